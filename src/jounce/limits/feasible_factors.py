"""Which factors of speed break a limit, at states of a motion: intervals between roots of polynomials in the factor."""

import numpy as np

from jounce.core.cures import Remedy
from jounce.core.errors import JounceError, quote_value
from jounce.limits.joints import joint_units
from jounce.limits.limited_motion import LimitedMotion
from jounce.limits.motion_polynomials import split_part, split_windows
from jounce.limits.ratios import SIGNS
from jounce.limits.speed_polynomials import Polynomials, polynomials, positive_roots
from jounce.model.limit_kinds import LIMIT_KINDS

_ZERO_BOUND_STAND_IN = 1e-300  # in the place of a bound of 0: roots divide by it
_NEAR_MISS_RATIO = 0.98  # to a limit: where samples come as near, values between them may break it
_NEAR_MISS_FACTORS = 128  # even factors of speed, among which the nearest approaches are sought
_FIRST_STATES = 400  # states whose roots bound the factor first, so that few of the others need roots


class Feasible:
    """The states of a motion, as far as added, and the open intervals of factors at which they break limits.

    `start` and `stop` (M,) are the intervals; `kind`, `joint` and `t` (M,) say which limit is broken, and when.
    """

    def __init__(self, b: LimitedMotion) -> None:
        self.b = b
        self.start = self.stop = self.t = np.empty(0)
        self.kind = np.empty(0, dtype=str)
        self.joint = np.empty(0, dtype=int)
        self.states: list[Polynomials] = []  # polynomials by kind
        parts = sample_states(b)
        stride = max(1, sum(len(times) for times, _ in parts) // _FIRST_STATES)
        for which in (np.equal, np.not_equal):  # some states first, which bound the others
            for times, states in parts:
                some = which(np.arange(len(times)) % stride, 0)
                self._add_states({kind: c[:, some] for kind, c in states.items()}, times[some])

    def add(self, t: np.ndarray) -> None:
        """Add the states at some times, (N,)."""
        for part, (start, stop) in split_windows(self.b):
            some = t[(start <= t) & (t <= stop)]
            if some.size:
                found = polynomials(part, some)
                refuse_static(part, found, some)
                self._add_states(found, some)

    def _add_states(self, states: Polynomials, t: np.ndarray) -> None:
        self.states.append(states)
        highest = float(self.start[np.isinf(self.stop)].min(initial=np.inf))  # from it on, some state breaks a limit
        for kind, c in states.items():
            if kind == "position":
                continue
            for sign in SIGNS:
                self._add_roots(kind, sign, c, t, highest)

    @property
    def first(self) -> int:
        """The interval that begins first."""
        return int(self.start.argmin())

    @property
    def factor(self) -> float:
        """The largest factor below which no state breaks a limit; infinite if none ever does."""
        return float(self.start.min(initial=np.inf))

    @property
    def largest(self) -> float:
        """The largest factor at which no state breaks a limit."""
        order = np.argsort(self.start)
        start, stop = self.start[order], self.stop[order]
        covered = np.maximum.accumulate(stop)
        gaps = np.flatnonzero(start[1:] >= covered[:-1])
        return float(start[gaps[-1] + 1] if gaps.size else start[0])

    def near_misses(self, factor: float) -> np.ndarray:
        """The factors below one at which states come nearest to a limit and recede from it again."""
        c = np.linspace(0, factor, _NEAR_MISS_FACTORS + 1)
        found = []
        for kind in self.b.kinds:
            if LIMIT_KINDS[kind].of == "q":
                continue  # which grows with the speed alone
            for sign in SIGNS:
                scale = self.b.scales[kind]
                highest = np.full((len(c), len(self.b.joints)), -np.inf)
                for f in (state[kind] for state in self.states if kind in state):
                    most = sum(np.abs(x) * factor**k for k, x in enumerate(f))
                    rows = np.flatnonzero((scale.ratio(sign * most, sign) > _NEAR_MISS_RATIO).any(axis=1))
                    if rows.size:
                        values = sum(x[rows] * c[:, None, None] ** k for k, x in enumerate(f))
                        highest = np.maximum(highest, scale.ratio(values, sign).max(axis=1))
                inner = (
                    (highest[1:-1] >= highest[:-2]) & (highest[1:-1] > highest[2:]) & (highest[1:-1] > _NEAR_MISS_RATIO)
                )
                found.append(c[1:-1][inner.any(axis=1)])
        return np.unique(np.concatenate(found)) if found else np.empty(0)

    def _add_roots(self, kind: str, sign: int, c: np.ndarray, t: np.ndarray, highest: float) -> None:
        bound = self.b.scales[kind].bound(sign)
        finite = np.flatnonzero(np.isfinite(bound))
        f = sign * c[:, :, finite]
        f[0] -= bound[finite]
        most = min(highest, 1e9)
        reach = sum(np.abs(x) * most**k for k, x in enumerate(f[1:], start=1))
        i, j = np.nonzero((reach > -f[0]) & (f[1:] != 0).any(axis=0))
        if not i.size:
            return
        roots = positive_roots(
            np.minimum(f[:, i, j], np.where(np.arange(len(f)) > 0, np.inf, -_ZERO_BOUND_STAND_IN)[:, None])
        )
        degree = roots.shape[1]
        starts = roots[:, ::2]
        stops = np.concatenate([roots[:, 1::2], np.full((len(roots), degree % 2), np.inf)], axis=1)
        row, column = np.nonzero(np.isfinite(starts))
        self.start = np.append(self.start, starts[row, column])
        self.stop = np.append(self.stop, stops[row, column])
        self.t = np.append(self.t, t[i[row]])
        self.joint = np.append(self.joint, finite[j[row]])
        self.kind = np.append(self.kind, np.full(len(row), kind))


def refuse_static(b: LimitedMotion, found: Polynomials, t: np.ndarray) -> None:
    """Raise where a limit is broken at every speed: of a position, or of the effort or a motor at rest."""
    for kind in b.kinds:
        scale, value = b.scales[kind], found[kind][0]
        for sign in SIGNS:
            beyond = sign * value - scale.tolerant(sign)
            i, j = np.unravel_index(beyond.argmax(), beyond.shape)
            if beyond[i, j] > 0:
                raise _static_error(
                    b, kind, int(j), float(value[i, j]), sign * float(scale.bound(sign)[j]), float(t[i])
                )


def _static_error(b: LimitedMotion, kind: str, j: int, value: float, bound: float, t: float) -> JounceError:
    unit = LIMIT_KINDS[kind].unit(joint_units(b.robot.mechanism)[j])
    joint, when = f"joint {quote_value(b.name(kind, j))}", f"at t = {t:.6g} s"
    limit = Remedy(f"with_limits({kind}=...)", "its limit (--limits)")
    if kind == "position":
        limits = Remedy("with_limits(lower=..., upper=...)", "its limits (--limits)")
        return JounceError(
            f"{joint} is at {value:.6g} {unit} {when}, beyond its limit of {bound:.6g} {unit};"
            f" slowing down does not help: change the motion or {limits}"
        )
    if LIMIT_KINDS[kind].takes:
        what = kind.removeprefix("motor_")
        return JounceError(
            f"the motor of {joint} has a {what} of {value:.6g} {unit} at rest {when}, beyond its limit of {bound:.6g}"
            f" {unit}; slowing down does not help: change the pose, the load or {limit}"
        )
    of = " without gravity" if kind in b.limits.without_gravity else ""
    return JounceError(
        f"{joint} cannot hold itself up {when}: it takes {value:.6g} {unit}{of} at rest, and its limit is"
        f" {bound:.6g} {unit}; slowing down does not help: change the pose, the load or {limit}"
    )


def sample_states(b: LimitedMotion) -> list[tuple[np.ndarray, Polynomials]]:
    """The times of all pieces with the polynomials there, from the left too at breaks and at the end."""
    breaks = [found.t for found in b.motion.breaks_to(b.rate_order)]
    states: list[tuple[np.ndarray, Polynomials]] = []
    for part, span in split_windows(b):
        pieces = list(split_part(part, span))
        right, ends = (np.concatenate([getattr(some, side) for some in pieces]) for side in ("start", "stop"))
        left = np.append(ends[np.isin(ends, breaks)], ends[-1])
        times, of_left = np.concatenate([right, left]), polynomials(part, left, "left")
        found = {kind: np.concatenate([c, of_left[kind]], axis=1) for kind, c in polynomials(part, right).items()}
        refuse_static(part, found, times)
        states.append((times, found))
    return states
