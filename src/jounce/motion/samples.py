"""Samples as they are smoothed."""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from jounce.motion.least_squares import Rows, few_rows_of

if TYPE_CHECKING:
    from scipy.interpolate import BSpline


@dataclass(frozen=True, eq=False)
class Samples:
    """Samples of the joints that move, as they are smoothed.

    Attributes
    ----------
    t, q, weight : (N,), (N, n), (N,)
        Increasing times, samples, and weights of the rows.
    span : (float, float)
        The first and the last time of the spline.
    steps : (n,)
        Steps of encoders or of written digits, otherwise 0.
    drift : (BSpline, (n,)), or None
        Where stamps are in doubt, a spline to take velocities from, and each joint's own variance.
    unsure : (n,), or None
        By how much each joint's sensor may be read earlier than the times say, s.
    """

    t: np.ndarray
    q: np.ndarray
    weight: np.ndarray
    span: tuple[float, float]
    steps: np.ndarray
    drift: "tuple[BSpline, np.ndarray] | None" = None
    unsure: np.ndarray | None = None

    @property
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

    def rows(self, cells: int) -> Rows:
        """The rows of a least-squares problem, compressed to a number of cells if there are many samples."""
        rows = few_rows_of(self.t, self.q, self.weight, self.span, cells)
        if self.drift is None:
            return rows
        spline, own = self.drift
        return replace(rows, along=(spline(rows.t, nu=1), own))
