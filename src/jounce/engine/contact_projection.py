"""The motion nearest to a given one that leaves contacts where they are at its start.

Problem: joints q(t) near given ones q*(t), and the position and quaternion p(t) of the base, with which all contacts
keep their poses, and the time derivatives of both.

Algorithm: q = q* + A_q^T mu, p = p_0 + N d, A_b^T mu = 0 with the rows A of the contacts at q*: to first order the
least change of the joints, while the base, which nothing drives, costs nothing. Newton's method finds y = (d; mu). Its
matrix gives y^(k) too, from what the contacts do where y^(k) is 0, order by order.

Invariant: contacts stay at every time, and rates are exact derivatives. It fails, with `JounceError`, where no y brings
all contacts to their places, and where the matrix is nearly singular, as with straight legs.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from jounce.core.errors import JounceError, join_names, quote_value
from jounce.core.typing import ArrayLike
from jounce.engine.along import check_motion
from jounce.engine.dispatch import compute
from jounce.engine.engine import Engine
from jounce.engine.generic_methods import as_tuple
from jounce.model.contacts import Contact
from jounce.model.coordinates import body_screws, velocity_map, velocity_rows
from jounce.model.mechanism import Mechanism, path_to, robot_size
from jounce.motion.base import FREE_JOINT_PLACES, compute_twists
from jounce.motion.curves import ArrangedCurve, DerivedCurve, Jump, find_jumps, keep_by_order, sample_rates
from jounce.motion.motion import Motion
from jounce.spatial.groups import FREE
from jounce.spatial.lie import Ad, axial, inverse, position, rotation
from jounce.spatial.series import Series, column_series

MAX_PROJECTION_STEPS = 30  # of Newton's method, which takes four where feet are some cm off
PLACE_TOLERANCE = 1e-12  # rad or sizes of the robot: how far contacts may be from their places
MAX_REDUNDANT = 1e-13  # of the largest singular value: rounding, left of what contacts state twice
MIN_REGULAR = 1e-8  # of the same: less loses more than half of the digits
_CHANGE_SAMPLES = 500  # even times at which the change of a motion is measured


@dataclass(frozen=True, eq=False)
class ProjectedCurve(DerivedCurve):
    """The numbers of the base of a robot, as those of a free joint, and q, of which `base` is the given curve."""

    m: Mechanism
    numbers: np.ndarray  # (7,) of the base at the start
    anchors: Sequence[np.ndarray]  # the poses of the contacts there

    @property
    def columns(self) -> int:
        """The number of coordinates."""
        return 7 + self.base.columns

    def rates(self, t: np.ndarray, order: int, left: bool = False) -> list[np.ndarray]:
        """The values and their derivatives up to `order`; the last ones are kept: joints and base ask in turn."""
        times, from_left, known = vars(self).get("_last", (t[:0], left, []))
        if left != from_left or len(known) <= order or not np.array_equal(t, times):
            known = self._compute_rates(t, order, left)
            vars(self)["_last"] = t.copy(), left, known
        return [rate.copy() for rate in known[: order + 1]]  # whoever asks may write into them

    def _compute_rates(self, t: np.ndarray, order: int, left: bool) -> list[np.ndarray]:
        to_z = np.eye(self.columns)
        start = to_z[:, :7] @ self.numbers[:, None]
        given = to_z[:, 7:] @ column_series(self.base.rates(t, order, left)) + start
        AT = Series.of(self._rows("jacobian", given.upto(order))).mT
        of_y = np.eye(6 + AT[0].shape[2])  # d, then mu
        B = to_z[:, 7:] @ AT.map(lambda AT: AT[:, 6:]) @ of_y[6:] + to_z[:, :7] @ FREE.moves(self.numbers) @ of_y[:6]
        E = AT.map(lambda AT: AT[:, :6]) @ of_y[6:]
        y, inverse_there = self._close(t, given[0], B[0], E[0])
        terms = [y]
        for k in range(1, order + 1):
            Y = Series.of([*terms, 0 * y])
            twists = self._rows("twists", (given + B @ Y).upto(k))[-1]
            terms.append(-inverse_there @ np.concatenate([(E @ Y)[k], twists], axis=1))
        return [z[..., 0] for z in (given + B @ Series.of(terms)).upto(order)]

    def _close(self, t: np.ndarray, z: np.ndarray, B: np.ndarray, E: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """y with which all contacts are in their places, and the inverse of the matrix there."""
        y = np.zeros((len(t), B.shape[2], 1))
        of_base_motion = np.repeat([1.0, robot_size(self.m)], 3)  # of turns and slides
        sizes = np.concatenate([of_base_motion[contact.held] for contact in self.m.contacts])
        scales = np.concatenate([of_base_motion, 1 / sizes])  # of the rows and columns of the matrix
        for _ in range(MAX_PROJECTION_STEPS):
            x = z + B @ y
            poses, jacobians = self._frames(x)
            off = self._errors(poses)
            of_base = np.linalg.pinv(FREE.moves(x[:, :7, 0])) @ B[:, :7]
            rows = jacobians @ np.concatenate([of_base, B[:, 7:]], axis=1)
            inverse_there, lost = _invert(np.concatenate([E, rows], axis=1), scales)
            if (np.abs(off[..., 0]) < PLACE_TOLERANCE * sizes).all():
                break
            y = y - inverse_there @ np.concatenate([E @ y, off], axis=1)
        else:
            most = np.abs(off).max(axis=(1, 2))
            came = f"the contacts of {self.m.name!r} cannot stay: at t = {t[most.argmax()]:.6g} s they are"
            raise JounceError(f"{came} {most.max():.2g} m or rad from where they start; leave out those that move")
        if lost.any():
            came = f"joints and base of {self.m.name!r} hardly move its contacts in one direction"
            raise JounceError(
                f"{came} at t = {t[lost.argmax()]:.6g} s, as straight legs do; bend them, or leave one out"
            )
        return y, inverse_there

    def _rows(self, name: str, z: Sequence[np.ndarray]) -> list[np.ndarray]:
        """What contacts hold of Jacobians or twists of their frames, (N, k, ...), with derivatives."""
        robot, q, numbers = Engine(self.m), [x[:, 7:, 0] for x in z], [x[:, :7, 0] for x in z]
        base, found = (FREE.pose(numbers[0]), *compute_twists(FREE, numbers)), []
        for contact in self.m.contacts:
            terms = as_tuple(compute(robot, name, q, base=base, body=contact.frame, method="recursion"))
            rows = Ad(inverse(contact.place))[contact.held]
            found.append([rows @ x.reshape((len(x), 6, -1)) for x in terms])
        return [np.concatenate(parts, axis=1) for parts in zip(*found, strict=True)]

    def _frames(self, z: np.ndarray) -> tuple[list[np.ndarray], np.ndarray]:
        """The poses (N, 4, 4) of the contacts, and what they hold of their Jacobians, (N, k, nv)."""
        m, poses, rows = self.m, [], []
        H = compute(Engine(m), "poses", [z[:, 7:, 0]], base=(FREE.pose(z[:, :7, 0]),), method="recursion")
        for contact in m.contacts:
            link = m.frame(contact.frame)
            pose, path = H[:, link.body] @ link.T @ contact.place, path_to(m, link.body)
            seen = Ad(inverse(pose)[:, None] @ H[:, path])[:, :, contact.held]
            rows.append((seen @ self._screws[path]).sum(axis=1))
            poses.append(pose)
        return poses, np.concatenate(rows, axis=1)

    @cached_property
    def _screws(self) -> np.ndarray:
        """(nb, 6, nv): the twists of the bodies against their parents, by the velocities."""
        G = velocity_map(self.m)
        return np.stack([body_screws(self.m, i) @ G[velocity_rows(self.m, i)] for i in range(self.m.nb)])

    def _errors(self, poses: Sequence[np.ndarray]) -> np.ndarray:
        """How far contacts are from their places, (N, k, 1), in their axes: turned, then moved."""
        found = []
        for contact, pose, anchor in zip(self.m.contacts, poses, self.anchors, strict=True):
            H = inverse(anchor) @ pose
            R = rotation(H)
            turned = axial(R)[..., None] / (1 + np.trace(R, axis1=1, axis2=2))[:, None, None] * 2  # tan(angle / 2) * 2
            found.append(np.concatenate([turned, R.mT @ position(H)], axis=1)[:, contact.held])
        return np.concatenate(found, axis=1)

    @keep_by_order
    def jumps(self, order: int) -> list[Jump]:
        """Where a derivative up to `order` of the given joints jumps."""
        if not (t := self.inner_jumps(order)).size:
            return []
        before, after = (self.rates(t, order, left) for left in (True, False))
        return find_jumps(t, before, after, np.full(len(t), self.stop - self.start), sample_rates(self, order))

    def deviations(self, t: np.ndarray, order: int) -> list[np.ndarray] | None:
        """Those of the given joints: what they mean for the base is not known."""
        found = self.base.deviations(t, order)
        return found and [np.pad(x, ((0, 0), (7, 0))) for x in found]


def _invert(K: np.ndarray, scales: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pseudoinverses of matrices (N, m, m), without what contacts state twice, and which of them lose digits.

    The scales (m,) of rows and columns make entries of rad and m comparable.
    """
    U, s, Vh = np.linalg.svd(scales[:, None] * K * scales)
    share = s / s[:, :1]
    lost = ((share > MAX_REDUNDANT) & (share < MIN_REGULAR)).any(axis=1)
    inverse_of_scaled = (Vh.mT * np.where(share > MAX_REDUNDANT, 1 / s, 0)[:, None]) @ U.mT
    return scales[:, None] * inverse_of_scaled * scales, lost


def _contact_poses(m: Mechanism, contact: Contact, q: np.ndarray, C: np.ndarray) -> np.ndarray:
    H = compute(Engine(m), "poses", [q], base=(C,), body=contact.frame, method="recursion")
    return np.asarray(H @ contact.place)


def project(robot: Engine, motion: Any, base: ArrayLike | None) -> Motion:
    """The motion nearest to a given one that keeps the contacts of a robot, with a note of what it changes."""
    m, first = robot.mechanism, next(iter(robot.mechanism.contacts), None)
    if first is None:
        raise JounceError(f"{m.name!r} has no contacts that a motion could keep; robot.contacts([...]) states some")
    given, follows = motion, isinstance(motion, Motion) and motion.base_curve is None and base is None
    if isinstance(motion, Motion):
        C: Any = np.eye(4) if base is None else base
        given = motion.with_stances([]) if base is None and not follows else motion.with_stances([]).with_base(None, C)
    path = check_motion(replace(m, contacts=()), given)
    [q], [C] = path([path.start], 0), path.base([path.start], 0) or ()
    if follows:
        if first.kind == "point":
            came = f"the motion has no base, and {quote_value(first.frame)}, a point, no axes to begin with"
            raise JounceError(f"{came}; state base=C, the pose of the base at the start")
        C = inverse(_contact_poses(m, first, q, C))
    anchors = [_contact_poses(m, contact, q, C)[0] for contact in m.contacts]
    curve = ProjectedCurve(path.curve, m, FREE.numbers(C)[0], anchors)
    t = np.linspace(path.start, path.stop, _CHANGE_SAMPLES)
    change = np.abs(curve.rates(t, 0)[0][:, 7:] - path(t, 0)[0])
    i, j = np.unravel_index(change.argmax(), change.shape)
    frames = join_names(x.frame for x in m.contacts)
    changed = f"changes joint {quote_value(m.coordinates[j])} by up to {change[i, j]:.3g} at t = {t[i]:.6g} s"
    return replace(
        motion,
        curve=ArrangedCurve(curve, np.arange(7, curve.columns)),
        joint_names=path.joint_names,
        base_curve=ArrangedCurve(curve, np.argsort(FREE_JOINT_PLACES)),
        samples=None,
        residual=change.max(axis=0),
        grid=path.times,
        torques=path.torques,
        notes=(*path.notes, f"contacts at {frames} stay as at the start, which {changed}"),
    )
