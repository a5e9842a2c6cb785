"""The worst value of every limit along a motion, and when limits are broken, gathered piece by piece."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from jounce.engine.along import ForceBreak
from jounce.limits.joints import drop_base, quantity_columns, scatter_columns
from jounce.limits.limited_motion import LimitedMotion
from jounce.limits.motion_polynomials import MIN_SHARE_OF_LIMIT, PIECE_TOLERANCE, Pieces, bernstein_coefficients
from jounce.limits.peaks import Peaks, find_peaks, pick_values
from jounce.limits.ratios import LIMIT_TOLERANCE, SIGNS
from jounce.limits.root_finding import find_roots
from jounce.model.limit_kinds import LIMIT_KINDS, MOTION_KINDS
from jounce.model.positions import multiscrew_joints
from jounce.motion.channel import Span
from jounce.motion.motion import Break

Spans = dict[tuple[str, int], list[Span]]  # by kind and joint


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
                above = {kind: k for k, kind in enumerate(MOTION_KINDS[found.order + 1 :])}
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
        several = next((x for x in multiscrew_joints(b.robot.mechanism.tree).values() if own in x.names), None)
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


def find_runs(which: np.ndarray) -> list[tuple[int, int]]:
    """The first and the last index of each run of true entries."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], which, [False]])))
    return [(int(first), int(behind) - 1) for first, behind in edges.reshape(-1, 2)]


class _Crossing(NamedTuple):
    kind: str
    joint: int
    sign: int
    bound: float
    edges: np.ndarray  # (edges, 2), times
    excess: np.ndarray  # (edges, 2), of signed values over the bound at these times
