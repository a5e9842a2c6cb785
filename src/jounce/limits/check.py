"""Every limit along a motion: the worst values, between samples too, and when limits are broken."""

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from jounce.core.errors import join_names
from jounce.core.progress import stage
from jounce.engine.along import ForceBreak, find_force_breaks
from jounce.engine.contact_limits import are_limited
from jounce.engine.contact_motion import refuse_hovering
from jounce.engine.engine import Engine
from jounce.limits.commands import JudgedCommands, take_differences
from jounce.limits.contact_ratios import judge_contacts
from jounce.limits.deviations import compute_deviations, is_measured
from jounce.limits.doubts import describe_wrong_inertias, find_doubts, with_consistent_inertias
from jounce.limits.joints import joint_units
from jounce.limits.limited_motion import LimitedMotion
from jounce.limits.measured_torques import EFFORT, describe_play, find_contradictions
from jounce.limits.motion_polynomials import split_motion
from jounce.limits.omissions import describe_lacks, describe_omissions, describe_unresolved
from jounce.limits.ratios import SIGNS
from jounce.limits.uncertain_spans import judge_samples, judge_values
from jounce.limits.validation import validate_limits
from jounce.limits.verdicts import Check, CheckedLimit, combine_verdicts, join_spans
from jounce.limits.worst_values import Spans, Worst
from jounce.model.limit_kinds import EFFORT_KINDS, LIMIT_KINDS
from jounce.motion.reliability import MAX_CERTAIN_SHARE

SAMPLES_CAUSE = "the limit lies within two standard deviations of the value, which follows from measured samples"
UNRESOLVED_CAUSE = "the value changes too fast between samples to be followed"


@stage("limits along the motion")
def check(robot: Engine, motion: object) -> Check:
    """Every limit of a robot along a motion, or at the commands of one."""
    b = validate_limits(robot, motion)
    found = _check_limits(b)
    consistent, bodies = with_consistent_inertias(b.robot)
    if not bodies or not (b.forces or are_limited(robot.mechanism)):
        return found
    # Rows that are decided otherwise with inertias that bodies can have are undecided.
    others = _check_limits(replace(b, robot=consistent)).table
    causes = {
        place: describe_wrong_inertias(bodies, other.verdict)
        for place, (row, other) in enumerate(zip(found.table, others, strict=True))
        if row.verdict != other.verdict
    }
    return _doubt_rows(b, found, causes)


def _check_limits(b: LimitedMotion) -> Check:
    """Every limit along a motion with the inertias of a robot, but for limits of 0 and joints that move no mass."""
    if commands := take_differences(b):
        return _check_commands(b, commands)
    refuse_hovering(b.robot, b.motion)
    contacts = tuple(CheckedLimit(*row) for row in judge_contacts(b)) if are_limited(b.robot.mechanism) else ()
    if combine_verdicts([row.verdict for row in contacts]) == "broken":  # there are no forces
        b = b.select_kinds([kind for kind in b.kinds if LIMIT_KINDS[kind].of == "q"])
    breaks = find_limited_breaks(b)
    b = replace(b, switches=tuple(found.t for found in breaks if not found.causes))
    worst, measured = Worst(b), bool(b.kinds) and is_measured(b.motion)
    take = worst.take_worst if measured else worst.take
    for pieces in split_motion(b):
        take(pieces)
    known = _copy_worst(worst)
    undecided = judge_samples(b, worst) if measured else {}
    causes = dict.fromkeys(undecided, SAMPLES_CAUSE)
    for of, spans in worst.unresolved.items():
        undecided[of] = undecided.get(of, []) + spans
        causes[of] = UNRESOLVED_CAUSE
    worst.take_jumps(breaks)
    notes = (*describe_omissions(b, breaks), *describe_unresolved(worst), *describe_lacks(b, b.motion))
    if measured and b.force_rates:
        notes += describe_play(b)
    for j, cause in (find_contradictions(b, worst) if measured else {}).items():
        undecided[EFFORT, j] = undecided.get((EFFORT, j), []) + worst.drop_spans(EFFORT, j)
        causes[EFFORT, j] = cause
        notes += (f"undecided: effort of {b.joints[j]}: {cause}",)
    table = (*_build_table(b, worst, undecided, known, causes), *contacts)
    found = Check(table, breaks, notes, _judged_shares(b, undecided), b.whole)
    return _doubt_rows(b, found, _place_doubts(b))


def _check_commands(b: LimitedMotion, commands: JudgedCommands) -> Check:
    """Every limit that differences of commands are compared with; those of measured motions have deviations."""
    of, t, undecided = commands.b, commands.q.times[1:], Spans()
    worst = Worst(of)
    if is_measured(b.motion):
        judge_values(of, worst, t, {kind: channel.values for kind, channel in commands.limited.items()}, undecided)
    else:
        for kind, channel in commands.limited.items():
            for sign in SIGNS:
                worst.take_values(kind, sign, t, sign * channel.values, of.scales[kind].beyond(channel.values, sign))
    table = _build_table(of, worst, undecided, _copy_worst(worst), dict.fromkeys(undecided, SAMPLES_CAUSE))
    notes = (*commands.notes, *describe_omissions(b, ()))
    found = Check(table, (), notes, _judged_shares(of, undecided), b.whole)
    return _doubt_rows(b, found, _place_doubts(of))


def _place_doubts(b: LimitedMotion) -> dict[int, str]:
    """The causes for which limits are undecided along every motion, by their places in the table."""
    doubts = find_doubts(b)
    return {i: doubts[of] for i, of in enumerate(_limited_columns(b)) if of in doubts}


def _doubt_rows(b: LimitedMotion, found: Check, causes: Mapping[int, str]) -> Check:
    """The check with some rows undecided all the time, each for a cause."""
    if not causes:
        return found
    rows = list(found.table)
    for i, cause in causes.items():
        rows[i] = replace(rows[i], violations=(), undecided=(b.whole,), cause=cause)
    of_cause: dict[str, list[str]] = {}
    for i, cause in causes.items():
        of_cause.setdefault(cause, []).append(f"{rows[i].limit.replace('_', ' ')} of {rows[i].joint}")
    notes = tuple(f"undecided: {join_names(names)}: {cause}" for cause, names in of_cause.items())
    decided = {row.limit for i, row in enumerate(rows) if i not in causes}
    judged = {kind: share * (kind in decided) for kind, share in found.judged.items()}
    return replace(found, table=tuple(rows), notes=(*found.notes, *notes), judged=judged)


def find_limited_breaks(b: LimitedMotion) -> tuple[ForceBreak, ...]:
    """Where the forces that are limited are not smooth."""
    return find_force_breaks(b.robot, b.motion, b.motion.times, b.force_order, row=b.efforts) if b.forces else ()


def _copy_worst(worst: Worst) -> dict[tuple[str, int], tuple[np.ndarray, np.ndarray]]:
    """The worst values and their times by kind and sign, as they are now."""
    return {side: (value.copy(), worst.t[side].copy()) for side, value in worst.value.items()}


def _limited_columns(b: LimitedMotion) -> list[tuple[str, int]]:
    """The kind and joint of each row of the table."""
    return [
        (kind, j) for j in range(len(b.joints)) for kind in b.kinds if np.isfinite(b.limits.bounds(kind)[:, j]).any()
    ]


def _build_table(
    b: LimitedMotion,
    worst: Worst,
    undecided: Spans,
    known: Mapping[tuple[str, int], tuple[np.ndarray, np.ndarray]],
    causes: Mapping[tuple[str, int], str] = MappingProxyType({}),
) -> tuple[CheckedLimit, ...]:
    """The rows of the table, with the worst values and times that are `known` within windows, by kind and sign."""
    ratios, units = worst.ratios, joint_units(b.robot.mechanism)
    limited = [(kind, max(SIGNS, key=lambda sign: ratios[kind, sign][j]), j) for kind, j in _limited_columns(b)]
    off = compute_deviations(b, np.array([worst.t[kind, sign][j] for kind, sign, j in limited]))
    rows = []
    for i, (kind, sign, j) in enumerate(limited):
        value, bound = (sign * float(x[j]) for x in (worst.value[kind, sign], b.scales[kind].bound(sign)))
        spread, reach = float(off[kind][i, j]) if kind in off else np.nan, float(abs(b.scales[kind].reach(sign)[j]))
        t, (start, stop) = float(worst.t[kind, sign][j]), b.window(kind)
        near = max(SIGNS, key=lambda s: b.scales[kind].ratio(s * known[kind, s][0], s)[j])
        certain = near * float(known[kind, near][0][j]), float(known[kind, near][1][j])
        rows.append(CheckedLimit(
            joint=b.name(kind, j),
            limit=kind,
            of=b.limits.of(kind) if kind in EFFORT_KINDS else None,
            unit=LIMIT_KINDS[kind].unit(units[j]),
            value=value,
            bound=bound,
            ratio=float(ratios[kind, sign][j]),
            margin=sign * (bound - value),
            t=t,
            deviation=None if np.isnan(spread) or not reach else spread / reach,
            violations=join_spans(worst.broken_spans(kind, j)),
            undecided=join_spans(undecided.get((kind, j), [])),
            certain=None if start <= t <= stop or spread <= MAX_CERTAIN_SHARE * abs(value) else certain,
            cause=causes.get((kind, j)),
        ))  # fmt: skip
    return tuple(rows)


def _judged_shares(b: LimitedMotion, undecided: Spans) -> dict[str, float]:
    """The share of time in which each kind is decided for all joints, 0 for those that nothing is checked against."""
    shares = dict.fromkeys(b.limits.kinds, 0.0)
    for kind in b.kinds:
        spans = join_spans([span for (of, _), found in undecided.items() if of == kind for span in found])
        share = sum(stop - start for start, stop in spans) / b.motion.duration if b.motion.duration else bool(spans)
        shares[kind] = 1.0 - share
    return shares
