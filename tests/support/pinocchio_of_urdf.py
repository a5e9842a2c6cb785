"""Pinocchio's own reading of URDF files: the robots of example-robot-data, and states by the names of joints.

Shares with jounce: nothing.
"""

import warnings
from importlib import metadata
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    import pinocchio

FOLDER = "example-robot-data/robots/"
REAL = {
    str(file).partition(FOLDER)[2].replace("_description", "").replace("/urdf/", "/"): Path(str(file.locate()))
    for file in sorted(metadata.files("example-robot-data") or [])
    if str(file).endswith(".urdf")
}


def control_bounds(path, interface, joints):
    """The symmetric bounds that command interfaces of ros2_control state, which Pinocchio does not read."""
    bounds = dict.fromkeys(joints, np.inf)
    for joint in ElementTree.parse(path).getroot().findall("ros2_control/joint"):
        for value in joint.findall(f"command_interface[@name='{interface}']/param[@name='max']"):
            bounds[joint.get("name")] = min(bounds[joint.get("name")], float(value.text))
    return np.array([bounds[joint] for joint in joints])


def configuration(model, theta):
    """Pinocchio's q of joint variables in the order of v: joints without bounds have a cosine and a sine in it."""
    q = pinocchio.neutral(model)
    for joint in list(model.joints)[1:]:
        q_part, v_part = (slice(at, at + n) for at, n in ((joint.idx_q, joint.nq), (joint.idx_v, joint.nv)))
        if joint.nq == joint.nv:
            q[q_part] = theta[v_part]
        elif (joint.nq, joint.nv) == (2, 1):
            q[q_part] = np.cos(theta[joint.idx_v]), np.sin(theta[joint.idx_v])
    return q


def rnea(model, theta, *rates):
    """Pinocchio's forces at joint variables and rates in the order of v."""
    return pinocchio.rnea(model, model.createData(), configuration(model, theta), *rates)


def crba(model, theta):
    """Pinocchio's mass matrix, both halves of it."""
    upper = np.triu(pinocchio.crba(model, model.createData(), configuration(model, theta)))
    return upper + np.triu(upper, 1).T
