"""Samples whose time stamps are wrong, at the times that the fit to all joints tells."""

from dataclasses import replace

import numpy as np

from jounce.motion.knots import halves as halves_of
from jounce.motion.least_squares import Solution, solve
from jounce.motion.samples import Samples
from jounce.motion.stamps import SUBSET, Scatter, scatter_of, shifts

MEDIAN_OF_ONE = 0.455  # median of chi^2 with one degree of freedom


def corrected(samples: Samples, raw: Solution, cells: int, rounds: int) -> tuple[Samples, Scatter] | None:
    """The samples at corrected times, in order, where shifts of rows explain what a fit leaves of them."""
    some = slice(None, None, len(samples.t) // SUBSET + 1)
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
            spline = solve(moved.rows(cells), raw.breaks).spline
    return moved, scatter


def colour(samples: Samples, stamped: np.ndarray, solution: Solution, sigma: float) -> float:
    """How much shifts of rows, averaged over half intervals, scatter more than independent ones do: they may drift."""
    halves = np.searchsorted(samples.t, halves_of(solution.breaks)[:-1]).clip(max=len(samples.t) - 1)
    number = np.diff(halves, append=len(samples.t))
    means = np.add.reduceat(samples.t - np.sort(stamped), halves)[number > 1] / number[number > 1]
    return float(np.sqrt(max(1.0, np.median(means**2 * number[number > 1]) / MEDIAN_OF_ONE / sigma**2)))
