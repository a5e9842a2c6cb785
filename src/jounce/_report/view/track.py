"""What is shown along a motion: the coordinates, Q, the loads on bodies and the base wrench at many times."""

from collections.abc import Mapping, Sequence
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
from jounce.model.positions import position_names
from jounce.motion.channel import Channel

if TYPE_CHECKING:
    from jounce.motion import Motion

MAX_TRACK_STATES = 2000  # of a motion, all held in memory: at 30 pictures per second those of a minute


@dataclass(frozen=True, eq=False)
class ShownState:
    """What is shown at a time t: q, Q (n,), the base wrench F (6,), what bodies exert, (6,) by name, the base's pose.

    `positions` (joints,) are q, and where loops are closed the positions of the joints that follow too.
    """

    t: float
    q: np.ndarray
    Q: np.ndarray
    F: np.ndarray
    wrenches: Mapping[str, np.ndarray]
    C: np.ndarray  # (4, 4)
    positions: np.ndarray
    contacts: np.ndarray  # (contacts, 9, 3), see `contact_lines`
    zmp: np.ndarray  # (3,), see `zmp_points`


@dataclass(frozen=True, eq=False)
class Track:
    """What is shown along a motion: channels at the same times, named as the arrays of a state."""

    q: Channel
    Q: Channel
    F: Channel  # (N, 1, 6)
    wrenches: Channel  # (N, bodies, 6)
    C: Channel  # (N, 1, 4, 4)
    positions: Channel
    contacts: Channel  # (N, contacts, 9, 3)
    zmp: Channel  # (N, 1, 3)

    @property
    def t(self) -> np.ndarray:
        """Times (N,) in s."""
        return self.q.times

    def at(self, t: float) -> ShownState:
        """What is shown at the time that is nearest to one."""
        k = int(np.abs(self.t - t).argmin())
        q, Q, positions, contacts = (x.values[k] for x in (self.q, self.Q, self.positions, self.contacts))
        F, C, zmp = (channel.values[k, 0] for channel in (self.F, self.C, self.zmp))
        wrenches = dict(zip(self.wrenches.names, self.wrenches.values[k], strict=True))
        return ShownState(float(self.t[k]), q, Q, F, wrenches, C, positions, contacts, zmp)


def record_track(robot: Engine, motion: "Motion") -> Track:
    """A motion of a robot, which must be of its joints, at its own times or, of many, at evenly spaced ones."""
    t, m = motion.times, robot.mechanism
    if len(t) > MAX_TRACK_STATES:
        t = np.linspace(motion.start, motion.stop, MAX_TRACK_STATES)
    along = forces_along(robot, motion, t, 0)
    path = check_motion(m, motion)  # in the order of the robot's joints
    states = MotionStates.sample(robot, path, t, [(QUANTITIES["base_wrench"], 0)])
    loads, [F] = states.wrench[0] if states.wrench else {}, states.compute(robot, "base_wrench")
    poses = along.base_motion[0].values if along.base_motion else np.tile(np.eye(4), (len(t), 1, 1, 1))
    of_bodies = np.stack([*loads.values()], axis=1) if loads else np.zeros((len(t), 0, 6))
    whole = states.rates[0] if states.near is None else states.near
    joints = position_names(m.tree) if states.near is not None else along.coordinates[0].names
    frames = [contact.frame for contact in m.contacts]

    def channel(symbol: str, names: Sequence[str], unit: str, values: np.ndarray) -> Channel:
        return Channel(symbol, tuple(names), (unit,) * len(names), t, (values,))

    return Track(
        along.coordinates[0].upto(0),
        along.efforts.columns(range(-robot.n, 0)),
        channel("F", ["base"], "N m and N", F[:, None]),
        channel("W", [*loads], "N m and N", of_bodies),
        channel("C", ["base"], "1 and m", poses),
        channel("q", joints, "", whole),
        channel("contact", frames, "m", contact_lines(robot, states)),
        channel("zmp", ["zmp"], "m", zmp_points(robot, states)[:, None]),
    )


def rest_state(robot: Engine, q: np.ndarray, C: np.ndarray, near: np.ndarray | None = None) -> ShownState:
    """The state of a robot that rests at q, its base at C, without loads; loops are closed from positions nearby."""
    whole = close_loops(robot.mechanism, q[None], near)[0] if robot.mechanism.is_closed else q
    rest, base = np.zeros(robot.n), (C, np.zeros(6), np.zeros(6))
    Q, F = (compute(robot, name, (whole, rest, rest), base=base) for name in (DEFAULT_QUANTITY.name, "base_wrench"))
    states = MotionStates((q, rest, rest), None, base, None)
    drawn = contact_lines(robot, states), zmp_points(robot, states)
    return ShownState(0.0, q, Q[-robot.n :], F, {}, C, whole, *drawn)
