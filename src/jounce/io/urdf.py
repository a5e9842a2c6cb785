"""Reads the part of a URDF that dynamics needs, by lxml.

A robot file is data, never a program. Collisions are never opened. `read` and `parse` give the mechanism: fixed joints
merged, mimic joints folded, with what `urdf_control` reads of transmissions and ros2_control.

`refuse_declarations` is for all readers of XML: an error if a document type declares anything, before the file itself
is read. Entities and default attributes define content outside the elements that use it. XML readers treat them
differently, so that one file could be two robots.
"""

from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from xml.parsers import expat

import numpy as np
from lxml import etree

from jounce.core.errors import JounceError, locate_errors, one_line, quote_value, shorten, unknown_name_error, warn
from jounce.core.foreign import parse_finite
from jounce.io import files, loop_files, urdf_control
from jounce.io.loop_files import LoopFile
from jounce.io.orientation import from_rpy, unit_direction
from jounce.model import screws, tree
from jounce.model.equivalent_mechanisms import turn_to
from jounce.model.mechanism import GRAVITY, Mechanism
from jounce.spatial import groups
from jounce.spatial.inertia import inertia_matrix, symmetric_matrix
from jounce.spatial.lie import Ad, pose

# By type of joint, where in the screw (angular; linear) the axis goes.
AXIS_PLACES = {"revolute": 0, "continuous": 0, "prismatic": 3}
FREE_JOINT_TYPES = ("floating", "planar")
DEFAULT_AXIS = "1 0 0"  # by the format, where a joint states none
LIMIT_ATTRIBUTES = {"velocity", "effort", "acceleration", "jerk"}  # they bound nothing where they are not stated
WORLD = "world"  # the ground, which a parent may name although no link does, as Drake has it
ORIGIN_ATTRIBUTES = ("xyz", "rpy")  # of the pose that an <origin> states


@dataclass(frozen=True)
class UrdfParameters:
    """The arguments of `jounce.load` that a URDF takes."""

    gravity: object = None
    base: str | None = None
    root: str | None = None
    transmissions: bool = True
    loops: LoopFile | None = None  # of a file next to it


def read(
    path: Path,
    gravity: object = None,
    base: str | None = None,
    root: str | None = None,
    transmissions: bool = True,
    loops: LoopFile | None = None,
) -> Mechanism:
    """Return the mechanism of a URDF file.

    Fixed joints are merged, mimic joints folded; joints are in its order, depth first.
    """
    parameters = UrdfParameters(gravity, base, root, transmissions, loops)
    return parse(files.read_bytes(path), str(path), path.stem, parameters)


def parse(content: bytes, file: str, name: str, parameters: UrdfParameters) -> Mechanism:
    """Return the mechanism of a URDF's text.

    Messages call it `file`; a robot without a name is called `name`.
    """
    robot, root, loops = parse_xml(content, file), parameters.root, parameters.loops
    # The size is checked before what may be minutes of reading.
    if root is None:
        with locate_errors(file):
            screws.check_size(sum(element.get("type") in AXIS_PLACES for element in robot.iterchildren("joint")))
    links = [_read_link(element, file) for element in robot.iterchildren("link")]
    joints = [_read_joint(element, file) for element in robot.iterchildren("joint")]
    joints = urdf_control.tighten_limits(joints, robot, file)
    stated_joints = joints
    if loops is not None:
        links, joints = loop_files.replace_joints(loops, links, joints)
    # A parent may name the world although no link does: it becomes one.
    world = None
    if WORLD in {joint.parent for joint in joints} - {link.name for link in links}:
        world, links = WORLD, [tree.Link(WORLD, np.zeros((6, 6)), file), *links]
    for limit in robot.iterfind("joint/limit[@deceleration]"):
        if limit.get("deceleration") != limit.get("acceleration"):
            warn(f"{_element_place(limit, file)}: deceleration= is left out; acceleration= alone bounds q2d")
    gravity = GRAVITY if parameters.gravity is None else parameters.gravity
    model = tree.LinkModel(links, joints, robot.get("name") or name, file, world=world)
    built = tree.build_mechanism(model, gravity, parameters.base, root)
    # The mechanism remembers which variables turn about, or slide along, an axis that the file does not state.
    without_axis = set()
    for element in robot.iterchildren("joint"):
        if element.find("axis") is None:
            suffix = ".wz" if element.get("type") == "planar" else ""
            without_axis.add(f"{element.get('name')}{suffix}")
    built = replace(built, default_axes=tuple(joint for joint in built.joints if joint in without_axis))
    if loops is not None:
        built = loop_files.close_loops(loops, built, stated_joints)
    return urdf_control.couple_drives(built, joints, robot, file) if parameters.transmissions else built


def parse_xml(content: bytes, file: str) -> etree._Element:
    """Return the root of a URDF's text; messages call it `file`."""
    # Nothing is resolved and nothing is fetched: a robot file is data, never a program.
    refuse_declarations(content, file)
    parser = etree.XMLParser(resolve_entities=False, no_network=True, load_dtd=False, remove_comments=True)
    try:
        root = etree.fromstring(content, parser)
    except etree.XMLSyntaxError as error:
        raise JounceError(f"{file}:{error.lineno}: not XML: {one_line(error.msg) or 'the file is empty'}") from None
    if root.tag != "robot":
        raise JounceError(f"{file}: the root element is <{shorten(str(root.tag))}>; a URDF has <robot>")
    # Entities that stay in the tree, and macros, would be lost in silence.
    for element in root.iter(etree.Element, etree.Entity):
        if element.tag is etree.Entity:
            came = f"{shorten(element.text or '')} is an entity, which is never resolved"
            raise JounceError(f"{_element_place(element, file)}: {came}; write its content instead")
        if element.prefix == "xacro":
            raise JounceError(
                f"{_element_place(element, file)}: contains xacro macros; name the file *.xacro to expand them"
            )
    return root


def _read_link(element: etree._Element, file: str) -> tree.Link:
    """Return a link with its inertia matrix (6, 6).

    It is zero where the file states none.
    """
    name, inertial = _require_text(element, "name", file), element.find("inertial")
    if inertial is None:
        return tree.Link(name, np.zeros((6, 6)), _element_place(element, file))
    mass = read_numbers(_require_child(inertial, "mass", file), "value", 1, file)[0]
    tensor = _require_child(inertial, "inertia", file)
    six_numbers = [read_numbers(tensor, "i" + axes, 1, file)[0] for axes in ("xx", "xy", "xz", "yy", "yz", "zz")]
    # The inertia is about the COM, in the axes of the <origin>.
    pose_link_from_com = origin_pose(inertial, file)
    theta, com, R = symmetric_matrix(np.array(six_numbers)), pose_link_from_com[:3, 3], pose_link_from_com[:3, :3]
    return tree.Link(name, inertia_matrix(mass, com, theta, rotation=R), _element_place(element, file))


def _read_joint(element: etree._Element, file: str) -> tree.Joint:
    """Return a joint between two links."""
    name, kind = _require_text(element, "name", file), _require_text(element, "type", file)
    kinds = ["fixed", *AXIS_PLACES, *FREE_JOINT_TYPES]
    if kind not in kinds:
        raise JounceError(
            f"{_element_place(element, file)}: joint {quote_value(name)}:"
            f" {unknown_name_error('joint type', kind, kinds)}"
        )
    # Only joints of one screw follow others, and have limits and drives here.
    has_one_screw = kind in AXIS_PLACES
    return tree.Joint(
        name=name,
        parent=_require_text(_require_child(element, "parent", file), "link", file),
        child=_require_text(_require_child(element, "child", file), "link", file),
        B=origin_pose(element, file),
        X=_joint_screw(element, kind, file) if has_one_screw or kind == "planar" else None,
        mimic=_read_mimic(element, file) if has_one_screw else None,
        limits=_read_limits(element, kind, file) if has_one_screw else {},
        drive=_read_drive(element, file) if has_one_screw else {},
        place=_element_place(element, file),
        free=kind if kind in FREE_JOINT_TYPES else None,
    )


def _joint_screw(element: etree._Element, kind: str, file: str) -> np.ndarray:
    """Return the screw (6,) of a joint, (3, 6) if planar.

    The axis of a planar joint is the normal of its plane. The axes x and y in which its position counts are those of
    the child, turned the shortest way that takes z to the normal. Pinocchio takes z for the normal, whatever a file
    says.
    """
    axis = _joint_axis(element, file)
    if kind == "planar":
        return (Ad(pose(turn_to(axis), np.zeros((3, 1)))) @ groups.PLANAR.X).T
    return np.insert(np.zeros(3), AXIS_PLACES[kind], axis)


def _joint_axis(element: etree._Element, file: str) -> np.ndarray:
    """Return the unit axis (3,) of a joint, by default x."""
    axis_element = element.find("axis")
    if axis_element is None:
        numbers = np.array(DEFAULT_AXIS.split(), dtype=float)
    else:
        numbers = read_numbers(axis_element, "xyz", 3, file)
    axis = unit_direction(numbers)
    if axis is None:
        name = quote_value(element.get("name"))
        raise JounceError(f"{_element_place(element, file)}: joint {name} has a zero axis; expected a direction")
    return axis


def _read_mimic(element: etree._Element, file: str) -> tree.Mimic | None:
    mimic = element.find("mimic")
    if mimic is None:
        return None
    multiplier = read_numbers(mimic, "multiplier", 1, file, default="1")[0]
    offset = read_numbers(mimic, "offset", 1, file, default="0")[0]
    return tree.Mimic(_require_text(mimic, "joint", file), multiplier, offset)


def _read_limits(element: etree._Element, kind: str, file: str) -> dict[str, float]:
    """Return the values of a <limit>.

    Missing positions are 0 by the format, except for continuous joints.
    """
    limit = element.find("limit")
    if limit is None:
        return {}
    position_keys = () if kind == "continuous" else ("lower", "upper")
    keys = [*position_keys, *(LIMIT_ATTRIBUTES & set(limit.attrib))]
    return {key: float(read_numbers(limit, key, 1, file, default="0")[0]) for key in keys}


def _read_drive(element: etree._Element, file: str) -> dict[str, float]:
    """Return damping and friction of a <dynamics>, if there is one."""
    dynamics = element.find("dynamics")
    if dynamics is None:
        return {}
    return {key: float(read_numbers(dynamics, key, 1, file, default="0")[0]) for key in ("damping", "friction")}


def origin_pose(element: etree._Element, file: str) -> np.ndarray:
    """Return the pose of an <origin>, the identity by default."""
    origin = element.find("origin")
    if origin is None:
        return np.eye(4)
    # A quaternion, or a frame that the pose is given in, must not be lost in silence.
    for key in origin.attrib:
        if key not in ORIGIN_ATTRIBUTES:
            raise JounceError(
                f"{_element_place(origin, file)}: {unknown_name_error('attribute of <origin>', key, ORIGIN_ATTRIBUTES)}"
            )
    R = from_rpy(read_numbers(origin, "rpy", 3, file, default="0 0 0"), _element_place(origin, file))
    return pose(R, read_numbers(origin, "xyz", 3, file, default="0 0 0")[:, None])


def _require_child(element: etree._Element, tag: str, file: str) -> etree._Element:
    """Return a child of an element, which has to be there."""
    child = element.find(tag)
    if child is None:
        name = element.get("name")
        name_words = f" {quote_value(name)}" if name else ""
        raise JounceError(f"{_element_place(element, file)}: <{element.tag}>{name_words} has no <{tag}>")
    return child


def _require_text(element: etree._Element, attribute: str, file: str) -> str:
    """Return an attribute, which has to be there and not empty."""
    text = element.get(attribute)
    if not text:
        raise JounceError(f"{_element_place(element, file)}: <{element.tag}> has no {attribute}=; expected a text")
    return text


def read_numbers(
    element: etree._Element, attribute: str, count: int, file: str, default: str | None = None
) -> np.ndarray:
    """Return the finite numbers of an attribute, as many as are expected."""
    text = element.get(attribute, default)
    expected = "expected 1 finite number" if count == 1 else f"expected {count} finite numbers"
    if text is None:
        raise JounceError(f"{_element_place(element, file)}: <{element.tag}> has no {attribute}=; {expected}")
    numbers = [number for number in map(parse_finite, text.split()) if number is not None]
    if not len(numbers) == len(text.split()) == count:
        raise JounceError(
            f"{_element_place(element, file)}: <{element.tag} {attribute}={quote_value(text)}>; {expected}"
        )
    return np.array(numbers)


def _element_place(element: etree._Element, file: str) -> str:
    return f"{file}:{element.sourceline}"


class _RootReachedError(Exception):
    """The root element begins: no document type can follow."""


def refuse_declarations(content: bytes, file: object) -> None:
    """Raise `JounceError` if the document type of an XML file has declarations.

    They may be in this or another file. A file that is not XML is left to the actual reader; ``<!DOCTYPE robot>``
    without declarations is accepted.
    """
    parser = expat.ParserCreate()

    def refuse_document_type(name: str, system: str | None, public: str | None, internal: int) -> None:
        if system or public or internal:
            what = "the document type has declarations; entities and default attributes are never resolved"
            raise JounceError(f"{file}:{parser.CurrentLineNumber}: {what}; write their content instead")

    def stop_at_root(*_: object) -> None:
        raise _RootReachedError

    # Parsing ends at the root element: the file itself is never read here.
    parser.StartDoctypeDeclHandler, parser.StartElementHandler = refuse_document_type, stop_at_root
    with suppress(_RootReachedError, expat.ExpatError, LookupError, ValueError):
        parser.Parse(content, True)
