"""Bags of ROS: trajectories and samples come out as they went in; what is not there is said with what is."""

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

import jounce
from support.refusals import refusal

STORE = get_typestore(Stores.ROS2_HUMBLE)
PLANAR = jounce.load("planar2r")
T = np.arange(60) * 0.01
Q = np.stack([np.cos(3 * T), np.sin(2 * T)], axis=1)  # of joint2, joint1
NAMES = ["joint2", "joint1"]


def bag_message(kind, **fields):
    return STORE.types[kind](**fields)


def header(seconds):
    total = round(seconds * 1e9)
    stamp = bag_message("builtin_interfaces/msg/Time", sec=total // 10**9, nanosec=total % 10**9)
    return bag_message("std_msgs/msg/Header", stamp=stamp, frame_id="")


def joint_states(names=NAMES):
    none = np.zeros(0)
    kind = "sensor_msgs/msg/JointState"
    return [
        bag_message(kind, header=header(1.7e9 + t), name=names, position=q, velocity=none, effort=10 * q)
        for t, q in zip(T, Q, strict=True)
    ]


def trajectory():
    points = [
        bag_message(
            "trajectory_msgs/msg/JointTrajectoryPoint", positions=Q[i], velocities=Q[i] * 0, accelerations=np.zeros(0),
            effort=np.zeros(0), time_from_start=bag_message("builtin_interfaces/msg/Duration", sec=i // 20, nanosec=0),
        )
        for i in (0, 20, 40)
    ]  # fmt: skip
    return [bag_message("trajectory_msgs/msg/JointTrajectory", header=header(0), joint_names=NAMES, points=points)]


@pytest.fixture(params=[StoragePlugin.SQLITE3, StoragePlugin.MCAP])
def bag(request, tmp_path):
    """A way to write a bag of topics and their messages."""

    def write(**topics):
        path = tmp_path / "bag"
        with Writer(path, version=9, storage_plugin=request.param) as writer:
            for topic, messages in topics.items():
                kind = messages[0].__msgtype__
                connection = writer.add_connection(f"/{topic}", kind, typestore=STORE)
                for i, given in enumerate(messages):
                    writer.write(connection, i, STORE.serialize_cdr(given, kind))
        return path

    return write


def test_samples_of_joint_states(bag):
    path = bag(joint_states=joint_states())
    for file in path.glob("*.mcap"):
        path = file  # which needs no folder
    motion = jounce.load_motion(path, PLANAR)
    np.testing.assert_allclose(motion.times, T, atol=1e-6)
    np.testing.assert_array_equal(motion.samples[1], Q[:, ::-1])
    np.testing.assert_array_equal(motion.torques[1], 10 * Q[:, ::-1])


def test_a_trajectory_and_a_choice_of_topics(bag):
    path = bag(joint_states=joint_states(), plan=trajectory())
    motion = jounce.load_motion(path, PLANAR, topic="/plan")
    np.testing.assert_allclose(motion([0.0, 1.0, 2.0], 0)[0], Q[[0, 20, 40]][:, ::-1], atol=1e-12)
    assert "cubic" in motion.source
    refusal(lambda: jounce.load_motion(path, PLANAR), "/joint_states, /plan; select one with topic=")
    refusal(lambda: jounce.load_motion(path, PLANAR, topic="/pln"), "unknown topic '/pln'; did you mean '/plan'?")


def test_refuses_messages_that_name_a_joint_twice(bag):
    path = bag(joint_states=joint_states(["joint1", "joint1"]))
    refusal(lambda: jounce.load_motion(path, PLANAR), "'joint1' occurs 2 times")


def test_refuses_joints_of_others_and_damaged_bags(bag, tmp_path):
    path = bag(joint_states=joint_states(["joint2", "jont1"]))
    refusal(lambda: jounce.load_motion(path, PLANAR), "missing 'joint1'; unknown 'jont1'")
    (tmp_path / "broken.mcap").write_bytes(b"no bag")
    refusal(lambda: jounce.load_motion(tmp_path / "broken.mcap", PLANAR), "broken.mcap: not a bag of ROS")
    refusal(lambda: jounce.load_motion(tmp_path / "none.mcap", PLANAR), "no such file")
