"""Names of columns that are not those of the robot: stated renamings, and the renaming that a refusal suggests.

A renaming is a pair: (OLD, NEW) of a whole column, or (OLD*, NEW*) of a prefix. A prefix is replaced wherever a name of
the robot stands in the name of a column, so that ``tau_fer_joint1`` becomes ``tau_panda_joint1``.

`suggest_names` compares the joints without a column with the columns that nothing has read, and returns an option that
maps all of them: a pattern where the columns are numbered or hold the names of the joints, a prefix where all differ by
one, or one renaming per joint. It never decides: the caller reads the suggestion and gives the option.
"""

import re
import shlex
from collections.abc import Mapping, Sequence
from difflib import SequenceMatcher
from itertools import takewhile
from typing import Any

from jounce.core.cures import Remedy, option_name, repeat_command
from jounce.core.errors import JounceError, join_names, quote_value
from jounce.model import positions
from jounce.model.mechanism import Mechanism

STAR = "*"
NUMBERED = re.compile(r"(.*?)(\d+)(\D*)", re.DOTALL)
MIN_LIKENESS = 0.5  # of two names: half of their letters are the same, in the same order

Renaming = tuple[tuple[str, str], ...]


def check_renaming(given: Any) -> Renaming:
    """Return renamings as pairs of OLD and NEW.

    Raises `JounceError` unless they are pairs of texts with a star at the end of both or of none, each OLD once.
    """
    pairs = tuple(given.items()) if isinstance(given, Mapping) else given
    is_pairs = isinstance(pairs, tuple | list) and all(isinstance(x, tuple | list) and len(x) == 2 for x in pairs)
    if not is_pairs or not all(isinstance(text, str) and text != "" for pair in pairs for text in pair):
        expected = "expected a mapping {'OLD': 'NEW'} of columns, or {'OLD*': 'NEW*'} of a prefix"
        raise JounceError(f"rename is {quote_value(given)}; {expected}")
    for old, new in pairs:
        if old.endswith(STAR) != new.endswith(STAR) or STAR in old[:-1] + new[:-1]:
            raise JounceError(f"{_describe(old, new)}; expected OLD=NEW for a column, OLD*=NEW* for a prefix")
    new_names: dict[str, str] = {}
    for old, new in pairs:
        if old in new_names:
            came = f"{quote_value(old)} is renamed twice, to {quote_value(new_names[old])} and {quote_value(new)}"
            raise JounceError(f"{option_name('rename')}: {came}; expected once")
        new_names[old] = new
    return tuple(new_names.items())


def rename_columns(names: Mapping[str, str], renaming: Renaming, mechanism: Mechanism) -> dict[str, str]:
    """Return the names of columns after all renamings.

    They are by the names in the table. `names` are the names without units; OLD may be either.

    Raises
    ------
    JounceError : if nothing has the name or the prefix, or two columns get one name.
    """
    renamed = dict(names)
    for old, new in renaming:
        if old.endswith(STAR):
            renamed |= _replace_prefix(names, old[:-1], new[:-1], mechanism)
            continue
        # The whole heading is meant before the name without its unit, which several columns may share.
        sources = [old] if old in names else [source for source, name in names.items() if name == old]
        if len(sources) == 0:
            raise JounceError(_missing_column(names, old, new, mechanism))
        if len(sources) > 1:
            came = f"{_describe(old, new)}: columns {join_names(map(quote_value, sources))} have this name"
            raise JounceError(f"{came}; expected one of them, with its unit")
        renamed[sources[0]] = new
    # A renaming must not hide that another column has the name already.
    sources_by_name: dict[str, str] = {}
    changed = {source for source in names if renamed[source] != names[source]}
    for source, name in renamed.items():
        other = sources_by_name.setdefault(name, source)
        if other != source and {source, other} & changed:
            came = f"columns {quote_value(other)} and {quote_value(source)} both become {quote_value(name)}"
            raise JounceError(f"{option_name('rename')}: {came}; expected different names")
    return renamed


def _replace_prefix(names: Mapping[str, str], old: str, new: str, mechanism: Mechanism) -> dict[str, str]:
    """Return the new names of columns that have the prefix.

    The prefix stands where a name of the robot begins.
    """
    described = _describe(old + STAR, new + STAR)
    # Names of the robot by what the table calls them.
    by_old_name = {old + name.removeprefix(new): name for name in _robot_names(mechanism) if name.startswith(new)}
    if len(by_old_name) == 0:
        came = f"no joint or body begins with {quote_value(new)}"
        raise JounceError(f"{described}: {came}; there are: {join_names(mechanism.coordinates)}")
    # Long names first: joint1 would be replaced within joint10. Names end where letters and digits do.
    longest_first = sorted(by_old_name, key=len, reverse=True)
    old_name = re.compile(rf"(?<![^\W_])({'|'.join(map(re.escape, longest_first))})(?![^\W_])")
    renamed = {source: old_name.sub(lambda match: by_old_name[match[1]], name) for source, name in names.items()}
    changed = {source: name for source, name in renamed.items() if name != names[source]}
    if len(changed) == 0:
        raise JounceError(f"{described}: no column of {join_names(by_old_name, 3)}; there are: {join_names(names)}")
    return changed


def _missing_column(names: Mapping[str, str], old: str, new: str, mechanism: Mechanism) -> str:
    """Describe a renaming of a column that is not there.

    The beginning of names may be meant.
    """
    came = f"{_describe(old, new)}: no column {quote_value(old)}"
    is_prefix = any(name.startswith(old) for name in names.values())
    if is_prefix and any(name.startswith(new) for name in _robot_names(mechanism)):
        return f"{came}; a prefix is renamed by {_describe(old + STAR, new + STAR)}"
    return f"{came}; there are: {join_names(names)}"


def _describe(old: str, new: str) -> str:
    """Describe a renaming in the words of its reader."""
    return str(Remedy(f"rename={{{old!r}: {new!r}}}", f"--rename {shlex.quote(f'{old}={new}')}"))


def _robot_names(mechanism: Mechanism) -> list[str]:
    """Return the names of the robot that columns may hold."""
    several = [joint.name for joint in positions.list_multiscrew_joints(mechanism)]
    return [*positions.names(mechanism), *several, *mechanism.tree.coordinates, *mechanism.frame_names]


def suggest_names(joints: Sequence[str], absent: Sequence[str], columns: Sequence[str]) -> str:
    """Return a cure that gives columns to joints without one.

    It is "" if none is likely.

    Parameters
    ----------
    joints : the joints of the robot, in its order
    absent : those without a column
    columns : the columns that nothing reads, by their names without units, in the order of the table
    """
    pattern = _find_pattern(joints, columns)
    # A prefix of names is renamed, in columns of torques too.
    if pattern is not None and pattern.endswith("{joint}"):
        return _suggest_renaming({pattern.removesuffix("{joint}") + STAR: STAR})
    if pattern is not None:
        return _suggest("columns", Remedy(f"columns={pattern!r}", repeat_command("columns", [pattern])))
    pairs = _match_similar(absent, columns)
    condition = ""
    if len(pairs) == 0 and len(absent) == len(columns):
        pairs = dict(zip(columns, absent, strict=True))
        condition = " if the columns are in the robot's order"
    if len(pairs) == 0:
        return ""
    return _suggest_renaming(_shorten_to_prefix(pairs), condition)


def _suggest_renaming(renaming: Mapping[str, str], condition: str = "") -> str:
    """Return renamings as a cure in words."""
    pairs_in_words = [f"{old}={new}" for old, new in renaming.items()]
    command = repeat_command("rename", pairs_in_words, repeatable=True)
    return _suggest("rename", Remedy(f"rename={renaming}", command), condition)


def _suggest(keyword: str, cure: Remedy, condition: str = "") -> str:
    """Return a cure in words.

    It is "" if the running command has no option for it.
    """
    return f"try{condition}: {cure}" if option_name(keyword) != "" else ""


def _find_pattern(joints: Sequence[str], columns: Sequence[str]) -> str | None:
    """Return the pattern of columns that all joints have, or None.

    Columns hold the names or the numbers of joints.
    """
    known = {*columns}
    for column in columns:
        # The name of a joint with something around it.
        if joints[0] in column:
            before, _, after = column.partition(joints[0])
            if known.issuperset(f"{before}{joint}{after}" for joint in joints):
                return f"{before}{{joint}}{after}"
        # Or a number from 1 or from 0.
        match = NUMBERED.fullmatch(column)
        for word, first in (("number", 1), ("index", 0)):
            if match is not None and int(match[2]) == first:
                numbers = range(first, first + len(joints))
                if len(joints) > 1 and known.issuperset(f"{match[1]}{k}{match[3]}" for k in numbers):
                    return f"{match[1]}{{{word}}}{match[3]}"
    return None


def _match_similar(absent: Sequence[str], columns: Sequence[str]) -> dict[str, str]:
    """Return the joint of each column by the likeness of names.

    It is {} unless each joint has a column of its own.
    """
    pairs: dict[str, str] = {}
    for joint in absent:
        likeness = {column: SequenceMatcher(None, column.lower(), joint.lower()).ratio() for column in columns}
        best = max(likeness, key=likeness.__getitem__, default=None)
        is_alone = best is not None and list(likeness.values()).count(likeness[best]) == 1
        if best is None or not is_alone or likeness[best] < MIN_LIKENESS or best in pairs:
            return {}
        pairs[best] = joint
    return pairs


def _shorten_to_prefix(pairs: Mapping[str, str]) -> dict[str, str]:
    """Return one renaming of a prefix if all pairs differ by it."""
    prefixes = set()
    for column, joint in pairs.items():
        # The end that both names share is what follows the prefixes.
        letters = zip(reversed(column), reversed(joint), strict=False)
        shared = sum(1 for _ in takewhile(lambda pair: pair[0] == pair[1], letters))
        prefixes.add((column[: len(column) - shared], joint[: len(joint) - shared]))
    if len(pairs) < 2 or len(prefixes) != 1:
        return dict(pairs)
    ((old, new),) = prefixes
    return {old + STAR: new + STAR}
