"""Units of columns, and numbers that look as if they were in others than SI: degrees, milliseconds."""

import re

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
             "sec": "s", "seconds": "s"}  # fmt: skip
UNITS_BY_KIND = {"s": TIME_UNITS, "rad": ANGLE_UNITS, "m": LENGTH_UNITS, "1": NUMBER_UNITS}
HEADER = re.compile(r"(.*?)\s*(?:\[([^][]*)\]|\(([^()]*)\))", re.DOTALL)
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


def split_unit(name: str) -> tuple[str, str | None]:
    """A column's name and its unit, ``joint1 [deg]`` or ``time (ms)``; an index in brackets is part of the name."""
    found = HEADER.fullmatch(name)
    unit = found and (found[2] or found[3])
    return (name, None) if found is None or not found[1] or not unit or INDEX.fullmatch(unit) else (found[1], unit)


def unit_factor(stated: str | None, said: str | None, kind: str, order: int, column: str) -> float:
    """Return the factor to SI units of a column of s, rad, m, 1 or load; its name or the caller states the unit."""
    if kind == "load":  # of wrenches, N m and N
        if stated is not None and "".join(stated.split()).replace("*", "") not in ("N", "Nm", "N.m", "N·m"):
            raise JounceError(f"column {quote_value(column)}: {unknown_name_error('unit', stated, ('N', 'N m'))}")
        return 1.0
    known = UNITS_BY_KIND[kind]
    if stated is None:
        return known[said] if said is not None else 1.0
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
    """Raise `JounceError` where numbers of q (N, nq) look like degrees or times like milliseconds.

    Not if they are `stated`, the unit of angles and that of time. Limits that are broken all the same are a warning.
    """
    if len(t) >= smoothness.MIN_JUDGED_SAMPLES and not stated[1] and (unit := _guess_time_unit(t, q)):
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
    """Raise `JounceError` where samples q (N, nq) at times t look like degrees; `cure` states the unit.

    Without a cure the unit is stated. Limits that are broken all the same are a warning.
    """
    q, qd = (
        positions.single_joint_positions(mechanism, q),
        None if qd is None else positions.single_joint_positions(mechanism, qd),
    )
    refuse_unit_changes(t, q, mechanism, place)
    speeds = _usual_speeds(t, q) if qd is None or len(t) < smoothness.MIN_JUDGED_SAMPLES else _high_quantile(np.abs(qd))
    here = _breaks_limits(q, speeds, mechanism)
    if not here.any():
        return
    came, allowed = _describe_motion(q, speeds, mechanism, int(here.argmax()))
    if cure and _look_like_degrees(q, speeds, mechanism):
        if not _only_turn_over(q, speeds, mechanism):
            raise JounceError(f"{place}: {came}: {allowed}; {IN_DEGREES}; {cure}")
        warn(f"{place}: {came}: {allowed}, which is right if it turns over, and in degrees if it does not; {cure}")
        return
    if np.isfinite([*_stated_limits(mechanism, int(here.argmax()))]).any():
        warn(f"{place}: {came}, but {allowed}; check units, joint names and {Remedy('lock=', '--lock')}")


@np.errstate(over="ignore", invalid="ignore")  # absurd positions are refused later
def refuse_unit_changes(t: np.ndarray, q: np.ndarray, mechanism: Mechanism, place: str) -> None:
    """Raise `JounceError` where all angles of q (N, n) become 57.3 times or 1/57.3 of what they were, and remain so."""
    steps = q[1:] - q[:-1]
    if max(steps.max(initial=0), -steps.min(initial=0)) <= MIN_UNIT_JUMP:  # as of nearly all tables
        return
    turns = np.flatnonzero([unit == "rad" for unit in coordinates.units(mechanism)])
    before, after = q[:-1, turns], q[1:, turns]
    step = np.abs(after - before).max(axis=1, initial=0)
    beside = np.pad(step, 1)
    jumps = step > np.maximum(MIN_UNIT_JUMP, smoothness.MIN_JUMP_TO_NEIGHBOURS * np.maximum(beside[:-2], beside[2:]))
    for name, factor in (("degrees", 1 / ANGLE_UNITS["deg"]), ("radians", ANGLE_UNITS["deg"])):
        other, off = (np.abs(x).max(axis=1, initial=0) for x in (factor * before, after - factor * before))
        alike = off < MAX_UNIT_MISMATCH * other  # not of the step, of which any return to zero is a small share
        for i in np.flatnonzero(jumps & alike)[:1]:
            j = turns[np.abs(after[i] - before[i]).argmax()]
            came = f"joint {quote_value(mechanism.coordinates[j])} goes from {q[i, j]:.4g} to {q[i + 1, j]:.4g}"
            where = f"at t = {t[i + 1]:.9g} s, row {i + 1} from 0, all angles become {name}"
            raise JounceError(f"{place}: {where}: {came}; write all rows in one unit")


def warn_of_degrees(q: np.ndarray, qd: np.ndarray, mechanism: Mechanism, place: str) -> None:
    """Warn where positions (N, nq) and velocities (N, n) of a motion that is no table look like degrees."""
    q, speeds = (
        positions.single_joint_positions(mechanism, q),
        np.abs(qd).max(axis=0) * positions.single_positions(mechanism).any(axis=1),
    )
    if _look_like_degrees(q, speeds, mechanism):
        came, allowed = _describe_motion(q, speeds, mechanism, int(_breaks_limits(q, speeds, mechanism).argmax()))
        warn(f"{place}: {came}: {allowed}; {IN_DEGREES}: numpy.deg2rad makes rad of them")


def warn_of_times(t: np.ndarray, q: np.ndarray, place: str) -> None:
    """Warn where times (N,) of samples (N, n) look like milliseconds."""
    if len(t) >= smoothness.MIN_JUDGED_SAMPLES and (unit := _guess_time_unit(t, q)):
        warn(f"{place}: {_describe_pace(t, q)}: t looks like {unit}; expected seconds")


def _look_like_degrees(q: np.ndarray, speeds: np.ndarray, mechanism: Mechanism) -> bool:
    """Whether revolute joints break their limits, which none would if its angles were degrees."""
    revolute = np.array([unit == "rad" for unit in coordinates.units(mechanism)])
    scale = np.where(revolute, ANGLE_UNITS["deg"], 1.0)
    now, then = _breaks_limits(q, speeds, mechanism), _breaks_limits(q * scale, speeds * scale, mechanism)
    return bool(now[revolute].any() and not then.any())


def _only_turn_over(q: np.ndarray, speeds: np.ndarray, mechanism: Mechanism) -> bool:
    """Whether joints leave nothing but a range that no file states, at speeds that they may have in rad/s too."""
    leading = coordinates.leading_joints(mechanism)
    lower, upper = mechanism.limits.lower[leading], mechanism.limits.upper[leading]
    turning = np.isinf(lower) & np.isinf(upper) & (speeds <= MAX_SPEED_TO_LIMIT * _generous_limits(mechanism)[2])
    return bool(turning[_breaks_limits(q, speeds, mechanism)].all())


def _breaks_limits(q: np.ndarray, speeds: np.ndarray, mechanism: Mechanism) -> np.ndarray:
    """Which coordinates (n,) are far beyond their limits, or much faster."""
    lower, upper, fastest = _generous_limits(mechanism)
    slack = MAX_OUT_OF_RANGE * np.where(np.isfinite(upper - lower), upper - lower, 1)
    far = (q.min(axis=0) < lower - slack) | (q.max(axis=0) > upper + slack)
    return np.asarray(far | (speeds > MAX_SPEED_TO_LIMIT * fastest))


def _describe_motion(q: np.ndarray, speeds: np.ndarray, mechanism: Mechanism, j: int) -> tuple[str, str]:
    """How a joint moves, and what it may."""
    unit = coordinates.units(mechanism)[j]
    went = f"goes from {q[:, j].min():.4g} to {q[:, j].max():.4g} {unit} at up to {speeds[j]:.3g} {unit}/s"
    return f"joint {quote_value(mechanism.coordinates[j])} {went}", _describe_limits(mechanism, j)


def _guess_time_unit(t: np.ndarray, q: np.ndarray) -> str | None:
    """The unit that times look like where rows are long apart, while nothing moves at a robot's speed."""
    step = float(np.median(np.diff(t)))
    moves = np.ptp(q, axis=0).max() > MIN_MOTION
    if step < MIN_SUSPECT_STEP or not (
        step >= MIN_SUSPECT_STEP / TIME_UNITS["ms"] or (moves and _usual_speeds(t, q).max() < MAX_SPEED_AT_REST)
    ):
        return None
    return next((unit for unit in ("ms", "us") if step * TIME_UNITS[unit] < MIN_SUSPECT_STEP), "ns")


def _describe_pace(t: np.ndarray, q: np.ndarray) -> str:
    step, fastest = np.median(np.diff(t)), _usual_speeds(t, q).max()
    return f"rows are {step:g} s apart, and no joint moves faster than {fastest:.2g} rad/s or m/s"


def _check_rates(t: np.ndarray, q: np.ndarray, qd: np.ndarray | None, place: str) -> None:
    """Refuse rates that are of another unit than the coordinates: both determine how far a joint goes."""
    if qd is None or len(t) < smoothness.MIN_JUDGED_SAMPLES:
        return
    way = np.abs(np.diff(q, axis=0)).sum(axis=0)
    stated = (np.abs(qd[1:] + qd[:-1]) / 2 * np.diff(t)[:, None]).sum(axis=0)
    moved = np.minimum(way, stated) > MIN_MOTION * 1e-3
    ratio = np.median(way[moved] / stated[moved]) if moved.any() else 1.0
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


def _usual_speeds(t: np.ndarray, q: np.ndarray) -> np.ndarray:
    """The speeds (n,) that joints seldom exceed: single wild stamps and rows do not count."""
    if len(t) < smoothness.MIN_JUDGED_SAMPLES:
        return np.zeros(q.shape[1])
    with np.errstate(all="ignore"):
        return np.nan_to_num(_high_quantile(np.abs(np.diff(q, axis=0) / np.diff(t)[:, None])))


def _high_quantile(x: np.ndarray) -> np.ndarray:
    return np.asarray(np.quantile(x, 0.99, axis=0))


def _stated_limits(mechanism: Mechanism, j: int) -> tuple[float, float, float]:
    limits, i = mechanism.limits, coordinates.leading_joints(mechanism)[j]
    return float(limits.lower[i]), float(limits.upper[i]), float(limits.velocity[i])


def _generous_limits(mechanism: Mechanism) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Lower and upper limits and speeds of the coordinates, generous ones where nothing is stated."""
    leading = coordinates.leading_joints(mechanism)
    fastest = mechanism.limits.velocity[leading]
    lower, upper = (bound[leading] for bound in coordinates.likely_positions(mechanism))
    return lower, upper, np.where(np.isfinite(fastest) & (fastest > 0), fastest, DEFAULT_MAX_SPEED / MAX_SPEED_TO_LIMIT)


def _describe_limits(mechanism: Mechanism, j: int) -> str:
    lower, upper, fastest = _stated_limits(mechanism, j)
    if not np.isfinite([lower, upper, fastest]).any():
        return "more than four turns, or faster than joints move"
    return f"its limits are {lower:.4g} to {upper:.4g} at {fastest:.3g}/s"
