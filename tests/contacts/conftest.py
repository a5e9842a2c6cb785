"""Robots on contacts, and motions of a humanoid that leave its feet where they are."""

import numpy as np
import pytest

import jounce

FEET = ["left_ankle_roll_link", "right_ankle_roll_link"]
SOLE = {"place": (0.035, 0, -0.037), "sole": (0.09, 0.03)}
MOVING = ("hip", "knee", "ankle", "waist_roll", "left_shoulder_pitch")  # joints of the humanoid; others are locked
PAWS = [f"{leg}_FOOT" for leg in ("FL", "FR", "HL", "HR")]
BENT = {
    "hip_pitch": (-0.2, -0.5),
    "knee": (0.4, 1.0),
    "ankle_pitch": (-0.2, -0.5),
}  # of a squat: at rest, and by how much


@pytest.fixture(scope="session")
def humanoid():
    """With 14 of its 29 joints, on ways to its contacts: it takes half the time."""
    joints = jounce.load("g1", base="floating").joint_names
    locked = {name: 0.0 for name in joints if not any(part in name for part in MOVING)}
    return jounce.load("g1", base="floating", lock=locked)


@pytest.fixture(scope="session")
def stands(dog, humanoid):
    """Robots on contacts by name."""
    hand = jounce.Contact("left_rubber_hand", "point", place=(0.1, 0, 0), normal=(0.6, 0, 0.8))
    edge = jounce.Contact(FEET[1], "line", place=(0.1, 0, -0.037))
    soles = [jounce.Contact(foot, "plane", place=SOLE["place"]) for foot in FEET]
    return {
        "quadruped": dog.contacts([jounce.Contact(paw, "point") for paw in PAWS]),
        "uneven": dog.contacts([jounce.Contact(paw, "point", normal=(0, 0.6, 0.8)) for paw in PAWS[1:]]),
        "two feet": humanoid.contacts(soles),
        "one foot": humanoid.contacts(soles[:1]),
        "foot, edge, hand": humanoid.contacts([soles[0], edge, hand]),
    }


def standing_base(robot, rates, foot):
    """C, V, Vd, ... of a base of which a foot stays at the inertial frame: C = H^-1, V = -V_foot seen from it."""
    still = (np.eye(4), *[np.zeros(6)] * (len(rates) - 1))
    H = robot.poses(rates[0], body=foot, base=still[0], method="recursion")
    V = robot.twists(*rates, body=foot, frame="spatial", base=still, method="recursion")
    return np.linalg.inv(H), *(-x for x in (V if isinstance(V, tuple) else (V,)))


def squat(robot, t, order):
    """q, qd, ... of a squat of both legs at times t, by ``sin(t)^2``."""
    t = np.asarray(t)[..., None]
    bends = [np.sin(t) ** 2, *(2 ** (k - 1) * np.sin(2 * t + (k - 1) * np.pi / 2) for k in range(1, order + 1))]
    q0, by = np.zeros((2, robot.n))
    for side in ("left", "right"):
        for joint, values in BENT.items():
            j = robot.joint_names.index(f"{side}_{joint}_joint")
            q0[j], by[j] = values
    return [q0 * (k == 0) + by * bend for k, bend in enumerate(bends)]
