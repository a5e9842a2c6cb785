"""Why a controller stops a motion: cases after public threads on Franka arms, and what is not predicted."""

import json
import shlex
from math import pi

import numpy as np
import pytest
from scipy.special import erf

import jounce
from jounce.limits import explanation
from support.commands import call
from support.refusals import refusal

HOME = np.array([0, -0.785, 0, -2.356, 0, 1.571, 0.785])
WAY = np.array([0.5, 0.2, 0, 0.3, 0, 0, 0.2])
PANDA = jounce.load("panda", lock={"panda_finger_joint1": 0.0})
T = np.arange(2001) / 1000


def quintic(way, duration, home=HOME):
    """From rest to rest, accelerations zero at both ends and jerks not."""
    powers = np.array([0, 0, 0, 10, -15, 6]) / duration ** np.arange(6)
    return jounce.Motion.polynomial(home[:, None] * np.eye(6)[0] + way[:, None] * powers, duration)


def commands_of(q, t=None, robot=PANDA, **more):
    """A table of commands, a row per millisecond."""
    t = np.arange(len(q)) / 1000 if t is None else t
    columns = {"t": t, **dict(zip(robot.joint_names, np.transpose(q), strict=True)), **more}
    return jounce.load_motion(columns, robot, 1, as_="commands")


def first_trip(motion, robot=PANDA, **options):
    found = robot.explain(motion, **(options or {"controller": "franka"}))
    return found, found.trips[0] if found.trips else None


@pytest.fixture
def causes_alone(monkeypatch):
    """Without the search for time laws that cure trips, which takes most of the time."""
    monkeypatch.setattr(explanation, "_try_cures", lambda *_: [])


def cured(found):
    return {cure.method: cure.works for cure in found.cures}


def test_a_quintic_that_is_too_short_trips_and_a_long_one_does_not():
    """libfranka #219: both ends at rest, and peaks beyond the limits of acceleration."""
    found, trip = first_trip(quintic(WAY, 0.35))
    peak = 0.35 * (0.5 - np.sqrt(3) / 6)  # of the acceleration of joint 1
    assert (trip.joint, trip.limit, trip.cause) == ("panda_joint1", "acceleration", "too fast")
    assert 0.02 < trip.t < peak < trip.stop
    assert trip.ratio == pytest.approx(10 / np.sqrt(3) * 0.5 / 0.35**2 / 15, rel=1e-3)
    assert cured(found) == {"slowdown": True, "retime": True}
    factor = float(found.cures[0].words.split()[0])
    kept = PANDA.with_limits("panda").check(quintic(WAY, 0.35).scaled(1 / factor), rate=1000)
    assert 0.95 < kept.worst.ratio <= 1 + 1e-3
    found, trip = first_trip(quintic(WAY, 3.0))
    assert (found.trips, found.cures) == ((), ())


def test_the_jerk_of_a_polynomial_jumps_in_its_first_commands():
    """franka_ros2 #127: within velocity and acceleration, and the jerk begins at once at 60 d / T^3 = 30 rad/s^3."""
    arm = PANDA.with_limits(velocity=2.0, acceleration=7.5, jerk=20.0, effort=np.inf)
    found, trip = first_trip(quintic(WAY, 1.0), arm, rate=1000)
    assert (trip.joint, trip.limit, trip.cause) == ("panda_joint1", "jerk", "jump")
    assert trip.t == 0.002  # the third difference is 1/6, 5/6 and all of it
    assert "the jerk of panda_joint1 jumps by 29" in trip.words
    assert cured(found)["slowdown"]


@pytest.mark.usefixtures("causes_alone")
def test_velocities_that_jump_between_segments_trip_at_the_waypoints():
    """franka_ros2 #168, #174: waypoints joined by straight lines."""
    way = np.concatenate([np.zeros(50), np.linspace(0, 0.02, 101)[1:], np.linspace(0.02, 0.06, 101)[1:], 50 * [0.06]])
    found, _ = first_trip(commands_of(HOME + way[:, None] * np.eye(7)[1]))
    assert [(trip.joint, trip.limit, trip.t, trip.cause) for trip in found.trips] == [
        ("panda_joint2", "jerk", t, "jump") for t in (0.05, 0.15, 0.25)
    ]
    assert found.trips[0].words == "the velocity of panda_joint2 jumps by 0.2 rad/s"


def test_trapezoids_trip_by_torque_rates_alone_at_high_jerk_limits():
    found, trip = first_trip(jounce.Motion.trapezoidal([HOME, HOME + 0.3], 0.5, 2.0))
    assert [(of.cause, of.limit, of.t) for of in found.trips[:2]] == [
        ("torque rate", "effort rate of Q - Qgrav", 0.001), ("torque rate", "effort rate of Q - Qgrav", 0.251)
    ]  # fmt: skip
    assert "limits of velocity, acceleration, jerk are kept there" in trip.words
    assert cured(found) == {"slowdown": True, "retime": False}
    assert "motion.blended(time" in found.cures[1].words


def commands_of_two_joints(q, limit):
    """Commands of the first joint of a small arm with a limit of acceleration, and the cause for which it is broken."""
    arm = jounce.load("planar2r").with_limits(acceleration=limit)
    return first_trip(commands_of(np.transpose([q, 0 * q]), robot=arm), arm, rate=1000)[1]


@pytest.mark.usefixtures("causes_alone")
@pytest.mark.parametrize(("width", "cause"), [(0.002, "jump"), (0.0025, "too fast"), (0.004, "too fast")])
def test_an_acceleration_that_swells_within_some_periods_is_no_jump(width, cause):
    """A bell of acceleration, whose velocity changes by more than its slopes before and after make of it.

    A bell of two periods cannot be told from a jump: its velocity changes by 1.6 times what the slopes make.
    """
    x = (np.arange(400) / 1000 - 0.2) / width
    q = 10 * width**2 * np.sqrt(pi) / 2 * (x * (1 + erf(x)) + np.exp(-(x**2)) / np.sqrt(pi))
    assert commands_of_two_joints(q, 0.95 * np.diff(q, 2).max() * 1e6).cause == cause


@pytest.mark.usefixtures("causes_alone")
@pytest.mark.parametrize(("share", "cause"), [(0.3, "too fast"), (0.6, "jump"), (0.8, "jump")])
def test_a_velocity_that_jumps_amid_an_acceleration_is_a_jump(share, cause):
    """By a share of the change that the acceleration makes in the four periods around it; half of it is the bound."""
    t = np.arange(400) / 1000
    trip = commands_of_two_joints(4 * t**2 / 2 + share * 4 * 0.004 * (t - 0.2).clip(0), 5.0)
    assert (trip.t, trip.cause) == (0.201, cause)


@pytest.mark.usefixtures("causes_alone")
@pytest.mark.parametrize("power", [0, 1])
@pytest.mark.parametrize(("share", "cause"), [(0.7, "too fast"), (1.5, "jump")])
def test_what_rounding_leaves_after_a_spike_is_no_jump(power, share, cause):
    """The position, or the velocity by what rounding makes of it in a period, is another after a spike at rest."""
    i = np.arange(400)
    x = (i / 190).clip(0, 1)
    q = 2 + 2 * (10 * x**3 - 15 * x**4 + 6 * x**5) + 0.01 * (i == 200)
    q += share * explanation.ROUNDING_OF_Q * 4 * 2**power * (i > 200) * (i - 200) ** power
    arm = jounce.load("planar2r").with_limits(jerk=1e6)
    assert first_trip(commands_of(np.transpose([q, 0 * q]), robot=arm), arm, rate=1000)[1].cause == cause


def ramp(speed=1.0, periods=100, count=400):
    """Steps of the commands of a joint in mrad, 1 ms each, from rest evenly up to a speed in rad/s."""
    return speed * np.minimum(np.arange(count) / periods, 1)


def of_steps(steps, others=0.0, late=(), torques=None, **limits):
    """The first trip of commands of two joints by their steps in mrad; stamps of some are a period late."""
    arm = jounce.load("planar2r").with_limits(**limits)
    steps = np.stack([steps, others + 0 * steps], axis=1)
    t = np.arange(len(steps)) + np.isin(np.arange(len(steps)), late).cumsum()
    more = {} if torques is None else {"joint1.tau": torques}
    return first_trip(commands_of(np.cumsum(1e-3 * steps, axis=0), t / 1000, arm, **more), arm, rate=1000)[1]


@pytest.mark.usefixtures("causes_alone")
@pytest.mark.parametrize(
    ("k", "late", "limits", "cause"),
    [  # a step grows by 0.3 mrad at command k, and the stamp of one is late
        (201, 199, {"acceleration": 100}, "jump"),
        (201, 200, {"acceleration": 100}, "late command"),  # its step enters the second difference of k
        (201, 201, {"acceleration": 100}, "late command"),
        (201, 202, {"acceleration": 100}, "jump"),
        (201, 50, {"acceleration": 100}, "jump"),
        (3, 2, {"acceleration": 100}, "late command"),
        (399, 398, {"acceleration": 100}, "late command"),  # of 400 commands
        (201, 200, {"velocity": 1.2}, "too fast"),
        (201, 201, {"velocity": 1.2}, "late command"),
    ],
)
def test_a_late_command_is_the_cause_where_its_step_counts(k, late, limits, cause):
    speed = 1.0 if k > 100 else 0.0
    trip = of_steps(ramp(speed) + 0.3 * (np.arange(400) >= k), late=[late], **limits)
    assert (trip.cause, trip.limit) == (cause, *limits)


@pytest.mark.usefixtures("causes_alone")
@pytest.mark.parametrize(
    ("steps", "others", "cause"),
    [  # before command 200, of it, and after it: by both joints
        ((1, 2, 1), (0, 0, 0), "late command"),
        ((1, 2, 1), (0.5, 1, 0.5), "late command"),
        ((1, 2, 1), (0.5, 0.5, 0.5), "too fast"),  # the other one goes on evenly
        ((0.85, 2, 1.15), (0, 0, 0), "late command"),  # a fifth of the step is the bound of what fits
        ((0.75, 2, 1.25), (0, 0, 0), "jump"),
        ((0.85, 2, 0.85), (0, 0, 0), "late command"),
        ((0.75, 2, 0.75), (0, 0, 0), "too fast"),
        ((1, 0, 1), (0, 0, 0), "repeated command"),
        ((1, 0, 1), (0.5, 0, 0.5), "repeated command"),
        ((1, 0, 1), (0.5, 0.5, 0.5), "too fast"),
    ],
)
@pytest.mark.parametrize("limit", [100, (-100, np.inf), (-np.inf, 100)])
def test_steps_that_a_missing_or_repeated_command_makes(steps, others, cause, limit):
    """Whichever of its differences is beyond its limit."""
    every = [ramp(of[0]) for of in (steps, others)]
    for column, of in zip(every, (steps, others), strict=True):
        column[200], column[201:] = of[1:]
    trip = of_steps(*every, acceleration={"joint1": limit})
    first_one = (200 if steps[1] > 1 else 201) if limit != (-100, np.inf) else (201 if steps[1] > 1 else 200)
    assert (trip.t, trip.cause) == (200e-3 if limit == 100 else 1e-3 * first_one, cause)


@pytest.mark.usefixtures("causes_alone")
@pytest.mark.parametrize(("units", "cause"), [(6.4, "repeated command"), (3.2, "rounding")])
def test_four_steps_of_an_encoder_show_that_a_command_is_repeated(units, cause):
    steps = ramp(units)
    steps[200] = 0
    q = 1e-5 * np.cumsum(steps).round()
    assert commands_of_two_joints(q, 25.0).cause == cause


@pytest.mark.usefixtures("causes_alone")
def test_the_worst_of_limits_that_are_broken_at_once():
    """Of motion before those of forces, whose share is larger."""
    step = np.arange(400) >= 201
    for shares in ((0.3, 0.5), (0.5, 0.3)):
        trip = of_steps(ramp() + shares[0] * step, ramp() + shares[1] * step, acceleration=100, effort_rate=1e5)
        assert (trip.joint, trip.limit) == (f"joint{1 + np.argmax(shares)}", "acceleration")
        assert (trip.value, trip.bound) == (pytest.approx(500), 100)
        assert trip.ratio > 5.01  # of the torque rate
    trip = of_steps(ramp() - 0.3 * step, acceleration=[[-100, np.inf], [-np.inf, np.inf]])
    assert (trip.value, trip.bound, trip.ratio) == (pytest.approx(-300), -100, pytest.approx(3))


@pytest.mark.usefixtures("causes_alone")
@pytest.mark.parametrize(("limit", "cause"), [(70, "too fast"), (90, "torque rate")])
def test_a_motion_limit_broken_three_commands_later_is_the_cause(limit, cause):
    """From command 350 on accelerations rise by 20 rad/s^2 in each: the torque rate is broken at once."""
    k = np.arange(400)
    steps = ramp(periods=300) + 0.02 * np.maximum(k - 349, 0).cumsum()
    trip = of_steps(steps, acceleration={"joint1": limit}, jerk=1e9, effort_rate={"joint1": 3e4})
    assert (trip.limit, trip.t, trip.cause) == ("effort rate", 0.35, cause)
    assert trip.ratio == pytest.approx(50 * 20 / limit)  # of the acceleration, at the last command


@pytest.mark.usefixtures("causes_alone")
def test_a_first_torque_off_the_rest_before_is_a_start():
    trip = of_steps(0 * ramp(), torques=np.full(400, 5.0), effort_rate=1000, of={"effort_rate": "Q - Qgrav"})
    assert (trip.t, trip.cause, trip.value) == (0, "start", pytest.approx(5000))
    assert trip.words == "the first torque of joint1 is not that of the rest before it"


@pytest.mark.usefixtures("causes_alone")
@pytest.mark.parametrize(("share", "cause"), [(0.15, "rounding"), (0.06, "jump")])
def test_rounding_above_a_tenth_of_the_jerk_is_the_cause(share, cause):
    """Commands of joint 1 in steps of 1e-9 rad: their third differences are up to 4 rad/s^3 off."""
    t = np.arange(1001) / 1000
    q = (4 / share - 4) / 60 * (10 * t**3 - 15 * t**4 + 6 * t**5)
    arm = jounce.load("planar2r").with_limits(effort_rate={"joint1": 40.0})
    trip = first_trip(commands_of(np.transpose([q.round(9), 0 * q]), robot=arm), arm, rate=1000)[1]
    assert trip.cause == cause


@pytest.mark.usefixtures("causes_alone")
def test_an_acceleration_that_jumps_breaks_a_lower_jerk_limit():
    arm = PANDA.with_limits(jerk=500.0, effort=np.inf)
    found, trip = first_trip(jounce.Motion.trapezoidal([HOME, HOME + 0.3], 0.5, 2.0), arm, rate=1000)
    assert [(of.t, of.cause) for of in found.trips] == [(t, "jump") for t in (0.001, 0.251, 0.601, 0.851)]
    assert trip.words.endswith(" jumps by 2 rad/s^2")


def test_a_first_command_off_the_measured_position_trips_at_once():
    """franka_ros2 #55, libfranka #169."""
    measured = HOME + 0.001 * np.eye(7)[3]
    found, trip = first_trip(quintic(WAY, 2.0), controller="franka", start=measured)
    assert (trip.joint, trip.limit, trip.t, trip.cause) == ("panda_joint4", "jerk", 0.0, "start")
    assert trip.words == "panda_joint4 begins off the state before: its position jumps by -0.001 rad"
    assert found.cures == ()
    assert "slowdown and retime do not help against: start" in found.notes
    assert not first_trip(quintic(WAY, 2.0), controller="franka", start=HOME)[0].trips
    assert "start states" in first_trip(quintic(WAY, 2.0))[0].unpredicted[-2]


def test_a_lost_packet_doubles_a_difference():
    """frankx #14, #22, #51: the generator goes on by the true period, 2 ms; with stamps, and without."""
    t = np.delete(T, 700)
    q = quintic(WAY, 2.0)(t, 0)[0]
    found, trip = first_trip(commands_of(q, t))
    assert (trip.joint, trip.limit, trip.t, trip.cause) == ("panda_joint1", "jerk", 0.701, "late command")
    assert trip.words == "the command of t = 0.701 s comes 2 periods after the one before"
    found, trip = first_trip(commands_of(q))
    assert (trip.t, trip.cause, len(found.trips)) == (0.7, "late command", 1)
    assert "a command is missing: the step is twice those next to it" in trip.words
    assert found.cures == ()


def test_a_repeated_command_is_named():
    q = quintic(WAY, 2.0)(T, 0)[0]
    q[900] = q[899]
    found, trip = first_trip(commands_of(q))
    assert (trip.t, trip.cause, len(found.trips)) == (0.9, "repeated command", 1)
    assert trip.words == "the command of t = 0.9 s repeats the one before, while the robot moves"


def test_a_torque_step_of_feedback_is_seen_in_commanded_torques_alone():
    """libfranka #196, #9: a stiff controller whose target moves by 5 cm; the plan of positions shows nothing."""
    tau = np.where(T >= 0.3, 600 * 0.05 * np.exp(-(T - 0.3) / 0.1), 0)
    still = np.tile(HOME, (len(T), 1))
    found, trip = first_trip(commands_of(still, **{"panda_joint2.tau": tau}))
    assert (trip.joint, trip.limit, trip.t, trip.cause) == (
        "panda_joint2",
        "effort rate of Q - Qgrav",
        0.3,
        "torque step",
    )
    assert "changes by 30 N m or N in one period" in trip.words
    found, trip = first_trip(commands_of(still))
    assert trip is None
    assert "torques of feedback: torques reads" in found.unpredicted[-1]


def test_a_saturated_torque_trips_where_a_cycle_is_late():
    """franka_ros #324: steps of 0.9 N m per cycle are allowed; where a cycle is lost, the step is of two."""
    t = np.delete(T[:200], 100)
    tau = 0.9 * np.minimum(np.maximum(1000 * t - 90, 0), 20).round(9)
    found, trip = first_trip(commands_of(np.tile(HOME, (len(t), 1)), t, **{"panda_joint2.tau": tau}))
    assert (trip.joint, trip.t, trip.cause, len(found.trips)) == ("panda_joint2", 0.101, "late command", 1)
    assert trip.value == pytest.approx(1800)


def test_a_torque_rate_within_kinematic_limits_is_cured():
    """A plan of Ruckig within all kinematic limits: its torque rate is many times the limit."""
    import ruckig

    arm = PANDA.with_limits("panda")
    asked, trajectory = ruckig.InputParameter(7), ruckig.Trajectory(7)
    asked.current_position, asked.target_position = HOME.tolist(), (HOME + WAY).tolist()
    asked.max_velocity, asked.max_acceleration = arm.limits.velocity.tolist(), arm.limits.acceleration.tolist()
    asked.max_jerk = arm.limits.jerk.tolist()
    ruckig.Ruckig(7).calculate(asked, trajectory)
    found, trip = first_trip(jounce.Motion.from_ruckig(trajectory))
    assert {of.cause for of in found.trips} == {"torque rate"}
    assert trip.t <= 0.003
    assert cured(found) == {"slowdown": True, "retime": True}


@pytest.mark.usefixtures("causes_alone")
def test_the_cause_is_that_of_a_motion_limit_broken_next():
    """The torque rate is broken two periods before the jerk, whose jump is the cause of both."""
    arm = PANDA.with_limits(jerk=20.0, effort_rate=0.5, effort=np.inf)
    _, trip = first_trip(quintic(WAY, 1.0), arm, rate=1000)
    assert (trip.limit, trip.t, trip.cause) == ("effort rate", 0.001, "jump")


@pytest.mark.usefixtures("causes_alone")
def test_steps_of_rounding_are_no_repeated_commands():
    found, _ = first_trip(commands_of(quintic(0.5 * np.eye(7)[0], 2.0)(T, 0)[0].round(5)))
    assert {trip.cause for trip in found.trips} == {"rounding"}


@pytest.mark.usefixtures("causes_alone")
def test_rounded_commands_are_named():
    q = quintic(WAY, 2.0)(T, 0)[0]
    found, _ = first_trip(commands_of(q.round(6)))
    assert {trip.cause for trip in found.trips} == {"rounding"}
    arm = PANDA.with_limits(jerk=500.0, effort=np.inf)
    found, _ = first_trip(commands_of(q.round(6)), arm, rate=1000)
    assert {trip.cause for trip in found.trips} == {"rounding"}
    assert not first_trip(commands_of(q), arm, rate=1000)[0].trips


@pytest.mark.usefixtures("causes_alone")
def test_motions_that_begin_or_end_in_motion_are_named():
    found, trip = first_trip(jounce.Motion.polynomial([[h, 0.3] for h in HOME], 1.0))
    assert [(of.t, of.cause) for of in found.trips] == [(0.001, "start"), (1.001, "end")]
    assert "its velocity jumps by 0.3 rad/s" in trip.words
    found, _ = first_trip(
        jounce.load_motion("paper", jounce.load("iiwa14")), jounce.load("iiwa14").with_limits(effort=320.0), rate=1000
    )
    assert (found.trips[-1].cause, found.trips[-1].t) == ("end", 5.001)


@pytest.mark.usefixtures("causes_alone")
@pytest.mark.sweep(8)
@pytest.mark.parametrize("rate", [100, 250, 500, 1000])
@pytest.mark.parametrize("limit", [0.5, 1.0, 4.0])
@pytest.mark.parametrize("duration", [0.2, 0.3, 1.0])
def test_every_moment_that_is_named_breaks_a_limit(duration, limit, rate):
    """A moment that ends with the last commands need not go on while the last one is held, nor stop before."""
    arm = jounce.load("planar2r").with_limits(acceleration=limit)
    way = np.array([0, 0, 0, 6, -9, 3.6]) / duration ** np.arange(6)
    motion = jounce.Motion.polynomial([way, 0 * way], duration)
    t, q = motion.sampled(rate).samples
    held = np.concatenate([q[:1], q[:1], q, np.repeat(q[-1:], 3, axis=0)])
    beyond = np.abs(np.diff(held, 2, axis=0)[:, 0]) * rate**2 > limit * (1 + 1e-9)
    times = np.append(t, t[-1] + np.arange(1, 4) / rate)[beyond]
    found = arm.explain(motion, rate=rate).trips
    named = np.concatenate([times[(times > of.t - 1e-9) & (times < of.stop + 1e-9)] for of in found] or [[]])
    np.testing.assert_allclose(np.unique(named), times)
    assert all(np.abs(times - end).min() < 1e-9 for of in found for end in (of.t, of.stop))


def test_a_position_out_of_range_is_cured_by_no_time_law():
    found, trip = first_trip(quintic(pi * np.eye(7)[0], 3.0))
    assert (trip.joint, trip.limit, trip.cause, found.cures) == ("panda_joint1", "position", "position", ())


def test_the_arm_of_franka_is_that_of_the_names_of_joints():
    _, panda = explanation.select_controller("franka", ["panda_joint1"])
    _, fer = explanation.select_controller("franka", ["fer_joint1"])
    _, fr3 = explanation.select_controller("franka", ["left_fr3_joint1"])
    assert (panda, fer, fr3) == ("panda", "panda", "fr3")


def test_the_controller_of_franka_takes_third_differences():
    """Of commands of 1 kHz, as rate_limiting.h does."""
    found, _ = explanation.select_controller("franka", ["panda_joint1"])
    assert (found.rate, found.differences) == (1000.0, 3)


def test_controllers_without_public_rules_are_refused():
    motion = quintic(WAY, 2.0)
    refusal(lambda: PANDA.explain(motion, "ur"), "controller 'ur'", "franka", "rate=1000 judges")
    for options in ({}, {"controller": "franka", "rate": 1000}):
        refusal(lambda options=options: PANDA.explain(motion, **options), "either controller='franka'", "rate=1000")
    for start in ([0.0], [np.nan] * 7, [np.nan, *HOME[1:]], "home"):
        refusal(lambda start=start: PANDA.explain(motion, "franka", start=start), "start")


def test_the_command_explains(tmp_path):
    path = tmp_path / "log.csv"
    t = np.delete(T, 700)
    header = ",".join(["t", *PANDA.joint_names])
    np.savetxt(path, np.column_stack([t, quintic(WAY, 2.0)(t, 0)[0]]), "%.17g", ",", header=header, comments="")
    arguments = (
        "explain",
        "panda",
        path,
        "--lock",
        "panda_finger_joint1=0",
        "--as",
        "commands",
        "--controller",
        "franka",
    )
    result = call(*arguments)
    assert result.exit_code == 1, result.output
    lines = result.stdout.splitlines()
    assert lines[0].endswith(
        "panda_joint1 exceeds its jerk limit at 701 ms: the command of t = 0.701 s comes 2 periods after the one before"
    )
    assert "limits of panda, of libfranka" in result.stdout
    assert any(line.startswith("not predicted: libfranka's low-pass filter") for line in lines)
    data = json.loads(call(*arguments, "--json").stdout)
    assert (data["ok"], data["trips"][0]["cause"], data["controller"]) == (False, "late command", "franka")
    start = ",".join(map(str, HOME))
    assert call(*arguments, "--start", start).exit_code == 1
    assert "expected numbers with commas" in call(*arguments, "--start", "a,b").stderr
    assert "leave out --limits" in call(*arguments, "--limits", "panda").stderr
    kept = call("explain", "iiwa14", "paper", "--rate", 1000, "--limits", "ur5e")
    assert kept.exit_code == 2


def cured_motions(found, robot, motion):
    """The motions of the calls that an explanation names."""
    return [eval(cure.call, {"robot": robot, "motion": motion}).motion for cure in found.cures if cure.works]


@pytest.mark.parametrize("rate", [250, 500])
@pytest.mark.parametrize("differences", [2, 3])
def test_the_calls_that_are_named_cure(rate, differences):
    arm = jounce.load("planar2r").with_limits(velocity=2, acceleration=8, effort=100)
    motion = quintic(np.array([0.5, -0.6]), 0.4, np.zeros(2))
    found = arm.explain(motion, rate=rate, differences=differences)
    assert ("differences" in found.cures[0].call) == (differences != 3)
    cures = cured_motions(found, arm, motion)
    assert len(cures) == 2
    for cure in cures:
        assert not arm.explain(cure, rate=rate, differences=differences).trips
        assert arm.check(cure, rate, differences).ok


def test_the_calls_that_are_named_for_a_controller_cure():
    found, _ = first_trip(quintic(WAY, 0.35))
    assert found.cures[0].call == "robot.with_limits('panda').slowdown(motion, rate=1000)"
    for cure in cured_motions(found, PANDA, quintic(WAY, 0.35)):
        assert not PANDA.explain(cure, "franka").trips


def table_of(motion, path, *names):
    t, q = motion.sampled(500).samples
    np.savetxt(path, np.column_stack([t, q]), "%.17g", ",", header=",".join(["t", *names]), comments="")


@pytest.mark.filterwarnings("ignore:.*jumps at . knot")
@pytest.mark.parametrize(
    "options",
    [
        ("--limits", "arm limits.yaml", "--rate", "500", "--as", "commands"),
        ("--limits=arm limits.yaml", "--rate=500", "--degree", "7", "--differences", "2"),
        ("--limits", "arm limits.yaml", "--rate", "250", "--degree", "7", "--lock", "joint2=-0.5", "--json"),
    ],
)
def test_the_command_lines_that_are_named_cure(tmp_path, monkeypatch, options):
    monkeypatch.chdir(tmp_path)
    tmp_path.joinpath("arm limits.yaml").write_text(
        "units: SI\njoints:\n  joint1: {velocity: 2, acceleration: 8, effort_rate: 900}\n"
    )
    powers = np.array([0, 0, 0, 0, 35, -84, 70, -20]) / 0.5 ** np.arange(8)
    motion = jounce.Motion.polynomial(np.outer([0.5, -0.6], powers), 0.5)
    table_of(motion, "moves.csv", "joint1", "joint2")
    if "--lock" in options:
        table_of(jounce.Motion.polynomial(np.outer([0.5], powers), 0.5), "moves.csv", "joint1")
    result = call("explain", "planar2r", "moves.csv", *options)
    assert result.exit_code == 1, result.output
    if "--json" in options:
        lines = [cure["command"] for cure in json.loads(result.stdout)["cures"] if cure["works"]]
    else:
        lines = [line.strip() for line in result.stdout.splitlines() if line.startswith("  jounce")]
    assert len(lines) == 2
    for line in lines:
        _, verb, *words = shlex.split(line)
        done = call(verb, *words)
        assert done.exit_code == 0, done.output
        rate = words[words.index("--rate") + 1]
        judge = ["--limits", "arm limits.yaml", "--rate", rate]
        for option in ("--differences", "--lock"):
            judge += words[words.index(option) : words.index(option) + 2] if option in words else []
        checked = call("check", "planar2r", words[-1], *judge)
        assert checked.exit_code == 0, checked.output
        assert "every limit is kept" in checked.stdout


def test_json_has_null_for_the_ratio_to_a_limit_of_zero(tmp_path):
    (tmp_path / "limits.yaml").write_text("units: SI\njoints:\n  joint1: {velocity: [-1, 0]}\n")
    (tmp_path / "moves.csv").write_text("t,joint1,joint2\n" + "".join(f"0.0{k},0.00{k},0\n" for k in range(5)))
    result = call("explain", "planar2r", tmp_path / "moves.csv", "--as", "commands", "--rate", 100,
                 "--limits", tmp_path / "limits.yaml", "--json")  # fmt: skip
    data = json.loads(result.stdout, parse_constant=pytest.fail)
    assert (data["trips"][0]["bound"], data["trips"][0]["ratio"]) == (0, None)
