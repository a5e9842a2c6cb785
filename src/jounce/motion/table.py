"""Make motions of tables: of samples or all rates, matched by joint name.

`motion_from_columns` is the door, for columns in any order that are matched already. It takes whole turns and units
into account, makes curves of joints, base and wrenches, and notes what is odd.

Where the first stamp of a log is large, times are since then (`TimeOrigin`), subtracted in all digits of the file:
doubles of seconds since 1970 step by 2.4e-7 s. At 1 rad/s and 1 kHz, fourth differences make 1e6 rad/s^4 of that.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from decimal import Decimal

import numpy as np

from jounce.core.cures import Remedy, join_cures
from jounce.core.errors import JounceError, join_names, locate_errors, quote_value, shorten, warn
from jounce.model import positions
from jounce.model.mechanism import Mechanism
from jounce.model.positions import Position
from jounce.motion import body_columns, smoothness, units, wraps
from jounce.motion.base import align_quaternions, compute_numbers
from jounce.motion.hermite import HermiteCurve, collect_rates
from jounce.motion.motion import Motion
from jounce.motion.poses import Poses, find_holds
from jounce.motion.sample_curves import SampleCurve, fit_curve
from jounce.motion.spline import SampledColumns, Smoothing, Spline, refuse_smoothing
from jounce.motion.table_columns import (
    DEVIATION,
    TIME,
    TIME_CURE,
    ColumnMatch,
    ColumnOptions,
    column_stems,
    follower_columns,
    joints_with_velocities,
)
from jounce.spatial.series import rate_name

MIN_LARGE_STAMP = 86400.0  # s: up to a day doubles step by 1.5e-11 s at most, such differences by 100 rad/s^4
EPOCH_SECONDS = 1e8, 1e10  # since 1970: 1973 to 2286. No clock since a start shows as much
STAMP_GRID_TOLERANCE = 1e-3  # of a step, by which multiples of it may be off
DEFAULT_SMOOTHING, DEFAULT_COLUMN_OPTIONS = Smoothing(), ColumnOptions()
MAX_FOLLOWER_OFFSET = 0.02  # rad or m: more than transmissions deflect, and less than another ratio shows
MAX_REST_SPEED = 4e-3  # rad/s or m/s, as of a hold: sensors show some of it at rest
JERK_ORDER = 3  # of q3d
ALL_RATES_SOURCE = "all rates from the table"  # the source of motions without samples


@dataclass(frozen=True)
class TimeOrigin:
    """The first stamp of a log, in all digits of its file.

    In the unit of its column it is a double and what that leaves of the stamp.
    """

    high: float
    low: float
    factor: float  # the seconds of the unit

    def since(self, high: np.ndarray, low: np.ndarray) -> np.ndarray:
        """Return stamps less this one, in the unit of the column."""
        return np.asarray((high - self.high) + (low - self.low))

    def rounding(self, t: np.ndarray) -> float:
        """Return the standard deviation in s of the rounding of stamps.

        Times t (N,) are since this one; 0 if the stamps are exact. They are rounded where they are multiples
        of the step of doubles, and not of a decimal that doubles resolve.
        """
        step = float(np.spacing(abs(self.high)))
        since = t / self.factor
        is_rounded = _is_on_grid(since, step) and not _is_on_grid(since, shortest_decimal(self.high))
        return step * self.factor / np.sqrt(12) if is_rounded else 0.0

    @property
    def notes(self) -> tuple[str, ...]:
        """The time of the first row, in one sentence."""
        return (f"times are since the first row, at {self}",)

    def __str__(self) -> str:
        seconds = (Decimal(self.high) + Decimal(self.low)) * Decimal(repr(self.factor))
        text = f"{seconds:.9f}".rstrip("0").rstrip(".")
        if not EPOCH_SECONDS[0] <= seconds < EPOCH_SECONDS[1]:
            return f"{text} s"
        return f"{text} s, {datetime.fromtimestamp(float(seconds), UTC):%Y-%m-%d %H:%M:%S} UTC"


def find_origin(high: float, low: float, factor: float) -> TimeOrigin | None:
    """Return the origin of stamps whose first one is given.

    None where doubles hold such stamps well enough.
    """
    return TimeOrigin(high, low, factor) if MIN_LARGE_STAMP <= abs(high) * factor < np.inf else None


def rounding_notes(rounding: float, highest: int) -> tuple[str, ...]:
    """Return what a user should know of stamps that are rounded.

    Rates up to `highest` are asked of them.
    """
    if rounding == 0:
        return ()
    step = f"{rounding * np.sqrt(12):.2g}"
    return (f"the stamps are doubles, in steps of {step} s; the deviations of q to {rate_name('q', highest)} hold it",)


def shortest_decimal(largest: float) -> float:
    """Return the power of ten whose multiples doubles resolve.

    Doubles up to the largest do so with certainty.
    """
    return float(10.0 ** np.ceil(np.log10(2 * np.spacing(abs(largest)))))


def _is_on_grid(x: np.ndarray, step: float) -> bool:
    """Return whether numbers are multiples of a step."""
    return bool((np.abs(x / step - np.rint(x / step)) < STAMP_GRID_TOLERANCE).all())


def motion_from_columns(
    columns: Mapping[str, np.ndarray],
    match: ColumnMatch,
    mechanism: Mechanism,
    place: str,
    *,
    way: Smoothing | Spline,
    origin: TimeOrigin | None = None,
) -> Motion:
    """Return the motion in the columns of a table that are matched.

    Its times are since `origin`, if there is one. Either `t` and one column per joint (samples: the rates are those of
    a spline along or through them), or `t` and ``NAME.q, NAME.qd, NAME.q2d, ...`` for every joint (used as they are).
    Wrenches that bodies or merged links exert come in columns ``BODY.mx .. BODY.fz``, again as samples or with all
    rates, ``BODY.fxd, BODY.fx2d, ...``. Of joints that follow others in closed loops, the first row decides on the
    branch, if it states them. Raises `JounceError` where units are suspect, t does not increase, or samples are few.
    """
    joints, several = positions.names(mechanism), positions.list_multiscrew_joints(mechanism)
    highest, sampled = match.highest, match.sampled
    # Columns in SI units, by the names that the robot has for them.
    si = {name: columns[source] * match.factors[name] for name, source in match.sources.items()}
    t = si[TIME]
    rounding, time_notes = 0.0, tuple[str, ...]()
    if origin is not None:
        rounding = origin.rounding(t)
        time_notes = (*origin.notes, *rounding_notes(rounding, highest))
    si, turn_notes = _align_turns(si, match, mechanism, place)
    # States: rows of q, qd, ... (N, n) each, or samples of q alone.
    stems = column_stems(mechanism)
    rows, rate_notes = ((), ()) if sampled else _add_jerk(t, collect_rates(si, stems), highest, joints)
    q = np.stack([si[name] for name in joints], axis=1) if sampled else rows[0]
    q, wrap_notes = _follow_turns(t, q, match, mechanism, place)
    if not sampled:
        rows = (q, *rows[1:])
    qd = rows[1] if len(rows) > 1 else None
    units.check_units(t, q, qd, mechanism, (match.angles_stated, match.time_stated), place)
    # The base and the wrenches may be samples where the joints have rates, and the other way round.
    wrench_columns = {name: si[name] for name in body_columns.select_wrench_columns(list(si), mechanism)}
    base_columns = {name: si[name] for name in body_columns.select_base_columns(list(si), mechanism)}
    has_sampled_wrenches = body_columns.are_wrenches_sampled(wrench_columns)
    has_sampled_base = len(base_columns) > 0 and body_columns.are_poses_sampled(list(base_columns))
    if not (sampled or has_sampled_wrenches or has_sampled_base):
        refuse_smoothing(way, place, "all rates are in the table")
    samples = fit_curve(SampledColumns(t, q, highest, place, joints, rounding=rounding), way) if sampled else None
    branch = {name: float(si[column][0]) for name, column in follower_columns(mechanism, si, sampled).items()}
    follower_notes = _compare_followers(mechanism, si, q, sampled)
    base, base_notes = body_columns.curve_from_columns(t, base_columns, way, highest, place)
    # Forces take two rates of q more than they have themselves, and W enters them as it is.
    W, wrench_notes = body_columns.build_wrenches(t, wrench_columns, mechanism, max(highest - 2, 0), way, place)
    measured = _measured_torques(columns, match, mechanism.coordinates)
    if samples is None:
        jumps = smoothness.describe_rate_jumps(rows)
        if jumps is not None:
            warn(f"{place}: {jumps}")
        samples = SampleCurve(_curve_of_rates(t, rows, si, rounding, place, stems), ALL_RATES_SOURCE)
    return Motion(
        samples.curve,
        joints,
        samples.source,
        W,
        samples=(t, q) if sampled else None,
        residual=samples.residual,
        grid=t,
        torques=None if measured is None else (t, measured),
        notes=(
            *time_notes,
            *match.notes,
            *rate_notes,
            *turn_notes,
            *wrap_notes,
            *samples.notes,
            *follower_notes,
            *base_notes,
            *wrench_notes,
        ),
        base_curve=base,
        branch=branch,
        several=several,
        commanded=match.commanded,
    )


def poses_from_columns(
    columns: Mapping[str, np.ndarray],
    match: ColumnMatch,
    mechanism: Mechanism,
    place: str,
    *,
    approach: Mapping[str, str],
    rows: Sequence[str] | None,
) -> Poses:
    """Return the poses at rest in matched columns of a table.

    `rows` are the places of rows that are a pose each; None of a log, whose holds are the poses. `approach` are the
    columns of directions, by joint.
    """
    joints = positions.names(mechanism)
    si = {name: columns[source] * match.factors[name] for name, source in match.sources.items()}
    q = np.stack([si[name if match.sampled else f"{name}.q"] for name in joints], axis=1)
    torques = _measured_torques(columns, match, mechanism.coordinates)
    if torques is None:
        torques = np.full((len(q), len(joints)), np.nan)
    if rows is None:
        q, notes = _follow_turns(si[TIME], q, match, mechanism, place)
        units.check_units(si[TIME], q, None, mechanism, (match.angles_stated, match.time_stated), place)
        with locate_errors(place):
            poses = find_holds(si[TIME], q, torques, joints)
        return replace(poses, notes=(*match.notes, *notes, *poses.notes))
    # Rows at rest have no speeds by which degrees show themselves: positions do.
    cure = None if match.angles_stated else units.ANGLES_OPTION_CURE
    units.check_angles(si[TIME], q, np.zeros_like(q), mechanism, place, cure)
    rates = collect_rates(si, column_stems(mechanism))
    if len(rates) > 1:
        _refuse_velocities(rates[1], joints, rows)
    directions = None
    if len(approach) > 0:
        unknown = np.zeros(len(q))
        for column in approach.values():
            for row in np.flatnonzero(~np.isin(columns[column], (-1.0, 0.0, 1.0)))[:1]:
                expected = "expected 1 of a joint that moved up before it rested, -1 down, 0 if unknown"
                raise JounceError(
                    f"{rows[row]}: column {quote_value(column)} holds {columns[column][row]:g}; {expected}"
                )
        directions = np.stack([columns[approach[j]] if j in approach else unknown for j in joints], axis=1)
    with locate_errors(place):
        return Poses(q, torques, tuple(joints), directions, angles="rad", places=tuple(rows), notes=match.notes)


def _refuse_velocities(qd: np.ndarray, joints: Sequence[str], rows: Sequence[str]) -> None:
    """Raise `JounceError` where velocities (N, n) of poses are not 0."""
    moving = np.argwhere(np.abs(qd) > MAX_REST_SPEED)
    for i, j in moving[:1]:
        came = f"{rows[i]}: {shorten(joints[j])} moves at {qd[i, j]:.3g} rad/s or m/s"
        cure = "leave this row out, or add the column of times of a log"
        raise JounceError(f"{came}; a table without times states poses at rest: {cure}")


def points_from_columns(
    columns: Mapping[str, np.ndarray], match: ColumnMatch, mechanism: Mechanism, place: str
) -> tuple[np.ndarray, dict[str, float]]:
    """Return way points (k, nq) of the columns of a table without times.

    Where joints that follow others in closed loops are at the first point comes with them, by name. Other columns are
    refused, as one of them may be times.
    """
    joints = positions.names(mechanism)
    followers = follower_columns(mechanism, match.sources, True)
    others = [source for name, source in match.sources.items() if name not in {TIME, *joints, *followers.values()}]
    others += [*match.torques.values(), *match.others]
    if not match.sampled:
        raise JounceError(f"{place}: there are columns of rates and none of times; {join_cures([TIME_CURE])}")
    if len(others) > 0:
        name_joints = Remedy(
            "name those of the points by columns='{joint}'", "name those of the points by --columns '{joint}'"
        )
        raise JounceError(
            f"{place}: no column of times, and columns that are no positions of joints: {join_names(others)};"
            f" {join_cures([TIME_CURE, name_joints])}"
        )
    si = {name: columns[source] * match.factors[name] for name, source in match.sources.items()}
    q = np.stack([si[name] for name in joints], axis=1)
    return q, {name: float(si[column][0]) for name, column in followers.items()}


def _align_turns(
    si: Mapping[str, np.ndarray], match: ColumnMatch, mechanism: Mechanism, place: str
) -> tuple[dict[str, np.ndarray], list[str]]:
    """Return columns with quaternions whose signs follow each other, and notes.

    Balls, planar and free joints have such columns, and rates of them: where velocities are stated, the rates follow.
    """
    aligned, notes = dict(si), list[str]()
    by_twist = joints_with_velocities(match.sources, mechanism)
    for joint in positions.list_multiscrew_joints(mechanism):
        if joint in by_twist:
            aligned |= _rates_by_velocity(aligned, joint)
        with locate_errors(place):
            turn = joint.names[len(joint.group.places) :]
            aligned, joint_notes = align_quaternions(aligned, turn, match.sampled)
        notes += joint_notes
    return aligned, notes


def _curve_of_rates(
    t: np.ndarray,
    rows: tuple[np.ndarray, ...],
    si: Mapping[str, np.ndarray],
    rounding: float,
    place: str,
    stems: Sequence[str],
) -> HermiteCurve:
    """Return the curve through rows of all rates, with deviations if stated."""
    spreads = collect_rates(si, stems, DEVIATION)[: len(rows)]
    return HermiteCurve(t, rows, spreads if len(spreads) == len(rows) else None, rounding, place, tuple(stems))


def _follow_turns(
    t: np.ndarray, q: np.ndarray, match: ColumnMatch, mechanism: Mechanism, place: str
) -> tuple[np.ndarray, tuple[str, ...]]:
    """Return positions q (N, nq) without the wraps of encoders, and notes.

    Wraps are refused unless it is asked to take them off.
    """
    joints = wraps.Turning.of_robot(mechanism)
    if match.unwrap:
        return wraps.unwrap(t, q, joints, place)
    # Where the unit of angles changes they jump too: such jumps are no wraps.
    units.refuse_unit_changes(t, q, mechanism, place)
    wraps.refuse_wraps(t, q, joints, place)
    return q, ()


def _add_jerk(
    t: np.ndarray, rows: tuple[np.ndarray, ...], highest: int, joints: Sequence[str]
) -> tuple[tuple[np.ndarray, ...], tuple[str, ...]]:
    """Return rows with q3d, where only q3d is missing, and notes.

    It is the difference of q2d to the next row.
    """
    if len(rows) != JERK_ORDER or highest != JERK_ORDER:
        return rows, ()
    between = np.diff(rows[2], axis=0) / np.diff(t)[:, None]
    # How much differences change from row to row is how far off q3d may be.
    most = np.abs(np.diff(between, axis=0)).max(axis=0, initial=0)
    largest = f"{most.max():.2g} of {joints[int(most.argmax())]}"
    note = f"q3d is the difference of q2d to the next row, and changes by up to {largest} from row to row"
    return (*rows, np.concatenate([between, between[-1:]])), (note,)


def _compare_followers(
    m: Mechanism, columns: Mapping[str, np.ndarray], q: np.ndarray, sampled: bool
) -> tuple[str, ...]:
    """Return a note where following joints are stated at other positions.

    These joints follow others by constant ratios: their columns are not read.
    """
    if m.closure is None or len(m.closure.ratios.places) == 0:
        return ()
    ratios, stated = m.closure.ratios, follower_columns(m, columns, sampled)
    largest, worst_joint = MAX_FOLLOWER_OFFSET, ""
    for j, x in zip(ratios.places, ratios.positions(q).T, strict=True):
        name = m.tree.coordinates[j]
        if name in stated:
            largest, worst_joint = max((largest, worst_joint), (float(np.abs(columns[stated[name]] - x).max()), name))
    if worst_joint == "":
        return ()
    return (f"{worst_joint} is up to {largest:.3g} off where the coordinates take it, and is not read",)


def _rates_by_velocity(columns: Mapping[str, np.ndarray], joint: Position) -> dict[str, np.ndarray]:
    """Return columns of rates of a joint whose velocities are stated."""
    p = np.stack([columns[name] for name in joint.names], axis=1)
    rates = compute_numbers(joint.group, p, collect_rates(columns, joint.velocities))
    return {rate_name(x, k): rate[:, j] for k, rate in enumerate(rates, 1) for j, x in enumerate(joint.names)}


def _measured_torques(
    columns: Mapping[str, np.ndarray], match: ColumnMatch, joints: Sequence[str]
) -> np.ndarray | None:
    """Return measured torques (N, n), NaN for joints without them.

    None if no joint has any. Infinite torques are as unknown as missing ones.
    """
    if len(match.torques) == 0:
        return None
    missing = np.full(len(columns[match.sources[TIME]]), np.nan)
    torques = np.stack([columns[match.torques[j]] if j in match.torques else missing for j in joints], axis=1)
    # Currents become torques; the factors are 1 where torques are read.
    torques *= [match.torque_factors.get(joint, 1.0) for joint in joints]
    return np.where(np.isfinite(torques), torques, np.nan)
