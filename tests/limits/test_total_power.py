"""Limits of the power of the whole robot, against sums over dense samples of plain inverse dynamics."""

import json
import re
from functools import cache

import numpy as np
import pytest
from click.testing import CliRunner

import jounce
from jounce.cli import main
from jounce.limits.feasible_factors import polynomials
from jounce.limits.limited_motion import compute_deviations, validate_limits
from jounce.limits.retime_problem import build_problem
from support.closed_robots import fivebar_swing
from support.refusals import refusal, refusals
from support.robots import floating

MECHANICAL, ELECTRICAL = "total_power", "total_electrical_power"
MOTOR = jounce.Motor(gear=-50, inertia=1e-4, resistance=0.5, inductance=2e-3, constant=0.05)
RUBBING_MOTOR = jounce.Motor(gear=100, inertia=2e-5, resistance=0.5, constant=0.05, friction=0.02, damping=1e-4)
STIFFNESS = [800.0, 600.0]
REST_TO_REST = jounce.Motion.polynomial([[0, 0, 0, 0, 35, -84, 70, -20], [0, 0, 0, 0, 17, -42, 35, -10]], 1.0)
REST = jounce.Motion.polynomial([[0, 0, 3, -2], [0, 0, 1.5, -1]], duration=1.0)


def point_to_point(start, way, duration):
    """A motion from rest to rest, smooth up to jerk."""
    rows = [[a, 0, 0, 0, 35 * b, -84 * b, 70 * b, -20 * b] for a, b in zip(start, way, strict=True)]
    return jounce.Motion.polynomial(rows, 1.0).scaled(duration)


def arm_2r():
    return jounce.load("planar2r")


def with_joint_drives():
    m = arm_2r().mechanism
    drives = {"armature": [0.3, 0.1], "damping": [0.5, 0.3], "friction": [0.8, 0.4]}
    return jounce.Robot.from_screws(m.B, m.X, m.M, m.parent, gravity=m.gravity, drives=drives).with_drives([*drives])


def with_coupled_motors():
    return arm_2r().with_transmission([[1, 0], [1, 1]], ["a", "b"])


def with_redundant_motors():
    whole = arm_2r().with_transmission([[1, 0], [1, 1], [0, 1]], ["a", "b", "c"])
    return whole.closed(coordinates=["joint1", "joint2"], weights={"b": 2.0})


ROBOTS = {
    "iiwa14": lambda: jounce.load("iiwa14"),
    "drives": with_joint_drives,
    "elastic": lambda: arm_2r().elastic(STIFFNESS, motors=MOTOR),
    "elastic, rubbing": lambda: arm_2r().elastic(STIFFNESS, motors=RUBBING_MOTOR),
    "elastic iiwa14": lambda: jounce.load("iiwa14").elastic(5e3, motors=jounce.Motor(
        gear=100, inertia=2e-5, resistance=0.5, constant=0.05)),
    "coupled motors": with_coupled_motors,
    "redundant motors": with_redundant_motors,
    "fivebar": lambda: jounce.load("fivebar"),
    "floating": lambda: jounce.Robot(floating(arm_2r().mechanism, np.random.default_rng(3), mass=30.0)),
}  # fmt: skip
robot_of = cache(lambda name: ROBOTS[name]())


def motion_of_seed(robot, seed):
    """A motion of a robot, with a base that moves where it floats."""
    rng = np.random.default_rng(seed)
    if robot.name == "fivebar":
        return fivebar_swing().scaled(rng.uniform(0.4, 1.0))
    motion = point_to_point(rng.uniform(-0.5, 0.5, robot.n), rng.uniform(-1, 1, robot.n), rng.uniform(0.6, 1.5))
    if not robot.mechanism.floats:
        return motion
    t = np.linspace(motion.start, motion.stop, 61)
    C = np.tile(np.eye(4), (61, 1, 1))
    C[:, :3, 3] = np.sin(np.outer(t, rng.uniform(0.5, 2, 3)))
    return motion.with_base(t, C, degree=7)


def powers(robot, motion, t, kind=MECHANICAL):
    """The power of all motors together, by one call for each of its factors."""
    rates = motion(t, 5)
    if kind == ELECTRICAL:
        order = 1 if robot.mechanism.elasticity.is_inductive else 0
        # A rate of voltages with an inductance takes one more of q.
        voltages = robot.motor_voltages(*rates[: 5 + order])
        return (voltages * robot.motor_currents(*rates[:5])).sum(axis=1)
    if robot.mechanism.elasticity is not None:
        return (robot.motor_torques(*rates[:5]) * robot.motor_positions(*rates[:4])[1]).sum(axis=1)
    base = {"base": motion.base(t, 2)} if robot.mechanism.floats else {}
    Q = robot.inverse_dynamics(*rates[:3], **base)
    return (Q[:, -robot.n :] * rates[1]).sum(axis=1)


def least_and_largest(robot, motion, kind=MECHANICAL):
    """The least and the largest of 20,001 samples, and of as close ones about them."""
    t = np.linspace(motion.start, motion.stop, 20_001)
    P = powers(robot, motion, t, kind)
    ends = []
    for find in (np.argmin, np.argmax):
        i = find(P)
        near = np.linspace(t[max(i - 1, 0)], t[min(i + 1, len(t) - 1)], 201)
        close = powers(robot, motion, near, kind)
        ends.append(float(close[find(close)]))
    return ends


def total_row(robot, motion):
    [row] = [row for row in robot.check(motion).table if row.joint == "robot"]
    return row


CASES = [
    (name, kind, seed)
    for name in ROBOTS
    for kind in ((MECHANICAL, ELECTRICAL) if name.startswith("elastic") else (MECHANICAL,))
    for seed in range(6)
]


@pytest.mark.sweep(12)
@pytest.mark.parametrize(("name", "kind", "seed"), CASES)
def test_verdicts_and_ratios_are_those_of_dense_samples(name, kind, seed):
    robot, motion = robot_of(name), motion_of_seed(robot_of(name), seed)
    low, high = least_and_largest(robot, motion, kind)
    for side, extreme in enumerate((low, high)):
        if abs(extreme) < 1e-9 * max(-low, high):
            continue  # the side on which there is no power
        for share in (0.9, 1.1):
            bounds = [-np.inf, np.inf]
            bounds[side] = share * extreme
            if not bounds[0] <= 0 <= bounds[1]:
                continue  # power of the other sign all the time
            row = total_row(robot.with_limits(**{kind: bounds}), motion)
            assert (row.limit, row.unit, row.bound) == (kind, "W", bounds[side])
            assert row.ratio == pytest.approx(1 / share, rel=1e-9)
            assert row.verdict == ("broken" if share < 1 else "kept")
            assert (len(row.violations) > 0) == (share < 1)


@pytest.mark.sweep(6)
@pytest.mark.parametrize(("name", "kind", "seed"), [case for case in CASES if case[2] < 2])
def test_a_slowdown_keeps_the_limit_and_meets_it(name, kind, seed):
    robot, motion = robot_of(name), motion_of_seed(robot_of(name), seed).scaled(0.6)
    low, high = least_and_largest(robot, motion, kind)
    at_rest = powers(robot, motion.scaled(1e4), np.linspace(motion.start, motion.stop * 1e4, 201), kind).max()
    # Between the power at rest, the losses of windings that hold the robot, and that of the motion.
    upper = max(at_rest, 0) + 0.6 * (high - max(at_rest, 0))
    bounded = robot.with_limits(**{kind: (-np.inf, upper) if high > -low else (0.6 * low, np.inf)})
    slow = bounded.slowdown(motion)
    assert (slow.binding.joint, slow.binding.limit) == ("robot", kind)
    reached = max(
        least_and_largest(robot, slow.motion, kind)[side] / bounded.limits.bounds(kind)[side, 0] for side in (0, 1)
    )
    assert 0.999999 < reached < 1 + 1e-8
    assert slow.factor < 1


RETIMED = [(name, MECHANICAL) for name in ROBOTS if not name.startswith("elastic")]
RETIMED += [("elastic iiwa14", MECHANICAL), ("elastic iiwa14", ELECTRICAL), ("elastic", MECHANICAL)]


@pytest.mark.sweep(4)
@pytest.mark.parametrize(("name", "kind"), RETIMED)
def test_a_retiming_keeps_the_limit_and_meets_it(name, kind):
    robot, motion = robot_of(name), motion_of_seed(robot_of(name), 1)
    if name == "fivebar":  # from rest to rest, near its start
        motion = point_to_point([2.2, 0.94], [0.15, -0.2], 0.5)
    low, high = least_and_largest(robot, motion, kind)
    at_rest = max(powers(robot, motion.scaled(1e4), np.linspace(0, 1e4 * motion.duration, 201), kind).max(), 0)
    most = 0.6 * max(-low, high - at_rest)
    bounds = min(0.6 * low, -0.1 * most), at_rest + max(0.6 * (high - at_rest), 0.1 * most)
    bounded = robot.with_limits(**{kind: bounds})
    fast, slow = bounded.retime(motion, margin=0.005), bounded.slowdown(motion, up_to_limits=True)
    assert {(part.joint, part.limit) for part in fast.binding} == {("robot", kind)}
    assert 0.99 < (np.array(least_and_largest(robot, fast.motion, kind)) / bounds).max() < 1
    assert fast.duration < slow.motion.duration


def test_powers_of_motors_along_a_path_are_quadratic_forms():
    """Their values, and their derivatives by the jets of the time law."""
    robot, motion = robot_of("elastic iiwa14"), motion_of_seed(robot_of("elastic iiwa14"), 0)
    problem = build_problem(robot.with_limits(total_power=1.0, total_electrical_power=2.0), motion, 1.0)
    sigma = np.linspace(0.1, 0.9, 7) * motion.duration
    rows = problem.rows_at(sigma, 100.0)
    assert rows.kinds == ("velocity", MECHANICAL, ELECTRICAL)
    for speed in (0.5, 1.0):
        scaled = motion.scaled(1 / speed)
        for column, kind in enumerate((MECHANICAL, ELECTRICAL), start=1):
            exact = powers(robot, scaled, sigma / speed, kind)
            found = column * rows.uniform(speed)[:, column]
            np.testing.assert_allclose(found, exact, rtol=0, atol=1e-10 * np.abs(exact).max())
    jet, h = np.random.default_rng(1).uniform(0.5, 1.5, (4, 7)), 1e-5
    gradients, hessians = rows.power.derivatives(jet)
    for i in range(4):
        step = np.zeros((4, 1))
        step[i] = h
        ahead, back = ((rows.power.products(x), rows.power.derivatives(x)[0]) for x in (jet + step, jet - step))
        for exact, *ends in ((gradients[:, i], ahead[0], back[0]), (hessians[:, :, i], ahead[1], back[1])):
            difference = (ends[0] - ends[1]) / (2 * h)
            np.testing.assert_allclose(difference, exact, rtol=0, atol=1e-8 * np.abs(hessians).max())


def test_electrical_power_is_the_sum_of_current_times_voltage():
    """By the quantities along a motion, whose rates take an inductance."""
    robot = robot_of("elastic").with_limits(total_electrical_power=1e3)
    t = np.linspace(REST.start, REST.stop, 101)
    along = robot.motors_along(point_to_point([0, 0], [1, 0.5], 1.0), t, order=1)
    b = validate_limits(robot, point_to_point([0, 0], [1, 0.5], 1.0))
    expected = (along.currents[0] * along.voltages[0]).sum(axis=1)
    np.testing.assert_allclose(b.values(t)[ELECTRICAL][:, 0], expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize(("name", "kind"), [(name, kind) for name, kind, seed in CASES if seed == 0])
def test_sums_are_polynomials_of_the_speed(name, kind):
    robot, motion = robot_of(name), motion_of_seed(robot_of(name), 2)
    if name in ("drives", "elastic, rubbing", "floating"):
        return  # Coulomb friction is no polynomial; a base has a speed of its own
    t = np.linspace(motion.start, motion.stop, 7)
    c = polynomials(validate_limits(robot.with_limits(**{kind: 1e6}), motion), t)[kind]
    for speed in (0.3, 1.7):
        scaled = motion.scaled(1 / speed)
        exact = powers(robot, scaled, scaled.start + (t - motion.start) / speed, kind)
        found = sum(x[:, 0] * speed**k for k, x in enumerate(c))
        np.testing.assert_allclose(found, exact, rtol=0, atol=1e-9 * np.abs(exact).max())


@pytest.mark.parametrize("name", ["iiwa14", "drives", "elastic", "fivebar", "redundant motors"])
def test_rates_are_those_of_differences(name):
    robot, motion, h = robot_of(name).with_limits(total_power=1e6), motion_of_seed(robot_of(name), 3), 1e-3
    b = validate_limits(robot, motion)
    t = np.linspace(motion.start + 5 * h, motion.stop - 5 * h, 9)
    P, slope = (x[:, 0] for x in b.channels(t)[MECHANICAL].rates[:2])
    np.testing.assert_allclose(P, powers(robot, motion, t), rtol=1e-12, atol=1e-12 * np.abs(P).max())
    weights = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0, 4 / 5, -1 / 5, 4 / 105, -1 / 280]) / h
    stencil = sum(w * powers(robot, motion, t + k * h) for k, w in zip(range(-4, 5), weights, strict=True))
    np.testing.assert_allclose(stencil, slope, atol=1e-6 * np.abs(slope).max())


def test_motors_share_the_power_of_the_joints():
    """Q_u . u' in either coordinates: what joints take, motors deliver."""
    values = [total_row(robot_of(name).with_limits(total_power=10), REST).value for name in ("coupled motors",)]
    values.append(total_row(arm_2r().with_limits(total_power=10), REST).value)
    values.append(total_row(with_redundant_motors().with_limits(total_power=10), REST).value)
    np.testing.assert_allclose(values, values[0], rtol=1e-12)


def test_one_joint_may_use_what_another_one_takes_back():
    """The sum may be kept where a limit of each joint is broken."""
    robot, motion = arm_2r(), point_to_point([0.0, 0.0], [1.0, -2.0], 0.7)
    t = np.linspace(0, motion.duration, 2001)
    q, qd, q2d = motion(t, 2)
    each = np.abs(robot.inverse_dynamics(q, qd, q2d) * qd).max(axis=0)
    low, high = least_and_largest(robot, motion)
    assert max(-low, high) < each.max()
    found = robot.with_limits(power=0.99 * each, total_power=1.01 * max(-low, high)).check(motion)
    assert [row.verdict for row in found.table] == ["broken", "broken", "kept"]
    assert [row.joint for row in found.table] == [*robot.joint_names, "robot"]


def test_the_verdict_says_which_power_counts():
    def note(robot, **limits):
        return robot.with_limits(**limits).check(motion_of_seed(robot, 0)).notes[-1]

    assert note(robot_of("iiwa14"), total_power=1) == (
        "total power is the sum of Q qd of all motors, with no terms of drives in Q"
    )
    assert "with armature, damping, friction in Q" in note(robot_of("drives"), total_power=1)
    assert "the motors a, b, c" in note(robot_of("redundant motors"), total_power=1)
    assert note(robot_of("floating"), total_power=1).endswith("in Q, and no motor at the base")
    assert "tau thetad of all motors behind springs" in note(robot_of("elastic"), total_power=1)
    assert "i u of all motors" in note(robot_of("elastic"), total_electrical_power=1)


def test_a_jump_makes_the_power_of_motors_behind_springs_infinite():
    jerky = jounce.Motion.trapezoidal([[0, 0], [1, 1]], 2.0, 10.0)
    robot = robot_of("elastic").with_limits(total_power=1e6)
    assert np.isinf(total_row(robot, jerky).ratio)
    refusal(lambda: robot.slowdown(jerky), "break at", "total power of the robot is infinite")
    rigid = arm_2r().with_limits(total_power=1e6)
    assert np.isfinite(total_row(rigid, jerky).ratio)
    assert np.isinf(
        total_row(
            rigid, jounce.Motion.polynomial([[0, 1]] * 2, 1.0) + jounce.Motion.polynomial([[1, 0]] * 2, 1.0)
        ).ratio
    )


@pytest.mark.parametrize("name", ["iiwa14", "drives", "elastic"])
def test_deviations_bound_the_errors_of_measured_motions(name):
    robot = robot_of(name)
    truth, t = motion_of_seed(robot, 4).scaled(4.0), None
    t = np.linspace(truth.start, truth.stop, 2001)
    noise = np.random.default_rng(0).normal(0, 1e-5, (len(t), robot.n))
    measured = jounce.Motion.fit(t, truth(t, 0)[0] + noise)
    low, high = least_and_largest(robot, truth)
    bounds = {"kept": 1.5, "broken": 0.6, "undecided": 1.0}
    middle = np.linspace(0.25, 0.75, 41) * truth.duration
    bounded = robot.with_limits(total_power=max(-low, high))
    off = compute_deviations(validate_limits(bounded, measured), middle)[MECHANICAL][:, 0]
    found = powers(robot, measured, middle)
    assert (np.abs(found - powers(robot, truth, middle)) < 4 * off).all()
    assert (off < 0.05 * max(-low, high)).all()
    for verdict, share in bounds.items():
        assert total_row(robot.with_limits(total_power=share * max(-low, high)), measured).verdict == verdict


def test_commands_are_judged_by_their_differences():
    robot, motion = arm_2r().with_limits(total_power=(-5.0, 30.0)), point_to_point([0, 0], [1, 1], 1.0)
    found = robot.check(motion, rate=1000)
    q = motion(np.arange(1001) / 1000, 0)[0]
    q = np.concatenate([q[:1], q, q[-1:], q[-1:], q[-1:]])
    qd = np.diff(q, axis=0, prepend=q[:1]) * 1000
    q2d = np.diff(qd, axis=0, prepend=qd[:1]) * 1000
    P = (arm_2r().inverse_dynamics(q, qd, q2d) * qd).sum(axis=1)
    [row] = found.table
    assert row.value in (pytest.approx(P.min(), rel=1e-9), pytest.approx(P.max(), rel=1e-9))
    assert row.ratio == pytest.approx(max(P.min() / -5, P.max() / 30), rel=1e-9)
    explained = robot.explain(motion, rate=1000)
    assert {(trip.joint, trip.limit) for trip in explained.trips} == {("robot", "total power")}
    slow = robot.slowdown(motion, rate=1000)
    assert 0.99 < robot.check(slow.motion, rate=1000).worst.ratio <= 1
    assert slow.binding.joint == "robot"


def test_files_and_other_robots_keep_the_limits(tmp_path):
    robot = arm_2r().with_limits(total_power=(-200, 500), total_electrical_power=300, velocity=2)
    for suffix in ("yaml", "json"):
        jounce.save(robot, tmp_path / f"arm.{suffix}")
        assert jounce.load(tmp_path / f"arm.{suffix}") == robot
    limits = robot.limits
    assert (limits.total_power, limits.total_electrical_power) == (500, 300)
    assert limits.bounds(MECHANICAL).tolist() == [[-200], [500]]
    assert limits.kinds == ("velocity", MECHANICAL, ELECTRICAL)
    assert limits.stated_totals == {MECHANICAL: [-200, 500], ELECTRICAL: 300}
    for other in (
        arm_2r().with_limits(limits),
        robot.with_limits(effort=3),
        arm_2r().with_limits(**{kind: limits.bounds(kind) for kind in (MECHANICAL, ELECTRICAL)}),
        robot.with_drives([]),
        robot.locked({"joint2": 0.3}),
        robot.elastic(300.0, rotor=0.1),
        robot.with_transmission([[1, 0], [1, 1]], ["a", "b"]),
    ):
        assert other.limits.totals == limits.totals
    assert robot.with_limits(total_power=np.inf, total_electrical_power=np.inf).limits.kinds == ("velocity",)
    assert robot.with_limits(total_power=(-np.inf, 3)).limits != limits


def test_files_of_limits_state_them_once(tmp_path):
    file = tmp_path / "limits.yaml"
    file.write_text("units: SI\nangles: deg\ntotal_power: [-200, null]\njoints: {joint1: {velocity: 90}}\n")
    limits = arm_2r().with_limits(file).limits
    assert limits.bounds(MECHANICAL)[:, 0].tolist() == [-200, np.inf]
    assert limits.velocity[0] == pytest.approx(np.pi / 2)
    file.write_text("units: SI\ntotal_power: 60\n")
    assert arm_2r().with_limits(file).with_limits(velocity=1).limits.total_power == 60
    for value, words in {
        "-5": "limit of total_power is -5; expected 0 or more",
        "[5, 1]": "limits of total_power are 5 and 1; expected lower <= 0 <= upper",
        ".nan": "expected a finite number",
        "[1, 2, 3]": "expected a number for the whole robot, or two: [lower, upper]; joints have limits of their own",
        "{joint1: 3}": "expected a number for the whole robot",
    }.items():
        file.write_text(f"units: SI\ntotal_power: {value}\n")
        refusal(lambda: arm_2r().with_limits(file), f"{file.name}:2: ", words)
    file.write_text("units: SI\njoints: {joint1: {total_power: 3}}\n")
    refusal(lambda: arm_2r().with_limits(file), "joint 'joint1' has no key 'total_power'")


test_bad_limits_are_refused = refusals({
    "negative": (lambda: arm_2r().with_limits(total_power=-5), ["limit of total_power is -5; expected 0 or more"]),
    "reversed": (lambda: arm_2r().with_limits(total_power=(9, 1)), ["are 9 and 1; expected lower <= 0 <= upper"]),
    "NaN": (lambda: arm_2r().with_limits(total_power=np.nan), ["limit of total_power is nan"]),
    "per joint": (lambda: arm_2r().with_limits(total_power=[1, 2, 3]), ["for the whole robot", "power=[...]"]),
    "two joints": (lambda: arm_2r().with_limits(total_power=[1, 2]), ["lower <= 0 <= upper", "power=[...]"]),
    "by name": (lambda: arm_2r().with_limits(total_power={"joint1": 3}), ["for the whole robot", "power=[...]"]),
    "text": (lambda: arm_2r().with_limits(total_power="much"), ["total_power is of type str"]),
    "rigid joints": (
        lambda: arm_2r().with_limits(total_electrical_power=5).check(REST),
        ["no limits of rigid joints, only total_electrical_power", "robot.elastic(stiffness)"],
    ),
    "motors without data": (
        lambda: arm_2r().elastic(300.0, rotor=0.1).with_limits(total_electrical_power=5).check(REST),
        ["the robot has a limit of total_electrical_power", "motor of joint 'joint1' states no constant", "motors="],
    ),
    "at rest": (
        lambda: robot_of("elastic").with_limits(total_electrical_power=1).slowdown(point_to_point([0, 0], [1, 1], 2)),
        ["the motors take a total electrical power of", "at rest", "slowing down does not help"],
    ),
    "retiming motors that rub": (
        lambda: robot_of("elastic, rubbing").with_limits(total_power=5).retime(point_to_point([0, 0], [1, 1], 2)),
        ["does not support", "(total_power) with Coulomb friction of motors", "robot.slowdown keeps them"],
    ),
    "retiming inductances": (
        lambda: robot_of("elastic").with_limits(total_electrical_power=99).retime(point_to_point([0, 0], [1, 1], 2)),
        ["does not support", "(total_electrical_power) with windings with an inductance", "robot.slowdown keeps them"],
    ),
    "retiming at rest": (
        lambda: robot_of("elastic iiwa14").with_limits(total_electrical_power=0.1).retime(
            point_to_point([0.5] * 7, [1] * 7, 2)
        ),
        ["the robot holds", "W at rest", "its total electrical power limit is 0.1 W"],
    ),
    "retiming with bounds too different": (
        lambda: robot_of("elastic").with_limits(total_power=(-22.9, 1e-3)).retime(
            motion_of_seed(robot_of("elastic"), 1)
        ),
        ["retiming fails: total power of robot", "of 0.001 W", "its bounds are too different", "margin"],
    ),
    "retiming without power": (
        lambda: arm_2r().with_limits(total_power=0).retime(point_to_point([0, 0], [1, 1], 2)),
        ["the total_power limit of the robot is 0, and it moves"],
    ),
    "jumps": (
        lambda: arm_2r().with_limits(total_power=50, velocity=3).retime(REST, smooth=False),
        ["total power", "smooth=False"],
    ),
    "guard": (
        lambda: arm_2r().with_limits(total_power=50, velocity=3).guard(point_to_point([0, 0], [1, 1], 2)),
        ["guard() supports no limits of total_power"],
    ),
})  # fmt: skip


def test_limits_in_doubt_are_undecided():
    found = arm_2r().with_limits(total_power=0).check(REST)
    assert (found.verdict, found.judged) == ("undecided", {MECHANICAL: 0.0})
    assert "the limit is 0 on both sides" in found.table[0].cause
    m = arm_2r().mechanism
    tipless = jounce.Robot.from_screws(m.B, m.X, m.M * [[[1]], [[0]]], m.parent, gravity=m.gravity)
    [row] = tipless.with_limits(total_power=1e3).check(REST).table
    assert (row.verdict, "moves no inertia" in row.cause) == ("undecided", True)
    assert tipless.with_limits(total_power=1e3, velocity=1).slowdown(REST).binding.limit == "velocity"


def test_a_forces_table_tells_of_the_limit():
    """`run` looks at the rows of Q alone, and knows the sum where Q is of motors."""
    from jounce.limits.samples import find_worst_broken, reported_limits

    t = np.linspace(REST.start, REST.stop, 2001)
    q, qd, q2d = REST(t, 2)
    for robot in (arm_2r(), robot_of("floating")):
        still = {"base": (np.tile(np.eye(4), (len(t), 1, 1)), *np.zeros((2, len(t), 6)))}
        Q = robot.inverse_dynamics(q, qd, q2d, **(still if robot.mechanism.floats else {}))
        P = (Q[:, -2:] * qd).sum(axis=1)
        bounded = robot.with_limits(total_power=0.5 * np.abs(P).max())
        worst = find_worst_broken(reported_limits(bounded.mechanism), t, (q, qd, q2d), (Q,))
        assert (worst.kind, worst.joint, worst.ratio) == (MECHANICAL, 0, pytest.approx(2))
    with pytest.warns(jounce.JounceWarning, match="limits of total_power are of motors, which Q is not of"):
        assert reported_limits(robot_of("elastic").with_limits(total_power=1).mechanism).kinds == ()


def test_an_excitation_keeps_the_limit():
    robot = arm_2r().with_limits(velocity=3, effort=200, total_power=(-20, 40))
    excited = robot.excite(period=4.0, harmonics=3, starts=1, seed=0)
    low, high = least_and_largest(robot, excited.motion)
    assert -20 <= low < 0 < high <= 40


def test_pages_and_commands_show_it(tmp_path):
    def run(*words):
        return CliRunner().invoke(main, list(map(str, words)))

    (tmp_path / "limits.yaml").write_text("units: SI\ntotal_power: [-50, 100]\n")
    robot = arm_2r().with_limits(tmp_path / "limits.yaml")
    jounce.save(robot, tmp_path / "arm.yaml")
    assert "total power of the robot: -50 .. 100 W" in run("info", tmp_path / "arm.yaml").output
    assert json.loads(run("info", tmp_path / "arm.yaml", "--json").output)["limits"][MECHANICAL] == [-50, 100]
    broken = run("check", "iiwa14", "paper", "--limits", tmp_path / "limits.yaml")
    assert (broken.exit_code, "total power is the sum of Q qd of all motors" in broken.output) == (1, True)
    assert "total power  robot" in broken.output
    assert "total power of the robot: -50 .. 100 W" in robot._repr_html_()
    page = tmp_path / "report.html"
    run("report", "iiwa14", "paper", "--limits", tmp_path / "limits.yaml", "-o", page)
    text = page.read_text(encoding="utf-8")
    assert "total power in W: from -152.91 (robot, t = " in text
    assert "total power is the sum of Q qd of all motors" in text
    # Of elastic robots the sums follow from the curves of their motors.
    robot_of("elastic").with_limits(total_power=50, total_electrical_power=200).report(REST_TO_REST).save(page)
    text = page.read_text(encoding="utf-8")
    shown = re.search(r"total electrical power in W: from (\S+) \(robot, t = [^)]*\) to (\S+) \(", text)
    ends = least_and_largest(robot_of("elastic"), REST_TO_REST, ELECTRICAL)
    assert [float(x) for x in shown.groups()] == pytest.approx(ends, rel=1e-3)
