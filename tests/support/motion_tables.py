"""Tables in memory: structured arrays, and the motions of tables."""

import numpy as np

from jounce.core.errors import locate_errors
from jounce.motion.table import DEFAULT_COLUMN_OPTIONS, DEFAULT_SMOOTHING, motion_from_columns
from jounce.motion.table_columns import match_columns


def from_table(columns, mechanism, highest, place, way=DEFAULT_SMOOTHING, options=DEFAULT_COLUMN_OPTIONS):
    with locate_errors(place):
        found = match_columns(list(columns), mechanism, options, highest)
    return motion_from_columns(columns, found, mechanism, place, way=way)


def structured(columns):
    """The structured array of columns."""
    array = np.zeros(len(next(iter(columns.values()))), dtype=[(name, float) for name in columns])
    for name, column in columns.items():
        array[name] = column
    return array
