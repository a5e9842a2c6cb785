"""The columns of a motion in a table: times, joints, rates, wrenches, measured torques, each with its unit."""

import re
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache

from jounce.arguments import names
from jounce.core.cures import Remedy, join_cures, option_name, option_value
from jounce.core.errors import JounceError, check_bool, join_names, one_line, quote_value, unknown_name_error
from jounce.model import coordinates, positions
from jounce.model.mechanism import Mechanism
from jounce.model.positions import Position
from jounce.motion import body_columns
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
JOINT_CURES = (
    Remedy("name the columns by columns='q_{joint}'", "name the columns by --columns 'q_{joint}'"),
    Remedy("map their prefix by rename='OLD=NEW'", "map their prefix by --rename OLD=NEW"),
    Remedy("hold {absent} by lock= of jounce.load", "hold a joint by --lock {absent}=VALUE"),
)


@dataclass(frozen=True)
class ColumnOptions:
    """What a caller says of the columns: the one of times, how joints and their torques are called there, and units.

    `rename`, "OLD=NEW", is what names begin with there, and what they begin with in the robot.
    """

    time: str | None = None
    pattern: str | None = None
    angles: str | None = None
    time_unit: str | None = None
    torques: str | None = None
    rename: str | None = None
    unwrap: bool = False  # whether angles wrap, and turns are to be taken off
    skip: bool = field(default=False, repr=False)  # bad rows, whose treatment changes no result

    def __post_init__(self) -> None:
        check_bool("unwrap", self.unwrap, "whether angles wrap at whole turns, which are to be taken off")
        for what, given, known in (("angles", self.angles, ANGLE_UNITS), ("time_unit", self.time_unit, TIME_UNITS)):
            if given is not None and (not isinstance(given, str) or given not in known):
                raise unknown_name_error(f"unit of {what}", given, known)
        texts = {"time": self.time, "columns": self.pattern, "torques": self.torques, "rename": self.rename}
        for what, given in texts.items():
            if given is not None and not isinstance(given, str):
                raise JounceError(f"{what} is {quote_value(given)}; expected a text")
        if self.rename is not None and self.rename.count("=") != 1:
            raise JounceError(f"{option_value('rename', self.rename)}; expected OLD=NEW, as in 'fer_=panda_'")

    def refuse(self, place: str, reason: str) -> None:
        """Raise `JounceError` if options for columns are given although the motion has no columns."""
        names = {"time": self.time, "columns": self.pattern, "angles": self.angles, "time_unit": self.time_unit}
        given = [name for name, value in {**names, "rename": self.rename}.items() if value is not None]
        given += ["unwrap"] * self.unwrap
        if given:
            raise JounceError(f"{place}: {reason}; {option_name(given[0])} is for the columns of a table: leave it out")


@dataclass(frozen=True)
class ColumnMatch:
    """The columns of a motion: of each its name in the table, and the factor that makes SI units of its numbers."""

    sampled: bool
    sources: Mapping[str, str]
    factors: Mapping[str, float]
    torques: Mapping[str, str] = field(default_factory=dict)  # by joint
    others: tuple[str, ...] = ()
    angles_stated: bool = False
    time_stated: bool = False
    unwrap: bool = False

    @property
    def names(self) -> list[str]:
        """The columns to read."""
        return list(dict.fromkeys([*self.sources.values(), *self.torques.values()]))

    @property
    def commanded(self) -> bool:
        """Whether torques are commands, by what all their columns are called."""
        called = [source.replace(joint, "") for joint, source in self.torques.items()]
        return bool(called) and all(COMMAND.search(name) for name in called)

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes for the user: columns that are not part of the motion, and torques that are commands."""
        notes = []
        if self.others:
            notes.append(f"other columns, ignored: {join_names(self.others)}")
        if self.commanded:
            first = quote_value(next(iter(self.torques.values())))
            notes.append(f"torques are commands by the names of their columns, as {first}: no verdict relies on them")
        return tuple(notes)


def match_columns(header: Sequence[str], mechanism: Mechanism, options: ColumnOptions, highest: int) -> ColumnMatch:
    """The columns of a motion with rates up to `highest`, by the names that a table has.

    Raises
    ------
    JounceError : if a joint, a rate or the times are missing, a unit is unknown, or both samples and rates are given.
    """
    joints = positions.names(mechanism)
    if TIME in joints:
        raise JounceError("a joint is named 't' like the column of times; rename the joint")
    split = {source: (source, None) if source in joints else split_unit(source) for source in header}
    units = {source: unit for source, (_, unit) in split.items()}
    bare = sources = _bare_names({source: name for source, (name, _) in split.items()}, mechanism, options)
    sources = _with_time(sources, header, options.time, joints)
    torques = _torque_columns(bare, units, options.torques, mechanism.coordinates)
    sources = _with_pattern(sources, units, options.pattern, joints)
    of_base = body_columns.select_base_columns(list(sources), mechanism)
    renamed = ((of_base.get(name, name), source) for name, source in sources.items())
    sources = _rename_columns(renamed, lambda name: f"both state {name!r} of the base")
    of_wrenches = body_columns.select_wrench_columns(list(sources), mechanism)
    elsewhere = {*of_wrenches, *of_base.values()}
    given = [name for name in sources if name not in elsewhere and sources[name] not in torques.values()]
    stated = options.pattern is not None and {*joints} <= {*given}  # which columns are the motion, beside others
    sampled = stated or not any(_is_rate(name, mechanism) for name in given)
    is_derived = highest == 3 and not of_base and not any(name.endswith(".q3d") for name in given)  # of differences
    wanted = list(joints) if sampled else _rate_columns(given, mechanism, highest - is_derived)
    _check_columns(given, [TIME, *wanted], sampled, mechanism, highest)
    body_columns.check_base_columns(list(of_base.values()), mechanism, highest)
    passive = follower_columns(mechanism, list(sources), sampled).values()
    kept = {TIME, *wanted, *elsewhere, *passive} | {
        name for name in given if not sampled and _is_known_column(name, mechanism)
    }
    used = {name: source for name, source in sources.items() if name in kept}
    asked = {"s": options.time_unit, "rad": options.angles}
    kinds = {name: _column_unit(name, mechanism, of_base.values()) for name in used}
    factors = {
        name: unit_factor(units[used[name]], asked.get(kind), kind, k, used[name]) for name, (kind, k) in kinds.items()
    }
    ignored = [name for name in given if name not in kept and not DRAWING_COLUMNS.search(name)]
    angles_stated = options.angles is not None or any(units[sources[name]] for name in wanted)
    time_stated = options.time_unit is not None or units[sources[TIME]] is not None
    others = tuple(sources[name] for name in ignored)
    return ColumnMatch(sampled, used, factors, torques, others, angles_stated, time_stated, options.unwrap)


@lru_cache(maxsize=64)
def _column_units(mechanism: Mechanism) -> dict[str, tuple[str, int]]:
    """What columns of q and its rates begin with: the unit of q, and the order of what they state, 1 of velocities."""
    units = dict(zip(mechanism.coordinates, coordinates.units(mechanism), strict=True))
    found: dict[str, tuple[str, int]] = {}
    for name, unit in zip(positions.names(mechanism), coordinates.position_units(mechanism), strict=True):
        found[f"{name}.q" if units.pop(name, None) else name] = unit, 0
    return found | {name: (unit, 1) for name, unit in units.items()}


def column_stems(mechanism: Mechanism) -> list[str]:
    """What the columns of the numbers of q and of their rates begin with: ``joint1.q`` or, of a ball, ``ankle.qx``."""
    return [stem for stem, (_, order) in _column_units(mechanism).items() if not order]


def joints_with_velocities(columns: Collection[str], mechanism: Mechanism) -> list[Position]:
    """The balls, planar and free joints of which columns state velocities, ``ankle.wx``, in place of rates of q."""
    return [
        joint for joint in positions.list_multiscrew_joints(mechanism) if not {*joint.velocities}.isdisjoint(columns)
    ]


def _rate_columns(given: Collection[str], mechanism: Mechanism, highest: int) -> list[str]:
    """The columns that state all rates of q."""
    twists = joints_with_velocities(given, mechanism)
    still = {name for joint in twists for name in joint.names}
    columns = [
        rate_name(stem, k) for stem in column_stems(mechanism) for k in range(1 if stem in still else highest + 1)
    ]
    return columns + [rate_name(name, k) for joint in twists for name in joint.velocities for k in range(highest)]


def follower_columns(mechanism: Mechanism, columns: Collection[str], sampled: bool) -> dict[str, str]:
    """The columns, by joint, of positions of joints that follow others in closed loops, as far as they are there."""
    known = [name for name in mechanism.tree.coordinates if name not in mechanism.coordinates]
    found = {name: name if sampled else f"{name}.q" for name in known}
    return {name: column for name, column in found.items() if column in columns}


def _rename_columns(names: Iterable[tuple[str, str]], state: Callable[[str], str]) -> dict[str, str]:
    """The columns by their new names; raises `JounceError` where two get the same one."""
    found: dict[str, str] = {}
    for name, source in names:
        if name in found:
            raise JounceError(
                f"columns {quote_value(found[name])} and {quote_value(source)} {state(name)}; expected it once"
            )
        found[name] = source
    return found


def _bare_names(split: Mapping[str, str], mechanism: Mechanism, options: ColumnOptions) -> dict[str, str]:
    """The columns by their names without units, which begin as those of the robot do; patterns select among equals."""
    names, of_joints = dict(split), (positions.names(mechanism), mechanism.coordinates)
    if options.rename is not None:
        names = _with_prefix(names, options.rename, mechanism)
    given = zip(map(option_name, ("columns", "torques")), (options.pattern, options.torques), of_joints, strict=True)
    asked = {
        name
        for option, pattern, joints in given
        if pattern is not None
        for name in _name_joints(option, pattern, joints)
    }
    chosen = {name for source, name in names.items() if source in asked}
    hidden = {source for source, name in names.items() if name in chosen and source not in asked}
    by_pattern = Remedy("columns=", "--columns PATTERN")
    cure = f"select one by {by_pattern} with its unit, '{{joint}} [deg]'"
    return _rename_columns(
        ((f"{source} " if source in hidden else name, source) for source, name in names.items()),
        lambda _: f"have the same name: {cure}",
    )


def _with_prefix(names: Mapping[str, str], rename: str, mechanism: Mechanism) -> dict[str, str]:
    """Names of columns in which those of joints and bodies begin as the robot has them: ``tau_fer_joint1`` too."""
    old, new = rename.split("=")
    several = [joint.name for joint in positions.list_multiscrew_joints(mechanism)]
    known = [*positions.names(mechanism), *several, *mechanism.tree.coordinates, *mechanism.frame_names]
    theirs = {old + name.removeprefix(new): name for name in known if name.startswith(new)}
    longest = sorted(theirs, key=len, reverse=True)
    called = re.compile(rf"(?<![^\W_])({'|'.join(map(re.escape, longest))})(?![^\W_])")
    found = {source: called.sub(lambda match: theirs[match[1]], name) for source, name in names.items()}
    if not theirs or found == names:
        came = f"no column of {join_names(theirs, 3)}" if theirs else f"no joint or body begins with {quote_value(new)}"
        exist = names if theirs else mechanism.coordinates
        raise JounceError(f"{option_value('rename', rename)}: {came}; there are: {join_names(exist)}")
    return found


def _with_time(
    sources: Mapping[str, str], header: Sequence[str], time: str | None, joints: Sequence[str]
) -> dict[str, str]:
    """The columns with the one of times called t."""
    if time is None:
        also = [name for name in sources if name.lower() in TIME_NAMES and name not in joints]
        if TIME in sources or not also:
            return dict(sources)
        chosen = also[0]
    else:
        chosen = next((name for name, source in sources.items() if time in (name, source)), "")
        if not chosen:
            raise JounceError(f"{option_name('time')}: {unknown_name_error('column', time, header)}")
    renamed = {name if name != TIME or chosen == TIME else f"{TIME} ": source for name, source in sources.items()}
    return {TIME if name == chosen else name: source for name, source in renamed.items()}


def _with_pattern(
    sources: Mapping[str, str], units: Mapping[str, str | None], pattern: str | None, joints: Sequence[str]
) -> dict[str, str]:
    """The columns with those of joints called as the joints are: ``q_{joint}``, ``q{number}``, ``q[{index}]``."""
    if pattern is None:
        return dict(sources)
    places = _match_pattern(option_name("columns"), pattern, sources, units, joints)
    hidden = set(places.values()) - set(places)
    return {places.get(name, f"{name} " if name in hidden else name): source for name, source in sources.items()}


def _name_joints(option: str, pattern: str, joints: Sequence[str]) -> list[str]:
    """What a pattern calls the joints."""
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
    option: str, pattern: str, header: Mapping[str, str], units: Mapping[str, str | None], joints: Sequence[str]
) -> dict[str, str]:
    """The joint of each column that a pattern names, with its unit or without."""
    called = _name_joints(option, pattern, joints)
    for i, (name, unit) in enumerate(map(split_unit, called)):
        if called[i] not in header and unit is not None and name in header and units[header[name]] == unit:
            called[i] = name
    if not any(name in header for name in called):
        came = f"{option} {quote_value(pattern)}: no column {join_names(map(quote_value, called[:2]))}"
        raise JounceError(f"{came}, ...; there are: {join_names(header)}")
    return {name: joint for name, joint in zip(called, joints, strict=True) if name in header}


_EXPECTED = "expected {joint}, {number} (from 1) or {index} (from 0) in it, as in 'q_{joint}'"


def _torque_columns(
    bare: Mapping[str, str], units: Mapping[str, str | None], pattern: str | None, joints: Sequence[str]
) -> dict[str, str]:
    """The columns of measured torques, by joint."""
    if pattern is None:
        called = {known.format(joint): joint for known in TORQUE_PATTERNS for joint in joints}
        found = {name: called[name] for name in bare if name in called and name not in joints}
    else:
        found = _match_pattern(option_name("torques"), pattern, bare, units, joints)
    for name in found:
        unit_factor(units[bare[name]], None, "load", 0, bare[name])
    cure = f"select one by {Remedy('torques=', '--torques PATTERN')}"
    return _rename_columns(
        ((joint, bare[name]) for name, joint in found.items()), lambda joint: f"both state torques of {joint!r}: {cure}"
    )


def _strip_rate(name: str) -> str:
    """What the name of a column of a rate begins with: ``joint1.q`` of ``joint1.q2d``."""
    found = RATE_COLUMN.fullmatch(name.rpartition(".")[2])
    return name[: len(name) - len(found[2] or "")] if found else name


def _is_rate(name: str, mechanism: Mechanism) -> bool:
    return name not in positions.names(mechanism) and _strip_rate(name) in _column_units(mechanism)


def _is_known_column(name: str, mechanism: Mechanism) -> bool:
    """Whether a column states q or a rate, or the standard deviation of one; of velocities none is known."""
    stated = name.removesuffix(DEVIATION)
    return _column_units(mechanism).get(_strip_rate(stated), ("", 2))[1] <= (stated == name)


def _is_misspelt(name: str, mechanism: Mechanism) -> bool:
    """Whether a column looks like a misspelt rate of a joint or component of a wrench."""
    owner, _, suffix = name.rpartition(".")
    return owner in {*mechanism.coordinates, *mechanism.frame_names} and MISSPELT_RATE.fullmatch(suffix) is not None


def _check_columns(
    given: Sequence[str], expected: Sequence[str], sampled: bool, mechanism: Mechanism, highest: int
) -> None:
    joints, follows = positions.names(mechanism), names.find_followers(mechanism)
    samples = {*joints} - {*column_stems(mechanism)}
    unfit = {} if sampled else {name: "both samples and columns of rates" for name in given if name in samples}
    twice = {name for joint in joints_with_velocities(given, mechanism) for name in joint.names}
    both = [name for name in given if name not in twice and _strip_rate(name) in twice]
    unfit |= dict.fromkeys(both, "both rates of numbers and velocities")
    missing = [name for name in expected if name not in given]
    wrong = [name for name in given if not _is_known_column(name, mechanism) and _is_misspelt(name, mechanism)]
    if not missing and not unfit and not wrong:
        return
    asked = (
        join_names(joints) if sampled else f"for each joint {', '.join(rate_name('q', k) for k in range(highest + 1))}"
    )
    if not sampled and (several := positions.list_multiscrew_joints(mechanism)):
        number, velocity = several[0].names[-1], several[0].velocities[0]
        asked += (
            f"; of {join_names([x.name for x in several])} rates of numbers, {number}d, or velocities, {velocity}, ..."
        )
    absent = [joint for joint in joints if joint in samples and not {joint, f"{joint}.q"}.isdisjoint(missing)]
    cures = [str(TIME_CURE)] * (TIME in missing)
    cures += [join_cures(JOINT_CURES).replace("{absent}", joint) for joint in absent[:1]]
    if missing and {name.rpartition(".")[2] for name in missing} <= {"q3d", "q4d"}:
        cures.append(f"{Remedy('order=1', '--order 1')} takes q3d from differences of q2d")
    if missing and (forces := [f"{joint}.Q" for joint in joints if f"{joint}.Q" in given]):
        came = f"it holds forces, {quote_value(forces[0])}, ..., and not the motion"
        raise JounceError(f"{came}; expected t and {asked}: 'jounce run --rates' writes both")
    others = [
        name for name in given if not _is_known_column(name, mechanism) and name.removesuffix(".q") not in follows
    ]
    named = [name for name in given if name in {*expected, *unfit, *(others if missing else wrong)}]
    names.check_names(named, expected, unfit, "; ".join([f"t and {asked}", *filter(None, cures)]))


def _column_unit(name: str, mechanism: Mechanism, of_base: Collection[str]) -> tuple[str, int]:
    """The unit of a column, s, rad, m, 1 or load, and the power of time that divides it."""
    if name in of_base:
        unit, suffix = body_columns.base_column_unit(name)
        return unit, _rate_order(f".q{suffix}")
    units = _column_units(mechanism.tree)
    stated = f"{name}.q" if f"{name}.q" in units else name.removesuffix(DEVIATION)
    unit, least = ("s", 0) if name == TIME else units.get(_strip_rate(stated), ("load", 0))
    return unit, least + _rate_order(stated)


def _rate_order(name: str) -> int:
    """The order of a rate by the name of its column: 0 of q, 1 of qd, 2 of q2d."""
    suffix = name[len(_strip_rate(name)) :]
    return int(suffix[:-1] or 1) if suffix else 0
