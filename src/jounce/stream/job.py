"""What is computed of every part of a plan, and the parts, as data that can be sent to another process."""

import json
from dataclasses import dataclass
from functools import cached_property
from hashlib import sha256
from pathlib import Path
from secrets import token_hex
from typing import Any, Literal

from jounce.core.code_digest import code_digest
from jounce.dynamics.joint_springs import elasticity_of
from jounce.dynamics.quantities import DEFAULT_QUANTITY
from jounce.engine.engine import Engine
from jounce.io.native import writing
from jounce.io.table_format import Span
from jounce.motion.spline import Smoothing, Spline
from jounce.motion.table import DEFAULT_COLUMN_OPTIONS
from jounce.motion.table_columns import ColumnMatch, ColumnOptions
from jounce.motion.time_origin import TimeOrigin

Subject = Literal["forces", "motors", "limits"]
MOTION_COLUMN = "motion"  # the column that names the motion of each row


@dataclass(frozen=True)
class Reading:
    """How the input is read: its columns, and how curves follow from samples.

    `blend` and `step` are those of `Motion.blended` and `Motion.with_step`.
    """

    options: ColumnOptions = DEFAULT_COLUMN_OPTIONS
    way: Smoothing | Spline | None = None
    blend: float | None = None
    step: float | None = None

    @property
    def skip(self) -> bool:
        """Whether bad rows are left out and recorded instead of ending the run."""
        return self.options.skip


@dataclass(frozen=True, eq=False)
class Job:
    """What is computed: forces, motor torques or ratios to limits of a robot up to an order.

    `form` is the suffix of the tables that hold the rows of parts, None if only aggregates are wanted.
    """

    subject: Subject
    robot: Engine
    order: int
    reading: Reading
    form: str | None
    method: str | None = None
    with_rates: bool = False

    @property
    def of_motors(self) -> bool:
        """Whether what the motors of elastic joints do is computed."""
        return self.subject == "motors"

    @property
    def highest(self) -> int:
        """The highest rate of q that the results take."""
        more = elasticity_of(self.robot.mechanism).more_rates + 2 if self.of_motors else 0
        return self.order + DEFAULT_QUANTITY.takes.rates - 1 + more

    @cached_property
    def key(self) -> str:
        """A digest of all that results depend on, but for the input and the treatment of bad rows.

        It is another one in each run of code that has no digest: nobody knows whether the parts there are its own.
        """
        mechanism = self.robot.mechanism
        text = [
            code_digest() or token_hex(), writing.json_text(mechanism), str(sorted(mechanism.acting)), self.subject,
            str(self.order), str(self.form), str(self.method), str(self.with_rates), str(self.reading.options),
            str(self.reading.way), str(self.reading.blend), str(self.reading.step),
        ]  # fmt: skip
        return digest(text)


@dataclass(frozen=True)
class InputPart:
    """A piece of the input: whole motions, or any rows where these state all rates.

    `motion` is the name of the motion of all rows, None if a column names it. `key` is a digest of the job and of the
    identity of the input: a record with another key is of another run. Times are since `origin`, the first stamp of the
    file, if there is one.
    """

    number: int
    path: Path
    span: Span
    motion: str | None
    key: str
    origin: TimeOrigin | None = None

    @property
    def size(self) -> int:
        """The rows of the part, or the bytes of a CSV table."""
        return self.span.stop - self.span.start


@dataclass(frozen=True, eq=False)
class Task:
    """What is computed of every part, and how the tables are read: all that another process needs to know.

    `match` names the columns of the motion. If `independent`, each row states all that its results need;
    otherwise parts are whole motions. If `named`, the output has the column of motions.
    """

    job: Job
    match: ColumnMatch
    independent: bool
    named: bool


def digest(data: Any) -> str:
    """The SHA-256 digest of plain data."""
    return sha256(json.dumps(data, sort_keys=True).encode()).hexdigest()
