"""Angles that wrap: encoders that count to the end of a turn, 360 degrees or pi, and begin again at its start.

A step from row to row is a wrap where it is whole turns to within what the joint moves from row to row next to it.
Prismatic joints do not wrap. Whole turns of 2 pi rad are all that is taken off: other periods are refused by name.
"""

from dataclasses import dataclass

import numpy as np

from jounce.core.errors import JounceError, join_names, option_name, quote_value
from jounce.model.coordinates import coordinate_units, leading_joints
from jounce.model.mechanism import Mechanism
from jounce.model.positions import position_names, single_positions
from jounce.motion.smoothness import MIN_JUDGED_SAMPLES
from jounce.motion.units import ANGLE_UNITS, ANGLES_OPTION_CURE, MAX_OUT_OF_RANGE, MAX_SPEED_TO_LIMIT

TURN = 2 * np.pi
MAX_OFF_TURNS = 0.1  # rad, by which a wrap at rest may miss whole turns: noise and coarse encoders, no step of a motion
MAX_DOUBT = TURN / 8  # by which it may where the steps next to it differ: more would let any jump pass for a wrap
NEIGHBOURS = 2  # steps on either side that show how a joint moves
MIN_PERIOD_SHARE = 0.9  # of the range of all angles, that a wrap at another period passes: what is left moves on
MIN_UNKNOWN_SPEED = 20.0  # rad/s: without a stated limit no joint jumps faster of itself
RADIANS_CURE = "numpy.deg2rad makes rad of them"
UNWRAP_CURE = f"{option_name('unwrap')} takes the turns off"


@dataclass(frozen=True, eq=False)
class Turning:
    """What is known of positions (N, k): their names, which are angles (k,), how fast they may be, their limits."""

    names: tuple[str, ...]
    turns: np.ndarray
    fastest: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    cure_of_degrees: str

    @staticmethod
    def of_robot(mechanism: Mechanism) -> "Turning":
        """Of the positions of a robot: joints of several screws do not turn by one number."""
        single, leading = single_positions(mechanism), leading_joints(mechanism)
        revolute = np.array([unit == "rad" for unit in coordinate_units(mechanism)])
        limit = mechanism.limits.velocity[leading]
        speed = np.where(np.isfinite(limit) & (limit > 0), MAX_SPEED_TO_LIMIT * limit, MIN_UNKNOWN_SPEED)
        joint = np.asarray(single).argmax(axis=0)  # of each position
        alone = np.asarray(single).any(axis=0)
        lower, upper = mechanism.limits.lower[leading][joint], mechanism.limits.upper[leading][joint]
        return Turning(tuple(position_names(mechanism)), alone & revolute[joint], speed[joint], lower, upper, ANGLES_OPTION_CURE)

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
    if steps is None or len(t) < MIN_JUDGED_SAMPLES:
        return
    fast = np.abs(steps) > joints.fastest * np.diff(t)[:, None]
    wraps = _find_wraps(t, steps, joints.turns) & fast
    if wraps.any():
        i, j = map(int, np.argwhere(wraps)[0])
        come = f"joint {quote_value(joints.names[j])} wraps {_describe_step(t, q, i, j)}, whole turns but for its motion"
        raise JounceError(f"{place}: {come}; {_count_wraps(wraps, joints.names)}; {UNWRAP_CURE}")
    _refuse_other_periods(t, q, steps, fast, joints, place)


def unwrap(t: np.ndarray, q: np.ndarray, joints: Turning, place: str) -> tuple[np.ndarray, tuple[str, ...]]:
    """Positions q (N, k) at times t without their wraps, and notes of it; `JounceError` for wraps at other periods.

    Angles go on from their first rows. Those that leave the stated limits are moved by the turns that keep them there.
    """
    notes = []
    steps = _large_steps(q, joints)
    if steps is not None:
        wraps = _find_wraps(t, steps, joints.turns)
        _refuse_other_periods(
            t, q, steps, ~wraps & (np.abs(steps) > joints.fastest * np.diff(t)[:, None]), joints, place
        )
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


def _find_wraps(t: np.ndarray, steps: np.ndarray, turns: np.ndarray) -> np.ndarray:
    """Which steps (N - 1, k) are whole turns but for what the joint moves next to them."""
    rest = without_turns(steps, turns)
    # the steps that the speeds next to each would make, and how sure they are of it
    apart = np.diff(t)[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):  # of equal stamps, which are refused later
        speed = np.pad(rest / apart, ((NEIGHBOURS, NEIGHBOURS), (0, 0)), constant_values=np.nan)
    others = [k for k in range(2 * NEIGHBOURS + 1) if k != NEIGHBOURS]
    expected = np.stack([speed[k : k + len(steps)] for k in others]) * apart
    least, most = np.nanmin(expected, axis=0), np.nanmax(expected, axis=0)
    margin = np.minimum(MAX_OFF_TURNS + (most - least), MAX_DOUBT)

    def is_expected(step: np.ndarray) -> np.ndarray:
        return (step >= least - margin) & (step <= most + margin)

    return np.asarray((np.abs(steps) > TURN / 2) & is_expected(rest) & ~is_expected(steps))


def _refuse_other_periods(
    t: np.ndarray, q: np.ndarray, steps: np.ndarray, fast: np.ndarray, joints: Turning, place: str
) -> None:
    """Raise `JounceError` where a joint jumps against its motion, from one end of all its angles to the other.

    So do encoders at the end of their range, and counters that are reset; steps of a motion and wild rows do not.
    """
    for j in np.flatnonzero(fast.any(axis=0)):
        jumps = fast[:, j] & (np.abs(steps[:, j]) >= MIN_PERIOD_SHARE * np.ptp(q[:, j]))
        calm = np.where(jumps, 0.0, steps[:, j])
        before, after = np.append(0, calm[:-1]), np.append(calm[1:], 0)
        against = jumps & (before * steps[:, j] < 0) & (after * steps[:, j] < 0)
        if against.any():
            i, period = int(np.argmax(against)), float(np.median(np.abs(steps[jumps, j])))
            came = f"joint {quote_value(joints.names[j])} jumps against its motion {_describe_step(t, q, i, j)}"
            in_degrees = abs(period * ANGLE_UNITS["deg"] - TURN) < MAX_OFF_TURNS
            cure = joints.cure_of_degrees if in_degrees else "unwrap it at the period of its encoder before, or split the log"
            what = "a turn in degrees" if in_degrees else f"as at the end of a range, which is not 2 pi but {period:.4g}"
            raise JounceError(f"{place}: {came}, {what}; {cure}")


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
    lower, upper = np.where(bounded, joints.lower, -np.inf), np.where(bounded, joints.upper, np.inf)
    slack = MAX_OUT_OF_RANGE * np.where(bounded, upper - lower, 0.0)
    beyond = (low < lower - slack) | (high > upper + slack)
    middle = np.where(bounded, (joints.lower + joints.upper) / 2, 0.0) if bounded.any() else np.zeros(len(low))
    whole = np.where(beyond, np.round((middle - (low + high) / 2) / TURN), 0.0)
    fits = (low + TURN * whole >= lower - slack) & (high + TURN * whole <= upper + slack)
    return np.where(fits, whole, 0.0)
