"""What a run keeps of each motion: rows, times, peaks and root mean squares, or a check; and how parts are merged.

Sums are added in the order of the input whatever computes the parts, so that they are the same to the last bit.
"""

from dataclasses import dataclass, field, replace
from typing import Self

from jounce.core.errors import JounceError, locate_errors, quote_value
from jounce.engine.along import DescribedBreak
from jounce.engine.hidden_vibrations import HiddenVibration
from jounce.limits.samples import Sample
from jounce.limits.verdicts import Check
from jounce.motion.channel import Span
from jounce.motion.extremes import PeaksByJoint, merge_peaks
from jounce.motion.motion import Motion
from jounce.motion.table import ALL_RATES_SOURCE


@dataclass(frozen=True)
class MotionFacts:
    """What rows do not hold of a motion: where its rates come from, notes, breaks, vibrations that would not show."""

    source: str = ""
    residual: float | None = None
    notes: tuple[str, ...] = ()
    breaks: tuple[DescribedBreak, ...] = ()
    hidden: tuple[HiddenVibration, ...] = ()

    @classmethod
    def of(cls, motion: Motion) -> Self:
        """Where the rates of a motion come from, and its notes."""
        residual = None if motion.residual is None else float(motion.residual.max())
        return cls(motion.source, residual, motion.notes)


STATED = MotionFacts(ALL_RATES_SOURCE)  # of motions whose rows state all rates


@dataclass(frozen=True)
class MotionResult:
    """What is kept of a motion, or of some rows of it.

    `peaks` are by joint or motor and quantity. `broken` is the limit that is broken most at the rows, if one is.
    """

    rows: int
    span: Span
    facts: MotionFacts
    peaks: PeaksByJoint = field(default_factory=dict)
    broken: Sample | None = None
    check: Check | None = None


def add_result(known: dict[str, MotionResult], name: str, more: MotionResult) -> None:
    """Merge the result of further rows of a motion into those that are known."""
    known[name] = _merge(name, known[name], more) if name in known else more


def _merge(name: str, first: MotionResult, second: MotionResult) -> MotionResult:
    """The result of rows of a motion and of those that follow; checks of stretches share the row between them."""
    ends, begins = first.span[1], second.span[0]
    if begins < ends or (begins == ends and second.check is None):
        raise JounceError(
            f"motion {quote_value(name)} goes on at t = {begins:.17g}, and its rows before end at t = {ends:.17g};"
            " expected increasing times: sort the rows of each motion, and give motions names of their own"
        )
    with locate_errors(f"motion {quote_value(name)}"):
        check = first.check and second.check and Check.merge([first.check, second.check])
    notes = tuple(dict.fromkeys([*first.facts.notes, *second.facts.notes]))
    peaks = merge_peaks(first.peaks, second.peaks)
    broken = max((found for found in (first.broken, second.broken) if found), default=None)
    span = first.span[0], second.span[1]
    return MotionResult(first.rows + second.rows, span, replace(first.facts, notes=notes), peaks, broken, check)
