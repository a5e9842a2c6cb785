"""Tables of motions: only the columns that belong to the motion are read."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from jounce.core.errors import JounceError, at, quoted
from jounce.core.scalars import asarray
from jounce.io import tables
from jounce.io.columns import CellError, checked, select_columns
from jounce.io.remainders import remainder_of, split_names
from jounce.model.mechanism import Mechanism
from jounce.motion.columns import TIME, Match, Options, match
from jounce.motion.motion import Motion
from jounce.motion.origin import origin_of
from jounce.motion.spline import Smoothing, Spline
from jounce.motion.table import from_columns


class Matching:
    """Selects the columns of a motion once the column names of a table are known, and remembers the selection."""

    def __init__(self, mechanism: Mechanism, options: Options, highest: int, place: str) -> None:
        self.given = mechanism, options, highest
        self.place = place
        self.found: Match | None = None

    def __call__(self, header: Sequence[str]) -> list[str]:
        """The columns of the motion, and what doubles leave of the times."""
        with at(self.place):
            self.found = match(header, *self.given)
        return [*self.found.names, remainder_of(self.found.sources[TIME])]


def read(path: Path, mechanism: Mechanism, highest: int, way: Smoothing | Spline, options: Options) -> Motion:
    """The motion of a table in a file."""
    matching = Matching(mechanism, options, highest, str(path))
    with _cures():
        columns = tables.read(path, matching)
    return _motion(columns, matching, highest, way)


def of_arrays(
    given: Mapping[str, Any], mechanism: Mechanism, highest: int, way: Smoothing | Spline, options: Options, place: str
) -> Motion:
    """Return the motion of named arrays; other entries may be anything."""
    matching = Matching(mechanism, options, highest, place)
    arrays, refused = {}, {}
    for name, values in given.items():
        try:
            found = np.asarray(asarray(values, f"column {quoted(name)}"))
            arrays[name] = integers if (integers := np.asarray(values)).dtype.kind in "iu" else found
        except JounceError as error:
            arrays[name], refused[name] = np.empty(0), error
    with _cures():
        columns = select_columns(arrays, matching) if arrays else {}
        for name in split_names(columns)[0]:
            if name in refused:
                raise CellError(f"{place}: {refused[name]}")
        columns = checked(place, columns)
    return _motion(columns, matching, highest, way)


def _motion(columns: Mapping[str, np.ndarray], matching: Matching, highest: int, way: Smoothing | Spline) -> Motion:
    found = matching.found
    assert found is not None  # every reader selects
    time = found.sources[TIME]
    left = remainder_of(time)
    origin = origin_of(float(columns[time][0]), float(columns[left][0]), found.factors[TIME])
    if origin:
        columns = {**columns, time: origin.since(columns[time], columns[left])}
    return from_columns(columns, found, matching.given[0], highest, matching.place, way, origin)


@contextmanager
def _cures() -> Iterator[None]:
    """Within this context, the error for a cell that is not a number says how to fix it."""
    try:
        yield
    except CellError as error:
        cure = "repair or remove the row, or select columns with --time, --columns, --lock JOINT=VALUE"
        raise JounceError(f"{error}; {cure}") from None
