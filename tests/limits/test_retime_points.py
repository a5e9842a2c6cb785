"""Retiming along way points: every limit is kept, and every point passed or rounded, by oracles of their own."""

from itertools import pairwise

import numpy as np
import pinocchio
import pytest

import jounce
from jounce import JounceError, Motion
from jounce.motion.way_points import path_along_lines
from support.pinocchio_of_mechanism import ConstrainedPeer
from support.refusals import refusal

CASE = [
    (-1.62219, 0.0430026, 0.51164, 0.814931, 0.88985, -1.98603),
    (0, 0, 0, 0, 0.523599, 0),
    (0, 0, 0, 0, 0, 0),
    (0, 0, 0, 0, 0, 0),
]
GANTRY = """<robot name="gantry"><link name="rail"/>
<link name="cart"><inertial><mass value="4"/>
<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="arm"><inertial><origin xyz="0.2 0 0"/><mass value="2"/>
<inertia ixx="0.01" iyy="0.05" izz="0.05" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="slide" type="prismatic"><parent link="rail"/><child link="cart"/><axis xyz="1 0 0"/>
<limit lower="-0.5" upper="0.5" velocity="1.5" effort="80"/></joint>
<joint name="swing" type="revolute"><parent link="cart"/><child link="arm"/><axis xyz="0 1 0"/>
<limit lower="-2.5" upper="2.5" velocity="3" effort="15"/></joint></robot>"""
MARGIN = 0.01
TOLERATED = 1e-4  # of a limit: what retime may exceed the margin by between its points
UR5 = jounce.load("ur5")


@pytest.fixture(scope="module")
def robots(tmp_path_factory):
    file = tmp_path_factory.mktemp("robots") / "gantry.urdf"
    file.write_text(GANTRY)
    return {
        "ur5": UR5.with_limits(effort_rate=2000.0, acceleration=20.0),
        "panda": jounce.load("panda", lock={"panda_finger_joint1": 0.0}).with_limits("panda"),
        "gantry": jounce.load(file).with_limits(acceleration=[10, 20], jerk=[200, 400], effort_rate=[800, 300]),
    }


def random_points(robot, count, seed):
    rng = np.random.default_rng(seed)
    lower, upper = robot.limits.bounds("position").clip(-2.5, 2.5)
    return (lower + upper) / 2 + (upper - lower) * rng.uniform(-0.3, 0.3, (count, robot.n))


def forces_of_pinocchio(robot, *rates):
    """Forces (N, n) at states by the recursion of Pinocchio."""
    peer = ConstrainedPeer(robot.mechanism, [])
    given = [np.zeros((len(rates[0]), peer.model.nv)) for _ in rates]
    for x, rate in zip(given, rates, strict=True):
        x[:, peer.order] = rate
    forces = [pinocchio.rnea(peer.model, peer.data, *state) for state in zip(*given, strict=True)]
    return np.array(forces)[:, peer.order]


def largest_ratios(robot, motion, count=4001):
    """The largest ratio to each kind of limit, by differences of positions and forces of Pinocchio.

    Differences between neighbours are means of derivatives, which limits bound too.
    """
    t = np.linspace(motion.start, motion.stop, count)
    q, qd, q2d = motion(t, 2)
    step = t[1] - t[0]
    Q, static = forces_of_pinocchio(robot, q, qd, q2d), forces_of_pinocchio(robot, q, 0 * q, 0 * q)
    kinds = {
        "position": q, "velocity": np.diff(q, axis=0) / step, "acceleration": np.diff(q, 2, axis=0) / step**2,
        "jerk": np.diff(q2d, axis=0) / step, "effort": Q,
        "effort_rate": np.diff(Q if robot.name != "panda" else Q - static, axis=0) / step,
    }  # fmt: skip
    ratios = {}
    for kind, values in kinds.items():
        lower, upper = robot.limits.bounds(kind)
        if np.isfinite(upper).any():
            middle, half = (0, upper) if kind != "position" else ((lower + upper) / 2, (upper - lower) / 2)
            ratios[kind] = float(np.nanmax(np.abs(values - middle) / half))
    return ratios


def least_distance(motion, point):
    """The least distance of a motion from a point, by the largest joint: sampled ever more closely."""
    start, stop = motion.start, motion.stop
    for _ in range(9):
        t = np.linspace(start, stop, 501)
        distances = np.abs(motion(t, 0)[0] - point).max(axis=1)
        nearest, step = t[distances.argmin()], t[1] - t[0]
        start, stop = max(motion.start, nearest - 2 * step), min(motion.stop, nearest + 2 * step)
    return distances.min()


@pytest.mark.sweep(3)
@pytest.mark.parametrize("count", [2, 3, 5, 7])
@pytest.mark.parametrize("name", ["ur5", "panda", "gantry"])
def test_a_smooth_path_passes_all_points_within_all_limits(robots, name, count):
    robot = robots[name]
    points = random_points(robot, count, seed=count)
    fast = robot.retime(points)
    ratios = largest_ratios(robot, fast.motion)
    assert 1 - 2 * MARGIN < max(ratio for kind, ratio in ratios.items() if kind != "position") < 1 - MARGIN + TOLERATED
    assert ratios["position"] < 1
    assert max(least_distance(fast.motion, point) for point in points) < 1e-9
    assert fast.motion.breaks == ()
    assert robot.check(fast.motion).ok
    ends = fast.motion([fast.motion.start, fast.motion.stop], 1)
    assert np.abs(ends[0] - points[[0, -1]]).max() < 1e-12
    assert np.abs(ends[1]).max() < 1e-9


@pytest.mark.sweep(1)
@pytest.mark.parametrize(("name", "count"), [("ur5", 3), ("panda", 3), ("gantry", 4)])
def test_rounded_corners_are_within_their_tolerance_and_all_limits(robots, name, count):
    robot, tolerance = robots[name], 0.02
    points = random_points(robot, count, seed=count + 1)
    fast = robot.retime(points, tolerance=tolerance)
    ratios = largest_ratios(robot, fast.motion)
    assert 1 - 2 * MARGIN < max(ratio for kind, ratio in ratios.items() if kind != "position") < 1 - MARGIN + TOLERATED
    distances = [least_distance(fast.motion, point) for point in points]
    assert max(distances[1:-1]) < tolerance * (1 + 1e-9)
    assert fast.motion.residual.max() == pytest.approx(tolerance, rel=1e-9)
    # The largest joint is nearest to the corner before or after the middle of the blend, never by much.
    assert max(distances[1:-1]) > 0.9 * tolerance
    assert max(distances[0], distances[-1]) < 1e-12


def test_four_points_of_a_thread():
    """A path of a UR5 under 6 rad/s^2, whose last point is repeated; smooth accelerations cost little."""
    robot = UR5.with_limits(acceleration=6.0)
    fast = robot.retime(CASE)
    assert robot.check(fast.motion).ok
    assert max(least_distance(fast.motion, point) for point in CASE) < 1e-9
    assert any("point 3 from 0: equal to the one before" in note for note in fast.motion.notes)
    shortest, *rounded, first, second = (
        robot.retime(points, smooth=False, tolerance=tolerance).duration
        for points, tolerance in ((CASE, None), (CASE, 1e-2), (CASE, 1e-4), (CASE[:2], None), (CASE[1:], None))
    )
    assert shortest < fast.duration < 1.01 * shortest
    # The tighter the corner, the slower; a path that stops at the middle point is the slowest.
    assert shortest < rounded[0] < rounded[1] < first + second


@pytest.mark.parametrize("tolerance", [None, 0.02])
def test_the_duration_is_that_of_any_given_pace(tolerance):
    """The path decides, and not the time law that it is given with."""
    robot = UR5.with_limits(acceleration=6.0)
    given = robot.retime(Motion.waypoints(CASE, 7.0, tolerance=tolerance))
    assert given.duration == pytest.approx(robot.retime(CASE, tolerance=tolerance).duration, rel=5e-3)


def test_check_and_motors_take_points_with_a_duration():
    robot = UR5.with_limits(acceleration=6.0)
    motion = Motion.waypoints(CASE, 3.0)
    assert robot.check(CASE, duration=3.0) == robot.check(motion)
    assert robot.check(CASE, duration=3.0, tolerance=0.01).worst.limit == "acceleration"
    assert robot.check(CASE, 500.0, duration=3.0) == robot.check(motion, 500.0)
    arm = UR5.elastic(1e4, rotor=0.5)
    [tau] = arm.motors_along(CASE, [0.5, 1.0], duration=3.0).torques
    assert np.array_equal(tau, arm.motors_along(motion, [0.5, 1.0]).torques[0])
    fast = robot.retime(CASE).motion
    assert arm.motors_along(fast).torques[0].shape == (len(fast.times), 6)


@pytest.mark.parametrize("limits", [{}, {"jerk": 200.0}], ids=["second", "third"])
@pytest.mark.parametrize("tolerance", [1e-3, 1e-5, 1e-6, 1e-8])
def test_tight_corners_are_passed_within_limits_or_refused(tolerance, limits):
    """However small a corner is, it is seen: sampled densely within it, or refused where it is not resolved."""
    robot = jounce.load("planar2r").with_limits(velocity=2.0, acceleration=5.0, **limits)
    points = [[0, 0], [1, 0], [1, 1]]
    given = Motion.waypoints(points, 1.0, tolerance=tolerance)
    try:
        fast, refused = robot.retime(given), ""
    except JounceError as error:
        fast, refused = None, str(error)
    if fast is None:
        assert "the path turns too sharply; expected a larger tolerance" in refused
        return
    # Times of the result within each piece of the path, corners too.
    x = path_along_lines(np.array(points, dtype=float), tolerance).curve.x
    pieces = np.concatenate([np.linspace(a, b, 201) for a, b in pairwise(x)])
    t = fast.law.times(given.curve.outer(pieces)).clip(fast.motion.start, fast.motion.stop)
    q, qd, q2d, q3d = fast.motion(t, 3)
    corner = np.abs(q - [1, 0]).max(axis=1).min()
    assert corner == pytest.approx(tolerance, rel=0.01)
    ratios = [np.abs(qd).max() / 2, np.abs(q2d).max() / 5, np.abs(q3d).max() / limits.get("jerk", np.inf)]
    assert 0.98 < max(ratios) < 0.99 * 1.01


def test_points_by_joint_name_are_those_of_the_robot():
    robot = UR5.with_limits(acceleration=6.0)
    columns = dict(zip(UR5.joint_names[::-1], np.array(CASE).T[::-1], strict=True))
    assert robot.check(columns, duration=3.0) == robot.check(CASE, duration=3.0)


BOUNDED = jounce.load("planar2r").with_limits(lower=-2, upper=2, velocity=2, acceleration=3)
OVER = [[0, 0], [0, 0], [2, 2], [-2, 2]]
REFUSED = {
    "beyond a limit": (
        lambda: BOUNDED.retime([[0, 0], [1, 2.5]]),
        ["point 1 from 0: joint 'joint2' is at 2.5 rad, beyond its position limits of -2 to 2; expected points within"],
    ),
    "degrees": (
        lambda: BOUNDED.check([[0, 0], [45, 90]], duration=1.0),
        ["point 1 from 0: joint 'joint1' is at 45 rad", "if they were degrees; numpy.deg2rad makes rad of them"],
    ),
    "between points": (
        lambda: BOUNDED.retime(OVER),
        ["joint 'joint1' leaves its position limits between points 2 and 3 from 0", "stay within: tolerance="],
    ),
    "number of joints": (
        lambda: BOUNDED.retime(CASE),
        ["points have 6 columns; expected 2, one for each of joint1, joint2 of 'planar2r'"],
    ),
    "names of joints": (
        lambda: BOUNDED.retime({"joint1": [0, 1], "joint3": [0, 1]}),
        ["missing 'joint2'; unknown 'joint3'", "expected joint1, joint2, the joints of 'planar2r'"],
    ),
    "NaN": (lambda: BOUNDED.retime([[0, 0], [np.nan, 1]]), ["points holds nan; expected finite numbers"]),
    "one point": (lambda: BOUNDED.retime([[0, 0]]), ["points: 1 point; expected at least two different ones"]),
    "tolerance": (lambda: BOUNDED.retime([[0, 0], [1, 0], [1, 1]], tolerance=-1), ["tolerance is -1; expected a dist"]),
    "no corner": (lambda: BOUNDED.retime([[0, 0], [1, 1]], tolerance=0.1), ["tolerance rounds the corners between"]),
    "no duration": (
        lambda: BOUNDED.check([[0, 0], [1, 1]]),
        ["way points have no times; state how long", "duration=", "robot.retime(points)"],
    ),
    "no duration of motors": (
        lambda: BOUNDED.elastic(800, 0.1).motors_along([[0, 0], [1, 1]]), ["way points have no times"],
    ),
    "times and duration": (
        lambda: BOUNDED.check(Motion.waypoints([[0, 0], [1, 1]], 1.0), duration=2.0),
        ["duration is for way points, which have no times; leave it out"],
    ),
    "times and tolerance": (
        lambda: BOUNDED.retime(Motion.waypoints([[0, 0], [1, 1]], 1.0), tolerance=0.1),
        ["tolerance is for way points, which have no times; leave it out"],
    ),
    "several motions": (
        lambda: BOUNDED.check([Motion.waypoints([[0, 0], [1, 1]], 1.0)]), ["expected a jounce.Motion"],
    ),
}  # fmt: skip


@pytest.mark.parametrize(("call", "words"), REFUSED.values(), ids=REFUSED)
def test_points_that_no_motion_follows_are_refused(call, words):
    refusal(call, *words)


def test_lines_stay_within_limits_that_a_smooth_path_leaves():
    fast = BOUNDED.retime(OVER, tolerance=0.05)
    assert BOUNDED.check(fast.motion).ok
