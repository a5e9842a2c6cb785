"""Find units of columns, and numbers that look like other units.

A column's name or the caller states its unit (`split_unit`, `unit_factor`). Where neither does, numbers are taken as SI
units. Degrees and milliseconds show themselves: joints would leave their limits or move too fast, or nothing would
move at a robot's speed (`check_units`). Such numbers are refused, with the options that state their unit.
"""

import re
from collections.abc import Container

import numpy as np

from jounce.core.cures import Remedy
from jounce.core.errors import JounceError, quote_value, unknown_name_error, warn
from jounce.model import coordinates, positions
from jounce.model.mechanism import Mechanism
from jounce.motion import smoothness

ANGLE_UNITS = {"rad": 1.0, "deg": np.pi / 180}  # rad
TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}  # s
LENGTH_UNITS = {"m": 1.0, "mm": 1e-3, "cm": 1e-2}  # m
NUMBER_UNITS = {"1": 1.0}  # of quaternions
SPELLINGS = {"°": "deg", "degree": "deg", "degrees": "deg", "radian": "rad", "radians": "rad", "µs": "us", "μs": "us",
             "sec": "s", "seconds": "s", "milliseconds": "ms"}  # fmt: skip
UNITS_BY_KIND = {"s": TIME_UNITS, "rad": ANGLE_UNITS, "m": LENGTH_UNITS, "1": NUMBER_UNITS}
HEADER = re.compile(r"(.*?)\s*(?:\[([^][]*)\]|\(([^()]*)\))", re.DOTALL)
UNIT_SUFFIX = re.compile(r"(.+)_(deg|degrees|rad|radians|mm)")
TIME_SUFFIX = re.compile(r"((?i:t|time|timestamp))_(s|sec|seconds|ms|us|ns)")
PER_TIME = re.compile(r"(.+?)\s*/\s*s(?:\^?([2-9])|([²³⁴]))?")
SUPERSCRIPTS = {"²": 2, "³": 3, "⁴": 4}
INDEX = re.compile(r"\d+")

DEFAULT_MAX_SPEED = 60.0  # rad/s or m/s: joints without limits are assumed to move no faster
MAX_OUT_OF_RANGE = 0.1  # share of the range of a joint: how far beyond its limits it may be
MAX_SPEED_TO_LIMIT = 3.0  # times the limit of speed: how fast a joint may be
MIN_SUSPECT_STEP = 0.5  # s between samples, from which on a unit shorter than the second is suspected
MAX_SPEED_AT_REST = 0.02  # rad/s or m/s: nothing moves faster, though something moves
MIN_MOTION = 1e-4  # rad or m: a joint that goes less far rests
MIN_UNIT_JUMP = 0.1  # rad from row to row, by which a change of unit shows: smaller ones do no harm
MAX_UNIT_MISMATCH = 0.05  # of the angles in the other unit: what joints move meanwhile
MAX_RATE_MISMATCH = 1.5  # times by which changes of q and qd may differ: units differ by more
ANGLES_OPTION_CURE = Remedy(
    "state the unit by angles='deg' or angles='rad'", "state the unit by --angles deg or --angles rad"
)
ANGLES_ARGUMENT_CURE = Remedy(
    "numpy.deg2rad makes rad of them, and Motion.fit(..., angles='rad') states that they are rad",
    "state the unit by --angles deg or --angles rad",
)
IN_DEGREES = "the values would be within limits if they were degrees"


def split_unit(name: str, whole: Container[str] = (), taken: Container[str] = ()) -> tuple[str, str | None]:
    """Return a column's name and its unit, None without one.

    Names are ``joint1 [deg]``, ``time (ms)``, ``joint1_deg`` or ``timestamp_ms``; an index in brackets is part of the
    name. Names in `whole` have no unit. A suffix is not taken off where the rest is `taken` by another column.
    """
    if name in whole:
        return name, None
    match = HEADER.fullmatch(name)
    if match is not None and match[1] != "":
        # Either square or round brackets contain the unit.
        unit = match[3] if match[2] is None else match[2]
        return (name, None) if unit == "" or INDEX.fullmatch(unit) is not None else (match[1], unit)
    suffix = UNIT_SUFFIX.fullmatch(name) or TIME_SUFFIX.fullmatch(name)
    return (name, None) if suffix is None or suffix[1] in taken else (suffix[1], suffix[2])


def unit_factor(stated: str | None, said: str | None, kind: str, order: int, column: str) -> float:
    """Return the factor to SI units of a column.

    The column is of s, rad, m, 1 or load; its name (`stated`) or the caller (`said`) states the unit.
    """
    # Wrenches and torques are in N m and N, whose factors are 1.
    if kind == "load":
        if stated is not None and "".join(stated.split()).replace("*", "") not in ("N", "Nm", "N.m", "N·m"):
            raise JounceError(f"column {quote_value(column)}: {unknown_name_error('unit', stated, ('N', 'N m'))}")
        return 1.0
    known = UNITS_BY_KIND[kind]
    if stated is None:
        return known[said] if said is not None else 1.0
    # A unit per power of time, rad/s^2, is that of a rate: of the column's order.
    per = PER_TIME.fullmatch(stated) if kind != "s" else None
    base, power = (per[1], int(per[2] or SUPERSCRIPTS.get(per[3], 1))) if per else (stated, 0)
    base = SPELLINGS.get(base, base)
    if base not in known:
        raise JounceError(f"column {quote_value(column)}: {unknown_name_error('unit', stated, known)}")
    if power != order:
        expected = base + (f"/s^{order}" if order > 1 else "/s" * order)
        raise JounceError(f"column {quote_value(column)}: the unit is {quote_value(stated)}; expected {expected}")
    if said not in (None, base):
        came = f"column {quote_value(column)} states its unit, but {quote_value(said)} is asked for"
        raise JounceError(f"{came}; leave one of them out")
    return known[base]


def check_units(
    t: np.ndarray, q: np.ndarray, qd: np.ndarray | None, mechanism: Mechanism, stated: tuple[bool, bool], place: str
) -> None:
    """Raise `JounceError` where numbers look like degrees or milliseconds.

    Positions q are (N, nq). Not if units are `stated`, that of angles and that of time. Limits that are broken
    all the same are a warning.
    """
    is_judged = len(t) >= smoothness.MIN_JUDGED_SAMPLES and not stated[1]
    unit = _guess_time_unit(t, q) if is_judged else None
    if unit is not None:
        cure = Remedy(
            f"state the unit by time_unit={unit!r} or time_unit='s'",
            f"state the unit by --time-unit {unit} or --time-unit s",
        )
        raise JounceError(f"{place}: {_describe_pace(t, q)}: t looks like {unit}; {cure}")
    _check_rates(t, q, qd, place)
    check_angles(t, q, qd, mechanism, place, None if stated[0] else ANGLES_OPTION_CURE)


def check_angles(
    t: np.ndarray, q: np.ndarray, qd: np.ndarray | None, mechanism: Mechanism, place: str, cure: Remedy | None
) -> None:
    """Raise `JounceError` where samples look like degrees.

    Samples are q (N, nq) at times t; `cure` states the unit. Without a cure the unit is stated. Limits that are
    broken all the same are a warning.
    """
    q = positions.single_joint_positions(mechanism, q)
    qd = None if qd is None else positions.single_joint_positions(mechanism, qd)
    refuse_unit_changes(t, q, mechanism, place)
    speeds = _usual_speeds(t, q, qd)
    broken = _breaks_limits(q, speeds, mechanism)
    if not broken.any():
        return
    joint = int(broken.argmax())
    came, allowed = _describe_motion(q, speeds, mechanism, joint)
    if cure is not None and _look_like_degrees(q, speeds, mechanism):
        if not _only_turn_over(q, speeds, mechanism):
            raise JounceError(f"{place}: {came}: {allowed}; {IN_DEGREES}; {cure}")
        # A joint without stated limits may turn over and over: no reason to refuse it.
        warn(f"{place}: {came}: {allowed}, which is right if it turns over, and in degrees if it does not; {cure}")
        return
    if np.isfinite([*_stated_limits(mechanism, joint)]).any():
        warn(f"{place}: {came}, but {allowed}; check units, joint names and {Remedy('lock=', '--lock')}")


@np.errstate(over="ignore", invalid="ignore")  # absurd positions are refused later
def refuse_unit_changes(t: np.ndarray, q: np.ndarray, mechanism: Mechanism, place: str) -> None:
    """Raise `JounceError` where the unit of all angles changes.

    Angles of q (N, n) become 57.3 times or 1/57.3 of what they were, and remain so.
    """
    steps = q[1:] - q[:-1]
    # Nearly all tables end here: no angle jumps.
    if max(steps.max(initial=0), -steps.min(initial=0)) <= MIN_UNIT_JUMP:
        return
    turns = np.flatnonzero([unit == "rad" for unit in coordinates.units(mechanism)])
    before, after = q[:-1, turns], q[1:, turns]
    # A jump is a step that is much larger than those before and after it.
    step = np.abs(after - before).max(axis=1, initial=0)
    padded = np.pad(step, 1)
    jumps = step > np.maximum(MIN_UNIT_JUMP, smoothness.MIN_JUMP_TO_NEIGHBOURS * np.maximum(padded[:-2], padded[2:]))
    for name, factor in (("degrees", 1 / ANGLE_UNITS["deg"]), ("radians", ANGLE_UNITS["deg"])):
        # All angles in the other unit, and how far off they are. They are compared with the angles and not with the
        # step, of which any return to zero is a small share.
        other, off = (np.abs(x).max(axis=1, initial=0) for x in (factor * before, after - factor * before))
        is_other_unit = off < MAX_UNIT_MISMATCH * other
        for i in np.flatnonzero(jumps & is_other_unit)[:1]:
            j = turns[np.abs(after[i] - before[i]).argmax()]
            came = f"joint {quote_value(mechanism.coordinates[j])} goes from {q[i, j]:.4g} to {q[i + 1, j]:.4g}"
            change = f"at t = {t[i + 1]:.9g} s, row {i + 1} from 0, all angles become {name}"
            raise JounceError(f"{place}: {change}: {came}; write all rows in one unit")


def warn_of_degrees(q: np.ndarray, qd: np.ndarray, mechanism: Mechanism, place: str) -> None:
    """Warn where positions and velocities look like degrees.

    They are (N, nq) and (N, n), of a motion that is no table.
    """
    q, speeds = (
        positions.single_joint_positions(mechanism, q),
        np.abs(qd).max(axis=0) * positions.single_positions(mechanism).any(axis=1),
    )
    if _look_like_degrees(q, speeds, mechanism):
        came, allowed = _describe_motion(q, speeds, mechanism, int(_breaks_limits(q, speeds, mechanism).argmax()))
        warn(f"{place}: {came}: {allowed}; {IN_DEGREES}: numpy.deg2rad makes rad of them")


def warn_of_times(t: np.ndarray, q: np.ndarray, place: str) -> None:
    """Warn where times (N,) of samples (N, n) look like milliseconds."""
    unit = _guess_time_unit(t, q) if len(t) >= smoothness.MIN_JUDGED_SAMPLES else None
    if unit is not None:
        warn(f"{place}: {_describe_pace(t, q)}: t looks like {unit}; expected seconds")


def _look_like_degrees(q: np.ndarray, speeds: np.ndarray, mechanism: Mechanism) -> bool:
    """Return whether limits would be kept if angles were degrees.

    Revolute joints break them as they are.
    """
    revolute = np.array([unit == "rad" for unit in coordinates.units(mechanism)])
    scale = np.where(revolute, ANGLE_UNITS["deg"], 1.0)
    broken = _breaks_limits(q, speeds, mechanism)
    broken_in_degrees = _breaks_limits(q * scale, speeds * scale, mechanism)
    return bool(broken[revolute].any() and not broken_in_degrees.any())


def _only_turn_over(q: np.ndarray, speeds: np.ndarray, mechanism: Mechanism) -> bool:
    """Return whether joints leave only ranges that no file states.

    Their speeds are ones that they may have in rad/s too.
    """
    leading = coordinates.leading_joints(mechanism)
    lower, upper = mechanism.limits.lower[leading], mechanism.limits.upper[leading]
    turning = np.isinf(lower) & np.isinf(upper) & (speeds <= MAX_SPEED_TO_LIMIT * _generous_limits(mechanism)[2])
    return bool(turning[_breaks_limits(q, speeds, mechanism)].all())


def _breaks_limits(q: np.ndarray, speeds: np.ndarray, mechanism: Mechanism) -> np.ndarray:
    """Return which coordinates (n,) are far beyond limits, or much faster."""
    lower, upper, fastest = _generous_limits(mechanism)
    slack = MAX_OUT_OF_RANGE * np.where(np.isfinite(upper - lower), upper - lower, 1)
    is_far = (q.min(axis=0) < lower - slack) | (q.max(axis=0) > upper + slack)
    return np.asarray(is_far | (speeds > MAX_SPEED_TO_LIMIT * fastest))


def _describe_motion(q: np.ndarray, speeds: np.ndarray, mechanism: Mechanism, j: int) -> tuple[str, str]:
    """Describe how a joint moves, and what it may."""
    unit = coordinates.units(mechanism)[j]
    went = f"goes from {q[:, j].min():.4g} to {q[:, j].max():.4g} {unit} at up to {speeds[j]:.3g} {unit}/s"
    return f"joint {quote_value(mechanism.coordinates[j])} {went}", _describe_limits(mechanism, j)


def _guess_time_unit(t: np.ndarray, q: np.ndarray) -> str | None:
    """Return the unit that times look like; None for seconds.

    Rows are long apart then, while nothing moves at a robot's speed.
    """
    step = float(np.median(np.diff(t)))
    if step < MIN_SUSPECT_STEP:
        return None
    # Steps of many minutes are suspect in themselves, shorter ones where something moves, and all of it slowly.
    if step < MIN_SUSPECT_STEP / TIME_UNITS["ms"]:
        moves = np.ptp(q, axis=0).max() > MIN_MOTION
        if not moves or _usual_speeds(t, q).max() >= MAX_SPEED_AT_REST:
            return None
    return next((unit for unit in ("ms", "us") if step * TIME_UNITS[unit] < MIN_SUSPECT_STEP), "ns")


def _describe_pace(t: np.ndarray, q: np.ndarray) -> str:
    """Describe how far rows are apart, and how fast joints move."""
    step, fastest = np.median(np.diff(t)), _usual_speeds(t, q).max()
    return f"rows are {step:g} s apart, and no joint moves faster than {fastest:.2g} rad/s or m/s"


def _check_rates(t: np.ndarray, q: np.ndarray, qd: np.ndarray | None, place: str) -> None:
    """Raise `JounceError` where rates are of another unit than positions.

    Both determine how far a joint goes.
    """
    if qd is None or len(t) < smoothness.MIN_JUDGED_SAMPLES:
        return
    # The way of each joint by positions, and by velocities with the trapezoidal rule, (n,).
    way = np.abs(np.diff(q, axis=0)).sum(axis=0)
    way_by_rates = (np.abs(qd[1:] + qd[:-1]) / 2 * np.diff(t)[:, None]).sum(axis=0)
    moves = np.minimum(way, way_by_rates) > MIN_MOTION * 1e-3
    ratio = np.median(way[moves] / way_by_rates[moves]) if moves.any() else 1.0
    for other, cure in (
        (ANGLE_UNITS["deg"], "qd looks like degrees per second: name the column NAME.qd [deg/s]"),
        (1 / ANGLE_UNITS["deg"], "q looks like degrees: name the column NAME.q [deg]"),
        *(
            (unit, f"t looks like {name}: {Remedy(f'time_unit={name!r}', f'--time-unit {name}')}")
            for name, unit in list(TIME_UNITS.items())[1:]
        ),
    ):
        if 1 / MAX_RATE_MISMATCH < ratio / other < MAX_RATE_MISMATCH:
            raise JounceError(f"{place}: q changes {ratio:.3g} times as fast as qd states; {cure}")


def _usual_speeds(t: np.ndarray, q: np.ndarray, qd: np.ndarray | None = None) -> np.ndarray:
    """Return the speeds (n,) that joints seldom exceed.

    Single wild stamps and rows do not count. Without velocities they follow from differences.
    """
    if len(t) < smoothness.MIN_JUDGED_SAMPLES:
        return np.zeros(q.shape[1])
    if qd is not None:
        return _high_quantile(np.abs(qd))
    with np.errstate(all="ignore"):
        return np.nan_to_num(_high_quantile(np.abs(np.diff(q, axis=0) / np.diff(t)[:, None])))


def _high_quantile(x: np.ndarray) -> np.ndarray:
    return np.asarray(np.quantile(x, 0.99, axis=0))


def _stated_limits(mechanism: Mechanism, j: int) -> tuple[float, float, float]:
    """Return the limits and the speed of a joint as stated."""
    limits, i = mechanism.limits, coordinates.leading_joints(mechanism)[j]
    return float(limits.lower[i]), float(limits.upper[i]), float(limits.velocity[i])


def _generous_limits(mechanism: Mechanism) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return lower and upper limits and speeds of the coordinates.

    They are generous ones where nothing is stated.
    """
    leading = coordinates.leading_joints(mechanism)
    fastest = mechanism.limits.velocity[leading]
    lower, upper = (bound[leading] for bound in coordinates.likely_positions(mechanism))
    return lower, upper, np.where(np.isfinite(fastest) & (fastest > 0), fastest, DEFAULT_MAX_SPEED / MAX_SPEED_TO_LIMIT)


def _describe_limits(mechanism: Mechanism, j: int) -> str:
    """Describe the limits of a joint."""
    lower, upper, fastest = _stated_limits(mechanism, j)
    if not np.isfinite([lower, upper, fastest]).any():
        return "more than four turns, or faster than joints move"
    return f"its limits are {lower:.4g} to {upper:.4g} at {fastest:.3g}/s"
