"""Find where a sampled motion is not smooth, before forces are reported.

It is not smooth where its velocity, acceleration or jerk jumps.

Between samples nothing is known, so this is a heuristic: a difference is a jump if it is much larger than those next to
it. A spline through such samples is smooth nevertheless, and its rates near the jumps are meaningless.
"""

from collections.abc import Sequence

import numpy as np

from jounce.motion import noise
from jounce.motion.curves import ROUNDING_OF_Q

DERIVATIVE_NAMES = {
    "q": {1: "velocity", 2: "acceleration", 3: "jerk"},  # by the order of the derivative
    "W": {0: "a wrench", 1: "the rate of a wrench", 2: "the second rate of a wrench"},
}
FORCE_ORDERS = {"q": 2, "W": 0}  # order of the derivative of each that Q takes
MIN_JUMP_TO_NEIGHBOURS = 8  # times the neighbouring differences: those of smooth motions grow by less
MAX_FORCE_ORDER = 2  # the order of Q2d
MIN_JUDGED_SAMPLES = 32  # fewer do not show what differences or speeds are usual
MAX_NOISE_DEVIATIONS = 8  # standard deviations of the samples, which differences of any order seldom exceed
MIN_HOLE_TO_SPACING = 5  # times the usual spacing of samples
MAX_ROUNDING_SHARE = 0.01  # of a rate: a user should hear of more
MIN_JUMP_TO_PEAK = 0.02  # share of the largest value, below which a difference is no jump worth a word


@np.errstate(all="ignore")  # absurd steps make absurd differences, which no floor lets pass
def describe_sample_jumps(
    t: np.ndarray, q: np.ndarray, sigma: np.ndarray | float = 0.0, symbol: str = "q"
) -> str | None:
    """Describe what jumps in a motion of samples alone.

    The samples (N, n) are of a motion or of a wrench. They have noise of standard deviations sigma (n,). Rates are
    divided differences.
    """
    if len(q) < MIN_JUDGED_SAMPLES:
        return None
    noise = np.maximum(100 * np.array([rounding_error(column) for column in q.T]), MAX_NOISE_DEVIATIONS * sigma)
    difference, orders, spacing = q, [], np.diff(t)
    # Next to a hole differences are of another scale: they count neither as jumps nor as usual ones.
    holes = spacing > MIN_HOLE_TO_SPACING * np.median(spacing)
    for k in range(max(DERIVATIVE_NAMES[symbol]) + 1):
        difference = np.diff(difference, axis=0) * k / (t[k:] - t[:-k])[:, None] if k else difference
        # The k-th difference takes k + 1 spacings; it takes noise 2^k times over the spacings.
        unlike = np.asarray(np.lib.stride_tricks.sliding_window_view(holes, k + 1).any(axis=1))
        orders.append((k, difference, max(k, 1), noise * (2 / spacing.min()) ** k, unlike))
    return _describe_jumps([order for order in orders if order[0] in DERIVATIVE_NAMES[symbol]], symbol)


def describe_rate_jumps(rates: Sequence[np.ndarray]) -> str | None:
    """Describe what jumps in a motion that states its rates."""
    if len(rates[0]) < MIN_JUDGED_SAMPLES:
        return None
    none, floors = np.zeros(len(rates[0]) - 1, bool), [MIN_JUMP_TO_PEAK * peak for peak in rate_peaks(rates)]
    return _describe_jumps([(k, rates[k], 1, floors[k], none) for k in DERIVATIVE_NAMES["q"] if k < len(rates)], "q")


def rate_peaks(rates: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Return the largest value of each rate (N, n), by column.

    Of columns at rest but for rounding it is that of all others. What their rates are is rounding too, to be
    held against those that move; infinite where none does.
    """
    rests = np.ptp(rates[0], axis=0) <= ROUNDING_OF_Q * np.abs(rates[0]).max(axis=0)
    peaks = [np.abs(rate).max(axis=0) for rate in rates]
    return [np.where(rests, np.inf if rests.all() else peak[~rests].max(initial=0), peak) for peak in peaks]


def rate_sizes(rates: Sequence[np.ndarray], span: float) -> list[np.ndarray]:
    """Return how large each rate is over a time, by column.

    Those that are zero are as lower ones would make them.
    """
    peaks = rate_peaks(rates)
    # The i-th rate of a size over a span makes a k-th rate of that size over span^(k - i).
    implied = ([peak / span ** (k - i) for i, peak in enumerate(peaks[: k + 1])] for k in range(len(peaks)))
    return [np.maximum(np.max(sizes, axis=0), np.finfo(float).tiny) for sizes in implied]


def rounding_error(samples: np.ndarray) -> float:
    """Return half the step that samples are rounded to.

    It is that of an encoder, of their decimals, or of doubles.
    """
    ulp = np.finfo(float).eps * float(np.abs(samples).max()) / 2
    return max(ulp, 0.5 * noise.find_step(samples)[0]) if np.ptp(samples) != 0 else ulp


def _describe_jumps(orders: Sequence[tuple[int, np.ndarray, int, np.ndarray, np.ndarray]], symbol: str) -> str | None:
    """Describe the lowest derivative that jumps, and the forces then.

    None if no derivative jumps. Of each order there are its values, the width of a jump in them, floors below which
    nothing is a jump, and which steps are unlike others.
    """
    for k, values, width, floors, unlike in orders:
        knots: set[int] = set()
        for column, floor in zip(values.T, floors, strict=True):
            knots.update(_find_jumps(column, width, floor, unlike))
        if len(knots) == 0:
            continue
        # Jumps of several joints at one place count once.
        count = 1 + int(np.count_nonzero(np.diff(sorted(knots)) > width))
        what = f"{DERIVATIVE_NAMES[symbol][k]} jumps at {count} knot{'s' * (count > 1)}"
        order = k - FORCE_ORDERS[symbol]
        then = f", {_force_name(order + 1)} undefined" if order < MAX_FORCE_ORDER else ""
        return f"{what}: {_force_name(order)} is discontinuous there{then}"
    return None


def _force_name(order: int) -> str:
    """Return the name of a rate of the forces, or qd below."""
    return "qd" if order < 0 else ("Q", "Qd", "Q2d")[order]


def _find_jumps(values: np.ndarray, width: int, floor: float, unlike: np.ndarray) -> list[int]:
    """Return where a sequence jumps, but for steps `unlike` others.

    Seen through divided differences, a jump takes `width`.
    """
    steps = np.where(unlike, 0, np.abs(np.diff(values)))
    reach = width + 1
    if len(steps) < 2 * reach + 2:
        return []
    padded, count = np.pad(steps, reach + 1), len(steps)
    # The two steps on either side beyond the reach of a jump show what is usual there.
    neighbours = np.max([padded[s : s + count] for s in (0, 1, 2 * reach + 1, 2 * reach + 2)], axis=0)
    jumps = np.flatnonzero(
        steps > np.maximum(MIN_JUMP_TO_NEIGHBOURS * neighbours, max(floor, MIN_JUMP_TO_PEAK * np.abs(values).max()))
    )
    # Large steps within the width of a jump are one jump, at the middle of them.
    groups = np.split(jumps, np.flatnonzero(np.diff(jumps) > width) + 1)
    return [int(group[len(group) // 2]) for group in groups if group.size]
