"""How far a fit of samples can be trusted: holes between them, and derivatives against their standard deviations.

Towards the ends of a fit deviations rise by powers of ten, and the values with them, so that the largest value says
nothing: peaks are those that stand out of their bands of 95 %.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from jounce.core.errors import JounceError, join_names
from jounce.motion.deviations import MAX_DEVIATION_ORDER
from jounce.motion.noise import varies_slowly
from jounce.motion.samples import Samples
from jounce.motion.smoothness import MIN_HOLE_TO_SPACING
from jounce.motion.spline import INTERPOLATION_OPTION

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

BAND_DEVIATIONS = 1.96  # standard deviations on either side: 95 % of a normal distribution
MAX_SCATTER_SHARE = 0.1  # of a joint's scatter about its mean that a fit may leave
RESIDUAL_REACH = 2  # intervals on either side of one that determine how well the fit follows there
RESIDUAL_DEVIATIONS = 6  # standard deviations of chi^2, by which residuals around an interval are not noise
MIN_NOTED_RESIDUAL = 10.0  # times the usual squares of residuals, which a user should know of
MAX_KNOWN_DEVIATION = 0.1  # of the peak of a derivative: noise alone is a third of its own
MAX_COMPARED_TIMES = 4000  # at which peaks and deviations are compared
INTERVALS_AROUND_HOLE = 3  # on either side, which determine how fast the motion is
MAX_HOLE_TO_INTERVAL = 1.0  # times the usual interval: a longer hole cannot be bridged
MAX_DEVIATION_TO_MEDIAN = 10.0  # in a window: towards the ends of a fit deviations rise by powers of ten
MAX_CERTAIN_SHARE = 0.05  # of a value, that its deviation is: its band of 95 % is a tenth of it
MAX_WINDOW_TIMES = 2000  # of a motion, for the median of deviations, which change slowly


def refuse_holes(t: np.ndarray, breaks: np.ndarray) -> None:
    """Raise `JounceError` where a hole is longer than the intervals around it: any motion may have happened there.

    Where no interval is around it, it is compared with the time that all other samples take.
    """
    apart = np.diff(t)
    lengths = np.diff(breaks)
    for k in np.flatnonzero(apart > MIN_HOLE_TO_SPACING * np.median(apart)):
        first, last = np.searchsorted(breaks, [t[k], t[k + 1]]).clip(1, len(breaks) - 1)
        before = lengths[max(0, first - 1 - INTERVALS_AROUND_HOLE) : first - 1]
        around = np.concatenate([before, lengths[last : last + INTERVALS_AROUND_HOLE]])
        usual = float(np.median(around)) if around.size else float(np.ptp(t) - apart[k])
        if apart[k] > MAX_HOLE_TO_INTERVAL * usual:
            raise JounceError(
                f"no samples from t = {t[k]:.6g} to {t[k + 1]:.6g} s: {apart[k]:.3g} s, where the motion can be"
                f" continued over {usual:.3g} s; split the log there, or set a lower bandwidth"
            )


def describe_undetermined(t: np.ndarray) -> str:
    """Why no spline of degree 9 follows from samples at times t (N,), which leave the coefficients undetermined."""
    apart = np.diff(t)
    k = int(apart.argmax())
    return (
        f"no spline of degree 9 follows from samples that are {apart.min():.3g} to {apart[k]:.3g} s apart, the latter"
        f" from t = {t[k]:.9g} to {t[k + 1]:.9g} s; split the log there, or interpolate it by"
        f" {INTERPOLATION_OPTION}"
    )


def residual_excess(samples: Samples, residual: np.ndarray, breaks: np.ndarray, variance: np.ndarray) -> np.ndarray:
    """Mean squares of residuals (N, n) around each interval over the variance, (M, n), where they are no noise; or 1.

    A motion that is too fast for the samples leaves them, and an error of its own size.
    """
    squares = (samples.weight[:, None] * residual) ** 2 / variance
    bounds = np.searchsorted(samples.t, breaks)
    bounds[0], bounds[-1] = 0, len(samples.t)
    sums = np.concatenate([np.zeros((1, squares.shape[1])), np.cumsum(squares, axis=0)])
    first, last = (np.arange(len(breaks) - 1) + k for k in (-RESIDUAL_REACH, RESIDUAL_REACH + 1))
    first, last = first.clip(0), last.clip(max=len(breaks) - 1)
    freedom = np.maximum(bounds[last] - bounds[first] - (last - first), 1)[:, None]
    mean = (sums[bounds[last]] - sums[bounds[first]]) / freedom
    return np.where(mean > 1 + RESIDUAL_DEVIATIONS * np.sqrt(2 / freedom), mean, 1.0)


def notes_of_residual(
    samples: Samples, residual: np.ndarray, breaks: np.ndarray, excess: np.ndarray
) -> tuple[str, ...]:
    """What a user should know of residuals (N, n) that are no noise."""
    notes = []
    if (varies_slowly(residual) & (residual.std(axis=0) > MAX_SCATTER_SHARE * samples.q.std(axis=0))).any():
        notes.append("much of the samples' scatter is no white noise: there may be motion faster than they carry")
    where = np.flatnonzero((excess > MIN_NOTED_RESIDUAL).any(axis=1))
    if where.size:
        parts = np.split(where, np.flatnonzero(np.diff(where) > 2 * RESIDUAL_REACH) + 1)
        at = join_names(f"{breaks[part[0]]:.4g} to {breaks[part[-1] + 1]:.4g} s" for part in parts)
        notes.append(f"the fit does not follow the samples to their noise at t = {at}: deviations are larger there")
    return tuple(notes)


def peaks_and_shares(
    spline: "BSpline", deviations: Callable[[np.ndarray], np.ndarray], ends: tuple[float, float], q: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Peaks (7, n) of q less the mean of samples q (N, n), of qd, ... between the ends; deviations over them, (7,).

    `deviations` of times (T,) are (7, T, n), 0 of joints that rest. Where a derivative is known, the next is no less
    than that of half a wave over the duration.
    """
    inside = np.linspace(*ends, min(MAX_COMPARED_TIMES, 4 * (len(spline.t) - 2 * spline.k)) + 2)[1:-1]
    size = np.abs([spline(inside, nu=k) - (k == 0) * q.mean(axis=0) for k in range(MAX_DEVIATION_ORDER + 1)])
    off = deviations(inside)
    usual = np.sqrt((off**2).mean(axis=1).max(axis=1))
    beyond = np.maximum((size - off).max(axis=(1, 2)), size.max(axis=(1, 2)) / 10)  # noise makes peaks as well
    largest = np.maximum(beyond, np.finfo(float).tiny)  # of joints that rest in all digits
    duration = np.ptp(spline.t)
    for k in range(1, len(largest)):
        if usual[k - 1] < MAX_KNOWN_DEVIATION * largest[k - 1]:
            largest[k] = max(largest[k], largest[k - 1] * np.pi / duration)
    return size.max(axis=1), usual / largest


def find_surest_rows(values: np.ndarray, deviations: np.ndarray) -> np.ndarray:
    """Where along the first axis absolute values are largest less their bands; NaN are not, unless all are."""
    sure = np.abs(values) - BAND_DEVIATIONS * deviations
    return np.asarray(np.argmax(np.where(np.isnan(sure), -np.inf, sure), axis=0))


def find_window(t: np.ndarray, deviations: np.ndarray, values: np.ndarray | None = None) -> tuple[float, float]:
    """The first and the last of times (T,) at which all deviations (T, n) are at most ten times their medians.

    Values (T, n) whose band of 95 % is a tenth of them are known as well: a fast start is no uncertain end. Outside are
    the uncertain ends of a fit. Deviations that are not known, NaN, do not count.
    """
    known = ~np.isnan(deviations).any(axis=0)
    off = deviations[:, known]
    well = off <= MAX_DEVIATION_TO_MEDIAN * np.median(off, axis=0)
    if values is not None:
        well |= off <= MAX_CERTAIN_SHARE * np.abs(values[:, known])
    at = np.flatnonzero(well.all(axis=1))
    first, last = (at[0], at[-1]) if at.size else (0, 0)
    return float(t[first]), float(t[last])
