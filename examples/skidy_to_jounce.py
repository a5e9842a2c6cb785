"""A robot in the description of the generator skidy, YAML or JSON, into a file of jounce's own format.

python examples/skidy_to_jounce.py examples/skidy2r.yaml planar2r.yaml

It is read as skidy 0.0.1 reads it, and like there SymPy evaluates its expressions: convert only files that you trust.
Every symbol needs a number under `assignments`. Loads (WEE, ...) belong to a motion and are left out.
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import sympy
from ruamel.yaml import YAML
from scipy.spatial.transform import Rotation

import jounce
from jounce.model.frame import Frame

IDENTITY = np.eye(3).tolist()
MOMENTS = ("Ixx", "Ixy", "Ixz", "Iyy", "Iyz", "Izz")
PLACES = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])  # of the six in a symmetric matrix

source = Path(sys.argv[1]) if sys.argv[1:] else Path(__file__).parent / "skidy2r.yaml"
target = Path(sys.argv[2] if sys.argv[2:] else "robot.yaml")
said = YAML(typ="safe").load(source)  # JSON is YAML, too


def numbers(given):
    """Numbers, in lists or alone; each may be an expression, such as sqrt(2)/2 or m1*L1**2."""
    return np.array(sympy.sympify(given, locals=said.get("assignments", {})), dtype=float)


def rotation(R):
    """Three rows, a quaternion (w, x, y, z), angles of roll, pitch and yaw, or an axis of unit length and an angle."""
    if isinstance(R, list):
        return numbers(R)
    if "Q" in R:
        return Rotation.from_quat(np.roll(numbers(R["Q"]), -1)).as_matrix()
    if "rpy" in R:
        return Rotation.from_euler("xyz", numbers(R["rpy"])).as_matrix()
    return Rotation.from_rotvec(numbers(R.get("angle", 0)) * numbers(R["axis"])).as_matrix()


def pose(T):
    if isinstance(T, list):
        return numbers(T)
    if "xyzrpy" in T:
        T = {"translation": T["xyzrpy"][:3], "rotation": {"rpy": T["xyzrpy"][3:]}}
    R, r = rotation(T.get("rotation", IDENTITY)), numbers(T.get("translation", [0, 0, 0]))
    return np.block([[R, r[:, None]], [np.zeros(3), 1]])


def screw(X):
    if isinstance(X, list):
        return numbers(X)
    e, x = numbers(X["axis"]), numbers(X.get("vec", [0, 0, 0]))
    return np.append(e, np.cross(x, e)) if X["type"] == "revolute" else np.append(np.zeros(3), e)


def inertia(M, frame):
    if isinstance(M, list):
        return numbers(M)
    theta, mass, com = M["inertia"], numbers(M["mass"]), numbers(M["com"])
    theta = numbers([theta.get(name, 0) for name in MOMENTS] if isinstance(theta, dict) else theta)
    if theta.shape != (3, 3):
        theta = theta[PLACES] if theta.shape == (6,) else theta * np.eye(3)
    if frame == "com":
        return jounce.inertia_matrix(mass, com, theta, rotation=rotation(M.get("rotation", IDENTITY)))
    about_origin = jounce.inertia_matrix(mass, com, np.zeros((3, 3)))
    about_origin[:3, :3] = theta
    return about_origin


frame, inertias = "body", []
for M in said["mass_inertia"]:
    frame = M.get("frame", frame) if isinstance(M, dict) else frame  # else that of the last body which states one
    inertias.append(inertia(M, frame))
poses, screws = [pose(T) for T in said["body_ref_config"]], [screw(X) for X in said["joint_screw_coord"]]
parent = [p - 1 for p in said["parent"]] if said.get("parent") and said.get("support") else None  # else a chain
gravity = numbers(said.get("gravity", said.get("gravity_vector", [0, 0, -9.81])))
build = jounce.Robot.from_screws if said.get("representation") == "body_fixed" else jounce.Robot.from_spatial_screws
robot = build(poses, screws, inertias, parent, gravity=gravity, joint_names=said.get("q"), name=source.stem)

ends = said["ee"]
if isinstance(ends, dict) or (isinstance(ends[0], list) and not isinstance(ends[0][0], list)):
    ends = [ends]  # one pose, not a list of them
bodies = np.atleast_1d(said.get("ee_parent", len(poses))) - 1
names = ["ee"] if len(ends) == 1 else [f"ee{i + 1}" for i in range(len(ends))]
frames = [Frame(name, int(body), pose(T)) for name, body, T in zip(names, bodies, ends, strict=True)]
jounce.save(jounce.Robot(replace(robot.mechanism, frames=tuple(frames))), target)
print(robot, "written to", target)
