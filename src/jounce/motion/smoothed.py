"""The curve of measured samples: a smoothing spline with standard deviations, refused where it means nothing.

Samples that are exact to their rounding have nothing to smooth: a spline goes through them.
"""

from dataclasses import dataclass

import numpy as np

from jounce.core.errors import JounceError, warn
from jounce.motion.curves import ROUNDING_OF_Q, Curve
from jounce.motion.deviations import MAX_DEVIATION_ORDER
from jounce.motion.fit import Fit, fit
from jounce.motion.noise import local_noise
from jounce.motion.smoothness import MAX_NOISE_DEVIATIONS, of_samples
from jounce.motion.spline import Smoothing, Spline, SplineCurve, curve_of
from jounce.motion.stamps import MIN_FIT_SAMPLES
from jounce.spatial.series import rate_name

INTERPOLATION_OPTION = "--degree 7 (degree=7)"


@dataclass(frozen=True, eq=False)
class SmoothedCurve(SplineCurve):
    """The spline of a fit, with its standard deviations."""

    fit: Fit

    def deviations(self, t: np.ndarray, order: int) -> list[np.ndarray] | None:
        """Standard deviations of the values and derivatives; None beyond the derivatives of which they are known."""
        return list(self.fit.deviations(t, order)) if order <= MAX_DEVIATION_ORDER else None


@dataclass(frozen=True, eq=False)
class Found:
    """The curve of samples, how it came about, what to know of it, and its largest distances (n,) from them."""

    curve: Curve
    source: str
    notes: tuple[str, ...] = ()
    residual: np.ndarray | None = None


def found_from(
    t: np.ndarray,
    q: np.ndarray,
    way: Smoothing | Spline,
    joints: tuple[str, ...] | None,
    highest: int,
    place: str,
    symbol: str = "q",
    rounding: float = 0.0,
) -> Found:
    """The curve of samples q (N, n), or of others, of which the derivative of order `highest` is asked.

    `rounding` is the standard deviation of the times' rounding in s, beyond that of doubles; a fit finds it as noise.

    Raises
    ------
    JounceError : where no curve follows from the samples, or they cannot carry that derivative and are not forced to.
    """
    if isinstance(way, Spline):
        return _by_hand(t, q, way, joints, highest, place, symbol, rounding)
    if len(t) < MIN_FIT_SAMPLES:
        least = f"smoothing needs at least {MIN_FIT_SAMPLES}; {INTERPOLATION_OPTION} takes them as exact"
        raise JounceError(f"{place}: {len(t)} samples; {least}")
    try:
        fitted = fit(t, q, bandwidth=way.bandwidth, names=joints)
        order = min(highest, MAX_DEVIATION_ORDER)
        shortfall = fitted.lacks(
            order, rate_name("Q", order - 2) if symbol == "q" else rate_name(symbol, order), symbol
        )
    except JounceError as error:
        raise JounceError(f"{place}: {error}") from None
    off = np.abs(fitted.spline(t) - q)
    exact = (off.max(axis=0) <= ROUNDING_OF_Q * np.abs(q).max(axis=0)).all()
    if exact and way.bandwidth is None:
        return _by_hand(t, q, Spline(), joints, highest, place, symbol)
    if shortfall and not way.allow_noise:
        cures = "--bandwidth HZ (bandwidth=) smooths them more, --allow-noise (allow_noise=) accepts them"
        raise JounceError(f"{place}: {shortfall}; {cures}")
    if jumps := _jumps(t, q, off, fitted, symbol):
        warn(f"{place}: {jumps}")
    curve = SmoothedCurve(fitted.spline, float(t[0]), float(t[-1]), fitted)
    notes = (*_notes(fitted, t), *([shortfall] if shortfall else []))
    kinds = ", ".join(sorted({noise.kind for noise in fitted.noise}))
    source = f"samples, smoothed by a spline of degree 9 that holds up to {fitted.bandwidth:.3g} Hz ({kinds})"
    return Found(curve, source, notes, off.max(axis=0))


def _jumps(t: np.ndarray, q: np.ndarray, off: np.ndarray, fitted: Fit, symbol: str) -> str | None:
    """What jumps in samples (N, n), where a fit does not follow them and their stamps are right."""
    steps = np.array([noise.step for noise in fitted.noise])
    noise = np.maximum(local_noise(q[fitted.rows]), steps)
    rows = fitted.rows
    if fitted.stamps or not (off[rows].max(axis=0) > MAX_NOISE_DEVIATIONS * noise).any():
        return None
    return of_samples(t[rows], q[rows], noise, symbol)


def _by_hand(
    t: np.ndarray,
    q: np.ndarray,
    way: Spline,
    joints: tuple[str, ...] | None,
    highest: int,
    place: str,
    symbol: str,
    rounding: float = 0.0,
) -> Found:
    if way.intervals is None and (
        jumps := of_samples(t, q, symbol=symbol)
    ):  # what a fit does not follow, its residual tells
        warn(f"{place}: {jumps}")
    curve = curve_of(t, q, way, place, highest, symbol, rounding, joints)
    residual = None if way.intervals is None else np.abs(curve.rates(t, 0)[0] - q).max(axis=0)
    return Found(curve, f"samples, rates from a {way}", residual=residual)


def _notes(found: Fit, t: np.ndarray) -> tuple[str, ...]:
    first, last = found.ends
    edges = f"derivatives are trustworthy from t = {first:.6g} to {last:.6g} s: deviations rise towards the ends"
    inside = found.relative.any() and (first > t[0] or last < t[-1])
    return (*found.notes, *([edges] if inside else []))
