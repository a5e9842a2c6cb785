"""One body in skidy's format: its joint screw, pose and inertia, each in one of several forms."""

import math
from collections.abc import Callable
from functools import partial

import numpy as np

from jounce.core.errors import JounceError, no_such
from jounce.io.entries import Entry
from jounce.io.native.parts import along
from jounce.io.orientation import from_rpy
from jounce.io.skidy import expressions
from jounce.model.screws import exact_inertia, exact_pose, exact_screw
from jounce.spatial import lie
from jounce.spatial.inertia import inertia_matrix, symmetric

Number = Callable[[Entry], float]  # what an entry says, be it an expression
MOMENTS = ("Ixx", "Ixy", "Ixz", "Iyy", "Iyz", "Izz")
TYPES = {"revolute": ("vec",), "prismatic": ()}  # of joints, and the keys besides the axis
IDENTITY = np.eye(3).tolist()


def assigned(robot: Entry) -> Number:
    """Return a reader of numbers and of expressions in the symbols to which the file assigns numbers."""
    values = {name: number.number() for name, number in robot.get("assignments", {}).members().items()}
    return partial(_number, values)


def _number(values: dict[str, float], entry: Entry) -> float:
    if not isinstance(entry.value, str):
        return entry.number()
    try:
        return expressions.value(entry.value, values)
    except JounceError as error:
        raise entry.error(str(error)) from None


def screw(entry: Entry, number: Number) -> np.ndarray:
    """Six numbers (xi; eta), or type, axis and a point `vec` of it; of unit length."""
    if isinstance(entry.value, list):
        X = entry.numbers((6,), read=number)
    else:
        kind = entry.keys(("type", "axis"), ("vec",)).get("type")
        if kind.text() not in TYPES:
            raise JounceError(f"{kind.place}: {entry.what}: {no_such('joint type', kind.value, TYPES)}")
        entry.keys(("type", "axis"), TYPES[kind.value])
        axis, point = (entry.get(key, [0, 0, 0]).numbers((3,), read=number) for key in ("axis", "vec"))
        X = along(kind.value, axis, point, 0.0)
    with entry.refusals():
        return exact_screw(X, entry.what)


def pose(entry: Entry, number: Number) -> np.ndarray:
    """A 4x4 matrix, xyzrpy, or translation and rotation."""
    if isinstance(entry.value, list):
        T = entry.numbers((4, 4), read=number)
    elif entry.keys((), ("xyzrpy", "translation", "rotation")).alone("xyzrpy", ("translation", "rotation")):
        six = entry.get("xyzrpy").numbers((6,), read=number)
        T = lie.pose(from_rpy(six[3:], entry.place), six[:3, None])
    else:
        r = entry.get("translation", [0, 0, 0]).numbers((3,), read=number)
        T = lie.pose(rotation(entry.get("rotation", IDENTITY), number), r[:, None])
    with entry.refusals():
        return exact_pose(T, entry.what)


def rotation(entry: Entry, number: Number) -> np.ndarray:
    """Three rows, a quaternion Q (w, x, y, z), rpy, or axis and angle."""
    if isinstance(entry.value, list):
        return entry.numbers((3, 3), read=number)
    entry.keys((), ("Q", "rpy", "axis", "angle"))
    if entry.alone("Q", ("rpy", "axis", "angle")):
        return lie.from_quaternion(entry.get("Q").numbers((4,), read=number))  # no rotation, unless of unit length
    if entry.alone("rpy", ("axis", "angle")):
        return from_rpy(entry.get("rpy").numbers((3,), read=number), entry.place)
    hat = lie.hat(entry.need("axis").numbers((3,), read=number))
    angle = number(entry.get("angle", 0))
    return np.eye(3) + math.sin(angle) * hat + (1 - math.cos(angle)) * hat @ hat


def inertia(entry: Entry, number: Number, com_before: bool) -> np.ndarray:
    """The 6x6 matrix, or mass, com and inertia in a frame; `com_before`: a body above says ``frame: com``."""
    if isinstance(entry.value, list):
        M = entry.numbers((6, 6), read=number)
    else:
        entry.keys(("mass", "inertia", "com"), ("frame", "rotation"))
        if com_before and "frame" not in entry.value:
            raise JounceError(
                f"{entry.place}: {entry.what} has no 'frame'; skidy would use that of the last body that has one"
            )
        frame, mass = entry.get("frame", "body"), number(entry.get("mass"))
        com, theta = entry.get("com").numbers((3,), read=number), _moments(entry.get("inertia"), number)
        if frame.value == "com":
            R = rotation(entry.get("rotation", IDENTITY), number)
            with entry.refusals():
                M = inertia_matrix(mass, com, theta, rotation=R)
        elif frame.value == "body":
            if "rotation" in entry.value:
                raise JounceError(f"{entry.place}: {entry.what} has a 'rotation', which requires frame: com")
            h = lie.hat(com) * mass
            M = np.block([[theta, h], [-h, mass * np.eye(3)]])
        else:
            raise frame.error("body or com")
    with entry.refusals():
        return exact_inertia(M, entry.what)


def _moments(entry: Entry, number: Number) -> np.ndarray:
    """Three rows, six numbers, some of the six by name, or one number for each axis alike."""
    if isinstance(entry.value, list):
        theta = entry.numbers((6,), (3, 3), read=number)
        return theta if theta.ndim == 2 else symmetric(theta)
    if isinstance(entry.value, dict):
        entry.keys((), MOMENTS)
        return symmetric(np.array([number(entry.get(key, 0)) for key in MOMENTS]))
    return number(entry) * np.eye(3)
