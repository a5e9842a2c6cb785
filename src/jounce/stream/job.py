"""What a run computes of every motion or row: forces, what motors do, or limits.

A job gives blocks: channels of some rows, in the order of the input, with what is kept of the motions that they belong
to. `forces`, `motors` and `limit_checks` are the jobs.
"""

import json
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from hashlib import sha256
from secrets import token_hex
from typing import NamedTuple, Self

from jounce.core.code_digest import code_digest
from jounce.engine.along import Progress
from jounce.engine.engine import Engine
from jounce.io.motions.skipped_rows import Skipped
from jounce.io.motions.table_parts import InputPart, Reading, TableLayout
from jounce.io.motions.writing import align_deviations, align_further
from jounce.io.native import writing
from jounce.motion.channel import Channel
from jounce.motion.motion import Motion
from jounce.motion.table_columns import ColumnMatch
from jounce.stream.results import MotionResult


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
        further = align_further(self.further, motion, joints, layout.match.torques, t)
        return self._replace(channels=align_deviations(self.channels), further=further)


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
        release = code_digest() or token_hex()
        robot = (writing.json_text(m), sorted(m.acting))
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
