"""`Worst` gathers worst values along a motion, and broken spans.

Exact motions: `Worst.take` takes in pieces of the motion one after the other. A piece has exact values at its ends,
and polynomials that come close to them in between. The ends count first, then peaks between them (`find_peaks`), and
then the times at which exact values pass their bounds. At last `Worst.take_jumps` counts a value as infinite where a
lower rate of it jumps.

Peaks: polynomials whose Bernstein coefficients stay below a floor have no peak above it (the convex hull property [1]),
which discards most of them. On the others a change of sign of the slope between even samples brackets a peak, unless
both tangents there stay below the floor as far as the other sample. Its place is the zero of the exact derivative, or,
where the derivative is not known or does not change its sign, the maximum on ever finer grids. Values are always exact;
two peaks between the same two samples of a polynomial count as one.

Measured motions: `judge_samples` takes their values one by one, at the ends of pieces and at peaks. One rule counts,
whatever the deviations come from (noise, vibrations that a fit leaves out, the ends of a fit) and wherever the value
is: one that is beyond its bound by more than two deviations is broken, one that is within it by as much is kept, and
all else is undecided. The value that is shown is the worst one in its window, where deviations are near their median,
or one outside that is decided.

[1] G. Farin, Curves and Surfaces for CAGD, 5th edition, 2002.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from jounce.engine.along import ForceBreak
from jounce.limits.joints import drop_base, quantity_columns, scatter_columns, scatter_sizes
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

Spans = dict[tuple[str, int], list[Span]]  # by kind and joint, which is a column


class Peaks(NamedTuple):
    """Local extremes as parallel arrays (M,), one entry for each peak.

    `sign` is 1 for a maximum and -1 for a minimum; `value` is the value itself, without its sign turned.
    """

    kind: np.ndarray  # of text
    joint: np.ndarray
    sign: np.ndarray
    t: np.ndarray
    value: np.ndarray


class Worst:
    """The worst values along a motion, and its broken spans.

    A side is a kind of limit and a sign. On it signed values (the value times the sign) stay below one bound, so that
    both bounds of a limit are upper bounds, and the worst value is the largest one.

    By side, `value` and `t` hold the worst signed value of each joint (n,) and its time, and `spans` a list of spans
    beyond the bound for each joint. By kind, `largest` holds the largest absolute value of each joint at the ends of
    pieces. By kind and joint, `unresolved` holds the spans of pieces that are within the bound at their ends, and
    change too fast to be known in between.

    `take` runs once for each block of pieces, in the order of time, or `take_worst` where the ends of spans are not
    needed; `take_jumps` runs once for each motion, after it. `take_values` adds values that stand for themselves.
    """

    def __init__(self, b: LimitedMotion) -> None:
        self.b = b
        sides = [(kind, sign) for kind in b.kinds for sign in SIGNS]
        n = {kind: len(b.names(kind)) for kind in b.kinds}
        # Any value is worse than -inf: the first one that is taken replaces it.
        self.value = {(kind, sign): np.full(n[kind], -np.inf) for kind, sign in sides}
        self.t = {(kind, sign): np.full(n[kind], b.motion.start) for kind, sign in sides}
        self.largest = {kind: np.zeros(n[kind]) for kind in b.kinds}
        self.spans: dict[tuple[str, int], list[list[Span]]] = {
            (kind, sign): [[] for _ in range(n[kind])] for kind, sign in sides
        }
        self.unresolved: Spans = {}

    def take(self, pieces: Pieces) -> None:
        """Add the worst values and the spans of the next pieces."""
        peaks = self.take_worst(pieces)
        self._add_spans(pieces, peaks)

    def take_worst(self, pieces: Pieces) -> Peaks:
        """Add the worst values of the next pieces, and return their peaks.

        The peaks are those between the ends of pieces. Pieces that are not resolved are recorded too.
        """
        # Values at the ends of pieces count first: they raise the floor that peaks have to pass.
        for kind in pieces.kinds:
            for t, values in ((pieces.start, pieces.left[kind]), (pieces.stop, pieces.right[kind])):
                self.largest[kind] = np.maximum(self.largest[kind], np.abs(values).max(axis=0))
                for sign in SIGNS:
                    row = (sign * values).argmax(axis=0)
                    self._update(kind, sign, np.arange(values.shape[1]), t[row], (sign * values).max(axis=0))
        # A piece is searched for peaks only where its polynomial can pass the floor.
        peaks = find_peaks(self.b, pieces, self._floor)
        # A motion has few peaks, so that they are taken one by one.
        for kind, joint, sign, t, value in zip(*peaks, strict=True):
            self._update(str(kind), int(sign), np.array([joint]), np.array([t]), np.array([sign * value]))
        self._take_unresolved(pieces)
        return peaks

    def _take_unresolved(self, pieces: Pieces) -> None:
        """Record pieces that may pass a bound within their polynomial error."""
        for kind, missed in pieces.missed.items():
            # Only pieces that could not be split once more have an error that counts.
            coarse = pieces.select(np.flatnonzero(missed.any(axis=1)))
            if len(coarse.start) == 0:
                continue
            # The coefficients (degree + 1, K, n) bound the polynomials: with the error they bound the exact values.
            coefficients = bernstein_coefficients(coarse.polynomials[kind])
            for sign in SIGNS:
                highest = (sign * coefficients).max(axis=0) + coarse.missed[kind]
                worst_end = np.maximum(sign * coarse.left[kind], sign * coarse.right[kind])
                bound = self.b.scales[kind].tolerant(sign)
                # A bound is at risk where the ends of the piece are within it and the inside may be beyond.
                for i, j in np.argwhere((worst_end <= bound) & (highest > bound)).tolist():
                    span = float(coarse.start[i]), float(coarse.stop[i])
                    self.unresolved.setdefault((kind, j), []).append(span)

    def broken_spans(self, kind: str, j: int) -> list[Span]:
        """Return the broken spans of a joint's limit, on both sides."""
        return [span for sign in SIGNS for span in self.spans[kind, sign][j]]

    def drop_spans(self, kind: str, j: int) -> list[Span]:
        """Forget the broken spans of a joint's limit, and return them."""
        dropped = self.broken_spans(kind, j)
        for sign in SIGNS:
            self.spans[kind, sign][j] = []
        return dropped

    def take_values(self, kind: str, sign: int, t: np.ndarray, values: np.ndarray, beyond: np.ndarray) -> None:
        """Add signed values (N, n) at times (N,), and broken spans.

        `beyond` (N, n) says which of them are beyond their bounds. A run of these is a span from its first time to its
        last: where the value passes the bound between two times is not known.
        """
        row = values.argmax(axis=0)
        self._update(kind, sign, np.arange(values.shape[1]), t[row], values.max(axis=0))
        for j in np.flatnonzero(beyond.any(axis=0)).tolist():
            self.spans[kind, sign][j] += [(float(t[i]), float(t[k])) for i, k in find_runs(beyond[:, j])]

    def take_jumps(self, breaks: Sequence[ForceBreak]) -> None:
        """Count values as infinite where a lower rate of them jumps.

        Rates of q jump at breaks of the motion, those of forces at the breaks that are given. The derivative of a jump
        is an impulse of its sign; derivatives of an impulse have both signs. So the rate just above the one that jumps
        is infinite on the side of the jump, and all higher ones on both sides.
        """
        # A limit of the k-th rate of q is broken by jumps of lower rates alone, one of positions by no jump.
        highest = max((LIMIT_KINDS[kind].rate for kind in self.b.kinds if LIMIT_KINDS[kind].of == "q"), default=0)
        for motion_break in self.b.motion.breaks_to(highest - 1) if highest else ():
            # Jumps of loads and of the base are of no concern here: they are among the breaks of forces.
            if motion_break.symbol == "q":
                # How many rates lie between a kind and the rate that jumps.
                above = {kind: k for k, kind in enumerate(LIMIT_KINDS.motion[motion_break.order + 1 :])}
                for j, jump in self._jumps_by_joint(motion_break).items():
                    for kind, k in above.items():
                        self._jump(kind, j, motion_break.t, jump, both_signs=k > 0)
        # A break of forces states the jumps of a rate of Q and of those above it, or none where Q itself is infinite.
        for force_break in breaks:
            m, row = self.b.robot.mechanism, self.b.efforts
            # Where q or qd jumps, Q is an impulse of unknown sign at every joint, as if a rate of order -1 jumped: any
            # number above 0 stands for that jump.
            if force_break.jump is None:
                jumps = scatter_sizes(m, [np.ones(len(quantity_columns(m, row)))], row)
            else:
                jumps = scatter_columns(m, drop_base(m, (force_break.jump, *force_break.higher), row), row)
            for order, of_joints in enumerate(jumps, start=force_break.order):
                # Jumps that are far smaller than the largest one are rounding.
                for j in np.flatnonzero(np.abs(of_joints) > LIMIT_TOLERANCE * np.abs(of_joints).max()).tolist():
                    for kind, rate in self.b.force_rates.items():
                        if order < rate:
                            both_signs = force_break.jump is None or rate > order + 1
                            self._jump(kind, j, force_break.t, float(of_joints[j]), both_signs)

    def _jumps_by_joint(self, motion_break: Break) -> dict[int, float]:
        """Return the jumps at a break of a coordinate, by column.

        A coordinate takes others with it: those of its joint of several screws, and joints that follow it in closed
        loops.
        """
        b, names = self.b, self.b.robot.joint_names
        own_name = motion_break.joint if isinstance(motion_break.joint, str) else names[motion_break.joint]
        joints_of_several_screws = positions.multiscrew_joints(b.robot.mechanism.tree).values()
        several = next((joint for joint in joints_of_several_screws if own_name in joint.names), None)
        # A joint of one screw jumps alone if no limits take joints that follow others.
        if several is None and not b.follow:
            return {b.joints.index(own_name): motion_break.jump}
        # Else the rates on both sides of the break show which columns jump: those that do so by more than rounding.
        t = np.array([motion_break.t])
        after, before = (b.rates(t, motion_break.order, side)[motion_break.order][0] for side in ("right", "left"))
        jump = after - before
        if several is not None:
            # The break is that of one number in q, such as a part of a quaternion, and columns are other numbers: all
            # columns of the joint may jump.
            columns = range(len(b.joints))[several.coordinates]
            least = LIMIT_TOLERANCE * np.abs(jump[several.coordinates]).max()
            return {j: float(jump[j]) for j in columns if abs(jump[j]) > least}
        # The coordinate jumps as its break states; joints that follow it, those that are no coordinates, jump as the
        # loops make them.
        followers = [j for j, name in enumerate(b.joints) if name not in names]
        least = LIMIT_TOLERANCE * np.abs(jump).max()
        return {b.joints.index(own_name): motion_break.jump} | {
            j: float(jump[j]) for j in followers if abs(jump[j]) > least
        }

    def _jump(self, kind: str, j: int, t: float, jump: float, both_signs: bool) -> None:
        """Count what a kind bounds as infinite, at the time t.

        The jump is that of a lower rate. Unless the value is infinite with both signs, it has that of the jump.
        """
        signs: Sequence[int] = SIGNS
        if LIMIT_KINDS[kind].is_total:
            # A sum over all joints jumps with any of them; which sign it has depends on the other factor.
            j = 0
        elif not both_signs:
            signs = [1] if jump > 0 else [-1]
        for sign in signs:
            # An infinite value breaks a limit only where there is one on this side.
            if kind in self.b.kinds and np.isfinite(self.b.scales[kind].bound(sign)[j]):
                self._update(kind, sign, np.array([j]), np.array([t]), np.array([np.inf]))
                self.spans[kind, sign][j].append((t, t))

    def _update(self, kind: str, sign: int, joint: np.ndarray, t: np.ndarray, value: np.ndarray) -> None:
        """Keep the signed values that are worse than those so far.

        Columns, times and values are (M,), and no column is there twice.
        """
        worse = value > self.value[kind, sign][joint]
        self.value[kind, sign][joint[worse]] = value[worse]
        self.t[kind, sign][joint[worse]] = t[worse]

    @property
    def ratios(self) -> dict[tuple[str, int], np.ndarray]:
        """The ratios (n,) of worst values to bounds, by side."""
        return {(kind, sign): self.b.scales[kind].ratio(sign * x, sign) for (kind, sign), x in self.value.items()}

    def _floor(self, pieces: Pieces, kind: str, sign: int) -> np.ndarray:
        """Return the least height of peaks that matter, as signed values (K, n).

        A peak matters where it is worse than all values so far. Where an end of its piece is within the bound, it
        matters too if it passes the bound, since a span begins or ends there. Peaks that go a negligible share of the
        way from the centre to the bound never matter: rounding makes thousands of them in rates of forces.
        """
        scale = self.b.scales[kind]
        bound = scale.bound(sign)
        end_within = np.minimum(sign * pieces.left[kind], sign * pieces.right[kind]) <= bound
        least = np.where(end_within, np.minimum(self.value[kind, sign], bound), self.value[kind, sign])
        # The exact value may be higher than its polynomial, by the tolerance of pieces: the floor is lowered by that.
        # What infinite bounds make of it does not count, as the last step replaces it.
        with np.errstate(invalid="ignore"):
            negligible = sign * scale.centre + MIN_SHARE_OF_LIMIT * scale.reach(sign)
            least = np.maximum(least - PIECE_TOLERANCE * self.largest[kind], negligible)
        # Nothing passes an infinite floor: sides without a bound have no peaks.
        return np.where(np.isfinite(bound), least, np.inf)

    def _add_spans(self, pieces: Pieces, peaks: Peaks) -> None:
        """Add the spans beyond the bounds, with exact ends.

        An edge is a pair of neighbouring times between which a value passes its bound, so that a span begins or ends
        there. All values at known times are at hand; exact values are evaluated for the zeros in edges alone.
        """
        # Only columns with a worst value beyond the bound have spans.
        crossings = [
            self._crossing(pieces, peaks, kind, sign, int(j))
            for (kind, sign), worst in self.value.items()
            if kind in pieces.kinds
            for j in np.flatnonzero(worst > self.b.scales[kind].tolerant(sign))
        ]
        if len(crossings) == 0:
            return
        # All edges go into one list, since evaluating at many times costs hardly more than at one.
        edges = [crossing.edges for crossing in crossings]
        counts = [len(edges_of_column) for edges_of_column in edges]
        column_of_edge = np.repeat(np.arange(len(crossings)), counts)
        # Each edge has the kind, joint, sign and bound of its column, (E,) each.
        kind, joint, sign, bound = (
            np.array(column)[column_of_edge] for column in zip(*(c[:4] for c in crossings), strict=True)
        )
        low, high = np.concatenate(edges).T
        excess = np.concatenate([crossing.excess for crossing in crossings])
        # An edge of no width is a jump, or an end of the pieces that cuts a span: its time is exact already.
        ends = low.copy()
        is_open = low < high

        # In the others the exact value meets its bound where its excess is zero; `edge` counts open edges alone.
        def excess_at(t: np.ndarray, edge: np.ndarray) -> np.ndarray:
            values = pick_values(self.b, t, kind[is_open][edge], joint[is_open][edge], 0)
            return sign[is_open][edge] * values - bound[is_open][edge]

        if is_open.any():
            ends[is_open] = find_roots(excess_at, low[is_open], high[is_open], excess[is_open].T)
        # Cut the ends (E,) into those of each column: start, stop, start, stop, ...
        for crossing, ends_of_column in zip(crossings, np.split(ends, np.cumsum(counts)[:-1]), strict=True):
            _extend_spans(self.spans[crossing.kind, crossing.sign][crossing.joint], ends_of_column.tolist())

    def _crossing(self, pieces: Pieces, peaks: Peaks, kind: str, sign: int, j: int) -> "_Crossing":
        """Return the edges at which one column passes its bound.

        Edges come in pairs, start and stop of a span. An edge has no width at a jump, where both sides stand at one
        time, and where the first or the last time of the pieces cuts a span. Values that are within the bound only
        between two known times do not part a span.
        """
        # Values are known at both ends of the pieces, and at the peaks between them.
        of_column = (peaks.kind == kind) & (peaks.joint == j) & (peaks.sign == sign)
        left, right = pieces.left[kind], pieces.right[kind]
        t = np.concatenate([pieces.stop, peaks.t[of_column], pieces.start])
        y = np.concatenate([right[:, j], peaks.value[of_column], left[:, j]]) * sign
        # The sort is stable: at a break the end of one piece stands before the start of the next.
        order = np.argsort(t, kind="stable")
        t, y, bound = t[order], y[order], float(self.b.scales[kind].bound(sign)[j])
        # A value that passes its bound by rounding is not beyond it, but spans begin and end at the bound itself.
        beyond = y > self.b.scales[kind].tolerant(sign)[j]
        passes = np.flatnonzero(beyond[1:] != beyond[:-1])
        # Each edge is the indices of two times; where a span is cut, both are the first, or the last.
        edges = [[i, i + 1] for i in passes.tolist()]
        if beyond[0]:
            edges.insert(0, [0, 0])
        if beyond[-1]:
            edges.append([-1, -1])
        index = np.array(edges, dtype=int).reshape(-1, 2)
        return _Crossing(kind, j, sign, bound, t[index], y[index] - bound)


def _extend_spans(spans: list[Span], ends: list[float]) -> None:
    """Add the spans between pairs of ends, in the order of time.

    A span that begins where the last one ends continues it: blocks of pieces cut spans in two.
    """
    for start, stop in zip(ends[::2], ends[1::2], strict=True):
        if len(spans) > 0 and spans[-1][1] == start:
            start = spans.pop()[0]
        spans.append((start, stop))


class _Crossing(NamedTuple):
    """The edges between which the value of one column passes its bound."""

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
    """Find the extremes inside pieces that pass a floor; each is exact.

    `floor` takes pieces, a kind and a sign, and returns the signed values (K, n) that peaks have to pass.
    """
    # Each entry brackets the peaks of a kind and a sign: kind, joint, sign, and two times, (M,) each.
    brackets: list[tuple[np.ndarray, ...]] = []
    u = np.linspace(0, 1, _SAMPLES_PER_PIECE)
    # The only piece of a motion of one state has no width, and no inside.
    for kind in pieces.kinds if pieces.width.all() else ():
        c = pieces.polynomials[kind]
        bernstein = bernstein_coefficients(c)
        for sign in SIGNS:
            # Discard polynomials that cannot reach the floor: their Bernstein coefficients stay below it.
            least = floor(pieces, kind, sign)
            i, j = np.nonzero((sign * bernstein).max(axis=0) > least)
            if i.size == 0:
                continue
            # The others are sampled evenly: signed values and slopes by u, (17, number of polynomials).
            candidates = c[:, i, j]
            derivatives = candidates[:-1] * np.arange(len(c) - 1, 0, -1)[:, None]
            y, slope = (sign * evaluate_polynomials(x, u[:, None]) for x in (candidates, derivatives))
            # A maximum lies between two samples where the slope passes from above 0 to 0 or below.
            has_peak = (slope[:-1] > 0) & (slope[1:] <= 0)
            # A curve that bends one way lies below the tangents at two samples: where both end below the floor at the
            # other sample, so does the peak. The higher end counts, which leaves room where the curve bends both ways.
            tangents = np.maximum(
                y[:-1] + slope[:-1] / (_SAMPLES_PER_PIECE - 1), y[1:] - slope[1:] / (_SAMPLES_PER_PIECE - 1)
            )
            has_peak &= tangents > least[i, j]
            # A peak rises above its samples by less than the fall of the slope times their distance. Where that is
            # rounding alone, the polynomial is flat, and its ends are as high.
            has_peak &= (slope[:-1] - slope[1:]) / _SAMPLES_PER_PIECE > _MIN_PEAK_HEIGHT * np.abs(y).max(axis=0)
            # Brackets in time are one sample wider on both sides: the polynomial may misplace the peak.
            sample, candidate = np.nonzero(has_peak)
            start, width = pieces.start[i[candidate]], pieces.width[i[candidate], 0]
            low, high = (u[end.clip(0, _SAMPLES_PER_PIECE - 1)] * width + start for end in (sample - 1, sample + 2))
            # At a break the value at the last time of this piece is that of the next one: brackets end just before.
            high = np.minimum(high, np.nextafter(pieces.stop[i[candidate]], start))
            count = len(candidate)
            brackets.append((np.full(count, kind), j[candidate], np.full(count, sign), low, high))
    if len(brackets) == 0:
        no_kinds, no_joints, no_times = (np.array([], dtype=dtype) for dtype in (str, int, float))
        return Peaks(no_kinds, no_joints, no_joints, no_times, no_times)
    return _place_peaks(b, *(np.concatenate(column) for column in zip(*brackets, strict=True)))


def _place_peaks(
    b: LimitedMotion, kind: np.ndarray, joint: np.ndarray, sign: np.ndarray, low: np.ndarray, high: np.ndarray
) -> Peaks:
    """Find the exact extremes, each between two times.

    An extreme is the zero of the derivative where that is known and changes its sign, else the best of ever finer
    grids.
    """
    if kind.size == 0:
        return Peaks(kind, joint, sign, low, low)
    # A channel knows the derivative of what a kind bounds if it has one rate more than that: one time shows it.
    channels = b.select_kinds(set(kind.tolist())).channels(low[:1])
    by_slope = np.array([len(channels[k].rates) > LIMIT_KINDS[k].derivative + 1 for k in kind.tolist()])
    t, places = np.empty(len(low)), np.flatnonzero(by_slope)
    if places.size > 0:

        def slope(t: np.ndarray, place: np.ndarray) -> np.ndarray:
            return sign[place] * pick_values(b, t, kind[place], joint[place], 1)

        # Where the exact derivative does not change its sign, as the polynomial's does, it has no zero to be found.
        ends = np.stack([slope(end[places], places) for end in (low, high)])
        crosses = ends[0] * ends[1] <= 0
        by_slope[places[~crosses]] = False
        places = places[crosses]
        # The functions are numbered by the brackets that cross: `places` leads back to all brackets.
        t[places] = find_roots(lambda t, i: slope(t, places[i]), low[places], high[places], ends[:, crosses])
    if not by_slope.all():

        def height(t: np.ndarray) -> np.ndarray:
            # Each bracket has G times of a grid (M, G): the exact values of all are evaluated in one call, (M G,).
            repeated_kind, repeated_joint = (np.repeat(column[~by_slope], t.shape[1]) for column in (kind, joint))
            values = pick_values(b, t.ravel(), repeated_kind, repeated_joint, 0)
            return sign[~by_slope, None] * values.reshape(t.shape)

        t[~by_slope] = find_maxima(height, low[~by_slope], high[~by_slope])
    return Peaks(kind, joint, sign, t, pick_values(b, t, kind, joint, 0))


def pick_values(b: LimitedMotion, t: np.ndarray, kind: np.ndarray, joint: np.ndarray, derivative: int) -> np.ndarray:
    """Evaluate what limits bound, of one column at each time.

    Each time has its kind and joint. `derivative` is 0 for the value, 1 for its rate.
    """
    values = np.empty(len(t))
    # The states at all times are evaluated once, for all kinds that occur; each time then picks its column.
    for name, channel in b.select_kinds(set(kind.tolist())).channels(t).items():
        rows = np.flatnonzero(kind == name)
        values[rows] = channel.rates[LIMIT_KINDS[name].derivative + derivative][rows, joint[rows]]
    return values


# Measured motions: values with deviations.
DECISIVE_DEVIATIONS = 2.0  # between a value and its limit: 95 % of normal errors are smaller
_UNCERTAIN_TIMES_AT_ONCE = 20_000  # times judged together, which bounds working memory
_VALUES_AT_ONCE = 2000  # times evaluated together


def judge_samples(b: LimitedMotion, worst: Worst) -> Spans:
    """Judge a measured motion, and return where limits are undecided.

    The worst values and the spans in which the motion is broken go into `worst`.
    """
    undecided: Spans = {}
    for t, values in sample_values(b):
        judge_values(b, worst, t, values, undecided)
    return undecided


def sample_values(b: LimitedMotion) -> Iterator[tuple[np.ndarray, dict[str, np.ndarray]]]:
    """Yield times along all the motion and the values there.

    The times (N,) are those of the pieces and of the peaks between them. They come part by part, with values by kind;
    breaks come twice, once for each side.
    """
    for t in _overlapping_parts(_collect_times(b)):
        yield from take_sides(b, t)


def take_sides(b: LimitedMotion, t: np.ndarray) -> Iterator[tuple[np.ndarray, dict[str, np.ndarray]]]:
    """Yield times (N,) with the values on both sides of breaks.

    First come the breaks among the times, with what ends there, then all times, with what begins there.
    """
    jumps = np.intersect1d(t, [motion_break.t for motion_break in b.motion.breaks_to(b.rate_order)])
    if jumps.size:
        yield jumps, b.values(jumps, "left")
    yield t, _values_in_blocks(b, t)


def judge_values(
    b: LimitedMotion, worst: Worst, t: np.ndarray, values: Mapping[str, np.ndarray], undecided: Spans
) -> None:
    """Judge values at times (N,), and add undecided spans.

    The values are (N, joints), by kind.
    """
    # Commands are held for a while after the motion, with the deviations of its end.
    deviations = compute_deviations(b, t.clip(*b.whole))
    for kind in b.kinds:
        # Kinds without deviations are exact.
        unclear = _judge_kind(worst, kind, t, values[kind], deviations.get(kind, np.zeros_like(values[kind])))
        for j in np.flatnonzero(unclear.any(axis=0)).tolist():
            # A span reaches from the last time before at which the value is decided to the first one after.
            spans = [(float(t[max(i - 1, 0)]), float(t[min(k + 1, len(t) - 1)])) for i, k in find_runs(unclear[:, j])]
            undecided[kind, j] = undecided.get((kind, j), []) + spans


def _judge_kind(worst: Worst, kind: str, t: np.ndarray, values: np.ndarray, deviations: np.ndarray) -> np.ndarray:
    """Add values to the worst, and return which are undecided.

    Values and their standard deviations are (N, joints). A value is undecided that is neither surely kept on both
    sides nor surely broken on one.
    """
    start, stop = worst.b.window(kind)
    inside = ((t >= start) & (t <= stop))[:, None]
    unclear, broken = (np.zeros(values.shape, dtype=bool) for _ in range(2))
    for sign in SIGNS:
        # A deviation that is not known is NaN, which makes both comparisons false: the value is undecided.
        excess = sign * values - worst.b.scales[kind].tolerant(sign)
        beyond, within = excess > DECISIVE_DEVIATIONS * deviations, excess <= -DECISIVE_DEVIATIONS * deviations
        # Outside of the window deviations are large: a value there counts as the worst one only where it is decided.
        shown = np.where(inside | beyond | within, sign * values, -np.inf)
        worst.take_values(kind, sign, t, shown, beyond)
        # A side without a bound is kept, even if the deviation is not known.
        unclear |= ~(beyond | within) & np.isfinite(worst.b.scales[kind].bound(sign))
        broken |= beyond
    # A value that is surely beyond one bound is broken, even if it is not known whether it keeps the other one.
    return unclear & ~broken


def _overlapping_parts(t: np.ndarray) -> Iterator[np.ndarray]:
    """Yield parts of times that share their ends.

    Each begins with the last time of the one before. Spans of two parts meet at the shared time, and a check joins them
    later.
    """
    for start in range(0, max(1, len(t) - 1), _UNCERTAIN_TIMES_AT_ONCE - 1):
        yield t[start : start + _UNCERTAIN_TIMES_AT_ONCE]


def _collect_times(b: LimitedMotion) -> np.ndarray:
    """Return the times of the pieces and of their peaks."""
    # Windows do not count: samples are judged by their deviations, along all the motion.
    times = [np.array(b.whole)]
    for pieces in split_part(b, b.whole):
        times += [pieces.start, pieces.stop, find_peaks(b, pieces, partial(_any_peak, b)).t]
    return np.unique(np.concatenate(times))


def _any_peak(b: LimitedMotion, pieces: Pieces, kind: str, sign: int) -> np.ndarray:
    """Return a floor that is just above both ends of each piece.

    Sides without a bound have no peaks.
    """
    scale = b.scales[kind]
    ends = np.maximum(sign * pieces.left[kind], sign * pieces.right[kind])
    # What infinite bounds make of the first case does not count.
    with np.errstate(invalid="ignore"):
        return np.where(np.isfinite(scale.bound(sign)), ends + LIMIT_TOLERANCE * np.abs(scale.reach(sign)), np.inf)


def _values_in_blocks(b: LimitedMotion, t: np.ndarray) -> dict[str, np.ndarray]:
    """Evaluate what limits bound at times (N,), in blocks.

    Blocks bound working memory.
    """
    blocks = [b.values(t[i : i + _VALUES_AT_ONCE]) for i in range(0, len(t), _VALUES_AT_ONCE)]
    return {kind: np.concatenate([block[kind] for block in blocks]) for kind in b.kinds}
