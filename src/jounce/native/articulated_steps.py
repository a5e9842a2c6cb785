"""The steps of articulated bodies for one joint, traced once for each kind of joint, as those of forces are.

The mathematics is that of `dynamics.recursion.articulated`, at order 0: it depends on the position alone.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from jounce.core.scalars import Array
from jounce.dynamics.recursion import articulated
from jounce.dynamics.recursion.articulated import ArticulatedJoint
from jounce.dynamics.recursion.joints import MovingJoint
from jounce.native.emit import JointStep
from jounce.native.loop_steps import (
    BASE_SIZES,
    JOINT_SIZES,
    Sheet,
    Sweeps,
    moments,
    screw_pitch,
    turn_about_axis,
)
from jounce.native.vector_layout import VectorLayout
from jounce.spatial import inertia
from jounce.spatial.lie import Ad, ad, inverse, pose, wedge
from jounce.spatial.linear import Factors
from jounce.spatial.series import Series

FORCE_ON_BASE = VectorLayout((("Q", 1, 6),))  # as an input lists it
_I = np.eye(3, dtype=int)
_UPPER = np.triu_indices(6)  # the entries of a symmetric matrix that are kept


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
        _write(sheet, "share", own.share)
        _write(sheet, "inverse_D", own.D.inverse_D[0])
        sheet.write("parent", "I", sheet.read("parent", "I") + felt[_UPPER][:, None])
        return sheet.step()

    def balance(self, kind: str) -> JointStep:
        """Trace the step from the force on a joint, u, to what it leaves, and to the share of the parent in F."""
        sheet = self.sweeps.sheet()
        left, felt = _articulated_joint(sheet, kind).balance(_read(sheet, "u"), _read(sheet, "F"))
        _write(sheet, "u", left)
        sheet.write("parent", "F", sheet.read("parent", "F") + felt)
        return sheet.step()

    def accelerate(self, kind: str) -> JointStep:
        """Trace the step from the parent's acceleration to that of the joint, in the place of u, and of the body."""
        sheet = self.sweeps.sheet()
        x, A = _articulated_joint(sheet, kind).accelerate(_read(sheet, "u"), sheet.read("parent", "A")[0])
        _write(sheet, "u", x)
        _write(sheet, "A", A)
        return sheet.step()

    def accelerate_base(self) -> JointStep:
        """Trace the step from all that acts on a floating base to the rate of its twist.

        The force that is given is in the place of a parent's vectors.
        """
        sheet = self.sweeps.sheet(parent=FORCE_ON_BASE, carrier=self.sweeps.base_motion)
        M = _articulated_inertia(sheet, sheet.constants(BASE_SIZES))
        n, f = (sheet.read("body", name)[self.sweeps.order] for name in ("n", "f"))
        left = sheet.read("parent", "Q")[0] - np.concatenate([n, f]) - _read(sheet, "F")
        A = Factors.of(M).solve(left)
        _write(sheet, "A", A)
        *_, highest = sheet.layouts["carrier"].places("V")
        sheet.outputs += [("carrier", place, x) for place, x in zip(highest, A[:, 0], strict=True)]
        return sheet.step()


def _articulated_joint(sheet: Sheet, kind: str) -> ArticulatedJoint:
    """A joint that moves an articulated body, as `articulate` has left it."""
    joint, _ = _moving_joint(sheet, kind)
    D = Factors((np.zeros(0, dtype=int),), (_read(sheet, "inverse_D")[0],))
    return ArticulatedJoint(joint, D, _read(sheet, "share"))


def _articulated_inertia(sheet: Sheet, c: Mapping[str, np.ndarray]) -> Array:
    """The inertia of a body and what it feels of those that it carries, (6, 6)."""
    return inertia.from_moments(*moments(c)) + inertia.symmetric_matrix(_read(sheet, "I")[:, 0])


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


def _read(sheet: Sheet, name: str) -> Array:
    return sheet.read("body", name)[0]


def _write(sheet: Sheet, name: str, value: Array) -> None:
    sheet.write("body", name, Series.of([value]))
