"""A guard keeps every limit at every tick, judged by inverse dynamics, goes on to the end, and does the same in C."""

import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pytest
from benchmarks.guard import (
    HOMES,
    compile_guard,
    joint_rates,
    load,
    random_motion,
    random_setpoints,
    run_compiled,
    run_greedily,
    within_ticks,
)

import jounce
from jounce import JounceWarning
from jounce.limits import path_terms
from jounce.live.guard import MAX_WORK, TABLE_ERROR
from support.refusals import expect_refusal, refusal
from support.robots import rubbing

ALLOWED = 1.0005  # of a limit, at ticks
PLANAR = jounce.load("planar2r").with_limits(effort=[50, 20], effort_rate=[600, 200], velocity=4)
SWING = jounce.Motion.fourier([0.3, 0.2], [[0.9, 0.5], [0.2, -0.4]], [[0.1, -0.3], [0.3, 0.2]], 2.0, 0.5)
BLEND = [0, 0, 0, 0, 35, -84, 70, -20]  # from rest to rest
MOVE = jounce.Motion.polynomial(np.outer([1.0, -0.8], BLEND) / 0.5 ** np.arange(8), 0.5)
needs_gcc = pytest.mark.skipif(not shutil.which("gcc"), reason="needs gcc")


CASES = {
    "moves at its ends": (PLANAR, SWING),
    "from rest to rest": (PLANAR, MOVE),
    "jerk that jumps": (PLANAR, jounce.Motion.trapezoidal([[0, 0], [1, -1]], 4.0, 30.0).blended(0.05, 2)),
    "viscous friction": (rubbing(PLANAR, damping=2.0), MOVE),
    "seven joints": (load("panda"), random_motion(np.array(HOMES["panda"]), np.random.default_rng(11))),
}


def follow(guard, setpoints):
    """The states of ticks until the end of the path."""
    states = []
    for setpoint in setpoints:
        states.append(guard.step(setpoint))
        if states[-1].status in ("end", "stuck"):
            break
    return states


def ratios(robot, states):
    """Largest qd, Q, Qd over their limits."""
    q, qd, q2d, q3d = joint_rates(states[0].motion, np.array([x[:4] for x in states]))
    Q, Qd = robot.inverse_dynamics(q, qd, q2d, q3d)
    limits = robot.limits
    return [np.abs(x / y).max() for x, y in ((qd, limits.velocity), (Q, limits.effort), (Qd, limits.effort_rate))]


@pytest.mark.parametrize("name", list(CASES)[:-1])
def test_no_limit_is_broken_at_a_tick(name):
    robot, motion = CASES[name]
    assert not robot.check(motion).ok
    states = follow(robot.guard(motion), random_setpoints(4000, np.random.default_rng(0)))
    assert states[-1].status == "end"
    found = ratios(robot, states)
    assert max(found) < ALLOWED
    assert max(found) > 0.95  # it makes use of them
    v, s = np.array([(x.v, x.s) for x in states]).T
    assert 0 <= v.min() <= v.max() <= 1 + 1e-8
    assert np.diff(s).min() >= 0


def test_set_points_are_followed_where_nothing_limits():
    free = PLANAR.with_limits(effort=1e4, effort_rate=1e6, velocity=100.0)
    guard = free.guard(MOVE)
    states = follow(guard, np.ones(2000))
    assert {x.status for x in states} == {"follow", "end"}, [x.limit for x in states if x.limit]
    assert states[-1].s == MOVE.stop
    assert not states[-1].rates[1].any()
    assert 1e-3 * len(states) == pytest.approx(MOVE.duration + 2 / 30, abs=2e-3)  # the law is behind by 2 / k
    states = follow(free.guard(SWING), [0.5] * 400 + [0.0] * 600)
    assert max(x.v for x in states) <= 0.5 + 1e-9
    assert states[-1].v < 1e-6
    assert states[-1].status == "follow"


FREE = jounce.Motion.polynomial(np.outer([0.3, -0.2], BLEND) / 10.0 ** np.arange(8), 10.0)  # no limit is near


@pytest.mark.parametrize("setpoint", [0.3, 0.7, 1.0])
def test_a_set_point_that_is_reached_is_followed_to_the_last_bit(setpoint):
    """Rounding lets the speed reach the set point from above, which is no overshoot."""
    assert {state.status for state in follow(PLANAR.guard(FREE), [setpoint] * 3000)} == {"follow"}


@pytest.mark.parametrize("drop", [1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-8])
def test_set_points_that_fall_are_not_overshot(drop):
    """The set point falls below what the speed is about to reach, as it is still accelerated."""
    guard, lowered = PLANAR.guard(FREE), 1 - drop
    while guard.step(1.0).v < 1 - 2 * drop:
        pass
    assert guard.state.v < lowered
    speeds = [guard.step(lowered).v for _ in range(500)]
    assert lowered - drop < max(speeds) <= lowered + 1e-10


def test_a_path_that_moves_at_its_end_is_stopped_there():
    states = follow(PLANAR.guard(SWING), np.ones(4000))
    assert states[-1].status == "end"
    assert 0 <= SWING.stop - states[-1].s <= 1e-6 * SWING.duration
    assert np.abs(states[-1].rates[1]).max() < 1e-3


def test_what_cannot_go_on_says_where():
    slow = PLANAR.with_limits(velocity=[2e-5, 10], effort=1e3, effort_rate=1e5)
    states = follow(slow.guard(SWING), np.ones(3000))
    assert states[-1].status == "stuck"
    assert (states[-1].limit.joint, states[-1].limit.limit) == ("joint1", "velocity")
    assert SWING.start <= states[-1].limit.t < 0.01


@pytest.mark.parametrize("name", ["from rest to rest", "seven joints"])
def test_tables_are_exact_between_nodes(name):
    robot, motion = CASES[name]
    tables, random = robot.guard(motion).tables, np.random.default_rng(0)
    s, v, a, j = random.uniform([motion.start, 0, -10, -300], [motion.stop, 1, 10, 300], (4000, 4)).T
    path = path_terms.sample_path(tables.problem.robot, motion, s, 1)
    rows = tables.problem.rows(path, 10.0)
    products = np.stack([v**0, v, v * v, a, v**3, v * a, j])
    exact = np.einsum("nrk,kn->nr", rows.factors, products[rows.used])[:, : len(tables.kinds)]
    within = (np.abs(exact) < 1).all(axis=1)
    assert within.sum() > 100
    assert np.abs(exact - tables.values(s, v, a, j))[within].max() < 2 * TABLE_ERROR


def test_friction_of_either_sign_is_left_of_efforts():
    with pytest.warns(JounceWarning, match="rate of Coulomb friction"):
        rough = rubbing(PLANAR, 3.0).guard(MOVE)
    smooth = PLANAR.with_limits(effort=[47, 17]).guard(MOVE)
    np.testing.assert_allclose(*(g.tables.values(*np.ones((4, 1)) * 0.3) * [1, 47, 17, 1, 1] for g in (rough, smooth)))


@pytest.mark.parametrize(("share", "holds"), [(0.9e-3, False), (1.5e-3, True)])
def test_standing_still_must_leave_a_share_of_each_limit(share, holds):
    Q = np.abs(PLANAR.inverse_dynamics(*np.zeros((3, 2)))[0])
    arm = PLANAR.with_limits(effort=[Q * (1 + share + TABLE_ERROR), 40])
    if holds:
        assert follow(arm.guard(MOVE), np.ones(300))[-1].s > 0
    else:
        refusal(lambda: arm.guard(MOVE), "joint 'joint1' holds … at rest at t = 0 s")


@pytest.mark.parametrize("setpoint", [-0.1, 1.1, np.nan, "1", None, [1.0]])
def test_set_points_from_0_to_1_are_expected(setpoint):
    refusal(lambda: PLANAR.guard(MOVE).step(setpoint), "setpoint is …; expected 0 to 1")


@pytest.mark.parametrize(("robot", "motion", "what"), [
    (jounce.load("planar2r"), MOVE, "no limit"),
    (PLANAR.with_limits(snap=1e6), MOVE, "no limits of snap…with_limits(snap=inf)"),
    (jounce.load("g1", base="floating"), MOVE, "fixed base"),
    (jounce.load("fivebar").with_limits(effort=9), MOVE, "without loops"),
    (PLANAR, jounce.Motion.trapezoidal([[0, 0], [1, 1]], 2.0, 10.0), "jumps at t = 0"),
    (PLANAR, 3, "expected a jounce.Motion"),
])  # fmt: skip
def test_what_is_not_served_is_refused(robot, motion, what):
    refusal(lambda: robot.guard(motion), what)


@pytest.mark.parametrize("dt", [0, -1e-3, np.inf, "1"])
def test_ticks_take_time(dt):
    refusal(lambda: PLANAR.guard(MOVE, dt=dt), "dt is …; expected the spacing of ticks")


@needs_gcc
@pytest.mark.parametrize("name", ["moves at its ends", "seven joints"])
def test_c_does_the_same_without_warnings_at_bounded_work(name, tmp_path):
    robot, motion = CASES[name]
    guard, setpoints = robot.guard(motion), random_setpoints(20_000, np.random.default_rng(1))
    runs = [
        run_compiled(compile_guard(guard, tmp_path, ("-ffp-contract=off", x)), guard.tables, setpoints)
        for x in ("-O2", "-O0")
    ]
    np.testing.assert_array_equal(runs[0].rates, runs[1].rates)
    states = follow(guard, setpoints[:700])
    np.testing.assert_allclose([x[:4] for x in states], runs[0].rates[: len(states)], rtol=1e-12, atol=1e-12)
    work = runs[0].found[:, 2] * guard.tables.work
    assert work.max() <= MAX_WORK
    assert np.median(work) <= MAX_WORK / 10


@needs_gcc
def test_c_keeps_limits_at_ticks_and_the_margin_between(tmp_path):
    robot, motion = CASES["seven joints"]
    guard = robot.guard(motion)
    run = run_compiled(compile_guard(guard, tmp_path), guard.tables, np.ones(20_000))
    for shares, margin, allowed in (((0.0, 1.0), 0.0, ALLOWED), ((0.3, 0.7), guard.dt / 2, 1.001)):
        Q, Qd = robot.inverse_dynamics(*joint_rates(motion, within_ticks(run, shares)))
        limits = robot.limits
        assert (np.abs(Q) < ALLOWED * limits.effort + limits.effort_rate * margin).all()
        assert (np.abs(Qd) < allowed * limits.effort_rate).all()


@pytest.mark.skipif(not shutil.which("g++"), reason="needs g++")
def test_the_header_is_cpp_too(tmp_path):
    (tmp_path / "guard.h").write_text(PLANAR.guard(MOVE).c_source())
    flags = ["-std=c++11", "-Wall", "-Wextra", "-Werror", "-fsyntax-only"]
    (tmp_path / "main.cpp").write_text(
        '#include "guard.h"\n'
        "void f(guard_state *g) { guard_start(&guard_motion, g); guard_step(&guard_motion, g, 1.0); }\n"
    )
    subprocess.run(["g++", *flags, "main.cpp"], cwd=tmp_path, check=True)


@needs_gcc
def test_set_points_of_c_are_clipped(tmp_path):
    guard = PLANAR.guard(MOVE)
    library = compile_guard(guard, tmp_path)
    for given, meant in ((np.nan, 0.0), (-1.0, 0.0), (7.0, 1.0)):
        runs = [run_compiled(library, guard.tables, np.full(300, x)).rates for x in (given, meant)]
        np.testing.assert_array_equal(*runs)


def test_greedy_scaling_breaks_limits():
    """What a guard is for: a tick that is feasible may have no feasible tick after it."""
    robot, motion = CASES["seven joints"]
    rates = run_greedily(robot.guard(motion).tables, 4000)
    Qd = robot.inverse_dynamics(*joint_rates(motion, rates))[1]
    assert np.abs(Qd / robot.limits.effort_rate).max() > 2


@pytest.mark.parametrize("prefix", ["", "2go", "a b", "x;", 3])
def test_prefixes_are_names(prefix):
    refusal(lambda: PLANAR.guard(MOVE).c_source(prefix), "prefix is")


def test_short_moves_amid_long_rests_are_seen():
    """Half a second of a minute and a half: tables of a hundred even nodes had missed it."""
    move = jounce.Motion.polynomial(np.outer([1, 1], [0] * 5 + [126, -420, 540, -315, 70]) / 0.5 ** np.arange(10), 0.5)
    rest = [jounce.Motion.polynomial([[x, 0], [x, 0]], 45.0) for x in (0.0, 1.0)]
    long = rest[0] + move + rest[1]
    tables = PLANAR.with_limits(velocity=1).guard(long).tables
    fastest = np.abs(long(np.linspace(45, 45.5, 501), 1)[1]).max()
    assert np.sqrt(np.abs(tables.factors).max()) >= 0.99 * fastest


def test_moving_ground_is_refused():
    t = np.linspace(0, 1, 21)
    C = np.tile(np.eye(4), (21, 1, 1))
    C[:, 1, 3] = 0.1 * t**2
    with expect_refusal("the ground moves, and goes on where the guard slows down"):
        PLANAR.guard(MOVE.with_base(t, C, degree=5))
    assert PLANAR.guard(MOVE.with_base(None, C[0])).step().s == 0


def test_ground_of_constant_velocity_is_refused():
    steady = jounce.Motion.polynomial([[0, 0.1], [0, 0], [0, 0], [1, 0], [0, 0], [0, 0], [0, 0]], MOVE.duration).curve
    refusal(lambda: PLANAR.guard(replace(MOVE, base_curve=steady)), "the ground moves, and goes on")
