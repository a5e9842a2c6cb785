"""Motions from tables in memory."""

from jounce.core.errors import at
from jounce.motion.columns import match
from jounce.motion.table import AS_NAMED, SMOOTHED, from_columns


def from_table(columns, mechanism, highest, place, way=SMOOTHED, options=AS_NAMED):
    with at(place):
        found = match(list(columns), mechanism, options, highest)
    return from_columns(columns, found, mechanism, highest, place, way)
