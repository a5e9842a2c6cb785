"""Read samples that come one by one, with time stamps.

Rows are CSV with a header, or a JSON object per line (`read_samples`).

`SampleClock` refuses a stamp that is not after the last one, with its sample. Where `NEW_CLOCK_STAMPS` in a row are
refused that increase among themselves, by steps that no gap is longer than, it is the one before them that was wrong,
or the clock was set back: the last of them is the first of a new clock. A stamp far ahead is a gap, and is not refused:
a robot may pause. If it was wrong, the stamps after it are refused, and the third of them starts the clock again.
"""

import csv
import json
import time
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain
from typing import IO, Any

import numpy as np

from jounce.core import scalars
from jounce.core.errors import JounceError, quote_value, warn
from jounce.core.foreign import parse_finite
from jounce.core.typing import JsonObject
from jounce.model.mechanism import Mechanism

POLL_TIME = 0.01  # s, after which a file that ended is looked at again


def read_lines(source: IO[str], follow: bool) -> Iterator[str]:
    """Yield lines that are not empty.

    Of a file that is followed as it grows: without end, and whole lines alone.
    """
    part = ""
    while True:
        line = source.readline()
        if line == "" and not follow:
            return
        # A program that writes the file may have written half of a line.
        part += line
        is_whole = part.endswith("\n") or not follow
        if is_whole and part.strip() != "":
            yield part
        if is_whole:
            part = ""
        elif line == "":
            time.sleep(POLL_TIME)


def read_samples(lines: Iterator[str], mechanism: Mechanism, pattern: str | None) -> Iterator[tuple[float, np.ndarray]]:
    """Yield times, s, and positions (n,) of rows, rad or m.

    What is no finite number is NaN; a time that is NaN comes with a warning.
    """
    from jounce.motion.table_columns import TIME, ColumnOptions, match_columns  # imported here: the clock takes none

    # The first line decides between JSON and the separator of a table.
    first = next(lines, "")
    lines = chain([first], lines)
    mark = next((mark for mark in ",;\t" if mark in first), ",")
    objects = first.lstrip().startswith("{")
    rows: Iterator[JsonObject] = map(_parse_object, lines) if objects else csv.DictReader(lines, delimiter=mark)
    start = next(rows, {})
    if len(start) == 0 or all(parse_finite(name) is not None for name in start):
        raise JounceError("there are no samples; expected a row of names, as in 't,JOINT,...', above numbers, or JSON")
    match = match_columns(list(start), mechanism, ColumnOptions(pattern=pattern), 0)
    names = [TIME, *(name if match.sampled else f"{name}.q" for name in mechanism.coordinates)]
    for row in chain([start], rows):
        t, *q = (_number(row.get(match.sources[name])) * match.factors[name] for name in names)
        if np.isnan(t):
            warn(f"row {quote_value(row)} has no time; it is left out")
        yield t, np.array(q)


def _number(cell: Any) -> float:
    # JSON has numbers of any size.
    text = cell.strip() if isinstance(cell, str) else repr(cell)
    number = parse_finite(text)
    return np.nan if number is None else number


def _parse_object(line: str) -> JsonObject:
    try:
        row = json.loads(line)
    except ValueError:  # no JSON
        row = None
    return row if isinstance(row, dict) else {}


NEW_CLOCK_STAMPS = 3  # one is an error, two are a pair of late rows: the third costs two rows more at a true new clock


@dataclass(frozen=True)
class SampleClock:
    """The time of the last stamp that was not refused, s.

    Of the stamps refused since, `refused` counts those in a row that increase, and `stamp` is the last. `is_new` says
    that the last stamp is the first of a new clock.
    """

    now: float = np.nan
    refused: int = 0
    stamp: float = np.nan
    is_new: bool = False

    def read(self, t: object, dt: float, longest_gap: float) -> "SampleClock":
        """Return the clock after one more stamp: t, or None for dt later.

        Raises
        ------
        JounceError
            If t is no finite number. The clock is as before.
        """
        if t is None:
            return SampleClock(0.0 if np.isnan(self.now) else self.now + dt)
        if not scalars.is_finite(t):
            raise JounceError(f"t is {quote_value(t)}; expected the time of the sample in s, or None")
        # A stamp after the last one is taken, also as the first of all, where the last one is NaN.
        time = float(t)  # type: ignore[arg-type]
        if not self.now >= time:
            return SampleClock(time)
        # Refused stamps count while they increase by steps that no gap is longer than.
        increases = self.refused > 0 and 0 < time - self.stamp <= longest_gap
        refused = 1 + self.refused * increases
        if refused == NEW_CLOCK_STAMPS:
            return SampleClock(time, is_new=True)
        return SampleClock(self.now, refused, time)
