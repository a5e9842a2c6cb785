"""Jobs say what a run computes of every motion or row: forces, what motors do, or limits.

A job gives blocks: channels of some rows, in the order of the input, with what is kept of the motions that they belong
to: rows, times, peaks and root mean squares, or a check (`MotionResult`). Sums are added in the order of the input
whatever computes the parts, so that they are the same to the last bit.

`ForceJob`, `MotorJob` and `CheckJob` are the jobs of `jounce run`, `jounce motors` and `jounce check`. Rows that state
all rates are checked in stretches, each from the last row of the one before: a check of a motion is the merge of the
checks of its stretches.
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


class Block(NamedTuple):
    """Some rows: their channels, none of a job without rows, and the results of the motions that follow each other.

    `further` are columns next to the results, such as that of breaks.
    """

    channels: Sequence[Channel]
    further: Sequence[Channel]
    results: Sequence[tuple[str, MotionResult]]

    def aligned(self, motion: Motion, layout: TableLayout) -> Self:
        """The block of a motion with the columns of all motions of a table."""
        joints, t = layout.robot.joint_names, self.channels[0].times
        further = writing.align_further(self.further, motion, joints, layout.match.torques, t)
        return self._replace(channels=writing.align_deviations(self.channels), further=further)


@dataclass(frozen=True, eq=False)
class Job(ABC):
    """What is computed of motions of a robot.

    `form` is the suffix of the tables that hold the rows of parts, None if only results of motions are wanted.
    """

    robot: Engine
    reading: Reading
    form: str | None = None
    order: int = 0

    @property
    @abstractmethod
    def highest(self) -> int:
        """The highest rate of q that the results take."""

    @property
    def has_memory(self) -> bool:
        """Whether results depend on the motion before."""
        return False

    def with_columns(self, match: ColumnMatch) -> Self:
        """The job as rows allow it that state all rates."""
        return self

    @abstractmethod
    def compute_part(self, layout: TableLayout, part: InputPart, skipped: list[Skipped]) -> Iterator[Block]:
        """The blocks of a part of a table; rows that are left out are added to `skipped`."""

    @cached_property
    def key(self) -> str:
        """A digest of all that results depend on, but for the input and the treatment of bad rows.

        It is another one in each run of code that has no digest: nobody knows whether the parts there are its own.
        """
        m, reading = self.robot.mechanism, self.reading
        release = code_digest.code_digest() or token_hex()
        robot = (robot_writing.json_text(m), sorted(m.acting))
        options = (type(self).__name__, *(getattr(self, x.name) for x in fields(self)[2:]))  # after robot and reading
        columns = replace(reading.options, skip=False)  # parts without bad rows are the same
        how_read = (columns, reading.way, reading.blend, reading.step)
        return digest([str(x) for x in (release, *robot, *options, *how_read)])

    def part_key(self, part: InputPart) -> str:
        """A digest of the job and of a part: its file, with size and time of the last change, and its rows."""
        return digest([self.key, str(part.path.resolve()), *part.written, *part.span, part.motion])


@dataclass(frozen=True, eq=False)
class RowJob(Job):
    """What is computed of rows, which a table holds: they have q and its rates too if these are to be written."""

    method: str | None = None
    with_rates: bool = False

    @abstractmethod
    def compute_motion(self, name: str, motion: Motion, show: Progress | None = None) -> Iterator[Block]:
        """The blocks of a motion in memory."""


def digest(data: object) -> str:
    """The SHA-256 digest of plain data."""
    return sha256(json.dumps(data, sort_keys=True).encode()).hexdigest()


STATED = MotionFacts(ALL_RATES_SOURCE)  # of motions whose rows state all rates


def add_result(known: dict[str, MotionResult], name: str, more: MotionResult) -> None:
    """Merge the result of further rows of a motion into those that are known."""
    known[name] = _merge_results(name, known[name], more) if name in known else more


def _merge_results(name: str, first: MotionResult, second: MotionResult) -> MotionResult:
    """The result of rows of a motion and of those that follow; checks of stretches share the row between them."""
    ends, begins = first.span[1], second.span[0]
    if begins < ends or (begins == ends and second.check is None):
        raise JounceError(
            f"motion {quote_value(name)} goes on at t = {begins:.17g}, and its rows before end at t = {ends:.17g};"
            " expected increasing times: sort the rows of each motion, and give motions names of their own"
        )
    with errors.locate_errors(f"motion {quote_value(name)}"):
        check = first.check and second.check and Check.merge([first.check, second.check])
    notes = tuple(dict.fromkeys([*first.facts.notes, *second.facts.notes]))
    peaks = extremes.merge_peaks(first.peaks, second.peaks)
    broken = max((found for found in (first.broken, second.broken) if found), default=None)
    span = first.span[0], second.span[1]
    return MotionResult(first.rows + second.rows, span, replace(first.facts, notes=notes), peaks, broken, check)


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
        """The blocks of a motion in memory."""
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
        hidden, facts = hidden_vibrations.find_hidden_vibrations(robot, motion, order), None
        for piece in along.compute_pieces(robot, motion, motion.times, order, options=options):
            Q = piece.efforts
            if facts is None:
                described = tuple(along.describe_break(found, Q.names, Q.rate_names) for found in breaks)
                facts = replace(MotionFacts.of(motion), breaks=described, hidden=hidden)
            states = positions.extents(robot.mechanism, piece.rates[0]), *piece.rates[1:]
            result = _summarize_forces(Q, MotionRun(name, 0, len(Q.times)), states, facts, limits)
            further = writing.further_channels(motion, robot.joint_names, breaks, piece.t)
            yield Block([*self._written_rates(motion, piece), Q], further, [(name, result)])

    def _written_rates(self, motion: Motion, piece: Along) -> list[Channel]:
        """q and its rates, and those of the base, as columns that are read again."""
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
    """The result of the rows of one motion, with the limit that the states and forces there break most."""
    here = slice(run.start, run.stop)
    Q = efforts.rows(here)
    forces = Q.rates
    if Q.deviations is not None:  # what is surely there
        bands = (DECISIVE_DEVIATIONS * spread for spread in Q.deviations)
        forces = tuple(np.sign(x) * np.maximum(np.abs(x) - band, 0) for x, band in zip(forces, bands, strict=True))
    broken = find_worst_broken(limits, Q.times, tuple(rate[here] for rate in states), forces)
    return MotionResult(
        len(Q.times), (float(Q.times[0]), float(Q.times[-1])), facts, extremes.find_extremes([Q]), broken
    )


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
        return (
            self.order + DEFAULT_QUANTITY.takes.rates + 1 + joint_springs.elasticity_of(self.robot.mechanism).more_rates
        )

    @property
    def has_memory(self) -> bool:
        """Whether results depend on the motion before: deflections of dampers, and stiffness over time."""
        e = joint_springs.elasticity_of(self.robot.mechanism)
        return bool((e.dampers and e.level is None) or e.pairs)

    def with_columns(self, match: ColumnMatch) -> Self:
        """The job with the rate of motor torques that voltages take, if the table states as many rates of q."""
        further = self.highest + 1
        is_known = all(f"{joint}.{rate_name('q', further)}" in match.sources for joint in self.robot.joint_names)
        return replace(
            self, order=voltage_order(joint_springs.elasticity_of(self.robot.mechanism), self.highest + is_known)
        )

    def compute_part(self, layout: TableLayout, part: InputPart, skipped: list[Skipped]) -> Iterator[Block]:
        """The blocks of a part of a table; rows that are left out are added to `skipped`."""
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
        """The block of a motion in memory."""
        robot = self.robot
        order = voltage_order(joint_springs.elasticity_of(robot.mechanism), motion.highest)
        whole = motors_along(robot, motion, order=order, method=self.method, progress=show)
        channels, t = _written(whole.motors), whole.t
        if self.with_rates:
            spread = motion.deviations(t, self.highest)
            channels = [
                *motion_channels.coordinate_channels(robot.mechanism, t, motion(t, self.highest), spread),
                *channels,
            ]
        names = TORQUE_NAMES[: order + 1]
        described = tuple(along.describe_break(found, robot.joint_names, names) for found in whole.breaks)
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
        found = _written(motor_channels(m, theta, motor_channel(m, rows[1], states.t, tau)))
        if not self.with_rates:
            return found
        return [
            *motion_channels.coordinate_channels(m, states.t, states.rates),
            *found[:-1],
            *states.base_columns,
            found[-1],
        ]


def _written(channels: Sequence[Channel]) -> list[Channel]:
    """The rates that are written of what motors do; of currents and voltages those of motors that state their data."""
    found = []
    for channel in channels:
        rates = channel.upto(WRITTEN_RATES[channel.symbol])
        stated = np.flatnonzero(~np.isnan(rates.values).all(axis=0)).tolist()
        found.append(rates.columns(stated) if channel.symbol in ELECTRIC else rates)
    return found


def _summarize_motors(channels: Sequence[Channel], facts: MotionFacts) -> MotionResult:
    """The result of rows of one motion, of what motors do."""
    t = channels[-1].times
    of_motors = [channel for channel in channels if channel.symbol in WRITTEN_RATES]
    return MotionResult(len(t), (float(t[0]), float(t[-1])), facts, extremes.find_extremes(of_motors))


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
            stretches = part_rows.read_stretches(layout, part, skipped)
        else:
            motions = part_rows.read_motions(layout, part, skipped)
            stretches = ((name, len(motion.times), motion) for name, motion in motions)
        for name, rows, motion in stretches:
            found = summarize_check(self, motion, check(self.robot, motion))
            yield Block((), (), [(name, replace(found, rows=rows))])


def summarize_check(job: Job, motion: Motion, found: Check) -> MotionResult:
    """What is kept of the check of a motion: its notes are those of the motion and of the check."""
    hidden = hidden_vibrations.find_hidden_vibrations(job.robot, motion, required_order(job.robot))
    facts = MotionFacts(notes=(*motion.notes, *found.notes), hidden=hidden)
    return MotionResult(len(motion.times), (motion.start, motion.stop), facts, check=replace(found, breaks=()))
