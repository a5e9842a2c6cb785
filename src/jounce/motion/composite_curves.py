"""Make curves of curves: at another pace, cut, joined, blended, by stances.

`RetimedCurve`, `CurvePart` and `CurveChain` take rates, jumps and deviations from the curves that they are made of, by
the rules of each.

`blend_curve` replaces the breaks of a curve by polynomials that continue it smoothly on both sides, column by column: a
`Blend` has windows around them, within which it is the Hermite polynomial of the rates at their ends.

`make_presence` is the curve of the contacts that stances name: of each the presence, 1 while it is there, else 0. It
multiplies the inverses of the weights of a contact, so that at 0 the contact transmits nothing. Its blends are
polynomials from 0 to 1 after the contact comes, and back before it leaves.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np

from jounce.core.cures import Remedy
from jounce.core.errors import JounceError, as_list, join_names, quote_value
from jounce.core.scalars import is_finite
from jounce.motion.curves import (
    INNER_SHARES,
    Curve,
    DerivedCurve,
    Jump,
    Polynomials,
    find_jumps,
    keep_by_order,
    sample_rates,
)
from jounce.motion.hermite import evaluate_nearer, hermite_coefficients, reversed_rates

BLEND_POINTS = 257  # at which its distance from the curve is measured; odd: the break is one of them
BLEND_DEGREE = 9
MAX_BLEND_SHARE = 0.49  # of a stance, at both of whose ends contacts may be blended
# The polynomial from 0 at 0 to 1 at 1, highest power first, whose first four derivatives vanish at both ends.
STEP_COEFFICIENTS = np.array([70.0, -315, 540, -420, 126, 0, 0, 0, 0, 0])


@dataclass(frozen=True, eq=False)
class RetimedCurve(DerivedCurve):
    """A curve at another pace: its value at t is that of `base` at origin + (t - place) / factor.

    The differences are short where the times are stamps since 1970, whose products would lose digits.
    """

    factor: float
    origin: float
    place: float

    def rates(self, t: np.ndarray, order: int, left: bool = False) -> list[np.ndarray]:
        rates = self.base.rates(self.inner_at_jumps(t, order), order, left)
        return [rate / self.factor**k for k, rate in enumerate(rates)]

    def jumps(self, order: int) -> list[Jump]:
        jumps = self.base.jumps(order)
        times = self.outer(np.array([jump.t for jump in jumps])).tolist()
        sizes = (jump.size / self.factor**jump.order for jump in jumps)
        return [jump._replace(t=t, size=size) for jump, t, size in zip(jumps, times, sizes, strict=True)]

    def deviations(self, t: np.ndarray, order: int) -> list[np.ndarray] | None:
        deviations = self.base.deviations(self.inner(t), order)
        return None if deviations is None else [rate / self.factor**k for k, rate in enumerate(deviations)]

    def outer(self, t: np.ndarray) -> np.ndarray:
        return self.place + (t - self.origin) * self.factor

    def inner(self, t: np.ndarray) -> np.ndarray:
        return (self.origin + (t - self.place) / self.factor).clip(self.base.start, self.base.stop)


@dataclass(frozen=True, eq=False)
class CurvePart(DerivedCurve):
    """A curve between two times."""

    first: float
    last: float

    def outer(self, t: np.ndarray) -> np.ndarray:
        """Return the times, moved to within the part."""
        return t.clip(self.first, self.last)

    def rates(self, t: np.ndarray, order: int, left: bool = False) -> list[np.ndarray]:
        return self.base.rates(t, order, left)

    def jumps(self, order: int) -> list[Jump]:
        return [jump for jump in self.base.jumps(order) if self.first < jump.t < self.last]


@dataclass(frozen=True, eq=False)
class CurveChain:
    """Curves one after the other: each begins where the previous one ends."""

    links: tuple[Curve, ...]

    @property
    def start(self) -> float:
        return self.links[0].start

    @property
    def stop(self) -> float:
        return self.links[-1].stop

    @property
    def columns(self) -> int:
        return self.links[0].columns

    @property
    def highest(self) -> int | None:
        """The order of the last derivative that all of the curves know."""
        return min((link.highest for link in self.links if link.highest is not None), default=None)

    def rates(self, t: np.ndarray, order: int, left: bool = False) -> list[np.ndarray]:
        rates = np.empty((order + 1, len(t), self.columns))
        for places, link in self._shares(t, left):
            rates[:, places] = link.rates(t[places], order, left)
        return list(rates)

    def deviations(self, t: np.ndarray, order: int) -> list[np.ndarray] | None:
        """Return the standard deviations: 0 where a curve is exact.

        None if all curves are exact.
        """
        if all(link.deviations(np.array([link.start]), 0) is None for link in self.links):
            return None
        deviations = np.zeros((order + 1, len(t), self.columns))
        for places, link in self._shares(t, False):
            parts = link.deviations(t[places], order)
            if parts is not None:
                deviations[: len(parts), places] = parts
        return list(deviations)

    def _shares(self, t: np.ndarray, left: bool) -> Iterator[tuple[np.ndarray, Curve]]:
        """Yield the numbers of the times of each curve, and the curve."""
        starts = np.array([link.start for link in self.links[1:]])
        link_numbers = np.searchsorted(starts, t, side="left" if left else "right")
        for i in np.unique(link_numbers):
            yield np.flatnonzero(link_numbers == i), self.links[i]

    @keep_by_order
    def jumps(self, order: int) -> list[Jump]:
        """Return where a derivative up to `order` jumps.

        It jumps within the curves, and where they meet.
        """
        jumps = [jump for link in self.links for jump in link.jumps(order)]
        for a, b in zip(self.links[:-1], self.links[1:], strict=True):
            before, after = a.rates(np.array([a.stop]), order, True), b.rates(np.array([b.start]), order)
            # Rates within both curves show how large a difference is, which may be rounding.
            span = max(a.stop - a.start, b.stop - b.start)
            sides = (sample_rates(link, order) for link in (a, b))
            within = [np.concatenate(parts) for parts in zip(*sides, strict=True)]
            jumps += find_jumps(np.array([b.start]), before, after, np.array([span]), within)
        return sorted(jumps)


# Breaks that are blended.
@dataclass(frozen=True, eq=False)
class BlendWindows:
    """The windows in which one column is replaced by polynomials."""

    start: np.ndarray  # (m,)
    stop: np.ndarray  # (m,)
    left: np.ndarray  # (k, m), rates at the starts
    right: np.ndarray  # (k, m), rates at the stops

    def locate(self, t: np.ndarray, left: bool) -> tuple[np.ndarray, np.ndarray]:
        """Return the numbers of times in windows, and of their windows.

        With `left`, the end of a window belongs to it, and its start does not.
        """
        i = np.searchsorted(self.start, t, side="left" if left else "right") - 1
        stop = self.stop[i.clip(0)]
        is_before_stop = (t <= stop) if left else (t < stop)
        places = np.flatnonzero((i >= 0) & is_before_stop)
        return places, i[places]

    def outside(self, jumps: Sequence[Jump]) -> list[Jump]:
        """Return the jumps of the column that lie in no window."""
        replaced, _ = self.locate(np.array([jump.t for jump in jumps]), False)
        return [jumps[i] for i in np.setdiff1d(np.arange(len(jumps)), replaced)]

    @cached_property
    def coefficients(self) -> np.ndarray:
        """The polynomials' coefficients (2 k, 2, m).

        They are expanded at the start, and backwards at the stop: each is exact at its end.
        """
        left, right, h = [*self.left], [*self.right], self.stop - self.start
        ahead = hermite_coefficients(left, right, h)
        return np.stack([ahead, hermite_coefficients(reversed_rates(right), reversed_rates(left), h)], axis=1)

    def rates(self, t: np.ndarray, i: np.ndarray, order: int) -> list[np.ndarray]:
        """Return the column at times (N,) in windows i (N,), with derivatives."""
        h = self.stop[i] - self.start[i]
        u = (t - self.start[i]) / h
        # The expansion at the nearer end, (2 k, N, 1).
        c = self.coefficients[:, (u > 0.5).astype(int), i, None]
        return [rate[:, 0] for rate in evaluate_nearer(c, h[:, None], u[:, None], order)]


@dataclass(frozen=True, eq=False)
class Blend(DerivedCurve):
    """A curve `base` with windows of its own in every column.

    A column without breaks has None.
    """

    windows: tuple[BlendWindows | None, ...]

    def rates(self, t: np.ndarray, order: int, left: bool = False) -> list[np.ndarray]:
        rates = [rate.copy() for rate in self.base.rates(t, order, left)]
        for j, windows in enumerate(self.windows):
            if windows is None:
                continue
            places, i = windows.locate(t, left)
            if places.size > 0:
                for rate, blended in zip(rates, windows.rates(t[places], i, order), strict=True):
                    rate[places, j] = blended
        return rates

    @keep_by_order
    def jumps(self, order: int) -> list[Jump]:
        """Return where a derivative up to `order` jumps.

        It is the curve outside of all windows that jumps, or the ends of windows.
        """
        jumps: list[Jump] = []
        for j, windows in enumerate(self.windows):
            of_column = [jump for jump in self.base.jumps(order) if jump.column == j]
            if windows is not None:
                of_column = windows.outside(of_column) + self._jumps_at_ends(j, windows, order)
            jumps += of_column
        return sorted(jumps)

    def _jumps_at_ends(self, j: int, windows: BlendWindows, order: int) -> list[Jump]:
        """Return the jumps of a column at the ends of its windows."""
        t = np.concatenate([windows.start, windows.stop])
        before, after = ([rate[:, [j]] for rate in self.rates(t, order, left)] for left in (True, False))
        spans = windows.stop - windows.start
        # Rates inside of the windows show how large a difference is: at an end they may be zero.
        inside = np.concatenate([windows.start + share * spans for share in INNER_SHARES])
        within = [rate[:, [j]] for rate in self.rates(inside, order)]
        return [jump._replace(column=j) for jump in find_jumps(t, before, after, np.tile(spans, 2), within)]


def blend_curve(base: Curve, time: float, continuity: int, names: Sequence[str]) -> tuple[Blend, np.ndarray]:
    """Return a curve with polynomials in place of its breaks.

    They last for a time, and are C^continuity. How far the curve moves, (columns,), comes with it.
    """
    times: list[list[float]] = [[] for _ in names]
    for jump in base.jumps(continuity):
        times[jump.column].append(jump.t)
    windows: list[BlendWindows | None] = []
    for j, (name, breaks) in enumerate(zip(names, times, strict=True)):
        if len(breaks) == 0:
            windows.append(None)
            continue
        _check_gaps(base, np.unique(breaks), time, name)
        windows.append(_make_windows(base, j, np.unique(breaks), time, continuity))
    blend = Blend(base, tuple(windows))
    distances = [0.0 if column is None else _measure_distance(blend, column, j) for j, column in enumerate(windows)]
    return blend, np.array(distances)


def _check_gaps(base: Curve, t: np.ndarray, time: float, name: str) -> None:
    """Raise `JounceError` where two blends of a joint would overlap.

    One that would reach beyond an end of the motion is refused too.
    """
    # At an end of the motion half a blend is enough: the end counts as a break as far behind it.
    ends = np.concatenate([[2 * base.start - t[0]], t, [2 * base.stop - t[-1]]])
    gaps = np.diff(ends)
    i = int(gaps.argmin())
    if gaps[i] >= time * (1 - 1e-9):
        return
    if 0 < i < len(gaps) - 1:
        where = f"the breaks at t = {ends[i]:.9g} and {ends[i + 1]:.9g} s"
    elif i == 0:
        where = f"the break at t = {t[0]:.9g} s and the start of the motion"
    else:
        where = f"the break at t = {t[-1]:.9g} s and the end of the motion"
    raise JounceError(
        f"a blend of {time:g} s does not fit between {where}, of {name};"
        f" expected {Remedy('blended(time=...)', '--blend')} of at most {np.floor(gaps[i] * 1e6) / 1e6:g} s"
    )


def _make_windows(base: Curve, j: int, t: np.ndarray, time: float, continuity: int) -> BlendWindows:
    """Return the windows of a column around breaks at t (m,)."""
    # A break at an end of the motion has half a window.
    start, stop = np.maximum(t - time / 2, base.start), np.minimum(t + time / 2, base.stop)
    before = np.array([rate[:, j] for rate in base.rates(start, continuity, True)])
    after = np.array([rate[:, j] for rate in base.rates(stop, continuity, False)])
    return BlendWindows(start, stop, before, after)


def _measure_distance(blend: Blend, windows: BlendWindows, j: int) -> float:
    """Return the largest distance of a blend from its curve.

    It is that at some points, and what the curvature allows between them.
    """
    u = np.linspace(0, 1, BLEND_POINTS)
    t = windows.start[:, None] + (windows.stop - windows.start)[:, None] * u
    rates = zip(blend.rates(t.ravel(), 2), blend.base.rates(t.ravel(), 2), strict=True)
    # Between points h apart a function is above their line by at most h^2 / 8 times its second derivative.
    q, _, q2d = (np.abs(a[:, j] - b[:, j]).max() for a, b in rates)
    return float(q + q2d * (windows.stop - windows.start).max() ** 2 / (BLEND_POINTS - 1) ** 2 / 8)


# Contacts that come and leave.
def make_presence(
    stance_list: Any, blend: Any, start: float, stop: float
) -> tuple[tuple[str, ...], Polynomials | None]:
    """Return the frames that stances name, and the curve of their presence.

    The curve lasts from `start` to `stop`. Every argument is checked.
    """
    stances = as_list(stance_list)
    for entry in stances:
        if not isinstance(entry, Sequence) or len(entry) != 2 or not is_finite(entry[0]):
            raise JounceError(f"stances holds {quote_value(entry)}; expected pairs (time in s, frames of the contacts)")
    if len(stances) == 0:
        return (), None
    starts = [float(t) for t, _ in stances]
    if starts[0] > start or starts[-1] >= stop or (np.diff(starts) <= 0).any():
        came = f"stances begin at {join_names(f'{t:.6g}' for t in starts)} s"
        raise JounceError(f"{came}; expected times that increase, from {start:.6g} s on, to before {stop:.6g} s")
    # Contacts come and leave within a stance: two blends have to fit into the shortest one.
    ends = np.array([start, *starts[1:], stop])
    longest = MAX_BLEND_SHARE * float(np.diff(ends).min())
    if not is_finite(blend) or not 0 <= blend <= longest:
        came = f"blend is {quote_value(blend)}"
        raise JounceError(f"{came}; expected 0 to {longest:.6g} s, {MAX_BLEND_SHARE} of the shortest stance")
    frames = tuple(dict.fromkeys(frame for _, names in stances for frame in as_list(names)))
    odd = [frame for frame in frames if not isinstance(frame, str)]
    if len(odd) > 0:
        raise JounceError(f"stances hold {quote_value(odd[0])}; expected names of frames of contacts")
    # Which frames each stance has, (stances, frames).
    present = np.array([[frame in as_list(names) for frame in frames] for _, names in stances], dtype=bool)
    return frames, _join_stances(ends, present, float(blend))


def _join_stances(ends: np.ndarray, present: np.ndarray, blend: float) -> Polynomials:
    """Return the presence (frames,) over time.

    Between `ends` (S + 1,) those frames are there that `present` (S, frames) says. In flight there is nothing to blend
    with.
    """
    powers = np.arange(len(STEP_COEFFICIENTS))[::-1, None]
    # Polynomials of time since the start of a piece, (10, 1): 1, and the rise from 0 to 1 in the time of a blend.
    one = 1.0 * (powers == 0)
    rise = STEP_COEFFICIENTS[:, None] / (1.0 if blend == 0 else blend) ** powers
    x, c = [ends[0]], list[np.ndarray]()
    stances = [present[0], *present, present[-1]]
    for i, (first, last) in enumerate(pairwise(ends)):
        before, during, after = stances[i : i + 3]
        # Contacts come or leave smoothly only while others carry the robot before or after.
        comes, leaves = (during & ~other & other.any() for other in (before, after))
        if blend == 0:
            x.append(last)
            c.append(one * during)
        else:
            x += [first + blend, last - blend, last]
            c += [one * during - (one - rise) * comes, one * during, one * during - rise * leaves]
    return Polynomials(np.array(x), np.stack(c, axis=1))
