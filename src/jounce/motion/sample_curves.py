"""The curve of measured samples: a smoothing spline with standard deviations, refused where it means nothing.

Samples that are exact to their rounding have nothing to smooth: a spline goes through them.
"""

from dataclasses import dataclass, replace

import numpy as np

from jounce.core.cures import Remedy
from jounce.core.errors import JounceError, warn
from jounce.motion.commands import read_commands
from jounce.motion.curves import ROUNDING_OF_Q, Curve
from jounce.motion.deviations import MAX_DEVIATION_ORDER
from jounce.motion.fit import Fit, fit
from jounce.motion.noise import estimate_local_noise
from jounce.motion.samples import MIN_FIT_SAMPLES
from jounce.motion.smoothness import MAX_NOISE_DEVIATIONS, describe_sample_jumps
from jounce.motion.spline import (
    INTERPOLATION_OPTION,
    CommandRows,
    SampledColumns,
    Smoothing,
    Spline,
    SplineCurve,
    fit_spline,
)
from jounce.spatial.series import rate_name


@dataclass(frozen=True, eq=False)
class SmoothedCurve(SplineCurve):
    """The spline of a fit, with its standard deviations, and what it was made of: samples, and the way from them."""

    fit: Fit
    given: SampledColumns
    way: Smoothing
    limit: float | None  # Hz, to which the fit is limited, where it is not the noise that limits it

    def smoothed_to(self, bandwidth: float) -> "SmoothedCurve":
        """Another curve of its samples, up to a bandwidth in Hz: all that is wrong with rows is found from them again.

        The samples carry its rates if they carry those of this one, so that it is not refused.
        """
        fitted = fit(self.given.t, self.given.q, bandwidth=bandwidth, names=self.given.names)
        return replace(self, spline=fitted.spline, fit=fitted, limit=bandwidth)

    def deviations(self, t: np.ndarray, order: int) -> list[np.ndarray] | None:
        """Standard deviations of the values and derivatives; None beyond the derivatives of which they are known."""
        return list(self.fit.deviations(t, order)) if order <= MAX_DEVIATION_ORDER else None


@dataclass(frozen=True, eq=False)
class SampleCurve:
    """The curve of samples, how it came about, what to know of it, and its largest distances (n,) from them."""

    curve: Curve
    source: str
    notes: tuple[str, ...] = ()
    residual: np.ndarray | None = None


def fit_curve(given: SampledColumns, way: Smoothing | Spline) -> SampleCurve:
    """The curve of samples; a fit finds the rounding of their times as noise.

    Raises
    ------
    JounceError : where no curve follows from the samples, or they cannot carry the derivative and are not forced to.
    """
    t, q, place, symbol = given.t, given.q, given.place, given.symbol
    if isinstance(way, CommandRows):
        return SampleCurve(*read_commands(t, q, place)) if symbol == "q" else _fit_spline_curve(given, Spline())
    if isinstance(way, Spline):
        return _fit_spline_curve(given, way)
    if len(t) < MIN_FIT_SAMPLES:
        least = f"smoothing needs at least {MIN_FIT_SAMPLES}; {INTERPOLATION_OPTION} takes them as exact"
        raise JounceError(f"{place}: {len(t)} samples; {least}")
    order = min(given.highest, MAX_DEVIATION_ORDER)
    purpose = rate_name("Q", order - 2) if symbol == "q" else rate_name(symbol, order)
    try:
        fitted = fit(t, q, bandwidth=way.bandwidth, names=given.names)
        shortfall = fitted.lacks(order, purpose, symbol)
    except JounceError as error:
        raise JounceError(f"{place}: {error}") from None
    off = np.abs(fitted.spline(t) - q)
    if way.bandwidth is None and (off.max(axis=0) <= ROUNDING_OF_Q * np.abs(q).max(axis=0)).all():
        return _fit_spline_curve(replace(given, rounding=0.0), Spline())
    if shortfall and not way.allow_noise:
        cures = Remedy(
            "a lower bandwidth= smooths them more, allow_noise=True accepts them",
            "a lower --bandwidth HZ smooths them more, --allow-noise accepts them",
        )
        raise JounceError(f"{place}: {shortfall}; {cures}")
    if jumps := _describe_jumps(given, off, fitted):
        warn(f"{place}: {jumps}")
    curve = SmoothedCurve(fitted.spline, float(t[0]), float(t[-1]), fitted, given, way, way.bandwidth)
    first, last = fitted.ends
    edges = f"derivatives are trustworthy from t = {first:.6g} to {last:.6g} s: deviations rise towards the ends"
    inside = fitted.relative.any() and (first > t[0] or last < t[-1])
    notes = (*fitted.notes, *([edges] if inside else []), *([shortfall] if shortfall else []))
    kinds = ", ".join(sorted({noise.kind for noise in fitted.noise}))
    source = f"samples, smoothed by a spline of degree 9 that holds up to {fitted.bandwidth:.3g} Hz ({kinds})"
    return SampleCurve(curve, source, notes, off.max(axis=0))


def _describe_jumps(given: SampledColumns, off: np.ndarray, fitted: Fit) -> str | None:
    """What jumps in samples, where a fit does not follow them and their stamps are right."""
    rows = fitted.rows
    noise = np.maximum(estimate_local_noise(given.q[rows]), [noise.step for noise in fitted.noise])
    if fitted.stamps or not (off[rows].max(axis=0) > MAX_NOISE_DEVIATIONS * noise).any():
        return None
    return describe_sample_jumps(given.t[rows], given.q[rows], noise, given.symbol)


def _fit_spline_curve(given: SampledColumns, way: Spline) -> SampleCurve:
    interpolates = way.intervals is None  # otherwise the residual shows what the fit does not follow
    if interpolates and (jumps := describe_sample_jumps(given.t, given.q, symbol=given.symbol)):
        warn(f"{given.place}: {jumps}")
    curve = fit_spline(given, way)
    residual = None if interpolates else np.abs(curve.rates(given.t, 0)[0] - given.q).max(axis=0)
    return SampleCurve(curve, f"samples, rates from a {way}", residual=residual)
