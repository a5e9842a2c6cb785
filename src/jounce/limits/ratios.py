"""Ratios of values to limits are 1 at either bound.

A `Scale` holds both bounds of a kind of limit and the centre from which ratios are measured. Which values are beyond a
bound, and in which runs of times, is decided here, with room for rounding.
"""

from dataclasses import dataclass

import numpy as np

ZERO_BOUND_TOLERANCE = 1e-12  # SI units: against a bound of 0, less counts as 0
LIMIT_TOLERANCE = 1e-9  # of the reach of a limit: less beyond it is rounding
SIGNS = (1, -1)  # of values: against the upper bound, and against the lower one


@dataclass(frozen=True, eq=False)
class Scale:
    """The bounds of a kind of limit, and the centre of ratios.

    Bounds and centre are (n,). A ratio is 0 at `centre` and 1 at a bound.
    """

    lower: np.ndarray
    upper: np.ndarray
    centre: np.ndarray

    def bound(self, sign: int) -> np.ndarray:
        """Return the bound below which signed values stay.

        The bound is the upper one (sign 1), or the negative of the lower one (-1).
        """
        return self.upper if sign > 0 else -self.lower

    @np.errstate(invalid="ignore")
    def reach(self, sign: int) -> np.ndarray:
        """Return how far signed values go from the centre to the bound."""
        return np.asarray(self.bound(sign) - sign * self.centre)

    def tolerant(self, sign: int) -> np.ndarray:
        """Return the bounds of signed values, with room for rounding."""
        bound, reach = self.bound(sign), np.abs(self.reach(sign))
        room = np.where(reach == 0, ZERO_BOUND_TOLERANCE, LIMIT_TOLERANCE * reach)
        return np.where(np.isfinite(bound), bound + room, np.inf)

    def beyond(self, value: np.ndarray, sign: int) -> np.ndarray:
        """Return which values (N, n) are beyond the bounds of a sign."""
        return np.asarray(sign * value > self.tolerant(sign))

    @np.errstate(all="ignore")
    def ratio(self, value: np.ndarray, sign: int, joint: np.ndarray | slice = slice(None)) -> np.ndarray:
        """Return the ratios of values to the bounds of a sign.

        They are those of all coordinates or of those given.
        """
        reach, way = self.reach(sign)[joint], value - self.centre[joint]
        unbounded = np.isinf(self.bound(sign)[joint])
        ratio = way / (sign * reach)
        # A bound at the centre, as one of 0, has no ratio: any value beyond it is infinitely far.
        if not reach.all():
            ratio = np.where(reach == 0, np.where(sign * way > ZERO_BOUND_TOLERANCE, np.inf, 0.0), ratio)
        return np.where(unbounded, -np.inf, ratio) if unbounded.any() else ratio

    def largest(self, value: np.ndarray) -> np.ndarray:
        """Return the ratios of values to the nearer bounds."""
        return np.maximum(*(self.ratio(value, sign) for sign in SIGNS))


def build_scale(bounds: np.ndarray, kind: str = "") -> Scale:
    """Build the scale of bounds (2, n).

    Ratios are measured from 0 where it lies between the bounds, of positions from their middle. Where a position has
    one bound only, ratios are measured from 1 rad or 1 m before it.
    """
    lower, upper = bounds
    # Infinite bounds have no middle, and are not used for one.
    with np.errstate(invalid="ignore"):
        middle = (lower + upper) / 2
    before_bound = np.where(np.isfinite(upper), upper - 1, np.where(np.isfinite(lower), lower + 1, 0.0))
    inside = np.where(np.isfinite(lower) & np.isfinite(upper), middle, before_bound)
    from_zero = (kind != "position") & (lower <= 0) & (upper >= 0)
    return Scale(lower, upper, np.where(from_zero, 0.0, inside))


def find_runs(which: np.ndarray) -> list[tuple[int, int]]:
    """Return the first and last index of each true run."""
    # Each run has two edges: its first entry, and the one after its last.
    edges = np.flatnonzero(np.diff(np.concatenate([[False], which, [False]])))
    return [(int(first), int(after) - 1) for first, after in edges.reshape(-1, 2)]
