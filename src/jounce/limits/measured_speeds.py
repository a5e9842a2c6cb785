"""The largest factor of speed at which a measured motion surely keeps its limits.

Problem: the largest c at which `uncertain_spans` finds every value within its bound by two standard deviations. Rates
and their deviations fall with powers of c, forces at rest do not.

Algorithm: values at some times bracket c, by factors of two, and bisection follows. A judgement along all the motion at
this c yields the times at which limits are not surely kept, and these are added until no more appear: an exchange
method, as in `slowdown`, whose costly step is taken two or three times.

A limit that is not surely kept even at a thousandth of the speed, such as that of a position at its bound, is
undecided at every speed: it may not be surely broken, and all others are surely kept. `JounceError` where one is surely
broken at every speed.
"""

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from jounce.core.errors import JounceError, join_names, quote_value
from jounce.limits.check import SAMPLES_CAUSE
from jounce.limits.deviations import Deviations, compute_deviations
from jounce.limits.factor_search import Place
from jounce.limits.limited_motion import LimitedMotion
from jounce.limits.ratios import SIGNS
from jounce.limits.uncertain_spans import DECISIVE_DEVIATIONS, sample_values, take_sides
from jounce.limits.verdicts import Check

_FIRST_SURE_TIMES = 200  # that bracket the factor first: those of the peaks follow
_MIN_FACTOR, _MAX_FACTOR = 1e-3, 1000.0  # times the given speed: no motion is meant to be slower or faster
_SURE_BISECTIONS = 20  # of a factor between its half and itself: to 1e-6 of it
_FACTOR_MARGIN = 1e-6  # of a factor, far below its deviation: peaks lie elsewhere at every speed
_MAX_SURE_ROUNDS = 20  # of times that are added: logs take two or three

Limit = tuple[str, int]  # kind and joint


class SureFactor(NamedTuple):
    """The largest factor, infinite if nothing bounds the speed, and the first limit that a larger one leaves open."""

    factor: float
    place: Place | None


@dataclass(frozen=True)
class _Excess:
    """How far a value with its deviations is beyond a bound, in shares of it, and when in the given motion."""

    share: float
    t: float


def find_sure_factor(b: LimitedMotion) -> SureFactor:
    """The largest factor of those tried at which every limit that a speed decides is surely kept."""
    times = b.motion.times
    t = times[np.unique(np.linspace(0, len(times) - 1, min(len(times), _FIRST_SURE_TIMES)).astype(int))]
    high = 1.0
    for _ in range(_MAX_SURE_ROUNDS):
        still = find_open_limits(b, t)
        factor, place = _bracket(b, t, still, high)
        beyond = _select_beyond(find_excess(b, factor, still=still))
        if not beyond:
            return SureFactor(np.inf if factor >= _MAX_FACTOR else factor, place)
        t, high = np.union1d(t, [found.t for found in beyond.values()]), factor
    raise JounceError(
        f"no factor of speed down to {factor:.3g} surely keeps the limits; samples with less noise, or with_limits"
    )


def find_open_limits(b: LimitedMotion, t: np.ndarray) -> frozenset[Limit]:
    """The limits that are undecided at every speed at some of the times (N,).

    Raises where one is surely broken at every speed.
    """
    open_limits = frozenset(_select_beyond(find_excess(b, _MIN_FACTOR, t)))
    if broken := _select_beyond(find_excess(b, _MIN_FACTOR, t, open_limits)):
        (kind, j), found = next(iter(broken.items()))
        what = f"the {kind.replace('_', ' ')} of joint {quote_value(b.name(kind, j))}"
        raise JounceError(
            f"{what} is beyond its limit by more than two standard deviations at t = {found.t:.6g} s, at every speed;"
            " change the motion or with_limits"
        )
    return open_limits


def widen(kind: str, sign: int, off: Deviations, still: Collection[Limit], joints: int) -> np.ndarray:
    """What is added to values (N, joints) of a kind before they are compared: two deviations towards the bound.

    Away from it for limits that are `still` undecided at every speed.
    """
    ways = np.array([-sign if (kind, j) in still else sign for j in range(joints)])
    return np.asarray(ways * DECISIVE_DEVIATIONS * off.get(kind, np.zeros((1, joints))))


def find_excess(
    b: LimitedMotion, factor: float, t: np.ndarray | None = None, still: Collection[Limit] = ()
) -> Mapping[Limit, _Excess]:
    """The largest excess of each limit at a factor of speed, along all the motion or at times (N,) in the given one."""
    scaled, found = b.scaled(1 / factor), dict[Limit, _Excess]()
    parts: Iterable[tuple[np.ndarray, Mapping[str, np.ndarray]]]
    parts = sample_values(scaled) if t is None else take_sides(scaled, b.motion.start + (t - b.motion.start) / factor)
    for at, values in parts:
        off = compute_deviations(scaled, at.clip(*scaled.whole))
        for kind in scaled.kinds:
            for sign in SIGNS:
                shares = _shares_beyond(scaled, kind, sign, values[kind], off, still)
                worst = shares.argmax(axis=0)
                for j in np.flatnonzero(np.isfinite(scaled.scales[kind].bound(sign))).tolist():
                    share = float(shares[worst[j], j])
                    if share > found.get((kind, j), _Excess(-np.inf, 0)).share:
                        found[kind, j] = _Excess(share, float(b.given_times(at[worst[j]], factor)))
    return found


def _shares_beyond(
    b: LimitedMotion, kind: str, sign: int, values: np.ndarray, off: Deviations, still: Collection[Limit]
) -> np.ndarray:
    """(N, joints): how far values with their deviations are beyond the bounds, in shares of these; above 0 if so."""
    scale = b.scales[kind]
    excess = sign * (values + widen(kind, sign, off, still, len(b.joints))) - scale.tolerant(sign)
    unknown = [-np.inf if (kind, j) in still else np.inf for j in range(len(b.joints))]
    reach = np.abs(scale.reach(sign))  # infinite where nothing bounds a joint
    of = np.where((reach > 0) & np.isfinite(reach), reach, 1.0)
    return np.asarray(np.where(np.isnan(excess), unknown, excess) / of)


def _select_beyond(excess: Mapping[Limit, _Excess]) -> dict[Limit, _Excess]:
    """Those above 0, the largest one first."""
    found = sorted(excess.items(), key=lambda item: -item[1].share)
    return {limit: of for limit, of in found if of.share > 0}


def _bracket(b: LimitedMotion, t: np.ndarray, still: frozenset[Limit], high: float) -> tuple[float, Place | None]:
    """The largest factor at which values at times (N,) surely keep limits, and the limit that a larger one leaves."""
    beyond = _select_beyond(find_excess(b, high, t, still))
    # Rise until a limit is not surely kept, or fall until all are.
    low = high
    while not beyond and high < _MAX_FACTOR:
        low, high = high, min(2 * high, _MAX_FACTOR)
        beyond = _select_beyond(find_excess(b, high, t, still))
    if not beyond:
        return high, None
    while low == high or _select_beyond(find_excess(b, low, t, still)):
        high, low = low, low / 2
    beyond = _select_beyond(find_excess(b, high, t, still)) or beyond
    for _ in range(_SURE_BISECTIONS):
        middle = (low + high) / 2
        found = _select_beyond(find_excess(b, middle, t, still))
        low, high, beyond = (low, middle, found) if found else (middle, high, beyond)
    (kind, j), worst = next(iter(beyond.items()))
    return low * (1 - _FACTOR_MARGIN), (kind, j, worst.t)


def describe_open_limits(found: Check) -> tuple[str, ...]:
    """Which limits a motion that was made slower or retimed still leaves undecided for its samples, or breaks."""
    rows = [row for row in found.table if row.violations or (row.undecided and row.cause == SAMPLES_CAUSE)]
    names = []
    for row in rows:
        start, stop = (row.violations or row.undecided)[0]
        what = f"{row.limit.replace('_', ' ')} of {row.joint} at t = {start:.6g} to {stop:.6g} s of the result"
        names.append(f"{what} is {row.verdict}")
    return (f"not every limit is surely kept: {join_names(names)}",) if names else ()
