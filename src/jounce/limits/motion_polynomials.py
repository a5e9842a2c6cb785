"""Split a motion into short pieces, with polynomials on each.

They are those of the bounded quantities. Breaks of the motion are ends of pieces. Between two times of a motion the
polynomials are those of the rates at both ends, quintic where two are known. Where they miss the exact value near the
middle, or no rate is known, polynomials go through exact values at Chebyshev-Lobatto points (L. N. Trefethen,
Approximation Theory and Approximation Practice, 2013), and a piece is split until they agree to `PIECE_TOLERANCE` or to
the rounding of the values. Pieces that still disagree after the last split keep how much they miss, which a check
reports. A piece has the kinds of limits in whose windows it lies.
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
    """Pieces of a motion, with what limits bound on each.

    They last from `start` to `stop` (K,); `left` and `right` are the values at both ends, (K, n) each.

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
        """Return the kinds of limits whose values the pieces have."""
        return tuple(self.left)

    @property
    def width(self) -> np.ndarray:
        """Return how long the pieces last, (K, 1)."""
        return (self.stop - self.start)[:, None]

    def select(self, which: np.ndarray) -> "Pieces":
        """Return some of the pieces."""
        left, right, missed = (
            {kind: x[which] for kind, x in values.items()} for values in (self.left, self.right, self.missed)
        )
        polynomials = {kind: c[:, which] for kind, c in self.polynomials.items()}
        return Pieces(self.start[which], self.stop[which], left, right, polynomials, missed)


def split_windows(b: LimitedMotion) -> Iterator[tuple[LimitedMotion, Span]]:
    """Yield the motion between the ends of windows.

    Each part has the kinds that are known well there.
    """
    edges = np.unique([b.whole, *map(b.window, b.kinds)])
    spans = [*pairwise(edges.tolist())] if len(edges) > 1 else [b.whole]
    for start, stop in spans:
        known = [kind for kind in b.kinds if b.window(kind)[0] <= start and stop <= b.window(kind)[1]]
        if len(known) > 0:
            yield b.select_kinds(known), (start, stop)


def split_motion(b: LimitedMotion) -> Iterator[Pieces]:
    """Yield the pieces of a motion, in blocks.

    Pieces are in the order of time.
    """
    for part, span in split_windows(b):
        yield from split_part(part, span)


def split_part(b: LimitedMotion, span: Span) -> Iterator[Pieces]:
    """Yield the pieces of a part of a motion, in blocks."""
    knots, is_break = collect_knots(b, span)
    # A motion of one state is one piece of no width, without anything in between.
    if len(knots) == 1:
        state = b.values(knots)
        yield Pieces(knots, knots, state, state, {}, {})
    for first in range(0, len(knots) - 1, _PIECES_PER_BLOCK):
        block = slice(first, first + _PIECES_PER_BLOCK + 1)
        t, jumps = knots[block], is_break[block]
        right = b.channels(t)
        # Before a switch of contacts, whose time is known to ten digits of forces, rates are those a little earlier.
        early = np.isin(t[jumps], b.switches) * PIECE_TOLERANCE * b.motion.duration
        left = b.channels(t[jumps] - early, "left") if jumps.any() else {}
        # A piece begins with what begins at its start, and ends with what ends at its stop: they differ at breaks.
        ends = right | {kind: _put_rows(right[kind], jumps, channel) for kind, channel in left.items()}
        starts = {kind: channel.rows(slice(-1)) for kind, channel in right.items()}
        stops = {kind: channel.rows(slice(1, None)) for kind, channel in ends.items()}
        yield _interpolate_pieces(b, t, starts, stops)


def _put_rows(channel: Channel, which: np.ndarray, rows: Channel) -> Channel:
    """Return a channel with some rows of another one."""
    rates = tuple(x.copy() for x in channel.rates)
    for all_rows, some_rows in zip(rates, rows.rates, strict=True):
        all_rows[which] = some_rows
    return replace(channel, rates=rates)


def collect_knots(b: LimitedMotion, span: Span) -> tuple[np.ndarray, np.ndarray]:
    """Collect the times at which pieces of a span begin and end.

    The times are those of the motion and of its breaks, and the ends of the span. The second array says which of them
    are breaks.
    """
    motion, (start, stop) = b.motion, span
    breaks = [*b.switches, *(motion_break.t for motion_break in motion.breaks_to(b.rate_order))]
    for curve in motion.loads.values():
        order = HERMITE_DERIVATIVES if curve.highest is None else min(HERMITE_DERIVATIVES, curve.highest)
        breaks += [jump.t for jump in curve.jumps(order)]
    jumps = np.unique([t for t in breaks if start < t <= stop])
    times = np.unique([start, *motion.times[(motion.times > start) & (motion.times < stop)], stop])
    # Where a joint turns round, friction changes within moments: pieces become short there.
    m = b.robot.mechanism
    friction = acting_friction(with_followers(m)) if b.forces else None
    if friction is not None and not m.takes_dependent and m.has_constant_ratios:
        times = np.union1d(times, friction.reversals(motion, times))
    if jumps.size == 0:
        return times, np.zeros(len(times), dtype=bool)
    # Times closer to a break than rounding are that break: drop them, by the distance to the breaks on both sides.
    following = np.searchsorted(jumps, times)
    after = np.abs(times - jumps[following.clip(0, len(jumps) - 1)])
    before = np.abs(times - jumps[(following - 1).clip(0)])
    distinct = times[np.minimum(after, before) > _BREAK_TIME_TOLERANCE * motion.duration]
    knots = np.unique(np.concatenate([[start], distinct, jumps, [stop]]))
    return knots, np.isin(knots, jumps)


def _interpolate_pieces(b: LimitedMotion, t: np.ndarray, left: Channels, right: Channels) -> Pieces:
    """Interpolate between times (K + 1,): by rates at the ends, or through values inside.

    `left` and `right` are the channels at the starts and at the ends of the pieces.
    """
    # The polynomial of a whole piece is tested near its middle. If it is right, those of both halves are better still.
    start, stop = t[:-1], t[1:]
    middle = start + _SPLIT_SHARE * (stop - start)
    exact = b.channels(middle)
    whole = _fit_rates(start, stop, left, right)
    first, second = _fit_rates(start, middle, left, exact), _fit_rates(middle, stop, exact, right)
    # The size of values to which tolerances are relative, (n,) by kind: the largest one, or a share of the limit.
    scales = {}
    for kind in b.kinds:
        ends = whole.left[kind], whole.right[kind], first.right[kind]
        scales[kind] = np.maximum(_negligible_values(b.scales[kind]), np.abs([*ends]).max(axis=(0, 1)))
    missed = _measure_errors(whole, middle, first.right)
    wrong = np.any([(missed[kind] > _HERMITE_TOLERANCE * scales[kind]).any(axis=1) for kind in b.kinds], axis=0)
    # Without any rate polynomials are chords, whose test proves nothing.
    wrong |= any(len(channel.rates) == 1 for channel in left.values())
    # Stamps since 1970 step by 2.4e-7 s: there may be no time between two of them.
    divisible = (start < middle) & (middle < stop)
    good = [half.select(divisible & ~wrong) for half in (first, second)]
    refitted = _fit_values(b, whole.select(divisible & wrong), scales)
    return _join_pieces([whole.select(~divisible), *good, *refitted])


def _fit_rates(start: np.ndarray, stop: np.ndarray, left: Channels, right: Channels) -> Pieces:
    """Fit polynomials to the rates at both ends of pieces."""
    polynomials, width = {}, (stop - start)[:, None]
    # Between two neighbouring doubles there is no time: width may be 0.
    with np.errstate(divide="ignore", invalid="ignore"):
        for kind in left:
            c = hermite.hermite_coefficients(left[kind].rates, right[kind].rates, width)
            # A kind bounds a derivative of its channel: differentiate by t = start + width u.
            for _ in range(LIMIT_KINDS[kind].derivative):
                c = c[:-1] * np.arange(len(c) - 1, 0, -1)[:, None, None] / width
            polynomials[kind] = c
    first, last = (
        {kind: channel.rates[LIMIT_KINDS[kind].derivative] for kind, channel in side.items()} for side in (left, right)
    )
    return Pieces(start, stop, first, last, polynomials, {kind: np.zeros_like(x) for kind, x in first.items()})


def _fit_values(b: LimitedMotion, pieces: Pieces, scales: Values) -> Iterator[Pieces]:
    """Fit polynomials through exact values inside of pieces.

    Pieces are yielded as their polynomials agree with another exact value. The others are split once more in each
    round.
    """
    for depth in range(_MAX_PIECE_SPLITS if len(pieces.start) > 0 else 0):
        middle = pieces.start + _SPLIT_SHARE * (pieces.stop - pieces.start)
        # Nodes inside, (K, degree - 1); not the end of a piece, where at a break another one begins.
        nodes = pieces.start[:, None] + _LOBATTO_NODES[1:-1] * pieces.width
        nodes = np.minimum(nodes, np.nextafter(pieces.stop, pieces.start)[:, None])
        count = len(middle)
        # Interpolate exact values inside, and test the polynomials at another one.
        values = b.values(np.concatenate([middle, nodes.T.ravel()]))
        exact, at_nodes = ({kind: x[part] for kind, x in values.items()} for part in (slice(count), slice(count, None)))
        polynomials = {}
        for kind in b.kinds:
            # Values at all nodes in their order, (degree + 1, K, n) -> coefficients of the same shape.
            inside = at_nodes[kind].reshape(_LOBATTO_DEGREE - 1, count, -1)
            all_values = np.stack([pieces.left[kind], *inside, pieces.right[kind]])
            polynomials[kind] = np.einsum("ij,jkn->ikn", _LOBATTO_TO_POWERS, all_values)
        pieces = replace(pieces, polynomials=polynomials)
        missed = _measure_errors(pieces, middle, exact)
        # Rounding of times makes values wrong too, much where stamps are those since 1970.
        rounded = 16 * np.spacing(np.abs(middle))[:, None] / pieces.width
        beyond = {kind: missed[kind] - (PIECE_TOLERANCE + rounded) * scales[kind] for kind in b.kinds}
        wrong = np.any([(x > 0).any(axis=1) for x in beyond.values()], axis=0)
        if wrong.any():
            # Splitting does not lessen rounding of values: differences of its size are not followed.
            rounding = _estimate_rounding(b, middle[wrong], pieces.width[wrong, 0])
            wrong[wrong] = np.any(
                [(beyond[kind][wrong] > _ROUNDING_FACTOR * rounding[kind]).any(axis=1) for kind in b.kinds], axis=0
            )
        # Pieces that agree are done; the others are split, as long as there is a time between their ends.
        wrong &= (pieces.start < middle) & (middle < pieces.stop)
        yield pieces.select(~wrong)
        if not wrong.any():
            break
        # After the last split pieces keep how much they miss.
        if depth + 1 == _MAX_PIECE_SPLITS:
            yield replace(pieces, missed=missed).select(wrong)
            break
        first = replace(pieces, stop=middle, right=exact)
        second = replace(pieces, start=middle, left=exact)
        pieces = _join_pieces([first.select(wrong), second.select(wrong)])


def _measure_errors(pieces: Pieces, t: np.ndarray, values: Values) -> dict[str, np.ndarray]:
    """Measure by how much polynomials miss values, (K, n).

    The values are at a time t of each piece.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        u = (t - pieces.start)[:, None] / pieces.width
        return {kind: np.abs(evaluate_polynomials(c, u) - values[kind]) for kind, c in pieces.polynomials.items()}


def _negligible_values(scale: Scale) -> np.ndarray:
    """Return the values (n,) too small to need digits.

    The values are infinite where nothing is bounded.
    """
    reach = np.minimum(*(np.abs(scale.reach(sign)) for sign in SIGNS))
    return np.where(reach > 0, MIN_SHARE_OF_LIMIT * reach, ZERO_BOUND_TOLERANCE / _HERMITE_TOLERANCE)


def _estimate_rounding(b: LimitedMotion, t: np.ndarray, width: np.ndarray) -> dict[str, np.ndarray]:
    """Estimate the rounding of values (N, n) at times (N,).

    It is how much they differ from values at times that are nearly the same.
    """
    step = np.maximum(_ROUNDING_PROBE * width, 2 * np.spacing(np.abs(t)))
    now, early, late = (b.values(t + sign * step) for sign in (0, -1, 1))
    return {kind: np.maximum(np.abs(early[kind] - x), np.abs(late[kind] - x)) for kind, x in now.items()}


def _join_pieces(parts: list[Pieces]) -> Pieces:
    """Join the pieces of several lists, in the order of time."""
    start, stop = (np.concatenate([getattr(part, name) for part in parts]) for name in ("start", "stop"))
    left, right, missed = (
        {kind: np.concatenate([getattr(part, values)[kind] for part in parts]) for kind in parts[0].kinds}
        for values in ("left", "right", "missed")
    )
    polynomials = {}
    for kind in parts[0].kinds:
        parts_of_kind = [part.polynomials[kind] for part in parts if len(part.start) > 0]
        # Polynomials of lower degree get zeros for their highest powers, which stand first.
        degree = max(map(len, parts_of_kind))
        padded = [np.pad(c, ((degree - len(c), 0), (0, 0), (0, 0))) for c in parts_of_kind]
        polynomials[kind] = np.concatenate(padded, axis=1)
    return Pieces(start, stop, left, right, polynomials, missed).select(np.argsort(start, kind="stable"))


def evaluate_polynomials(c: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Evaluate polynomials at u.

    Coefficients are (degree + 1, ...), highest power first; u broadcasts with one of them.
    """
    return np.asarray(polyval(u, c[::-1], tensor=False))


def bernstein_coefficients(c: np.ndarray) -> np.ndarray:
    """Return Bernstein coefficients, whose extremes bound the polynomials on their pieces."""
    degree = len(c) - 1
    powers = c[::-1]
    # u^k is the sum over j of comb(j, k) / comb(degree, k) times the j-th Bernstein polynomial.
    matrix = np.array([[comb(j, k) / comb(degree, k) for k in range(degree + 1)] for j in range(degree + 1)])
    return np.einsum("jk,k...->j...", matrix, powers)
