"""Reads the part of a URDF that dynamics needs, by lxml; a robot file is data.

Collisions and transmissions are never opened. `read` and `parse` give the mechanism: fixed joints merged, mimic joints
folded.

`refuse_declarations` is for all readers of XML: an error if a document type declares anything, before the file itself
is read. Entities and default attributes define content outside the elements that use it. XML readers treat them
differently, so that one file could be two robots.
"""

from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from xml.parsers import expat

import numpy as np
from lxml import etree

from jounce.core.errors import JounceError, locate_errors, one_line, quote_value, shorten, unknown_name_error, warn
from jounce.core.foreign import parse_finite
from jounce.io import files
from jounce.io.orientation import from_rpy, unit_direction
from jounce.model import screws, tree
from jounce.model.equivalent_mechanisms import turn_to
from jounce.model.mechanism import GRAVITY, Mechanism
from jounce.spatial import groups
from jounce.spatial.inertia import inertia_matrix, symmetric_matrix
from jounce.spatial.lie import Ad, pose

AXIS_PLACES = {
    "revolute": 0,
    "continuous": 0,
    "prismatic": 3,
}  # by type of joint, where in the screw (angular; linear) the axis goes
FREE_JOINT_TYPES = ("floating", "planar")
DEFAULT_AXIS = "1 0 0"  # by the format, where a joint states none
LIMIT_ATTRIBUTES = {"velocity", "effort", "acceleration", "jerk"}  # that bound nothing where they are not stated
WORLD = "world"  # the ground, which a parent may name although no link does, as Drake has it
ORIGIN_ATTRIBUTES = ("xyz", "rpy")  # of the pose that an <origin> states


def read(path: Path, gravity: object = None, base: str | None = None, root: str | None = None) -> Mechanism:
    """The mechanism of a URDF file: fixed joints merged, mimic joints folded, joints in its order depth first."""
    return parse(files.read_bytes(path), str(path), path.stem, gravity, base, root)


def parse(content: bytes, file: str, name: str, gravity: object, base: str | None, root: str | None) -> Mechanism:
    """The mechanism of a URDF's text; messages call it `file`, and a robot without a name is called `name`."""
    robot = parse_xml(content, file)
    if root is None:
        with locate_errors(file):  # before minutes of reading
            screws.check_size(sum(element.get("type") in AXIS_PLACES for element in robot.iterchildren("joint")))
    links = [_read_link(element, file) for element in robot.iterchildren("link")]
    joints = [_read_joint(element, file) for element in robot.iterchildren("joint")]
    given, world = GRAVITY if gravity is None else gravity, None
    if WORLD in {joint.parent for joint in joints} - {link.name for link in links}:
        world, links = WORLD, [tree.Link(WORLD, np.zeros((6, 6)), file), *links]
    for limit in robot.iterfind("joint/limit[@deceleration]"):
        if limit.get("deceleration") != limit.get("acceleration"):
            warn(f"{_element_place(limit, file)}: deceleration= is left out; acceleration= alone bounds q2d")
    called = robot.get("name") or name
    built = tree.build_mechanism(links, joints, given, called, file, base=base, root=root, world=world)
    unsaid = [element for element in robot.iterchildren("joint") if element.find("axis") is None]
    without = {f"{joint.get('name')}{'.wz' * (joint.get('type') == 'planar')}" for joint in unsaid}
    return replace(built, default_axes=tuple(joint for joint in built.joints if joint in without))


def parse_xml(content: bytes, file: str) -> etree._Element:
    """The root of a URDF's text; messages call it `file`."""
    # nothing is resolved and nothing is fetched: a robot file is data, never a program
    refuse_declarations(content, file)
    parser = etree.XMLParser(resolve_entities=False, no_network=True, load_dtd=False, remove_comments=True)
    try:
        root = etree.fromstring(content, parser)
    except etree.XMLSyntaxError as error:
        raise JounceError(f"{file}:{error.lineno}: not XML: {one_line(error.msg) or 'the file is empty'}") from None
    if root.tag != "robot":
        raise JounceError(f"{file}: the root element is <{shorten(str(root.tag))}>; a URDF has <robot>")
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
    name, inertial = _require_text(element, "name", file), element.find("inertial")
    if inertial is None:
        return tree.Link(name, np.zeros((6, 6)), _element_place(element, file))
    mass = read_numbers(_require_child(inertial, "mass", file), "value", 1, file)[0]
    tensor = _require_child(inertial, "inertia", file)
    six = [read_numbers(tensor, "i" + axes, 1, file)[0] for axes in ("xx", "xy", "xz", "yy", "yz", "zz")]
    C = origin_pose(inertial, file)
    theta = symmetric_matrix(np.array(six))
    return tree.Link(name, inertia_matrix(mass, C[:3, 3], theta, rotation=C[:3, :3]), _element_place(element, file))


def _read_joint(element: etree._Element, file: str) -> tree.Joint:
    name, kind = _require_text(element, "name", file), _require_text(element, "type", file)
    kinds = ["fixed", *AXIS_PLACES, *FREE_JOINT_TYPES]
    if kind not in kinds:
        raise JounceError(
            f"{_element_place(element, file)}: joint {quote_value(name)}:"
            f" {unknown_name_error('joint type', kind, kinds)}"
        )
    return tree.Joint(
        name=name,
        parent=_require_text(_require_child(element, "parent", file), "link", file),
        child=_require_text(_require_child(element, "child", file), "link", file),
        B=origin_pose(element, file),
        X=_joint_screw(element, kind, file) if kind in (*AXIS_PLACES, "planar") else None,
        mimic=_read_mimic(element, file) if kind in AXIS_PLACES else None,
        limits=_read_limits(element, kind, file) if kind in AXIS_PLACES else {},
        drive=_read_drive(element, file) if kind in AXIS_PLACES else {},
        place=_element_place(element, file),
        free=kind if kind in FREE_JOINT_TYPES else None,
    )


def _joint_screw(element: etree._Element, kind: str, file: str) -> np.ndarray:
    """The screw (6,) of a joint, or those (3, 6) of a planar joint, whose axis is the normal of the plane.

    The axes x and y in which a planar position counts are those of the child, turned the shortest way that takes z to
    the normal. Pinocchio takes z for the normal, whatever a file says.
    """
    axis = _joint_axis(element, file)
    if kind == "planar":
        return (Ad(pose(turn_to(axis), np.zeros((3, 1)))) @ groups.PLANAR.X).T
    return np.insert(np.zeros(3), AXIS_PLACES[kind], axis)


def _joint_axis(element: etree._Element, file: str) -> np.ndarray:
    stated = element.find("axis")
    numbers = np.array(DEFAULT_AXIS.split(), dtype=float) if stated is None else read_numbers(stated, "xyz", 3, file)
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
    """Return the values of a <limit>; missing positions are 0 by the format, except for continuous joints."""
    limit = element.find("limit")
    if limit is None:
        return {}
    keys = [*(("lower", "upper") if kind != "continuous" else ()), *(LIMIT_ATTRIBUTES & set(limit.attrib))]
    return {key: float(read_numbers(limit, key, 1, file, default="0")[0]) for key in keys}


def _read_drive(element: etree._Element, file: str) -> dict[str, float]:
    dynamics = element.find("dynamics")
    if dynamics is None:
        return {}
    return {key: float(read_numbers(dynamics, key, 1, file, default="0")[0]) for key in ("damping", "friction")}


def origin_pose(element: etree._Element, file: str) -> np.ndarray:
    """Return the pose of an <origin>, the identity by default."""
    origin = element.find("origin")
    if origin is None:
        return np.eye(4)
    for key in origin.attrib:  # a quaternion, or a frame that the pose is given in, must not be lost in silence
        if key not in ORIGIN_ATTRIBUTES:
            raise JounceError(
                f"{_element_place(origin, file)}: {unknown_name_error('attribute of <origin>', key, ORIGIN_ATTRIBUTES)}"
            )
    R = from_rpy(read_numbers(origin, "rpy", 3, file, default="0 0 0"), _element_place(origin, file))
    return pose(R, read_numbers(origin, "xyz", 3, file, default="0 0 0")[:, None])


def _require_child(element: etree._Element, tag: str, file: str) -> etree._Element:
    child = element.find(tag)
    if child is None:
        name = element.get("name")
        raise JounceError(
            f"{_element_place(element, file)}: <{element.tag}>{f' {quote_value(name)}' if name else ''} has no <{tag}>"
        )
    return child


def _require_text(element: etree._Element, attribute: str, file: str) -> str:
    text = element.get(attribute)
    if not text:
        raise JounceError(f"{_element_place(element, file)}: <{element.tag}> has no {attribute}=; expected a text")
    return text


def read_numbers(
    element: etree._Element, attribute: str, count: int, file: str, default: str | None = None
) -> np.ndarray:
    """The finite numbers of an attribute, as many as are expected."""
    text, expected = element.get(attribute, default), f"expected {count} finite number{'s' * (count > 1)}"
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
    """Raise `JounceError` if the document type of an XML file has declarations, in this or another file.

    A file that is not XML is left to the actual reader; ``<!DOCTYPE robot>`` without declarations is accepted.
    """
    parser = expat.ParserCreate()

    def begins(name: str, system: str | None, public: str | None, internal: int) -> None:
        if system or public or internal:
            what = "the document type has declarations; entities and default attributes are never resolved"
            raise JounceError(f"{file}:{parser.CurrentLineNumber}: {what}; write their content instead")

    def reached(*_: object) -> None:
        raise _RootReachedError

    parser.StartDoctypeDeclHandler, parser.StartElementHandler = begins, reached
    with suppress(_RootReachedError, expat.ExpatError, LookupError, ValueError):
        parser.Parse(content, True)
