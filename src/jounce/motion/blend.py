"""Blends: a curve whose breaks are replaced by polynomials that continue it smoothly on both sides, joint by joint."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from jounce.core.cures import Remedy
from jounce.core.errors import JounceError
from jounce.motion.curves import INNER_SHARES, Curve, DerivedCurve, Jump, find_jumps, keep_by_order
from jounce.motion.hermite import evaluate_nearer, hermite_coefficients, reversed_rates

BLEND_POINTS = 257  # at which its distance from the curve is measured; odd: the break is one of them


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
