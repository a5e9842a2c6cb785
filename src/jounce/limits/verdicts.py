"""Verdicts on limits: kept, broken, or undecided by measured samples; of several limits, in words."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from math import floor
from typing import Literal

from jounce.core.errors import join_names
from jounce.limits.limited_motion import Span

Verdict = Literal["kept", "broken", "undecided"]


def decide_verdict(broken: Sequence[object], undecided: Sequence[object]) -> Verdict:
    """The verdict on a limit by the spans in which it is surely broken, and those in which nothing is sure."""
    if broken:
        return "broken"
    return "undecided" if undecided else "kept"


def combine_verdicts(verdicts: Collection[Verdict]) -> Verdict:
    """The verdict on several limits or motions: broken if one is, kept if all are."""
    return "broken" if "broken" in verdicts else "undecided" if "undecided" in verdicts else "kept"


def describe_verdict(verdicts: Sequence[Verdict], judged: Mapping[str, float]) -> str:
    """How many limits are broken or undecided, and which share of time is judged, by kind, unless that is all of it."""
    counts = [
        f"{n} of {len(verdicts)} limits {name}" for name in ("broken", "undecided") if (n := verdicts.count(name))
    ]
    return "; ".join([" and ".join(counts) or "every limit is kept", *describe_judged(judged)])


def describe_judged(judged: Mapping[str, float], subject: str = "judged") -> list[str]:
    """The shares of time that are judged, by kind, where they are not all of it, and the kinds that are not judged."""
    partly = [
        f"{floor(1e4 * share) / 1e4:.2%} of the time for {kind.replace('_', ' ')}"
        for kind, share in judged.items()
        if 0 < share < 1
    ]
    never = [kind.replace("_", " ") for kind, share in judged.items() if not share]
    words = {subject: partly, "not judged": never}
    return [f"{title}: {join_names(names)}" for title, names in words.items() if names]


def join_spans(spans: Iterable[Sequence[float]]) -> tuple[Span, ...]:
    """Spans in the order of time; those that overlap or meet are one."""
    joined: list[Span] = []
    for start, stop in sorted((float(start), float(stop)) for start, stop in spans):
        if joined and start <= joined[-1][1]:
            start, stop = joined[-1][0], max(stop, joined.pop()[1])
        joined.append((start, stop))
    return tuple(joined)
