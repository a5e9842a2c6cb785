"""Samples before they are smoothed: what no smoothing mends, rows that repeat, and stamps that say the wrong time.

A controller's log is stamped when rows are written. Each row then has the joints' positions at another time than its
stamp says, all of them at the same: one shift per row, estimated from all joints together, explains their scatter.

Problem: with residuals ``r = v d + e`` of each row, ``d ~ N(0, s^2)``, ``e ~ N(0, D)``, D diagonal, the s and D of the
largest likelihood. This is factor analysis with known loadings v, by expectation and maximisation (Rubin & Thayer,
Psychometrika 47, 1982), whose likelihood rises in each step. A single joint does not distinguish shifts from noise; nor
are shifts believed that gain little likelihood, or that few rows have: a fit that does not follow leaves such ones.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from jounce.core.errors import JounceError, quoted

MIN_FIT_SAMPLES = 24  # more than twice the ten coefficients of one interval, so that noise can be estimated
MAX_SCATTER_ROWS = 20000  # from which the scatter of stamps is estimated: more only take time
EM_ROUNDS = 30  # of expectation and maximisation
MIN_OUTLYING_RESIDUAL = 10.0  # times the usual residual, from which on a row is an outlier
MIN_USUAL_SHARE = 0.9  # of the rows: where more lie far off they are no outliers
MIN_WILD_SHARE = 0.5  # of what a wild row is off the fit, it is off its neighbours
MAX_NEIGHBOUR_SHARE = 1 / 3  # of that, which its neighbours are off without it,
MAX_NEIGHBOUR_DEVIATIONS = 4.0  # and standard deviations of noise besides
MIN_SPIKE = 30.0  # times as far off as others around are rows that are left out
LARGEST_SHIFTS = 0.02  # of all: the 2 % largest of normal shifts have 13 % of the squares,
MAX_SHARE_OF_LARGEST = 0.4  # and those of a clock less than this
MIN_GAIN_PER_ROW = 0.05  # in the logarithm of the likelihood, on average, that makes shifts believable
MIN_GAIN_OF_ROWS = 50  # the same, of all rows together


@dataclass(frozen=True, eq=False)
class Scatter:
    """The standard deviation of rows' shifts in time, s, and the variance (n,) of each joint's own noise."""

    sigma: float
    own: np.ndarray


def check(
    t: object, q: object, names: Sequence[str] | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray, tuple[str, ...]]:
    """Samples as arrays (N,) and (N, n), the numbers of their rows, and the joints' names.

    Raises `JounceError` if they are invalid. Rows that are equal to the one before, time included, are left out.
    """
    times, samples = (_numbers(x, label) for x, label in ((t, "t"), (q, "q")))
    samples = samples[:, None] if samples.ndim == 1 else samples
    if times.ndim != 1 or samples.ndim != 2 or len(times) != len(samples):
        raise JounceError(f"t has shape {times.shape} and q {samples.shape}; expected (N,) and (N, n)")
    joints = tuple(names or (f"column {k + 1}" for k in range(samples.shape[1])))
    if len(joints) != samples.shape[1]:
        raise JounceError(f"{len(joints)} names for {samples.shape[1]} columns; expected one per column")
    if not np.isfinite(times).all():
        raise JounceError(f"the time of sample {np.argmin(np.isfinite(times))} is not a number; remove the row")
    for name, column in zip(joints, samples.T, strict=True):
        if not np.isfinite(column).all():
            where = int(np.argmin(np.isfinite(column)))
            came = f"{name} is {column[where]} at t = {times[where]:g} s"
            raise JounceError(f"{came}; expected numbers: remove such rows")
    kept = np.append(True, (np.diff(times) != 0) | (np.diff(samples, axis=0) != 0).any(axis=1))
    times, samples = times[kept], samples[kept]
    if (late := np.diff(times) <= 0).any():
        where = int(np.argmax(late))
        raise JounceError(
            f"time goes from {times[where]:.9g} to {times[where + 1]:.9g} s at sample {where + 1}; expected increasing"
            " times: sort the rows, or write the time with more digits"
        )
    if len(times) < MIN_FIT_SAMPLES:
        raise JounceError(
            f"{len(times)} samples; smoothing needs at least {MIN_FIT_SAMPLES}: give a longer log, or through()"
        )
    return times, samples, np.flatnonzero(kept), joints


def spikes(t: np.ndarray, q: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """Which rows, (N,), lie off the line through those on either side, alone and much farther than others around."""
    share = ((t[1:-1] - t[:-2]) / (t[2:] - t[:-2]))[:, None]
    off = np.pad(q[1:-1] - q[:-2] * (1 - share) - q[2:] * share, ((4, 4), (0, 0)))
    usual = np.maximum(np.median(np.abs(off[:: len(off) // MAX_SCATTER_ROWS + 1]), axis=0), steps)
    row, joint = np.nonzero(np.abs(off) > MIN_SPIKE * usual)
    here, before, after = (off[row + k, joint] for k in (0, -1, 1))
    around = np.max([np.abs(off[row + k, joint]) for k in (-3, -2, 2, 3)], axis=0)
    alone = (np.abs(here) > MIN_SPIKE * around) & (here * before < 0) & (here * after < 0)
    wild = np.zeros(len(t), bool)
    wild[row[alone] - 3] = True
    return wild


def are_wild(t: np.ndarray, q: np.ndarray, rows: np.ndarray, joint: np.ndarray, off: np.ndarray) -> np.ndarray:
    """Which rows, (R,), far `off` a fit in a joint, are wild: q (N, n) and `off` are in standard deviations of noise.

    A motion that the fit does not follow leaves far rows too. A wild row, or one of two in succession, is off the cubic
    through two rows on either side, and without it its neighbours are smooth, which those in a fast motion are not.
    """
    wild = np.zeros(len(rows), bool)
    for others in ((0,), (0, 1), (-1, 0)):  # rows that may be wild together
        own = _off_cubic(t, q, rows, joint, 0, others)
        beside = [_off_cubic(t, q, rows, joint, k, others) for k in (others[0] - 1, others[-1] + 1)]
        wild |= (own > off * MIN_WILD_SHARE) & (
            np.maximum(*beside) < own * MAX_NEIGHBOUR_SHARE + MAX_NEIGHBOUR_DEVIATIONS
        )
    return wild


def _off_cubic(
    t: np.ndarray, q: np.ndarray, rows: np.ndarray, joint: np.ndarray, target: int, without: tuple[int, ...]
) -> np.ndarray:
    """How far the rows (R,) plus a number `target` are off the cubic through the two next on either side but some."""
    before = [k for k in range(target - 1, -9, -1) if k not in without][:2]
    after = [k for k in range(target + 1, 9) if k not in without][:2]
    at = {k: (rows + k).clip(0, len(t) - 1) for k in (target, *before, *after)}
    inside = (rows + min(before) >= 0) & (rows + max(after) < len(t))
    off = q[at[target], joint].copy()
    for k in (*before, *after):
        others = [j for j in (*before, *after) if j != k]
        with np.errstate(divide="ignore", invalid="ignore"):  # at the ends rows coincide
            shares = [(t[at[target]] - t[at[j]]) / (t[at[k]] - t[at[j]]) for j in others]
            off -= q[at[k], joint] * np.prod(shares, axis=0)
    return np.where(inside, np.abs(off), np.inf if target == 0 else 0.0)


def scatter_of(r: np.ndarray, v: np.ndarray) -> Scatter | None:
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
    found = Scatter(float(np.sqrt((own / np.maximum((v**2).mean(axis=0), tiny)).min() / 2)), own / 2)
    for _ in range(EM_ROUNDS):  # shifts by the present s and D, then s and D by the shifts
        d, variance = _posterior(r, v, found)
        own = ((r - v * d[:, None]) ** 2 + v**2 * variance[:, None]).mean(axis=0)
        found = Scatter(float(np.sqrt((d**2 + variance).mean())), np.maximum(own, tiny))
    d, variance = _posterior(r, v, found)
    # the gain of likelihood, by the determinant and the inverse of D + s^2 v v^T
    squares = (r**2 / found.own).sum(axis=1) - d**2 / variance
    together = -0.5 * (np.log(found.own).sum() + np.log(found.sigma**2 / variance) + squares).mean()
    better = together - alone  # of the logarithms of likelihoods, per row
    return found if better > MIN_GAIN_PER_ROW and len(r) * better > MIN_GAIN_OF_ROWS and not _of_few(d) else None


def _of_few(d: np.ndarray) -> bool:
    """Whether few of the shifts (N,) are most of their squares: a motion that a fit does not follow, and no clock."""
    squares = np.sort(d**2)
    return bool(squares[-max(1, round(LARGEST_SHIFTS * len(d))) :].sum() > MAX_SHARE_OF_LARGEST * squares.sum())


def shifts(r: np.ndarray, v: np.ndarray, found: Scatter) -> np.ndarray:
    """How much later than its stamp each row belongs, (N,) in s: sum(v r / D) / (1 / s^2 + sum(v^2 / D)).

    Rows that lie off the motion at any time stay where they are.
    """
    d, _ = _posterior(r, v, found)
    off = ((r - v * d[:, None]) ** 2 / found.own).max(axis=1) > MIN_OUTLYING_RESIDUAL**2
    return np.where(off, 0.0, d)


def _posterior(r: np.ndarray, v: np.ndarray, found: Scatter) -> tuple[np.ndarray, np.ndarray]:
    """The mean and the variance (N,) of each row's shift."""
    variance = 1 / (1 / found.sigma**2 + (v**2 / found.own).sum(axis=1))
    return variance * (v * r / found.own).sum(axis=1), variance


def _numbers(given: object, label: str) -> np.ndarray:
    array = np.asarray(given)
    if array.dtype.kind not in "fiu":
        raise JounceError(f"{label} is {quoted(given)}; expected an array of numbers")
    return array.astype(float)
