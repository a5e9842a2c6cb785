"""Rows of logs: what can be decided is done and noted in one line; what would be guessed is refused with its cure.

ISO 8601 stamps are seconds, UTC where they state no zone. Rows without any position are left out. Stamps of samples
scatter: neighbours that changed places, and rows out of order by less than the time between rows, are sorted. Measured
torques may be missing. Other bad rows are refused, or left out on request.
"""

import re
from bisect import bisect_left
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from datetime import datetime
from decimal import Decimal

import numpy as np

from jounce.core.cures import option_name
from jounce.core.errors import JounceError, join_names, quote_value
from jounce.io.columns import Columns
from jounce.io.remainders import remainder_name
from jounce.io.table_format import Chunk, leave_out_rows
from jounce.motion.table_columns import TIME, ColumnMatch

MAX_DISORDER = 1.0  # times between rows, by which stamps that scatter may go back
ISO_STAMP = re.compile(r"\s*(\d{4}-\d\d-\d\d)[T ](\d\d:\d\d:\d\d)(?:[.,](\d+))?\s*(Z|[+-]\d\d:?\d\d)?\s*")


def read_stamps(rows: Chunk, found: ColumnMatch) -> Chunk:
    """The rows with ISO 8601 stamps as seconds since 1970, and what doubles leave of these where that is asked for."""
    time = found.sources[TIME]
    left, columns, texts = remainder_name(time), dict(rows.columns), dict(rows.texts)
    for place, text in rows.texts.items():
        if place[1] != time or (stamp := _parse_stamp(text)) is None:
            continue
        if found.factors[TIME] != 1:
            came = f"column {quote_value(time)} holds ISO 8601 stamps, {quote_value(text)}, which are in seconds"
            raise JounceError(f"{came}; leave {option_name('time_unit')} out")
        columns[time][place[0]] = high = float(stamp)
        if left in columns:
            columns[left][place[0]] = float(stamp - Decimal(high))
        del texts[place]
    return replace(rows, texts=texts)


def _parse_stamp(text: str) -> Decimal | None:
    if (stamp := ISO_STAMP.fullmatch(text)) is None:
        return None
    try:
        whole = datetime.fromisoformat(f"{stamp[1]}T{stamp[2]}{stamp[4] or 'Z'}").timestamp()
    except ValueError:  # no such day or hour
        return None
    return Decimal(whole) + Decimal(f"0.{stamp[3] or 0}")


def find_empty_rows(rows: Chunk, found: ColumnMatch, problems: Iterable[int]) -> list[int]:
    """Those of the rows with problems that have all cells, and no number but a time."""
    columns = [rows.columns[name] for name in {*found.sources.values()} - {found.sources[TIME]}]
    return [i for i in problems if i not in rows.broken and all(np.isnan(x[i]) for x in columns)]


def describe_empty_rows(count: int, rows: int) -> tuple[str, ...]:
    """A note of rows that are left out."""
    return (f"{count} of {rows} rows state no position; left out",) if count else ()


def clean_rows(
    rows: Chunk, found: ColumnMatch, where: Callable[[int], str], skip: bool
) -> tuple[Columns, np.ndarray, tuple[str, ...]]:
    """The columns of the good rows, the numbers (N,) of these, and notes; `where` names a row in messages."""
    count, problems = len(rows.places) - 1, rows.problems(dict.fromkeys(found.sources.values()))
    empty = find_empty_rows(rows, found, problems)
    if len(empty) == count:
        raise JounceError(f"{where(0)}: no position in this row, nor in any other; expected numbers")
    good, notes = leave_out_rows({i: problems[i] for i in problems.keys() - {*empty}}, count, where, skip)
    good[empty] = False
    columns = rows.columns if good.all() else {name: x[good] for name, x in rows.columns.items()}
    return columns, np.flatnonzero(good), describe_empty_rows(len(empty), count) + notes


def order_rows(
    columns: Mapping[str, np.ndarray], found: ColumnMatch
) -> tuple[np.ndarray, dict[int, tuple[str, str]], tuple[str, ...]]:
    """The numbers (N,) of the good rows in the order of time, what is wrong with the stamps of others, and notes."""
    time = found.sources[TIME]
    t = columns[time]
    if (np.diff(t) > 0).all():
        return np.arange(len(t)), {}, ()
    kept = _find_increasing(t)
    others = np.setdiff1d(np.arange(len(t)), kept)
    before, passed = np.searchsorted(kept, others), np.searchsorted(t[kept], t[others])  # of those kept, how many
    late = before > passed
    beside = t[kept[np.where(late, before - 1, before).clip(max=len(kept) - 1)]]
    away = np.abs(t[others] - beside)
    near = (np.abs(before - passed) <= 1) | (away < MAX_DISORDER * float(np.median(np.diff(np.sort(t)))))
    is_order = found.sampled and 2 * len(kept) >= len(t)  # half of the rows have changed places at most
    moved = near & is_order & ~np.isin(t[others], t[kept])
    order = np.append(kept, others[moved])
    order = order[np.argsort(t[order], kind="stable")]
    twice = np.append(False, np.diff(t[order]) == 0)
    wrong = {
        i: f"{float(t[i])!r} {'follows' if is_late else 'comes before'} {x!r}"
        for i, is_late, x in zip(others[~moved].tolist(), late[~moved], beside[~moved].tolist(), strict=True)
    } | {i: f"{float(t[i])!r} follows {float(t[i])!r}" for i in order[twice].tolist()}
    size = away[moved].max(initial=0) * found.factors[TIME]
    notes = (f"{moved.sum()} of {len(t)} rows out of order by up to {size:.2g} s; sorted by their stamps",)
    problems = {i: (time, f"does not increase: {words}") for i, words in wrong.items()}
    return order[~twice], problems, notes if moved.any() else ()


def _find_increasing(t: np.ndarray) -> np.ndarray:
    """The rows (K,) of the longest part of t that increases, by patience sorting (Fredman, Discrete Math. 11, 1975)."""
    ends, rows, previous = list[float](), list[int](), list[int]()
    for i, x in enumerate(t.tolist()):
        k = bisect_left(ends, x)
        previous.append(rows[k - 1] if k else -1)
        if ends[k : k + 1] != [x]:  # of equal ones the first
            ends[k : k + 1], rows[k : k + 1] = [x], [i]
    chain = [rows[-1]]
    while previous[chain[-1]] >= 0:
        chain.append(previous[chain[-1]])
    return np.array(chain[::-1])


def torque_notes(columns: Mapping[str, np.ndarray], found: ColumnMatch) -> tuple[str, ...]:
    """A note of measured torques that are missing."""
    lost = {joint: np.count_nonzero(~np.isfinite(columns[name])) for joint, name in found.torques.items()}
    rows = len(columns[found.sources[TIME]])
    counts = [f"{count} of {rows} of {joint}" for joint, count in lost.items() if count]
    return (f"measured torques missing, left out there: {join_names(counts)}",) if counts else ()
