"""Trace the steps of one joint for the loop form, once for each kind of joint.

A step is the recursion's work on one body: outward to its motion and the force that this takes, inward to the force of
its joint and what it hands on to its parent. What distinguishes joints of a kind are numbers in a table (`tables`), so
one trace serves them all: on a `Sheet`, a tape whose inputs and outputs have places in memory.

`Sweeps` are the steps to forces with their rates, by the mathematics of `dynamics.recursion.steps`. `ArticulatedSteps`
are those where forces are given and accelerations found, by that of `dynamics.recursion.articulated`, at order 0: they
depend on the position alone. Each is traced once per kernel and kind of joint; `loop` calls them for every body.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import accumulate
from typing import Any

import numpy as np

from jounce.core.scalars import Array, is_zero
from jounce.dynamics.computation import Computation
from jounce.dynamics.recursion import articulated
from jounce.dynamics.recursion.articulated import ArticulatedJoint
from jounce.dynamics.recursion.forces import AlignedJoint, BodyForce, BodyMotion, Moments, free_joint, ground
from jounce.dynamics.recursion.joints import MovingJoint, take_rows
from jounce.model import drive_trains
from jounce.model.equivalent_mechanisms import frame_shifts, minimal_mechanism
from jounce.model.mechanism import Mechanism
from jounce.native import memory_layout
from jounce.native.ir import JointStep
from jounce.native.memory_layout import VectorLayout
from jounce.program.passes import factor, fuse
from jounce.program.program import Tape
from jounce.spatial import inertia
from jounce.spatial.lie import Ad, ad, inverse, pose, position, rotation, wedge
from jounce.spatial.linear import Factors
from jounce.spatial.series import Series

JOINT_KINDS = ("revolute", "prismatic", "helical")
JOINT_SIZES = {"R": 9, "r": 3, "pitch": 1, "m": 1, "h": 3, "P": 6, "armature": 1}  # of a joint and its body
DRIVE_SIZES = dict.fromkeys(drive_trains.COEFFICIENTS, 1)  # of a joint's drive train
BASE_SIZES = {"g": 3, "m": 1, "h": 3, "P": 6}  # gravity, and the moments of a base that floats
CARRY_SIZES = {"R": 9, "r": 3}  # where the joint's frame lies in the body's own, in which wrenches are given
FORCE_ON_BASE = VectorLayout((("Q", 1, 6),))  # as an input lists it
_I = np.eye(3, dtype=int)
_UPPER = np.triu_indices(6)  # the entries of a symmetric matrix that are kept


class Sheet:
    """A tape whose inputs and outputs have places in memory, in parts of these layouts by its name."""

    def __init__(self, **layouts: VectorLayout) -> None:
        self.tape = Tape()
        self.layouts = layouts
        self.reads: list[tuple[str, int]] = []
        self.outputs: list[tuple[str, int, object]] = []

    def constants(self, sizes: dict[str, int]) -> dict[str, np.ndarray]:
        """Numbers from the joint's table."""
        self.reads += [("constants", i) for i in range(sum(sizes.values()))]
        return {name: self.tape.variables(size) for name, size in sizes.items()}

    def read(self, memory: str, name: str) -> Series:
        """A part of a body's vectors: a column, or a matrix of nine."""
        terms = []
        for places in self.layouts[memory].places(name):
            self.reads += [(memory, place) for place in places]
            terms.append(self.tape.variables(*((3, 3) if len(places) == 9 else (len(places), 1))))
        return Series.of(terms)

    def write(self, memory: str, name: str, values: Series) -> None:
        """A part of a body's vectors, as results."""
        for k, places in enumerate(self.layouts[memory].places(name)):
            self.outputs += [(memory, place, x) for place, x in zip(places, np.ravel(values[k]), strict=True)]

    def write_force(self, memory: str, force: BodyForce) -> None:
        """A force and its moment, as results."""
        self.write(memory, "f", force.f)
        self.write(memory, "n", force.n)

    def step(self) -> JointStep:
        """Return the recorded step."""
        program = fuse(factor(self.tape.program([x for _, _, x in self.outputs])))
        return JointStep(program, tuple(self.reads), tuple((memory, place) for memory, place, _ in self.outputs))


@dataclass(frozen=True)
class Sweeps:
    """The steps to forces with their rates up to an order, that of a computation or a lower one."""

    computation: Computation
    order: int
    acting: tuple[str, ...] = ()  # the terms of the drives in Q

    def sheet(self, **others: VectorLayout) -> Sheet:
        """A sheet for a step on a body or its parent, and the motion of either."""
        of_bodies = dict.fromkeys(("body", "parent"), self.layout)
        return Sheet(**of_bodies | dict.fromkeys(("motion", "carrier"), self.motion) | others)

    def name(self, step: str) -> str:
        """The name of a step of this order."""
        return f"{step}{self.order}"

    @property
    def motion(self) -> VectorLayout:
        """The vectors of the motion of a body."""
        return self._known(memory_layout.motion_layout(self.computation))

    @property
    def layout(self) -> VectorLayout:
        """The other vectors of a body."""
        return self._known(memory_layout.body_layout(self.computation))

    @property
    def base_motion(self) -> VectorLayout:
        """The vectors of the motion of the base."""
        return self._known(memory_layout.base_layout(self.computation))

    def _known(self, layout: VectorLayout) -> VectorLayout:
        return replace(layout, unknown=self.computation.order - self.order)

    def base(self, floating: bool) -> JointStep:
        """Trace the step from the base as it is given to the motion of the ground, with its inertia force if it floats.

        What carries the ground is the motion of the base, in the place of a parent's.
        """
        sheet = self.sheet(carrier=self.base_motion)
        c = sheet.constants(BASE_SIZES)
        C, V = sheet.read("carrier", "C")[0].reshape(4, 4), sheet.read("carrier", "V")
        kind = memory_layout.sweep_of(self.computation)
        B, X = np.eye(4, dtype=int), np.eye(6, dtype=int)
        found = kind.outward(free_joint(-1, B, X, pose(rotation(C), position(C)), V), ground(c["g"]))
        for name in kind.parts:
            sheet.write("motion", name, getattr(found, name))
        if floating:
            sheet.write_force("body", kind.force(moments(c), found))
        return sheet.step()

    def outward(self, kind: str) -> JointStep:
        """Trace the step from the parent's motion to the body's, with the inertia force."""
        sheet = self.sheet()
        joint, of_body = aligned_joint(sheet, kind)
        sweep = memory_layout.sweep_of(self.computation)
        parent = {name: sheet.read("carrier", name) for name in sweep.parts}
        found = sweep.outward(joint, BodyMotion(**vars(ground(np.zeros(3, dtype=int))) | parent))
        for name in sweep.parts:
            sheet.write("motion", name, getattr(found, name))
        sheet.write_force("body", sweep.force(of_body, found))
        return sheet.step()

    def add_wrench(self) -> JointStep:
        """Trace the step that adds the wrench of a body to the force on it."""
        sheet = self.sheet()
        T = sheet.constants(CARRY_SIZES)
        W = Ad(pose(T["R"].reshape(3, 3), T["r"][:, None])).mT @ sheet.read("body", "W")
        sheet.write("body", "f", sheet.read("body", "f") + take_rows(W, 3, 6))
        sheet.write("body", "n", sheet.read("body", "n") + take_rows(W, 0, 3))
        return sheet.step()

    def inward(self, kind: str) -> JointStep:
        """Trace the step from the force on a body to the joint force and the force on its parent."""
        sheet = self.sheet()
        joint, _ = aligned_joint(sheet, kind)
        on, parents = (BodyForce(sheet.read(memory, "f"), sheet.read(memory, "n")) for memory in ("body", "parent"))
        total = parents + joint.inward(on)
        sheet.write("body", "Q", joint.force(on))
        sheet.write_force("parent", total)
        return sheet.step()

    def drive(self) -> JointStep:
        """Trace the step that adds the drive terms to the joint force."""
        sheet = self.sheet()
        c, theta = sheet.constants(DRIVE_SIZES), sheet.read("body", "theta")
        Q = sheet.read("body", "Q") + drive_trains.forces(c, self.acting, theta)
        sheet.write(
            "body", "Q", Q + drive_trains.load_friction(c, theta, Q) if drive_trains.LOAD_FRICTION in self.acting else Q
        )
        return sheet.step()


def aligned_joint(sheet: Sheet, kind: str) -> tuple[AlignedJoint, Moments]:
    """A joint of a kind with the moments of its body, all numbers yet unknown."""
    c = sheet.constants(JOINT_SIZES)
    theta = sheet.read("body", "theta")
    pitch = screw_pitch(c, kind)
    joint = AlignedJoint(
        parent=0,
        R=c["R"].reshape(3, 3),
        r=c["r"][:, None],
        turn=turn_about_axis(sheet),
        theta=theta,
        turns=kind != "prismatic",
        d=None if kind == "revolute" else theta * pitch,
        pitch=pitch,
    )
    return joint, moments(c)


def screw_pitch(c: Mapping[str, np.ndarray], kind: str) -> np.ndarray:
    """How far a joint of a kind slides per unit of its variable, (1,)."""
    known = {"revolute": 0, "prismatic": 1}
    return np.array([known[kind]]) if kind in known else c["pitch"]


def turn_about_axis(sheet: Sheet) -> np.ndarray:
    """The rotation by the joint variable, (3, 3)."""
    s, co = (sheet.read("body", name)[0][0, 0] for name in ("sine", "cosine"))
    return np.array([[co, -s, 0], [s, co, 0], [0, 0, 1]], dtype=object)


def moments(c: Mapping[str, np.ndarray]) -> Moments:
    """The moments of a body in a table."""
    return c["m"][:, None], c["h"][:, None], inertia.symmetric_matrix(c["P"])


def joint_kinds(mechanism: Mechanism) -> list[str]:
    """The kind of each joint."""
    chain = minimal_mechanism(mechanism)
    return ["prismatic" if is_zero(X[2]) else "revolute" if is_zero(X[5]) else "helical" for X in chain.X]


def tables(mechanism: Mechanism, of_joints: Sequence[int]) -> dict[str, Sequence[float] | Sequence[int]]:
    """The constants of a robot by table; `of_joints` are the numbers of the kinds of its joints.

    "constants", "drives", "base" and "carry" hold what the sizes above list; the ground's inertia is not read.
    """
    chain, above = minimal_mechanism(mechanism), memory_layout.carriers(mechanism)
    owners = list(chain.owners)
    joints = [
        np.concatenate([*map(np.ravel, (rotation(B), position(B), X[5:])), _moment_row(M), [armature]])
        for B, X, M, armature in zip(chain.B[owners], chain.X, chain.M[owners], mechanism.drives.armature, strict=True)
    ]
    T, G = frame_shifts(mechanism, chain), mechanism.G.astype(float)
    followed = [np.flatnonzero(row).tolist() or [0] for row in G]  # coordinates by joint, at least one
    return {
        "kinds": of_joints,
        "parents": [p + 1 for p in above],
        "slots": memory_layout.motion_slots(above),
        "constants": _flatten(joints),
        "drives": _flatten(np.concatenate(list(drive_trains.coefficients(mechanism.drives).values()), axis=1)),
        "carry": _flatten(np.concatenate([rotation(T).reshape(-1, 9), position(T).reshape(-1, 3)], axis=1)),
        "base": _flatten(np.concatenate([chain.gravity, _moment_row(chain.M[0])])),
        "entries": [0, *accumulate(map(len, followed))],  # those of joint i: from entry i to entry i + 1
        "coordinates": [j for row in followed for j in row],
        "factors": [float(row[j]) for row, listed in zip(G, followed, strict=True) for j in listed],
        "offsets": _flatten(mechanism.g),
    }


def _flatten(numbers: Any) -> list[float]:
    return np.array(numbers, dtype=float).ravel().tolist()


def _moment_row(M: np.ndarray) -> np.ndarray:
    """The moments of a mass matrix as a row of ten."""
    m, h, P = inertia.moments(M)
    return np.concatenate([np.ravel(m), np.ravel(h), P[np.triu_indices(3)]])


@dataclass(frozen=True)
class ArticulatedSteps:
    """The steps that find accelerations, or their rates, of a joint and of a floating base."""

    sweeps: Sweeps

    def articulate(self, kind: str) -> JointStep:
        """Trace the step from the articulated inertia of a body to the share of its parent."""
        sheet = self.sweeps.sheet()
        joint, c = _moving_joint(sheet, kind)
        acting = int("armature" in self.sweeps.acting)
        own, felt = articulated.articulate(joint, _articulated_inertia(sheet, c), c["armature"] * acting)
        _write_body(sheet, "share", own.share)
        _write_body(sheet, "inverse_D", own.D.inverse_D[0])
        sheet.write("parent", "I", sheet.read("parent", "I") + felt[_UPPER][:, None])
        return sheet.step()

    def balance(self, kind: str) -> JointStep:
        """Trace the step from the force on a joint, u, to what it leaves, and to the share of the parent in F."""
        sheet = self.sweeps.sheet()
        left, felt = _articulated_joint(sheet, kind).balance(_read_body(sheet, "u"), _read_body(sheet, "F"))
        _write_body(sheet, "u", left)
        sheet.write("parent", "F", sheet.read("parent", "F") + felt)
        return sheet.step()

    def accelerate(self, kind: str) -> JointStep:
        """Trace the step from the parent's acceleration to that of the joint, in the place of u, and of the body."""
        sheet = self.sweeps.sheet()
        x, A = _articulated_joint(sheet, kind).accelerate(_read_body(sheet, "u"), sheet.read("parent", "A")[0])
        _write_body(sheet, "u", x)
        _write_body(sheet, "A", A)
        return sheet.step()

    def accelerate_base(self) -> JointStep:
        """Trace the step from all that acts on a floating base to the rate of its twist.

        The force that is given is in the place of a parent's vectors.
        """
        sheet = self.sweeps.sheet(parent=FORCE_ON_BASE, carrier=self.sweeps.base_motion)
        M = _articulated_inertia(sheet, sheet.constants(BASE_SIZES))
        n, f = (sheet.read("body", name)[self.sweeps.order] for name in ("n", "f"))
        left = sheet.read("parent", "Q")[0] - np.concatenate([n, f]) - _read_body(sheet, "F")
        A = Factors.of(M).solve(left)
        _write_body(sheet, "A", A)
        *_, highest = sheet.layouts["carrier"].places("V")
        sheet.outputs += [("carrier", place, x) for place, x in zip(highest, A[:, 0], strict=True)]
        return sheet.step()


def _articulated_joint(sheet: Sheet, kind: str) -> ArticulatedJoint:
    """A joint that moves an articulated body, as `articulate` has left it."""
    joint, _ = _moving_joint(sheet, kind)
    D = Factors((np.zeros(0, dtype=int),), (_read_body(sheet, "inverse_D")[0],))
    return ArticulatedJoint(joint, D, _read_body(sheet, "share"))


def _articulated_inertia(sheet: Sheet, c: Mapping[str, np.ndarray]) -> Array:
    """The inertia of a body and what it feels of those that it carries, (6, 6)."""
    return inertia.from_moments(*moments(c)) + inertia.symmetric_matrix(_read_body(sheet, "I")[:, 0])


def _moving_joint(sheet: Sheet, kind: str) -> tuple[MovingJoint, Mapping[str, np.ndarray]]:
    """A joint of a kind at a position, and its table, all numbers yet unknown."""
    c = sheet.constants(JOINT_SIZES)
    pitch, turns = screw_pitch(c, kind), int(kind != "prismatic")
    X = np.array([0, 0, turns, 0, 0, *pitch])[:, None]
    turn = turn_about_axis(sheet) if turns else _I
    T = pose(c["R"].reshape(3, 3) @ turn, c["R"].reshape(3, 3) @ (_I[:, 2:] * (sheet.read("body", "theta")[0] * pitch)))
    offset, still = pose(_I, c["r"][:, None]), np.eye(4, dtype=int)
    joint = MovingJoint(
        parent=0,
        B=offset,
        offset=offset,
        turn=still,
        Ad_offset=Ad(inverse(offset)),
        Ad_turn=Ad(still),
        X=X,
        ad_X=ad(X.T),
        X_hat=wedge(X.T),
        rate=Series.constant(0 * pitch[:, None]),
        T=T,
        A=Ad(inverse(T)),
    )
    return joint, c


def _read_body(sheet: Sheet, name: str) -> Array:
    return sheet.read("body", name)[0]


def _write_body(sheet: Sheet, name: str, value: Array) -> None:
    sheet.write("body", name, Series.of([value]))
