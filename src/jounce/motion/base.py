"""The motion of a base as a curve of seven columns, its position and a quaternion, and its pose and twist from them.

The quaternion may have any length but zero: any smooth curve in four dimensions that avoids zero is a smooth motion,
and its rates give those of the twist exactly. With Q = (w; v), the angular velocity in the axes of the base is
``2 E(Q) Qd / |Q|^2``, ``E = [-v, w 1 - hat(v)]``.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from jounce.core.errors import JounceError
from jounce.motion.curves import Curve, Jump, OfCurve
from jounce.spatial.lie import from_quaternion, hat, pose, rotation
from jounce.spatial.linear import solved
from jounce.spatial.series import Series, from_rate, joined

COLUMNS = ("x", "y", "z", "qw", "qx", "qy", "qz")
NAMES = tuple(f"base.{column}" for column in COLUMNS)
NOT_UNIT = 1e-3  # a norm further from 1 than rounding to three digits leaves it
VANISHES = 0.1  # norm of a quaternion, below which its curve passes too close to zero

Terms = tuple[np.ndarray, ...]  # C, V, Vd, ...


@dataclass(frozen=True, eq=False)
class Scaled(OfCurve):
    """A curve whose columns are multiplied by factors (columns,), as the sign of a quaternion is free."""

    factors: np.ndarray

    def rates(self, t: np.ndarray, order: int, left: bool = False) -> list[np.ndarray]:
        """The values and their derivatives up to `order`."""
        return [rate * self.factors for rate in self.base.rates(t, order, left)]

    def jumps(self, order: int) -> list[Jump]:
        """Where a derivative up to `order` jumps."""
        return [jump._replace(size=jump.size * float(self.factors[jump.column])) for jump in self.base.jumps(order)]

    def deviations(self, t: np.ndarray, order: int) -> list[np.ndarray] | None:
        """The standard deviations of the values and derivatives."""
        found = self.base.deviations(t, order)
        return None if found is None else [rate * np.abs(self.factors) for rate in found]


def terms_at(curve: Curve, t: np.ndarray, order: int, left: bool = False) -> Terms:
    """C, V, Vd, ... at times (N,) of a curve of seven columns, with as many terms as the rates of the curve."""
    return motion_of(_checked(curve.rates(t, order, left), t))


def perturbed(curve: Curve, t: np.ndarray, order: int) -> Iterator[Terms]:
    """C, V, Vd, ... with each entry of the curve off by its standard deviation, one after the other; none if exact."""
    rates = curve.rates(t, order)
    for k, off in enumerate(curve.deviations(t, order) or ()):
        for j in np.flatnonzero(off.any(axis=0)).tolist():
            yield motion_of((*rates[:k], rates[k] + off * (np.arange(len(COLUMNS)) == j), *rates[k + 1 :]))


def _checked(rates: list[np.ndarray], t: np.ndarray) -> list[np.ndarray]:
    """The rates of a curve, whose quaternion is not near zero, where it has no direction."""
    norms = np.linalg.norm(rates[0][:, 3:], axis=1)
    near = np.flatnonzero(~(norms > VANISHES))
    if near.size:
        i = int(near[0])
        raise JounceError(
            f"the quaternion of the base has the norm {norms[i]:.2g} at t = {t[i]:g} s; expected one that stays away"
            " from zero: terms with an offset, or samples less than half a turn apart"
        )
    return rates


def motion_of(rates: Sequence[np.ndarray]) -> tuple[np.ndarray, ...]:
    """C, V, Vd, ... from position and quaternion (N, 7) and their rates: as many terms as there are rates."""
    x = Series.of([rate[:, :, None] for rate in rates])
    p, Q = x.map(lambda x: x[:, :3]), x.map(lambda x: x[:, 3:])
    R = from_quaternion(rates[0][:, 3:] / np.linalg.norm(rates[0][:, 3:], axis=1, keepdims=True))
    C = pose(R, rates[0][:, :3, None])
    w = solved(Q.mT @ Q, (Q.map(_turning) @ Q.dot * 2).mT).mT
    to_base = from_rate(rotation(C).mT, lambda RT: -(w.map(lambda w: hat(w[..., 0])) @ RT))
    V = joined([w, to_base @ p.dot], axis=-2)
    return (C, *(V[k][..., 0] for k in range(len(rates) - 1)))


def _turning(Q: np.ndarray) -> np.ndarray:
    """E of quaternions (N, 4, 1): the vector part of the product of the conjugate with another, (N, 3, 4)."""
    w, v = Q[:, :1], Q[:, 1:]
    return np.concatenate([-v, w * np.eye(3) - hat(v[..., 0])], axis=-1)


def checked_quaternions(Q: np.ndarray, names: Sequence[str]) -> np.ndarray:
    """Unit quaternions (N, 4), each with the sign that is nearest to the one before."""
    norms = np.linalg.norm(Q, axis=1)
    off = np.abs(norms - 1)
    if not (off <= NOT_UNIT).all():
        i = int(np.nanargmax(np.where(np.isfinite(off), off, np.inf)))
        raise JounceError(f"row {i}: {', '.join(names)} have the norm {norms[i]:.6g}; expected unit quaternions")
    return Q / norms[:, None] * neighbouring_signs(Q)[:, None]


def neighbouring_signs(Q: np.ndarray) -> np.ndarray:
    """The signs (N,) by which each of quaternions (N, 4) is nearest to the one before: Q and -Q are one rotation."""
    turns = np.einsum("ij,ij->i", Q[1:], Q[:-1]) < 0
    return np.where(np.concatenate([[False], np.cumsum(turns) % 2 == 1]), -1.0, 1.0)
