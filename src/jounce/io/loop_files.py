"""Reads the loops of a URDF from a YAML or JSON file.

A URDF is a tree. What closes its loops stands in a second file, in one of two forms, which their keys identify. The
first is that of Gepetto's example-parallel-robots and of its generator:

closed_loop: [[closedloop1_A, closedloop1_B], [rod_end, lever_end]]   # pairs of links, or of joints that carry them
type: [6d, 3d]                        # 6d: the frames coincide, a weld; 3d: their origins meet, a ball
name_mot: [motor_hip, motor_knee]     # joints with motors; or one text: part of the name of each of them
joint_name: [spherical_rod, lever]    # joints that the URDF writes as another type, for lack of theirs
joint_type: [SPHERICAL, UJOINT_XY]    # a ball; UJOINT_XY, CARDAN: turns about x, then y of the joint's frame; FIXED

Its older files have `rotule_name`, part of the names of all balls, and `Lidmot` and `Lidvmot`, places that follow from
`name_mot`. The second form is the section of loops of jounce's own robot files, `robot_sections.read_loops`. Both may
state joint types, `independent`, `passive` and `weights`, and `start`, a configuration with closed loops.

`read` checks the keys. `replace_joints` changes the types of joints before the tree is built: a universal joint NAME
becomes joints NAME_X and NAME_Y with a massless link between them. `close_loops` closes the loops of the tree. Where
the first form names no passive coordinates, those that motors leave loose become passive, as the spin of a rod between
two balls.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import permutations
from pathlib import Path

import numpy as np

from jounce.arguments import loops as loop_arguments
from jounce.core.cures import Remedy
from jounce.core.errors import JounceError, join_names, locate_errors, quote_value, unknown_name_error, warn
from jounce.io import entries, robot_sections
from jounce.io.entries import Entry
from jounce.model.mechanism import Mechanism
from jounce.model.tree import Joint, Link

LOOPS_OPTION = Remedy("loops=", "--loops")
PAIR_KEYS = ("closed_loop", "type", "name_mot")
TYPE_KEYS = ("joint_name", "joint_type")
BALLS_KEY, PLACE_KEYS = "rotule_name", ("Lidmot", "Lidvmot")  # of older files
# Exports of CAD are closed at zero to the digits of their numbers. In rad or m: links of a decimeter are open by
# millimeters where a joint has to turn further.
MAX_ZERO_CORRECTION = 0.05
CLOSURE_KEYS = ("independent", "passive", "weights", "start")  # of jounce's own section, in both forms
CUT_JOINTS = {"3d": "spherical", "6d": "fixed"}  # by the type of a loop, in small letters
TURN_SCREWS = {"X": (1, 0, 0, 0, 0, 0), "Y": (0, 1, 0, 0, 0, 0), "Z": (0, 0, 1, 0, 0, 0)}


@dataclass(frozen=True)
class LoopFile:
    """A file of loops, and the joints that it replaces.

    `joint_types` has the entry of a type by the name of each joint.
    """

    content: Entry
    joint_types: Mapping[str, Entry]

    @property
    def states_pairs(self) -> bool:
        """Whether the file states pairs of frames, as Gepetto's do."""
        return PAIR_KEYS[0] in self.content.value


def read(path: Path) -> LoopFile:
    """Return a file of loops, of the form that its keys identify."""
    content = entries.read(path, "the file of loops")
    keys = list(content.members())
    if content.alone(PAIR_KEYS[0], [robot_sections.LOOPS_SECTION, "actuated"]):
        content.keys(PAIR_KEYS, (*TYPE_KEYS, *CLOSURE_KEYS, BALLS_KEY, *PLACE_KEYS))
    elif robot_sections.LOOPS_SECTION in keys or "actuated" in keys:
        content.keys(("actuated",), (robot_sections.LOOPS_SECTION, *CLOSURE_KEYS, *TYPE_KEYS))
    else:
        came = join_names(keys) if len(keys) > 0 else "none"
        forms = f"'closed_loop' (with {join_names(PAIR_KEYS[1:])}) or 'loops' (with actuated)"
        raise JounceError(
            f"{content.place}: the file of loops has no key that identifies it, {forms}; its keys: {came}"
        )
    return LoopFile(content, _read_joint_types(content))


def _read_joint_types(content: Entry) -> dict[str, Entry]:
    """Return the entry of a joint's type by the joint's name."""
    names, types = (content.get(key, []).items() for key in TYPE_KEYS)
    _check_lengths(content, TYPE_KEYS, len(names), len(types))
    types_by_name: dict[str, Entry] = {}
    for name, joint_type in zip(names, types, strict=True):
        if name.text() in types_by_name:
            raise name.error("each joint once")
        if joint_type.text().upper() not in REPLACEMENTS:
            unknown = unknown_name_error("joint_type", joint_type.value, REPLACEMENTS)
            raise JounceError(f"{joint_type.place}: joint {quote_value(name.value)}: {unknown}")
        types_by_name[name.value] = joint_type
    return types_by_name


def _check_lengths(content: Entry, keys: Sequence[str], count: int, other_count: int) -> None:
    """Raise `JounceError` unless two lists of a file have one length."""
    if count != other_count:
        first, other = keys
        place = content.get(other).place
        raise JounceError(f"{place}: {first} has {count} entries and {other} {other_count}; expected one for each")


# Joints of other types.
def replace_joints(stated: LoopFile, links: Sequence[Link], joints: Sequence[Joint]) -> tuple[list[Link], list[Joint]]:
    """Return the links and joints of a tree, types of joints replaced.

    Limits of a replaced joint are those of another joint, and are left out; so are its drive terms, with a warning.
    """
    # The type of each joint that is named, or has a name with the part that marks balls.
    joint_types = dict(stated.joint_types)
    names = [joint.name for joint in joints]
    for name in joint_types:
        if name not in names:
            place = stated.content.get("joint_name").place
            raise JounceError(f"{place}: joint_name: {unknown_name_error('joint', name, names)}")
    if BALLS_KEY in stated.content.value:
        balls = stated.content.get(BALLS_KEY)
        moving_names = [joint.name for joint in joints if len(joint.screws) > 0]
        ball_types = dict.fromkeys(_names_with(balls, moving_names), replace(balls, value="SPHERICAL"))
        joint_types = ball_types | joint_types
    # A joint of another type may become several, with links between them.
    new_links: list[Link] = []
    new_joints: list[Joint] = []
    for joint in joints:
        if joint.name in joint_types:
            made_links, made_joints = _replace_joint(joint, joint_types[joint.name])
        else:
            made_links, made_joints = [], [joint]
        new_links += made_links
        new_joints += made_joints
    driven = [joint.name for joint in joints if joint.name in joint_types and any(joint.drive.values())]
    if len(driven) > 0:
        lost = f"damping and friction of {join_names(driven)} are left out"
        warn(f"{stated.content.path}: {lost}, as the file gives these joints another type")
    return [*links, *new_links], new_joints


def _names_with(part: Entry, names: Sequence[str]) -> list[str]:
    """Return the names that contain the text of an entry."""
    found = [name for name in names if part.text() in name]
    if len(found) == 0 or part.value == "":
        raise part.error(f"a part of one of the names {join_names(names)}")
    return found


def _replace_joint(joint: Joint, joint_type: Entry) -> tuple[list[Link], list[Joint]]:
    """Return the joints in place of one, and the links between them."""
    if joint.mimic is not None:
        came = f"joint {quote_value(joint.name)} is {joint_type.value}, yet mimics {quote_value(joint.mimic.joint)}"
        raise JounceError(f"{joint_type.place}: {came} at {joint.place}; expected one of both")
    bare = replace(joint, X=None, free=None, limits={}, drive={})
    return REPLACEMENTS[joint_type.value.upper()](bare)


def _make_ball(joint: Joint) -> tuple[list[Link], list[Joint]]:
    """Return a ball at the origin of a joint's frame."""
    return [], [replace(joint, free="spherical")]


def _make_weld(joint: Joint) -> tuple[list[Link], list[Joint]]:
    """Return a weld at the zero of a joint."""
    return [], [joint]


def _make_universal(joint: Joint, axes: Sequence[str]) -> tuple[list[Link], list[Joint]]:
    """Return turns about one and then another axis of a joint."""
    first_name, second_name = (f"{joint.name}_{axis}" for axis in axes)
    first_screw, second_screw = (np.array(TURN_SCREWS[axis], dtype=float) for axis in axes)
    # The link between both turns has the name of the first.
    cross = Link(first_name, np.zeros((6, 6)), joint.place)
    first = replace(joint, name=first_name, child=cross.name, X=first_screw)
    second = replace(joint, name=second_name, parent=cross.name, B=np.eye(4), X=second_screw)
    return [cross], [first, second]


# By the words of `joint_type`, what makes joints of them, and links between these.
REPLACEMENTS: Mapping[str, Callable[[Joint], tuple[list[Link], list[Joint]]]] = {
    "SPHERICAL": _make_ball,
    "FIXED": _make_weld,
    "CARDAN": partial(_make_universal, axes="XY"),
    **{f"UJOINT_{a}{b}": partial(_make_universal, axes=a + b) for a, b in permutations(TURN_SCREWS, 2)},
}


# Loops.
def close_loops(stated: LoopFile, mechanism: Mechanism, joints: Sequence[Joint]) -> Mechanism:
    """Return the mechanism with the loops of a file closed.

    `joints` are those of the URDF: a frame may have the name of the joint that carries it.
    """
    content = stated.content
    if not stated.states_pairs:
        return robot_sections.read_loops(content, mechanism)
    pairs, types = (content.get(key).items(least=1) for key in PAIR_KEYS[:2])
    _check_lengths(content, PAIR_KEYS[:2], len(pairs), len(types))
    children = {joint.name: joint.child for joint in joints}
    loops = []
    for pair, loop_type in zip(pairs, types, strict=True):
        frames = [_find_link(frame, mechanism, children) for frame in pair.items()]
        if len(frames) != 2:
            raise pair.error("two names of links")
        if loop_type.text().lower() not in CUT_JOINTS:
            raise loop_type.error("3d, origins meet, or 6d, frames coincide")
        with locate_errors(f"{pair.place}: {pair.what}"):
            a, b = frames
            loops.append(loop_arguments.build_loop(mechanism, a, b, CUT_JOINTS[loop_type.value.lower()]))
    parameters = robot_sections.read_closure(content, _read_motors(content.get("name_mot"), mechanism))
    # The generator of these files knows no passive coordinates: what motors leave loose is passive unless it is stated.
    parameters = replace(parameters, finds_passive=parameters.passive is None)
    try:
        closed = loop_arguments.with_loops(replace(mechanism, loops=tuple(loops)), parameters)
    except JounceError as error:
        keys = f"keys of {content.path.name}: {join_names(['name_mot', *CLOSURE_KEYS])}"
        raise JounceError(f"{content.get(PAIR_KEYS[0]).place}: {error} ({keys})") from None
    if parameters.start is None:
        _warn_of_open_zero(closed, content.path)
    return closed


def _warn_of_open_zero(closed: Mechanism, path: Path) -> None:
    """Warn where loops close far from the zero of all joints.

    Then nothing says which of several branches is meant.
    """
    closure = closed.closure
    assert closure is not None
    farthest = int(np.abs(closure.start).argmax())
    position = float(closure.start[farthest])
    if abs(position) > MAX_ZERO_CORRECTION:
        name = quote_value(closure.coordinates[farthest])
        warn(
            f"{path}: loops are open where all joints are at 0, and were closed with {name} at {position:.3g}; if"
            " another branch is meant, state 'start' there, positions of joints near it"
        )


def _find_link(frame: Entry, mechanism: Mechanism, children: Mapping[str, str]) -> str:
    """Return the link of a frame: a link itself, or the child of a joint."""
    name = frame.text()
    is_link, child = name in mechanism.frame_names, children.get(name, name)
    if is_link and child != name:
        came = f"{quote_value(name)} is a link, and a joint that carries {quote_value(child)}"
        raise JounceError(f"{frame.place}: {came}; rename one of them")
    if child not in mechanism.frame_names:
        raise JounceError(f"{frame.place}: {unknown_name_error('link', name, mechanism.frame_names)}")
    return child


def _read_motors(stated_motors: Entry, mechanism: Mechanism) -> list[str]:
    """Return the joints with motors.

    They are named, or all those whose names contain one text.
    """
    # Only joints of one screw have motors.
    joints = [mechanism.joints[columns[0]] for columns in mechanism.columns if len(columns) == 1]
    names = [name for name in mechanism.coordinates if name in joints]
    if isinstance(stated_motors.value, str):
        return _names_with(stated_motors, names)
    motors = [name.text() for name in stated_motors.items(least=1)]
    for name in motors:
        if name not in names:
            raise JounceError(f"{stated_motors.place}: name_mot: {unknown_name_error('joint', name, names)}")
    return motors
