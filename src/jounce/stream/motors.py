"""The job of `jounce motors`: positions, torques, currents and voltages of the motors of elastic joints."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from jounce.actuators.along import motor_channel, motor_channels, motors_along, voltage_order
from jounce.core.errors import locate_errors
from jounce.dynamics.joint_springs import elasticity_of
from jounce.dynamics.quantities import DEFAULT_QUANTITY, find_row
from jounce.engine.along import Progress, describe_break
from jounce.engine.motion_channels import coordinate_channels
from jounce.io.motions.part_rows import read_motions
from jounce.io.motions.row_states import RowStates, compute_rows
from jounce.io.motions.skipped_rows import Skipped
from jounce.io.motions.table_parts import InputPart, TableLayout
from jounce.io.motions.writing import further_channels
from jounce.motion.channel import Channel
from jounce.motion.extremes import find_extremes
from jounce.motion.motion import Motion
from jounce.motion.table_columns import ColumnMatch
from jounce.spatial.series import rate_name
from jounce.stream.job import Block, RowJob
from jounce.stream.results import STATED, MotionFacts, MotionResult

TORQUE_NAMES = ("tau", "taud")  # of which breaks are reported
ELECTRIC = ("i", "u")
WRITTEN_RATES = {"theta": 1, "tau": 0, "i": 0, "u": 0}  # the highest rate of each quantity that is written


@dataclass(frozen=True, eq=False)
class MotorJob(RowJob):
    """theta, thetad, tau and, of motors that state their data, i and u; q with its rates if these are to be written.

    The order is the rate of tau that voltages take.
    """

    @property
    def highest(self) -> int:
        """The highest rate of q that the results take."""
        return self.order + DEFAULT_QUANTITY.takes.rates + 1 + elasticity_of(self.robot.mechanism).more_rates

    @property
    def has_memory(self) -> bool:
        """Whether results depend on the motion before: deflections of dampers, and stiffness over time."""
        e = elasticity_of(self.robot.mechanism)
        return bool((e.dampers and e.level is None) or e.pairs)

    def with_columns(self, match: ColumnMatch) -> Self:
        """The job with the rate of motor torques that voltages take, if the table states as many rates of q."""
        further = self.highest + 1
        is_known = all(f"{joint}.{rate_name('q', further)}" in match.sources for joint in self.robot.joint_names)
        return replace(self, order=voltage_order(elasticity_of(self.robot.mechanism), self.highest + is_known))

    def compute_part(self, layout: TableLayout, part: InputPart, skipped: list[Skipped]) -> Iterator[Block]:
        """The blocks of a part of a table; rows that are left out are added to `skipped`."""
        if not layout.independent:
            for name, motion in read_motions(layout, part, skipped):
                for block in self.compute_motion(name, motion):
                    yield block.aligned(motion, layout)
            return
        for runs, _, channels in compute_rows(layout, part, skipped, self.highest, self._compute_rows):
            with locate_errors(part.path):
                results = [
                    (run.motion, _summarize([x.rows(slice(run.start, run.stop)) for x in channels], STATED))
                    for run in runs
                ]
            yield Block(channels, (), results)

    def compute_motion(self, name: str, motion: Motion, show: Progress | None = None) -> Iterator[Block]:
        """The block of a motion in memory."""
        robot = self.robot
        order = voltage_order(elasticity_of(robot.mechanism), motion.highest)
        whole = motors_along(robot, motion, order=order, method=self.method, progress=show)
        channels, t = _written(whole.motors), whole.t
        if self.with_rates:
            spread = motion.deviations(t, self.highest)
            channels = [*coordinate_channels(robot.mechanism, t, motion(t, self.highest), spread), *channels]
        names = TORQUE_NAMES[: order + 1]
        described = tuple(describe_break(found, robot.joint_names, names) for found in whole.breaks)
        facts = MotionFacts.of(motion)
        facts = replace(facts, breaks=described, notes=(*facts.notes, *whole.notes))
        further = further_channels(motion, robot.joint_names, whole.breaks, t)
        yield Block(channels, further, [(name, _summarize(channels, facts))])

    def _compute_rows(self, states: RowStates) -> list[Channel]:
        robot, m = self.robot, self.robot.mechanism
        rows = [find_row(name, elasticity_of(m).more_rates) for name in ("motor_positions", "motor_torques")]
        theta, tau = (states.compute(robot, row, self.method) for row in rows)
        found = _written(motor_channels(m, theta, motor_channel(m, rows[1], states.t, tau)))
        if not self.with_rates:
            return found
        return [*coordinate_channels(m, states.t, states.rates), *found[:-1], *states.base_columns, found[-1]]


def _written(channels: Sequence[Channel]) -> list[Channel]:
    """The rates that are written of what motors do; of currents and voltages those of motors that state their data."""
    found = []
    for channel in channels:
        rates = channel.upto(WRITTEN_RATES[channel.symbol])
        stated = np.flatnonzero(~np.isnan(rates.values).all(axis=0)).tolist()
        found.append(rates.columns(stated) if channel.symbol in ELECTRIC else rates)
    return found


def _summarize(channels: Sequence[Channel], facts: MotionFacts) -> MotionResult:
    """The result of rows of one motion, of what motors do."""
    t = channels[-1].times
    of_motors = [channel for channel in channels if channel.symbol in WRITTEN_RATES]
    return MotionResult(len(t), (float(t[0]), float(t[-1])), facts, find_extremes(of_motors))
