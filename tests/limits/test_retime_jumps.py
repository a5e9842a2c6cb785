"""Retiming with accelerations that jump: the shortest duration of all, by closed forms, a linear program and peers."""

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import linprog

import jounce
from jounce import Motion
from jounce.limits.fastest_law import _build_steps, _IntervalPath, _pass_backward, find_first
from jounce.limits.retime_problem import MAX_UNIFORM_SPEED, build_problem
from support.refusals import expect_refusal, refusal

PLANAR = jounce.load("planar2r")
UR5 = jounce.load("ur5")
PANDA = jounce.load("panda", lock={"panda_finger_joint1": 0.0})
IIWA = jounce.load("iiwa14").with_limits(
    velocity=np.deg2rad([85, 85, 100, 75, 130, 135, 135]), effort=[320, 320, 176, 176, 110, 40, 40]
)
ONE_WAY = {  # from 0 to 1, from rest to rest but for the last
    "cubic": [0, 0, 3, -2],
    "quintic": [0, 0, 0, 10, -15, 6],
    "degree 7": [0, 0, 0, 0, 35, -84, 70, -20],
}
BETWEEN = 5e-4  # of a limit, which may be exceeded between the points of the path


def one_way(start, way, name="degree 7", duration=2.0):
    c = np.outer(way, ONE_WAY[name])
    c[:, 0] += start
    return Motion.polynomial(c / duration ** np.arange(c.shape[1]), duration)


def random_move(robot, seed, name="degree 7"):
    rng = np.random.default_rng(seed)
    middle = np.nan_to_num(robot.limits.bounds("position"), posinf=0, neginf=0).mean(axis=0)
    start, way = rng.uniform(-0.7, 0.7, (2, robot.n))
    return one_way(start + middle, way, name)


def random_curve(robot, seed):
    """A path that bends, from rest to rest."""
    rng = np.random.default_rng(seed)
    middle = np.nan_to_num(robot.limits.bounds("position"), posinf=0, neginf=0).mean(axis=0)
    start, way, bend = rng.uniform(-0.7, 0.7, (3, robot.n))
    u = np.array(ONE_WAY["degree 7"]) / 2.0 ** np.arange(8)
    arc = np.polynomial.polynomial.polymul(u, np.append(1 - u[0], -u[1:]))  # u (1 - u)
    c = np.outer(way, np.pad(u, (0, len(arc) - len(u)))) + np.outer(3 * bend, arc)
    c[:, 0] += middle + start
    return Motion.polynomial(c, 2.0)


def largest(robot, motion, count=20_001):
    """The largest share of a limit of velocity, acceleration and effort, on a fine grid and at both sides of jumps."""
    jumps = np.unique([found.t for found in motion.breaks_to(2)])
    shares = []
    for side, t in (("right", np.linspace(motion.start, motion.stop, count)), ("left", jumps), ("right", jumps)):
        q, qd, q2d = motion(t, 2, side)
        wrench = None if motion.wrench(t) is None else motion.wrench(t, 0, side)[0]
        Q = robot.inverse_dynamics(q, qd, q2d, wrench=wrench)
        for kind, value in (("velocity", qd), ("acceleration", q2d), ("effort", Q)):
            shares.append(np.abs(value / robot.limits.bounds(kind)[1]).max(initial=0))
    return max(shares)


@pytest.mark.parametrize("name", ONE_WAY)
@pytest.mark.parametrize(("way", "acceleration", "velocity"), [(1.0, 2.0, np.inf), (0.3, 1.0, np.inf), (1.0, 2.0, 0.5)])
def test_one_joint_takes_the_time_of_a_double_integrator(name, way, acceleration, velocity):
    robot = PLANAR.with_limits(acceleration=acceleration, velocity=velocity)
    found = robot.retime(one_way([0, 0], [way, 0], name), margin=0.0, smooth=False)
    ramps = 2 * np.sqrt(way / acceleration)
    exact = ramps if velocity > acceleration * ramps / 2 else way / velocity + velocity / acceleration
    assert exact * (1 - 1e-5) < found.duration < exact * (1 + 5e-4)


@pytest.mark.parametrize(("robot", "seed"), [(UR5, 1), (PLANAR.with_limits(acceleration=2.0, effort=60.0), 2)])
def test_controllable_speeds_are_those_of_a_linear_program(robot, seed):
    """The largest x at a point from which the end is reached, by scipy's HiGHS over all points that follow."""
    problem = build_problem(robot, random_curve(robot, seed), 0.99)
    path = _IntervalPath.sample(problem, 20)
    rows = path.linear_rows(problem.rows(path.path, MAX_UNIFORM_SPEED))
    cap, count, kinds = 100.0 * rows.uniform(), len(rows.length), len(rows.upper)
    steps = _build_steps(rows, np.zeros(count), np.zeros((count, kinds)), cap)
    K, size = np.array(_pass_backward(steps, cap)), cap / 100
    found = find_first(rows, cap)
    assert (found.x <= K).all()
    assert (found.x >= 0).all()
    matrix, bound = [], []
    for share, G, H, g in zip((0.0, 0.5, 1.0), rows.G, rows.H, rows.g, strict=True):
        for i, r in np.ndindex(count, kinds):
            if share == 0.5 and rows.alone[r]:
                continue
            line = np.zeros(count + 1)
            line[i] += H[i, r] * (1 - share) - G[i, r] / (2 * rows.length[i])
            line[i + 1] += H[i, r] * share + G[i, r] / (2 * rows.length[i])
            matrix += [line, -line]
            bound += [rows.upper[r] - g[i, r], g[i, r] - rows.lower[r]]
    matrix, bound = np.array(matrix), np.array(bound)
    assert (matrix @ found.x < bound + 1e-9).all()
    for i in range(0, count, 7):
        later = ~matrix[:, :i].any(axis=1)
        best = linprog(-np.eye(count + 1)[i], matrix[later] * size, bound[later], bounds=(0, 100), method="highs")
        assert best.x[i] == pytest.approx(K[i] / size, rel=1e-6)


CURVES = [
    (name, robot, seed)
    for name, robot in {
        "ur5": UR5,
        "ur5, accelerations": UR5.with_limits(acceleration=8.0),
        "panda": PANDA,
        "iiwa": IIWA,
        "panda, Q - Qgrav": PANDA.with_limits(effort=30.0, of={"effort": "Q - Qgrav"}),
    }.items()
    for seed in range(2)
]


@pytest.mark.sweep(4)
@pytest.mark.parametrize(("name", "robot", "seed"), CURVES, ids=[f"{name} {seed}" for name, _, seed in CURVES])
def test_limits_hold_between_points_and_the_smooth_answer_is_near(name, robot, seed):
    motion = random_curve(robot, seed) if seed else random_move(robot, seed, "quintic")
    found, smooth = robot.retime(motion, smooth=False), robot.retime(motion)
    assert robot.check(found.motion).verdict == "kept"
    if "grav" not in name:
        assert 0.9899 < largest(robot, found.motion) < 0.99 * (1 + BETWEEN)
    assert found.duration < smooth.duration < 1.005 * found.duration
    for end in (found.motion.start, found.motion.stop):
        assert np.abs(found.motion(end, 1)[1]).max() < 1e-6
    t = np.linspace(found.motion.start, found.motion.stop, 9)
    np.testing.assert_allclose(found.motion(t, 0)[0], motion(found.law.sigma(t), 0)[0], atol=1e-12)


def test_it_is_as_fast_as_toppra():
    pytest.importorskip("toppra")
    from benchmarks.retime import on_path, path, toppra

    for robot in (UR5, PANDA, IIWA):
        c = path(robot, 1)
        theirs, _ = toppra(robot, c, 1001)
        assert robot.retime(on_path(c), smooth=False).duration < 1.0005 * theirs


def test_jumps_are_breaks_of_the_motion_and_said():
    robot = UR5.with_limits(acceleration=10.0)
    found = robot.retime(random_move(UR5, 3), smooth=False)
    assert found.jumps > 100
    assert re.search(rf"; accelerations and forces jump {found.jumps} times>$", repr(found))
    assert "jump" not in repr(robot.retime(random_move(UR5, 3)))
    breaks = found.motion.breaks_to(2)
    assert {stop.order for stop in breaks} == {2}
    for stop in breaks[:: len(breaks) // 9]:
        before, after = (found.motion(stop.t, 2, side)[2][stop.joint] for side in ("left", "right"))
        assert after - before == pytest.approx(stop.jump, rel=1e-9)
    # Between jumps each rate is the derivative of the one below, with all of its digits.
    knots = found.law.times(np.concatenate([[found.law.first], found.law.kinks, [found.law.last]]))
    i = np.arange(120, len(knots) - 120, 17)
    u, w = np.polynomial.legendre.leggauss(12)
    half = np.diff(knots)[i][:, None] / 2
    inside = found.motion((knots[i][:, None] + half * (1 + u)).ravel(), 4)
    ends = found.motion(knots[i], 4), found.motion(knots[i + 1], 4, "left")
    for k in range(4):
        rise = (half[..., None] * w[:, None] * inside[k + 1].reshape(len(i), 12, -1)).sum(axis=1)
        np.testing.assert_allclose(rise, ends[1][k] - ends[0][k], atol=1e-7 * np.abs(inside[k]).max())
    with expect_refusal("^q2d of joint … jumps at t = … s, where Qd of every"):
        UR5.with_limits(effort_rate=1000.0).retime(found.motion)
    assert robot.slowdown(found.motion, up_to_limits=True).factor == pytest.approx(
        0.99**-0.5, rel=1e-3
    )  # of accelerations


def test_wrenches_and_breaks_go_with_the_path():
    robot = UR5.with_limits(acceleration=12.0)
    given = Motion.fourier(np.array([0, -1.5, 1, 0, 0.5, 0]), *np.full((2, 2, 6), 0.2), 1.3, 2.0)
    load = Motion.fourier(np.zeros(6), *np.full((2, 2, 6), 3.0), 1.3, 2.0)
    pushed = replace(given, loads={robot.body_names[-1]: load.curve})
    corners = Motion.trapezoidal(np.random.default_rng(2).uniform(-1, 1, (4, 6)), 1.0, 2.0)
    for motion in (pushed, corners):
        found = robot.retime(motion, smooth=False)
        assert robot.check(found.motion).verdict == "kept"
        assert largest(robot, found.motion) < 0.99 * (1 + BETWEEN)
        assert found.duration < robot.retime(motion).duration


def test_ends_that_move_keep_their_speed():
    robot = UR5.with_limits(acceleration=12.0)
    whole = random_move(UR5, 1)
    t = np.linspace(0.4, 1.2, 41)
    part = Motion.through(t, whole(t, 0)[0])
    found = robot.retime(part, smooth=False)
    for end, given in ((found.motion.start, part.start), (found.motion.stop, part.stop)):
        np.testing.assert_allclose(found.motion(end, 1)[1], part(given, 1)[1], rtol=1e-6, atol=1e-9)
    assert largest(robot, found.motion) < 0.99 * (1 + BETWEEN)
    with expect_refusal(re.compile(r"^the motion moves at its (start|end), and no time law keeps the velocity")):
        robot.retime(part.scaled(0.05), smooth=False)


def test_rests_within_and_the_pace_of_the_motion_do_not_matter():
    robot = UR5.with_limits(acceleration=12.0)
    there = random_move(UR5, 1)
    fast = robot.retime(there, smooth=False).duration
    for factor in (1e-3, 1e3):
        assert robot.retime(there.scaled(factor), smooth=False).duration == pytest.approx(fast, rel=1e-6)
    stay = Motion.polynomial(there(there.stop, 0)[0][:, None], 1.0)
    back = one_way(there(there.stop, 0)[0], there(0.0, 0)[0] - there(there.stop, 0)[0])
    both = robot.retime(there + stay + back, smooth=False)
    assert both.duration == pytest.approx(fast + robot.retime(back, smooth=False).duration, rel=0.02)
    assert largest(robot, both.motion) < 0.99 * (1 + BETWEEN)


@pytest.mark.parametrize(("limits", "names"), [
    ({"jerk": 100.0}, "jerk"),
    ({"effort_rate": 500.0, "power": 100.0}, "effort rate, power"),
    ({"snap": 1e5, "second_effort_rate": 1e5}, "snap, second effort rate"),
])  # fmt: skip
def test_limits_of_higher_order_are_named(limits, names):
    with expect_refusal(f"this robot also has limits of {names}; omit smooth=False"):
        UR5.with_limits(**limits).retime(random_move(UR5, 0), smooth=False)


def test_terms_that_are_not_linear_are_named():
    damped = PANDA.with_drives(["damping"])
    with expect_refusal("^retime with smooth=False supports effort limits without damping, "):
        damped.retime(random_move(PANDA, 0), smooth=False)
    no_forces = damped.with_limits(effort=np.inf, acceleration=10.0)
    assert no_forces.retime(random_move(PANDA, 0), smooth=False).jumps
    free = PLANAR.with_limits(velocity=np.inf, effort=np.inf, acceleration={"joint2": 1.0})
    with expect_refusal("^no limit bounds the speed along part of the path"):
        free.retime(one_way([0, 0], [1, 0]), smooth=False)
    refusal(lambda: UR5.retime(one_way(np.zeros(6), np.zeros(6)), smooth=False), "^the path does not move")


def test_closed_loops_go_the_same_way():
    robot = jounce.load("fivebar").with_limits(velocity=5.0, effort=20.0)
    motion = one_way([2.2, 0.94], [0.2, 0.1])
    found = robot.retime(motion, smooth=False)
    assert 0.9899 < robot.check(found.motion).worst.ratio < 0.99 * (1 + BETWEEN)
    assert found.duration < robot.retime(motion).duration
