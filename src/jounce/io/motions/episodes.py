"""Reads data sets of LeRobot: tables of episodes, each of which is a motion.

Such a data set (versions 2 and 3 of its format) is a folder with ``meta/info.json`` and Parquet tables below ``data``.
Each table holds one episode or several: rows have `episode_index`, `frame_index` and `timestamp` in s, and lists, such
as ``observation.state`` and ``action``, whose entries are columns ``observation.state[0]``, .... `info.json` may name
the entries. No unit of angles is stated there, and many data sets are in degrees: a caller has to state it.

`list_episodes` finds the episodes, and `match_episodes` matches the columns of a table, of LeRobot or not.
"""

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np

from jounce.core.cures import Remedy, option_name
from jounce.core.errors import JounceError, join_names, quote_value
from jounce.io import entries
from jounce.io.table_format import Span
from jounce.io.tables import PARQUET
from jounce.model import coordinates, positions
from jounce.model.mechanism import Mechanism
from jounce.motion.table_columns import ColumnMatch, ColumnOptions, match_columns
from jounce.motion.units import ANGLES_OPTION_CURE

EPISODE, FRAME = "episode_index", "frame_index"  # the columns that make a table one of LeRobot
COUNTERS = (EPISODE, FRAME, "index", "task_index")  # columns of rows, which are no quantities
STATE = "observation.state"  # the list of measured positions; "action" holds what was asked for
NAME_SUFFIX = r"\.(pos|position|vel|velocity|effort|torque|current)$"  # of names in info.json
INFO = Path("meta", "info.json")
MAX_INFO_DEPTH = 4  # folders above a table of a data set: data/chunk-000/file-000.parquet
EPISODE_CURE = Remedy("select one by episode=N", "select one by --episode N")


class Episode(NamedTuple):
    """The rows of an episode: a span of a file."""

    path: Path
    span: Span


def is_data_set(source: Path) -> bool:
    """Return whether a path is the folder of a data set."""
    try:
        return (source / INFO).is_file()
    except OSError:  # a name longer than the file system takes
        return False


def list_tables(source: Path) -> list[Path] | None:
    """Return the tables of a data set, None of other folders."""
    if not is_data_set(source):
        return None
    paths = sorted((source / "data").rglob("*.parquet"))
    if len(paths) == 0:
        raise JounceError(f"{source}: a data set without tables; expected data/*/*.parquet")
    return paths


def episode_column(names: Sequence[str]) -> str | None:
    """Return the column that numbers the episodes, if any."""
    return EPISODE if {EPISODE, FRAME} <= {*names} else None


def list_episodes(source: Path, tables: Sequence[Path] | None = None) -> dict[int, Episode]:
    """Return the episodes of a data set or a table of one.

    They are {} of other sources. `tables` are those of a folder. Tables with different columns are refused, and rows of
    an episode that do not follow each other in one table.
    """
    paths = list_tables(source) if tables is None else tables
    if paths is None:
        is_parquet = source.suffix.lower() == ".parquet" and not source.is_dir()
        paths = [source] if is_parquet and episode_column(PARQUET.names(source)) is not None else []
    episodes: dict[int, Episode] = {}
    for path in paths:
        different = {EPISODE, FRAME, *PARQUET.names(paths[0])} ^ {*PARQUET.names(path)}
        if len(different) > 0:
            came = f"columns differ from those of {paths[0].name}: {join_names(sorted(different), 3)}"
            raise JounceError(f"{path}: {came}; expected the same columns in all tables of a data set")
        numbers = PARQUET.whole(path, lambda _: [EPISODE]).columns[EPISODE]
        starts = np.flatnonzero(np.append(True, np.diff(numbers) != 0)).tolist()
        for start, stop in pairwise([*starts, len(numbers)]):
            if not np.isfinite(numbers[start]):
                raise JounceError(f"{path}: row {start} from 0: {EPISODE} is missing; expected a number in each row")
            number = int(numbers[start])
            if number in episodes:
                came = f"episode {number} begins a second time, after {episodes[number].path.name}"
                raise JounceError(f"{path}: row {start} from 0: {came}; expected its rows one below the other")
            episodes[number] = Episode(path, Span(start, stop))
    return episodes


def find_episode(source: Path, episode: int | None) -> Episode | None:
    """Return an episode of a source, the only one by default.

    Return None where the source has no episodes.
    """
    episodes = list_episodes(source)
    if len(episodes) == 0:
        if episode is not None:
            what = f"data sets of LeRobot, whose tables have {EPISODE} and {FRAME}"
            raise JounceError(f"{source}: {option_name('episode')} is for {what}; leave it out")
        return None
    numbers = f"{min(episodes)} to {max(episodes)}"
    if episode is None and len(episodes) > 1:
        raise JounceError(f"{source}: {len(episodes)} episodes, {numbers}; {EPISODE_CURE}")
    chosen = min(episodes) if episode is None else episode
    if chosen not in episodes:
        raise JounceError(f"{source}: no episode {chosen}; it has {len(episodes)}, {numbers}")
    return episodes[chosen]


def match_episodes(
    path: Path, header: Sequence[str], mechanism: Mechanism, options: ColumnOptions, highest: int
) -> ColumnMatch:
    """Return the columns of a motion in a table, as `match_columns` does.

    Of a table of episodes, `info.json` names the joints, if it knows them, and the unit of angles has to be stated.
    """
    if episode_column(header) is None:
        return match_columns(header, mechanism, options, highest)
    # Measured positions first: what a refusal suggests are these, and not what was asked for.
    names = [name for name in header if name not in COUNTERS]
    names.sort(key=lambda name: not name.startswith(STATE))
    entry_names = _read_entry_names(path, names)
    joints = positions.names(mechanism)
    column_of = {name: column for column, name in entry_names.items() if column.startswith(f"{STATE}[")}
    if options.pattern is None and {*joints} <= {*column_of}:
        options = replace(options, pattern=tuple((joint, column_of[joint]) for joint in joints))
    for keyword, pattern in (("columns", options.pattern), ("torques", options.torques)):
        if isinstance(pattern, str):
            _refuse_other_order(keyword, pattern, mechanism, entry_names)
    match = match_columns(names, mechanism, options, highest)
    if "rad" in coordinates.position_units(mechanism) and not match.angles_stated:
        raise JounceError(
            f"data sets of LeRobot state no unit of angles, and many are in degrees; {ANGLES_OPTION_CURE}"
        )
    return match


def _read_entry_names(path: Path, header: Sequence[str]) -> dict[str, str]:
    """Return the names of entries of lists, as `info.json` has them.

    They are by column, ``observation.state[0]``. Lists without names have those of the positions, if they are as long.
    """
    folders = list(path.parents)[:MAX_INFO_DEPTH] if path.is_file() else []
    info = next((folder / INFO for folder in folders if is_data_set(folder)), None)
    if info is None:
        return {}
    value = entries.read(info, "the description of the data set").value
    features = value.get("features") if isinstance(value, dict) else None
    if not isinstance(features, dict):
        return {}
    names = {name: _list_names(feature) for name, feature in features.items()}
    lengths = Counter(column.rpartition("[")[0] for column in header)
    names_of_state = names.get(STATE, [])
    columns: dict[str, str] = {}
    for column, length in lengths.items():
        own_names = names.get(column, [])
        listed = own_names if len(own_names) > 0 else names_of_state
        if len(listed) == length and len({*listed}) == length:
            columns |= {f"{column}[{i}]": name for i, name in enumerate(listed)}
    return columns


def _list_names(feature: object) -> list[str]:
    """Return the names of a feature's entries without endings.

    Such an ending is ".pos". They are a list, or one list under any key.
    """
    names = feature.get("names") if isinstance(feature, dict) else None
    if isinstance(names, dict) and len(names) == 1:
        [names] = names.values()
    return [re.sub(NAME_SUFFIX, "", str(name)) for name in names] if isinstance(names, list) else []


def _refuse_other_order(keyword: str, pattern: str, mechanism: Mechanism, entry_names: Mapping[str, str]) -> None:
    """Raise `JounceError` where a pattern gives a joint the column of another."""
    joints = positions.names(mechanism)
    for number, joint in enumerate(joints):
        try:
            column = pattern.format(joint=joint, number=number + 1, index=number)
        except (LookupError, ValueError, AttributeError):
            return  # the pattern is refused later, with what is expected
        stated = entry_names.get(column, joint)
        if stated != joint and stated in joints:
            came = f"{option_name(keyword)} {quote_value(pattern)} reads {quote_value(column)} as {quote_value(joint)}"
            cure = f"leave {option_name('columns')} out"
            if keyword == "torques":
                new = f"tau_{stated}"
                cure = str(Remedy(f"rename={{{column!r}: {new!r}, ...}}", f"--rename '{column}={new}' ..."))
            raise JounceError(f"{came}, and {INFO} calls it {quote_value(stated)}; {cure}")
