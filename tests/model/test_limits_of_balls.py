"""Limits of joints of several screws: a cone and a twist of a ball, places and an angle in a plane."""

import numpy as np
import pytest

import jounce
from jounce.model import positions
from jounce.spatial import groups
from jounce.spatial.lie import exp, rotation
from support.leg_and_cart import leg_and_cart
from support.refusals import refusal

ROBOT = leg_and_cart()
LIMITED = {"upper": {"ankle.swing": 0.5, "ankle.twist": 0.3}, "lower": {"ankle.twist": -0.2}}


def about(axis, angle):
    return exp(np.array([*axis, 0, 0, 0.0]), np.array([[angle]]))


@pytest.mark.parametrize(("swing", "twist"), [(0.4, -0.3), (2.9, 3.0), (0.0, 1.0), (1.0, -3.1)])
@pytest.mark.parametrize("sign", [1, -3])
def test_a_turn_is_a_twist_about_z_then_a_swing_square_to_it(swing, twist, sign):
    H = about([0.6, 0.8, 0], swing) @ about([0, 0, 1], twist)
    found = groups.BALL.extent(sign * groups.BALL.numbers(H))
    angle = np.arccos((np.trace(rotation(H)) - 1) / 2)
    np.testing.assert_allclose(found, [swing, angle, twist], atol=1e-14)


def test_extents_of_a_plane_and_of_places_are_as_they_are_given():
    np.testing.assert_allclose(groups.PLANAR.extent(np.array([1.0, 2.0, 0.0, -3.0])), [-np.pi / 2, 1, 2])
    p = np.random.default_rng(0).normal(size=(3, 7))
    np.testing.assert_array_equal(groups.GROUPS["free"].extent(p)[:, 3:], p[:, :3])


def test_a_resting_position_moves_no_body():
    m, q = ROBOT.mechanism, positions.rest(ROBOT.mechanism)
    assert q.shape == (positions.count(m),)
    for joint in positions.multiscrew_joints(m).values():
        np.testing.assert_array_equal(joint.group.pose(q[joint.numbers]), np.eye(4))
    np.testing.assert_array_equal(positions.extents(m, q), np.zeros(m.n))


def test_limits_of_a_ball_bound_its_swing_and_its_twist():
    limits = ROBOT.with_limits(**LIMITED).limits
    place = positions.extent_names(ROBOT.mechanism).index("ankle.swing")
    assert limits.stated(place) == {"lower": -0.5, "upper": 0.5}
    assert limits.stated(place + 2) == {"lower": -0.2, "upper": 0.3}
    assert not np.isfinite(limits.upper[place + 1])


def test_a_file_of_limits_bounds_a_ball(tmp_path):
    path = tmp_path / "limits.yaml"
    path.write_text(
        "units: SI\nangles: deg\njoints:\n  ankle.swing: {upper: 30}\n  ankle.twist: {lower: -10, upper: 20}\n"
        "  ankle.wx: {velocity: 90}\n  box.z: {lower: 0}\n"
    )
    limits = ROBOT.with_limits(path).limits
    assert limits.stated(1) == pytest.approx({"lower": -np.pi / 6, "upper": np.pi / 6, "velocity": np.pi / 2})
    assert limits.stated(3) == pytest.approx({"lower": -np.pi / 18, "upper": np.pi / 9})
    assert limits.stated(13) == {"lower": 0.0}


@pytest.mark.parametrize(("given", "words"), [
    ({"upper": {"ankle.wx": 1}}, "joint 'ankle.wx' has no upper limit: 'ankle' is a ball joint, with limits of "
                                 "ankle.swing, ankle.angle, ankle.twist"),
    ({"lower": {"ankle": 1}}, "joint 'ankle' has no lower limit: … ankle.swing, ankle.angle, ankle.twist"),
    ({"upper": {"deck.vx": 1}}, "'deck' is a planar joint, with limits of deck.angle, deck.x, deck.y"),
    ({"velocity": {"ankle.swing": 1}}, "no velocity limit: … with limits of ankle.wx, ankle.wy, ankle.wz"),
    ({"lower": {"ankle.swing": -0.1}}, "'ankle.swing': expected upper alone, of 0 to pi: a swing has no sign"),
    ({"upper": {"ankle.angle": -0.1}}, "expected upper alone"),
    ({"upper": {"ankle.twist": 4}}, "'ankle.twist': a limit of 4 rad; a twist is never beyond pi"),
])  # fmt: skip
def test_limits_that_a_ball_cannot_have_are_refused_by_name(given, words):
    refusal(lambda: ROBOT.with_limits(**given), words)


def test_limits_of_a_ball_are_taken_away():
    limits = ROBOT.with_limits(**LIMITED).with_limits(upper={"ankle.swing": np.inf}).limits
    assert limits.stated(1) == {}


def test_a_robot_file_restores_limits_of_a_ball(tmp_path):
    robot = ROBOT.with_limits(**LIMITED, velocity={"ankle.wy": 2.0})
    jounce.save(robot, tmp_path / "robot.yaml")
    assert jounce.load(tmp_path / "robot.yaml").limits == robot.limits


MJCF = """<mujoco><compiler angle="radian"/><worldbody><body name="foot">
<joint name="ankle" type="ball" range="0 0.7" limited="true"/>
<inertial pos="0 0 0.1" mass="1" diaginertia="0.01 0.01 0.01"/></body></worldbody></mujoco>"""


def test_the_range_of_a_ball_in_mjcf_is_one_of_the_angle_of_its_turn(tmp_path):
    mujoco = pytest.importorskip("mujoco")
    path = tmp_path / "ankle.xml"
    path.write_text(MJCF)
    robot = jounce.load(path)
    assert [robot.limits.stated(j) for j in range(3)] == [{}, {"lower": -0.7, "upper": 0.7}, {}]
    model = mujoco.MjModel.from_xml_string(MJCF)
    data = mujoco.MjData(model)
    for angle in (0.69, 0.71, 3.0):
        data.qpos[:] = np.roll(groups.BALL.numbers(about([0.6, 0, 0.8], angle)), 1)
        mujoco.mj_forward(model, data)
        assert (data.nefc > 0) == (groups.BALL.extent(np.roll(data.qpos, -1))[1] > 0.7)
