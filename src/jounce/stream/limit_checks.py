"""The job of `jounce check`: the limits along motions, between rows too.

Rows that state all rates are checked in stretches, each from the last row of the one before: a check of a motion is the
merge of the checks of its stretches.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

from jounce.dynamics.quantities import DEFAULT_QUANTITY
from jounce.engine.hidden_vibrations import find_hidden_vibrations
from jounce.io.motions.part_rows import read_motions
from jounce.io.motions.skipped_rows import Skipped
from jounce.io.motions.stretches import read_stretches
from jounce.io.motions.table_parts import InputPart, TableLayout
from jounce.limits.check import check
from jounce.limits.limited_motion import required_order
from jounce.limits.verdicts import Check
from jounce.motion.motion import Motion
from jounce.stream.job import Block, Job
from jounce.stream.results import MotionFacts, MotionResult


@dataclass(frozen=True, eq=False)
class CheckJob(Job):
    """Every limit of the robot; the order is that of the rates of Q that its limits take."""

    @property
    def highest(self) -> int:
        """The highest rate of q that the results take."""
        return self.order + DEFAULT_QUANTITY.takes.rates - 1

    def compute_part(self, layout: TableLayout, part: InputPart, skipped: list[Skipped]) -> Iterator[Block]:
        """The blocks of a part; rows that state all rates are checked up to the first row behind it."""
        if layout.independent:
            stretches = read_stretches(layout, part, skipped)
        else:
            motions = read_motions(layout, part, skipped)
            stretches = ((name, len(motion.times), motion) for name, motion in motions)
        for name, rows, motion in stretches:
            found = summarize_check(self, motion, check(self.robot, motion))
            yield Block((), (), [(name, replace(found, rows=rows))])


def summarize_check(job: Job, motion: Motion, found: Check) -> MotionResult:
    """What is kept of the check of a motion: its notes are those of the motion and of the check."""
    hidden = find_hidden_vibrations(job.robot, motion, required_order(job.robot))
    facts = MotionFacts(notes=(*motion.notes, *found.notes), hidden=hidden)
    return MotionResult(len(motion.times), (motion.start, motion.stop), facts, check=replace(found, breaks=()))
