"""`Worst` gathers the worst value of every limit along a motion, and when limits are broken.

Exact motions: `Worst.take` takes in pieces of the motion one after the other. Values at their ends count first, then
peaks between them (`find_peaks`), and then the times at which values pass their bounds, which are zeros of the exact
values. A rate that jumps makes those above it infinite (`take_jumps`).

Peaks: polynomials whose Bernstein coefficients stay below a floor have no peak above it (the convex hull property [1]),
which discards most of them. On the others a change of sign of the slope between even samples brackets a peak, unless
the tangents there meet below the floor. Its place is the zero of the exact derivative, or, where the derivative is not
known or does not change its sign, the maximum on ever finer grids. Values are always exact; two peaks between the same
two samples of a polynomial count as one.

Measured motions: `judge_samples` takes their values one by one. One rule counts, whatever the deviations come from
(noise, vibrations that a fit leaves out, the ends of a fit) and wherever it is: a value that is beyond its bound by
more than two deviations is broken, one that is within it by as much is kept, and all else is undecided. Peaks between
samples count. The value that is shown is the worst one in its window, where deviations are near their median, or one
outside that is decided.

[1] G. Farin, Curves and Surfaces for CAGD, 5th edition, 2002.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from jounce.engine.along import ForceBreak
from jounce.limits.joints import drop_base, quantity_columns, scatter_columns
from jounce.limits.limited_motion import LimitedMotion, compute_deviations
from jounce.limits.motion_polynomials import (
    MIN_SHARE_OF_LIMIT,
    PIECE_TOLERANCE,
    Pieces,
    bernstein_coefficients,
    evaluate_polynomials,
    split_part,
)
from jounce.limits.ratios import LIMIT_TOLERANCE, SIGNS, find_runs
from jounce.limits.root_finding import find_maxima, find_roots
from jounce.model import positions
from jounce.model.limits import LIMIT_KINDS
from jounce.motion.channel import Span
from jounce.motion.motion import Break

Spans = dict[tuple[str, int], list[Span]]  # by kind and joint


class Peaks(NamedTuple):
    """Local extremes, one each: of which kind, joint and sign (1: a maximum), the piece, the time and the value."""

    kind: np.ndarray  # of text
    joint: np.ndarray
    sign: np.ndarray
    t: np.ndarray
    value: np.ndarray


class Worst:
    """For each kind and sign the largest signed values (n,), their times, and the spans beyond the bounds.

    `unresolved` are spans in which values within their bounds change too fast to be known between the ends of pieces.
    """

    def __init__(self, b: LimitedMotion) -> None:
        self.b = b
        sides = [(kind, sign) for kind in b.kinds for sign in SIGNS]
        n = len(b.joints)
        self.value = {side: np.full(n, -np.inf) for side in sides}
        self.t = {side: np.full(n, b.motion.start) for side in sides}
        self.largest = {kind: np.zeros(n) for kind in b.kinds}
        self.spans: dict[tuple[str, int], list[list[Span]]] = {side: [[] for _ in range(n)] for side in sides}
        self.unresolved: Spans = {}

    def take(self, pieces: Pieces) -> None:
        """Take in pieces of the motion, which follow earlier ones."""
        peaks = self.take_worst(pieces)
        self._add_spans(pieces, peaks)

    def take_worst(self, pieces: Pieces) -> Peaks:
        """Take in the worst values of pieces alone; returns the peaks between the ends of pieces."""
        for kind in pieces.kinds:
            for t, values in ((pieces.start, pieces.left[kind]), (pieces.stop, pieces.right[kind])):
                self.largest[kind] = np.maximum(self.largest[kind], np.abs(values).max(axis=0))
                for sign in SIGNS:
                    at = (sign * values).argmax(axis=0)
                    self._update(kind, sign, np.arange(values.shape[1]), t[at], (sign * values).max(axis=0))
        peaks = find_peaks(self.b, pieces, self._floor)
        for kind, joint, sign, t, value in zip(*peaks, strict=True):
            self._update(str(kind), int(sign), np.array([joint]), np.array([t]), np.array([sign * value]))
        self._take_unresolved(pieces)
        return peaks

    def _take_unresolved(self, pieces: Pieces) -> None:
        """Record where a polynomial and its error together reach a bound."""
        for kind, missed in pieces.missed.items():
            coarse = pieces.select(np.flatnonzero(missed.any(axis=1)))
            ends = (
                bernstein_coefficients(coarse.polynomials[kind])
                if len(coarse.start)
                else np.zeros((1, 0, missed.shape[1]))
            )
            for sign in SIGNS:
                reach = (sign * ends).max(axis=0) + coarse.missed[kind]
                known = np.maximum(sign * coarse.left[kind], sign * coarse.right[kind])
                bound = self.b.scales[kind].tolerant(sign)
                for i, j in np.argwhere((known <= bound) & (reach > bound)).tolist():
                    span = float(coarse.start[i]), float(coarse.stop[i])
                    self.unresolved.setdefault((kind, j), []).append(span)

    def broken_spans(self, kind: str, j: int) -> list[Span]:
        """When the limit of a joint is broken, on either side."""
        return [span for sign in SIGNS for span in self.spans[kind, sign][j]]

    def drop_spans(self, kind: str, j: int) -> list[Span]:
        """Forget when the limit of a joint is broken; returns these times."""
        dropped = self.broken_spans(kind, j)
        for sign in SIGNS:
            self.spans[kind, sign][j] = []
        return dropped

    def take_values(self, kind: str, sign: int, t: np.ndarray, values: np.ndarray, beyond: np.ndarray) -> None:
        """Count signed values (N, n) of a kind at times (N,), and the times at which they are beyond their bounds."""
        at = values.argmax(axis=0)
        self._update(kind, sign, np.arange(values.shape[1]), t[at], values.max(axis=0))
        for j in np.flatnonzero(beyond.any(axis=0)).tolist():
            self.spans[kind, sign][j] += [(float(t[i]), float(t[k])) for i, k in find_runs(beyond[:, j])]

    def take_jumps(self, breaks: Sequence[ForceBreak]) -> None:
        """Count jumps of a lower rate as infinite values: of motions, and of forces at their breaks.

        The rate above the one that jumps has an impulse of the sign of the jump, and those above it of either sign.
        """
        highest = max((LIMIT_KINDS[kind].rate for kind in self.b.kinds if LIMIT_KINDS[kind].of == "q"), default=0)
        for found in self.b.motion.breaks_to(highest - 1) if highest else ():
            if found.symbol == "q":
                above = {kind: k for k, kind in enumerate(LIMIT_KINDS.motion[found.order + 1 :])}
                for j, jump in self._jumps_with(found).items():
                    for kind, k in above.items():
                        self._jump(kind, j, found.t, jump, either=k > 0)
        for met in breaks:
            m, row = self.b.robot.mechanism, self.b.efforts
            unknown = [np.ones(len(quantity_columns(m, row)))]  # where q or qd jumps: an impulse
            known = unknown if met.jump is None else drop_base(m, (met.jump, *met.higher), row)
            for order, force in enumerate(scatter_columns(m, known, row), start=met.order):
                for i in np.flatnonzero(np.abs(force) > LIMIT_TOLERANCE * np.abs(force).max()).tolist():
                    for kind, rate in self.b.force_rates.items():
                        if order < rate:
                            self._jump(kind, i, met.t, float(force[i]), either=met.jump is None or rate > order + 1)

    def _jumps_with(self, found: Break) -> dict[int, float]:
        """The jumps of joints at a break of a coordinate, by column: its own, and those of joints that follow it."""
        b, names = self.b, self.b.robot.joint_names
        own = found.joint if isinstance(found.joint, str) else names[found.joint]
        several = next(
            (x for x in positions.multiscrew_joints(b.robot.mechanism.tree).values() if own in x.names), None
        )
        if several is None and not b.follow:
            return {b.joints.index(own): found.jump}
        t = np.array([found.t])
        after, before = (b.rates(t, found.order, side)[found.order][0] for side in ("right", "left"))
        jump = after - before
        if several is not None:  # one of its numbers jumps: its velocities show which of them do
            columns = range(len(b.joints))[several.coordinates]
            least = LIMIT_TOLERANCE * np.abs(jump[several.coordinates]).max()
            return {j: float(jump[j]) for j in columns if abs(jump[j]) > least}
        follow = [j for j, name in enumerate(b.joints) if name not in names]
        least = LIMIT_TOLERANCE * np.abs(jump).max()
        return {b.joints.index(own): found.jump} | {j: float(jump[j]) for j in follow if abs(jump[j]) > least}

    def _jump(self, kind: str, j: int, t: float, jump: float, either: bool) -> None:
        """Count a jump of a lower rate as an infinite value of a kind: of its sign, or of either one."""
        for sign in SIGNS if either else (1 if jump > 0 else -1,):
            if kind in self.b.kinds and np.isfinite(self.b.scales[kind].bound(sign)[j]):
                self._update(kind, sign, np.array([j]), np.array([t]), np.array([np.inf]))
                self.spans[kind, sign][j].append((t, t))

    def _update(self, kind: str, sign: int, joint: np.ndarray, t: np.ndarray, value: np.ndarray) -> None:
        better = value > self.value[kind, sign][joint]
        self.value[kind, sign][joint[better]] = value[better]
        self.t[kind, sign][joint[better]] = t[better]

    @property
    def ratios(self) -> dict[tuple[str, int], np.ndarray]:
        """The ratios (n,) of the largest values, by kind and sign."""
        return {(kind, sign): self.b.scales[kind].ratio(sign * x, sign) for (kind, sign), x in self.value.items()}

    def _floor(self, pieces: Pieces, kind: str, sign: int) -> np.ndarray:
        """The least height of a peak that matters, (K, n): the worst value, or the bound if an end is within it.

        Less than a negligible share of the bound does not: the rounding of rates of forces has thousands of peaks.
        """
        scale = self.b.scales[kind]
        bound = scale.bound(sign)
        within = np.minimum(sign * pieces.left[kind], sign * pieces.right[kind]) <= bound
        least = np.where(within, np.minimum(self.value[kind, sign], bound), self.value[kind, sign])
        with np.errstate(invalid="ignore"):  # of infinite bounds
            negligible = sign * scale.centre + MIN_SHARE_OF_LIMIT * scale.reach(sign)
            least = np.maximum(least - PIECE_TOLERANCE * self.largest[kind], negligible)
        return np.where(np.isfinite(bound), least, np.inf)

    def _add_spans(self, pieces: Pieces, peaks: Peaks) -> None:
        """The spans in which values are beyond their bounds, their ends exact."""
        crossings = [
            self._crossing(pieces, peaks, kind, sign, int(j))
            for (kind, sign), worst in self.value.items()
            if kind in pieces.kinds
            for j in np.flatnonzero(worst > self.b.scales[kind].tolerant(sign))
        ]
        if not crossings:
            return
        edges = [crossing.edges for crossing in crossings]
        counts = [len(edge) for edge in edges]
        of = np.repeat(np.arange(len(crossings)), counts)
        kind, joint, sign, bound = (np.array(column)[of] for column in zip(*(c[:4] for c in crossings), strict=True))
        low, high = np.concatenate(edges).T
        excess = np.concatenate([crossing.excess for crossing in crossings])
        ends = low.copy()
        inner = low < high

        def beyond(t: np.ndarray, at: np.ndarray) -> np.ndarray:
            return sign[inner][at] * pick_values(self.b, t, kind[inner][at], joint[inner][at], 0) - bound[inner][at]

        if inner.any():
            ends[inner] = find_roots(beyond, low[inner], high[inner], excess[inner].T)
        for crossing, mine in zip(crossings, np.split(ends, np.cumsum(counts)[:-1]), strict=True):
            _extend_spans(self.spans[crossing.kind, crossing.sign][crossing.joint], mine.tolist())

    def _crossing(self, pieces: Pieces, peaks: Peaks, kind: str, sign: int, j: int) -> "_Crossing":
        """Between which times a value passes its bound; where it begins or ends beyond it, and at jumps, that time."""
        mine = (peaks.kind == kind) & (peaks.joint == j) & (peaks.sign == sign)
        left, right = pieces.left[kind], pieces.right[kind]
        t = np.concatenate([pieces.stop, peaks.t[mine], pieces.start])
        y = np.concatenate([right[:, j], peaks.value[mine], left[:, j]]) * sign
        order = np.argsort(t, kind="stable")  # at a break what ends there stands before what begins
        t, y, bound = t[order], y[order], float(self.b.scales[kind].bound(sign)[j])
        beyond = y > self.b.scales[kind].tolerant(sign)[j]
        passes = np.flatnonzero(beyond[1:] != beyond[:-1])
        first, last = [[0, 0]] * bool(beyond[0]), [[-1, -1]] * bool(beyond[-1])
        ends = np.array([*first, *np.column_stack([passes, passes + 1]), *last], dtype=int).reshape(-1, 2)
        return _Crossing(kind, j, sign, bound, t[ends], y[ends] - bound)


def _extend_spans(spans: list[Span], ends: list[float]) -> None:
    """Add the spans between pairs of ends; one that begins where the last one ends continues it."""
    for start, stop in zip(ends[::2], ends[1::2], strict=True):
        if spans and spans[-1][1] == start:
            start = spans.pop()[0]
        spans.append((start, stop))


class _Crossing(NamedTuple):
    kind: str
    joint: int
    sign: int
    bound: float
    edges: np.ndarray  # (edges, 2), times
    excess: np.ndarray  # (edges, 2), of signed values over the bound at these times


# Peaks between the ends of pieces.
_SAMPLES_PER_PIECE = 17  # of a polynomial: many for the six extremes of degree 7
_MIN_PEAK_HEIGHT = 1e-12  # of the values of a polynomial: lower peaks are rounding, and the ends as high


def find_peaks(b: LimitedMotion, pieces: Pieces, floor: Callable[[Pieces, str, int], np.ndarray]) -> Peaks:
    """The extremes inside pieces that pass a floor (K, n), given by kind and sign; each is exact."""
    found: list[tuple[np.ndarray, ...]] = []
    u = np.linspace(0, 1, _SAMPLES_PER_PIECE)
    for kind in pieces.kinds if pieces.width.all() else ():
        c = pieces.polynomials[kind]
        bernstein = bernstein_coefficients(c)
        for sign in SIGNS:
            # Discard polynomials that cannot reach the floor.
            least = floor(pieces, kind, sign)
            i, j = np.nonzero((sign * bernstein).max(axis=0) > least)
            if not i.size:
                continue
            # Samples between which the slope changes its sign, and the tangents meet above the floor.
            near = c[:, i, j]
            y, slope = (
                sign * evaluate_polynomials(x, u[:, None])
                for x in (near, near[:-1] * np.arange(len(c) - 1, 0, -1)[:, None])
            )
            inner = (slope[:-1] > 0) & (slope[1:] <= 0)
            tangents = np.maximum(
                y[:-1] + slope[:-1] / (_SAMPLES_PER_PIECE - 1), y[1:] - slope[1:] / (_SAMPLES_PER_PIECE - 1)
            )  # above any peak
            inner &= tangents > least[i, j]
            inner &= (slope[:-1] - slope[1:]) / _SAMPLES_PER_PIECE > _MIN_PEAK_HEIGHT * np.abs(y).max(axis=0)
            # Brackets in time, one sample wider on both sides: the polynomial may misplace the peak.
            at, which = np.nonzero(inner)
            start, width = pieces.start[i[which]], pieces.width[i[which], 0]
            low, high = (u[at_end.clip(0, _SAMPLES_PER_PIECE - 1)] * width + start for at_end in (at - 1, at + 2))
            high = np.minimum(high, np.nextafter(pieces.stop[i[which]], start))  # at a break another piece begins
            count = len(which)
            found.append((np.full(count, kind), j[which], np.full(count, sign), low, high))
    if not found:
        return _place_peaks(b, np.array([], dtype=str), *(np.array([], dtype=int),) * 2, *(np.array([]),) * 2)
    return _place_peaks(b, *(np.concatenate(column) for column in zip(*found, strict=True)))


def _place_peaks(
    b: LimitedMotion, kind: np.ndarray, joint: np.ndarray, sign: np.ndarray, low: np.ndarray, high: np.ndarray
) -> Peaks:
    """The exact extremes between two times each: where the derivative is 0, or on finer and finer grids."""
    if not kind.size:
        return Peaks(kind, joint, sign, low, low)

    def value(t: np.ndarray) -> np.ndarray:
        return pick_values(b, t, kind, joint, 0)

    channels = b.select_kinds(set(kind.tolist())).channels(low[:1])
    known = np.array([len(channels[k].rates) > LIMIT_KINDS[k].derivative + 1 for k in kind.tolist()])
    t, places = np.empty(len(low)), np.flatnonzero(known)
    if places.size:

        def slope(t: np.ndarray, at: np.ndarray) -> np.ndarray:
            return sign[at] * pick_values(b, t, kind[at], joint[at], 1)

        ends = np.stack([slope(end[places], places) for end in (low, high)])
        crosses = ends[0] * ends[1] <= 0  # else the polynomial and the value do not rise and fall alike
        known[places[~crosses]] = False
        places = places[crosses]
        t[places] = find_roots(lambda t, at: slope(t, places[at]), low[places], high[places], ends[:, crosses])
    if not known.all():

        def height(t: np.ndarray) -> np.ndarray:
            of, at = (np.repeat(column[~known], t.shape[1]) for column in (kind, joint))
            return sign[~known, None] * pick_values(b, t.ravel(), of, at, 0).reshape(t.shape)

        t[~known] = find_maxima(height, low[~known], high[~known])
    return Peaks(kind, joint, sign, t, value(t))


def pick_values(b: LimitedMotion, t: np.ndarray, kind: np.ndarray, joint: np.ndarray, derivative: int) -> np.ndarray:
    """What limits bound, of one kind and joint at each time, or a derivative of it."""
    found = np.empty(len(t))
    for name, channel in b.select_kinds(set(kind.tolist())).channels(t).items():
        mine = np.flatnonzero(kind == name)
        found[mine] = channel.rates[LIMIT_KINDS[name].derivative + derivative][mine, joint[mine]]
    return found


# Measured motions: values with deviations.
DECISIVE_DEVIATIONS = 2.0  # between a value and its limit: 95 % of normal errors are smaller
_UNCERTAIN_TIMES_AT_ONCE = 20_000  # times judged together, which bounds working memory
_VALUES_AT_ONCE = 2000  # times evaluated together


def judge_samples(b: LimitedMotion, worst: Worst) -> Spans:
    """Judge a measured motion along all its time: its worst values, and where it is broken; returns where undecided."""
    undecided: Spans = {}
    for t, values in sample_values(b):
        judge_values(b, worst, t, values, undecided)
    return undecided


def sample_values(b: LimitedMotion) -> Iterator[tuple[np.ndarray, dict[str, np.ndarray]]]:
    """Times (N,) along all the motion, those of peaks between its samples too, and the values there, part by part."""
    for t in _overlapping_parts(_collect_times(b)):
        yield from take_sides(b, t)


def take_sides(b: LimitedMotion, t: np.ndarray) -> Iterator[tuple[np.ndarray, dict[str, np.ndarray]]]:
    """Times (N,) and the values there: of those that are breaks what ends there, and of all what begins there."""
    jumps = np.intersect1d(t, [found.t for found in b.motion.breaks_to(b.rate_order)])
    if jumps.size:
        yield jumps, b.values(jumps, "left")
    yield t, _values_in_blocks(b, t)


def judge_values(
    b: LimitedMotion, worst: Worst, t: np.ndarray, values: Mapping[str, np.ndarray], undecided: Spans
) -> None:
    """Judge given values (N, joints) by kind at times (N,), and add the spans in which nothing is known."""
    off = compute_deviations(b, t.clip(*b.whole))
    for kind in b.kinds:
        unclear = _judge_kind(worst, kind, t, values[kind], off.get(kind, np.zeros_like(values[kind])))
        for j in np.flatnonzero(unclear.any(axis=0)).tolist():
            # from the last time before at which it is known to the first one after
            spans = [(float(t[max(i - 1, 0)]), float(t[min(k + 1, len(t) - 1)])) for i, k in find_runs(unclear[:, j])]
            undecided[kind, j] = undecided.get((kind, j), []) + spans


def _judge_kind(worst: Worst, kind: str, t: np.ndarray, values: np.ndarray, off: np.ndarray) -> np.ndarray:
    """Count values (N, joints) of a kind; returns which are neither kept nor broken on any side."""
    start, stop = worst.b.window(kind)
    inside = ((t >= start) & (t <= stop))[:, None]
    unclear, broken = (np.zeros(values.shape, dtype=bool) for _ in range(2))
    for sign in SIGNS:
        excess = sign * values - worst.b.scales[kind].tolerant(sign)
        beyond, within = excess > DECISIVE_DEVIATIONS * off, excess <= -DECISIVE_DEVIATIONS * off
        shown = np.where(inside | beyond | within, sign * values, -np.inf)
        worst.take_values(kind, sign, t, shown, beyond)
        unclear |= ~(beyond | within) & np.isfinite(worst.b.scales[kind].bound(sign))
        broken |= beyond
    return unclear & ~broken


def _overlapping_parts(t: np.ndarray) -> Iterator[np.ndarray]:
    """Parts of times, of which each begins with the last time of the one before."""
    for start in range(0, max(1, len(t) - 1), _UNCERTAIN_TIMES_AT_ONCE - 1):
        yield t[start : start + _UNCERTAIN_TIMES_AT_ONCE]


def _collect_times(b: LimitedMotion) -> np.ndarray:
    """The times of the pieces of a motion, and when values have peaks."""
    every = [np.array(b.whole)]
    for pieces in split_part(b, b.whole):
        every += [pieces.start, pieces.stop, find_peaks(b, pieces, partial(_any_peak, b)).t]
    return np.unique(np.concatenate(every))


def _any_peak(b: LimitedMotion, pieces: Pieces, kind: str, sign: int) -> np.ndarray:
    """What peaks must reach where a value is bounded on this side: more than the ends of their piece."""
    scale = b.scales[kind]
    ends = np.maximum(sign * pieces.left[kind], sign * pieces.right[kind])
    with np.errstate(invalid="ignore"):  # of infinite bounds
        return np.where(np.isfinite(scale.bound(sign)), ends + LIMIT_TOLERANCE * np.abs(scale.reach(sign)), np.inf)


def _values_in_blocks(b: LimitedMotion, t: np.ndarray) -> dict[str, np.ndarray]:
    blocks = [b.values(t[i : i + _VALUES_AT_ONCE]) for i in range(0, len(t), _VALUES_AT_ONCE)]
    return {kind: np.concatenate([block[kind] for block in blocks]) for kind in b.kinds}
