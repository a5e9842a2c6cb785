"""Computes forces, motors or limits of every motion or row.

A job yields blocks: channels of some rows, in the order of the input, with the results of their motions: rows, times,
peaks and root mean squares, or a check (`MotionResult`). Sums are added in the order of the input, wherever parts are
computed, so that they are the same to the last bit.

`ForceJob`, `MotorJob` and `CheckJob` are the jobs of `jounce run`, `jounce motors` and `jounce check`. Rows that state
all rates are checked in stretches, each from the last row of the stretch before: the check of a motion is the merge of
the checks of its stretches.
"""

import json
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from hashlib import sha256
from secrets import token_hex
from typing import NamedTuple, Self

import numpy as np

from jounce.actuators.motors import motor_channel, motor_channels, motors_along, voltage_order
from jounce.core import code_digest, errors
from jounce.core.errors import JounceError, quote_value
from jounce.dynamics import joint_springs
from jounce.dynamics.quantities import DEFAULT_QUANTITY, find_row
from jounce.engine import along, hidden_vibrations, motion_channels
from jounce.engine.along import Along, DescribedBreak, Progress
from jounce.engine.engine import Engine
from jounce.engine.hidden_vibrations import HiddenVibration
from jounce.io import robot_writing
from jounce.io.motions import part_rows, writing
from jounce.io.motions.part_rows import MotionRun, RowStates, Skipped
from jounce.io.motions.table_parts import InputPart, Reading, TableLayout
from jounce.limits.check import check
from jounce.limits.limited_motion import required_order
from jounce.limits.samples import Sample, find_worst_broken, reported_limits
from jounce.limits.verdicts import Check
from jounce.limits.worst_values import DECISIVE_DEVIATIONS
from jounce.model import positions
from jounce.model.limits import Limits
from jounce.motion import extremes
from jounce.motion.channel import Channel, Rates, Span
from jounce.motion.extremes import PeaksByJoint
from jounce.motion.motion import Motion
from jounce.motion.table import ALL_RATES_SOURCE
from jounce.motion.table_columns import ColumnMatch
from jounce.spatial.series import rate_name


@dataclass(frozen=True)
class MotionFacts:
    """What is known of a motion besides its rows.

    It is the source of its rates, notes, breaks, and hidden vibrations.
    """

    source: str = ""
    residual: float | None = None
    notes: tuple[str, ...] = ()
    breaks: tuple[DescribedBreak, ...] = ()
    hidden: tuple[HiddenVibration, ...] = ()

    @classmethod
    def of(cls, motion: Motion) -> Self:
        """Collect the source of the rates of a motion, and its notes."""
        residual = None if motion.residual is None else float(motion.residual.max())
        return cls(motion.source, residual, motion.notes)


@dataclass(frozen=True)
class MotionResult:
    """The result of a motion, or of some rows of it.

    `peaks` are by joint or motor and quantity. `broken` is the limit that is broken most at the rows, if one is.
    """

    rows: int
    span: Span
    facts: MotionFacts
    peaks: PeaksByJoint = field(default_factory=dict)
    broken: Sample | None = None
    check: Check | None = None


class Block(NamedTuple):
    """Some rows: their channels, none of a job without rows, and the results of the motions that follow each other.

    `further` are columns next to the results, such as that of breaks.
    """

    channels: Sequence[Channel]
    further: Sequence[Channel]
    results: Sequence[tuple[str, MotionResult]]

    def aligned(self, motion: Motion, layout: TableLayout) -> Self:
        """Return the block of a motion with the columns of its table.

        They are the columns of all motions.
        """
        joints, t = layout.robot.joint_names, self.channels[0].times
        further = writing.align_further(self.further, motion, joints, layout.match.torques, t)
        return self._replace(channels=writing.align_deviations(self.channels), further=further)


@dataclass(frozen=True, eq=False)
class Job(ABC):
    """A computation on the motions of a robot.

    `form` is the suffix of the tables that hold the rows of parts, None if only results of motions are wanted.
    """

    robot: Engine
    reading: Reading
    form: str | None = None
    order: int = 0

    @property
    @abstractmethod
    def highest(self) -> int:
        """The highest rate of q that the results need."""

    @property
    def has_memory(self) -> bool:
        """Whether results depend on earlier rows of the motion."""
        return False

    def with_columns(self, match: ColumnMatch) -> Self:
        """Return the job as allowed by rows that state all rates."""
        return self

    @abstractmethod
    def compute_part(self, layout: TableLayout, part: InputPart, skipped: list[Skipped]) -> Iterator[Block]:
        """Yield the blocks of a part, and append skipped rows to `skipped`."""

    @cached_property
    def key(self) -> str:
        """A digest of everything that determines the results.

        The input, and the treatment of bad rows, are left out. If the code has no digest, the key differs in each run,
        since parts may be of other code.
        """
        m, reading = self.robot.mechanism, self.reading
        release = code_digest.code_digest() or token_hex()
        robot = (robot_writing.json_text(m), sorted(m.acting))
        options = (type(self).__name__, *(getattr(self, x.name) for x in fields(self)[2:]))  # after robot and reading
        columns = replace(reading.options, skip=False)  # parts without bad rows are the same
        how_read = (columns, reading.way, reading.blend, reading.step)
        return digest([str(x) for x in (release, *robot, *options, *how_read)])

    def part_key(self, part: InputPart) -> str:
        """Return a digest of the job and of a part.

        The part is given by its file, with size and time of the last change, and its rows.
        """
        return digest([self.key, str(part.path.resolve()), *part.written, *part.span, part.motion])


@dataclass(frozen=True, eq=False)
class RowJob(Job):
    """A computation of rows that a table holds.

    `with_rates` adds q and its rates to the table.
    """

    method: str | None = None
    with_rates: bool = False

    @abstractmethod
    def compute_motion(self, name: str, motion: Motion, show: Progress | None = None) -> Iterator[Block]:
        """Yield the blocks of a motion in memory."""


def digest(data: object) -> str:
    """Return the SHA-256 digest of plain data."""
    return sha256(json.dumps(data, sort_keys=True).encode()).hexdigest()


STATED = MotionFacts(ALL_RATES_SOURCE)  # for motions whose rows state all rates


def add_result(results: dict[str, MotionResult], name: str, result: MotionResult) -> None:
    """Merge the result of further rows of a motion into all results."""
    results[name] = _merge_results(name, results[name], result) if name in results else result


def _merge_results(name: str, first: MotionResult, second: MotionResult) -> MotionResult:
    """Merge the results of consecutive rows of a motion.

    Stretches of a check share the row between them.
    """
    end, start = first.span[1], second.span[0]
    if start < end or (start == end and second.check is None):
        raise JounceError(
            f"motion {quote_value(name)} goes on at t = {start:.17g}, and its rows before end at t = {end:.17g};"
            " expected increasing times: sort the rows of each motion, and give motions names of their own"
        )
    with errors.locate_errors(f"motion {quote_value(name)}"):
        check = None
        if first.check is not None and second.check is not None:
            check = Check.merge([first.check, second.check])
    notes = tuple(dict.fromkeys([*first.facts.notes, *second.facts.notes]))
    peaks = extremes.merge_peaks(first.peaks, second.peaks)
    broken = max((sample for sample in (first.broken, second.broken) if sample), default=None)
    span = first.span[0], second.span[1]
    return MotionResult(first.rows + second.rows, span, replace(first.facts, notes=notes), peaks, broken, check)


@dataclass(frozen=True, eq=False)
class ForceJob(RowJob):
    """The forces Q with their rates, and q with its rates.

    q is there if `with_rates` is set.
    """

    @property
    def highest(self) -> int:
        """The highest rate of q that the results need."""
        return self.order + DEFAULT_QUANTITY.takes.rates - 1

    def compute_part(self, layout: TableLayout, part: InputPart, skipped: list[Skipped]) -> Iterator[Block]:
        """Yield the blocks of a part, and append skipped rows to `skipped`."""
        limits = reported_limits(self.robot.mechanism)
        # Samples need the whole motion; rows that state all rates are computed as they are.
        if not layout.independent:
            for name, motion in part_rows.read_motions(layout, part, skipped):
                for block in self._compute_blocks(name, motion, limits):
                    yield block.aligned(motion, layout)
            return
        for runs, states, channels in part_rows.compute_rows(layout, part, skipped, self.highest, self._compute_rows):
            Q = channels[-1]
            with errors.locate_errors(part.path):
                results = [(run.motion, _summarize_forces(Q, run, states.rates, STATED, limits)) for run in runs]
            yield Block(channels, (), results)

    def compute_motion(self, name: str, motion: Motion, show: Progress | None = None) -> Iterator[Block]:
        """Yield the blocks of a motion in memory."""
        path = along.check_motion(self.robot.mechanism, motion)
        yield from self._compute_blocks(name, path, reported_limits(self.robot.mechanism), show)

    def _compute_rows(self, states: RowStates) -> list[Channel]:
        m, row = self.robot.mechanism, DEFAULT_QUANTITY
        Q = motion_channels.quantity_channel(m, row, states.t, states.compute(self.robot, row, self.method))
        if not self.with_rates:
            return [Q]
        return [*motion_channels.coordinate_channels(m, states.t, states.rates), *states.base_columns, Q]

    def _compute_blocks(
        self, name: str, motion: Motion, limits: Limits, show: Progress | None = None
    ) -> Iterator[Block]:
        robot, order = self.robot, self.order
        options = along.ForceOptions(self.method, show)
        breaks = along.find_force_breaks(robot, motion, motion.times, order, options=options)
        # Facts are those of the whole motion, and the same in each block.
        hidden, facts = hidden_vibrations.find_hidden_vibrations(robot, motion, order), None
        for piece in along.compute_pieces(robot, motion, motion.times, order, options=options):
            Q = piece.efforts
            if facts is None:
                described = tuple(along.describe_break(force_break, Q.names, Q.rate_names) for force_break in breaks)
                facts = replace(MotionFacts.of(motion), breaks=described, hidden=hidden)
            states = positions.extents(robot.mechanism, piece.rates[0]), *piece.rates[1:]
            result = _summarize_forces(Q, MotionRun(name, 0, len(Q.times)), states, facts, limits)
            further = writing.further_channels(motion, robot.joint_names, breaks, piece.t)
            yield Block([*self._written_rates(motion, piece), Q], further, [(name, result)])

    def _written_rates(self, motion: Motion, piece: Along) -> list[Channel]:
        """Return q, its rates, and those of the base, as columns.

        A table with these columns can be read again as a motion.
        """
        if not self.with_rates:
            return []
        t, highest = piece.t, len(piece.rates) - 1
        if motion.several:
            return [
                writing.joint_channel(motion, self.robot.joint_names, t, highest),
                *writing.base_channels(motion, t, highest),
            ]
        q = replace(piece.coordinates[0], deviations=motion.deviations(t, highest))
        return [q, *writing.base_channels(motion, t, highest)]


def _summarize_forces(
    efforts: Channel, run: MotionRun, states: Rates, facts: MotionFacts, limits: Limits
) -> MotionResult:
    """Return the result of rows of a motion, with the worst limit.

    It is the limit that states and forces at the rows break most.
    """
    rows = slice(run.start, run.stop)
    Q = efforts.rows(rows)
    forces = Q.rates
    # A limit is broken only by values that exceed it together with their uncertainty.
    if Q.deviations is not None:
        bands = (DECISIVE_DEVIATIONS * deviation for deviation in Q.deviations)
        forces = tuple(np.sign(x) * np.maximum(np.abs(x) - band, 0) for x, band in zip(forces, bands, strict=True))
    broken = find_worst_broken(limits, Q.times, tuple(rate[rows] for rate in states), forces)
    return MotionResult(
        len(Q.times), (float(Q.times[0]), float(Q.times[-1])), facts, extremes.find_extremes([Q]), broken
    )


TORQUE_NAMES = ("tau", "taud")  # their breaks are reported
ELECTRIC = ("i", "u")
WRITTEN_RATES = {"theta": 1, "tau": 0, "i": 0, "u": 0}  # the highest rate of each quantity that is written


@dataclass(frozen=True, eq=False)
class MotorJob(RowJob):
    """Positions, velocities and torques of motors.

    Motors with electrical data have currents and voltages too. q and its rates are added if requested. The order is the
    rate of tau that voltages need.
    """

    @property
    def highest(self) -> int:
        """The highest rate of q that the results need."""
        return (
            self.order + DEFAULT_QUANTITY.takes.rates + 1 + joint_springs.elasticity_of(self.robot.mechanism).more_rates
        )

    @property
    def has_memory(self) -> bool:
        """Whether results depend on earlier rows of the motion.

        Deflections of dampers do, and stiffness over time.
        """
        e = joint_springs.elasticity_of(self.robot.mechanism)
        return bool((e.dampers and e.level is None) or e.pairs)

    def with_columns(self, match: ColumnMatch) -> Self:
        """Return the job with the rate of torques that voltages need.

        The table must state q to that rate.
        """
        further = self.highest + 1
        is_known = all(f"{joint}.{rate_name('q', further)}" in match.sources for joint in self.robot.joint_names)
        return replace(
            self, order=voltage_order(joint_springs.elasticity_of(self.robot.mechanism), self.highest + is_known)
        )

    def compute_part(self, layout: TableLayout, part: InputPart, skipped: list[Skipped]) -> Iterator[Block]:
        """Yield the blocks of a part, and append skipped rows to `skipped`."""
        if not layout.independent:
            for name, motion in part_rows.read_motions(layout, part, skipped):
                for block in self.compute_motion(name, motion):
                    yield block.aligned(motion, layout)
            return
        for runs, _, channels in part_rows.compute_rows(layout, part, skipped, self.highest, self._compute_rows):
            with errors.locate_errors(part.path):
                results = [
                    (run.motion, _summarize_motors([x.rows(slice(run.start, run.stop)) for x in channels], STATED))
                    for run in runs
                ]
            yield Block(channels, (), results)

    def compute_motion(self, name: str, motion: Motion, show: Progress | None = None) -> Iterator[Block]:
        """Yield the block of a motion in memory."""
        robot = self.robot
        order = voltage_order(joint_springs.elasticity_of(robot.mechanism), motion.highest)
        whole = motors_along(robot, motion, order=order, method=self.method, progress=show)
        channels, t = _written(whole.motors), whole.t
        if self.with_rates:
            deviations = motion.deviations(t, self.highest)
            channels = [
                *motion_channels.coordinate_channels(robot.mechanism, t, motion(t, self.highest), deviations),
                *channels,
            ]
        # Breaks are described for the torques that the motion allows: tau, and taud where voltages need it.
        names = TORQUE_NAMES[: order + 1]
        described = tuple(along.describe_break(torque_break, robot.joint_names, names) for torque_break in whole.breaks)
        facts = MotionFacts.of(motion)
        facts = replace(facts, breaks=described, notes=(*facts.notes, *whole.notes))
        further = writing.further_channels(motion, robot.joint_names, whole.breaks, t)
        yield Block(channels, further, [(name, _summarize_motors(channels, facts))])

    def _compute_rows(self, states: RowStates) -> list[Channel]:
        robot, m = self.robot, self.robot.mechanism
        rows = [
            find_row(name, joint_springs.elasticity_of(m).more_rates) for name in ("motor_positions", "motor_torques")
        ]
        theta, tau = (states.compute(robot, row, self.method) for row in rows)
        channels = _written(motor_channels(m, theta, motor_channel(m, rows[1], states.t, tau)))
        # The last channel stands behind the columns of the base, as Q does in tables of forces.
        if not self.with_rates:
            return channels
        return [
            *motion_channels.coordinate_channels(m, states.t, states.rates),
            *channels[:-1],
            *states.base_columns,
            channels[-1],
        ]


def _written(channels: Sequence[Channel]) -> list[Channel]:
    """Return the rates of motor channels that are written.

    Currents and voltages are those of motors with electrical data.
    """
    written_channels = []
    for channel in channels:
        rates = channel.upto(WRITTEN_RATES[channel.symbol])
        known_columns = np.flatnonzero(~np.isnan(rates.values).all(axis=0)).tolist()
        written_channels.append(rates.columns(known_columns) if channel.symbol in ELECTRIC else rates)
    return written_channels


def _summarize_motors(channels: Sequence[Channel], facts: MotionFacts) -> MotionResult:
    """Return the result of rows of one motion, for its motors."""
    t = channels[-1].times
    motor_channels_of_rows = [channel for channel in channels if channel.symbol in WRITTEN_RATES]
    return MotionResult(len(t), (float(t[0]), float(t[-1])), facts, extremes.find_extremes(motor_channels_of_rows))


@dataclass(frozen=True, eq=False)
class CheckJob(Job):
    """A check of every limit of the robot.

    The order is that of the rates of Q that limits need.
    """

    @property
    def highest(self) -> int:
        """The highest rate of q that the results need."""
        return self.order + DEFAULT_QUANTITY.takes.rates - 1

    def compute_part(self, layout: TableLayout, part: InputPart, skipped: list[Skipped]) -> Iterator[Block]:
        """Yield the blocks of a part, and append skipped rows to `skipped`.

        Rows that state all rates are checked up to the first row of the next part.
        """
        if layout.independent:
            stretches = part_rows.read_stretches(layout, part, skipped)
        else:
            motions = part_rows.read_motions(layout, part, skipped)
            stretches = ((name, len(motion.times), motion) for name, motion in motions)
        for name, rows, motion in stretches:
            result = summarize_check(self, motion, check(self.robot, motion))
            yield Block((), (), [(name, replace(result, rows=rows))])


def summarize_check(job: Job, motion: Motion, checked: Check) -> MotionResult:
    """Return the result of the check of a motion.

    Its notes are those of the motion and of the check.
    """
    hidden = hidden_vibrations.find_hidden_vibrations(job.robot, motion, required_order(job.robot))
    facts = MotionFacts(notes=(*motion.notes, *checked.notes), hidden=hidden)
    return MotionResult(len(motion.times), (motion.start, motion.stop), facts, check=replace(checked, breaks=()))
