"""Limits along a path as rows: sums of products of sigma's rates, each between two bounds at every point."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from jounce.limits import path_velocity
from jounce.limits.friction import Friction, FrictionAlong
from jounce.limits.motor_terms import MotorTerms
from jounce.limits.path import Path, Terms
from jounce.limits.ratios import build_scale
from jounce.model.limit_kinds import LIMIT_KINDS
from jounce.model.limits import Limits

_MAX_BOUND_RATIO = 1e6  # of a bound that is infinite to the stated one: finite for the barrier, and never binding
# Of each product, the highest derivative of x that it takes.
_PRODUCT_JET_ORDERS = (0, 0, 0, 1, 0, 1, 2, 0, 1, 1, 2, 3)

RowBlock = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, tuple[str, ...]]  # factors, bounds, joints, kinds


@dataclass(frozen=True, eq=False)
class LimitRows:
    """R quantities at N points of a path: ``lower <= factors . products <= upper``, all in units of their limits.

    Attributes
    ----------
    factors : (N, R, K)
        Of the K products that occur at all.
    used : (K,)
        The indices of these products.
    lower, upper : (R,)
        The bounds.
    kinds : (R,)
        Of each row the kind of the limit.
    joints : (N, R)
        Of each row and point the index of the coordinate.
    friction : FrictionAlong or None
        What adds products to those of the path, where Coulomb friction acts.
    """

    factors: np.ndarray
    used: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    kinds: tuple[str, ...]
    joints: np.ndarray
    friction: FrictionAlong | None = None

    @property
    def jet(self) -> int:
        """How many of x, x', x'', x''' the rows take."""
        highest = _PRODUCT_JET_ORDERS + (self.friction.highest_jet if self.friction else ())
        return 1 + max((highest[k] for k in self.used), default=0)

    def values(self, jet: np.ndarray) -> np.ndarray:
        """The rows (N, R) at jets (4, N)."""
        products = path_velocity.products(jet)
        if self.friction:
            products = np.concatenate([products, self.friction.products(jet)])
        return np.matmul(self.factors, products[self.used].T[:, :, None])[:, :, 0]

    def derivatives(self, jet: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Gradients (K, J, N) and Hessians (K, J, J, N) of the products with respect to what the rows take of jets."""
        first, second = path_velocity.derivatives(jet)
        if self.friction:
            parts = zip((first, second), self.friction.derivatives(jet), strict=True)
            first, second = (np.concatenate(pair) for pair in parts)
        return first[self.used, : self.jet], second[self.used, : self.jet, : self.jet]

    def uniform(self, speed: float) -> np.ndarray:
        """The rows (N, R) at a uniform speed, 0 for those at rest."""
        jet = np.zeros((path_velocity.JET_SIZE, len(self.factors)))
        jet[0] = speed**2
        return self.values(jet)

    def excess(self, jet: np.ndarray) -> np.ndarray:
        """By how much the rows (N, R) leave their bounds at jets (4, N); negative within, infinite where x <= 0."""
        possible = jet[0] > 0
        values = self.values(np.where(possible, jet, 1.0))
        return np.where(possible[:, None], np.maximum(values - self.upper, self.lower - values), np.inf)

    def select(self, points: np.ndarray | slice) -> "LimitRows":
        """The rows at some of the points."""
        friction = self.friction and self.friction.select(points)
        return replace(self, factors=self.factors[points], joints=self.joints[points], friction=friction)

    def widen(self, by: float) -> "LimitRows":
        """The rows with wider bounds."""
        return replace(self, lower=self.lower - by, upper=self.upper + by)

    def nearness(self, jet: np.ndarray) -> np.ndarray:
        """The rows (N, R) at jets (4, N) as shares of the bounds: 1 on a bound."""
        return build_scale(np.stack([self.lower, self.upper])).largest(self.values(jet))


def build_rows(
    path: Path,
    limits: Limits,
    share: float,
    fastest: float,
    friction: Friction | None = None,
    motors: MotorTerms | None = None,
) -> LimitRows:
    """The rows of all finite limits of the coordinates, each taken to a share of itself, at the points of a path.

    `friction` acts in addition to the forces of the path, or to those of `motors`, whose limits count where there are
    any.

    The velocity limits are one row, (q' / v)^2 x of the joint that is nearest to its own; x itself stays below the
    square of `fastest`, so that a rest of the motion does not make it infinite: that is of the joint -1.
    """
    kinds = [
        kind
        for kind in limits.kinds
        if kind not in ("position", "velocity") and (motors or not LIMIT_KINDS[kind].takes)
    ]
    rubbing = _friction_along(path, kinds, friction, motors)
    size = len(path_velocity.PRODUCT_POWERS) + (len(rubbing.highest_jet) if rubbing else 0)
    found: list[RowBlock] = [_velocity_row(path, limits.bounds("velocity") * share, fastest, size)]
    for kind in kinds:
        terms = limit_terms(path, kind, limits, motors)
        if rubbing:
            shares = motors.shares(kind)[0] if motors and LIMIT_KINDS[kind].takes else np.ones(path.q[1].shape[1])
            terms |= rubbing.terms(kind, path.q[1] if kind == "power" else shares)
        found.append(_scale_rows(kind, terms, limits.bounds(kind) * share, size))
    factors = np.concatenate([rows[0] for rows in found], axis=1)
    used = np.flatnonzero(np.any(factors, axis=(0, 1)))
    lower, upper = (np.concatenate([rows[k] for rows in found]) for k in (1, 2))
    joints = np.concatenate([rows[3] for rows in found], axis=1)
    of = tuple(kind for rows in found for kind in rows[4])
    return LimitRows(np.ascontiguousarray(factors[:, :, used]), used, lower, upper, of, joints, rubbing)


def _friction_along(
    path: Path, kinds: Sequence[str], friction: Friction | None, motors: MotorTerms | None
) -> FrictionAlong | None:
    """The friction that enters limits of some kinds: that of the motors, where these are limited."""
    rubbed = [k for k in kinds if ("motor_torques" in LIMIT_KINDS[k].takes if motors else LIMIT_KINDS[k].force)]
    if not friction or not rubbed:
        return None
    rates = [motors.position(path, 1)] if motors else [path.rate(k) for k in range(1, min(4, len(path.q)))]
    return friction.along(rates, tuple(rubbed))


def limit_terms(path: Path, kind: str, limits: Limits, motors: MotorTerms | None) -> Terms:
    """The terms of what limits of a kind bound, without friction."""
    row = LIMIT_KINDS[kind]
    if row.takes and motors:
        return motors.terms(path, kind)
    if row.of == "q":
        return path.rate(row.rate)
    if kind == "power":
        return path.power()
    force = path.force(row.rate, kind in limits.without_gravity)
    return force | {path_velocity.S1: force[path_velocity.S1] + limits.effort_slope * path.q[1]} if row.line else force


def _scale_rows(kind: str, terms: Terms, bounds: np.ndarray, products: int) -> RowBlock:
    [points, n] = next(iter(terms.values())).shape
    factors = np.zeros((points, n, products))
    for k, term in terms.items():
        factors[:, :, k] = term
    limited = np.flatnonzero(np.isfinite(bounds).any(axis=0) & bounds.any(axis=0))  # a limit of 0: it does not move
    lower, upper = bounds[:, limited]
    size = np.where(np.isfinite(upper), upper, 0) - np.where(np.isfinite(lower), lower, 0)
    scale = np.where(np.isfinite(upper) & np.isfinite(lower), size / 2, size)
    joints = np.broadcast_to(limited, (points, len(limited)))
    return (
        factors[:, limited] / scale[:, None],
        (lower / scale).clip(-_MAX_BOUND_RATIO),
        (upper / scale).clip(max=_MAX_BOUND_RATIO),
        joints,
        (kind,) * len(limited),
    )


def _velocity_row(path: Path, bounds: np.ndarray, fastest: float, products: int) -> RowBlock:
    rate = path.q[1]
    ratio = build_scale(bounds, "velocity").largest(rate)
    factors = np.zeros((len(rate), 1, products))
    factors[:, 0, path_velocity.S1_2] = np.maximum(ratio.max(axis=1), 1 / fastest) ** 2
    joints = np.where(ratio.max(axis=1) * fastest < 1, -1, ratio.argmax(axis=1))
    one = np.ones(1)
    return factors, -_MAX_BOUND_RATIO * one, one, joints[:, None], ("velocity",)
