"""Locked joints: the robot without them moves as the whole robot does whose joints stand still there."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import jounce
from support.files import LINKS, joint, link, robot_file
from support.refusals import refusal
from support.robots import Interpreted, mechanisms, random_mechanism, relative_error


def split(robot, rng, chosen):
    """Values for the chosen coordinates, and states of the others, apart and together."""
    values = {robot.joint_names[j]: float(rng.uniform(-1, 1)) for j in chosen}
    others = [j for j in range(robot.n) if j not in chosen]
    q = rng.uniform(-1, 1, (5, 6, len(others)))
    whole = np.zeros((5, 6, robot.n))
    whole[..., others] = q
    whole[0][:, list(chosen)] = list(values.values())
    return values, others, q, whole


@given(mechanisms(6), st.data())
def test_a_locked_robot_is_the_whole_one_with_joints_at_rest(drawn, data):
    mechanism, rng = drawn
    robot = Interpreted(jounce.Robot(mechanism))
    if robot.n == 1:
        return
    chosen = data.draw(st.sets(st.integers(0, robot.n - 1), min_size=1, max_size=robot.n - 1))
    values, others, q, whole = split(robot, rng, sorted(chosen))
    locked = Interpreted(robot.locked(values))
    assert locked.joint_names == tuple(robot.joint_names[j] for j in others)
    found = locked.inverse_dynamics(*q)
    expected = robot.inverse_dynamics(*whole)
    for x, y in zip(found, expected, strict=True):
        scale = np.abs(y).max() + 1e-9  # that of all the joints: one may feel nothing
        assert np.abs(x - y[..., others]).max() < 1e-12 * scale
    M = robot.mass_matrix(whole[0])
    assert relative_error(locked.mass_matrix(q[0]), M[..., others, :][..., others]) < 1e-12
    for body in robot.body_names:
        assert relative_error(locked.poses(q[0], body=body), robot.poses(whole[0], body=body)) < 1e-13


def test_followers_of_locked_joints_are_welded_others_still_move():
    rng = np.random.default_rng(0)
    base = random_mechanism(rng, [-1, 0, 1], ["revolute"] * 3, [1.0] * 3)
    G = [[1, 0], [2, 0], [0.5, -1]]
    robot = jounce.Robot.from_screws(base.B, base.X, base.M, G=G, g=[0, 0.3, 0.1], joint_names=["a", "b"])
    locked = robot.locked({"a": 0.4})
    assert locked.mechanism.nb == 1
    np.testing.assert_allclose(locked.mechanism.G, [[-1]])
    np.testing.assert_allclose(locked.mechanism.g, [0.1 + 0.5 * 0.4])


def test_limits_drives_and_terms_of_the_other_joints_stay():
    base = jounce.load("iiwa14").mechanism
    numbers = np.arange(1.0, 8.0)
    given = {"limits": {"effort": numbers}, "drives": {"friction": numbers}}
    robot = jounce.Robot.from_screws(base.B, base.X, base.M, **given).with_drives("friction")
    locked = robot.locked({"joint2": 0.1, "joint5": 0})
    for found in (locked.limits.effort, locked.drives.friction):
        assert found.tolist() == [1, 3, 4, 6, 7]
    assert locked.mechanism.acting == ("friction",)


def test_load_locks_joints_of_a_file_and_links_stay_findable(tmp_path):
    chain = (*LINKS, link("hand"), joint("turn", "base", "arm"), joint("wrist", "arm", "hand"))
    robot = jounce.load(robot_file(tmp_path, *chain), lock={"wrist": np.pi / 2})
    assert robot.joint_names == ("turn",)
    assert robot.poses([0.0], body="hand")[:3, 0] == pytest.approx([0, 1, 0])


@pytest.mark.parametrize(("lock", "words"), [
    ({"join1": 0}, ["unknown joint to lock 'join1'; did you mean 'joint1'"]),
    ({"joint1": np.nan}, ["joint 'joint1' is locked at nan; expected a finite number"]),
    (["joint1"], ["joints to lock are of type list; expected a mapping of names and values"]),
    ({"joint1": "0"}, ["locked at '0'"]),
    ({"joint1": 0, "joint2": 0}, ["all 2 joints are locked; expected one that moves"]),
])  # fmt: skip
def test_refuses_what_cannot_be_locked(lock, words):
    refusal(lambda: jounce.load("planar2r", lock=lock), "planar2r: ", *words)


def bounded_turn(lower, upper, screw=(0, 0, 1, 0, 0, 0)):
    base = jounce.load("planar2r").mechanism
    limits = {"lower": [lower, -np.inf], "upper": [upper, np.inf]}
    return jounce.Robot.from_screws(base.B, [screw, base.X[1]], base.M, limits=limits)


@pytest.mark.parametrize(
    ("robot", "lock", "words"),
    [
        (
            bounded_turn(-3, 3),
            {"joint1": 90},
            "'joint1' is locked at 90 rad: its limits are -3 to 3 rad; 90 deg are 1.5708",
        ),
        (bounded_turn(-3, -1), {"joint1": 0}, "at 0 rad: its limits are -3 to -1 rad$"),
        (bounded_turn(0, 0.1, (0, 0, 0, 0, 0, 1)), {"joint1": -1}, "at -1 m: its limits are 0 to 0.1 m$"),
        (bounded_turn(-np.inf, np.inf), {"joint1": -45}, "at -45 rad: more than four turns; -45 deg are -0.785398 rad"),
    ],
)
def test_a_joint_that_is_locked_where_it_cannot_be_is_warned_of(robot, lock, words):
    with pytest.warns(jounce.JounceWarning, match=words):
        robot.locked(lock)


def test_limits_hold_for_followers_too_and_are_rounded():
    base = jounce.load("planar2r").mechanism
    limits = {"lower": [0, 0], "upper": [3.1416, 1.0]}
    data = (base.B[[0, 1, 1]], base.X[[0, 1, 1]], base.M[[0, 1, 1]])
    wide = {key: [*numbers, np.inf if key == "upper" else -np.inf] for key, numbers in limits.items()}
    robot = jounce.Robot.from_screws(*data, G=[[1, 0], [2, 0], [0, 1]], joint_names=["lead", "free"], limits=wide)
    with pytest.warns(jounce.JounceWarning, match=r"'joint2' is locked at 2 rad: its limits are 0 to 1 rad$"):
        robot.locked({"lead": 1.0})
    bounded_turn(0, 3.1416).locked({"joint1": np.pi + 1e-5})


def test_refuses_to_lock_a_follower():
    G = [[1.0], [1.0]]
    base = jounce.load("planar2r").mechanism
    robot = jounce.Robot.from_screws(base.B, base.X, base.M, G=G, joint_names=["lead"])
    refusal(lambda: robot.locked({"joint2": 0.0}), "joint 'joint2' cannot be locked: it follows lead; lock that")
