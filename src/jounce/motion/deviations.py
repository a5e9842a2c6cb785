"""Standard deviations of a smoothing spline and its derivatives: of noise, of stamps, and of the spline's own error.

Problem: the covariance of q, qd, ... of each joint at a time, of the least-squares spline of its samples. It is a sum
of independent parts, each positive semidefinite:

1. noise: ``(B^T B)^-1`` of the normal equations times the variance of white noise in that interval
2. corrected time stamps, by a parametric bootstrap (Efron & Tibshirani, An Introduction to the Bootstrap, 6.5)
3. residuals that are no noise, and vibrations that the spline leaves out: waves of their size
4. sensors that may be read earlier than the times say: a shift that is anywhere from 0 to that
5. the spline's own error, from a coarser one by Richardson's extrapolation

It says nothing of what neither spline resolves and the residuals do not show, as a burst below the noise.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from jounce.motion.bsplines import FIT_DEGREE, basis
from jounce.motion.least_squares import SplineRows, SplineSolution, covariance_blocks
from jounce.motion.normal_equations import factorize

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

    from jounce.motion.vibrations import Line

MAX_GATHERED_TIMES = 20000  # for which ten coefficients' covariances are gathered at once: 16 MB
ERROR_DECAY_POWER = 15  # of the interval, with which the error of q falls: 10, and more near the limit of the band
BOOTSTRAP_DRAWS = 32  # of the scatter of stamps: deviations are known to 1 / sqrt(2 * 32) = 13 % then
DRAWS_PER_FIT = 4  # as columns of one problem
MAX_DEVIATION_ORDER = 6  # the highest derivative with a standard deviation


@dataclass(frozen=True, eq=False)
class TimestampCovariances:
    """Covariances (T, n, 7, 7), at times t (T,), of what is left of the stamps' scatter where they are corrected."""

    t: np.ndarray
    values: np.ndarray

    def at(self, t: np.ndarray, order: int) -> np.ndarray:
        """Covariances of q, qd, ... with each other at times (P,), (P, n, order + 1, order + 1)."""
        some = self.values[:, :, : order + 1, : order + 1]
        columns = some.reshape(len(self.t), -1).T
        return np.stack([np.interp(t, self.t, column) for column in columns], axis=1).reshape(-1, *some.shape[1:])


@dataclass(frozen=True, eq=False)
class SplineCovariances:
    """Covariances of a least-squares spline: (B^T B)^-1, times a variance per interval and joint."""

    solution: SplineSolution  # the spline, of the joints that move
    variance: np.ndarray  # (M, n), of white noise that is fitted as the samples' noise is
    coarser: "BSpline | None" = None  # a spline of fewer intervals, from which the error of the spline itself follows
    ratio: float = 1.0  # how many times fewer they are
    stamps: TimestampCovariances | None = None  # at times of their own: corrected rows may bear fewer breaks
    # (M, n), squares of residuals beyond noise, as of a vibration at the end of the band
    unfollowed: np.ndarray | None = None
    unsure: np.ndarray | None = None  # (n,), by how much sensors may be read earlier than the times say, s
    left_out: "tuple[Line, ...]" = ()  # vibrations that the spline does not follow

    def covariances(self, t: np.ndarray, order: int) -> np.ndarray:
        """Covariances of q, qd, ... with each other at times (P,), (P, n, order + 1, order + 1)."""
        starts = range(0, max(1, len(t)), MAX_GATHERED_TIMES)
        return np.concatenate([self._covariances(t[start : start + MAX_GATHERED_TIMES], order) for start in starts])

    def _covariances(self, t: np.ndarray, order: int) -> np.ndarray:
        breaks, spline = self.solution.breaks, self.solution.spline
        bases = [basis(t.clip(breaks[0], breaks[-1]), breaks, k) for k in range(order + 1)]
        values, place = np.stack([row for row, _ in bases], axis=1), bases[0][1]
        total = self.variance[place][:, :, None, None] * (values @ self._blocks[place] @ values.mT)[:, None]
        if self.stamps is not None:
            total += self.stamps.at(t, order)
        if self.unfollowed is not None and self.unfollowed.any():
            rate = np.pi / np.diff(breaks)[place, None]
            for k in range(order + 1):
                total[:, :, k, k] += self.unfollowed[place] * rate ** (2 * k)
        for line in self.left_out:
            total[:, line.joint, *np.diag_indices(order + 1)] += line.mean_squares(t, order)
        if self.unsure is not None and self.unsure.any():
            rates = np.stack([spline(t, nu=k + 1) for k in range(order + 1)], axis=-1)
            shifted = rates * self.unsure[:, None] / np.sqrt(3)  # the root mean square of a shift from 0 to `unsure`
            total += shifted[..., :, None] * shifted[..., None, :]
        if self.coarser is not None:
            middles = (breaks[1:] + breaks[:-1]) / 2
            for k, model in enumerate(self._model[: order + 1]):
                total[:, :, k, k] += np.stack([np.interp(t, middles, column) for column in model.T], axis=1)
        return total

    @cached_property
    def _blocks(self) -> np.ndarray:
        return covariance_blocks(self.solution.factor)

    @cached_property
    def _model(self) -> list[np.ndarray]:
        """Mean squares (M, n), per derivative, of the spline's own error, by Richardson's extrapolation.

        The error e of the k-th derivative falls with the interval to the power p = ERROR_DECAY_POWER - k, so that a
        spline of r times fewer intervals differs by (r^p - 1) e. Squares are averaged over three intervals.
        """
        assert self.coarser is not None
        breaks = self.solution.breaks
        t = _quarter_points(breaks)
        out = []
        for k in range(MAX_DEVIATION_ORDER + 1):
            rest = self.ratio ** -(ERROR_DECAY_POWER - k)
            apart = (self.solution.spline(t, nu=k) - self.coarser(t, nu=k)) * rest / (1 - rest)
            squares = (apart**2).reshape(len(breaks) - 1, 4, -1).mean(axis=1)
            padded = np.pad(squares, ((1, 1), (0, 0)), mode="edge")
            out.append((padded[:-2] + padded[1:-1] + padded[2:]) / 3)
        return out


def timestamp_covariances(rows: SplineRows, raw: SplineSolution, sigma: float, own: np.ndarray) -> TimestampCovariances:
    """What is left in q, qd, ... of stamps that scattered by sigma before correction.

    Corrected stamps are wrong by what a fit to the raw ones takes of their scatter: tau = (v^T D^-1 e) / (v^T D^-1 v),
    where e are splines fitted to v d with random d. The fit at corrected times takes v tau. Draws of d, from a fixed
    seed, give the covariances.
    """
    from scipy.interpolate import BSpline

    random = np.random.default_rng(0)
    v = raw.spline(rows.t, nu=1)
    across = v / own / np.maximum((v**2 / own).sum(axis=1), np.finfo(float).tiny)[:, None]
    weight = rows.weight if rows.edges is None else np.ones(len(rows.t))  # a row of a cell has the noise of one sample
    equations = factorize(rows.t, rows.weight, raw.breaks, in_cells=rows.edges is not None)
    times = _quarter_points(raw.breaks)
    total = np.zeros((len(times), v.shape[1], MAX_DEVIATION_ORDER + 1, MAX_DEVIATION_ORDER + 1))
    for _ in range(BOOTSTRAP_DRAWS // DRAWS_PER_FIT):
        # e: what the raw fit takes of random shifts
        d = sigma * random.normal(size=(len(v), 1, DRAWS_PER_FIT))
        noise = (weight[:, None, None] * v[:, :, None] * d).reshape(len(v), -1)
        taken = ((noise - equations.fit(noise)[1]) / rows.weight[:, None]).reshape(*v.shape, DRAWS_PER_FIT)
        # tau: what correction makes of that, and the spline that follows it
        tau = (across[:, :, None] * taken).sum(axis=1, keepdims=True)
        left = rows.weight[:, None] * (v[:, :, None] * tau).reshape(len(v), -1)
        curve = BSpline(raw.spline.t, equations.fit(left)[0], FIT_DEGREE)
        rates = [curve(times, nu=k).reshape(len(times), -1, DRAWS_PER_FIT) for k in range(MAX_DEVIATION_ORDER + 1)]
        e = np.stack(rates, axis=2)  # squares are averaged over draws
        total += e @ e.mT / BOOTSTRAP_DRAWS
    return TimestampCovariances(times, total)


def _quarter_points(breaks: np.ndarray) -> np.ndarray:
    return (breaks[:-1, None] + np.diff(breaks)[:, None] * np.array([0.125, 0.375, 0.625, 0.875])).ravel()
