"""Curves made of curves: at another pace, a part of one, one after the other."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from jounce.motion.curves import Curve, DerivedCurve, Jump, find_jumps, keep_by_order, sample_rates


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
