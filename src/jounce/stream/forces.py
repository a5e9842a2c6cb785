"""The job of `jounce run`: the forces Q and their rates along motions, and the limit that rows break most."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from jounce.core.errors import locate_errors
from jounce.dynamics.quantities import DEFAULT_QUANTITY
from jounce.engine.along import Along, Progress, check_motion, compute_pieces, describe_break, find_force_breaks
from jounce.engine.hidden_vibrations import find_hidden_vibrations
from jounce.engine.motion_channels import coordinate_channels, quantity_channel
from jounce.io.motions.part_rows import MotionRun, read_motions
from jounce.io.motions.row_states import RowStates, compute_rows
from jounce.io.motions.skipped_rows import Skipped
from jounce.io.motions.table_parts import InputPart, TableLayout
from jounce.io.motions.writing import base_channels, further_channels, joint_channel
from jounce.limits.samples import find_worst_broken, reported_limits
from jounce.limits.uncertain_spans import DECISIVE_DEVIATIONS
from jounce.model.limits import Limits
from jounce.model.positions import position_extents
from jounce.motion.channel import Channel, Rates
from jounce.motion.extremes import find_extremes
from jounce.motion.motion import Motion
from jounce.stream.job import Block, RowJob
from jounce.stream.results import STATED, MotionFacts, MotionResult


@dataclass(frozen=True, eq=False)
class ForceJob(RowJob):
    """Q and its rates up to an order, and q with its rates if these are to be written."""

    @property
    def highest(self) -> int:
        """The highest rate of q that the results take."""
        return self.order + DEFAULT_QUANTITY.takes.rates - 1

    def compute_part(self, layout: TableLayout, part: InputPart, skipped: list[Skipped]) -> Iterator[Block]:
        """The blocks of a part of a table; rows that are left out are added to `skipped`."""
        limits = reported_limits(self.robot.mechanism)
        if not layout.independent:
            for name, motion in read_motions(layout, part, skipped):
                for block in self._compute_blocks(name, motion, limits):
                    yield block.aligned(motion, layout)
            return
        for runs, states, channels in compute_rows(layout, part, skipped, self.highest, self._compute_rows):
            Q = channels[-1]
            with locate_errors(part.path):
                results = [(run.motion, _summarize(Q, run, states.rates, STATED, limits)) for run in runs]
            yield Block(channels, (), results)

    def compute_motion(self, name: str, motion: Motion, show: Progress | None = None) -> Iterator[Block]:
        """The blocks of a motion in memory."""
        path = check_motion(self.robot.mechanism, motion)
        yield from self._compute_blocks(name, path, reported_limits(self.robot.mechanism), show)

    def _compute_rows(self, states: RowStates) -> list[Channel]:
        m, row = self.robot.mechanism, DEFAULT_QUANTITY
        Q = quantity_channel(m, row, states.t, states.compute(self.robot, row, self.method))
        if not self.with_rates:
            return [Q]
        return [*coordinate_channels(m, states.t, states.rates), *states.base_columns, Q]

    def _compute_blocks(
        self, name: str, motion: Motion, limits: Limits, show: Progress | None = None
    ) -> Iterator[Block]:
        robot, order = self.robot, self.order
        breaks = find_force_breaks(robot, motion, motion.times, order, self.method)
        hidden, facts = find_hidden_vibrations(robot, motion, order), None
        for piece in compute_pieces(robot, motion, motion.times, order, self.method, show):
            Q = piece.efforts
            if facts is None:
                described = tuple(describe_break(found, Q.names, Q.rate_names) for found in breaks)
                facts = replace(MotionFacts.of(motion), breaks=described, hidden=hidden)
            states = position_extents(robot.mechanism, piece.rates[0]), *piece.rates[1:]
            result = _summarize(Q, MotionRun(name, 0, len(Q.times)), states, facts, limits)
            further = further_channels(motion, robot.joint_names, breaks, piece.t)
            yield Block([*self._written_rates(motion, piece), Q], further, [(name, result)])

    def _written_rates(self, motion: Motion, piece: Along) -> list[Channel]:
        """q and its rates, and those of the base, as columns that are read again."""
        if not self.with_rates:
            return []
        t, highest = piece.t, len(piece.rates) - 1
        if motion.several:
            return [joint_channel(motion, self.robot.joint_names, t, highest), *base_channels(motion, t, highest)]
        q = replace(piece.coordinates[0], deviations=motion.deviations(t, highest))
        return [q, *base_channels(motion, t, highest)]


def _summarize(efforts: Channel, run: MotionRun, states: Rates, facts: MotionFacts, limits: Limits) -> MotionResult:
    """The result of the rows of one motion, with the limit that the states and forces there break most."""
    here = slice(run.start, run.stop)
    Q = efforts.rows(here)
    forces = Q.rates
    if Q.deviations is not None:  # what is surely there
        bands = (DECISIVE_DEVIATIONS * spread for spread in Q.deviations)
        forces = tuple(np.sign(x) * np.maximum(np.abs(x) - band, 0) for x, band in zip(forces, bands, strict=True))
    broken = find_worst_broken(limits, Q.times, tuple(rate[here] for rate in states), forces)
    return MotionResult(len(Q.times), (float(Q.times[0]), float(Q.times[-1])), facts, find_extremes([Q]), broken)
