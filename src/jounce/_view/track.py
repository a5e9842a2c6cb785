"""What is shown along a motion: the coordinates, Q, the loads on bodies and the base wrench at many times."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from jounce.robot import Robot

if TYPE_CHECKING:
    from jounce.motion import Motion

STATES = 2000  # of a motion, at most


@dataclass(frozen=True, eq=False)
class Track:
    """A motion at times (N,): q, Q (N, n), the base wrench F (N, 6), what bodies exert, (N, 6) by name, base poses."""

    t: np.ndarray
    q: np.ndarray
    Q: np.ndarray
    F: np.ndarray
    wrenches: Mapping[str, np.ndarray]
    C: np.ndarray  # (N, 4, 4)

    def at(self, t: float) -> "Track":
        """The state at a time, every array without its first axis: the nearest of those that are kept."""
        k = int(np.abs(self.t - t).argmin())
        wrenches = {name: W[k] for name, W in self.wrenches.items()}
        return Track(self.t[k], self.q[k], self.Q[k], self.F[k], wrenches, self.C[k])


def track(robot: Robot, motion: "Motion") -> Track:
    """A motion of a robot, at its own times or, of many, at evenly spaced ones.

    Raises
    ------
    JounceError : where the motion is of other joints.
    """
    t = motion.times
    if len(t) > STATES:
        t = np.linspace(motion.start, motion.stop, STATES)
    along = robot.forces_along(motion, t, order=0)
    W = motion.wrench(t, 0)
    loads = {} if W is None else W[0]
    F = robot.base_wrench(*along.rates[:3], wrench=loads or None, base=along.base)
    C = np.tile(np.eye(4), (len(t), 1, 1)) if along.base is None else along.base[0]
    return Track(t, along.rates[0], along.forces[0][:, -robot.n :], np.asarray(F), loads, C)


def at_rest(robot: Robot, q: np.ndarray, C: np.ndarray) -> Track:
    """The state of a robot that rests at q, its base at C, without loads."""
    rest, base = np.zeros(robot.n), (C, np.zeros(6), np.zeros(6))
    Q, F = (np.asarray(f(q, rest, rest, base=base)) for f in (robot.inverse_dynamics, robot.base_wrench))
    return Track(np.zeros(()), q, Q[-robot.n :], F, {}, C)
