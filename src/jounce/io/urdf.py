"""URDF: what dynamics needs of it, read with lxml; visuals, collisions, meshes and transmissions are never opened."""

from pathlib import Path

import numpy as np
from lxml import etree

from jounce import linkage
from jounce.drives import drive_error
from jounce.errors import JounceError, no_such, one_line
from jounce.inertia import inertia_matrix, symmetric
from jounce.io.files import finite, read_bytes
from jounce.io.orientation import direction, from_rpy
from jounce.lie import pose
from jounce.mechanism import UNLIMITED, Mechanism, limit_error

MOVING = {"revolute": 0, "continuous": 0, "prismatic": 3}  # where in the screw the axis goes
FREE = ("floating", "planar")


def read(path: Path, gravity: object, base: str | None = None, root: str | None = None) -> Mechanism:
    """The mechanism of a URDF file: fixed joints merged, mimic joints folded, joints in its order depth first."""
    robot = _parsed(path)
    links = [_link(element, path) for element in robot.iterchildren("link")]
    joints = [_joint(element, path) for element in robot.iterchildren("joint")]
    name = robot.get("name") or path.stem
    return linkage.mechanism(links, joints, gravity, name, str(path), base=base, root=root)


def _parsed(path: Path) -> etree._Element:
    # entities stay unresolved and nothing is fetched: a robot file is data, never a program
    parser = etree.XMLParser(resolve_entities=False, no_network=True, load_dtd=False, remove_comments=True)
    try:
        root = etree.fromstring(read_bytes(path), parser)
    except etree.XMLSyntaxError as error:
        raise JounceError(f"{path}:{error.lineno}: not XML: {one_line(error.msg) or 'the file is empty'}") from None
    if root.tag != "robot":
        raise JounceError(f"{path}: the root element is <{root.tag}>; a URDF has <robot>")
    for element in root.iter(etree.Element, etree.Entity):
        if element.tag is etree.Entity:
            raise JounceError(f"{_at(element, path)}: {element.text} is an entity, never resolved; write its content")
        if element.prefix == "xacro":
            raise JounceError(f"{_at(element, path)}: xacro macros are not expanded; run xacro first, load its output")
    return root


def _link(element: etree._Element, path: Path) -> linkage.Link:
    name, inertial = _text(element, "name", path), element.find("inertial")
    if inertial is None:
        return linkage.Link(name, np.zeros((6, 6)), _at(element, path))
    mass = _numbers(_child(inertial, "mass", path), "value", 1, path)[0]
    tensor = _child(inertial, "inertia", path)
    six = [_numbers(tensor, "i" + axes, 1, path)[0] for axes in ("xx", "xy", "xz", "yy", "yz", "zz")]
    C = _origin(inertial, path)
    theta = symmetric(np.array(six))
    return linkage.Link(name, inertia_matrix(mass, C[:3, 3], theta, rotation=C[:3, :3]), _at(element, path))


def _joint(element: etree._Element, path: Path) -> linkage.Joint:
    name, kind = _text(element, "name", path), _text(element, "type", path)
    kinds = ["fixed", *MOVING, *FREE]
    if kind not in kinds:
        raise JounceError(f"{_at(element, path)}: joint {name!r}: {no_such('joint type', kind, kinds)}")
    return linkage.Joint(
        name=name,
        parent=_text(_child(element, "parent", path), "link", path),
        child=_text(_child(element, "child", path), "link", path),
        B=_origin(element, path),
        X=_screw(element, kind, path) if kind in MOVING else None,
        mimic=_mimic(element, path) if kind in MOVING else None,
        limits=_limits(element, kind, path) if kind in MOVING else {},
        drive=_drive(element, path) if kind in MOVING else {},
        place=_at(element, path),
        free=kind if kind in FREE else None,
    )


def _screw(element: etree._Element, kind: str, path: Path) -> np.ndarray:
    axis = direction(_numbers(_child(element, "axis", path), "xyz", 3, path))
    if axis is None:
        raise JounceError(f"{_at(element, path)}: joint {element.get('name')!r} has a zero axis; expected a direction")
    X = np.zeros(6)
    X[MOVING[kind] : MOVING[kind] + 3] = axis
    return X


def _mimic(element: etree._Element, path: Path) -> linkage.Mimic | None:
    mimic = element.find("mimic")
    if mimic is None:
        return None
    multiplier = _numbers(mimic, "multiplier", 1, path, default="1")[0]
    offset = _numbers(mimic, "offset", 1, path, default="0")[0]
    return linkage.Mimic(_text(mimic, "joint", path), multiplier, offset)


def _limits(element: etree._Element, kind: str, path: Path) -> dict[str, float]:
    """What a <limit> states; where it leaves positions out they are 0 by the format, unless the joint turns freely."""
    limit = element.find("limit")
    if limit is None:
        return {}
    keys = [*(("lower", "upper") if kind != "continuous" else ()), *({"velocity", "effort"} & set(limit.attrib))]
    stated = {key: float(_numbers(limit, key, 1, path, default="0")[0]) for key in keys}
    error = limit_error(**UNLIMITED | stated)
    if error:
        raise JounceError(f"{_at(limit, path)}: joint {element.get('name')!r}: {error}")
    return stated


def _drive(element: etree._Element, path: Path) -> dict[str, float]:
    """What a <dynamics> states."""
    dynamics = element.find("dynamics")
    if dynamics is None:
        return {}
    stated = {key: float(_numbers(dynamics, key, 1, path, default="0")[0]) for key in ("damping", "friction")}
    error = drive_error(**stated)
    if error:
        raise JounceError(f"{_at(dynamics, path)}: joint {element.get('name')!r}: {error}")
    return stated


def _origin(element: etree._Element, path: Path) -> np.ndarray:
    """The pose of an <origin>: the identity where there is none."""
    origin = element.find("origin")
    if origin is None:
        return np.eye(4)
    R = from_rpy(_numbers(origin, "rpy", 3, path, default="0 0 0"))
    return pose(R, _numbers(origin, "xyz", 3, path, default="0 0 0")[:, None])


def _child(element: etree._Element, tag: str, path: Path) -> etree._Element:
    child = element.find(tag)
    if child is None:
        name = element.get("name")
        raise JounceError(f"{_at(element, path)}: <{element.tag}>{f' {name!r}' if name else ''} has no <{tag}>")
    return child


def _text(element: etree._Element, attribute: str, path: Path) -> str:
    text = element.get(attribute)
    if not text:
        raise JounceError(f"{_at(element, path)}: <{element.tag}> has no {attribute}=; expected a text")
    return text


def _numbers(element: etree._Element, attribute: str, count: int, path: Path, default: str | None = None) -> np.ndarray:
    text = element.get(attribute, default)
    if text is None:
        raise JounceError(f"{_at(element, path)}: <{element.tag}> has no {attribute}=; expected {count} numbers")
    numbers = [number for number in map(finite, text.split()) if number is not None]
    if not len(numbers) == len(text.split()) == count:
        came = f"<{element.tag} {attribute}={text!r}>"
        raise JounceError(f"{_at(element, path)}: {came}; expected {count} finite number{'s' * (count > 1)}")
    return np.array(numbers)


def _at(element: etree._Element, path: Path) -> str:
    return f"{path}:{element.sourceline}"
