"""Angles that wrap: encoders that count to the end of a turn, 360 degrees or pi, and begin again at its start.

A step from row to row is a wrap where it is whole turns to within what the joint moves from row to row next to it.
Prismatic joints do not wrap. Whole turns of 2 pi rad are all that is taken off: other periods are refused by name.
"""

from dataclasses import dataclass

import numpy as np

from jounce.core.cures import Remedy
from jounce.core.errors import JounceError, join_names, quote_value
from jounce.model import coordinates, positions
from jounce.model.mechanism import Mechanism
from jounce.motion import smoothness, units

TURN = 2 * np.pi
MAX_OFF_TURNS = 0.1  # rad, by which a wrap at rest may miss whole turns: noise and coarse encoders, no step of a motion
NOISE_TO_SCATTER = 4.0  # times the median change of steps, which white noise passes once in 300,000 rows
MAX_DOUBT = TURN / 8  # by which it may where the steps next to it differ: more would let any jump pass for a wrap
NEIGHBOURS = 2  # steps on either side that show how a joint moves
MIN_PERIOD_SHARE = 0.9  # of the range of all angles, that a wrap at another period passes: what is left moves on
MOVING_ROWS = 8  # on either side of a jump that show in which direction the joint moves,
MIN_MOVING_STEPS = 3  # where as many of them change its angle: an encoder at rest flickers by one step
MIN_NET_SHARE = 0.8  # and all of them together lead as far: noise leads back and forth
MIN_UNKNOWN_SPEED = 20.0  # rad/s: without a stated limit no joint jumps faster of itself
RADIANS_CURE = "numpy.deg2rad makes rad of them"
UNWRAP_CURE = Remedy("unwrap=True takes the turns off", "--unwrap takes the turns off")


@dataclass(frozen=True, eq=False)
class Turning:
    """What is known of positions (N, k): their names, which are angles (k,), how fast they may be, their limits."""

    names: tuple[str, ...]
    turns: np.ndarray
    fastest: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    cure_of_degrees: Remedy | str

    @staticmethod
    def of_robot(mechanism: Mechanism) -> "Turning":
        """Of the positions of a robot: joints of several screws do not turn by one number."""
        single, leading = positions.single_positions(mechanism), coordinates.leading_joints(mechanism)
        revolute = np.array([unit == "rad" for unit in coordinates.units(mechanism)])
        limit = mechanism.limits.velocity[leading]
        speed = np.where(np.isfinite(limit) & (limit > 0), units.MAX_SPEED_TO_LIMIT * limit, MIN_UNKNOWN_SPEED)
        joint = np.asarray(single).argmax(axis=0)  # of each position
        alone = np.asarray(single).any(axis=0)
        lower, upper = mechanism.limits.lower[leading][joint], mechanism.limits.upper[leading][joint]
        return Turning(
            tuple(positions.names(mechanism)),
            alone & revolute[joint],
            speed[joint],
            lower,
            upper,
            units.ANGLES_OPTION_CURE,
        )

    @staticmethod
    def of_columns(names: tuple[str, ...]) -> "Turning":
        """Of columns whose robot is not known."""
        count = len(names)
        free = np.full(count, np.inf)
        return Turning(names, np.ones(count, bool), np.full(count, MIN_UNKNOWN_SPEED), -free, free, RADIANS_CURE)


def without_turns(apart: np.ndarray, turns: np.ndarray) -> np.ndarray:
    """Changes (..., n) of positions less the whole turns in them, where these are angles (n,)."""
    return apart - np.where(turns, TURN * np.round(apart / TURN), 0.0)


def refuse_wraps(t: np.ndarray, q: np.ndarray, joints: Turning, place: str) -> None:
    """Raise `JounceError` where positions q (N, k) at times t wrap, at any period, faster than joints may move."""
    steps = _large_steps(q, joints)
    if steps is None or len(t) < smoothness.MIN_JUDGED_SAMPLES:
        return
    fast = _are_fast(t, steps, joints)
    wraps = _find_wraps(t, steps, joints.turns) & fast
    if wraps.any():
        i, j = map(int, np.argwhere(wraps)[0])
        came = f"joint {quote_value(joints.names[j])} wraps {_describe_step(t, q, i, j)}"
        counts = _count_wraps(wraps, joints.names)
        raise JounceError(f"{place}: {came}, whole turns but for its motion; {counts}; {UNWRAP_CURE}")
    _refuse_other_periods(t, q, steps, fast, joints, place)


def unwrap(t: np.ndarray, q: np.ndarray, joints: Turning, place: str) -> tuple[np.ndarray, tuple[str, ...]]:
    """Positions q (N, k) at times t without their wraps, and notes of it; `JounceError` for wraps at other periods.

    Angles go on from their first rows. Those that leave the stated limits are moved by the turns that keep them there.
    """
    notes = []
    steps = _large_steps(q, joints)
    if steps is not None:
        wraps = _find_wraps(t, steps, joints.turns)
        _refuse_other_periods(t, q, steps, _are_fast(t, steps, joints) & ~wraps, joints, place)
        turned = np.cumsum(np.round(steps / TURN) * wraps, axis=0)
        q = np.concatenate([q[:1], q[1:] - TURN * turned])
        if wraps.any():
            notes.append(f"{_count_wraps(wraps, joints.names)}: turns are counted from the first row on")
    whole = _turns_to_limits(q, joints)
    if whole.any():
        moved = [f"{joints.names[j]} by {whole[j]:+.0f}" for j in np.flatnonzero(whole)]
        notes.append(f"angles are moved by whole turns to within their limits: {join_names(moved)}")
    return q + TURN * whole, tuple(notes)


@np.errstate(over="ignore", invalid="ignore")  # absurd positions are refused later
def _large_steps(q: np.ndarray, joints: Turning) -> np.ndarray | None:
    """The steps (N - 1, k) of positions from row to row, 0 of those that are not angles; None if none can be a wrap."""
    if len(q) <= NEIGHBOURS or not joints.turns.any():
        return None
    steps = np.diff(q, axis=0)
    large = max(steps.max(), -steps.min()) > MAX_OFF_TURNS  # as in few tables
    return np.where(joints.turns, steps, 0.0) if large else None


def _are_fast(t: np.ndarray, steps: np.ndarray, joints: Turning) -> np.ndarray:
    """Which steps (N - 1, k) are faster than their joints may move."""
    return np.asarray(np.abs(steps) > joints.fastest * np.diff(t)[:, None])


def _find_wraps(t: np.ndarray, steps: np.ndarray, turns: np.ndarray) -> np.ndarray:
    """Which steps (N - 1, k) are whole turns but for what the joint moves next to them."""
    rest = without_turns(steps, turns)
    whole = np.round((steps - rest) / TURN)
    if not whole.any():
        return np.zeros(steps.shape, bool)
    least, most = _bound_steps(np.diff(t)[:, None], rest, whole)
    scatter = np.median(np.abs(np.diff(rest, axis=0)), axis=0)
    margin = np.minimum(MAX_OFF_TURNS + (most - least) + NOISE_TO_SCATTER * scatter, MAX_DOUBT)

    def is_expected(step: np.ndarray) -> np.ndarray:
        return (step >= least - margin) & (step <= most + margin)

    # turns in the same direction one after the other are a joint that is sampled too seldom
    goes_on = (whole * _shifted(whole, -1, 0.0) > 0) | (whole * _shifted(whole, 1, 0.0) > 0)
    return np.asarray((whole != 0) & ~goes_on & is_expected(rest) & ~is_expected(steps))


def _bound_steps(apart: np.ndarray, rest: np.ndarray, whole: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The least and the largest step (N - 1, k) that the speeds next to each would make in the times apart (N - 1, 1).

    Steps less their turns are `rest`. Those next to a step count that have no turn, or as many as it: these jump back
    and forth by noise at the end of a turn.
    """
    least, most = np.full(rest.shape, np.inf), np.full(rest.shape, -np.inf)
    for k in (*range(-NEIGHBOURS, 0), *range(1, NEIGHBOURS + 1)):
        speed, turned = _shifted(rest / apart, k, np.nan), np.abs(_shifted(whole, k, np.nan))
        counts = (turned == 0) | (turned == np.abs(whole))
        least = np.minimum(least, np.where(counts, speed * apart, np.inf))
        most = np.maximum(most, np.where(counts, speed * apart, -np.inf))
    return least, most


def _shifted(x: np.ndarray, k: int, fill: float) -> np.ndarray:
    """The rows (N, n) that come k rows later."""
    moved = np.full(x.shape, fill)
    if k > 0:
        moved[:-k] = x[k:]
    else:
        moved[-k:] = x[:k]
    return moved


def _refuse_other_periods(
    t: np.ndarray, q: np.ndarray, steps: np.ndarray, fast: np.ndarray, joints: Turning, place: str
) -> None:
    """Raise `JounceError` where a joint jumps against its motion, from one end of all its angles to the other.

    So do encoders at the end of their range, and counters that are reset; steps of a motion and wild rows do not.
    """
    for j in np.flatnonzero(fast.any(axis=0)).tolist():
        jumps = fast[:, j] & (np.abs(steps[:, j]) >= MIN_PERIOD_SHARE * np.ptp(q[:, j]))
        places = np.flatnonzero(jumps).tolist()
        against = [i for i in places if _is_alone(jumps, i) and _moves_against(steps[:, j], i)]
        if not against:
            continue
        i, period = against[0], float(np.median(np.abs(steps[jumps, j])))
        came = f"joint {quote_value(joints.names[j])} jumps against its motion {_describe_step(t, q, i, j)}"
        if abs(period * units.ANGLE_UNITS["deg"] - TURN) < MAX_OFF_TURNS:
            raise JounceError(f"{place}: {came}, a turn in degrees; {joints.cure_of_degrees}")
        what = f"as at the end of a range, which is not 2 pi but {period:.4g}"
        raise JounceError(f"{place}: {came}, {what}; unwrap it at the period of its encoder before, or split the log")


def _is_alone(jumps: np.ndarray, i: int) -> bool:
    """Whether the i-th step (N,) is the only jump among those next to it: others show how the joint moves there."""
    return int(jumps[max(0, i - MOVING_ROWS) : i + 1 + MOVING_ROWS].sum()) == 1


def _moves_against(steps: np.ndarray, i: int) -> bool:
    """Whether a joint moves before and after the i-th step (N,) in the other direction than by it."""
    before, after = steps[max(0, i - MOVING_ROWS) : i], steps[i + 1 : i + 1 + MOVING_ROWS]
    return _direction(before) == _direction(after) == -np.sign(steps[i])


def _direction(steps: np.ndarray) -> int:
    """In which direction, 1 or -1, a joint moves by most of some steps; 0 if it rests, or its noise hides that."""
    net, way = steps.sum(), np.abs(steps).sum()
    if np.count_nonzero(steps) < MIN_MOVING_STEPS or abs(net) < MIN_NET_SHARE * way:
        return 0
    return int(np.sign(net))


def _describe_step(t: np.ndarray, q: np.ndarray, i: int, j: int) -> str:
    return f"from {q[i, j]:.4g} to {q[i + 1, j]:.4g} at t = {t[i + 1]:.9g} s, row {i + 1} from 0"


def _count_wraps(wraps: np.ndarray, names: tuple[str, ...]) -> str:
    counts = wraps.sum(axis=0)
    each = (f"{names[j]} {counts[j]} time{'s' * int(counts[j] > 1)}" for j in np.flatnonzero(counts))
    return f"angles wrap: {join_names(each)}"


def _turns_to_limits(q: np.ndarray, joints: Turning) -> np.ndarray:
    """By how many turns (k,) angles are to be moved that are beyond their limits, and then are within them."""
    low, high = q.min(axis=0), q.max(axis=0)
    bounded = joints.turns & np.isfinite(joints.lower) & np.isfinite(joints.upper)
    lower, upper = (np.where(bounded, bound, 0.0) for bound in (joints.lower, joints.upper))
    slack = units.MAX_OUT_OF_RANGE * (upper - lower)
    beyond = (low < lower - slack) | (high > upper + slack)
    whole = np.round((lower + upper - low - high) / (2 * TURN))
    fits = (low + TURN * whole >= lower - slack) & (high + TURN * whole <= upper + slack)
    return np.where(bounded & beyond & fits, whole, 0.0)
