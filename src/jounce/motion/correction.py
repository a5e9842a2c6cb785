"""Samples whose time stamps are wrong, at the times that the fit to all joints determines."""

from dataclasses import replace

import numpy as np

from jounce.motion.knots import fitted
from jounce.motion.least_squares import Solution
from jounce.motion.samples import Samples
from jounce.motion.stamps import MAX_SCATTER_ROWS, Scatter, scatter_of, shifts

AVERAGING_PARTS = (2, 4, 8, 16)  # of an interval, over which shifts of rows are averaged
MEDIAN_OF_CHI2_1 = 0.455  # of chi^2 with one degree of freedom


def corrected(samples: Samples, raw: Solution, cells: int, rounds: int) -> tuple[Samples, Scatter] | None:
    """The samples at corrected times, in order, where shifts of rows explain what a fit leaves of them."""
    some = slice(None, None, len(samples.t) // MAX_SCATTER_ROWS + 1)
    t = samples.t[some]
    scatter = scatter_of(samples.q[some] - raw.spline(t), raw.spline(t, nu=1))
    if not scatter:
        return None
    spline, shift, order, moved = raw.spline, np.zeros(len(samples.t)), np.arange(len(samples.t)), samples
    for k in range(rounds):
        velocity = spline(moved.t, nu=1)
        left = moved.q - spline(moved.t) + velocity * shift[:, None]
        scatter = scatter_of(left, velocity) or scatter
        shift = shifts(left, velocity, scatter)
        times = (samples.t[order] + shift).clip(*samples.span)
        again = np.argsort(times, kind="stable")
        order, shift = order[again], shift[again]
        moved = replace(samples.part(order), t=times[again])
        if k + 1 < rounds:
            spline = fitted(moved.rows(cells), raw.breaks).spline
    return moved, scatter


def colour(samples: Samples, stamped: np.ndarray, solution: Solution, sigma: float) -> float:
    """How much shifts of rows, averaged over parts of intervals, scatter more than independent ones do.

    Neighbours' shifts may be alike. Averages over much of an interval do not show it, for a fit takes these; averages
    over fewer rows than are alike show too little.
    """
    shift, squares = samples.t - np.sort(stamped), [1.0]
    for parts in AVERAGING_PARTS:
        block = max(1, len(shift) // (parts * solution.intervals))
        means = shift[: len(shift) // block * block].reshape(-1, block).mean(axis=1)
        squares.append(float(np.median(means**2)) * block / MEDIAN_OF_CHI2_1 / sigma**2)
    return float(np.sqrt(max(squares)))
