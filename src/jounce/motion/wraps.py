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
UNWRAP_CURE = Remedy("unwrap=True removes the turns", "--unwrap removes the turns")


@dataclass(frozen=True, eq=False)
class Turning:
    """What is known of positions (N, k) that may wrap."""

    names: tuple[str, ...]
    turns: np.ndarray  # (k,), which are angles of their own
    fastest: np.ndarray  # (k,), rad/s, how fast they may be
    lower: np.ndarray  # (k,), limits
    upper: np.ndarray  # (k,)
    cure_of_degrees: Remedy | str

    @staticmethod
    def of_robot(mechanism: Mechanism) -> "Turning":
        """Return what is known of the positions of a robot.

        Joints of several screws do not turn by one number.
        """
        single, leading = positions.single_positions(mechanism), coordinates.leading_joints(mechanism)
        revolute = np.array([unit == "rad" for unit in coordinates.units(mechanism)])
        limit = mechanism.limits.velocity[leading]
        speed = np.where(np.isfinite(limit) & (limit > 0), units.MAX_SPEED_TO_LIMIT * limit, MIN_UNKNOWN_SPEED)
        # The joint of each position, and whether it is the joint's only one.
        joint = np.asarray(single).argmax(axis=0)
        is_single = np.asarray(single).any(axis=0)
        lower, upper = mechanism.limits.lower[leading][joint], mechanism.limits.upper[leading][joint]
        return Turning(
            tuple(positions.names(mechanism)),
            is_single & revolute[joint],
            speed[joint],
            lower,
            upper,
            units.ANGLES_OPTION_CURE,
        )

    @staticmethod
    def of_columns(names: tuple[str, ...]) -> "Turning":
        """Return what is known of columns whose robot is not known."""
        count = len(names)
        free = np.full(count, np.inf)
        return Turning(names, np.ones(count, bool), np.full(count, MIN_UNKNOWN_SPEED), -free, free, RADIANS_CURE)


def without_turns(changes: np.ndarray, turns: np.ndarray) -> np.ndarray:
    """Return changes (..., n) of positions less their whole turns.

    Only angles (n,) turn.
    """
    return changes - np.where(turns, TURN * np.round(changes / TURN), 0.0)


def refuse_wraps(t: np.ndarray, q: np.ndarray, joints: Turning, place: str) -> None:
    """Raise `JounceError` where positions wrap faster than joints may move.

    Positions are q (N, k) at times t; they may wrap at any period.
    """
    steps = _large_steps(q, joints)
    if steps is None or len(t) < smoothness.MIN_JUDGED_SAMPLES:
        return
    # A joint that may be as fast is not suspected: what looks like a wrap may be its motion.
    fast = _are_fast(t, steps, joints)
    wraps = _find_wraps(t, steps, joints.turns) & fast
    if wraps.any():
        i, j = map(int, np.argwhere(wraps)[0])
        came = f"joint {quote_value(joints.names[j])} wraps {_describe_step(t, q, i, j)}"
        counts = _count_wraps(wraps, joints.names)
        raise JounceError(f"{place}: {came}, whole turns but for its motion; {counts}; {UNWRAP_CURE}")
    _refuse_other_periods(t, q, steps, fast, joints, place)


def unwrap(t: np.ndarray, q: np.ndarray, joints: Turning, place: str) -> tuple[np.ndarray, tuple[str, ...]]:
    """Return positions without their wraps, and notes.

    Positions are q (N, k) at times t; `JounceError` for wraps at other periods. Angles go on from their first
    rows. Those that leave the stated limits are moved by the turns that keep them there.
    """
    notes = []
    steps = _large_steps(q, joints)
    if steps is not None:
        wraps = _find_wraps(t, steps, joints.turns)
        _refuse_other_periods(t, q, steps, _are_fast(t, steps, joints) & ~wraps, joints, place)
        # Turns add up from row to row: each wrap moves all rows behind it.
        turns = np.cumsum(np.round(steps / TURN) * wraps, axis=0)
        q = np.concatenate([q[:1], q[1:] - TURN * turns])
        if wraps.any():
            notes.append(f"{_count_wraps(wraps, joints.names)}: turns are counted from the first row on")
    whole = _turns_to_limits(q, joints)
    if whole.any():
        changes = [f"{joints.names[j]} by {whole[j]:+.0f}" for j in np.flatnonzero(whole)]
        notes.append(f"angles are moved by whole turns to within their limits: {join_names(changes)}")
    return q + TURN * whole, tuple(notes)


@np.errstate(over="ignore", invalid="ignore")  # absurd positions are refused later
def _large_steps(q: np.ndarray, joints: Turning) -> np.ndarray | None:
    """Return the steps (N - 1, k) from row to row.

    They are 0 of positions that are not angles; None if none can be a wrap.
    """
    if len(q) <= NEIGHBOURS or not joints.turns.any():
        return None
    steps = np.diff(q, axis=0)
    large = max(steps.max(), -steps.min()) > MAX_OFF_TURNS  # as in few tables
    return np.where(joints.turns, steps, 0.0) if large else None


def _are_fast(t: np.ndarray, steps: np.ndarray, joints: Turning) -> np.ndarray:
    """Return which steps (N - 1, k) joints cannot make by moving."""
    return np.asarray(np.abs(steps) > joints.fastest * np.diff(t)[:, None])


def _find_wraps(t: np.ndarray, steps: np.ndarray, turns: np.ndarray) -> np.ndarray:
    """Return which steps (N - 1, k) are whole turns plus motion.

    The motion is what the joint moves next to them.
    """
    # Each step is a remainder of at most half a turn and whole turns.
    remainder = without_turns(steps, turns)
    whole = np.round((steps - remainder) / TURN)
    if not whole.any():
        return np.zeros(steps.shape, bool)
    # Motion goes on: the remainder lies between the steps that the speeds before and after would make, with a margin
    # for noise and for what these speeds differ by.
    least, most = _bound_steps(np.diff(t)[:, None], remainder, whole)
    scatter = np.median(np.abs(np.diff(remainder, axis=0)), axis=0)
    margin = np.minimum(MAX_OFF_TURNS + (most - least) + NOISE_TO_SCATTER * scatter, MAX_DOUBT)

    def is_expected(step: np.ndarray) -> np.ndarray:
        return (step >= least - margin) & (step <= most + margin)

    # Turns in the same direction one after the other are a joint that is sampled too seldom.
    goes_on = (whole * _shift_rows(whole, -1, 0.0) > 0) | (whole * _shift_rows(whole, 1, 0.0) > 0)
    return np.asarray((whole != 0) & ~goes_on & is_expected(remainder) & ~is_expected(steps))


def _bound_steps(durations: np.ndarray, remainder: np.ndarray, whole: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the least and the largest step that neighbouring speeds make.

    Steps last for durations (N - 1, 1); steps less their turns are `remainder`, their turns `whole`, both (N - 1, k).
    Those next to a step count that have no turn, or as many as it: these jump back and forth by noise at the end of a
    turn.
    """
    least, most = np.full(remainder.shape, np.inf), np.full(remainder.shape, -np.inf)
    for k in (*range(-NEIGHBOURS, 0), *range(1, NEIGHBOURS + 1)):
        speed, turns = _shift_rows(remainder / durations, k, np.nan), np.abs(_shift_rows(whole, k, np.nan))
        counts = (turns == 0) | (turns == np.abs(whole))
        least = np.minimum(least, np.where(counts, speed * durations, np.inf))
        most = np.maximum(most, np.where(counts, speed * durations, -np.inf))
    return least, most


def _shift_rows(x: np.ndarray, k: int, fill: float) -> np.ndarray:
    """Return the rows (N, n) that come k rows later, or `fill`."""
    later = np.full(x.shape, fill)
    if k > 0:
        later[:-k] = x[k:]
    else:
        later[-k:] = x[:k]
    return later


def _refuse_other_periods(
    t: np.ndarray, q: np.ndarray, steps: np.ndarray, fast: np.ndarray, joints: Turning, place: str
) -> None:
    """Raise `JounceError` where a joint jumps against its motion.

    It jumps from one end of all its angles to the other: so do encoders at the end of their range, and counters
    that are reset. Steps of a motion and wild rows do not.
    """
    for j in np.flatnonzero(fast.any(axis=0)).tolist():
        jumps = fast[:, j] & (np.abs(steps[:, j]) >= MIN_PERIOD_SHARE * np.ptp(q[:, j]))
        places = np.flatnonzero(jumps).tolist()
        against = [i for i in places if _is_alone(jumps, i) and _moves_against(steps[:, j], i)]
        if len(against) == 0:
            continue
        # All jumps from end to end are the period, those that the motion hides too.
        i, period = against[0], float(np.median(np.abs(steps[jumps, j])))
        came = f"joint {quote_value(joints.names[j])} jumps against its motion {_describe_step(t, q, i, j)}"
        if abs(period * units.ANGLE_UNITS["deg"] - TURN) < MAX_OFF_TURNS:
            raise JounceError(f"{place}: {came}, a turn in degrees; {joints.cure_of_degrees}")
        what = f"as at the end of a range, which is not 2 pi but {period:.4g}"
        raise JounceError(f"{place}: {came}, {what}; unwrap it at the period of its encoder before, or split the log")


def _is_alone(jumps: np.ndarray, i: int) -> bool:
    """Return whether the i-th step is the only jump around.

    Others next to it show how the joint moves there.
    """
    return int(jumps[max(0, i - MOVING_ROWS) : i + 1 + MOVING_ROWS].sum()) == 1


def _moves_against(steps: np.ndarray, i: int) -> bool:
    """Return whether a joint moves against the i-th step (N,).

    It moves in the other direction both before and after it.
    """
    before, after = steps[max(0, i - MOVING_ROWS) : i], steps[i + 1 : i + 1 + MOVING_ROWS]
    return _direction(before) == _direction(after) == -np.sign(steps[i])


def _direction(steps: np.ndarray) -> int:
    """Return the direction, 1 or -1, of some steps of a joint.

    It is that of most of them; 0 if the joint rests, or its noise hides that.
    """
    net, way = steps.sum(), np.abs(steps).sum()
    if np.count_nonzero(steps) < MIN_MOVING_STEPS or abs(net) < MIN_NET_SHARE * way:
        return 0
    return int(np.sign(net))


def _describe_step(t: np.ndarray, q: np.ndarray, i: int, j: int) -> str:
    """Describe a step: from where to where, and when."""
    return f"from {q[i, j]:.4g} to {q[i + 1, j]:.4g} at t = {t[i + 1]:.9g} s, row {i + 1} from 0"


def _count_wraps(wraps: np.ndarray, names: tuple[str, ...]) -> str:
    """Describe how often each joint wraps."""
    counts = wraps.sum(axis=0)
    each = (f"{names[j]} {counts[j]} time{'s' * int(counts[j] > 1)}" for j in np.flatnonzero(counts))
    return f"angles wrap: {join_names(each)}"


def _turns_to_limits(q: np.ndarray, joints: Turning) -> np.ndarray:
    """Return by how many turns (k,) angles are to be moved.

    These are beyond their limits, and then are within them.
    """
    low, high = q.min(axis=0), q.max(axis=0)
    bounded = joints.turns & np.isfinite(joints.lower) & np.isfinite(joints.upper)
    lower, upper = (np.where(bounded, bound, 0.0) for bound in (joints.lower, joints.upper))
    slack = units.MAX_OUT_OF_RANGE * (upper - lower)
    is_outside = (low < lower - slack) | (high > upper + slack)
    # The turns that bring the middle of the angles next to the middle of the limits.
    whole = np.round((lower + upper - low - high) / (2 * TURN))
    fits = (low + TURN * whole >= lower - slack) & (high + TURN * whole <= upper + slack)
    return np.where(bounded & is_outside & fits, whole, 0.0)
