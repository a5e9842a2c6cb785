"""The curve of measured samples: a smoothing spline with standard deviations, refused where it means nothing."""

from dataclasses import dataclass

import numpy as np

from jounce.errors import JounceError
from jounce.motion.curves import Jump
from jounce.motion.deviations import HIGHEST
from jounce.motion.fit import Fit
from jounce.motion.spline import Smoothing


@dataclass(frozen=True, eq=False)
class SmoothedCurve:
    """A fit from its first sample to its last."""

    fit: Fit
    start: float
    stop: float

    @property
    def columns(self) -> int:
        """The number of coordinates."""
        return len(self.fit.joints)

    @property
    def highest(self) -> int:
        """The degree: derivatives beyond it are zero, and say nothing of the samples."""
        return int(self.fit.spline.k)

    def rates(self, t: np.ndarray, order: int, left: bool = False) -> list[np.ndarray]:
        """The values and their derivatives up to `order`."""
        return [self.fit.spline(t, nu=k) for k in range(order + 1)]

    def jumps(self, order: int) -> list[Jump]:
        """None below the degree; those of the degree itself, at every knot, are of the method and not of the motion."""
        return []

    def deviations(self, t: np.ndarray, order: int) -> list[np.ndarray] | None:
        """Standard deviations of the values and derivatives; None beyond the derivatives of which they are known."""
        return list(self.fit.deviations(t, order)) if order <= HIGHEST else None


def smoothed(
    t: np.ndarray, q: np.ndarray, way: Smoothing, joints: tuple[str, ...] | None, highest: int, place: str
) -> tuple[SmoothedCurve, tuple[str, ...]]:
    """The curve of samples q (N, n) of which the derivative of order `highest` is asked, and what to know about it.

    Raises
    ------
    JounceError : where no fit follows from the samples, or they cannot carry that derivative and are not forced to.
    """
    from jounce.motion.fit import fit  # which imports what only samples need

    try:
        found = fit(t, q, bandwidth=way.bandwidth, names=joints)
        order = min(highest, HIGHEST) - 2
        shortfall = found.shortfall(order) if order >= 0 else None
    except JounceError as error:
        raise JounceError(f"{place}: {error}") from None
    if shortfall and not way.force:
        raise JounceError(f"{place}: {shortfall}; --force (force=) takes them all the same")
    curve = SmoothedCurve(found, float(t[0]), float(t[-1]))
    return curve, (*_notes(found), *([shortfall] if shortfall else []))


def source_of(curve: SmoothedCurve) -> str:
    """How the rates came about, in words."""
    fitted, last = curve.fit, curve.fit.noise
    kinds = sorted({noise.kind for noise in last})
    return f"samples, smoothed by a spline of degree 9 that holds up to {fitted.bandwidth:.3g} Hz ({', '.join(kinds)})"


def _notes(found: Fit) -> tuple[str, ...]:
    first, last = found.ends
    edges = f"derivatives are trustworthy from t = {first:.6g} to {last:.6g} s: deviations rise towards the ends"
    return (*found.notes, *([edges] if found.relative.any() else []))
