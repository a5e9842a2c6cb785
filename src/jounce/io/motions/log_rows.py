"""Rows of logs: what can be decided is done and noted in one line; what would be guessed is refused with its cure.

ISO 8601 stamps are seconds, UTC where they state no zone. Rows that state nothing but a time, and rows that repeat the
one before, stamp included, are left out. Stamps of samples scatter: rows that are out of order by less than the time
between them are sorted. Measured torques may be missing. Other bad rows are refused, or left out on request.
"""

import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from datetime import UTC, datetime
from decimal import Decimal

import numpy as np

from jounce.core.errors import JounceError, join_names, quote_value
from jounce.io.columns import Columns
from jounce.io.remainders import remainder_name
from jounce.io.table_format import Chunk, leave_out_rows
from jounce.motion.table_columns import TIME, ColumnMatch

MAX_DISORDER = 1.0  # times between rows: stamps that scatter by less change places with their neighbours alone
MISSING_CELLS = ("", "nan", "null", "none", "na", "n/a")  # of rows that state nothing, in any case
ISO_STAMP = re.compile(r"(\d{4}-\d\d-\d\d)[T ](\d\d:\d\d:\d\d)(?:[.,](\d+))?\s*(Z|[+-]\d\d:?\d\d)?")


def read_stamps(rows: Chunk, found: ColumnMatch) -> Chunk:
    """The rows with ISO 8601 stamps as seconds since 1970, and what doubles leave of these where that is asked for."""
    time = found.sources[TIME]
    left = remainder_name(time)
    stamps = {i: stamp for (i, name), text in rows.texts.items() if name == time and (stamp := _parse_stamp(text))}
    if not stamps:
        return rows
    if found.factors[TIME] != 1:
        came = f"column {quote_value(time)} holds ISO 8601 stamps, {quote_value(rows.texts[min(stamps), time])}"
        raise JounceError(f"{came}, which state their units; expected no other: leave --time-unit (time_unit=) out")
    high = {i: float(stamp) for i, stamp in stamps.items()}
    columns = {name: x.copy() if name in (time, left) else x for name, x in rows.columns.items()}
    columns[time][list(high)] = list(high.values())
    if left in columns:
        columns[left][list(high)] = [float(stamps[i] - Decimal(x)) for i, x in high.items()]
    texts = {place: text for place, text in rows.texts.items() if place[1] != time or place[0] not in stamps}
    return replace(rows, columns=columns, texts=texts)


def _parse_stamp(text: str) -> Decimal | None:
    stamp = ISO_STAMP.fullmatch(text.strip())
    if stamp is None:
        return None
    try:
        whole = datetime.fromisoformat(f"{stamp[1]}T{stamp[2]}{stamp[4] or 'Z'}").astimezone(UTC)
    except ValueError:  # no such day or hour
        return None
    return Decimal(round(whole.timestamp())) + Decimal(f"0.{stamp[3] or 0}")


def find_empty_rows(rows: Chunk, found: ColumnMatch) -> np.ndarray:
    """The numbers of the rows that state nothing of the motion but a time."""
    names = {*found.sources.values()} - {found.sources[TIME]}
    empty = np.flatnonzero(np.all([np.isnan(rows.columns[name]) for name in names], axis=0))
    cells = {i: {rows.texts.get((i, name), "").lower() for name in names} for i in empty.tolist()}
    return np.array([i for i, texts in cells.items() if i not in rows.broken and texts <= {*MISSING_CELLS}], dtype=int)


def describe_empty_rows(count: int, rows: int) -> tuple[str, ...]:
    """A note of rows that state nothing."""
    return (f"{count} of {rows} rows state no position; left out",) if count else ()


def clean_rows(
    rows: Chunk, found: ColumnMatch, where: Callable[[int], str], skip: bool
) -> tuple[Columns, np.ndarray, tuple[str, ...]]:
    """The columns of the good rows, the numbers (N,) of these, and notes of what was done."""
    count = len(rows.places) - 1
    problems, empty = rows.problems(dict.fromkeys(found.sources.values())), find_empty_rows(rows, found)
    if len(empty) == count:
        raise JounceError(f"{where(0)}: no position in this row, nor in any other; expected numbers")
    others = {i: problem for i, problem in problems.items() if i not in {*empty.tolist()}}
    good, notes = leave_out_rows(others, count, where, skip)
    good[empty] = False
    columns = rows.columns if good.all() else {name: x[good] for name, x in rows.columns.items()}
    return columns, np.flatnonzero(good), describe_empty_rows(len(empty), count) + notes


def order_rows(
    columns: Mapping[str, np.ndarray], found: ColumnMatch
) -> tuple[np.ndarray, dict[int, tuple[str, str]], tuple[str, ...]]:
    """The numbers (N,) of the good rows in the order of time, what is wrong with the stamps of others, and notes."""
    time = found.sources[TIME]
    t, order, notes = columns[time], np.arange(len(columns[time])), list[str]()
    if (np.diff(t) > 0).all():
        return order, {}, ()
    table = np.stack([columns[name] for name in found.names])
    alike = (table[:, 1:] == table[:, :-1]) | (np.isnan(table[:, 1:]) & np.isnan(table[:, :-1]))
    order = order[np.append(True, ~alike.all(axis=0))]
    if repeated := len(t) - len(order):
        notes.append(f"{repeated} of {len(t)} rows repeat the row before, stamp included; left out")
    at, reach = t[order], 0.0
    if found.sampled:
        reach = MAX_DISORDER * float(np.median(np.diff(np.sort(at))))
    latest, soonest = np.maximum.accumulate(at), np.minimum.accumulate(at[::-1])[::-1]
    # rows that go back, or rows that run ahead of those that follow, whichever are fewer
    back, ahead = ((off > 0) & (off >= reach) for off in (latest - at, at - soonest))
    words, bound, off = ("follows", latest, back) if back.sum() <= ahead.sum() else ("is followed by", soonest, ahead)
    problems = {
        int(order[i]): (time, f"does not increase: {float(at[i])!r} {words} {float(bound[i])!r}")
        for i in np.flatnonzero(off).tolist()
    }
    order, at = order[~off], at[~off]
    late = np.maximum.accumulate(at) - at
    order = order[np.argsort(at, kind="stable")]
    if (moved := np.count_nonzero(late)) and found.sampled:
        size = f"{late.max() * found.factors[TIME]:.2g} s"
        notes.append(f"{moved} of {len(t)} rows out of order by up to {size}, less than the time between rows; sorted")
    twice = np.append(False, np.diff(t[order]) == 0)
    problems |= {
        i: (time, f"does not increase: {float(t[i])!r} follows {float(t[i])!r}") for i in order[twice].tolist()
    }
    return order[~twice], problems, tuple(notes)


def torque_notes(columns: Mapping[str, np.ndarray], found: ColumnMatch) -> tuple[str, ...]:
    """A note of measured torques that are missing."""
    lost = {joint: np.count_nonzero(~np.isfinite(columns[name])) for joint, name in found.torques.items()}
    rows = len(columns[found.sources[TIME]])
    counts = [f"{count} of {rows} of {joint}" for joint, count in lost.items() if count]
    return (f"measured torques missing, left out there: {join_names(counts)}",) if counts else ()
