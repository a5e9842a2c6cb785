"""Standard deviations of a smoothing spline and its derivatives: of noise, of stamps, and of the spline's own error."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from math import comb
from typing import TYPE_CHECKING

import numpy as np

from jounce.motion.least_squares import Solution, basis, covariance_blocks

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

POINTS = 20000  # for which ten coefficients' covariances are gathered at once
DECAY = 15  # power of the interval with which the error of q falls: 10 far from the limit of the band, more near it
HIGHEST = 6  # derivative with a standard deviation


@dataclass(frozen=True, eq=False)
class Spread:
    """Covariances of a least-squares spline: (B^T B)^-1, times a variance per interval and joint.

    Attributes
    ----------
    solution : Solution
        The spline, of the joints that move.
    variance : (M, n)
        Variances of white noise that is fitted as the samples' noise is.
    coarser : BSpline or None
        A spline of fewer intervals, to tell the error of the spline itself from.
    ratio : float
        How many times fewer.
    stamps : tuple of (Solution, float), or None
        The fit to samples at their stamps as they are, and the standard deviation of these, where they are corrected.
    """

    solution: Solution
    variance: np.ndarray
    coarser: "BSpline | None" = None
    ratio: float = 1.0
    stamps: tuple[Solution, float] | None = None

    def covariances(self, t: np.ndarray, order: int) -> np.ndarray:
        """Covariances of q, qd, ... with each other at times (P,), (P, n, order + 1, order + 1)."""
        return np.concatenate([self._covariances(part, order) for part in _portions(t)])

    def _covariances(self, t: np.ndarray, order: int) -> np.ndarray:
        unit, place = _unit_covariances(self.solution, self._blocks, t, order)
        total = self.variance[place][:, :, None, None] * unit[:, None]
        if self.stamps:
            solution, sigma = self.stamps
            late, _ = _unit_covariances(solution, self._stamp_blocks, t, order)
            leibniz = self._leibniz(t, order)
            total += leibniz @ (sigma**2 * late)[:, None] @ leibniz.mT
        if self.coarser is not None:
            for k, model in enumerate(self._model[: order + 1]):
                middles = (self.solution.breaks[1:] + self.solution.breaks[:-1]) / 2
                total[:, :, k, k] += np.stack([np.interp(t, middles, column) for column in model.T], axis=1)
        return total

    def _leibniz(self, t: np.ndarray, order: int) -> np.ndarray:
        """(v tau)^(k) = sum_a binomial(k, a) v^(k - a) tau^(a) as matrices (P, n, order + 1, order + 1)."""
        spline = self.solution.spline
        v = [spline(t, nu=k + 1) for k in range(order + 1)]
        out = np.zeros((*v[0].shape, order + 1, order + 1))
        for k in range(order + 1):
            for a in range(k + 1):
                out[:, :, k, a] = comb(k, a) * v[k - a]
        return out

    @cached_property
    def _blocks(self) -> np.ndarray:
        return covariance_blocks(self.solution.factor)

    @cached_property
    def _stamp_blocks(self) -> np.ndarray:
        assert self.stamps
        return covariance_blocks(self.stamps[0].factor)

    @cached_property
    def _model(self) -> list[np.ndarray]:
        """Mean squares (M, n), per derivative, of the spline's own error, by Richardson's extrapolation.

        The error of a derivative falls with a power of the interval; what a coarser spline differs by is the error of
        that one without this one's. Squares are averaged over an interval and those on either side.
        """
        assert self.coarser is not None
        breaks = self.solution.breaks
        t = (breaks[:-1, None] + np.diff(breaks)[:, None] * np.array([0.125, 0.375, 0.625, 0.875])).ravel()
        out = []
        for k in range(HIGHEST + 1):
            rest = self.ratio ** -(DECAY - k)
            apart = (self.solution.spline(t, nu=k) - self.coarser(t, nu=k)) * rest / (1 - rest)
            squares = (apart**2).reshape(len(breaks) - 1, 4, -1).mean(axis=1)
            padded = np.pad(squares, ((1, 1), (0, 0)), mode="edge")
            out.append((padded[:-2] + padded[1:-1] + padded[2:]) / 3)
        return out


def ideal_deviation(sigma: float, spacing: float, bandwidth: float, order: int) -> float:
    """The standard deviation of a derivative of samples smoothed by an ideal low-pass filter.

    White noise of sigma at spacing dt has the density 2 sigma^2 dt per Hz. Up to B Hz, its k-th derivative has the
    variance 2 sigma^2 dt B (2 pi B)^(2 k) / (2 k + 1); a spline with intervals of 1 / (2 B) comes within some percent.
    """
    variance = 2 * sigma**2 * spacing * bandwidth * (2 * np.pi * bandwidth) ** (2 * order) / (2 * order + 1)
    return float(np.sqrt(variance))


def _unit_covariances(
    solution: Solution, blocks: np.ndarray, t: np.ndarray, order: int
) -> tuple[np.ndarray, np.ndarray]:
    """Covariances (P, order + 1, order + 1) for white noise of variance 1, and the intervals of the times."""
    t = t.clip(solution.breaks[0], solution.breaks[-1])
    rows = [basis(t, solution.breaks, k) for k in range(order + 1)]
    values, place = np.stack([row for row, _ in rows], axis=1), rows[0][1]
    return values @ blocks[place] @ values.mT, place


def _portions(t: np.ndarray) -> Iterator[np.ndarray]:
    for start in range(0, max(1, len(t)), POINTS):
        yield t[start : start + POINTS]
