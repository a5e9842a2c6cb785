"""Trace the steps of one joint for the loop form.

They are traced once for each kind of joint. A step is the recursion's work on one body: outward to its motion and the
force that this takes, inward to the force of its joint and what it hands on to its parent. What distinguishes joints of
a kind are numbers in a table (`tables`), so one trace serves them all: on a `Sheet`, a tape whose inputs and outputs
have places in memory.

`Sweeps` are the steps to forces with their rates, by the mathematics of `dynamics.recursion.steps`. `ArticulatedSteps`
are those where forces are given and accelerations found, by that of `dynamics.recursion.articulated`, at order 0: they
depend on the position alone. Each is traced once per kernel and kind of joint; the code that `loop` writes calls them
for every body of every block of states.
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
    """A tape whose inputs and outputs have places in memory.

    `layouts` has one layout for each part of memory, by its name: "body", "parent", "motion" and others.
    """

    def __init__(self, **layouts: VectorLayout) -> None:
        self.tape = Tape()
        self.layouts = layouts
        self.reads: list[tuple[str, int]] = []
        self.outputs: list[tuple[str, int, object]] = []

    def constants(self, sizes: dict[str, int]) -> dict[str, np.ndarray]:
        """Read numbers from a joint's table, in the order of `sizes`."""
        self.reads += [("constants", i) for i in range(sum(sizes.values()))]
        return {name: self.tape.variables(size) for name, size in sizes.items()}

    def read(self, memory: str, name: str) -> Series:
        """Read a part of a body's vectors with its rates: columns, or 3 by 3 matrices of nine."""
        terms = []
        for places in self.layouts[memory].places(name):
            self.reads += [(memory, place) for place in places]
            terms.append(self.tape.variables(*((3, 3) if len(places) == 9 else (len(places), 1))))
        return Series.of(terms)

    def write(self, memory: str, name: str, values: Series) -> None:
        """Write a part of a body's vectors, with its rates."""
        for k, places in enumerate(self.layouts[memory].places(name)):
            self.outputs += [(memory, place, x) for place, x in zip(places, np.ravel(values[k]), strict=True)]

    def write_force(self, memory: str, force: BodyForce) -> None:
        """Write a force and its moment, with their rates."""
        self.write(memory, "f", force.f)
        self.write(memory, "n", force.n)

    def step(self) -> JointStep:
        """Return the recorded step, its operations shared and fused."""
        program = fuse(factor(self.tape.program([x for _, _, x in self.outputs])))
        return JointStep(program, tuple(self.reads), tuple((memory, place) for memory, place, _ in self.outputs))


@dataclass(frozen=True)
class Sweeps:
    """The steps to forces with their rates up to an order.

    The order is that of the computation, or a lower one while accelerations are found. All orders share one memory, so
    that layouts are those of the computation, with the highest rates not known yet.
    """

    computation: Computation
    order: int
    acting: tuple[str, ...] = ()  # the terms of the drives in Q

    def sheet(self, **others: VectorLayout) -> Sheet:
        """Return a sheet for a body, its parent, and their motions."""
        of_bodies = dict.fromkeys(("body", "parent"), self.layout)
        return Sheet(**of_bodies | dict.fromkeys(("motion", "carrier"), self.motion) | others)

    def name(self, step: str) -> str:
        """Return the name of a step of this order."""
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
        """Return a layout whose rates above this order are unknown."""
        return replace(layout, unknown=self.computation.order - self.order)

    def base(self, floating: bool) -> JointStep:
        """Trace the step from the base's motion to that of the ground.

        A base that floats has an inertia force, which the step adds. In the place of a parent's motion, "carrier" is
        the given motion of the base.
        """
        sheet = self.sheet(carrier=self.base_motion)
        c = sheet.constants(BASE_SIZES)
        # The base moves as the body of a free joint on a ground at rest, which has gravity alone.
        C, V = sheet.read("carrier", "C")[0].reshape(4, 4), sheet.read("carrier", "V")
        kind = memory_layout.sweep_of(self.computation)
        B, X = np.eye(4, dtype=int), np.eye(6, dtype=int)
        motion = kind.outward(free_joint(-1, B, X, pose(rotation(C), position(C)), V), ground(c["g"]))
        for name in kind.parts:
            sheet.write("motion", name, getattr(motion, name))
        if floating:
            sheet.write_force("body", kind.force(moments(c), motion))
        return sheet.step()

    def outward(self, kind: str) -> JointStep:
        """Trace the step to a body's motion and inertia force.

        It starts from the motion of the parent.
        """
        sheet = self.sheet()
        joint, body_moments = aligned_joint(sheet, kind)
        sweep = memory_layout.sweep_of(self.computation)
        # Some quantities need only parts of a motion. All other parts are those of the ground at rest.
        parent = {name: sheet.read("carrier", name) for name in sweep.parts}
        motion = sweep.outward(joint, BodyMotion(**vars(ground(np.zeros(3, dtype=int))) | parent))
        for name in sweep.parts:
            sheet.write("motion", name, getattr(motion, name))
        # The force that the motion takes starts the total on the body, to which children add theirs.
        sheet.write_force("body", sweep.force(body_moments, motion))
        return sheet.step()

    def add_wrench(self) -> JointStep:
        """Trace the step that adds the wrench of a body."""
        sheet = self.sheet()
        T = sheet.constants(CARRY_SIZES)
        # Wrenches are given in the body's own frame, and the sweep works in the joint's: Ad^T takes them there.
        W = Ad(pose(T["R"].reshape(3, 3), T["r"][:, None])).mT @ sheet.read("body", "W")
        sheet.write("body", "f", sheet.read("body", "f") + take_rows(W, 3, 6))
        sheet.write("body", "n", sheet.read("body", "n") + take_rows(W, 0, 3))
        return sheet.step()

    def inward(self, kind: str) -> JointStep:
        """Trace the step to the joint force and the parent's force.

        It starts from the force on the body.
        """
        sheet = self.sheet()
        joint, _ = aligned_joint(sheet, kind)
        # The force on the body is complete: children come before parents. The joint's share of it is Q, and all of it
        # goes on to the parent.
        body_force, parent_force = (
            BodyForce(sheet.read(memory, "f"), sheet.read(memory, "n")) for memory in ("body", "parent")
        )
        total = parent_force + joint.inward(body_force)
        sheet.write("body", "Q", joint.force(body_force))
        sheet.write_force("parent", total)
        return sheet.step()

    def drive(self) -> JointStep:
        """Trace the step that adds the drive terms to the joint force."""
        sheet = self.sheet()
        c, theta = sheet.constants(DRIVE_SIZES), sheet.read("body", "theta")
        Q = sheet.read("body", "Q") + drive_trains.forces(c, self.acting, theta)
        # This friction goes with the force that the drive transmits, all other terms included.
        if drive_trains.LOAD_FRICTION in self.acting:
            Q = Q + drive_trains.load_friction(c, theta, Q)
        sheet.write("body", "Q", Q)
        return sheet.step()


def aligned_joint(sheet: Sheet, kind: str) -> tuple[AlignedJoint, Moments]:
    """Return a joint of a kind, and the moments of its body.

    All their numbers are inputs of the tape.
    """
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
    """Return the slide of a joint per unit of its variable, (1,)."""
    # That of two kinds is a constant of the trace, which costs nothing; that of helical joints is in the table.
    known = {"revolute": 0, "prismatic": 1}
    return np.array([known[kind]]) if kind in known else c["pitch"]


def turn_about_axis(sheet: Sheet) -> np.ndarray:
    """Return the rotation about z by the joint variable, (3, 3)."""
    s, co = (sheet.read("body", name)[0][0, 0] for name in ("sine", "cosine"))
    return np.array([[co, -s, 0], [s, co, 0], [0, 0, 1]], dtype=object)


def moments(c: Mapping[str, np.ndarray]) -> Moments:
    """Return the moments of a body from its row of a table: mass m, h = m r, second moments P."""
    return c["m"][:, None], c["h"][:, None], inertia.symmetric_matrix(c["P"])


def joint_kinds(mechanism: Mechanism) -> list[str]:
    """Return the kind of each joint, by its screw along z."""

    def joint_kind(X: np.ndarray) -> str:
        if is_zero(X[2]):
            return "prismatic"
        return "revolute" if is_zero(X[5]) else "helical"

    return [joint_kind(X) for X in minimal_mechanism(mechanism).X]


def tables(mechanism: Mechanism, kind_numbers: Sequence[int]) -> dict[str, Sequence[float] | Sequence[int]]:
    """Return the constants of a robot by table.

    `kind_numbers` has the number of each joint's kind. "constants", "drives", "base" and "carry" hold what the
    sizes above list; the ground's inertia is not read.
    """
    chain, carriers = minimal_mechanism(mechanism), memory_layout.carriers(mechanism)
    owners = list(chain.owners)
    # Rows as `JOINT_SIZES` lists them.
    joints = [
        np.concatenate([*map(np.ravel, (rotation(B), position(B), X[5:])), _moment_row(M), [armature]])
        for B, X, M, armature in zip(chain.B[owners], chain.X, chain.M[owners], mechanism.drives.armature, strict=True)
    ]
    T, G = frame_shifts(mechanism, chain), mechanism.G.astype(float)
    # The coordinates that each joint follows: at least one, with factor 0, as loops in the code run at least once.
    followed = [np.flatnonzero(row).tolist() or [0] for row in G]
    return {
        "kinds": kind_numbers,
        "parents": [p + 1 for p in carriers],
        "slots": memory_layout.motion_slots(carriers),
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
    """Return the ten moments of a mass matrix: m, h and the upper triangle of P."""
    m, h, P = inertia.moments(M)
    return np.concatenate([np.ravel(m), np.ravel(h), P[np.triu_indices(3)]])


@dataclass(frozen=True)
class ArticulatedSteps:
    """The steps that find accelerations, or their rates.

    They are those of a joint and of a floating base. They solve M x = u by articulated bodies: `articulate` factors
    M, inward and at order 0 only; `balance` reduces the right side, inward; `accelerate` finds x, outward.
    """

    sweeps: Sweeps

    def articulate(self, kind: str) -> JointStep:
        """Trace the step to what a parent feels of an inertia.

        It starts from the articulated inertia of the body.
        """
        sheet = self.sweeps.sheet()
        joint, c = _moving_joint(sheet, kind)
        acting = int("armature" in self.sweeps.acting)
        body, inertia_on_parent = articulated.articulate(joint, _articulated_inertia(sheet, c), c["armature"] * acting)
        # The later steps of the joint, at all orders, need only its share I X / D and 1 / D, D = X^T I X + armature.
        _write_body(sheet, "share", body.share)
        _write_body(sheet, "inverse_D", body.D.inverse_D[0])
        # The inertia is symmetric: (6, 6) -> (21, 1).
        sheet.write("parent", "I", sheet.read("parent", "I") + inertia_on_parent[_UPPER][:, None])
        return sheet.step()

    def balance(self, kind: str) -> JointStep:
        """Trace the step that reduces u and passes F on.

        u is the force on the joint, F what the parent feels.
        """
        sheet = self.sweeps.sheet()
        # F is what the children have left on the body. The joint resists a part of it, and the parent feels the rest.
        reduced_u, F_on_parent = _articulated_joint(sheet, kind).balance(_read_body(sheet, "u"), _read_body(sheet, "F"))
        _write_body(sheet, "u", reduced_u)
        sheet.write("parent", "F", sheet.read("parent", "F") + F_on_parent)
        return sheet.step()

    def accelerate(self, kind: str) -> JointStep:
        """Trace the step to the acceleration of joint and body.

        It starts from that of the parent. The acceleration of the joint takes the place of u.
        """
        sheet = self.sweeps.sheet()
        x, A = _articulated_joint(sheet, kind).accelerate(_read_body(sheet, "u"), sheet.read("parent", "A")[0])
        _write_body(sheet, "u", x)
        _write_body(sheet, "A", A)
        return sheet.step()

    def accelerate_base(self) -> JointStep:
        """Trace the step to the rate of the base's twist.

        It starts from all that acts on the base. The given force on the base is in the place of a parent's
        vectors.
        """
        sheet = self.sweeps.sheet(parent=FORCE_ON_BASE, carrier=self.sweeps.base_motion)
        M = _articulated_inertia(sheet, sheet.constants(BASE_SIZES))
        # M A = Q - (the wrench that the motion takes without A) - F, with M the inertia of the whole robot at the base.
        n, f = (sheet.read("body", name)[self.sweeps.order] for name in ("n", "f"))
        remaining = sheet.read("parent", "Q")[0] - np.concatenate([n, f]) - _read_body(sheet, "F")
        A = Factors.of(M).solve(remaining)
        _write_body(sheet, "A", A)
        # A is the rate of V that the next order takes as known.
        *_, highest = sheet.layouts["carrier"].places("V")
        sheet.outputs += [("carrier", place, x) for place, x in zip(highest, A[:, 0], strict=True)]
        return sheet.step()


def _articulated_joint(sheet: Sheet, kind: str) -> ArticulatedJoint:
    """Return a joint with what `articulate` has written."""
    joint, _ = _moving_joint(sheet, kind)
    D = Factors((np.zeros(0, dtype=int),), (_read_body(sheet, "inverse_D")[0],))
    return ArticulatedJoint(joint, D, _read_body(sheet, "share"))


def _articulated_inertia(sheet: Sheet, c: Mapping[str, np.ndarray]) -> Array:
    """Return the inertia of a body with its children's share, (6, 6)."""
    return inertia.from_moments(*moments(c)) + inertia.symmetric_matrix(_read_body(sheet, "I")[:, 0])


def _moving_joint(sheet: Sheet, kind: str) -> tuple[MovingJoint, Mapping[str, np.ndarray]]:
    """Return a joint of a kind, and its row of the table."""
    c = sheet.constants(JOINT_SIZES)
    pitch, turns = screw_pitch(c, kind), int(kind != "prismatic")
    X = np.array([0, 0, turns, 0, 0, *pitch])[:, None]
    turn = turn_about_axis(sheet) if turns else _I
    # The joint's constant rotation R and its motion are one pose T, after the offset r. Accelerations need no rates.
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
