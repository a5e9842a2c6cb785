"""Verdicts on limits: kept, broken, or undecided; of one limit, of a motion, of several motions.

A `CheckedLimit` states the worst value of a limit, and the spans in which it is surely broken or undecided, from which
its verdict follows. A `Check` has one for each limit of a robot along a motion. Checks of parts of a motion merge: of
each limit the worse row is kept, with the spans of both.
"""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import reduce
from math import copysign, floor
from typing import Literal

import numpy as np

from jounce.core.display import HtmlDisplay
from jounce.core.errors import JounceError, join_names
from jounce.core.typing import JsonObject
from jounce.engine.along import ForceBreak
from jounce.model.limits import LIMIT_KINDS
from jounce.motion.channel import Span

Verdict = Literal["kept", "broken", "undecided"]


@dataclass(frozen=True)
class CheckedLimit:
    """One limit of one coordinate along a motion.

    The value is that at the time when it is nearest to the bound or farthest beyond.

    Attributes
    ----------
    joint, limit : str
        The coordinate or contact, and the kind or row of its limit: "position", ..., "power", "friction along x", ...;
        of limits of the whole robot, as "total_power", it is "robot".
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
        """The verdict: surely "broken" at some time, surely "kept" all the time, or "undecided".

        A limit is kept to rounding.
        """
        return decide_verdict(self.violations, self.undecided)

    @property
    def ok(self) -> bool:
        """Whether the limit is kept all the time.

        It is False where that is undecided.
        """
        return self.verdict == "kept"

    @property
    def words(self) -> str:
        """The kind of limit in words.

        An effort limit names the force that it bounds, unless that is Q.
        """
        return LIMIT_KINDS[self.limit].describe(self.of)

    def __str__(self) -> str:
        of = "" if self.of is None else f" of {self.of}"
        numbers = f"{self.value:.6g} of {self.bound:.6g} {self.unit}"
        when = f"at t = {self.t:.6g} s, ratio {self.ratio:.4g}"
        return f"{self.limit.replace('_', ' ')}{of} of {self.joint}: {numbers} {when}"


@dataclass(frozen=True, repr=False)
class Check(HtmlDisplay):
    """Every limit of a robot along a motion.

    `Robot.check` makes one.

    Attributes
    ----------
    table : tuple of CheckedLimit
        Each limit of each coordinate that is stated, in the order of the coordinates.
    breaks : tuple of ForceBreak
        Where Q or one of its rates jumps or does not exist; none where no force is limited.
    notes : tuple of str
        What cannot be met or is not checked, and which powers limits of the whole robot sum up, in words.
    judged : mapping of str to float
        By kind of limit, the share of time from 0 to 1 in which each joint is known to keep or break it: 1 for motions
        that are exact. Of measured samples a limit counts as kept or broken where the value lies two standard
        deviations or more from it. 0 for kinds that are stated and not judged, as of motors where joints are rigid, or
        beyond the differences that a controller takes, and where no joint is decided along any motion.
    span : (start, stop)
        The times, s, between which the motion is judged.

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
    span: Span = (0.0, 0.0)

    def __repr__(self) -> str:
        return f"<Check: {self.words}; worst: {self.worst}>"

    @property
    def verdict(self) -> Verdict:
        """The verdict: "kept", "broken", or "undecided".

        The motion is kept if every limit is, broken if one limit is surely broken, and else undecided.
        """
        return combine_verdicts([row.verdict for row in self.table])

    @property
    def ok(self) -> bool:
        """Whether every limit of the table is kept all the time.

        It is False where that is undecided.
        """
        return self.verdict == "kept"

    @property
    def words(self) -> str:
        """The verdict in words, with the shares of time that are judged.

        A share that is all of the time is not named.
        """
        return describe_verdict([row.verdict for row in self.table], self.judged)

    @property
    def worst(self) -> CheckedLimit:
        """The limit with the largest ratio."""
        return max(self.table, key=lambda row: row.ratio)

    @classmethod
    def merge(cls, parts: Sequence["Check"]) -> "Check":
        """Merge the checks of parts of a motion.

        The parts are in the order of time. Of each limit the result has the worst value of all parts, and the times at
        which any part finds it broken or undecided. A rate that jumps between two parts is in neither: cut motions
        where they are smooth.

        Parameters
        ----------
        parts : sequence of Check
            The checks of parts that follow each other, by the same limits.

        Returns
        -------
        Check
            The check of the whole motion, from the start of the first part to the end of the last.

        Raises
        ------
        JounceError
            If there is no part, the parts are of different limits, or one begins before the one before it ends.

        Examples
        --------
        >>> import jounce
        >>> robot = jounce.load("planar2r").with_limits(velocity=1.0)
        >>> slow, fast = (jounce.Motion.polynomial([[0, v], [0, 0]], duration=1.0) for v in (0.5, 2.0))
        >>> first, second = robot.check(slow), robot.check(fast.shifted(1.0))
        >>> jounce.Check.merge([first, second]).worst.ratio
        2.0
        """
        if len(parts) == 0:
            raise JounceError("Check.merge() of no checks; expected one or more")
        return reduce(_merge_two, parts)


def worst_limits(checks: Mapping[str, Check]) -> list[tuple[str, CheckedLimit]]:
    """Return the worst row of each limit of several motions.

    Each comes with the name of its motion.
    """
    worst: dict[tuple[str, str], tuple[str, CheckedLimit]] = {}
    for name, checked in checks.items():
        for row in checked.table:
            key = row.joint, row.limit
            if key not in worst or row.ratio > worst[key][1].ratio:
                worst[key] = name, row
    return [*worst.values()]


def tabulate_limits(checks: Mapping[str, Check]) -> dict[str, np.ndarray]:
    """Return columns of a table with a row per motion and limit.

    Numbers that are infinite are so in the table; texts that are not known are empty.
    """
    rows = [(name, row) for name, checked in checks.items() for row in checked.table]
    texts = {name: [getattr(row, name) for _, row in rows] for name in ("joint", "limit", "of", "unit", "verdict")}
    texts["of"] = ["" if force is None else force for force in texts["of"]]
    numbers = {name: [getattr(row, name) for _, row in rows] for name in ("value", "bound", "ratio", "margin", "t")}
    numbers["deviation"] = [np.nan if row.deviation is None else row.deviation for _, row in rows]
    columns = {name: np.array(cells, dtype=str) for name, cells in ({"motion": [x for x, _ in rows]} | texts).items()}
    return columns | {name: np.array(cells) for name, cells in numbers.items()}


def read_check(data: JsonObject) -> Check:
    """Read a check from the plain data that `dataclasses.asdict` makes of it.

    Breaks are left out.
    """
    rows = []
    for row in data["table"]:
        # Tuples are lists in plain data.
        spans = {name: tuple(map(tuple, row[name])) for name in ("violations", "undecided")}
        certain = None if row["certain"] is None else tuple(row["certain"])
        rows.append(CheckedLimit(**row | spans | {"certain": certain}))
    return Check(tuple(rows), (), tuple(data["notes"]), data["judged"], tuple(data["span"]))


def least_judged(checks: Iterable[Check]) -> dict[str, float]:
    """Return the least share of time that is judged, by kind.

    The least one is taken over several motions.
    """
    least: dict[str, float] = {}
    for checked in checks:
        for kind, share in checked.judged.items():
            least[kind] = min(share, least.get(kind, 1.0))
    return least


def _merge_two(first: Check, second: Check) -> Check:
    """Merge the checks of two parts of a motion.

    The second part follows the first one.
    """
    first_limits, second_limits = ([(row.joint, row.limit) for row in part.table] for part in (first, second))
    if first_limits != second_limits or first.judged.keys() != second.judged.keys():
        raise JounceError(
            f"checks of {len(first_limits)} and of {len(second_limits)} limits are of different robots; expected parts"
            " of one motion"
            " of one robot"
        )
    if second.span[0] < first.span[1]:
        raise JounceError(
            f"a check begins at t = {second.span[0]:.17g} s, and the one before it ends at t = {first.span[1]:.17g} s;"
            " expected parts in the order of time"
        )
    # Shares of time are weighted by how long the parts last; parts of one state have no time.
    first_time, second_time = (part.span[1] - part.span[0] for part in (first, second))
    total = first_time + second_time
    if total == 0:
        total = 1.0
    judged = {
        kind: (share * first_time + second.judged[kind] * second_time) / total for kind, share in first.judged.items()
    }
    table = tuple(_merge_rows(*rows) for rows in zip(first.table, second.table, strict=True))
    notes = tuple(dict.fromkeys([*first.notes, *second.notes]))
    return Check(table, (*first.breaks, *second.breaks), notes, judged, (first.span[0], second.span[1]))


def _merge_rows(first: CheckedLimit, second: CheckedLimit) -> CheckedLimit:
    """Return the worse of two rows of one limit.

    The result has the times of both.
    """
    worse, other = (second, first) if second.ratio > first.ratio else (first, second)
    return replace(
        worse,
        violations=join_spans(first.violations + second.violations),
        undecided=join_spans(first.undecided + second.undecided),
        certain=None if worse.certain is None else _worse_certain(worse, other),
        cause=other.cause if worse.cause is None else worse.cause,
    )


def _worse_certain(row: CheckedLimit, other: CheckedLimit) -> tuple[float, float]:
    """Return the worst certain value of two rows, and its time.

    The value of the first row lies in an uncertain end.
    """
    # The margin is sign (bound - value): this is the sign of the side, and larger signed values are worse.
    upwards = copysign(1, row.bound - row.value) * copysign(1, row.margin)
    certain_values = [(x.value, x.t) if x.certain is None else x.certain for x in (row, other)]
    return max(certain_values, key=lambda value: upwards * value[0])


def decide_verdict(broken: Sequence[object], undecided: Sequence[object]) -> Verdict:
    """Return the verdict on a limit by its spans.

    In some it is surely broken, in others nothing is sure.
    """
    if len(broken) > 0:
        return "broken"
    return "undecided" if len(undecided) > 0 else "kept"


def combine_verdicts(verdicts: Collection[Verdict]) -> Verdict:
    """Return the verdict on several limits or motions: broken if one is, kept if all are."""
    if "broken" in verdicts:
        return "broken"
    return "undecided" if "undecided" in verdicts else "kept"


def describe_verdict(verdicts: Sequence[Verdict], judged: Mapping[str, float]) -> str:
    """Describe how many limits are broken or undecided, and what is judged.

    Shares of time are named by kind, unless they are all of the time.
    """
    counts = []
    for verdict in ("broken", "undecided"):
        count = verdicts.count(verdict)
        if count > 0:
            counts.append(f"{count} of {len(verdicts)} limits {verdict}")
    summary = " and ".join(counts) if len(counts) > 0 else "every limit is kept"
    return "; ".join([summary, *describe_judged(judged)])


def describe_judged(judged: Mapping[str, float], subject: str = "judged") -> list[str]:
    """Describe the shares of time that are judged, by kind.

    Kinds that are not judged are named too. Shares that are all of the time are left out.
    """
    partly = [
        f"{floor(1e4 * share) / 1e4:.2%} of the time for {kind.replace('_', ' ')}"
        for kind, share in judged.items()
        if 0 < share < 1
    ]
    never = [kind.replace("_", " ") for kind, share in judged.items() if share == 0]
    names_by_title = {subject: partly, "not judged": never}
    return [f"{title}: {join_names(names)}" for title, names in names_by_title.items() if len(names) > 0]


def join_spans(spans: Iterable[Sequence[float]]) -> tuple[Span, ...]:
    """Return spans in the order of time, joined.

    Spans that overlap or meet become one.
    """
    joined: list[Span] = []
    for start, stop in sorted((float(start), float(stop)) for start, stop in spans):
        if len(joined) > 0 and start <= joined[-1][1]:
            last_start, last_stop = joined.pop()
            start, stop = last_start, max(stop, last_stop)
        joined.append((start, stop))
    return tuple(joined)
