"""Every limit along a motion: the worst values, between samples too, and when limits are broken."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np

from jounce.core.display import HtmlDisplay
from jounce.core.errors import join_names
from jounce.core.progress import stage
from jounce.engine.along import ForceBreak, find_force_breaks
from jounce.engine.contact_limits import are_limited
from jounce.engine.contact_motion import refuse_hovering
from jounce.engine.engine import Engine
from jounce.limits.commands import CommandDifferences, take_differences
from jounce.limits.contact_ratios import judge_contacts
from jounce.limits.deviations import compute_deviations, is_measured
from jounce.limits.doubts import describe_wrong_inertias, find_doubts, with_consistent_inertias
from jounce.limits.joints import joint_units
from jounce.limits.limited_motion import LimitedMotion, Span
from jounce.limits.measured_torques import EFFORT, describe_play, find_contradictions
from jounce.limits.motion_polynomials import split_motion
from jounce.limits.omissions import describe_lacks, describe_omissions, describe_unresolved
from jounce.limits.ratios import SIGNS
from jounce.limits.uncertain_spans import judge_samples, judge_values
from jounce.limits.validation import validate_limits
from jounce.limits.verdicts import Verdict, combine_verdicts, decide_verdict, describe_verdict, join_spans
from jounce.limits.worst_values import Spans, Worst
from jounce.model.limit_kinds import EFFORT_KINDS, LIMIT_KINDS, describe_kind
from jounce.motion.reliability import MAX_CERTAIN_SHARE

SAMPLES_CAUSE = "the limit lies within two standard deviations of the value, which follows from measured samples"
UNRESOLVED_CAUSE = "the value changes too fast between samples to be followed"


@dataclass(frozen=True)
class CheckedLimit:
    """One limit of one coordinate along a motion, at the time when it is nearest or farthest beyond.

    Attributes
    ----------
    joint, limit : str
        The coordinate or contact, and the kind or row of its limit: "position", ..., "power", "friction along x", ...
    of : str or None
        Which force an effort limit bounds: "Q" or "Q - Qgrav".
    unit : str
        The unit of `value`, `bound` and `margin`.
    value, bound : float
        The worst value, and the bound on its side; infinite where a lower rate jumps.
    ratio : float
        Above 1 where the limit is broken: value / bound, for positions measured from the middle of their range.
    margin : float
        How far the value stays from the bound, negative where it is beyond.
    t : float
        When, s.
    deviation : float or None
        Standard deviation of the ratio, for measured motions.
    violations : tuple of (start, stop)
        When the limit is broken, s; of measured samples, by more than two standard deviations.
    certain : (float, float) or None
        Where `value` lies in an uncertain end of measured samples, the worst value outside of these and its time, s;
        else None. There deviations are more than ten times their median, and that of the value more than 5 % of it.
    undecided : tuple of (start, stop)
        When nothing decides, s: where the value of measured samples lies less than two standard deviations from the
        limit, or its deviation is not known; where a computed effort breaks it and the measured torque does not; where
        a value changes too fast between samples to be followed; all the time for forces of joints that move no mass,
        limits of 0, and where inertias that no body can have decide.
    cause : str or None
        Why the limit is undecided at these times, in words.

    Examples
    --------
    >>> import jounce
    >>> robot = jounce.load("planar2r").with_limits(velocity=1.0)
    >>> robot.check(jounce.Motion.polynomial([[0, 2], [0, 0.5]], duration=1.0)).worst.ratio
    2.0
    """

    joint: str
    limit: str
    of: str | None
    unit: str
    value: float
    bound: float
    ratio: float
    margin: float
    t: float
    deviation: float | None
    violations: tuple[Span, ...]
    undecided: tuple[Span, ...] = ()
    certain: tuple[float, float] | None = None
    cause: str | None = None

    @property
    def verdict(self) -> Verdict:
        """Whether the limit is surely "broken" at some time, surely "kept" to rounding all the time, or "undecided"."""
        return decide_verdict(self.violations, self.undecided)

    @property
    def ok(self) -> bool:
        """Whether the limit is kept all the time; False where that is undecided."""
        return self.verdict == "kept"

    @property
    def words(self) -> str:
        """The kind of limit in words, and the force that it bounds unless that is Q."""
        return describe_kind(self.limit, self.of)

    def __str__(self) -> str:
        of = f" of {self.of}" if self.of else ""
        numbers = f"{self.value:.6g} of {self.bound:.6g} {self.unit}"
        when = f"at t = {self.t:.6g} s, ratio {self.ratio:.4g}"
        return f"{self.limit.replace('_', ' ')}{of} of {self.joint}: {numbers} {when}"


@dataclass(frozen=True, repr=False)
class Check(HtmlDisplay):
    """Every limit of a robot along a motion. `Robot.check` makes one.

    Attributes
    ----------
    table : tuple of CheckedLimit
        Each limit of each coordinate that is stated, in the order of the coordinates.
    breaks : tuple of ForceBreak
        Where Q or one of its rates jumps or does not exist; none where no force is limited.
    notes : tuple of str
        What cannot be met or is not checked, in words.
    judged : mapping of str to float
        By kind of limit, the share of time from 0 to 1 in which each joint is known to keep or break it: 1 for motions
        that are exact. Of measured samples a limit counts as kept or broken where the value lies two standard
        deviations or more from it. 0 for kinds that are stated and not judged, as of motors where joints are rigid, or
        beyond the differences that a controller takes, and where no joint is decided along any motion.

    Examples
    --------
    >>> import jounce
    >>> robot = jounce.load("panda", lock={"panda_finger_joint1": 0.0})
    >>> home = [0, -0.785, 0, -2.356, 0, 1.571, 0.785]
    >>> motion = jounce.Motion.trapezoidal([home, [q + 0.5 for q in home]], 1.0, 5.0)
    >>> found = robot.check(motion)
    >>> found.ok, found.worst.joint, found.worst.limit
    (True, 'panda_joint4', 'position')
    """

    table: tuple[CheckedLimit, ...]
    breaks: tuple[ForceBreak, ...] = ()
    notes: tuple[str, ...] = ()
    judged: Mapping[str, float] = field(default_factory=dict)

    def __repr__(self) -> str:
        return f"<Check: {self.words}; worst: {self.worst}>"

    @property
    def verdict(self) -> Verdict:
        """Whether every limit is "kept", one is "broken", or that is "undecided": none is surely broken."""
        return combine_verdicts([row.verdict for row in self.table])

    @property
    def ok(self) -> bool:
        """Whether every limit of the table is kept all the time; False where that is undecided."""
        return self.verdict == "kept"

    @property
    def words(self) -> str:
        """The verdict in words, with the shares of time that are judged unless that is all of it."""
        return describe_verdict([row.verdict for row in self.table], self.judged)

    @property
    def worst(self) -> CheckedLimit:
        """The limit with the largest ratio."""
        return max(self.table, key=lambda row: row.ratio)


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
    if differences := take_differences(b):
        return _check_differences(b, differences)
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
    return _doubt_rows(b, Check(table, breaks, notes, _judged_shares(b, undecided)), _place_doubts(b))


def _check_differences(b: LimitedMotion, differences: CommandDifferences) -> Check:
    """Every limit that differences of commands are compared with; those of measured motions have deviations."""
    worst, undecided, of = differences.worst(), Spans(), differences.b
    if is_measured(b.motion):
        worst = Worst(of)
        judge_values(of, worst, differences.t, differences.values, undecided)
    table = _build_table(of, worst, undecided, _copy_worst(worst), dict.fromkeys(undecided, SAMPLES_CAUSE))
    notes = (*differences.notes, *describe_omissions(b, ()))
    judged = differences.judged | _judged_shares(of, undecided)
    judged = {kind: share * differences.judged[kind] for kind, share in judged.items()}
    return _doubt_rows(b, Check(table, (), notes, judged), _place_doubts(of))


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
