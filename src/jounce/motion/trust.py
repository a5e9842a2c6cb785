"""How far a fit of samples can be trusted: holes between them, and derivatives against their standard deviations."""

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from jounce.core.errors import JounceError
from jounce.motion.deviations import MAX_DEVIATION_ORDER
from jounce.motion.smoothness import MIN_HOLE_TO_SPACING

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

MAX_KNOWN_DEVIATION = 0.1  # of the peak of a derivative: noise alone is a third of its own
MAX_COMPARED_TIMES = 4000  # at which peaks and deviations are compared
INTERVALS_AROUND_HOLE = 3  # on either side, which determine how fast the motion is
MAX_HOLE_TO_INTERVAL = 1.0  # times the usual interval: a longer hole cannot be bridged


def refuse_holes(t: np.ndarray, breaks: np.ndarray) -> None:
    """Raise `JounceError` where a hole is longer than the intervals around it: any motion may have happened there."""
    apart = np.diff(t)
    lengths = np.diff(breaks)
    for k in np.flatnonzero(apart > MIN_HOLE_TO_SPACING * np.median(apart)):
        first, last = np.searchsorted(breaks, [t[k], t[k + 1]]).clip(1, len(breaks) - 1)
        around = np.concatenate(
            [
                lengths[max(0, first - 1 - INTERVALS_AROUND_HOLE) : first - 1],
                lengths[last : last + INTERVALS_AROUND_HOLE],
            ]
        )
        if around.size and apart[k] > MAX_HOLE_TO_INTERVAL * np.median(around):
            raise JounceError(
                f"no samples from t = {t[k]:.6g} to {t[k + 1]:.6g} s: {apart[k]:.3g} s, where the motion can be"
                f" continued over {np.median(around):.3g} s; split the log there, or set a lower bandwidth"
            )


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
