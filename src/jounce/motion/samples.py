"""Samples before they are smoothed: what no smoothing mends, rows that repeat, and wild rows."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from jounce.core.errors import JounceError, quote_value
from jounce.motion.least_squares import SplineRows, compress_rows, cut_cells, make_rows

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

MAX_SCATTER_ROWS = 20000  # from which the scatter of stamps is estimated: more only take time
MAX_POSITION = 1e30  # rad or m: no length is as large, and eighth powers of it have no overflow
MIN_FIT_SAMPLES = 24  # more than twice the ten coefficients of one interval, so that noise can be estimated
MIN_WILD_SHARE = 0.5  # of what a wild row is off the fit, it is off its neighbours
MAX_NEIGHBOUR_SHARE = 1 / 3  # of that, which its neighbours are off without it,
MAX_NEIGHBOUR_DEVIATIONS = 4.0  # and standard deviations of noise besides
MIN_SPIKE = 30.0  # times as far off as others around are rows that are left out


@dataclass(frozen=True, eq=False)
class Samples:
    """Samples of the joints that move, as they are smoothed."""

    t: np.ndarray  # (N,), increasing
    q: np.ndarray  # (N, n)
    weight: np.ndarray  # (N,), of the rows
    span: tuple[float, float]  # the first and the last time of the spline
    steps: np.ndarray  # (n,), of encoders or of written digits, otherwise 0
    # where stamps are in doubt: a spline to take velocities from, and each joint's own variance (n,)
    drift: "tuple[BSpline, np.ndarray] | None" = None
    unsure: np.ndarray | None = None  # (n,), by how much each sensor may be read earlier than the times say, s

    @cached_property
    def floor(self) -> np.ndarray:
        """The variance (n,) of rounding of doubles."""
        return np.maximum((4 * np.finfo(float).eps * np.abs(self.q).max(axis=0)) ** 2, np.finfo(float).tiny)

    def joints(self, which: np.ndarray) -> "Samples":
        """The samples of some of the joints."""
        unsure = None if self.unsure is None else self.unsure[which]
        return replace(self, q=self.q[:, which], steps=self.steps[which], unsure=unsure)

    def part(self, rows: np.ndarray) -> "Samples":
        """Some of the rows."""
        return replace(self, t=self.t[rows], q=self.q[rows], weight=self.weight[rows])

    def rows(self, cells: int) -> SplineRows:
        """The rows of a least-squares problem, compressed to a number of cells if there are many samples."""
        rows = compress_rows(self.t, self.q, self.weight, self.span, cells)
        if self.drift is None:
            return rows
        spline, own = self.drift
        return replace(rows, along=(spline(rows.t, nu=1), own))

    def all_rows(self, cells: int) -> SplineRows:
        """The rows of all samples for splines with knots as in compressed ones: faster for few fits."""
        _, edges = cut_cells(self.t, self.span, cells)
        return make_rows(self.t, self.q, self.weight, self.span, edges)


def check_samples(
    t: object, q: object, names: Sequence[str] | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray, tuple[str, ...]]:
    """Samples as arrays (N,) and (N, n), the numbers of their rows, and the joints' names.

    Raises `JounceError` if they are invalid. Rows that are equal to the one before, time included, are left out.
    """
    times, samples = (_as_numbers(x, label) for x, label in ((t, "t"), (q, "q")))
    samples = samples[:, None] if samples.ndim == 1 else samples
    if times.ndim != 1 or samples.ndim != 2 or len(times) != len(samples):
        raise JounceError(f"t has shape {times.shape} and q {samples.shape}; expected (N,) and (N, n)")
    joints = tuple(names or (f"column {k + 1}" for k in range(samples.shape[1])))
    if len(joints) != samples.shape[1]:
        raise JounceError(f"{len(joints)} names for {samples.shape[1]} columns; expected one per column")
    if not np.isfinite(times).all():
        raise JounceError(f"the time of sample {np.argmin(np.isfinite(times))} is not a number; remove the row")
    for name, column in zip(joints, samples.T, strict=True):
        possible = np.abs(column) <= MAX_POSITION  # False of NaN, too
        if not possible.all():
            where = int(np.argmin(possible))
            came = f"{name} is {column[where]} at t = {times[where]:g} s"
            raise JounceError(f"{came}; expected numbers up to {MAX_POSITION:g}: remove such rows")
    kept = np.append(True, (np.diff(times) != 0) | (np.diff(samples, axis=0) != 0).any(axis=1))
    times, samples = times[kept], samples[kept]
    if (late := np.diff(times) <= 0).any():
        where = int(np.argmax(late))
        came = f"time goes from {times[where]:.9g} to {times[where + 1]:.9g} s at sample {where + 1}"
        raise JounceError(f"{came}; expected increasing times: sort the rows, or write the time with more digits")
    if len(times) < MIN_FIT_SAMPLES:
        raise JounceError(
            f"{len(times)} samples; smoothing needs at least {MIN_FIT_SAMPLES}: give a longer log, or through()"
        )
    return times, samples, np.flatnonzero(kept), joints


def _as_numbers(given: object, label: str) -> np.ndarray:
    array = np.asarray(given)
    if array.dtype.kind not in "fiu":
        raise JounceError(f"{label} is {quote_value(given)}; expected an array of numbers")
    return array.astype(float)


def find_spikes(t: np.ndarray, q: np.ndarray, steps: np.ndarray) -> np.ndarray:
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


def are_wild_rows(t: np.ndarray, q: np.ndarray, rows: np.ndarray, joint: np.ndarray, off: np.ndarray) -> np.ndarray:
    """Which rows, (R,), far `off` a fit in a joint, are wild: q (N, n) and `off` are in standard deviations of noise.

    A motion that the fit does not follow leaves far rows too. A wild row, or one of two in succession, is off the cubic
    through two rows on either side, and without it its neighbours are smooth, which those in a fast motion are not.
    """
    wild = np.zeros(len(rows), bool)
    for others in ((0,), (0, 1), (-1, 0)):  # rows that may be wild together
        own = _distance_from_cubic(t, q, rows, joint, 0, others)
        beside = [_distance_from_cubic(t, q, rows, joint, k, others) for k in (others[0] - 1, others[-1] + 1)]
        wild |= (own > off * MIN_WILD_SHARE) & (
            np.maximum(*beside) < own * MAX_NEIGHBOUR_SHARE + MAX_NEIGHBOUR_DEVIATIONS
        )
    return wild


def _distance_from_cubic(
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
