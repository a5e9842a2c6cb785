"""Match the columns of a table with a motion: times, joints, rates, wrenches, torques.

`match_columns` is the door. It brings names to those of the robot, step by step: units off, prefixes renamed, times
called t, patterns of joints and torques replaced by joints, the base's prefix by ``base``. What is left over is either
a rate, a deviation, or another column. Then it checks that all columns that a motion needs are there, and each of them
once, and finds the factor to SI units of each.
"""

import re
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np

from jounce.arguments import names
from jounce.core.cures import Remedy, join_cures, option_name
from jounce.core.errors import JounceError, check_bool, join_names, one_line, quote_value, unknown_name_error
from jounce.model import coordinates, positions
from jounce.model.mechanism import Mechanism
from jounce.model.positions import Position
from jounce.motion import body_columns
from jounce.motion.column_names import Renaming, check_renaming, rename_columns, suggest_names
from jounce.motion.currents import Currents
from jounce.motion.units import ANGLE_UNITS, TIME_UNITS, split_unit, unit_factor
from jounce.spatial import groups
from jounce.spatial.series import RATE_SUFFIX, rate_name

TIME = "t"
TIME_NAMES = ("time", "timestamp")  # in any case, where there is no t
NUMBER_NAMES = "|".join(sorted({name for x in groups.GROUPS.values() for name in (*x.positions, *x.velocities)}))
RATE_COLUMN = re.compile(rf"(q|{NUMBER_NAMES})(?=.{{0,4}}$){RATE_SUFFIX}", re.DOTALL)  # of orders up to 999
DEVIATION = "_sd"  # what the name of a rate's column ends in that holds its standard deviation
# the last as `jounce motion` and `run` write them
TORQUE_PATTERNS = ("tau_{0}", "{0}.tau", "{0}_tau", "effort_{0}", "{0}.effort", "{0}_effort", "{0}.Q_measured")
# what names of commanded torques have besides those of their joints
COMMAND = re.compile(r"(?<![a-z])(cmd|command|commanded|d|des|desired|ref|reference|setpoint|target)(?![a-z])", re.I)
MISSPELT_RATE = re.compile(r"q[a-z0-9]{0,4}|[fm][a-z]?\d*d*")
DRAWING_COLUMNS = re.compile(rf"\.(q|{NUMBER_NAMES})_sample$|^break$")  # what `jounce motion` writes to be drawn
TIME_CURE = Remedy("name another column of times by time=", "name another column of times by --time COLUMN")
POSES_CURE = Remedy(
    "jounce.load_poses reads poses at rest", "`jounce payload` and `jounce identify` take poses at rest"
)
DURATION_CURE = Remedy(
    "state duration= for way points without times", "state --duration SECONDS for way points without times"
)
JOINT_CURES = (
    Remedy("name the columns by columns='q_{joint}'", "name the columns by --columns 'q_{joint}'"),
    Remedy("rename them by rename={'OLD': 'NEW'}", "rename them by --rename OLD=NEW"),
    Remedy("hold {absent} by lock= of jounce.load", "hold a joint by --lock {absent}=VALUE"),
)


JointColumns = tuple[tuple[str, str], ...]  # pairs of a joint and its column


class UntimedError(JounceError):
    """A table or file has positions of all joints, and no times."""


@dataclass(frozen=True)
class ColumnOptions:
    """What a caller says of the columns of a table."""

    time: str | None = None  # the column of times
    pattern: str | JointColumns | None = None  # how joints are called there, or the column of each joint
    angles: str | None = None  # the unit of angles
    time_unit: str | None = None
    torques: str | None = None  # how torques of joints are called there
    rename: Renaming = ()  # names there, and those of the robot
    unwrap: bool = False  # whether angles wrap, and turns are to be taken off
    skip: bool = field(default=False, repr=False)  # bad rows, whose treatment changes no result
    torque_constants: Any = None  # and ratios of gears, as `Currents` takes them
    gear_ratios: Any = None
    episode: int | None = None  # which motion of a data set is read

    def __post_init__(self) -> None:
        check_bool("unwrap", self.unwrap, "whether angles wrap at whole turns, which are to be taken off")
        for what, unit, units in (("angles", self.angles, ANGLE_UNITS), ("time_unit", self.time_unit, TIME_UNITS)):
            if unit is not None and (not isinstance(unit, str) or unit not in units):
                raise unknown_name_error(f"unit of {what}", unit, units)
        # Mappings become tuples of pairs, which are compared and hashed by value.
        if isinstance(self.pattern, Mapping | tuple):
            object.__setattr__(self, "pattern", _check_joint_columns(self.pattern))
        object.__setattr__(self, "rename", check_renaming(self.rename))
        texts = {"time": self.time, "torques": self.torques}
        if not isinstance(self.pattern, tuple):
            texts["columns"] = self.pattern
        for what, text in texts.items():
            if text is not None and not isinstance(text, str):
                raise JounceError(f"{what} is {quote_value(text)}; expected a text")
        is_number = isinstance(self.episode, int | np.integer) and not isinstance(self.episode, bool)
        if self.episode is not None and not is_number:
            raise JounceError(f"episode is {quote_value(self.episode)}; expected its number, from 0")
        currents = self.currents
        object.__setattr__(self, "torque_constants", currents.constants)
        object.__setattr__(self, "gear_ratios", currents.ratios)

    @property
    def currents(self) -> Currents:
        """The constants of motors whose currents are read."""
        return Currents(self.torque_constants, self.gear_ratios)

    def refuse(self, place: str, reason: str) -> None:
        """Raise `JounceError` if options are given for a motion without columns."""
        names = {"time": self.time, "columns": self.pattern, "angles": self.angles, "time_unit": self.time_unit}
        options = [name for name, value in {**names, "rename": self.rename or None}.items() if value is not None]
        if self.unwrap:
            options.append("unwrap")
        if self.currents.are_read:
            options.append("torque_constants")
        if self.episode is not None:
            options.append("episode")
        if len(options) > 0:
            raise JounceError(
                f"{place}: {reason}; {option_name(options[0])} is for the columns of a table: leave it out"
            )


@dataclass(frozen=True)
class ColumnMatch:
    """The columns of a motion in a table, by the robot's names."""

    sampled: bool  # whether there are samples of q, and no rates
    highest: int  # the order of the highest rate that is asked for
    sources: Mapping[str, str]  # names in the table
    factors: Mapping[str, float]  # that make SI units
    torques: Mapping[str, str] = field(default_factory=dict)  # columns of torques, by joint
    others: tuple[str, ...] = ()  # columns that are ignored
    angles_stated: bool = False
    time_stated: bool = False
    unwrap: bool = False
    torque_factors: Mapping[str, float] = field(default_factory=dict)  # of currents, by joint

    @property
    def names(self) -> list[str]:
        """The columns to read."""
        return list(dict.fromkeys([*self.sources.values(), *self.torques.values()]))

    @property
    def commanded(self) -> bool:
        """Whether torques are commands, by the names of all their columns."""
        # Names of joints may contain what commands are called by.
        bare_names = [source.replace(joint, "") for joint, source in self.torques.items()]
        return len(bare_names) > 0 and all(COMMAND.search(name) is not None for name in bare_names)

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on ignored columns, and on torques that are commands."""
        notes = []
        if len(self.others) > 0:
            notes.append(f"other columns, ignored: {join_names(self.others)}")
        if len(self.torque_factors) > 0:
            notes.append(Currents.describe(self.torque_factors, self.torques))
        if self.commanded:
            first = quote_value(next(iter(self.torques.values())))
            notes.append(f"torques are commands by the names of their columns, as {first}: no verdict relies on them")
        return tuple(notes)


def match_columns(header: Sequence[str], mechanism: Mechanism, options: ColumnOptions, highest: int) -> ColumnMatch:
    """Return the columns of a motion, by the names of a table.

    The motion has rates up to `highest`.

    Raises
    ------
    JounceError : if a joint, a rate or the times are missing, a unit is unknown, or both samples and rates are given.
    """
    joints = positions.names(mechanism)
    sources, units, torques = _name_columns(header, mechanism, options)
    base_names = body_columns.select_base_columns(list(sources), mechanism)
    renamed = ((base_names.get(name, name), source) for name, source in sources.items())
    sources = _rename_columns(renamed, lambda name: f"both state {name!r} of the base")
    wrench_names = body_columns.select_wrench_columns(list(sources), mechanism)
    body_names = {*wrench_names, *base_names.values()}
    # What is left are columns of joints and others. They are samples, if no rate is among them, or if a pattern says
    # which columns are the motion, whatever the others are.
    left_names = [name for name in sources if name not in body_names and sources[name] not in torques.values()]
    is_stated = options.pattern is not None and {*joints} <= {*left_names}
    sampled = is_stated or not any(_is_rate(name, mechanism) for name in left_names)
    # q3d may be derived from differences of q2d.
    has_jerk = any(name.endswith(".q3d") for name in left_names)
    is_derived = highest == 3 and len(base_names) == 0 and not has_jerk
    needed = list(joints) if sampled else _rate_columns(left_names, mechanism, highest - is_derived)
    _check_columns(left_names, [TIME, *needed], sampled, mechanism, highest)
    body_columns.check_base_columns(list(base_names.values()), mechanism, highest)
    # Columns to read: what the motion needs, followers of loops, and among rates deviations and higher rates too.
    follower_names = follower_columns(mechanism, list(sources), sampled).values()
    read_names = {TIME, *needed, *body_names, *follower_names}
    if not sampled:
        read_names |= {name for name in left_names if _is_known_column(name, mechanism)}
    used = {name: source for name, source in sources.items() if name in read_names}
    # Factors to SI units, by the unit that the name or the caller states.
    said = {"s": options.time_unit, "rad": options.angles}
    kinds = {name: _column_unit(name, mechanism, base_names.values()) for name in used}
    factors = {
        name: unit_factor(units[used[name]], said.get(kind), kind, k, used[name]) for name, (kind, k) in kinds.items()
    }
    ignored = [name for name in left_names if name not in read_names and not DRAWING_COLUMNS.search(name)]
    angles_stated = options.angles is not None or any(units[sources[name]] is not None for name in needed)
    time_stated = options.time_unit is not None or units[sources[TIME]] is not None
    others = tuple(sources[name] for name in ignored)
    return ColumnMatch(
        sampled,
        highest,
        used,
        factors,
        torques,
        others,
        angles_stated,
        time_stated,
        options.unwrap,
        options.currents.factors(mechanism.coordinates, torques, units),
    )


def find_absent_joints(header: Sequence[str], mechanism: Mechanism, options: ColumnOptions) -> list[str]:
    """Return the coordinates of joints of which a table has no column."""
    sources, _, _ = _name_columns(header, mechanism, options)
    return [joint for joint in mechanism.coordinates if joint not in sources and f"{joint}.q" not in sources]


def has_times(header: Sequence[str], mechanism: Mechanism, options: ColumnOptions) -> bool:
    """Return whether a table has a column of times.

    Otherwise its rows are no motion, but poses at rest or way points.
    """
    sources, _, _ = _name_columns(header, mechanism, options)
    return TIME in sources


def find_approach_columns(header: Sequence[str], mechanism: Mechanism, options: ColumnOptions) -> dict[str, str]:
    """Return the columns of directions from which joints came, by joint."""
    sources, _, _ = _name_columns(header, mechanism, options)
    called = {joint: (f"{joint}.approach", f"approach_{joint}") for joint in mechanism.coordinates}
    return {joint: sources[name] for joint, both in called.items() for name in both if name in sources}


def _name_columns(
    header: Sequence[str], mechanism: Mechanism, options: ColumnOptions
) -> tuple[dict[str, str], dict[str, str | None], dict[str, str]]:
    """Return the columns by names of the robot, units, and torques.

    Units are by columns, columns of torques by joint.
    """
    joints = positions.names(mechanism)
    if TIME in joints:
        raise JounceError("a joint is named 't' like the column of times; rename the joint")
    # Units are taken off names, but for a joint that is called like a name with its unit, and where another column has
    # the name without the unit. From here on `sources` are the columns of the table by their names so far.
    whole, taken = frozenset(joints), frozenset(header)
    split = {source: split_unit(source, whole, taken) for source in header}
    units = {source: unit for source, (_, unit) in split.items()}
    bare = _bare_names({source: name for source, (name, _) in split.items()}, mechanism, options)
    # Names of times, joints and the base, each as the robot has them.
    sources = _with_time(bare, header, options.time, joints)
    torques = _torque_columns(bare, units, options, mechanism.coordinates)
    return _with_pattern(sources, units, options.pattern, joints), units, torques


@lru_cache(maxsize=64)
def _column_units(mechanism: Mechanism) -> dict[str, tuple[str, int]]:
    """Return the units and orders of stems of columns.

    Columns of q and of rates begin with a stem. Its unit is that of q, its order that of what it states: 1 of
    velocities.
    """
    units = dict(zip(mechanism.coordinates, coordinates.units(mechanism), strict=True))
    stems: dict[str, tuple[str, int]] = {}
    for name, unit in zip(positions.names(mechanism), coordinates.position_units(mechanism), strict=True):
        # A joint of one coordinate has columns NAME.q, a number of a joint of several ones has its own name.
        is_coordinate = units.pop(name, None) is not None
        stems[f"{name}.q" if is_coordinate else name] = unit, 0
    return stems | {name: (unit, 1) for name, unit in units.items()}


def column_stems(mechanism: Mechanism) -> list[str]:
    """Return the stems of columns of q and of its rates.

    They are ``joint1.q`` or, of a ball, ``ankle.qx``.
    """
    return [stem for stem, (_, order) in _column_units(mechanism).items() if not order]


def joints_with_velocities(columns: Collection[str], mechanism: Mechanism) -> list[Position]:
    """Return the joints of several numbers whose velocities are stated.

    Balls, planar and free joints have such columns, ``ankle.wx``, in place of rates of q.
    """
    return [
        joint for joint in positions.list_multiscrew_joints(mechanism) if not {*joint.velocities}.isdisjoint(columns)
    ]


def _rate_columns(names: Collection[str], mechanism: Mechanism, highest: int) -> list[str]:
    """Return the columns that state all rates of q."""
    twists = joints_with_velocities(names, mechanism)
    # Of joints whose velocities are stated, the numbers need no rates.
    without_rates = {name for joint in twists for name in joint.names}
    columns = []
    for stem in column_stems(mechanism):
        orders = range(1 if stem in without_rates else highest + 1)
        columns += [rate_name(stem, k) for k in orders]
    for joint in twists:
        columns += [rate_name(name, k) for name in joint.velocities for k in range(highest)]
    return columns


def follower_columns(mechanism: Mechanism, columns: Collection[str], sampled: bool) -> dict[str, str]:
    """Return the columns of joints that follow others, by joint.

    They follow in closed loops. Columns that are not there are left out.
    """
    followers = [name for name in mechanism.tree.coordinates if name not in mechanism.coordinates]
    expected = {name: name if sampled else f"{name}.q" for name in followers}
    return {name: column for name, column in expected.items() if column in columns}


def _rename_columns(names: Iterable[tuple[str, str]], state: Callable[[str], str]) -> dict[str, str]:
    """Return the columns by their new names.

    Raises `JounceError` where two get the same name: `state` says what both of them do.
    """
    sources: dict[str, str] = {}
    for name, source in names:
        if name in sources:
            raise JounceError(
                f"columns {quote_value(sources[name])} and {quote_value(source)} {state(name)}; expected it once"
            )
        sources[name] = source
    return sources


def _bare_names(split: Mapping[str, str], mechanism: Mechanism, options: ColumnOptions) -> dict[str, str]:
    """Return the columns by names without units, as the robot's begin.

    Of columns that have the same name without units, patterns select one.
    """
    names = dict(split)
    if len(options.rename) > 0:
        names = rename_columns(names, options.rename, mechanism)
    # What patterns call joints and torques, with units as far as they state them.
    pattern_names: set[str] = set()
    patterns = (
        ("columns", options.pattern, positions.names(mechanism)),
        ("torques", options.torques, mechanism.coordinates),
    )
    for option, pattern, joints in patterns:
        if pattern is not None:
            pattern_names.update(_name_joints(option_name(option), pattern, joints))
    # Where a pattern names one of several columns, the others get a name that nothing matches.
    chosen = {name for source, name in names.items() if source in pattern_names}
    hidden = {source for source, name in names.items() if name in chosen and source not in pattern_names}
    by_pattern = Remedy("columns=", "--columns PATTERN")
    cure = f"select one by {by_pattern} with its unit, '{{joint}} [deg]'"
    return _rename_columns(
        ((f"{source} " if source in hidden else name, source) for source, name in names.items()),
        lambda _: f"have the same name: {cure}",
    )


def _with_time(
    sources: Mapping[str, str], header: Sequence[str], time: str | None, joints: Sequence[str]
) -> dict[str, str]:
    """Return the columns with the one of times called t."""
    if time is None:
        time_names = [name for name in sources if name.lower() in TIME_NAMES and name not in joints]
        if TIME in sources or len(time_names) == 0:
            return dict(sources)
        chosen = time_names[0]
    else:
        chosen = next((name for name, source in sources.items() if time in (name, source)), "")
        if chosen == "":
            raise JounceError(f"{option_name('time')}: {unknown_name_error('column', time, header)}")
    # Another column of that name is no time then.
    renamed = {name if name != TIME or chosen == TIME else f"{TIME} ": source for name, source in sources.items()}
    return {TIME if name == chosen else name: source for name, source in renamed.items()}


def _with_pattern(
    sources: Mapping[str, str],
    units: Mapping[str, str | None],
    pattern: str | JointColumns | None,
    joints: Sequence[str],
) -> dict[str, str]:
    """Return the columns with those of joints called as the joints are.

    Patterns are ``q_{joint}``, ``q{number}``, ``q[{index}]``, or the column of each joint.
    """
    if pattern is None:
        return dict(sources)
    places = _match_pattern(option_name("columns"), pattern, sources, units, joints)
    # A column that has the name of a joint, but is not the one of the pattern, gets a name that nothing matches.
    hidden = set(places.values()) - set(places)
    return {places.get(name, f"{name} " if name in hidden else name): source for name, source in sources.items()}


def _check_joint_columns(columns: Mapping[str, str] | JointColumns) -> JointColumns:
    """Return the columns of joints as pairs.

    Each joint has a column of its own.
    """
    pairs = tuple(columns.items()) if isinstance(columns, Mapping) else columns
    are_pairs = all(isinstance(pair, tuple) and len(pair) == 2 for pair in pairs)
    if not are_pairs or not all(isinstance(text, str) for pair in pairs for text in pair):
        raise JounceError(f"columns is {quote_value(columns)}; expected a pattern, or a mapping from joints to columns")
    joints_by_column: dict[str, str] = {}
    for joint, column in pairs:
        if column in joints_by_column:
            came = f"column {quote_value(column)} is that of {joints_by_column[column]!r} and {joint!r}"
            raise JounceError(f"{option_name('columns')}: {came}; expected a column for each joint")
        joints_by_column[column] = joint
    return pairs


def _name_joints(option: str, pattern: str | JointColumns, joints: Sequence[str]) -> list[str]:
    """Return what a pattern calls the joints.

    Joints that a mapping leaves out keep their names.
    """
    if isinstance(pattern, tuple):
        columns = dict(pattern)
        for joint in columns:
            if joint not in joints:
                raise JounceError(f"{option}: {unknown_name_error('joint', joint, joints)}")
        return [columns.get(joint, joint) for joint in joints]
    try:
        called = [pattern.format(joint=joint, number=j + 1, index=j) for j, joint in enumerate(joints)]
    except (LookupError, ValueError, AttributeError) as error:
        raise JounceError(f"{option} {quote_value(pattern)}: {one_line(error)}; {_EXPECTED}") from None
    if len(set(called)) < len(called):
        raise JounceError(
            f"{option} {quote_value(pattern)} names {quote_value(called[0])} for every joint; {_EXPECTED}"
        )
    return called


def _match_pattern(
    option: str,
    pattern: str | JointColumns,
    header: Mapping[str, str],
    units: Mapping[str, str | None],
    joints: Sequence[str],
) -> dict[str, str]:
    """Return the joint of each column that a pattern names.

    The pattern may have the column's unit or not.
    """
    called = _name_joints(option, pattern, joints)
    # A pattern with a unit names the column without it, if that has this unit.
    for i, (name, unit) in enumerate(map(split_unit, called)):
        if called[i] not in header and unit is not None and name in header and units[header[name]] == unit:
            called[i] = name
    if isinstance(pattern, tuple):
        stated = dict(pattern)
        for name, joint in zip(called, joints, strict=True):
            if joint in stated and name not in header:
                raise JounceError(f"{option}: {unknown_name_error('column', name, list(header))}")
    elif not any(name in header for name in called):
        came = f"{option} {quote_value(pattern)}: no column {join_names(map(quote_value, called[:2]))}"
        raise JounceError(f"{came}, ...; there are: {join_names(header)}")
    return {name: joint for name, joint in zip(called, joints, strict=True) if name in header}


_EXPECTED = "expected {joint}, {number} (from 1) or {index} (from 0) in it, as in 'q_{joint}'"


def _torque_columns(
    bare: Mapping[str, str], units: Mapping[str, str | None], options: ColumnOptions, joints: Sequence[str]
) -> dict[str, str]:
    """Return the columns of measured torques or currents, by joint."""
    if options.torques is not None:
        joint_of = _match_pattern(option_name("torques"), options.torques, bare, units, joints)
    else:
        # Where constants are stated, columns of currents go before those of torques.
        joint_of = _find_usual(options.currents.patterns, bare, joints)
        if len(joint_of) == 0:
            joint_of = _find_usual(TORQUE_PATTERNS, bare, joints)
    # Other units than N m or N are refused, or other ones than A where currents are read.
    options.currents.check_units({joint: bare[name] for name, joint in joint_of.items()}, units)
    for name in () if options.currents.are_read else joint_of:
        unit_factor(units[bare[name]], None, "load", 0, bare[name])
    cure = f"select one by {Remedy('torques=', '--torques PATTERN')}"
    return _rename_columns(
        ((joint, bare[name]) for name, joint in joint_of.items()),
        lambda joint: f"both state torques of {joint!r}: {cure}",
    )


def _find_usual(patterns: Sequence[str], bare: Mapping[str, str], joints: Sequence[str]) -> dict[str, str]:
    """Return the joints of columns that are called as usual."""
    usual_names = {known.format(joint): joint for known in patterns for joint in joints}
    return {name: usual_names[name] for name in bare if name in usual_names and name not in joints}


def _strip_rate(name: str) -> str:
    """Return the name of a column without the order of its rate.

    It is ``joint1.q`` of ``joint1.q2d``.
    """
    match = RATE_COLUMN.fullmatch(name.rpartition(".")[2])
    if match is None or match[2] is None:
        return name
    return name.removesuffix(match[2])


def _is_rate(name: str, mechanism: Mechanism) -> bool:
    """Return whether a column states q or a rate by a stem."""
    return name not in positions.names(mechanism) and _strip_rate(name) in _column_units(mechanism)


def _is_known_column(name: str, mechanism: Mechanism) -> bool:
    """Return whether a column states q, a rate, or a deviation.

    Of velocities no deviation is known.
    """
    rate = name.removesuffix(DEVIATION)
    stem = _strip_rate(rate)
    units = _column_units(mechanism)
    if stem not in units:
        return False
    _, order = units[stem]
    is_velocity, is_deviation = order > 0, rate != name
    return not (is_velocity and is_deviation)


def _is_misspelt(name: str, mechanism: Mechanism) -> bool:
    """Return whether a column looks like a misspelt rate or component.

    It is called after a joint or a body.
    """
    owner, _, suffix = name.rpartition(".")
    return owner in {*mechanism.coordinates, *mechanism.frame_names} and MISSPELT_RATE.fullmatch(suffix) is not None


def _check_columns(
    given: Sequence[str], expected: Sequence[str], sampled: bool, mechanism: Mechanism, highest: int
) -> None:
    """Raise `JounceError` unless the columns of joints are as expected.

    Columns that are missing, misspelt, or state the same twice are named, with what cures it.
    """
    joints, follows = positions.names(mechanism), names.find_followers(mechanism)
    # Columns that do not go together, and why: samples of a joint with rates, rates of numbers with velocities.
    samples = {*joints} - {*column_stems(mechanism)}
    unfit = {} if sampled else {name: "both samples and columns of rates" for name in given if name in samples}
    numbers_by_twist = {name for joint in joints_with_velocities(given, mechanism) for name in joint.names}
    doubled = [name for name in given if name not in numbers_by_twist and _strip_rate(name) in numbers_by_twist]
    unfit |= dict.fromkeys(doubled, "both rates of numbers and velocities")
    missing = [name for name in expected if name not in given]
    wrong = [name for name in given if not _is_known_column(name, mechanism) and _is_misspelt(name, mechanism)]
    if len(missing) == 0 and len(unfit) == 0 and len(wrong) == 0:
        return
    # What is expected, in words.
    if sampled:
        expectation = join_names(joints)
    else:
        expectation = f"for each joint {', '.join(rate_name('q', k) for k in range(highest + 1))}"
        several = positions.list_multiscrew_joints(mechanism)
        if len(several) > 0:
            number, velocity = several[0].names[-1], several[0].velocities[0]
            many = join_names([x.name for x in several])
            expectation += f"; of {many} rates of numbers, {number}d, or velocities, {velocity}, ..."
    # What cures it: an option for the times, for the first joint that is missing, or for rates.
    absent = [joint for joint in joints if joint in samples and not {joint, f"{joint}.q"}.isdisjoint(missing)]
    cures = [str(TIME_CURE)] if TIME in missing else []
    # The finished option is better than the names of options.
    unread = [name for name in given if name not in {TIME, *joints, *follows}]
    suggestion = suggest_names(joints, absent, unread) if sampled and len(absent) > 0 else ""
    if suggestion != "":
        cures.append(suggestion)
    else:
        cures += [join_cures(JOINT_CURES).replace("{absent}", joint) for joint in absent[:1]]
    if len(missing) > 0:
        if {name.rpartition(".")[2] for name in missing} <= {"q3d", "q4d"}:
            cures.append(f"{Remedy('order=1', '--order 1')} takes q3d from differences of q2d")
        # Results of jounce are no motions.
        forces = [f"{joint}.Q" for joint in joints if f"{joint}.Q" in given]
        if len(forces) > 0:
            came = f"it holds forces, {quote_value(forces[0])}, ..., and not the motion"
            raise JounceError(f"{came}; expected t and {expectation}: 'jounce run --rates' writes both")
    # Where columns are missing, all that are not known may be misspelt ones of them.
    others = [
        name for name in given if not _is_known_column(name, mechanism) and name.removesuffix(".q") not in follows
    ]
    named = [name for name in given if name in {*expected, *unfit, *(others if len(missing) > 0 else wrong)}]
    # Positions of all joints without times may be way points.
    is_untimed = missing == [TIME] and sampled and len(unfit) == 0
    if is_untimed:
        cures = [join_cures([TIME_CURE, DURATION_CURE, POSES_CURE])]
    try:
        names.check_names(named, expected, unfit, "; ".join([f"t and {expectation}", *filter(None, cures)]))
    except JounceError as error:
        raise (UntimedError(str(error)) if is_untimed else error) from None


def _column_unit(name: str, mechanism: Mechanism, of_base: Collection[str]) -> tuple[str, int]:
    """Return the unit of a column, and its order in time.

    The unit is s, rad, m, 1 or load; the order is the power of time that divides it.
    """
    if name in of_base:
        unit, suffix = body_columns.base_column_unit(name)
        return unit, _rate_order(f".q{suffix}")
    # Samples of a joint have its name alone, and a deviation has the unit of its rate.
    units = _column_units(mechanism.tree)
    rate = f"{name}.q" if f"{name}.q" in units else name.removesuffix(DEVIATION)
    unit, stem_order = ("s", 0) if name == TIME else units.get(_strip_rate(rate), ("load", 0))
    return unit, stem_order + _rate_order(rate)


def _rate_order(name: str) -> int:
    """Return the order of a rate by the name of its column.

    It is 0 of q, 1 of qd, 2 of q2d.
    """
    suffix = name[len(_strip_rate(name)) :]
    return int(suffix[:-1] or 1) if suffix else 0
