"""Trajectories of ROS in YAML and JSON files, for a robot: joints are matched by name."""

from jounce.io.entries import Entry
from jounce.model.mechanism import Mechanism
from jounce.motion.matching import matched
from jounce.motion.motion import Motion
from jounce.motion.ros import trajectories_in


def is_trajectory(entry: Entry) -> bool:
    """Whether a file holds a JointTrajectory, alone or in a plan."""
    return next(trajectories_in(entry.value), None) is not None


def read(entry: Entry, mechanism: Mechanism) -> Motion:
    """The motion of a file that holds a JointTrajectory."""
    with entry.refusals():
        return matched(Motion.from_joint_trajectory(entry.value), mechanism)
