"""Every limit along a motion: the worst values, between samples too, and when limits are broken."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from jounce.core.display import HtmlDisplay
from jounce.engine.along import ForceBreak, find_force_breaks
from jounce.engine.contact_limits import are_limited
from jounce.engine.contact_motion import refuse_hovering
from jounce.engine.engine import Engine
from jounce.limits.commands import take_differences
from jounce.limits.contact_ratios import judge_contacts
from jounce.limits.deviations import compute_deviations
from jounce.limits.joints import joint_units
from jounce.limits.limited_motion import LimitedMotion, Span
from jounce.limits.motion_polynomials import split_motion
from jounce.limits.omissions import describe_lacks, describe_omissions, describe_unresolved
from jounce.limits.ratios import SIGNS
from jounce.limits.uncertain_spans import count_uncertain
from jounce.limits.validation import validate_limits
from jounce.limits.verdicts import Verdict, combine_verdicts, decide_verdict, describe_verdict, join_spans
from jounce.limits.worst_values import Spans, Worst
from jounce.model.limit_kinds import EFFORT_KINDS, LIMIT_KINDS, describe_kind
from jounce.motion.reliability import MAX_CERTAIN_SHARE


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
        When the limit is broken, s.
    certain : (float, float) or None
        Where `value` lies in an uncertain end of measured samples, the worst value outside of these and its time, s;
        else None. There deviations are more than ten times their median, and that of the value more than 5 % of it.
    undecided : tuple of (start, stop)
        When measured samples do not decide, s: towards their ends, where rates are uncertain, the value lies less than
        two standard deviations from the limit, or its deviation is not known. Also where a value changes too fast
        between samples to be followed, as `Check.notes` say.

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

    @property
    def verdict(self) -> Verdict:
        """Whether the limit is "kept" to rounding, "broken", or "undecided": kept as far as the samples decide."""
        return decide_verdict(self.ratio, self.undecided)

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
        that are exact. Towards the ends of measured samples rates are uncertain; there a limit counts as kept or broken
        where the value lies two standard deviations or more from it. 0 for kinds that are stated and not judged, as of
        motors where joints are rigid, or beyond the differences that a controller takes.

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
        """Whether every limit is "kept", one is "broken", or that is "undecided": none is, as far as samples decide."""
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


def check(robot: Engine, motion: object) -> Check:
    """Every limit of a robot along a motion, or at the commands of one."""
    b = validate_limits(robot, motion)
    if differences := take_differences(b):
        worst = differences.worst()
        table = _build_table(differences.b, worst, {}, _copy_worst(worst))
        notes = (*differences.notes, *describe_omissions(b, ()))
        return Check(table, (), notes, differences.judged)
    refuse_hovering(b.robot, b.motion)
    contacts = tuple(CheckedLimit(*row) for row in judge_contacts(b)) if are_limited(b.robot.mechanism) else ()
    if combine_verdicts([row.verdict for row in contacts]) == "broken":  # there are no forces
        b = b.select_kinds([kind for kind in b.kinds if LIMIT_KINDS[kind].of == "q"])
    breaks = find_limited_breaks(b)
    b = replace(b, switches=tuple(found.t for found in breaks if not found.causes))
    worst = Worst(b)
    for pieces in split_motion(b):
        worst.take(pieces)
    certain = _copy_worst(worst)
    undecided = count_uncertain(b, worst)
    for of, spans in worst.unresolved.items():
        undecided[of] = undecided.get(of, []) + spans
    worst.take_jumps(breaks)
    notes = (*describe_omissions(b, breaks), *describe_unresolved(worst), *describe_lacks(b, b.motion))
    table = (*_build_table(b, worst, undecided, certain), *contacts)
    return Check(table, breaks, notes, _judged_shares(b, undecided))


def find_limited_breaks(b: LimitedMotion) -> tuple[ForceBreak, ...]:
    """Where the forces that are limited are not smooth."""
    return find_force_breaks(b.robot, b.motion, b.motion.times, b.force_order, row=b.efforts) if b.forces else ()


def _copy_worst(worst: Worst) -> dict[tuple[str, int], tuple[np.ndarray, np.ndarray]]:
    """The worst values and their times by kind and sign, as they are now."""
    return {side: (value.copy(), worst.t[side].copy()) for side, value in worst.value.items()}


def _build_table(
    b: LimitedMotion, worst: Worst, undecided: Spans, known: Mapping[tuple[str, int], tuple[np.ndarray, np.ndarray]]
) -> tuple[CheckedLimit, ...]:
    """The rows of the table, with the worst values and times that are `known` within windows, by kind and sign."""
    ratios, units = worst.ratios, joint_units(b.robot.mechanism)
    limited = [
        (kind, max(SIGNS, key=lambda sign: ratios[kind, sign][j]), j)
        for j in range(len(b.joints))
        for kind in b.kinds
        if np.isfinite(b.limits.bounds(kind)[:, j]).any()
    ]
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
            violations=join_spans(worst.spans[kind, 1][j] + worst.spans[kind, -1][j]),
            undecided=join_spans(undecided.get((kind, j), [])),
            certain=None if start <= t <= stop or spread <= MAX_CERTAIN_SHARE * abs(value) else certain,
        ))  # fmt: skip
    return tuple(rows)


def _judged_shares(b: LimitedMotion, undecided: Spans) -> dict[str, float]:
    """The share of time in which each kind is decided for all joints, 0 for those that nothing is checked against."""
    shares = dict.fromkeys(b.limits.kinds, 0.0)
    for kind in b.kinds:
        spans = join_spans([span for (of, _), found in undecided.items() if of == kind for span in found])
        shares[kind] = 1 - sum(stop - start for start, stop in spans) / (b.motion.duration or 1)
    return shares
