"""A motion in short pieces, between whose ends the bounded quantities are interpolated: quintic Hermite polynomials.

Breaks of the motion are ends of pieces, with the rates from either side. A piece whose polynomial misses the exact
value near its middle is split there until it does not. A piece has the kinds of limits in whose windows it lies.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from math import comb

import numpy as np

from jounce.limits.bounded import DERIVATIVE, SMOOTH, Bounded, Series, Span
from jounce.limits.ratios import STILL, Scale, scale_of
from jounce.motion.hermite import coefficients

SPLIT = (
    0.45  # of a piece: in its middle a motion from rest to rest agrees with any polynomial, as both are odd about it
)
TOLERANCE = 1e-5  # of the largest value: a polynomial that misses the place of the split by more is not trusted
NEGLIGIBLE = 1e-3  # of a limit: smaller values are compared with that much of it, or their rounding would be followed
NUDGE = 1e-6  # of a piece: values so much earlier and later differ by rounding alone
ROUNDING_MARGIN = 8.0  # times such a difference is rounding too, which splitting does not lessen
DEEPEST = 10  # times that a piece is split
CLOSE = 1e-9  # of the duration: times closer to a break are that break
BLOCK = 8000  # pieces worked on at a time: fewer take most of the time to call NumPy, more do not fit in a cache


@dataclass(frozen=True, eq=False)
class Pieces:
    """Pieces from `start` to `stop` (K,), with the series at both ends, (K, n) each."""

    start: np.ndarray
    stop: np.ndarray
    left: Series
    right: Series

    @property
    def kinds(self) -> tuple[str, ...]:
        """The kinds of limits that they are looked at for."""
        return tuple(self.left)

    @property
    def width(self) -> np.ndarray:
        """How long they last, (K, 1)."""
        return (self.stop - self.start)[:, None]

    def taken(self, which: np.ndarray) -> "Pieces":
        """Some of the pieces."""
        left, right = (
            {kind: [x[which] for x in series] for kind, series in side.items()} for side in (self.left, self.right)
        )
        return Pieces(self.start[which], self.stop[which], left, right)

    def polynomials(self, kind: str) -> np.ndarray:
        """Coefficients (degree + 1, K, n), highest power of u = (t - start) / width first, of what a limit bounds."""
        c = coefficients(self.left[kind], self.right[kind], self.width)
        for _ in range(DERIVATIVE.get(kind, 0)):
            c = c[:-1] * np.arange(len(c) - 1, 0, -1)[:, None, None] / self.width
        return c

    def values(self, kind: str) -> tuple[np.ndarray, np.ndarray]:
        """What a limit bounds at both ends, (K, n) each."""
        k = DERIVATIVE.get(kind, 0)
        return self.left[kind][k], self.right[kind][k]


def parts_of(b: Bounded) -> list[tuple[Bounded, Span]]:
    """The motion between the ends of windows, with the kinds that are known well there."""
    edges = np.unique([b.whole, *map(b.window, b.kinds)])
    spans = [(float(a), float(z)) for a, z in pairwise(edges)] or [b.whole]
    parts = [
        (
            b.of_kinds([kind for kind in b.kinds if b.window(kind)[0] <= start and stop <= b.window(kind)[1]]),
            (start, stop),
        )
        for start, stop in spans
    ]
    return [(part, span) for part, span in parts if part.kinds]


def pieces_of(b: Bounded) -> Iterator[Pieces]:
    """The pieces of a motion, in the order of time, some at a time."""
    for part, span in parts_of(b):
        yield from part_pieces(part, span)


def part_pieces(b: Bounded, span: Span) -> Iterator[Pieces]:
    """The pieces of a part of a motion."""
    knots, is_break = knots_of(b, span)
    if len(knots) == 1:  # a motion of one state
        state = b.series(knots)
        yield Pieces(knots, knots, state, state)
    for first in range(0, len(knots) - 1, BLOCK):
        t, jumps = knots[first : first + BLOCK + 1], is_break[first : first + BLOCK + 1]
        right = b.series(t)
        left = b.series(t[jumps], "left") if jumps.any() else {}
        ends = {kind: [x.copy() for x in series] for kind, series in right.items()}
        for kind, series in left.items():
            for whole, part in zip(ends[kind], series, strict=True):
                whole[jumps] = part
        starts = {kind: [x[:-1] for x in series] for kind, series in right.items()}
        stops = {kind: [x[1:] for x in series] for kind, series in ends.items()}
        yield _split(b, Pieces(t[:-1], t[1:], starts, stops))


def knots_of(b: Bounded, span: Span) -> tuple[np.ndarray, np.ndarray]:
    """The times of a motion and of its breaks in a span, with its ends, and which of them are breaks."""
    motion, order, (start, stop) = b.motion, b.rate_order, span
    breaks = [found.t for found in motion.breaks_to(order)]
    for curve in motion.loads.values():
        known = curve.highest
        breaks += [jump.t for jump in curve.jumps(SMOOTH if known is None else min(SMOOTH, known))]
    jumps = np.unique([t for t in breaks if start < t <= stop])
    every = np.unique([start, *motion.times[(motion.times > start) & (motion.times < stop)], stop])
    if not jumps.size:
        return every, np.zeros(len(every), dtype=bool)
    apart = np.abs(every - jumps[np.abs(np.searchsorted(jumps, every)).clip(0, len(jumps) - 1)])
    before = np.abs(every - jumps[(np.searchsorted(jumps, every) - 1).clip(0)])
    kept = every[np.minimum(apart, before) > CLOSE * motion.duration]
    knots = np.unique(np.concatenate([[start], kept, jumps, [stop]]))
    return knots, np.isin(knots, jumps)


def _split(b: Bounded, pieces: Pieces) -> Pieces:
    """Every piece in two, and those again that their polynomials do not describe."""
    least = {kind: _negligible(scale_of(b.limits.bounds(kind), kind)) for kind in b.kinds}
    scales = {kind: np.maximum(*(np.abs(x).max(axis=0) for x in pieces.values(kind))) for kind in b.kinds}
    scales = {kind: np.maximum(scale, least[kind]) for kind, scale in scales.items()}
    done: list[Pieces] = []
    for _ in range(DEEPEST):
        middle = pieces.start + SPLIT * (pieces.stop - pieces.start)
        divisible = (pieces.start < middle) & (middle < pieces.stop)  # stamps since 1970 step by 2.4e-7 s
        done.append(pieces.taken(~divisible))
        pieces, middle = pieces.taken(divisible), middle[divisible]
        if not middle.size:
            break
        exact, wrong = b.series(middle), np.zeros(len(middle), dtype=bool)
        u = (middle - pieces.start)[:, None] / pieces.width
        rounded = 16 * np.spacing(np.abs(middle))[:, None] / pieces.width  # much where stamps are those since 1970
        missed = {}
        for kind in b.kinds:
            c, value = pieces.polynomials(kind), exact[kind][DERIVATIVE.get(kind, 0)]
            scales[kind] = np.maximum(scales[kind], np.abs(value).max(axis=0))
            missed[kind] = np.abs(_at(c, u) - value) - (TOLERANCE + rounded) * scales[kind]
            wrong |= (missed[kind] > 0).any(axis=1)
        if wrong.any():
            rounding = _rounding(b, middle[wrong], pieces.width[wrong, 0])
            beyond = [(missed[kind][wrong] > ROUNDING_MARGIN * rounding[kind]).any(axis=1) for kind in b.kinds]
            wrong[wrong] = np.any(beyond, axis=0)
        first = Pieces(pieces.start, middle, pieces.left, exact)
        second = Pieces(middle, pieces.stop, exact, pieces.right)
        done += [first.taken(~wrong), second.taken(~wrong)]
        pieces = _joined([first.taken(wrong), second.taken(wrong)])
        if not wrong.any():
            break
    return _joined([*done, pieces])


def _negligible(scale: Scale) -> np.ndarray:
    """The values (n,) of which polynomials need no digits; infinite where nothing is bounded."""
    reach = np.minimum(*(np.abs(bound - scale.centre) for bound in (scale.lower, scale.upper)))
    return np.maximum(NEGLIGIBLE * reach, STILL / TOLERANCE)


def _rounding(b: Bounded, t: np.ndarray, width: np.ndarray) -> dict[str, np.ndarray]:
    """By how much values (N, n) differ from those at times that are as good as the same."""
    step = np.maximum(NUDGE * width, 2 * np.spacing(np.abs(t)))
    at, early, late = (b.values(t + sign * step) for sign in (0, -1, 1))
    return {kind: np.maximum(np.abs(early[kind] - x), np.abs(late[kind] - x)) for kind, x in at.items()}


def _joined(parts: list[Pieces]) -> Pieces:
    """Pieces of several lists as one, in the order of time."""
    order = np.argsort(np.concatenate([part.start for part in parts]), kind="stable")
    left, right = (
        {
            kind: [np.concatenate(x)[order] for x in zip(*(getattr(part, side)[kind] for part in parts), strict=True)]
            for kind in parts[0].left
        }
        for side in ("left", "right")
    )
    start, stop = (np.concatenate([getattr(part, name) for part in parts])[order] for name in ("start", "stop"))
    return Pieces(start, stop, left, right)


def _at(c: np.ndarray, u: np.ndarray) -> np.ndarray:
    """The values of polynomials at a u of each piece, (K, 1)."""
    value = c[0]
    for coefficient in c[1:]:
        value = value * u + coefficient
    return value


def hull(c: np.ndarray) -> np.ndarray:
    """Bernstein coefficients, whose extremes bound the polynomials on their pieces."""
    degree = len(c) - 1
    powers = c[::-1]
    matrix = np.array([[comb(j, k) / comb(degree, k) for k in range(degree + 1)] for j in range(degree + 1)])
    return np.einsum("jk,k...->j...", matrix, powers)
