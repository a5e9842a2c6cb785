"""The fastest speed along a path under limits that are linear in x = sigma'^2 and u = sigma'': reachability analysis.

Problem: x(sigma) >= 0 of least duration, the integral of x^(-1/2), with ``lower <= G u + H x + g <= upper`` along the
path, where ``u = x'/2``.

Algorithm: TOPP-RA [1]. The path is divided into N intervals, on each of which u is linear with a given slope w, so that
the rows at its start, middle and end are half-planes of x and u at its start. Backwards, x is controllable up to
K[i], from where some u leads to x <= K[i + 1]; forwards, the largest u that stays within K is taken. Both steps are the
least of affine functions of x. The first round has w = 0, an error of the first order in the length of intervals; its
solution yields the slopes w of the second, which leaves one of the second order. Slopes are limited as in schemes for
shocks (minmod), hence 0 where u switches back and forth.

Invariants: a robot at rest is strictly within all limits, so that x = 0 is controllable everywhere and K[i] > 0; the
greedy x is the largest of all at every point of the path, but for the length of intervals [1]. Where G passes zero, so
that x alone is bounded (a zero-inertia point), rows at both ends of the interval bound u, and no division by G decides.

Failure: the profile ends at less than the x asked for where no u leads there, and exceeds bounds between the points
where these are too few: both are for callers to see (`Profile.excess`).

[1] H. Pham, Q.-C. Pham, A new approach to time-optimal path parameterization based on reachability analysis, IEEE
    Transactions on Robotics 34 (2018).
"""

from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np

MAX_EXCESS_ON_INTERVALS = 1e-4  # of a limit: what rows may exceed it by between the three points of an interval
_SHARES = np.array([0.0, 0.5, 1.0])[:, None]  # of an interval: where rows hold
_QUARTERS = np.array([0.25, 0.75])[:, None]
_FLAT_ROW = 1e-12  # of its bound: what u within its range adds to a row that bounds x alone
_MAX_SPEED_STEPS = 60  # of Newton's method on concave functions of a few dozen pieces, which takes three to five
_SPEED_ROUNDING = 1e-12  # of u: bounds of u that meet to rounding
_CAPS_TRIED = 200  # in a geometric series: the cap needs no digits
_NEAR_CAP, _SHARE_NEAR_CAP = 0.1, 1e-3  # of a cap, where x has a corner, and of the duration that is spent there
_RESERVE_NEAR_CAP = 5e-3  # of bounds, where that takes no time: the corner lies between points
_MAX_ROUNDS = 4  # one finds the profile, others remove what exceeds a bound between points


@cache
def _gauss_legendre() -> tuple[np.ndarray, np.ndarray]:
    return np.polynomial.legendre.leggauss(4)


@dataclass(frozen=True, eq=False)
class PathRows:
    """R rows at the start, middle and end of N intervals of a path: ``lower <= G u + H x + g <= upper``.

    `G`, `H`, `g` are (3, N, R), the bounds (R,), `length` (N,) is that of the intervals.
    """

    length: np.ndarray
    G: np.ndarray
    H: np.ndarray
    g: np.ndarray
    lower: np.ndarray
    upper: np.ndarray

    @cached_property
    def alone(self) -> np.ndarray:
        """Which rows (R,) do not take u."""
        return np.asarray(~self.G.any(axis=(0, 1)))

    def uniform(self) -> float:
        """The largest x that, constant along the path, is within all rows."""
        with np.errstate(divide="ignore", invalid="ignore"):
            most = np.where(self.H > 0, self.upper - self.g, self.lower - self.g) / self.H
        return float(np.where(self.H == 0, np.inf, most).min())


@dataclass(frozen=True, eq=False)
class Profile:
    """x (N + 1,) at the ends of intervals, u (N,) at their starts, and its slope (N,) on them."""

    x: np.ndarray
    u: np.ndarray
    slope: np.ndarray

    def at(self, d: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """x and u at distances d (..., N) from the starts of the intervals."""
        return self.x[:-1] + d * (2 * self.u + d * self.slope), self.u + d * self.slope

    def duration(self, length: np.ndarray) -> float:
        """The integral of x^(-1/2) by the rule of Gauss and Legendre on each interval."""
        nodes, weights = _gauss_legendre()
        x, _ = self.at(length / 2 * (1 + nodes[:, None]))
        return float((weights @ x.clip(np.finfo(float).tiny) ** -0.5 * length / 2).sum())

    def cap(self, length: np.ndarray, cost: float, highest: float) -> float:
        """A cap of x that makes the duration longer by a share, but for where x is at the highest cap already."""
        x, _ = self.at(length / 2)
        x, length = (part[x < highest / 2] for part in (x, length))
        if not x.size:  # it is at the highest cap all along
            return highest
        caps = np.geomspace(x.max(), np.median(x), _CAPS_TRIED)
        with np.errstate(divide="ignore"):
            longer = (length * (caps[:, None] ** -0.5 - x**-0.5).clip(0)).sum(axis=1)
        return float(caps[np.searchsorted(longer, cost * (length * x**-0.5).sum(), side="right") - 1])

    def excess(self, rows: PathRows) -> np.ndarray:
        """By how much rows leave their bounds on each interval (N, R), between its three points by parabolas."""
        x, u = self.at(_SHARES * rows.length)
        first, middle, last = rows.G * u[..., None] + rows.H * x[..., None] + rows.g
        rise, bend = last - first, 2 * (first + last - 2 * middle)  # value: middle + rise s + bend s^2, |s| <= 1/2
        with np.errstate(divide="ignore", invalid="ignore"):
            top = np.where(np.abs(rise) < np.abs(bend), middle - rise**2 / (4 * bend), middle)
        # Rows of x alone have kinks, where another joint decides: at quarters, from chords.
        chords = [(part[:-1] + part[1:]) / 2 for part in (rows.H, rows.g)]
        quarters = np.where(rows.alone, chords[0] * self.at(_QUARTERS * rows.length)[0][..., None] + chords[1], middle)
        values = np.stack([first, top, last, *quarters])
        return np.asarray(np.maximum(values - rows.upper, rows.lower - values).max(axis=0))


@dataclass(frozen=True, eq=False)
class _Steps:
    """The least of affine functions that each interval takes: of x at its end backwards, of x at its start forwards."""

    most: np.ndarray  # x at the start for which any u is left
    back: np.ndarray
    back_offset: np.ndarray
    ahead: np.ndarray
    ahead_offset: np.ndarray


def find_first(rows: PathRows, cap: float, first: float | None = None, last: float | None = None) -> Profile:
    """The fastest x below a cap with u constant on intervals, from `first` to at most `last` where these are given."""
    none = np.zeros(len(rows.length))
    return _find_round(rows, none, np.zeros((len(none), len(rows.upper))), cap, first, last)


def refine_profile(
    rows: PathRows, coarse: Profile, cap: float, first: float | None = None, last: float | None = None
) -> Profile:
    """The fastest x below a cap with u linear on intervals, of slopes that those of another profile are near to."""
    best, least, found = coarse, np.inf, coarse
    taken = np.zeros((len(rows.length), len(rows.upper)))
    bent = np.ones(len(rows.length), dtype=bool)  # where u has a slope
    for _ in range(_MAX_ROUNDS):
        high = np.maximum(found.x[1:], found.x[:-1])
        near = high > _NEAR_CAP * cap
        if found.duration(rows.length * near) < _SHARE_NEAR_CAP * found.duration(rows.length):
            taken[near] = taken[near].clip(_RESERVE_NEAR_CAP)
        slope = _estimate_slopes(found.u + found.slope * rows.length / 2, rows.length) * (bent & (high <= cap))
        following = _find_round(rows, slope, taken, cap, first, last)
        if (below := ~(following.at(_SHARES * rows.length)[0].min(axis=0) > 0)).any():
            bent &= ~(below | np.roll(below, 1) | np.roll(below, -1))  # slopes beyond what the limits leave at rest
            continue
        # Bounds are drawn in by what exceeds them between the three points of intervals.
        found = following
        excess = found.excess(rows)
        if (size := float(excess.max())) < least:
            best, least = found, size
        if size <= MAX_EXCESS_ON_INTERVALS:
            break
        taken = taken + excess.clip(0)
    return best


def _find_round(
    rows: PathRows, slope: np.ndarray, taken: np.ndarray, cap: float, first: float | None, last: float | None
) -> Profile:
    """The fastest x with given slopes of u, and bounds drawn in by what is `taken` (N, R)."""
    steps = _build_steps(rows, slope, taken, cap)
    x = _pass_forward(steps, _pass_backward(steps, cap if last is None else last), first)
    return Profile(x, (np.diff(x) / rows.length - rows.length * slope) / 2, slope)


def _build_steps(rows: PathRows, slope: np.ndarray, taken: np.ndarray, cap: float) -> _Steps:
    """The half-planes of x and u at the starts of intervals, and what a step does with them."""
    # x and u at the three points are affine in those at the start, and so are the rows: A u + H x + rest.
    d = _SHARES * rows.length
    bent = d * slope
    A = rows.G + 2 * d[..., None] * rows.H
    rest = rows.g + bent[..., None] * rows.G + (bent * d)[..., None] * rows.H
    upper, lower = rows.upper - taken - rest, rows.lower + taken - rest
    # Rows of x alone hold at the ends of intervals: with those in the middle x would swing from one to the other.
    upper[1][:, rows.alone], lower[1][:, rows.alone] = np.inf, -np.inf
    flat = np.abs(A) * (cap / (2 * rows.length))[:, None] < _FLAT_ROW
    A = np.where(flat, 1.0, A)
    m = np.where(flat, 0.0, -rows.H / A)
    high = np.where(flat, np.inf, np.where(A > 0, upper, lower) / A)
    low = np.where(flat, -np.inf, np.where(A > 0, lower, upper) / A)
    with np.errstate(divide="ignore", invalid="ignore"):
        bound = np.where(rows.H > 0, upper, lower) / rows.H
        most = np.minimum(cap, np.where(flat & (rows.H != 0), bound, np.inf).min(axis=(0, 2)))
    m, high, low = (np.moveaxis(part, 1, 0).reshape(len(slope), -1) for part in (m, high, low))
    # The next x is c x + 2 length n + length^2 w on a line u = m x + n.
    twice, added = 2 * rows.length[:, None], (rows.length**2 * slope)[:, None]
    c, ahead, behind = 1 + twice * m, twice * high + added, twice * low + added
    with np.errstate(divide="ignore", invalid="ignore"):
        most = np.minimum(most, np.where(c < 0, -ahead / c, np.inf).min(axis=1))  # from where the next x is >= 0
        back = np.where(c > 0, 1 / c, 0.0)
        back_offset = np.where((c > 0) & np.isfinite(behind), -behind / c, np.inf)
    return _Steps(_highest_speeds(m, high, low, most), back, back_offset, c, ahead)


def _highest_speeds(m: np.ndarray, high: np.ndarray, low: np.ndarray, most: np.ndarray) -> np.ndarray:
    """The largest x (N,) at which a u is left between lines (N, L): Newton's method on a concave function."""
    row = np.arange(len(most))
    for _ in range(_MAX_SPEED_STEPS):
        above, below = m * most[:, None] + high, m * most[:, None] + low
        i, j = above.argmin(axis=1), below.argmax(axis=1)
        over = below[row, j] - above[row, i] > _SPEED_ROUNDING * np.abs(above[row, i])
        if not over.any():
            break
        fall = np.where(over, m[row, j] - m[row, i], 1.0)
        most = np.where(over, (high[row, i] - low[row, j]) / fall, most)
    return most


def _pass_backward(steps: _Steps, last: float) -> list[float]:
    """The largest controllable x (N + 1,), from that at the end."""
    least, x = np.minimum.reduce, last
    K = [last]
    for most, factor, offset in zip(steps.most[::-1].tolist(), steps.back[::-1], steps.back_offset[::-1], strict=True):
        K.append(x := min(most, float(least(factor * x + offset))))
    return K[::-1]


def _pass_forward(steps: _Steps, K: list[float], first: float | None) -> np.ndarray:
    """The largest x (N + 1,) within the controllable ones, from that at the start."""
    least, now = np.minimum.reduce, K[0] if first is None else min(first, K[0])
    x = [now]
    for most, factor, offset in zip(K[1:], steps.ahead, steps.ahead_offset, strict=True):
        x.append(now := min(most, float(least(factor * now + offset))))
    return np.array(x)


def _estimate_slopes(u: np.ndarray, length: np.ndarray) -> np.ndarray:
    """The slopes of u on intervals from its values in their middles: the smaller of both sides, or 0 where u turns."""
    steep = 2 * np.diff(u) / (length[1:] + length[:-1])
    before, after = np.concatenate([[0.0], steep]), np.concatenate([steep, [0.0]])
    smaller = np.where(np.abs(before) < np.abs(after), before, after)
    return np.where(before * after > 0, smaller, 0.0)
