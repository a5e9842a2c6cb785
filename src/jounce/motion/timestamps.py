"""Samples whose time stamps are wrong, at the times that the fit to all joints determines.

A controller's log is stamped when rows are written. Each row then has the joints' positions at another time than its
stamp says, all of them at the same: one shift per row, estimated from all joints together, explains their scatter.

Problem: with residuals ``r = v d + e`` of each row, ``d ~ N(0, s^2)``, ``e ~ N(0, D)``, D diagonal, the s and D of the
largest likelihood. This is factor analysis with known loadings v, by expectation and maximisation (Rubin & Thayer,
Psychometrika 47, 1982), whose likelihood rises in each step. A single joint does not distinguish shifts from noise; nor
are shifts believed that gain little likelihood, or that few rows have: a fit that does not follow leaves such ones.
"""

from dataclasses import dataclass, replace

import numpy as np

from jounce.motion.knots import fit_breaks
from jounce.motion.least_squares import SplineSolution
from jounce.motion.samples import MAX_SCATTER_ROWS, Samples

AVERAGING_PARTS = (2, 4, 8, 16)  # of an interval, over which shifts of rows are averaged
MEDIAN_OF_CHI2_1 = 0.455  # of chi^2 with one degree of freedom
EM_ROUNDS = 30  # of expectation and maximisation
MIN_OUTLYING_RESIDUAL = 10.0  # times the usual residual, from which on a row is an outlier
MIN_USUAL_SHARE = 0.9  # of the rows: where more lie far off they are no outliers
LARGEST_SHIFTS = 0.02  # of all: the 2 % largest of normal shifts have 13 % of the squares,
MAX_SHARE_OF_LARGEST = 0.4  # and those of a clock less than this
MIN_GAIN_PER_ROW = 0.05  # in the logarithm of the likelihood, on average, that makes shifts believable
MIN_GAIN_OF_ROWS = 50  # the same, of all rows together


@dataclass(frozen=True, eq=False)
class TimestampScatter:
    """The standard deviation of rows' shifts in time, s, and the variance (n,) of each joint's own noise."""

    sigma: float
    own: np.ndarray


def correct_timestamps(
    samples: Samples, raw: SplineSolution, cells: int, rounds: int
) -> tuple[Samples, TimestampScatter] | None:
    """The samples at corrected times, in order, where shifts of rows explain what a fit leaves of them."""
    some = slice(None, None, len(samples.t) // MAX_SCATTER_ROWS + 1)
    t = samples.t[some]
    scatter = estimate_scatter(samples.q[some] - raw.spline(t), raw.spline(t, nu=1))
    if not scatter:
        return None
    spline, shift, order, moved = raw.spline, np.zeros(len(samples.t)), np.arange(len(samples.t)), samples
    for k in range(rounds):
        velocity = spline(moved.t, nu=1)
        left = moved.q - spline(moved.t) + velocity * shift[:, None]
        scatter = estimate_scatter(left, velocity) or scatter
        shift = estimate_shifts(left, velocity, scatter)
        times = (samples.t[order] + shift).clip(*samples.span)
        again = np.argsort(times, kind="stable")
        order, shift = order[again], shift[again]
        moved = replace(samples.part(order), t=times[again])
        if k + 1 < rounds:
            spline = fit_breaks(moved.rows(cells), raw.breaks).spline
    return moved, scatter


def correlation_factor(samples: Samples, stamped: np.ndarray, solution: SplineSolution, sigma: float) -> float:
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


def estimate_scatter(r: np.ndarray, v: np.ndarray) -> TimestampScatter | None:
    """How stamps scatter, where shifts of rows explain residuals r, (N, n), at velocities v better than noise alone."""
    if r.shape[1] < 2:
        return None
    # some rows, without outliers, and the likelihood of noise alone
    step = len(r) // MAX_SCATTER_ROWS + 1
    r, v, tiny = r[::step], v[::step], np.finfo(float).tiny
    usual = (np.abs(r) <= MIN_OUTLYING_RESIDUAL * np.median(np.abs(r), axis=0)).all(axis=1)
    if usual.mean() > MIN_USUAL_SHARE:
        r, v = r[usual], v[usual]
    own = np.maximum((r**2).mean(axis=0), tiny)
    alone = -0.5 * (np.log(own).sum() + len(own))
    found = TimestampScatter(float(np.sqrt((own / np.maximum((v**2).mean(axis=0), tiny)).min() / 2)), own / 2)
    for _ in range(EM_ROUNDS):  # shifts by the present s and D, then s and D by the shifts
        d, variance = _posterior_shifts(r, v, found)
        own = ((r - v * d[:, None]) ** 2 + v**2 * variance[:, None]).mean(axis=0)
        found = TimestampScatter(float(np.sqrt((d**2 + variance).mean())), np.maximum(own, tiny))
    d, variance = _posterior_shifts(r, v, found)
    # the gain of likelihood, by the determinant and the inverse of D + s^2 v v^T
    squares = (r**2 / found.own).sum(axis=1) - d**2 / variance
    together = -0.5 * (np.log(found.own).sum() + np.log(found.sigma**2 / variance) + squares).mean()
    better = together - alone  # of the logarithms of likelihoods, per row
    return (
        found
        if better > MIN_GAIN_PER_ROW and len(r) * better > MIN_GAIN_OF_ROWS and not _has_few_large_shifts(d)
        else None
    )


def remaining_share(v: np.ndarray, found: TimestampScatter) -> np.ndarray:
    """The mean share (n,) of a wave of one joint alone that shifts of rows, at velocities v (N, n), do not take."""
    weights = v**2 / found.own
    return np.asarray(1 - (weights / (1 / found.sigma**2 + weights.sum(axis=1, keepdims=True))).mean(axis=0))


def _has_few_large_shifts(d: np.ndarray) -> bool:
    """Whether few of the shifts (N,) are most of their squares: a motion that a fit does not follow, and no clock."""
    squares = np.sort(d**2)
    return bool(squares[-max(1, round(LARGEST_SHIFTS * len(d))) :].sum() > MAX_SHARE_OF_LARGEST * squares.sum())


def estimate_shifts(r: np.ndarray, v: np.ndarray, found: TimestampScatter) -> np.ndarray:
    """How much later than its stamp each row belongs, (N,) in s: sum(v r / D) / (1 / s^2 + sum(v^2 / D)).

    Rows that lie off the motion at any time stay where they are.
    """
    d, _ = _posterior_shifts(r, v, found)
    off = ((r - v * d[:, None]) ** 2 / found.own).max(axis=1) > MIN_OUTLYING_RESIDUAL**2
    return np.where(off, 0.0, d)


def _posterior_shifts(r: np.ndarray, v: np.ndarray, found: TimestampScatter) -> tuple[np.ndarray, np.ndarray]:
    """The mean and the variance (N,) of each row's shift."""
    variance = 1 / (1 / found.sigma**2 + (v**2 / found.own).sum(axis=1))
    return variance * (v * r / found.own).sum(axis=1), variance
