"""Limits at a controller's rate: one verdict for one plan, whatever it is written as, and differences as stated."""

import json
from itertools import pairwise

import numpy as np
import pytest
import ruckig

import jounce
from support.commands import call
from support.refusals import refusal

HOME = np.array([0, -0.785, 0, -2.356, 0, 1.571, 0.785])
GOAL = np.array([1.0, 0.2, -0.4, -1.6, 0.5, 2.3, -0.4])
PANDA = jounce.load("panda", lock={"panda_finger_joint1": 0.0}).with_limits("panda")


@pytest.fixture(scope="module")
def ruckig_plan():
    """A plan of Ruckig within the limits of velocity, acceleration and jerk."""
    asked, trajectory, limits = ruckig.InputParameter(7), ruckig.Trajectory(7), PANDA.limits
    asked.current_position, asked.target_position = HOME.tolist(), GOAL.tolist()
    asked.max_velocity, asked.max_acceleration = limits.velocity.tolist(), limits.acceleration.tolist()
    asked.max_jerk = limits.jerk.tolist()
    ruckig.Ruckig(7).calculate(asked, trajectory)
    return jounce.Motion.from_ruckig(trajectory)


@pytest.fixture(scope="module")
def plan_files(ruckig_plan, tmp_path_factory):
    """The plan as a table of a row per millisecond, and as a JointTrajectory, both without the instant of its stop."""
    folder = tmp_path_factory.mktemp("plans")
    t = np.arange(0, ruckig_plan.stop, 0.001)
    rates = ruckig_plan(t, 2)
    header = ",".join(["t", *PANDA.joint_names])
    np.savetxt(folder / "plan.csv", np.column_stack([t, rates[0]]), "%.17g", ",", header=header, comments="")
    names = ("positions", "velocities", "accelerations")
    points = [
        {"time_from_start": {"sec": 0, "nanosec": round(1e9 * x)}, **dict(zip(names, of, strict=True))}
        for x, of in zip(t, np.stack(rates, axis=1).tolist(), strict=True)
    ]
    (folder / "plan.json").write_text(json.dumps({"joint_names": PANDA.joint_names, "points": points}))
    return folder


def broken(found):
    return {(row.joint, row.limit): round(row.ratio, 6) for row in found.table if not row.ok}


@pytest.mark.filterwarnings("ignore:.*acceleration jumps at 14 knots")
def test_one_plan_has_one_verdict_whatever_it_is_written_as(ruckig_plan, plan_files):
    """As functions of time the three differ: 5, 21 and 20 limits are broken, by overshoots of splines."""
    motions = [
        ruckig_plan,
        jounce.load_motion(plan_files / "plan.csv", PANDA, 1, as_="commands"),
        jounce.load_motion(plan_files / "plan.csv", PANDA, 1),
        jounce.load_motion(plan_files / "plan.json", PANDA, 1),
    ]
    first, *others = [PANDA.check(motion, rate=1000) for motion in motions]
    assert len({sum(not row.ok for row in PANDA.check(motion).table) for motion in (ruckig_plan, *motions[2:])}) == 3
    assert {limit for _, limit in broken(first)} == {"effort_rate"}
    assert len(broken(first)) == 5
    for found in others:
        assert broken(found) == broken(first)
        pairs = [(row.t, other.t) for row, other in zip(found.table, first.table, strict=True) if not row.ok]
        np.testing.assert_allclose(*np.transpose(pairs), atol=1e-9)
        for row, other in zip(found.table, first.table, strict=True):
            np.testing.assert_allclose(row.violations, other.violations, atol=1e-9)
    assert broken(PANDA.check(ruckig_plan.sampled(1000))) == broken(first)
    assert broken(PANDA.check(motions[1])) == broken(first)  # at its own rate


def test_values_are_the_differences_of_libfranka(ruckig_plan):
    """An independent loop over commands, one at a time, as libfranka's limitRate takes them."""
    _, q = ruckig_plan.sampled(1000).samples
    v, a, tau, most = np.zeros(7), np.zeros(7), np.zeros(7), {}
    last = q[0]
    for now in [*q, q[-1], q[-1], q[-1]]:
        velocity = (now - last) / 1e-3
        acceleration = (velocity - v) / 1e-3
        jerk = (acceleration - a) / 1e-3
        torque = PANDA.inverse_dynamics(now, velocity, acceleration) - PANDA.gravity_forces(now)
        values = {
            "velocity": velocity,
            "acceleration": acceleration,
            "jerk": jerk,
            "effort_rate": (torque - tau) / 1e-3,
        }
        for kind, value in values.items():
            most[kind] = np.maximum(np.abs(value), most.get(kind, 0))
        last, v, a, tau = now, velocity, acceleration, torque
    for row in PANDA.check(ruckig_plan, rate=1000).table:
        if row.limit in most:
            expected = most[row.limit][PANDA.joint_names.index(row.joint)]
            assert abs(row.value) == pytest.approx(expected, rel=1e-6), row


def test_kinematic_limits_that_a_plan_keeps_its_commands_keep(ruckig_plan):
    """A difference is a mean of the derivative, weighted by a B-spline: at any rate it is no larger."""
    for rate in (100, 250, 1000, 4000):
        found = PANDA.check(ruckig_plan, rate=rate)
        assert all(row.ok for row in found.table if row.limit in ("position", "velocity", "acceleration", "jerk"))


def test_differences_decide_which_limits_are_judged(ruckig_plan):
    arm = PANDA.with_limits(snap=1e9, second_effort_rate=1e9)
    kinds = [{row.limit for row in arm.check(ruckig_plan, rate=1000, differences=n).table} for n in (1, 2, 3, 4)]
    new = [later - earlier for earlier, later in pairwise([set(), *kinds])]
    assert new == [
        {"position", "velocity"}, {"acceleration", "effort"}, {"jerk", "effort_rate"}, {"snap", "second_effort_rate"}
    ]  # fmt: skip
    notes = PANDA.check(ruckig_plan, rate=1000, differences=2).notes
    assert notes[0] == "differences of commands at 1000 Hz: velocity, acceleration"
    assert notes[1] == "limits of jerk, effort rate are not judged by differences up to order 2"


def test_a_verdict_by_differences_says_which_limits_it_does_not_cover():
    """Jerk needs a third difference: two decide nothing on it, however small its limit is."""
    arm = jounce.load("planar2r").with_limits(velocity=3, jerk=0.01)
    commands = jounce.Motion.polynomial([[0, 2], [0, 0.5]], duration=1.0).sampled(1000, 2)
    found = arm.check(commands)
    assert (found.judged, found.words) == ({"velocity": 1, "jerk": 0}, "every limit is kept; not judged: jerk")
    assert repr(arm.explain(commands, rate=1000, differences=2)) == f"<Explanation: {found.words}>"
    assert "not judged" not in arm.check(commands, rate=1000).words


def test_differences_that_judge_no_limit_decide_nothing():
    """No verdict, and so none that a limit is kept: those of motors are judged by no differences at all."""
    motion = jounce.Motion.polynomial([[0, 0, 9], [0, 0, 0]], duration=1.0)
    arm = jounce.load("planar2r").with_limits(acceleration=4)
    soft = jounce.load("planar2r").elastic(800, rotor=0.1).with_limits(motor_velocity=1e-3)
    for judge in (arm.check, arm.explain):
        words = ("limits of acceleration are not judged", "up to order 1", "raise differences to 2")
        refusal(lambda judge=judge: judge(motion, rate=1000, differences=1), *words)
    refusal(lambda: soft.check(motion, rate=1000), "limits of motor velocity are not judged", "leave out rate")


def test_torques_of_a_table_of_commands_are_judged_as_they_are():
    """Joints without a column have the torques of the model; the first torque follows the rest before it."""
    t = np.arange(100) / 1000
    columns = {"t": t, **dict(zip(PANDA.joint_names, np.tile(HOME, (100, 1)).T, strict=True))}
    columns["panda_joint2.tau"] = np.where(t < 0.05, 0.5, 2.0)
    found = PANDA.check(jounce.load_motion(columns, PANDA, 1, as_="commands"))
    assert broken(found) == {("panda_joint2", "effort_rate"): 1.5}
    row = next(row for row in found.table if not row.ok)
    assert (row.value, row.t, row.violations) == (pytest.approx(1500), 0.05, ((0.05, 0.05),))
    assert "torque rates are differences of the table's torques, taken as Q - Qgrav" in found.notes
    columns["panda_joint2.tau"] = np.full(100, 1.5)
    row = next(row for row in PANDA.check(jounce.load_motion(columns, PANDA, 1, as_="commands")).table if not row.ok)
    assert (row.value, row.t) == (pytest.approx(1500), 0)


def test_joints_without_a_column_of_torques_have_those_of_the_model(ruckig_plan):
    t, q = ruckig_plan.sampled(1000).samples
    columns = {"t": t, **dict(zip(PANDA.joint_names, q.T, strict=True)), "panda_joint2.tau": np.zeros(t.size)}
    found = PANDA.check(jounce.load_motion(columns, PANDA, 1, as_="commands"))
    without = broken(PANDA.check(ruckig_plan, rate=1000))
    assert without.pop(("panda_joint2", "effort_rate")) > 7
    assert broken(found) == without


def test_closed_loops_are_judged_at_their_commands():
    """At a high rate differences are the derivatives, of joints that follow too."""
    arm = jounce.load("fivebar").with_limits(velocity=5.0, effort=20.0, effort_rate=500.0)
    start, way = np.array([2.2, 0.94]), np.array([0.2, 0.1])
    powers = np.array([0, 0, 0, 0, 35, -84, 70, -20])
    motion = jounce.Motion.polynomial(start[:, None] * np.eye(8)[0] + way[:, None] * powers, 1.0)
    for row, other in zip(arm.check(motion).table, arm.check(motion, rate=10_000).table, strict=True):
        assert (row.joint, row.limit) == (other.joint, other.limit)
        assert other.value == pytest.approx(row.value, rel=2e-3), row


def test_wrenches_act_at_commands():
    arm = jounce.load("iiwa14").with_limits(effort=1e3)
    q = np.array([0.1, 0.5, 0.2, -1.0, 0.3, 0.8, 0.1])
    columns = {"t": np.arange(50) / 1000, **{name: np.full(50, x) for name, x in zip(arm.joint_names, q, strict=True)}}
    columns |= {f"link7.{name}": np.full(50, 10.0 * (name == "fx")) for name in ("mx", "my", "mz", "fx", "fy", "fz")}
    Q = arm.inverse_dynamics(q, 0 * q, 0 * q, wrench={"link7": [0, 0, 0, 10.0, 0, 0]})
    for options in ({"degree": 7}, {"as_": "commands"}):
        found = arm.check(jounce.load_motion(columns, arm, 0, **options), rate=1000)
        np.testing.assert_allclose([row.value for row in found.table], Q, rtol=1e-9, atol=1e-9)


def test_bases_that_move_are_refused():
    floating = jounce.load("g1", base="floating").with_limits(velocity=1.0)
    move = jounce.Motion.polynomial(np.zeros((floating.n, 1)), 1.0).with_base(None, np.eye(4))
    refusal(lambda: floating.check(move, rate=1000), "moves its base", "leave out rate and as_")


def test_the_command_judges_at_a_rate(plan_files):
    lock = ("--lock", "panda_finger_joint1=0", "--limits", "panda")
    for name, options in (("plan.csv", ("--as", "commands")), ("plan.json", ("--rate", 1000, "--differences", 3))):
        result = call("check", "panda", plan_files / name, *lock, *options)
        assert result.exit_code == 1, result.output
        assert "5 of 42 limits broken" in result.stdout
        assert "differences of commands at 1000 Hz: velocity, acceleration, jerk" in result.stdout
    found = json.loads(call("check", "panda", plan_files / "plan.csv", *lock, "--as", "commands", "--json").stdout)
    assert max(row["ratio"] for row in found["limits"]) == pytest.approx(13.3257, rel=1e-5)
    many = call("check", "panda", plan_files, *lock, "--rate", 1000)
    assert many.exit_code == 2
    assert "--rate checks a single motion" in many.stderr


def test_options_of_a_file_say_that_rows_are_commands(plan_files, tmp_path):
    log = tmp_path / "log.yaml"
    lock = ("--lock", "panda_finger_joint1=0")
    moved = call(
        "motion",
        "panda",
        plan_files / "plan.csv",
        *lock,
        "--as",
        "commands",
        "--order",
        3,
        "--save-read",
        log,
        "-o",
        tmp_path / "q.csv",
    )
    assert moved.exit_code == 0, moved.output
    assert log.read_text() == "as: commands\n"
    result = call("check", "panda", plan_files / "plan.csv", *lock, "--limits", "panda", "--read", log)
    assert "5 of 42 limits broken" in result.stdout
