"""ROS 1 and 2 bags: a JointTrajectory, or the samples of JointState messages, from rosbag2, MCAP and .bag files."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from jounce.core.cures import Remedy
from jounce.core.errors import (
    JounceError,
    join_names,
    locate_errors,
    one_line,
    optional_import,
    quote_value,
    unknown_name_error,
)
from jounce.io.files import check_readable
from jounce.io.motions import tabular
from jounce.model.mechanism import Mechanism
from jounce.motion.joint_matching import match_joints
from jounce.motion.motion import Motion
from jounce.motion.ros import read_joint_states
from jounce.motion.spline import Smoothing, Spline, refuse_smoothing
from jounce.motion.table_columns import ColumnOptions

BAG_SUFFIXES = (".mcap", ".bag", ".db3")
JOINT_STATE = "sensor_msgs/msg/JointState"
TRAJECTORIES = ("trajectory_msgs/msg/JointTrajectory", "moveit_msgs/msg/DisplayTrajectory",
                "moveit_msgs/msg/RobotTrajectory")  # fmt: skip


def is_bag(source: Path) -> bool:
    """Return whether a path is a bag: a file of such a type, or a folder written by ROS 2."""
    try:
        return source.suffix.lower() in BAG_SUFFIXES or (source / "metadata.yaml").is_file()
    except OSError:  # a name longer than the file system takes
        return False


def read(
    source: Path, mechanism: Mechanism, highest: int, way: Smoothing | Spline, options: ColumnOptions, topic: str | None
) -> Motion:
    """The motion in a bag: of the given topic, or of the only topic with a motion."""
    if not source.is_dir():
        check_readable(source)
    with _open_bag(source) as bag:
        topics = {c.topic: c.msgtype for c in bag.connections if c.msgtype in (JOINT_STATE, *TRAJECTORIES)}
        if topic is not None and topic not in topics:
            raise JounceError(f"{source}: {unknown_name_error('topic', topic, topics)}")
        if topic is None and len(topics) != 1:
            kinds = f"JointTrajectory or JointState in it: {join_names(topics) or 'none'}"
            raise JounceError(f"{source}: topics of type {kinds}; select one with {Remedy('topic=', '--topic NAME')}")
        chosen = topic if topic is not None else next(iter(topics))
        connections = [c for c in bag.connections if c.topic == chosen]
        messages = [bag.deserialize(raw, c.msgtype) for c, _, raw in bag.messages(connections)]
    place = f"{source}: {chosen}"
    if topics[chosen] == JOINT_STATE:
        if not messages:
            raise JounceError(f"{place} has no messages")
        columns = read_joint_states(messages, lambda i: f"{place}: message {i}")
        return tabular.read_arrays(columns, mechanism, highest, way, options, place)
    reason = "its trajectory points are exact"
    refuse_smoothing(way, place, reason)
    options.refuse(place, reason)
    if len(messages) != 1:
        raise JounceError(f"{place} has {len(messages)} trajectories; expected one")
    with locate_errors(place):
        return match_joints(Motion.from_joint_trajectory(messages[0]), mechanism)


@contextmanager
def _open_bag(source: Path) -> Iterator[Any]:
    with optional_import(f"{source}: bags of ROS need rosbags", "ros"):
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    try:
        with AnyReader([source], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as bag:
            yield bag
    except JounceError:
        raise
    except Exception as error:  # damaged bags make their reader raise errors of any type
        raise JounceError(
            f"{source}: not a bag of ROS: {one_line(error) or quote_value(type(error).__name__)}"
        ) from None
