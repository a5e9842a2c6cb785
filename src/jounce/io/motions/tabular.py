"""Tables of motions: only the columns that belong to the motion are read."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from jounce.core.cures import Remedy, join_cures, option_name
from jounce.core.errors import JounceError, locate_errors, quote_value
from jounce.core.scalars import asarray
from jounce.io import tables
from jounce.io.columns import CellError, check_columns, select_columns
from jounce.io.motions.log_rows import clean_rows, order_rows, read_stamps, torque_notes
from jounce.io.remainders import remainder_name, split_names
from jounce.io.table_format import Chunk, leave_out_rows, number_rows
from jounce.model.mechanism import Mechanism
from jounce.motion.motion import Motion
from jounce.motion.spline import Smoothing, Spline
from jounce.motion.table import find_origin, motion_from_columns
from jounce.motion.table_columns import TIME, ColumnMatch, ColumnOptions, match_columns


class ColumnMatching:
    """Selects the columns of a motion once the column names of a table are known, and remembers the selection."""

    def __init__(self, mechanism: Mechanism, options: ColumnOptions, highest: int, place: str) -> None:
        self.given = mechanism, options, highest
        self.place = place
        self.found: ColumnMatch | None = None

    def __call__(self, header: Sequence[str]) -> list[str]:
        """The columns of the motion, and what doubles leave of the times."""
        with locate_errors(self.place):
            self.found = match_columns(header, *self.given)
        return [*self.found.names, remainder_name(self.found.sources[TIME])]


def read(path: Path, mechanism: Mechanism, highest: int, way: Smoothing | Spline, options: ColumnOptions) -> Motion:
    """The motion of a table in a file."""
    matching = ColumnMatching(mechanism, options, highest, str(path))
    with _cell_cure():
        rows = tables.read_rows(path, matching)
        return _build_motion(rows, matching, highest, way, partial(tables.describe_place, path))


def read_arrays(
    given: Mapping[str, Any],
    mechanism: Mechanism,
    highest: int,
    way: Smoothing | Spline,
    options: ColumnOptions,
    place: str,
) -> Motion:
    """Return the motion of named arrays; other entries may be anything."""
    matching = ColumnMatching(mechanism, options, highest, place)
    arrays, refused = {}, {}
    for name, values in given.items():
        try:
            found = np.asarray(asarray(values, f"column {quote_value(name)}"))
            arrays[name] = integers if (integers := np.asarray(values)).dtype.kind in "iu" else found
        except JounceError as error:
            arrays[name], refused[name] = np.empty(0), error
    with _cell_cure():
        columns = select_columns(arrays, matching) if arrays else {}
        for name in split_names(columns)[0]:
            if name in refused:
                raise CellError(f"{place}: {refused[name]}")
        rows = number_rows(check_columns(place, columns))
        return _build_motion(rows, matching, highest, way, lambda at: f"{place}: row {at} from 0")


def _build_motion(
    rows: Chunk, matching: ColumnMatching, highest: int, way: Smoothing | Spline, where: Callable[[int], str]
) -> Motion:
    """The motion of rows, of which `where` names the place in messages."""
    found, skip = matching.found, matching.given[1].skip
    assert found is not None  # every reader selects
    with locate_errors(matching.place):
        rows = read_stamps(rows, found)
    columns, kept, notes = clean_rows(rows, found, lambda i: where(int(rows.places[i])), skip)
    time = found.sources[TIME]
    left = remainder_name(time)
    origin = find_origin(float(columns[time][0]), float(columns[left][0]), found.factors[TIME])
    if origin:
        columns = {**columns, time: origin.since(columns[time], columns[left])}
    order, problems, of_order = order_rows(columns, found)
    _, of_stamps = leave_out_rows(problems, len(kept), lambda i: where(int(rows.places[kept[i]])), skip)
    if of_order or problems:
        columns = {name: x[order] for name, x in columns.items()}
    motion = motion_from_columns(columns, found, matching.given[0], highest, matching.place, way, origin)
    return replace(motion, notes=(*notes, *of_stamps, *of_order, *torque_notes(columns, found), *motion.notes))


@contextmanager
def _cell_cure() -> Iterator[None]:
    """Within this context, the error for a cell that is not a number says which options select other columns."""
    try:
        yield
    except CellError as error:
        ways: list[Remedy | str] = [
            option_name("time"),
            option_name("columns"),
            Remedy("lock= of jounce.load", "--lock JOINT=VALUE"),
        ]
        raise JounceError(f"{error}; or select columns with {join_cures(ways)}") from None
