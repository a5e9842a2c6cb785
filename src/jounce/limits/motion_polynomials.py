"""A motion in short pieces, on each of which the bounded quantities are polynomials.

Breaks of the motion are ends of pieces. Between two times of a motion the polynomials are those of the rates at both
ends, quintic where two are known. Where they miss the exact value near the middle, or no rate is known, polynomials go
through exact values at Chebyshev-Lobatto points (L. N. Trefethen, Approximation Theory and Approximation Practice,
2013), and a piece is split until they agree to `PIECE_TOLERANCE` or to the rounding of the values. Pieces that still
disagree after the last split keep how much they miss, which a check reports. A piece has the kinds of limits in whose
windows it lies.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from math import comb

import numpy as np
from numpy.polynomial.polynomial import polyval

from jounce.limits.drive_terms import acting_friction
from jounce.limits.limited_motion import HERMITE_DERIVATIVES, LimitedMotion
from jounce.limits.ratios import SIGNS, ZERO_BOUND_TOLERANCE, Scale
from jounce.model.limits import LIMIT_KINDS
from jounce.model.transmissions import with_followers
from jounce.motion import hermite
from jounce.motion.channel import Channel, Span

# Of a piece: in its middle a motion from rest to rest agrees with any polynomial, as both are odd about it.
_SPLIT_SHARE = 0.45
_HERMITE_TOLERANCE = 1e-5  # of the largest value, at the split: the halves miss less than a tenth of it
PIECE_TOLERANCE = 1e-6  # of the largest value: what polynomials may miss inside their piece
_LOBATTO_DEGREE = 7  # of polynomials through values: that of q2d between rows that state q to q4d
_LOBATTO_NODES = (1 - np.cos(np.pi * np.arange(_LOBATTO_DEGREE + 1) / _LOBATTO_DEGREE)) / 2  # shares of a piece
_LOBATTO_TO_POWERS = np.linalg.inv(np.vander(_LOBATTO_NODES))  # from values to coefficients, highest power first
MIN_SHARE_OF_LIMIT = 1e-3  # smaller values are compared with that much of the limit, else rounding would be followed
_ROUNDING_PROBE = 1e-6  # of a piece: values so much earlier and later differ by rounding alone
_ROUNDING_FACTOR = 8.0  # times such a difference is rounding too, which splitting does not lessen
_MAX_PIECE_SPLITS = 10  # of a piece, to a thousandth: what is not resolved then is reported
_BREAK_TIME_TOLERANCE = 1e-9  # of the duration: times closer to a break are that break
_PIECES_PER_BLOCK = 8000  # worked on together: fewer take most of the time to call NumPy, more leave the cache

Values = Mapping[str, np.ndarray]  # by kind, (K, n)
Channels = Mapping[str, Channel]  # by kind


@dataclass(frozen=True, eq=False)
class Pieces:
    """Pieces from `start` to `stop` (K,), with what limits bound at both ends, (K, n) each, and in between.

    `polynomials` are the coefficients (degree + 1, K, n), highest power of u = (t - start) / width first. `missed` is
    by how much they miss a value inside, (K, n), where a piece may not be split once more; elsewhere 0.
    """

    start: np.ndarray
    stop: np.ndarray
    left: Values
    right: Values
    polynomials: Values
    missed: Values

    @property
    def kinds(self) -> tuple[str, ...]:
        """The kinds of limits whose values they have."""
        return tuple(self.left)

    @property
    def width(self) -> np.ndarray:
        """How long they last, (K, 1)."""
        return (self.stop - self.start)[:, None]

    def select(self, which: np.ndarray) -> "Pieces":
        """Some of the pieces."""
        left, right, missed = (
            {kind: x[which] for kind, x in values.items()} for values in (self.left, self.right, self.missed)
        )
        polynomials = {kind: c[:, which] for kind, c in self.polynomials.items()}
        return Pieces(self.start[which], self.stop[which], left, right, polynomials, missed)


def split_windows(b: LimitedMotion) -> Iterator[tuple[LimitedMotion, Span]]:
    """The motion between the ends of windows, with the kinds that are known well there."""
    edges = np.unique([b.whole, *map(b.window, b.kinds)])
    for start, stop in pairwise(edges.tolist()) if len(edges) > 1 else [b.whole]:
        known = [kind for kind in b.kinds if b.window(kind)[0] <= start and stop <= b.window(kind)[1]]
        if known:
            yield b.select_kinds(known), (start, stop)


def split_motion(b: LimitedMotion) -> Iterator[Pieces]:
    """The pieces of a motion, in the order of time, some at a time."""
    for part, span in split_windows(b):
        yield from split_part(part, span)


def split_part(b: LimitedMotion, span: Span) -> Iterator[Pieces]:
    """The pieces of a part of a motion."""
    knots, is_break = collect_knots(b, span)
    if len(knots) == 1:  # a motion of one state
        state = b.values(knots)
        yield Pieces(knots, knots, state, state, {}, {})
    for first in range(0, len(knots) - 1, _PIECES_PER_BLOCK):
        t, jumps = knots[first : first + _PIECES_PER_BLOCK + 1], is_break[first : first + _PIECES_PER_BLOCK + 1]
        right = b.channels(t)
        # Before a switch of contacts, whose time is known to ten digits of forces, rates are those a little earlier.
        early = np.isin(t[jumps], b.switches) * PIECE_TOLERANCE * b.motion.duration
        left = b.channels(t[jumps] - early, "left") if jumps.any() else {}
        ends = right | {kind: _put_rows(right[kind], jumps, channel) for kind, channel in left.items()}
        starts = {kind: channel.rows(slice(-1)) for kind, channel in right.items()}
        stops = {kind: channel.rows(slice(1, None)) for kind, channel in ends.items()}
        yield _interpolate_pieces(b, t, starts, stops)


def _put_rows(channel: Channel, which: np.ndarray, rows: Channel) -> Channel:
    """A channel with the values of another one in some of its rows."""
    rates = tuple(x.copy() for x in channel.rates)
    for whole, part in zip(rates, rows.rates, strict=True):
        whole[which] = part
    return replace(channel, rates=rates)


def collect_knots(b: LimitedMotion, span: Span) -> tuple[np.ndarray, np.ndarray]:
    """The times of a motion and of its breaks in a span, with its ends, and which of them are breaks."""
    motion, (start, stop) = b.motion, span
    breaks = [*b.switches, *(found.t for found in motion.breaks_to(b.rate_order))]
    for curve in motion.loads.values():
        order = HERMITE_DERIVATIVES if curve.highest is None else min(HERMITE_DERIVATIVES, curve.highest)
        breaks += [jump.t for jump in curve.jumps(order)]
    jumps = np.unique([t for t in breaks if start < t <= stop])
    every = np.unique([start, *motion.times[(motion.times > start) & (motion.times < stop)], stop])
    m = b.robot.mechanism
    if b.forces and (friction := acting_friction(with_followers(m))) and not m.takes_dependent:
        every = np.union1d(every, friction.reversals(motion, every))
    if not jumps.size:
        return every, np.zeros(len(every), dtype=bool)
    apart = np.abs(every - jumps[np.abs(np.searchsorted(jumps, every)).clip(0, len(jumps) - 1)])
    before = np.abs(every - jumps[(np.searchsorted(jumps, every) - 1).clip(0)])
    kept = every[np.minimum(apart, before) > _BREAK_TIME_TOLERANCE * motion.duration]
    knots = np.unique(np.concatenate([[start], kept, jumps, [stop]]))
    return knots, np.isin(knots, jumps)


def _interpolate_pieces(b: LimitedMotion, t: np.ndarray, left: Channels, right: Channels) -> Pieces:
    """Pieces between times (K + 1,) with what is bounded at both ends: in two, or through values inside."""
    start, stop = t[:-1], t[1:]
    middle = start + _SPLIT_SHARE * (stop - start)
    exact = b.channels(middle)
    whole, *halves = (
        _fit_rates(*ends)
        for ends in ((start, stop, left, right), (start, middle, left, exact), (middle, stop, exact, right))
    )
    scales = {
        kind: np.maximum(_negligible_values(b.scales[kind]), np.abs([*ends]).max(axis=(0, 1)))
        for kind, ends in ((kind, (whole.left[kind], whole.right[kind], halves[0].right[kind])) for kind in b.kinds)
    }
    missed = _measure_errors(whole, middle, halves[0].right)
    wrong = np.any([(missed[kind] > _HERMITE_TOLERANCE * scales[kind]).any(axis=1) for kind in b.kinds], axis=0)
    wrong |= any(len(channel.rates) == 1 for channel in left.values())
    divisible = (start < middle) & (middle < stop)  # stamps since 1970 step by 2.4e-7 s
    good = [half.select(divisible & ~wrong) for half in halves]
    return _join_pieces([whole.select(~divisible), *good, *_fit_values(b, whole.select(divisible & wrong), scales)])


def _fit_rates(start: np.ndarray, stop: np.ndarray, left: Channels, right: Channels) -> Pieces:
    """Pieces whose polynomials have the rates at both ends."""
    found, width = {}, (stop - start)[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):  # no time between two neighbouring doubles
        for kind in left:
            c = hermite.hermite_coefficients(left[kind].rates, right[kind].rates, width)
            for _ in range(LIMIT_KINDS[kind].derivative):
                c = c[:-1] * np.arange(len(c) - 1, 0, -1)[:, None, None] / width
            found[kind] = c
    first, last = (
        {kind: channel.rates[LIMIT_KINDS[kind].derivative] for kind, channel in side.items()} for side in (left, right)
    )
    return Pieces(start, stop, first, last, found, {kind: np.zeros_like(x) for kind, x in first.items()})


def _fit_values(b: LimitedMotion, pieces: Pieces, scales: Values) -> Iterator[Pieces]:
    """Pieces with polynomials through exact values inside, split where these miss another one."""
    for depth in range(_MAX_PIECE_SPLITS if len(pieces.start) else 0):
        middle = pieces.start + _SPLIT_SHARE * (pieces.stop - pieces.start)
        inner = pieces.start[:, None] + _LOBATTO_NODES[1:-1] * pieces.width
        inner = np.minimum(inner, np.nextafter(pieces.stop, pieces.start)[:, None])  # at a break another one begins
        count = len(middle)
        # Interpolate exact values inside, and test the polynomials at another one.
        values = b.values(np.concatenate([middle, inner.T.ravel()]))
        exact, nodes = ({kind: x[part] for kind, x in values.items()} for part in (slice(count), slice(count, None)))
        polynomials = {}
        for kind in b.kinds:
            left, right, between = (
                pieces.left[kind],
                pieces.right[kind],
                nodes[kind].reshape(_LOBATTO_DEGREE - 1, count, -1),
            )
            polynomials[kind] = np.einsum("ij,jkn->ikn", _LOBATTO_TO_POWERS, np.stack([left, *between, right]))
        pieces = replace(pieces, polynomials=polynomials)
        missed = _measure_errors(pieces, middle, exact)
        rounded = 16 * np.spacing(np.abs(middle))[:, None] / pieces.width  # much where stamps are those since 1970
        beyond = {kind: missed[kind] - (PIECE_TOLERANCE + rounded) * scales[kind] for kind in b.kinds}
        wrong = np.any([(x > 0).any(axis=1) for x in beyond.values()], axis=0)
        if wrong.any():  # differences of rounding are not followed
            rounding = _estimate_rounding(b, middle[wrong], pieces.width[wrong, 0])
            wrong[wrong] = np.any(
                [(beyond[kind][wrong] > _ROUNDING_FACTOR * rounding[kind]).any(axis=1) for kind in b.kinds], axis=0
            )
        # Pieces that agree are done; the others are split, as long as there is a time between their ends.
        wrong &= (pieces.start < middle) & (middle < pieces.stop)
        yield pieces.select(~wrong)
        if not wrong.any():
            break
        if depth + 1 == _MAX_PIECE_SPLITS:
            yield replace(pieces, missed=missed).select(wrong)
            break
        first = replace(pieces, stop=middle, right=exact)
        second = replace(pieces, start=middle, left=exact)
        pieces = _join_pieces([first.select(wrong), second.select(wrong)])


def _measure_errors(pieces: Pieces, t: np.ndarray, values: Values) -> dict[str, np.ndarray]:
    """By how much polynomials miss values at a time t of each piece, (K, n)."""
    with np.errstate(divide="ignore", invalid="ignore"):
        u = (t - pieces.start)[:, None] / pieces.width
        return {kind: np.abs(evaluate_polynomials(c, u) - values[kind]) for kind, c in pieces.polynomials.items()}


def _negligible_values(scale: Scale) -> np.ndarray:
    """The values (n,) too small to need digits; infinite where nothing is bounded."""
    reach = np.minimum(*(np.abs(scale.reach(sign)) for sign in SIGNS))
    return np.where(reach > 0, MIN_SHARE_OF_LIMIT * reach, ZERO_BOUND_TOLERANCE / _HERMITE_TOLERANCE)


def _estimate_rounding(b: LimitedMotion, t: np.ndarray, width: np.ndarray) -> dict[str, np.ndarray]:
    """By how much values (N, n) differ from those at times that are nearly the same: their rounding."""
    step = np.maximum(_ROUNDING_PROBE * width, 2 * np.spacing(np.abs(t)))
    at, early, late = (b.values(t + sign * step) for sign in (0, -1, 1))
    return {kind: np.maximum(np.abs(early[kind] - x), np.abs(late[kind] - x)) for kind, x in at.items()}


def _join_pieces(parts: list[Pieces]) -> Pieces:
    """Pieces of several lists as one, in the order of time."""
    start, stop = (np.concatenate([getattr(part, name) for part in parts]) for name in ("start", "stop"))
    left, right, missed = (
        {kind: np.concatenate([getattr(part, values)[kind] for part in parts]) for kind in parts[0].kinds}
        for values in ("left", "right", "missed")
    )
    polynomials = {}
    for kind in parts[0].kinds:
        found = [part.polynomials[kind] for part in parts if len(part.start)]
        degree = max(map(len, found))
        polynomials[kind] = np.concatenate([np.pad(c, ((degree - len(c), 0), (0, 0), (0, 0))) for c in found], axis=1)
    return Pieces(start, stop, left, right, polynomials, missed).select(np.argsort(start, kind="stable"))


def evaluate_polynomials(c: np.ndarray, u: np.ndarray) -> np.ndarray:
    """The values of polynomials with coefficients (degree + 1, ...), highest power first, at u that broadcast."""
    return np.asarray(polyval(u, c[::-1], tensor=False))


def bernstein_coefficients(c: np.ndarray) -> np.ndarray:
    """Bernstein coefficients, whose extremes bound the polynomials on their pieces."""
    degree = len(c) - 1
    powers = c[::-1]
    matrix = np.array([[comb(j, k) / comb(degree, k) for k in range(degree + 1)] for j in range(degree + 1)])
    return np.einsum("jk,k...->j...", matrix, powers)
