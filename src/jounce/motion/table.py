"""Make motions of tables: of samples or all rates, matched by joint name.

`motion_from_columns` is the door, for columns in any order that are matched already. It takes whole turns and units
into account, makes curves of joints, base and wrenches, and notes what is odd.

Where the first stamp of a log is large, times are since then (`TimeOrigin`), subtracted in all digits of the file:
doubles of seconds since 1970 step by 2.4e-7 s. At 1 rad/s and 1 kHz, fourth differences make 1e6 rad/s^4 of that.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from decimal import Decimal

import numpy as np

from jounce.core.errors import locate_errors, warn
from jounce.model import positions
from jounce.model.mechanism import Mechanism
from jounce.model.positions import Position
from jounce.motion import body_columns, smoothness, units, wraps
from jounce.motion.base import align_quaternions, compute_numbers
from jounce.motion.hermite import HermiteCurve, collect_rates
from jounce.motion.motion import Motion
from jounce.motion.sample_curves import SampleCurve, fit_curve
from jounce.motion.spline import SampledColumns, Smoothing, Spline, refuse_smoothing
from jounce.motion.table_columns import (
    DEVIATION,
    TIME,
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
JERK_ORDER = 3  # of q3d
ALL_RATES_SOURCE = "all rates from the table"  # the source of motions without samples


@dataclass(frozen=True)
class TimeOrigin:
    """A stamp in the unit of its column, a double and what that leaves of the stamp; and the seconds of that unit."""

    high: float
    low: float
    factor: float

    def since(self, high: np.ndarray, low: np.ndarray) -> np.ndarray:
        """Stamps less this one, in the unit of the column."""
        return np.asarray((high - self.high) + (low - self.low))

    def rounding(self, t: np.ndarray) -> float:
        """The standard deviation in s of the rounding of stamps at times t (N,) since this one; 0 if they are exact.

        They are rounded where they are multiples of the step of doubles, and not of a decimal that doubles resolve.
        """
        step = float(np.spacing(abs(self.high)))
        since = t / self.factor
        is_rounded = _is_on_grid(since, step) and not _is_on_grid(since, shortest_decimal(self.high))
        return step * self.factor / np.sqrt(12) if is_rounded else 0.0

    @property
    def notes(self) -> tuple[str, ...]:
        """When the first row was, in one sentence."""
        return (f"times are since the first row, at {self}",)

    def __str__(self) -> str:
        seconds = (Decimal(self.high) + Decimal(self.low)) * Decimal(repr(self.factor))
        text = f"{seconds:.9f}".rstrip("0").rstrip(".")
        if not EPOCH_SECONDS[0] <= seconds < EPOCH_SECONDS[1]:
            return f"{text} s"
        return f"{text} s, {datetime.fromtimestamp(float(seconds), UTC):%Y-%m-%d %H:%M:%S} UTC"


def find_origin(high: float, low: float, factor: float) -> TimeOrigin | None:
    """The origin of stamps whose first one is given; None where doubles hold such stamps well enough."""
    return TimeOrigin(high, low, factor) if MIN_LARGE_STAMP <= abs(high) * factor < np.inf else None


def rounding_notes(rounding: float, highest: int) -> tuple[str, ...]:
    """What a user should know of stamps that are rounded, of which rates up to `highest` are asked."""
    if not rounding:
        return ()
    step = f"{rounding * np.sqrt(12):.2g}"
    return (f"the stamps are doubles, in steps of {step} s; the deviations of q to {rate_name('q', highest)} hold it",)


def shortest_decimal(largest: float) -> float:
    """The power of ten whose multiples doubles up to the largest are certain to resolve."""
    return float(10.0 ** np.ceil(np.log10(2 * np.spacing(abs(largest)))))


def _is_on_grid(x: np.ndarray, step: float) -> bool:
    return bool((np.abs(x / step - np.rint(x / step)) < STAMP_GRID_TOLERANCE).all())


def motion_from_columns(
    columns: Mapping[str, np.ndarray],
    found: ColumnMatch,
    mechanism: Mechanism,
    highest: int,
    place: str,
    way: Smoothing | Spline,
    origin: TimeOrigin | None = None,
) -> Motion:
    """The motion in the columns of a table that are matched; its times are since `origin`, if there is one.

    Either `t` and one column per joint (samples: the rates are those of a spline along or through them), or
    `t` and ``NAME.q, NAME.qd, NAME.q2d, ...`` for every joint (used as they are). Wrenches that bodies or merged links
    exert come in columns ``BODY.mx .. BODY.fz``, again as samples or with all rates, ``BODY.fxd, BODY.fx2d, ...``. Of
    joints that follow others in closed loops, the first row decides on the branch, if it states them. Raises
    `JounceError` where units are suspect, t does not increase, or samples are too few.
    """
    joints, several = positions.names(mechanism), positions.list_multiscrew_joints(mechanism)
    known, by_twist = column_stems(mechanism), joints_with_velocities(found.sources, mechanism)
    si = {name: columns[source] * found.factors[name] for name, source in found.sources.items()}
    t = si[TIME]
    rounding = origin.rounding(t) if origin else 0.0
    of_times = (*origin.notes, *rounding_notes(rounding, highest)) if origin else ()
    of_turns = list[str]()
    for joint in several:
        if joint in by_twist:
            si |= _rates_by_velocity(si, joint)
        with locate_errors(place):
            si, notes_of_turns = align_quaternions(si, joint.names[len(joint.group.places) :], found.sampled)
        of_turns += notes_of_turns
    rows, of_rates = ((), ()) if found.sampled else _add_jerk(t, collect_rates(si, known), highest, joints)
    q = np.stack([si[name] for name in joints], axis=1) if found.sampled else rows[0]
    q, of_wraps = _follow_turns(t, q, found, mechanism, place)
    rows = (q, *rows[1:]) if rows else ()
    units.check_units(t, q, rows[1] if rows[1:] else None, mechanism, (found.angles_stated, found.time_stated), place)
    of_wrenches = {name: si[name] for name in body_columns.select_wrench_columns(list(si), mechanism)}
    of_base = {name: si[name] for name in body_columns.select_base_columns(list(si), mechanism)}
    of_samples = (
        body_columns.are_wrenches_sampled(of_wrenches),
        bool(of_base) and body_columns.are_poses_sampled(list(of_base)),
    )
    if not found.sampled and not any(of_samples):
        refuse_smoothing(way, place, "all rates are in the table")
    samples = fit_curve(SampledColumns(t, q, highest, place, joints, rounding=rounding), way) if found.sampled else None
    branch = {name: float(si[column][0]) for name, column in follower_columns(mechanism, si, found.sampled).items()}
    of_followers = _compare_followers(mechanism, si, q if found.sampled else rows[0], found.sampled)
    base, of_poses = body_columns.curve_from_columns(t, of_base, way, highest, place)
    W, of_loads = body_columns.build_wrenches(t, of_wrenches, mechanism, max(highest - 2, 0), way, place)
    measured = _measured_torques(columns, found, mechanism.coordinates)
    torques = None if measured is None else (t, measured)
    if samples is None:
        if jumps := smoothness.describe_rate_jumps(rows):
            warn(f"{place}: {jumps}")
        spreads = collect_rates(si, known, DEVIATION)[: len(rows)]
        curve = HermiteCurve(t, rows, spreads if len(spreads) == len(rows) else None, rounding, place, tuple(known))
        samples = SampleCurve(curve, ALL_RATES_SOURCE)
    notes = (
        *of_times,
        *found.notes,
        *of_rates,
        *of_turns,
        *of_wraps,
        *samples.notes,
        *of_followers,
        *of_poses,
        *of_loads,
    )
    made, through = (samples.curve, joints, samples.source, W), (t, q) if found.sampled else None
    return Motion(*made, through, samples.residual, t, torques, notes, base, branch, several, commanded=found.commanded)


def _follow_turns(
    t: np.ndarray, q: np.ndarray, found: ColumnMatch, mechanism: Mechanism, place: str
) -> tuple[np.ndarray, tuple[str, ...]]:
    """Positions q (N, nq) without the wraps of their encoders, and notes of it; refused if that is not asked for."""
    joints = wraps.Turning.of_robot(mechanism)
    if found.unwrap:
        return wraps.unwrap(t, q, joints, place)
    units.refuse_unit_changes(t, q, mechanism, place)  # before wraps: angles jump there too, for another reason
    wraps.refuse_wraps(t, q, joints, place)
    return q, ()


def _add_jerk(
    t: np.ndarray, rows: tuple[np.ndarray, ...], highest: int, joints: Sequence[str]
) -> tuple[tuple[np.ndarray, ...], tuple[str, ...]]:
    """Rows of q, qd, q2d with q3d, where that is asked for: the difference of q2d to the next row; and a note of it."""
    if len(rows) != JERK_ORDER or highest != JERK_ORDER:
        return rows, ()
    between = np.diff(rows[2], axis=0) / np.diff(t)[:, None]
    most = np.abs(np.diff(between, axis=0)).max(axis=0, initial=0)
    largest = f"{most.max():.2g} of {joints[int(most.argmax())]}"
    note = f"q3d is the difference of q2d to the next row, and changes by up to {largest} from row to row"
    return (*rows, np.concatenate([between, between[-1:]])), (note,)


def _compare_followers(
    m: Mechanism, columns: Mapping[str, np.ndarray], q: np.ndarray, sampled: bool
) -> tuple[str, ...]:
    """A note where columns of joints that follow by constant ratios state other positions."""
    if m.closure is None or not m.closure.ratios.places:
        return ()
    ratios, stated, worst = m.closure.ratios, follower_columns(m, columns, sampled), (MAX_FOLLOWER_OFFSET, "")
    for j, x in zip(ratios.places, ratios.positions(q).T, strict=True):
        if column := stated.get(name := m.tree.coordinates[j]):
            worst = max(worst, (float(np.abs(columns[column] - x).max()), name))
    off, name = worst
    return (f"{name} is up to {off:.3g} off where the coordinates take it, and is not read",) if name else ()


def _rates_by_velocity(columns: Mapping[str, np.ndarray], joint: Position) -> dict[str, np.ndarray]:
    """The columns of rates of the numbers of a joint whose velocities are stated."""
    p = np.stack([columns[name] for name in joint.names], axis=1)
    rates = compute_numbers(joint.group, p, collect_rates(columns, joint.velocities))
    return {rate_name(x, k): rate[:, j] for k, rate in enumerate(rates, 1) for j, x in enumerate(joint.names)}


def _measured_torques(
    columns: Mapping[str, np.ndarray], found: ColumnMatch, joints: Sequence[str]
) -> np.ndarray | None:
    """Measured torques (N, n), NaN for joints without them; None if no joint has any."""
    if not found.torques:
        return None
    missing = np.full(len(columns[found.sources[TIME]]), np.nan)
    torques = np.stack([columns[found.torques[j]] if j in found.torques else missing for j in joints], axis=1)
    return np.where(np.isfinite(torques), torques, np.nan)
