"""Find the nearest motion that leaves contacts where they start.

Problem: joints q(t) near given ones q*(t), and the position and quaternion p(t) of the base, with which all contacts
keep their poses, and the time derivatives of both.

Algorithm: q = q* + A_q^T mu, p = p_0 + N d, A_b^T mu = 0 with the rows A of the contacts at q*: to first order the
least change of the joints, while the base, which nothing drives, costs nothing. All is seen from the base at its start:
d is the turn from there, about its axis by twice the tangent of half the angle, and the place. Newton's method finds
y = (d; mu). With the twist U of the base, the rates v = (U; mu') move contacts by e U + a q', their rows at q. So

    K = [[0, A_b^T], [e, a A_q^T]]

takes v to the rates of A_b^T mu and of the errors of the contacts. Where they are closed, both are 0 at all times. K is
inverted once: it gives v^(k) too, from what the two would do if v^(k) were 0, order by order. The wrenches e of
contacts that stay are constant, but for turns that mix components that a point or line holds.

Invariant: contacts stay at every time, and rates are exact derivatives. It fails, with `JounceError`, where no y brings
all contacts to their places, and where K is nearly singular, as with straight legs.

Cost of some times: for each step of Newton's method, the poses of all bodies, which native code computes, and an
inverse of K; then a dozen products of arrays for each order. One time takes nearly as long as ten.
"""

from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from jounce.core.errors import JounceError, join_names, quote_value
from jounce.core.typing import ArrayLike
from jounce.dynamics.contacts import ContactPaths, contact_paths
from jounce.engine.along import check_motion
from jounce.engine.engine import Engine
from jounce.engine.plan import compute
from jounce.model.mechanism import Mechanism, robot_size
from jounce.motion.base import FREE_JOINT_PLACES
from jounce.motion.curves import ArrangedCurve, DerivedCurve, Jump, find_jumps, keep_by_order, sample_rates
from jounce.motion.motion import Motion
from jounce.spatial import groups
from jounce.spatial.lie import ad, axial, hat, inverse, position, rotation
from jounce.spatial.series import product_rate, with_rates

MAX_PROJECTION_STEPS = 30  # of Newton's method, which takes four where feet are some cm off
PLACE_TOLERANCE = 1e-12  # rad or sizes of the robot: how far contacts may be from their places
DIVERGED = 1e6  # of y, without unit: Newton's method has left all places that a robot can have
MAX_REDUNDANT = 1e-13  # of the largest singular value: rounding, left of what contacts state twice
MIN_REGULAR = 1e-8  # of the same: less loses more than half of the digits
_CHANGE_SAMPLES = 500  # even times at which the change of a motion is measured
_RESTING = groups.FREE.resting  # (7,), numbers of a base that is where it starts, as seen from there
_FROM_REST = groups.FREE.moves(_RESTING)  # (7, 6), N there


@dataclass(frozen=True, eq=False)
class ProjectedCurve(DerivedCurve):
    """The coordinates of a projected motion: place and quaternion of the base (7), then q (n).

    `base` is the given curve of q.
    """

    m: Mechanism
    numbers: np.ndarray  # (7,) of the base at the start
    anchors: np.ndarray  # (c, 4, 4), the poses of the contacts there, seen from the base

    @property
    def columns(self) -> int:
        """The number of coordinates."""
        return 7 + self.base.columns

    def rates(self, t: np.ndarray, order: int, left: bool = False) -> list[np.ndarray]:
        """Return the values and their derivatives up to `order`.

        The last ones are kept, as joints and base ask for them in turn.
        """
        times, from_left, last_rates = vars(self).get("_last", (t[:0], left, []))
        if left != from_left or len(last_rates) <= order or not np.array_equal(t, times):
            last_rates = self._compute_rates(t, order, left)
            vars(self)["_last"] = t.copy(), left, last_rates
        # Whoever asks may write into them.
        return [rate.copy() for rate in last_rates[: order + 1]]

    def _compute_rates(self, t: np.ndarray, order: int, left: bool) -> list[np.ndarray]:
        """Return the coordinates (N, 7 + n) with their rates."""
        # The given joints with rates, (order + 1, N, n, 1), and with them A.
        q = np.stack(self.base.rates(t, order, left))[..., None]
        A = self._rows_of_given(q)
        d, joints = self._follow(self._close(t, q[0], A[0]), q, A)
        # p = p_0 + N d; both parts one behind the other, (order + 1, N, 7 + n, 1).
        p = self._N @ d
        p[0] += self.numbers[:, None]
        return list(np.concatenate([p, joints], axis=2)[..., 0])

    def _rows_of_given(self, q: np.ndarray) -> np.ndarray:
        """Return A of the given joints, with rates.

        It is (order + 1, N, k, 6 + n). The base rests as at the start.
        """
        H = _body_poses(self.m, q[0], np.eye(4))
        return self._paths.rows_at_rest(self._paths.screws(H), self._paths.wrenches(self._paths.poses(H)), q[1:])

    def _close(self, t: np.ndarray, q: np.ndarray, A: np.ndarray) -> "_ClosedContacts":
        """Find y with all contacts in their places.

        By Newton's method. All times are one batch, which stops when the last one has converged.
        """
        paths, A_b, A_q = self._paths, A[..., :6], A[..., 6:]
        y = np.zeros((len(t), 6 + A.shape[1], 1))
        for _ in range(MAX_PROJECTION_STEPS):
            d, mu = y[:, :6], y[:, 6:]
            H = _body_poses(self.m, q + A_q.mT @ mu, _base_pose(d))
            poses, S = paths.poses(H), paths.screws(H)
            errors = self._errors(poses)
            # Rows of the rates of the errors, at the contacts as they are by now.
            e = paths.wrenches(poses)[..., 0]
            K = _matrix(A_b, e, paths.columns(e @ S[..., 0].mT) @ A_q.mT)
            K_inverse, lost = _invert(K, self._scales)
            gaps = (np.abs(errors[..., 0]) * self._scales[6:]).max(axis=1)
            if gaps.max() < PLACE_TOLERANCE:
                break
            # The step is what the rates v make of y if they take A_b^T mu and the errors to 0.
            v = -K_inverse @ np.concatenate([A_b.mT @ mu, errors], axis=1)
            y = y + v
            y[:, :6] += _base_turning(d[None], v[None, :, :6], 0) @ d
            if not (np.abs(y) / self._scales[:, None]).max() < DIVERGED:
                break
        if not gaps.max() < PLACE_TOLERANCE:
            distances = np.abs(errors).max(axis=(1, 2))
            came = f"the contacts of {self.m.name!r} cannot stay: at t = {t[distances.argmax()]:.6g} s they are"
            raise JounceError(f"{came} {distances.max():.2g} m or rad from where they start; leave out those that move")
        if lost.any():
            came = f"joints and base of {self.m.name!r} hardly move its contacts in one direction"
            raise JounceError(
                f"{came} at t = {t[lost.argmax()]:.6g} s, as straight legs do; bend them, or leave one out"
            )
        return _ClosedContacts(d, mu, S, e, K_inverse)

    def _follow(self, closed: "_ClosedContacts", q: np.ndarray, A: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return d and the joints with rates, one order after another.

        They are (order + 1, N, ..., 1). One order follows after the other, with the inverse of K of order 0.
        """
        paths, order, (N, k, n) = self._paths, len(q) - 1, A[0, ..., 6:].shape
        AT, joints, m = A.mT, q.copy(), len(paths.owners)
        d, mu, S = (with_rates(x, order) for x in (closed.d, closed.mu, closed.S))
        U, L = np.zeros((order, N, 6, 1)), np.zeros((order, N, 6, 6))
        a, turns = np.zeros((order, N, k, n)), np.zeros((order, N, m, 6, 6))
        # q = q* + A_q^T mu.
        joints[0] += AT[0, :, 6:] @ mu[0]
        for i in range(order):
            # What A_b^T mu and e U + a q' do where the i-th rate of v is 0, which is -K times it.
            by_mu = product_rate(AT, mu, i + 1)
            joints[i + 1] += by_mu[:, 6:]
            a[i] = paths.columns(closed.e @ S[i, ..., 0].mT)
            v = -closed.inverse @ np.concatenate([by_mu[:, :6], product_rate(a, joints[1:], i)], axis=1)
            U[i], mu[i + 1] = v[:, :6], v[:, 6:]
            joints[i + 1] += AT[0, :, 6:] @ mu[i + 1]
            # Where these rates lead the base and the screws.
            L[i] = _base_turning(d, U, i)
            d[i + 1] = U[i] + product_rate(L, d, i)
            turns[i] = ad(paths.carries @ paths.twists(S, joints[1:], i) + U[i].mT)
            S[i + 1] = product_rate(turns, S, i)
        return d, joints

    @cached_property
    def _paths(self) -> ContactPaths:
        return contact_paths(self.m)

    @cached_property
    def _N(self) -> np.ndarray:
        return groups.FREE.moves(self.numbers)

    @cached_property
    def _scales(self) -> np.ndarray:
        """Scales (6 + k,) that free K of units.

        Those of the base come first, then those of what the contacts hold.
        """
        # Of turns, then of slides.
        sizes = np.repeat([1.0, robot_size(self.m)], 3)
        return np.concatenate([sizes, 1 / sizes[self._paths.component]])

    @cached_property
    def _to_anchors(self) -> np.ndarray:
        return inverse(self.anchors)

    def _errors(self, poses: np.ndarray) -> np.ndarray:
        """Return how far contacts are off, (N, k, 1), in their axes."""
        H = self._to_anchors @ poses
        R = rotation(H)
        # The turn about its axis by 2 tan(angle / 2), then the slide: (N, contacts, 6).
        turn = axial(R) / (1 + np.trace(R, axis1=-2, axis2=-1))[..., None] * 2
        components = np.concatenate([turn, (R.mT @ position(H))[..., 0]], axis=-1)
        # Only components that contacts hold.
        return components[:, self._paths.contact, self._paths.component, None]

    @keep_by_order
    def jumps(self, order: int) -> list[Jump]:
        """Return where a derivative up to `order` of the given joints jumps."""
        t = self.inner_jumps(order)
        if t.size == 0:
            return []
        before, after = (self.rates(t, order, left) for left in (True, False))
        return find_jumps(t, before, after, np.full(len(t), self.stop - self.start), sample_rates(self, order))

    def deviations(self, t: np.ndarray, order: int) -> list[np.ndarray] | None:
        """Return the deviations of the joints, and 0 for the base.

        Those of the base are not known.
        """
        deviations = self.base.deviations(t, order)
        return None if deviations is None else [np.pad(x, ((0, 0), (7, 0))) for x in deviations]


@dataclass(frozen=True, eq=False)
class _ClosedContacts:
    """Where all contacts are in their places: y = (d; mu), the screws S of the joints, the wrenches e, and K^-1."""

    d: np.ndarray
    mu: np.ndarray
    S: np.ndarray
    e: np.ndarray
    inverse: np.ndarray


def _matrix(A_b: np.ndarray, e: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Return K, (N, 6 + k, 6 + k): ``[[0, A_b^T], [e, a A_q^T]]``."""
    N, k = A_b.shape[:2]
    K = np.zeros((N, 6 + k, 6 + k))
    K[:, :6, 6:], K[:, 6:, :6], K[:, 6:, 6:] = A_b.mT, e, columns
    return K


def _invert(K: np.ndarray, scales: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return pseudoinverses of (N, m, m), and which lose digits.

    Directions that contacts state twice are left out. The scales (m,) of rows and columns make entries of rad and m
    comparable.
    """
    scaled = scales[:, None] * K * scales
    # Matrices that are regular for certain need no singular values, which take three times as long as inverses.
    with suppress(np.linalg.LinAlgError):
        inverse_of_scaled = np.linalg.inv(scaled)
        # Products of these norms are not below the ratio of the largest and the least singular value.
        conditions = np.linalg.norm(scaled, axis=(1, 2)) * np.linalg.norm(inverse_of_scaled, axis=(1, 2))
        if (conditions < 1 / MIN_REGULAR).all():
            return scales[:, None] * inverse_of_scaled * scales, np.zeros(len(K), dtype=bool)
    # Singular values that are rounding belong to what is stated twice; small ones above that lose digits.
    U, s, Vh = np.linalg.svd(scaled)
    share = s / s[:, :1]
    independent = share > MAX_REDUNDANT
    lost = (independent & (share < MIN_REGULAR)).any(axis=1)
    inverse_of_scaled = (Vh.mT * (independent / np.where(independent, s, 1.0))[:, None]) @ U.mT
    return scales[:, None] * inverse_of_scaled * scales, lost


def _base_pose(d: np.ndarray) -> np.ndarray:
    """Return the pose (N, 4, 4) of the base at d.

    d is (N, 6, 1), seen from where the base starts.
    """
    return groups.FREE.pose(_RESTING + (_FROM_REST @ d)[..., 0])


def _base_turning(d: np.ndarray, U: np.ndarray, k: int) -> np.ndarray:
    """Return the k-th rate of L of a base.

    L, (N, 6, 6), is that in ``d' = U + L d``, with the twist U. It takes the rates of d and U up to k. ``d = (x;
    r)`` has the rates ``x' = w + w x / 2 + x (w . x) / 4`` and ``r' = v + w x r``.
    """
    w, L = U[:, :, :3], np.zeros((U.shape[1], 6, 6))
    L[:, 3:, 3:] = hat(w[k, ..., 0])
    L[:, :3, :3] = L[:, 3:, 3:] / 2 + product_rate(d[:, :, :3], w.mT, k) / 4
    return L


@lru_cache(maxsize=64)
def _free_robot(m: Mechanism) -> Engine:
    """Return the robot without contacts: poses of bodies do not depend on them."""
    return Engine(replace(m, contacts=()))


def _body_poses(m: Mechanism, q: np.ndarray, C: np.ndarray) -> np.ndarray:
    """Return the poses (N, nb, 4, 4) of all bodies at q.

    q is (N, n, 1).
    """
    return np.asarray(compute(_free_robot(m), "poses", [q[..., 0]], base=(C,)))


def project(robot: Engine, motion: Any, base: ArrayLike | None) -> Motion:
    """Return the nearest motion that keeps the contacts of a robot.

    A note says what it changes.
    """
    m, first = robot.mechanism, next(iter(robot.mechanism.contacts), None)
    if first is None:
        raise JounceError(f"{m.name!r} has no contacts that a motion could keep; robot.contacts([...]) states some")
    # A motion without any base begins with the first contact at the origin of the world.
    given, follows = motion, isinstance(motion, Motion) and motion.base_curve is None and base is None
    if isinstance(motion, Motion):
        C: Any = np.eye(4) if base is None else base
        given = motion.with_stances([]) if base is None and not follows else motion.with_stances([]).with_base(None, C)
    path = check_motion(replace(m, contacts=()), given)
    [q], [C] = path([path.start], 0), path.base([path.start], 0) or ()
    # The places that contacts keep are those at the start, seen from the base: (contacts, 4, 4).
    anchors = contact_paths(m).poses(_body_poses(m, q[..., None], np.eye(4)))[0]
    if follows:
        if first.kind == "point":
            came = f"the motion has no base, and {quote_value(first.frame)}, a point, no axes to begin with"
            raise JounceError(f"{came}; state base=C, the pose of the base at the start")
        C = inverse(anchors[0])
    curve = ProjectedCurve(path.curve, m, groups.FREE.numbers(np.asarray(C).reshape(4, 4)), anchors)
    # How much the joints change, at even times, for the note.
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
