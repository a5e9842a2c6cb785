"""Motions from tables: samples, or all rates, matched by joint name in any column order."""

from collections.abc import Mapping, Sequence

import numpy as np

from jounce.core.errors import locate_errors, warn
from jounce.model.mechanism import Mechanism
from jounce.model.positions import Position, list_multiscrew_joints, position_names
from jounce.motion import loads, poses, smoothness, wraps
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
from jounce.motion.time_origin import TimeOrigin, rounding_notes
from jounce.motion.units import check_units, refuse_unit_changes
from jounce.spatial.series import rate_name

DEFAULT_SMOOTHING, DEFAULT_COLUMN_OPTIONS = Smoothing(), ColumnOptions()
MAX_FOLLOWER_OFFSET = 0.02  # rad or m: more than transmissions deflect, and less than another ratio shows
JERK_ORDER = 3  # of q3d
ALL_RATES_SOURCE = "all rates from the table"  # the source of motions without samples


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
    joints, several = position_names(mechanism), list_multiscrew_joints(mechanism)
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
    check_units(t, q, rows[1] if rows[1:] else None, mechanism, (found.angles_stated, found.time_stated), place)
    of_wrenches = {name: si[name] for name in loads.select_wrench_columns(list(si), mechanism)}
    of_base = {name: si[name] for name in poses.select_base_columns(list(si), mechanism)}
    of_samples = (loads.are_sampled(of_wrenches), bool(of_base) and poses.are_sampled(list(of_base)))
    if not found.sampled and not any(of_samples):
        refuse_smoothing(way, place, "all rates are in the table")
    samples = fit_curve(SampledColumns(t, q, highest, place, joints, rounding=rounding), way) if found.sampled else None
    branch = {name: float(si[column][0]) for name, column in follower_columns(mechanism, si, found.sampled).items()}
    of_followers = _compare_followers(mechanism, si, q if found.sampled else rows[0], found.sampled)
    base, of_poses = poses.curve_from_columns(t, of_base, way, highest, place)
    W, of_loads = loads.build_wrenches(t, of_wrenches, mechanism, max(highest - 2, 0), way, place)
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
    refuse_unit_changes(t, q, mechanism, place)  # before wraps: angles jump there too, for another reason
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
