"""The robots that are measured, written as URDF files that all libraries read.

The xarm7 and the g1 are those of example-robot-data, the chain of 40 joints is drawn. All are written anew, for three
reasons: libraries differ in what they do with meshes, joint limits and links without mass; fixed links are merged, so
that each library has as many bodies as joints; and each body frame lies in its joint, as URDF wants it.
"""

from collections.abc import Iterator
from importlib import metadata
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

import jounce
from benchmarks.rivals.arms import Arm
from benchmarks.robots import chain
from jounce.spatial.lie import hat

FILES = {"xarm7": "xarm7.urdf", "g1": "g1_29dof_rev_1_0.urdf"}  # of example-robot-data
TIPS = {"xarm7": "link7", "g1": "left_wrist_yaw_link", "chain": "body40"}  # the links whose Jacobians are computed
FIRST_ROBOTS = ("xarm7", "g1")  # of which the first result is timed: the chain differs from them by less than they do
TITLES = {"xarm7": "7 joints (xarm7)", "g1": "29 joints (g1)", "chain": "40 joints (a chain)"}


def write_arms(folder: Path) -> Iterator[Arm]:
    """Write the robots and yield each."""
    for name in TITLES:
        yield write_urdf(_load(name), folder / f"{name}.urdf", TIPS[name])


def _load(name: str) -> jounce.Robot:
    """Load a robot of example-robot-data, or draw the chain."""
    if name == "chain":
        return chain(40)
    files = metadata.files("example-robot-data") or []
    return jounce.load(str(next(file.locate() for file in files if file.name == FILES[name])))


def write_urdf(robot: jounce.Robot, path: Path, tip: str) -> Arm:
    """Write a robot of revolute joints, whose axes meet the origins of their bodies, as a URDF file."""
    m = robot.mechanism
    root = ElementTree.Element("robot", name=path.stem)
    # Two libraries want an inertia of the ground, which no result depends on.
    _add_link(root, "ground", np.eye(6))
    links = robot.body_names
    for i, parent in enumerate(m.parent):
        _add_link(root, links[i], m.M[i])
        joint = ElementTree.SubElement(root, "joint", name=robot.joint_names[i], type="revolute")
        ElementTree.SubElement(joint, "parent", link="ground" if parent < 0 else links[parent])
        ElementTree.SubElement(joint, "child", link=links[i])
        ElementTree.SubElement(joint, "origin", xyz=_text(m.B[i, :3, 3]), rpy=_text(_angles(m.B[i, :3, :3])))
        ElementTree.SubElement(joint, "axis", xyz=_text(m.X[i, :3]))
        ElementTree.SubElement(joint, "limit", lower="-10", upper="10", effort="1000", velocity="1000")
    ElementTree.ElementTree(root).write(path)
    return Arm(path.stem, str(path), tuple(robot.joint_names), tuple(links), tip)


def _add_link(root: ElementTree.Element, name: str, M: np.ndarray) -> None:
    """Add a link of a spatial inertia M (6, 6) about its origin: its mass, centre of mass and inertia about that."""
    mass = M[5, 5]
    com = np.array([M[2, 4], M[0, 5], M[1, 3]]) / mass
    inertia = M[:3, :3] + mass * hat(com) @ hat(com)
    inertial = ElementTree.SubElement(ElementTree.SubElement(root, "link", name=name), "inertial")
    ElementTree.SubElement(inertial, "origin", xyz=_text(com), rpy="0 0 0")
    ElementTree.SubElement(inertial, "mass", value=repr(float(mass)))
    entries = {f"i{'xyz'[r]}{'xyz'[c]}": repr(float(inertia[r, c])) for r in range(3) for c in range(r, 3)}
    ElementTree.SubElement(inertial, "inertia", entries)


def _angles(R: np.ndarray) -> np.ndarray:
    """Return roll, pitch and yaw."""
    return Rotation.from_matrix(R).as_euler("xyz")


def _text(x: np.ndarray) -> str:
    return " ".join(repr(float(value)) for value in x)
