"""Motions from tables: samples, or all rates, matched by joint name in any column order."""

from collections.abc import Mapping, Sequence

import numpy as np

from jounce.core.errors import JounceError, at, warn
from jounce.model.mechanism import Mechanism
from jounce.model.positions import Position, position_names, several_positions
from jounce.motion import loads, poses, smoothness
from jounce.motion.base import numbers_of, turned_along
from jounce.motion.columns import DEVIATION, TIME, Match, Options, by_velocity, followers, stems
from jounce.motion.hermite import Hermite, stated_rates
from jounce.motion.motion import Motion
from jounce.motion.origin import Origin, rounding_notes
from jounce.motion.smoothed import Found, found_from
from jounce.motion.spline import Sampled, Smoothing, Spline, refuse_way
from jounce.motion.units import check_units
from jounce.spatial.series import rate_name

SMOOTHED, AS_NAMED = Smoothing(), Options()
ALL_RATES = "all rates from the table"  # the source of motions without samples


def from_columns(
    columns: Mapping[str, np.ndarray],
    found: Match,
    mechanism: Mechanism,
    highest: int,
    place: str,
    way: Smoothing | Spline,
    origin: Origin | None = None,
) -> Motion:
    """The motion in the columns of a table that are matched; its times are since `origin`, if there is one.

    Either `t` and one column per joint (samples: the rates are those of a spline along or through them), or
    `t` and ``NAME.q, NAME.qd, NAME.q2d, ...`` for every joint (used as they are). Wrenches that bodies or merged links
    exert come in columns ``BODY.mx .. BODY.fz``, again as samples or with all rates, ``BODY.fxd, BODY.fx2d, ...``. Of
    joints that follow others in closed loops, the first row decides on the branch, if it states them. Raises
    `JounceError` where units are suspect, t does not increase, or samples are too few.
    """
    joints, several = position_names(mechanism), several_positions(mechanism)
    known, by_twist = stems(mechanism), by_velocity(found.sources, mechanism)
    si = {name: columns[source] * found.factors[name] for name, source in found.sources.items()}
    t = si[TIME]
    _check_increasing(t, found.sources[TIME], place)
    rounding = origin.rounding(t) if origin else 0.0
    of_times = (*origin.notes, *rounding_notes(rounding, highest)) if origin else ()
    of_turns = list[str]()
    for joint in several:
        if joint in by_twist:
            si |= _rates_by_velocity(si, joint)
        with at(place):
            si, notes_of_turns = turned_along(si, joint.names[len(joint.group.places) :], found.sampled)
        of_turns += notes_of_turns
    rows = () if found.sampled else stated_rates(si, known)
    q = np.stack([si[name] for name in joints], axis=1) if found.sampled else rows[0]
    check_units(t, q, rows[1] if rows[1:] else None, mechanism, (found.angles_stated, found.time_stated), place)
    of_wrenches = {name: si[name] for name in loads.named(list(si), mechanism)}
    of_base = {name: si[name] for name in poses.named(list(si), mechanism)}
    of_samples = (loads.are_sampled(of_wrenches), bool(of_base) and poses.are_sampled(list(of_base)))
    if not found.sampled and not any(of_samples):
        refuse_way(way, place, "all rates are in the table")
    samples = found_from(Sampled(t, q, highest, place, joints, rounding=rounding), way) if found.sampled else None
    branch = {name: float(si[column][0]) for name, column in followers(mechanism, si, found.sampled).items()}
    base, of_poses = poses.curve_of_columns(t, of_base, way, highest, place)
    W, of_loads = loads.wrenches(t, of_wrenches, mechanism, max(highest - 2, 0), way, place)
    measured = _torques(columns, found, mechanism.coordinates)
    torques = None if measured is None else (t, measured)
    if samples is None:
        if jumps := smoothness.of_rates(rows):
            warn(f"{place}: {jumps}")
        spreads = stated_rates(si, known, DEVIATION)[: len(rows)]
        curve = Hermite(t, rows, spreads if len(spreads) == len(rows) else None, rounding, place, tuple(known))
        samples = Found(curve, ALL_RATES)
    notes = (*of_times, *found.notes, *of_turns, *samples.notes, *of_poses, *of_loads)
    made, through = (samples.curve, joints, samples.source, W), (t, q) if found.sampled else None
    return Motion(*made, through, samples.residual, t, torques, notes, base, branch, several)


def _check_increasing(t: np.ndarray, column: str, place: str) -> None:
    steps = np.flatnonzero(np.diff(t) <= 0)
    if steps.size:
        i = int(steps[0])
        follows = f"{t[i]:.17g} is followed by {t[i + 1]:.17g}, rows {i} and {i + 1} counted from 0"
        raise JounceError(
            f"{place}: {column} does not increase: {follows}; sort and repair the rows,"
            " or name another column of times by --time COLUMN (time=)"
        )


def _rates_by_velocity(columns: Mapping[str, np.ndarray], joint: Position) -> dict[str, np.ndarray]:
    """The columns of rates of the numbers of a joint whose velocities are stated."""
    p = np.stack([columns[name] for name in joint.names], axis=1)
    rates = numbers_of(joint.group, p, stated_rates(columns, joint.velocities))
    return {rate_name(x, k): rate[:, j] for k, rate in enumerate(rates, 1) for j, x in enumerate(joint.names)}


def _torques(columns: Mapping[str, np.ndarray], found: Match, joints: Sequence[str]) -> np.ndarray | None:
    """Measured torques (N, n), NaN for joints without them; None if no joint has any."""
    if not found.torques:
        return None
    missing = np.full(len(columns[found.sources[TIME]]), np.nan)
    return np.stack([columns[found.torques[j]] if j in found.torques else missing for j in joints], axis=1)
