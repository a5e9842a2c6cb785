"""Where a sampled motion is not smooth: jumps of its velocity, acceleration or jerk, told before any force is.

Between samples nothing is known, so this is a heuristic: a difference is a jump if it is much larger than those next to
it. A spline through such samples is smooth nevertheless, and its rates near the jumps are meaningless.
"""

from collections.abc import Sequence

import numpy as np

NAMES = {1: "velocity", 2: "acceleration", 3: "jerk"}
STANDS_OUT = 8  # times the neighbouring differences
FEWEST = 32  # samples, below which nothing can be told
OF_THE_PEAK = 0.02  # share of the largest value, below which a difference is no jump worth a word


@np.errstate(all="ignore")  # absurd steps make absurd differences, which no floor lets pass
def of_samples(t: np.ndarray, q: np.ndarray) -> str | None:
    """What jumps in a motion given by samples q, (N, n), alone: its rates are divided differences."""
    if len(q) < FEWEST:
        return None
    noise = 100 * np.array([resolution(column) for column in q.T])
    difference, orders = q, []
    for k in NAMES:
        difference = np.diff(difference, axis=0) * k / (t[k:] - t[:-k])[:, None]
        orders.append((k, difference, k, noise * (2 / np.diff(t).min()) ** k))
    return _told(orders)


def of_rates(rates: Sequence[np.ndarray]) -> str | None:
    """What jumps in a motion given with its rates."""
    if len(rates[0]) < FEWEST:
        return None
    return _told([(k, rates[k], 1, np.zeros(rates[k].shape[1])) for k in NAMES if k < len(rates)])


def resolution(samples: np.ndarray) -> float:
    """Half a unit in the last place that samples are given to: of their decimals, or of doubles."""
    ulp = np.finfo(float).eps * float(np.abs(samples).max()) / 2
    decimals = next((d for d in range(13) if np.array_equal(np.round(samples, d), samples)), None)
    return ulp if decimals is None or not np.ptp(samples) else max(ulp, 0.5 * 10.0**-decimals)


def _told(orders: Sequence[tuple[int, np.ndarray, int, np.ndarray]]) -> str | None:
    for k, values, width, floors in orders:
        columns = zip(values.T, floors, strict=True)
        knots = sorted({knot for column, floor in columns for knot in _jumps(column, width, floor)})
        if knots:
            apart = 1 + int(np.count_nonzero(np.diff(knots) > width))
            what = f"{NAMES[k]} jumps at {apart} knot{'s' * (apart > 1)}"
            return f"{what}: {_force(k - 2)} is discontinuous there, {_force(k - 1)} undefined"
    return None


def _force(order: int) -> str:
    return "qd" if order < 0 else ("Q", "Qd", "Q2d")[order]


def _jumps(values: np.ndarray, width: int, floor: float) -> list[int]:
    """Where a sequence jumps; a jump seen through divided differences spreads over `width` of them."""
    steps = np.abs(np.diff(values))
    reach = width + 1
    if len(steps) < 2 * reach + 2:
        return []
    padded, count = np.pad(steps, reach + 1), len(steps)
    beside = np.max([padded[s : s + count] for s in (0, 1, 2 * reach + 1, 2 * reach + 2)], axis=0)
    found = np.flatnonzero(steps > np.maximum(STANDS_OUT * beside, max(floor, OF_THE_PEAK * np.abs(values).max())))
    groups = np.split(found, np.flatnonzero(np.diff(found) > width) + 1)
    return [int(group[len(group) // 2]) for group in groups if group.size]
