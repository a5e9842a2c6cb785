"""Rows of samples from lines of text that come one by one: CSV with a header, or a JSON object per line."""

import csv
import json
import time
from collections.abc import Iterator
from itertools import chain
from typing import IO, Any

import numpy as np

from jounce.core.errors import JounceError, quote_value, warn
from jounce.core.foreign import parse_finite
from jounce.core.typing import JsonObject
from jounce.model.mechanism import Mechanism
from jounce.motion.table_columns import TIME, ColumnOptions, match_columns

POLL_TIME = 0.01  # s, after which a file that ended is looked at again


def read_lines(source: IO[str], follow: bool) -> Iterator[str]:
    """Lines that are not empty; without end, and whole ones alone, of a file that is to be followed as it grows."""
    part = ""
    while (line := source.readline()) or follow:
        part += line
        if part.strip() and (part.endswith("\n") or not follow):
            yield part
        if part.endswith("\n") or not follow:
            part = ""
        elif not line:
            time.sleep(POLL_TIME)


def read_samples(lines: Iterator[str], mechanism: Mechanism, pattern: str | None) -> Iterator[tuple[float, np.ndarray]]:
    """Times, s, and positions (n,) of rows, rad or m; what is no finite number is NaN, and a time with a warning."""
    first = next(lines, "")
    lines = chain([first], lines)
    mark = next((mark for mark in ",;\t" if mark in first), ",")
    objects = first.lstrip().startswith("{")
    rows: Iterator[JsonObject] = map(_parse_object, lines) if objects else csv.DictReader(lines, delimiter=mark)
    start = next(rows, {})
    if not start or all(parse_finite(name) is not None for name in start):
        raise JounceError("there are no samples; expected a row of names, as in 't,JOINT,...', above numbers, or JSON")
    match = match_columns(list(start), mechanism, ColumnOptions(pattern=pattern), 0)
    names = [TIME, *(name if match.sampled else f"{name}.q" for name in mechanism.coordinates)]
    for row in chain([start], rows):
        t, *q = (_number(row.get(match.sources[name])) * match.factors[name] for name in names)
        if np.isnan(t):
            warn(f"row {quote_value(row)} has no time; it is left out")
        yield t, np.array(q)


def _number(cell: Any) -> float:
    text = cell.strip() if isinstance(cell, str) else repr(cell)  # JSON has numbers of any size
    found = parse_finite(text)
    return np.nan if found is None else found


def _parse_object(line: str) -> JsonObject:
    try:
        row = json.loads(line)
    except ValueError:  # no JSON
        row = None
    return row if isinstance(row, dict) else {}
