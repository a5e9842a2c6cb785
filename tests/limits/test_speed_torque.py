"""Torque that falls with speed: the line of a drive in checks, slow-downs, time laws and files, against dense grids."""

import json
from dataclasses import replace

import numpy as np
import pytest
from test_check import fourier
from test_retime import RUBBING, STATED_GAP, UR5, largest_shares, move, rubbing

import jounce
from jounce.limits.barrier import BarrierProgram, minimize_duration
from jounce.limits.retime import DUALITY_GAP, GRID_POINTS_PER_POINT, Grid
from jounce.limits.retime_problem import build_problem
from jounce.limits.samples import find_worst_broken
from jounce.model import coordinates
from support.commands import call
from support.refusals import refusal

PLANAR = jounce.load("planar2r")
NO_LOAD = np.array([2.0, 1.8, 2.2, 3.0, 2.5, 2.8])  # rad/s, below the velocities that the UR5 allows
LINE = {"stall_effort": 2 * UR5.limits.effort, "no_load_velocity": NO_LOAD}


def line_shares(robot, motion, count=20_001):
    """The shares of the line that a motion takes: (count, n), 1 on the line in the direction of the motion."""
    t = np.linspace(motion.start, motion.stop, count)
    Q, qd = robot.forces_along(motion, t, 0).forces[0], motion(t, 1)[1]
    stall, no_load = (robot.limits.bounds(kind)[1] for kind in ("stall_effort", "no_load_velocity"))
    return np.maximum(Q / stall + qd / no_load, -Q / stall - qd / no_load)


@pytest.mark.parametrize("share", [0.999, 1.001])
def test_a_motion_breaks_the_line_where_a_dense_grid_does(share):
    motion, start = fourier(2, 2), PLANAR.with_limits(stall_effort=100.0, no_load_velocity=3.0)
    stall, no_load = np.array([[100.0], [3.0]]) * line_shares(start, motion).max(axis=0) / share
    robot = PLANAR.with_limits(stall_effort=stall, no_load_velocity=no_load)
    found = robot.check(motion.with_step(0.05))
    assert found.ok == (share < 1)
    for j, row in enumerate(found.table):
        assert (row.limit, row.unit, abs(row.bound)) == ("stall_effort", "N m", pytest.approx(stall[j]))
        assert row.ratio == pytest.approx(share, rel=1e-6)
        broken = (line_shares(robot, motion)[:, j] > 1).mean() * motion.duration
        assert sum(stop - start for start, stop in row.violations) == pytest.approx(broken, abs=5e-4)


def test_the_line_bounds_what_drives_and_not_what_brakes():
    """A joint that turns at 2 rad/s, driven or held back by a moment; 150 N m (1 - 2 / 3) are left."""
    m = PLANAR.mechanism
    robot = jounce.Robot.from_screws(m.B, m.X, 1e-9 * m.M, gravity=[0, 0, 0])
    robot = robot.with_limits(effort=100.0, stall_effort={"joint1": 150.0}, no_load_velocity={"joint1": 3.0})
    turning = jounce.Motion.polynomial([[0.0, 2.0], [0.0, 0.0]], 1.0)
    for moment, kept in ((49.9, True), (50.1, False), (-99.9, True), (-100.1, False)):
        load = jounce.Motion.fourier([0, 0, moment, 0, 0, 0], *np.zeros((2, 1, 6)), 1.0, 1.0)
        motion = replace(turning, loads={robot.body_names[0]: load.curve})
        assert robot.check(motion).ok == kept


@pytest.mark.parametrize("robot", [PLANAR, rubbing(PLANAR, [3.0, 1.0])], ids=["without friction", "with friction"])
def test_a_slow_down_meets_the_line(robot):
    robot = robot.with_limits(stall_effort=[60, 20], no_load_velocity=3.0)
    motion = move(robot, 1, 1.0)
    slow = robot.slowdown(motion, up_to_limits=True)
    assert slow.binding.limit == "stall_effort"

    def peak(factor):
        return line_shares(robot, motion.scaled(1 / factor), 5001).max()

    assert peak(slow.factor) == pytest.approx(1, abs=1e-5)
    assert max(peak(c * slow.factor) for c in np.linspace(0.1, 1, 10)) < 1 + 1e-5 < peak(1.001 * slow.factor)


@pytest.mark.sweep(1)
@pytest.mark.parametrize(
    ("robot", "limits"),
    [(UR5, {}), (UR5, {"effort_rate": 2000.0}), (RUBBING, {"effort_rate": 2000.0})],
    ids=["alone", "with rates", "with rates and friction"],
)
def test_the_fastest_time_law_keeps_the_line_and_is_that_of_ipopt(robot, limits):
    pytest.importorskip("casadi")
    from benchmarks.retime import ipopt

    robot = robot.with_limits(**limits, stall_effort=0.5 * UR5.limits.effort, no_load_velocity=NO_LOAD)
    motion = move(robot, 2)
    found = robot.retime(motion)
    worst = line_shares(robot, found.motion, 5001).max()
    assert 0.985 < worst < 0.9902
    assert max(largest_shares(robot, found.motion, 5001).values()) < 0.9902
    assert "stall_effort" in {stretch.limit for stretch in found.binding}
    free = robot.with_limits(stall_effort=np.inf)
    assert line_shares(robot, free.retime(motion).motion, 501).max() > 1.1
    grid = Grid.build(build_problem(robot, motion, 0.99), 20, 20.0)
    points = slice(None, grid.count, GRID_POINTS_PER_POINT)
    program = BarrierProgram(grid.basis, grid.at.select(points), grid.rows.select(points), grid.free)
    c = minimize_duration(program, grid.inner(np.ones(grid.basis.count)), DUALITY_GAP)
    assert -1e-7 < grid.basis.duration(c) / ipopt(grid, points) - 1 < STATED_GAP


@pytest.mark.parametrize(("limits", "words"), [
    ({"stall_effort": 2.0}, "stall_effort is 2 and no_load_velocity is inf; expected both"),
    ({"no_load_velocity": 2.0}, "stall_effort is inf and no_load_velocity is 2; expected both"),
    ({"stall_effort": 0.0, "no_load_velocity": 2.0}, "stall_effort is 0.0; expected one number above 0"),
    ({"stall_effort": [[-2, 3]] * 2, "no_load_velocity": 2.0}, "stall_effort is [-2.0, 3.0]; expected one number"),
    ({"stall_effort": 2.0, "no_load_velocity": np.nan}, "expected both"),
])  # fmt: skip
def test_lines_that_are_none_are_refused(limits, words):
    refusal(lambda: PLANAR.with_limits(**limits), "joint1", words)


def test_infinity_takes_the_line_away_and_other_limits_leave_it():
    robot = PLANAR.with_limits(stall_effort=[20, 10], no_load_velocity=[3, 4]).with_limits(effort=5)
    np.testing.assert_allclose(robot.limits.effort_slope, [20 / 3, 2.5])
    assert robot.with_limits(stall_effort={"joint1": np.inf}).limits.effort_slope.tolist() == [0, 2.5]
    assert robot.with_limits(stall_effort=np.inf, effort=np.inf).limits == PLANAR.limits
    assert robot.with_limits(stall_effort=[40, 20]).limits.effort_slope.tolist() == [40 / 3, 5]


@pytest.mark.parametrize("call", ["slowdown", "retime"])
@pytest.mark.parametrize(("stall", "refused"), [(0.99, True), (1.03, False)])
def test_a_drive_that_cannot_hold_the_weight_is_refused(call, stall, refused):
    motion = jounce.Motion.polynomial([[0, 0, 1.0, -2 / 3], [0, 0, 0, 0]], 1.0)
    weight = np.abs(PLANAR.gravity_forces(motion(np.linspace(0, 1, 101), 0)[0])).max(axis=0)
    robot = PLANAR.with_limits(stall_effort=stall * weight, no_load_velocity=3.0)
    if refused:
        refusal(lambda: getattr(robot, call)(motion), "stall", "joint1", "slow")
    else:
        assert getattr(robot, call)(motion).motion.duration > 0


def test_joints_that_turn_the_other_way_have_the_line_of_their_leader():
    m = UR5.with_limits(**LINE).mechanism
    limits = coordinates.limits(replace(m, G=-2 * m.G))
    np.testing.assert_allclose(limits.stall_effort, 2 * LINE["stall_effort"])
    np.testing.assert_allclose(limits.no_load_velocity, NO_LOAD / 2)


def test_deviations_are_those_of_the_decisive_velocity_or_effort():
    t = np.linspace(0, 2, 1001)
    q = np.stack([np.sin(2 * t), np.cos(3 * t)], axis=1) + np.random.default_rng(0).normal(0, 1e-4, (1001, 2))
    fit = jounce.Motion.fit(t, q)
    for line, other in (((1e9, 3.0), {"velocity": 3.0}), ((50.0, 1e9), {"effort": 50.0})):
        robot = PLANAR.with_limits(**other, stall_effort=line[0], no_load_velocity=line[1])
        [own, of_line] = [row for row in robot.check(fit).table if row.joint == "joint1"]
        assert of_line.ratio == pytest.approx(own.ratio, rel=1e-6)
        assert of_line.deviation == pytest.approx(own.deviation, rel=1e-6)


def test_files_samples_commands_and_reports_know_the_line(tmp_path):
    robot = PLANAR.with_limits(stall_effort=[90, 30], no_load_velocity=3.0)
    jounce.save(robot, tmp_path / "arm.yaml")
    assert jounce.load(tmp_path / "arm.yaml").limits == robot.limits
    limits = {"units": "SI", "angles": "deg", "joints": {
        "joint1": {"stall_effort": 90, "no_load_velocity": 180 * 3 / np.pi},
        "joint2": {"stall_effort": 30, "no_load_velocity": 180 * 3 / np.pi},
    }}  # fmt: skip
    (tmp_path / "limits.yaml").write_text(json.dumps(limits))
    read = PLANAR.with_limits(tmp_path / "limits.yaml").limits
    np.testing.assert_allclose(read.no_load_velocity, 3.0)
    found = call("info", tmp_path / "arm.yaml")
    assert "stall effort" in found.output
    assert "no load velocity" in found.output
    motion = fourier(2, 2).with_step(0.01)
    along = robot.forces_along(motion, order=0)
    worst = find_worst_broken(robot.limits, along.t, along.rates, along.forces)
    assert worst.kind == "stall_effort"
    assert worst.ratio == pytest.approx(line_shares(robot, motion, 201).max(), rel=1e-2)
