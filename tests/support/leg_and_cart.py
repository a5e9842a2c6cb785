"""A robot with joints of several screws: a leg on a ball, and a loose box on a cart that moves in a plane."""

import numpy as np

import jounce
from jounce.model.screws import from_screws
from jounce.spatial.groups import BALL, FREE, GROUPS, PLANAR
from jounce.spatial.lie import pose

JOINTS = {  # the bodies that they move: the joint, the kind, the body that carries it, and where
    "shin": ("knee", "y", -1, (0.0, 0.0, 0.8)),
    "foot": ("ankle", BALL.name, 0, (0.0, 0.0, -0.4)),
    "toe": ("toe", "y", 1, (0.15, 0.0, -0.05)),
    "cart": ("deck", PLANAR.name, -1, (0.5, 0.0, 0.1)),
    "box": ("box", FREE.name, 3, (0.0, 0.1, 0.2)),
}


def leg_and_cart(base: bool = False) -> jounce.Robot:
    """The robot, with limits of its single joints; on a base that floats if asked."""
    B, X, M, names, owners = [], [], [], [], []
    for i, (joint, kind, _, place) in enumerate(JOINTS.values()):
        B.append(pose(np.eye(3), np.array(place)[:, None]))
        M.append(jounce.inertia_matrix(1 + 0.2 * i, (0.05, 0.01, -0.1), np.diag([0.02, 0.021, 0.008])))
        group = GROUPS.get(kind)
        X += [[0, 1, 0, 0, 0, 0]] if group is None else group.X.T.tolist()
        names += [joint] if group is None else [f"{joint}.{velocity}" for velocity in group.velocities]
        owners += [i] * (1 if group is None else len(group.axes))
    mechanism = from_screws(
        B,
        X,
        M,
        [parent for _, _, parent, _ in JOINTS.values()],
        list(JOINTS),
        joint_names=names,
        owners=owners,
        base=jounce.inertia_matrix(5, (0, 0, 0), 0.1 * np.eye(3)) if base else None,
        name="leg_and_cart",
    )
    robot = jounce.Robot(mechanism)
    return robot.with_limits(lower={"knee": -1.0, "toe": -0.5}, upper={"knee": 2.0, "toe": 0.5})
