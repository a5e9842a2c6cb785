"""Robots with closed loops: golden states, motions near their starts, and the same robots cut elsewhere."""

import copy
import json
from pathlib import Path

import numpy as np
from ruamel.yaml import YAML

import jounce
from jounce import Motion
from jounce.io import bundled
from jounce.spatial import lie
from support.robots import GOLDEN

LOOP_ROBOTS = ("fivebar", "delta", "gough_stewart", "fourbar_leg")
FOLDER = Path(bundled.__file__).parent / "robots"


def content(name):
    """What the file of a bundled robot says."""
    return YAML(typ="safe").load((FOLDER / name / "robot.yaml").read_text(encoding="utf-8"))


def loaded(said, folder, **options):
    """The robot of a file with this content."""
    path = folder / "robot.yaml"
    YAML(typ="safe").dump(said, path)
    return jounce.load(path, **options)


def driven_content(said):
    """The same content with a drive train at every joint, each different."""
    for k, body in enumerate(said["bodies"], start=1):
        body["joint"]["drive"] = {"armature": 0.001 * k, "damping": 0.2 * k, "stiffness": 0.3 * k, "rest": 0.1 * k}
        body["joint"]["drive"] |= {"friction": 0.1 * k, "eps": 0.5}
    return said


def golden_loops(name):
    """The coordinates of the tree, those with motors, and of three states all coordinates and forces, with rates."""
    data = json.loads((GOLDEN / "dalembert" / f"{name}.json").read_text())
    states = ([np.array(case[key], dtype=float) for case in data["cases"]] for key in ("coordinates", "forces"))
    return data["coordinates"], data["actuated"], *(np.stack(rates, axis=1) for rates in states)  # (5 or 3, 3, ...)


def motion_near_start(robot, rng, order, size=0.1):
    """q(t) and its rates about the start: waves of a tenth of a radian, or of a hundredth of a meter."""
    closure = robot.mechanism.closure
    own = list(closure.independent)
    A = np.where(robot.mechanism.tree.X[own, :3].any(axis=1), size, size / 10) * rng.uniform(0.5, 1, len(own))
    w, p = rng.uniform(1, 3, len(own)), rng.uniform(-3, 3, len(own))

    def motion(t):
        angle = np.multiply.outer(t, w) + p
        rates = [A * w**k * np.cos(angle + k * np.pi / 2) for k in range(order + 1)]
        return [closure.start[own] + rates[0], *rates[1:]]

    return motion


def at_zero(rates):
    """The state at the first time of rates along a motion."""
    return [x[0] for x in rates]


def fivebar_swing(duration=2.0):
    """Waves of both shoulders of the bundled five-bar, about its start."""
    return Motion.fourier([2.2, 0.94], [[0.05, 0.1]], [[0.1, 0.1]], 3.0, duration)


def fivebar_cut_at_elbow():
    """The five-bar whose left forearm hangs by the pin on the right one, cut at the left elbow."""
    said = content("fivebar")
    bodies = {body["name"]: body for body in said["bodies"]}
    forearm = copy.deepcopy(bodies["left_forearm"])
    reach = said["frames"][0]["pose"]["position"]
    forearm |= {"parent": "right_forearm", "pose": {"position": [0, 0, 0]}}
    forearm["joint"] |= {"name": "pin", "point": reach}
    start = said["start"]
    angles = [start[f"{side}_shoulder"] + start[f"{side}_elbow"] for side in ("left", "right")]
    elbow = {"name": "left_end", "body": "left_upper", "pose": bodies["left_forearm"]["pose"]}
    said["bodies"] = [bodies[name] for name in ("left_upper", "right_upper", "right_forearm")] + [forearm]
    said["frames"] = [elbow, {"name": "forearm_end", "body": "left_forearm"}]
    said["loops"] = [{"frames": ["left_end", "forearm_end"], "joint": "revolute", "axis": [0, 1, 0]}]
    said["start"] = {name: x for name, x in start.items() if name != "left_elbow"} | {"pin": angles[0] - angles[1]}
    return said


def platform_on_leg_four():
    """The Gough-Stewart platform that hangs on leg 4 and is cut from leg 1."""
    said = content("gough_stewart")
    bodies = {body["name"]: body for body in said["bodies"]}
    frames = {frame["name"]: frame for frame in said["frames"]}
    own, other = bodies["platform"]["joint"]["point"], frames["corner4"]["pose"]["position"]
    bodies["ball_x"]["parent"] = "piston4"
    bodies["platform"]["pose"]["position"] = [-x for x in other]
    bodies["platform"]["joint"]["point"] = other
    ball = ("ball_x", "ball_y", "platform")
    said["bodies"] = [body for name, body in bodies.items() if name not in ball] + [bodies[name] for name in ball]
    frames["tip4"] |= {"name": "tip1", "body": "piston1"}
    frames["corner4"] |= {"name": "corner1", "pose": {"position": own}}
    said["loops"] = [{"frames": [f"corner{i}", f"tip{i}"]} for i in (1, 2, 3, 5, 6)]
    a, b = said["start"]["leg4_x"], said["start"]["leg4_y"]
    R = (rotation_about(0, a) @ rotation_about(1, b)).T  # of the level platform, seen from leg 4
    angles = [np.arctan2(-R[1, 2], R[2, 2]), np.arcsin(R[0, 2]), np.arctan2(-R[0, 1], R[0, 0])]
    said["start"] |= dict(zip(("ball_x", "ball_y", "ball_z"), map(float, angles), strict=True))
    return said


def rotation_about(axis, angle):
    """The rotation about one of the axes of the frame."""
    return lie.exp(np.eye(6)[axis], np.array([[angle]]))[:3, :3]
