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
_STEP = np.array([70.0, -315, 540, -420, 126, 0, 0, 0, 0, 0])  # highest power first; four derivatives vanish at 0 and 1


@dataclass(frozen=True, eq=False)
class RetimedCurve(DerivedCurve):
    """A curve at another pace: its value at t is that of `base` at origin + (t - place) / factor.

    The differences are short where the times are stamps since 1970, whose products would lose digits.
    """

    factor: float
    origin: float
    place: float

    def rates(self, t: np.ndarray, order: int, left: bool = False) -> list[np.ndarray]:
        found = self.base.rates(self.inner_at_jumps(t, order), order, left)
        return [rate / self.factor**k for k, rate in enumerate(found)]

    def jumps(self, order: int) -> list[Jump]:
        found = self.base.jumps(order)
        times = self.outer(np.array([jump.t for jump in found])).tolist()
        sizes = (jump.size / self.factor**jump.order for jump in found)
        return [jump._replace(t=t, size=size) for jump, t, size in zip(found, times, sizes, strict=True)]

    def deviations(self, t: np.ndarray, order: int) -> list[np.ndarray] | None:
        found = self.base.deviations(self.inner(t), order)
        return None if found is None else [rate / self.factor**k for k, rate in enumerate(found)]

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
        """The times within the part."""
        return t.clip(self.first, self.last)

    def rates(self, t: np.ndarray, order: int, left: bool = False) -> list[np.ndarray]:
        return self.base.rates(t, order, left)

    def jumps(self, order: int) -> list[Jump]:
        return [jump for jump in self.base.jumps(order) if self.first < jump.t < self.last]


@dataclass(frozen=True, eq=False)
class CurveChain:
    """Curves one after the other: each begins where the one before ends."""

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
        """The order of the last derivative that all of them know."""
        return min((link.highest for link in self.links if link.highest is not None), default=None)

    def rates(self, t: np.ndarray, order: int, left: bool = False) -> list[np.ndarray]:
        found = np.empty((order + 1, len(t), self.columns))
        for at, link in self._shares(t, left):
            found[:, at] = link.rates(t[at], order, left)
        return list(found)

    def deviations(self, t: np.ndarray, order: int) -> list[np.ndarray] | None:
        """The standard deviations of the values and derivatives: 0 where a curve is exact, None if all are."""
        if all(link.deviations(np.array([link.start]), 0) is None for link in self.links):
            return None
        found = np.zeros((order + 1, len(t), self.columns))
        for at, link in self._shares(t, False):
            if (parts := link.deviations(t[at], order)) is not None:
                found[: len(parts), at] = parts
        return list(found)

    def _shares(self, t: np.ndarray, left: bool) -> Iterator[tuple[np.ndarray, Curve]]:
        """Which of the times each of the curves has."""
        starts = np.array([link.start for link in self.links[1:]])
        which = np.searchsorted(starts, t, side="left" if left else "right")
        for i in np.unique(which):
            yield np.flatnonzero(which == i), self.links[i]

    @keep_by_order
    def jumps(self, order: int) -> list[Jump]:
        """Where a derivative up to `order` jumps: within the curves, and where they meet."""
        found = [jump for link in self.links for jump in link.jumps(order)]
        for a, b in zip(self.links[:-1], self.links[1:], strict=True):
            before, after = a.rates(np.array([a.stop]), order, True), b.rates(np.array([b.start]), order)
            span = max(a.stop - a.start, b.stop - b.start)
            sides = (sample_rates(link, order) for link in (a, b))
            within = [np.concatenate(parts) for parts in zip(*sides, strict=True)]
            found += find_jumps(np.array([b.start]), before, after, np.array([span]), within)
        return sorted(found)


# Breaks that are blended.
@dataclass(frozen=True, eq=False)
class BlendWindows:
    """Where one column is replaced: from `start` to `stop` (m,), by polynomials with these rates (k, m) there."""

    start: np.ndarray
    stop: np.ndarray
    left: np.ndarray
    right: np.ndarray

    def which(self, t: np.ndarray, left: bool) -> tuple[np.ndarray, np.ndarray]:
        """The times that lie in a window, as numbers, and in which each."""
        i = np.searchsorted(self.start, t, side="left" if left else "right") - 1
        stop = self.stop[i.clip(0)]
        at = np.flatnonzero((i >= 0) & ((t <= stop) if left else (t < stop)))
        return at, i[at]

    def outside(self, jumps: Sequence[Jump]) -> list[Jump]:
        """The jumps of the column that lie in no window."""
        replaced, _ = self.which(np.array([jump.t for jump in jumps]), False)
        return [jumps[i] for i in np.setdiff1d(np.arange(len(jumps)), replaced)]

    @cached_property
    def coefficients(self) -> np.ndarray:
        """Those of the polynomials (2 k, 2, m): expanded at the start, and backwards at the stop."""
        left, right, h = [*self.left], [*self.right], self.stop - self.start
        ahead = hermite_coefficients(left, right, h)
        return np.stack([ahead, hermite_coefficients(reversed_rates(right), reversed_rates(left), h)], axis=1)

    def rates(self, t: np.ndarray, i: np.ndarray, order: int) -> list[np.ndarray]:
        """The column at times (N,) in windows i (N,), with derivatives up to `order`."""
        h = self.stop[i] - self.start[i]
        u = (t - self.start[i]) / h
        c = self.coefficients[:, (u > 0.5).astype(int), i, None]
        return [rate[:, 0] for rate in evaluate_nearer(c, h[:, None], u[:, None], order)]


@dataclass(frozen=True, eq=False)
class Blend(DerivedCurve):
    """A curve `base`, of which every column has windows of its own; none where it has no break."""

    windows: tuple[BlendWindows | None, ...]

    def rates(self, t: np.ndarray, order: int, left: bool = False) -> list[np.ndarray]:
        found = [rate.copy() for rate in self.base.rates(t, order, left)]
        for j, windows in enumerate(self.windows):
            if windows is None:
                continue
            at, i = windows.which(t, left)
            if at.size:
                for whole, rate in zip(found, windows.rates(t[at], i, order), strict=True):
                    whole[at, j] = rate
        return found

    @keep_by_order
    def jumps(self, order: int) -> list[Jump]:
        """Where a derivative up to `order` jumps: of the curve outside of all windows, and at their ends."""
        found: list[Jump] = []
        for j, windows in enumerate(self.windows):
            given = [jump for jump in self.base.jumps(order) if jump.column == j]
            found += given if windows is None else windows.outside(given) + self._jumps_at_ends(j, windows, order)
        return sorted(found)

    def _jumps_at_ends(self, j: int, windows: BlendWindows, order: int) -> list[Jump]:
        t = np.concatenate([windows.start, windows.stop])
        before, after = ([rate[:, [j]] for rate in self.rates(t, order, left)] for left in (True, False))
        spans = windows.stop - windows.start
        inside = np.concatenate([windows.start + share * spans for share in INNER_SHARES])
        within = [rate[:, [j]] for rate in self.rates(inside, order)]
        return [jump._replace(column=j) for jump in find_jumps(t, before, after, np.tile(spans, 2), within)]


def blend_curve(base: Curve, time: float, continuity: int, names: Sequence[str]) -> tuple[Blend, np.ndarray]:
    """A curve with polynomials of a duration in place of its breaks, C^continuity, and how far it moves (columns,)."""
    times: list[list[float]] = [[] for _ in names]
    for jump in base.jumps(continuity):
        times[jump.column].append(jump.t)
    windows = []
    for j, (name, of) in enumerate(zip(names, times, strict=True)):
        if of:
            _check_gaps(base, np.unique(of), time, name)
        windows.append(_make_windows(base, j, np.unique(of), time, continuity) if of else None)
    blend = Blend(base, tuple(windows))
    distances = [0.0 if column is None else _measure_distance(blend, column, j) for j, column in enumerate(windows)]
    return blend, np.array(distances)


def _check_gaps(base: Curve, t: np.ndarray, time: float, name: str) -> None:
    """Raise `JounceError` where two blends of a joint would overlap, or one would reach beyond an end of the motion."""
    ends = np.concatenate([[2 * base.start - t[0]], t, [2 * base.stop - t[-1]]])  # at an end half a blend is enough
    gaps = np.diff(ends)
    i = int(gaps.argmin())
    if gaps[i] < time * (1 - 1e-9):
        inner = 0 < i < len(gaps) - 1
        where = f"the breaks at t = {ends[i]:.9g} and {ends[i + 1]:.9g} s" if inner else (
            f"the break at t = {t[0] if i == 0 else t[-1]:.9g} s and the {'start' if i == 0 else 'end'} of the motion"
        )  # fmt: skip
        raise JounceError(
            f"a blend of {time:g} s does not fit between {where}, of {name};"
            f" expected {Remedy('blended(time=...)', '--blend')} of at most {np.floor(gaps[i] * 1e6) / 1e6:g} s"
        )


def _make_windows(base: Curve, j: int, t: np.ndarray, time: float, continuity: int) -> BlendWindows:
    start, stop = np.maximum(t - time / 2, base.start), np.minimum(t + time / 2, base.stop)
    left, right = (
        np.array([rate[:, j] for rate in base.rates(x, continuity, side)]) for x, side in ((start, True), (stop, False))
    )
    return BlendWindows(start, stop, left, right)


def _measure_distance(blend: Blend, windows: BlendWindows, j: int) -> float:
    """The largest distance of a blend from its curve: at the points, and what the curvature allows between them."""
    u = np.linspace(0, 1, BLEND_POINTS)
    t = windows.start[:, None] + (windows.stop - windows.start)[:, None] * u
    rates = zip(blend.rates(t.ravel(), 2), blend.base.rates(t.ravel(), 2), strict=True)
    q, _, q2d = (np.abs(a[:, j] - b[:, j]).max() for a, b in rates)
    return float(q + q2d * (windows.stop - windows.start).max() ** 2 / (BLEND_POINTS - 1) ** 2 / 8)


# Contacts that come and leave.
def make_presence(given: Any, blend: Any, start: float, stop: float) -> tuple[tuple[str, ...], Polynomials | None]:
    """The frames that stances name, and the curve of their presence between two times; every argument is checked."""
    stances = as_list(given)
    for entry in stances:
        if not isinstance(entry, Sequence) or len(entry) != 2 or not is_finite(entry[0]):
            raise JounceError(f"stances holds {quote_value(entry)}; expected pairs (time in s, frames of the contacts)")
    if not stances:
        return (), None
    starts = [float(t) for t, _ in stances]
    if starts[0] > start or starts[-1] >= stop or (np.diff(starts) <= 0).any():
        came = f"stances begin at {join_names(f'{t:.6g}' for t in starts)} s"
        raise JounceError(f"{came}; expected times that increase, from {start:.6g} s on, to before {stop:.6g} s")
    ends = np.array([start, *starts[1:], stop])
    longest = MAX_BLEND_SHARE * float(np.diff(ends).min())
    if not is_finite(blend) or not 0 <= blend <= longest:
        came = f"blend is {quote_value(blend)}"
        raise JounceError(f"{came}; expected 0 to {longest:.6g} s, {MAX_BLEND_SHARE} of the shortest stance")
    frames = tuple(dict.fromkeys(frame for _, names in stances for frame in as_list(names)))
    if odd := [frame for frame in frames if not isinstance(frame, str)]:
        raise JounceError(f"stances hold {quote_value(odd[0])}; expected names of frames of contacts")
    there = np.array([[frame in as_list(names) for frame in frames] for _, names in stances], dtype=bool)
    return frames, _join_stances(ends, there, float(blend))


def _join_stances(ends: np.ndarray, there: np.ndarray, blend: float) -> Polynomials:
    """The presence (frames,) between ends where some are there; in flight there is nothing to blend with."""
    powers = np.arange(len(_STEP))[::-1, None]
    one, rise = 1.0 * (powers == 0), _STEP[:, None] / (blend or 1.0) ** powers
    x, c = [ends[0]], list[np.ndarray]()
    stances = [there[0], *there, there[-1]]
    for i, (first, last) in enumerate(pairwise(ends)):
        before, here, after = stances[i : i + 3]
        comes, leaves = (here & ~other & other.any() for other in (before, after))
        pieces = [one * here - (one - rise) * comes, one * here, one * here - rise * leaves]
        c += pieces if blend else pieces[1:2]
        x += [first + blend, last - blend, last] if blend else [last]
    return Polynomials(np.array(x), np.stack(c, axis=1))
