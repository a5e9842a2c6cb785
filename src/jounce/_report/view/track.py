"""What is shown along a motion: the coordinates, Q, the loads on bodies and the base wrench at many times."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from jounce.dynamics.loop_closure import close_loops
from jounce.dynamics.quantities import DEFAULT_QUANTITY, QUANTITIES
from jounce.engine.along import check_motion, forces_along
from jounce.engine.balance_points import contact_lines, zmp_points
from jounce.engine.engine import Engine
from jounce.engine.motion_states import MotionStates
from jounce.engine.plan import compute

if TYPE_CHECKING:
    from jounce.motion import Motion

MAX_TRACK_STATES = 2000  # of a motion, all held in memory: at 30 pictures per second those of a minute


@dataclass(frozen=True, eq=False)
class Track:
    """A motion at times (N,): q, Q (N, n), the base wrench F (N, 6), what bodies exert, (N, 6) by name, base poses.

    `positions` (N, joints) are q, and where loops are closed the positions of the joints that follow too.
    """

    t: np.ndarray
    q: np.ndarray
    Q: np.ndarray
    F: np.ndarray
    wrenches: Mapping[str, np.ndarray]
    C: np.ndarray  # (N, 4, 4)
    positions: np.ndarray
    contacts: np.ndarray  # (N, contacts, 9, 3), see `contact_lines`
    zmp: np.ndarray  # (N, 3), see `zmp_points`

    def at(self, t: float) -> "Track":
        """The state at a time, every array without its first axis: the nearest of those that are kept."""
        k = int(np.abs(self.t - t).argmin())
        arrays = {name: x[k] for name, x in vars(self).items() if name != "wrenches"}
        return Track(**arrays, wrenches={name: W[k] for name, W in self.wrenches.items()})


def record_track(robot: Engine, motion: "Motion") -> Track:
    """A motion of a robot, which must be of its joints, at its own times or, of many, at evenly spaced ones."""
    t = motion.times
    if len(t) > MAX_TRACK_STATES:
        t = np.linspace(motion.start, motion.stop, MAX_TRACK_STATES)
    along = forces_along(robot, motion, t, 0)
    path = check_motion(robot.mechanism, motion)  # in the order of the robot's joints
    states = MotionStates.sample(robot, path, t, [(QUANTITIES["base_wrench"], 0)])
    whole = states.rates[0] if states.near is None else states.near
    loads, [F] = states.wrench[0] if states.wrench else {}, states.compute(robot, "base_wrench")
    C = np.tile(np.eye(4), (len(t), 1, 1)) if along.base is None else along.base[0]
    drawn = contact_lines(robot, states), zmp_points(robot, states)
    return Track(t, along.rates[0], along.forces[0][:, -robot.n :], F, loads, C, whole, *drawn)


def rest_state(robot: Engine, q: np.ndarray, C: np.ndarray, near: np.ndarray | None = None) -> Track:
    """The state of a robot that rests at q, its base at C, without loads; loops are closed from positions nearby."""
    whole = close_loops(robot.mechanism, q[None], near)[0] if robot.mechanism.is_closed else q
    rest, base = np.zeros(robot.n), (C, np.zeros(6), np.zeros(6))
    Q, F = (compute(robot, name, (whole, rest, rest), base=base) for name in (DEFAULT_QUANTITY.name, "base_wrench"))
    states = MotionStates((q, rest, rest), None, base, None)
    drawn = contact_lines(robot, states), zmp_points(robot, states)
    return Track(np.zeros(()), q, Q[-robot.n :], F, {}, C, whole, *drawn)
