"""A robot with joints of several screws: a leg on a ball, and a loose box on a cart that moves in a plane.

Shares with jounce: the chain rule, by which `Swinging` has the rates of its quaternion.
"""

from dataclasses import dataclass

import numpy as np

import jounce
from jounce.model import positions, screws
from jounce.motion.time_law import chain_rule
from jounce.spatial import groups
from jounce.spatial.lie import pose

JOINTS = {  # the bodies that they move: the joint, the kind, the body that carries it, and where
    "shin": ("knee", "y", -1, (0.0, 0.0, 0.8)),
    "foot": ("ankle", groups.BALL.name, 0, (0.0, 0.0, -0.4)),
    "toe": ("toe", "y", 1, (0.15, 0.0, -0.05)),
    "cart": ("deck", groups.PLANAR.name, -1, (0.5, 0.0, 0.1)),
    "box": ("box", groups.FREE.name, 3, (0.0, 0.1, 0.2)),
}


def leg_and_cart(base: bool = False) -> jounce.Robot:
    """The robot, with limits of its single joints; on a base that floats if asked."""
    B, X, M, names, owners = [], [], [], [], []
    for i, (joint, kind, _, place) in enumerate(JOINTS.values()):
        B.append(pose(np.eye(3), np.array(place)[:, None]))
        M.append(jounce.inertia_matrix(1 + 0.2 * i, (0.05, 0.01, -0.1), np.diag([0.02, 0.021, 0.008])))
        group = groups.GROUPS.get(kind)
        X += [[0, 1, 0, 0, 0, 0]] if group is None else group.X.T.tolist()
        names += [joint] if group is None else [f"{joint}.{velocity}" for velocity in group.velocities]
        owners += [i] * (1 if group is None else len(group.axes))
    mechanism = screws.from_screws(
        B,
        X,
        M,
        [parent for _, _, parent, _ in JOINTS.values()],
        screws.ScrewOptions(
            names=list(JOINTS),
            joint_names=names,
            owners=owners,
            base=jounce.inertia_matrix(5, (0, 0, 0), 0.1 * np.eye(3)) if base else None,
            name="leg_and_cart",
        ),
    )
    robot = jounce.Robot(mechanism)
    return robot.with_limits(lower={"knee": -1.0, "toe": -0.5}, upper={"knee": 2.0, "toe": 0.5})


AXIS = np.array([0.6, 0.0, 0.8])  # of the turn of the ankle


@dataclass(frozen=True)
class Swinging:
    """A curve of the joints: the ankle turns about an axis that stands still, the cart goes straight on, the box rests.

    Every moving joint is an amplitude times 1 - cos t.
    """

    amplitude: float = 0.8
    start: float = 0.0
    stop: float = 2 * np.pi
    columns: int = 17
    highest: None = None

    def rates(self, t: np.ndarray, order: int, left: bool = False) -> list[np.ndarray]:
        """The numbers of q with their rates."""
        angle = [self.amplitude * ((k == 0) - np.cos(t + k * np.pi / 2)) for k in range(order + 1)]
        m = leg_and_cart().mechanism
        joints = {joint.name: joint for joint in positions.multiscrew_joints(m).values()}
        q = np.zeros((order + 1, len(t), self.columns))
        q[0] = positions.rest(m)
        for k, factors in enumerate(chain_rule([rate / 2 for rate in angle], order)):
            cos, sin = (
                sum(x * np.cos(angle[0] / 2 + (i - shift) * np.pi / 2) for i, x in enumerate(factors))
                for shift in (0, 1)
            )
            q[k, :, joints["ankle"].numbers] = np.column_stack([np.outer(sin, AXIS), cos])
            q[k, :, joints["deck"].numbers.start] = angle[k]
            q[k, :, 0] = angle[k] / 2
        return list(q)

    def jumps(self, order: int) -> list[object]:
        """None: it is smooth."""
        return []

    def deviations(self, t: np.ndarray, order: int) -> None:
        """None: it is exact."""


def swinging(amplitude: float = 0.8) -> jounce.Motion:
    """A motion of the robot."""
    return jounce.Motion(
        Swinging(amplitude), positions.names(leg_and_cart().mechanism), "a test", grid=np.linspace(0, 2 * np.pi, 61)
    )
