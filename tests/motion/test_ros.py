"""Trajectories of ROS: from messages, files, plans; linear, cubic and quintic between points; matched by joint name."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
from ruamel.yaml import YAML

import jounce
from jounce import Motion
from support.refusals import expect_refusal, refusal

ROBOT = jounce.load("planar2r")
RNG = np.random.default_rng(4)
T = [0.0, 0.5, 1.25, 2.0]
Q, QD, Q2D = RNG.normal(size=(3, 4, 2))


def message(rates=3, names=("joint2", "joint1")):
    fields = list(zip(("positions", "velocities", "accelerations")[:rates], (Q, QD, Q2D), strict=False))
    points = [
        {name: rate[i].tolist() for name, rate in fields}
        | {"effort": [], "time_from_start": {"sec": int(t), "nanosec": round(t % 1 * 1e9)}}
        for i, t in enumerate(T)
    ]
    return {"header": {"frame_id": ""}, "joint_names": list(names), "points": points}


def planning_response(given):
    other = {"joint_names": ["world_joint"], "points": [{"transforms": []}]}
    return {"error_code": {"val": 1}, "trajectory": {"joint_trajectory": given, "multi_dof_joint_trajectory": other}}


def write_document(path, given):
    with path.open("w") as file:
        json.dump(given, file) if path.suffix == ".json" else YAML(typ="safe", pure=True).dump(given, file)
    return path


@pytest.mark.parametrize("rates", [1, 2, 3])
def test_points_are_joined_as_ros_does(rates):
    """All that they state holds at them, and degree 2 m - 1 between them leaves nothing else."""
    motion = Motion.from_joint_trajectory(message(rates))
    for side in ("left", "right"):
        inner = slice(1, None) if side == "left" else slice(None, -1)
        for rate, of in zip(motion(T, rates - 1, side), (Q, QD, Q2D)[:rates], strict=True):
            np.testing.assert_allclose(rate[inner], of[inner], atol=1e-12)
    degree = 2 * rates - 1
    rate = motion([0.1, 0.3, 0.7, 1.0, 1.5, 1.9], degree)[degree]
    np.testing.assert_allclose(rate[::2], rate[1::2], rtol=1e-6)  # the highest power alone is left in each piece
    assert {(found.t, found.order) for found in motion.breaks} == {(t, rates) for t in T[1:-1]}


def test_each_piece_is_of_what_both_its_points_state():
    given = message(3)
    del given["points"][1]["accelerations"], given["points"][2]["accelerations"], given["points"][2]["velocities"]
    motion = Motion.from_joint_trajectory(given)
    assert motion.source == "trajectory points, linear and cubic between them as in ROS"
    assert not motion([0.6, 1.0, 1.5], 2)[2].any()
    np.testing.assert_allclose(motion(0.5, 1, "left")[1], QD[1], atol=1e-12)


@pytest.mark.parametrize("suffix", [".yaml", ".json"])
@pytest.mark.parametrize("wrap", [lambda given: given, planning_response, lambda given: [planning_response(given)]])
def test_files_and_plans_are_read_and_joints_matched_by_name(tmp_path, suffix, wrap):
    motion = jounce.load_motion(write_document(tmp_path / f"m{suffix}", wrap(message())), ROBOT)
    assert motion.joint_names == ("joint1", "joint2")
    np.testing.assert_allclose(motion(T, 0)[0], Q[:, ::-1], atol=1e-14)
    assert {found.joint for found in motion.breaks} == {"joint1", "joint2"}


def test_what_ros2_topic_echo_prints(tmp_path):
    path = write_document(tmp_path / "m.yaml", message())
    path.write_text(path.read_text() + "---\n")
    assert jounce.load_motion(path, ROBOT).duration == 2.0


def test_messages_are_objects_too():
    def plain(given):
        if isinstance(given, dict):
            return SimpleNamespace(**{name: plain(part) for name, part in given.items()})
        return [plain(part) for part in given] if isinstance(given, list) else given

    motion = Motion.from_joint_trajectory(plain(planning_response(message())))
    np.testing.assert_array_equal(motion([0.3, 1.1])[4], Motion.from_joint_trajectory(message())([0.3, 1.1])[4])
    forces = ROBOT.forces_along(motion, [0.3]).forces
    expected = ROBOT.inverse_dynamics(*(rate[::-1] for rate in motion(0.3)))
    np.testing.assert_allclose([Q[0] for Q in forces], expected, atol=1e-9)


def changed(change, **options):
    given = message(**options)
    change(given)
    return given


REFUSED = {
    "nothing": ({"positions": [1]}, ["no joint_names and points", "expected one JointTrajectory"]),
    "two": ([message(), message(1)], ["2 trajectories", "expected one"]),
    "one point": (changed(lambda m: m.update(points=m["points"][:1])), ["time_from_start holds 1 time"]),
    "no time": (changed(lambda m: m["points"][2].pop("time_from_start")), ["point 2: time_from_start is None"]),
    "time of text": (changed(lambda m: m["points"][2].update(time_from_start="1 s")), ["time_from_start is '1 s'"]),
    "back in time": (changed(lambda m: m["points"].reverse()), ["time_from_start does not increase: 2 is followed by"]),
    "joints": (changed(lambda m: m["points"][1].update(positions=[1.0])), ["point 1: positions is [1.0]; expected 2"]),
    "nan": (changed(lambda m: m["points"][1].update(velocities=[1.0, float("nan")])), ["velocities is [1.0, nan]"]),
    "names": (changed(lambda m: m.update(joint_names=[1, 2])), ["joint_names is [1, 2]"]),
}  # fmt: skip


@pytest.mark.parametrize(("given", "words"), REFUSED.values(), ids=REFUSED)
def test_refuses(given, words):
    refusal(lambda: Motion.from_joint_trajectory(given), *words)


def test_joints_of_another_robot_are_refused(tmp_path):
    path = write_document(tmp_path / "m.yaml", message(names=("joint1", "jont2")))
    with expect_refusal("m.yaml", "missing 'joint2'; unknown 'jont2' (did you mean 'joint2'?)"):
        jounce.load_motion(path, ROBOT)
