"""`slowdown` and `retime` at a controller's rate: differences of the result keep every limit, by an oracle."""

import numpy as np
import pytest

import jounce
from support.refusals import refusal

RATES = (250, 500, 1000)
ARMS = {
    "planar2r": jounce.load("planar2r").with_limits(velocity=2, acceleration=8, effort=[60, 25], effort_rate=300),
    "panda": jounce.load("panda", lock={"panda_finger_joint1": 0.0}).with_limits("panda"),
    "ur5": jounce.load("ur5").with_limits(acceleration=10.0, jerk=200.0, effort_rate=500.0),
    "iiwa14": jounce.load("iiwa14").with_limits("iiwa14").with_limits(effort_rate=400.0, acceleration=12.0),
}
HOME = {
    "planar2r": [0.2, 0.5], "panda": [0, -0.785, 0, -2.356, 0, 1.571, 0.785], "ur5": [0, -1.5, 1, 0, 0.5, 0],
    "iiwa14": [0.1, 0.5, 0.2, -1.0, 0.3, 0.8, 0.1],
}  # fmt: skip


def rest_plan(name, seed, powers=(0, 0, 0, 10, -15, 6)):
    """From rest to rest: of jerks that jump at the ends, by default."""
    rng = np.random.default_rng(seed)
    home, duration = np.array(HOME[name]), rng.uniform(0.3, 1.2)
    way = rng.uniform(-0.6, 0.6, home.size)
    return jounce.Motion.polynomial(
        home[:, None] * np.eye(len(powers))[0] + way[:, None] * np.array(powers) / duration ** np.arange(len(powers)),
        duration,
    )


def worst_share(robot, motion, rate, order=3):
    """The largest share of a limit that one loop over the commands finds, as a controller takes differences of them."""
    limits, last, share = robot.limits, None, 0.0
    count = int(np.ceil(motion.duration * rate - 1e-6)) + 1 + order  # the last one is held
    velocity, acceleration, torque = np.zeros(robot.n), np.zeros(robot.n), None
    for k in range(count):
        q = motion(min(motion.start + k / rate, motion.stop), 0)[0]
        v = (q - q if last is None else q - last) * rate
        a, j = (v - velocity) * rate, ((v - velocity) * rate - acceleration) * rate
        Q = robot.inverse_dynamics(q, v, a)
        free = Q - robot.gravity_forces(q) if limits.of("effort_rate") != "Q" else Q
        rates = {"velocity": v, "acceleration": a, "jerk": j, "effort": Q}
        if torque is None:  # that of the rest before
            torque = robot.inverse_dynamics(q, 0 * q, 0 * q) - (Q - free)
        rates["effort_rate"] = (free - torque) * rate
        for kind, value in rates.items():
            bounds = limits.bounds(kind)[1]
            kept = np.isfinite(bounds)
            share = max(share, (np.abs(value[kept]) / bounds[kept]).max(initial=0.0))
        last, velocity, acceleration, torque = q, v, a, free
    return share


@pytest.mark.parametrize("name", ARMS)
@pytest.mark.parametrize("seed", range(3))
def test_differences_of_a_slower_plan_keep_every_limit(name, seed):
    robot, rate = ARMS[name], RATES[seed]
    motion = rest_plan(name, seed, [(0, 0, 0, 10, -15, 6), (0, 0, 3, -2), (0, 0, 0, 0, 35, -84, 70, -20)][seed])
    given = worst_share(robot, motion, rate)
    slow = robot.slowdown(motion, rate)
    if given <= 1:
        assert slow.motion is motion
        return
    assert 1 - 1e-4 < worst_share(robot, slow.motion, rate) <= 1
    assert robot.check(slow.motion, rate).ok
    if seed != 1:  # whose acceleration jumps at its end, by how much in one period depends on where that begins
        assert worst_share(robot, motion.scaled(0.995 / slow.factor), rate) > 1


@pytest.mark.parametrize("name", ARMS)
@pytest.mark.parametrize("seed", range(2))
def test_differences_of_a_retimed_plan_keep_every_limit(name, seed):
    robot, rate = ARMS[name], RATES[2 * seed]
    motion = rest_plan(name, seed, (0, 0, 0, 0, 35, -84, 70, -20))
    fast = robot.retime(motion, rate=rate)
    assert worst_share(robot, fast.motion, rate) <= 1
    assert robot.check(fast.motion, rate).ok


def test_retimed_differences_that_break_a_limit_are_slowed_down():
    """At a low rate a difference is late, and torques are of a state that never was: without a margin they exceed."""
    robot, motion = ARMS["planar2r"], rest_plan("planar2r", 5, (0, 0, 0, 0, 35, -84, 70, -20))
    free = robot.retime(motion, 1e-4)
    assert worst_share(robot, free.motion, 50) > 1
    fast = robot.retime(motion, 1e-4, rate=50)
    assert fast.duration > free.duration
    assert worst_share(robot, fast.motion, 50) <= 1
    for t in np.linspace(fast.motion.start, fast.motion.stop, 9):
        np.testing.assert_allclose(
            fast.motion(t, 0)[0], motion(float(fast.law.sigma(np.array([t]))[0]), 0)[0], atol=1e-12
        )
    assert fast.binding[-1].stop <= fast.motion.stop * (1 + 1e-9)


def test_a_plan_that_is_kept_says_how_much_faster_it_could_be():
    robot, motion = ARMS["planar2r"], rest_plan("planar2r", 1).scaled(5)
    slow, fast = robot.slowdown(motion, 500), robot.slowdown(motion, 500, up_to_limits=True)
    assert slow.motion is motion
    assert slow.largest == fast.factor > 1
    assert worst_share(robot, fast.motion, 500) == pytest.approx(1, abs=1e-4)
    assert worst_share(robot, fast.motion.scaled(0.995), 500) > 1


def test_commands_are_judged_at_their_own_rate():
    """As functions of time their spline keeps limits that their differences break: one verdict, that of `check`."""
    robot = ARMS["planar2r"]
    commands = rest_plan("planar2r", 2).scaled(0.6).sampled(500)
    assert not robot.check(commands).ok
    slow = robot.slowdown(commands)
    assert robot.check(slow.motion).ok
    assert robot.check(slow.motion).notes[0].startswith("differences of commands at 500 Hz")
    assert slow.motion.samples is not None
    assert robot.slowdown(slow.motion).motion is slow.motion


@pytest.mark.parametrize(("limits", "motion", "words"), [
    ({"effort": [20, 50]}, [[0.0, 0.3], [0.5, 0.2]], ["cannot hold itself up", "slowing down does not help"]),
    ({"upper": [0.1, 1]}, [[0.0, 0.3], [0.5, 0.2]], ["is at", "beyond its limit of 0.1 rad"]),
])  # fmt: skip
def test_what_slowing_down_does_not_help_is_refused_at_a_rate(limits, motion, words):
    robot = jounce.load("planar2r").with_limits(**limits)
    refusal(lambda: robot.slowdown(jounce.Motion.polynomial(motion, 1.0), 500), *words)


def test_a_limit_of_0_decides_no_speed_at_a_rate():
    robot = jounce.load("planar2r").with_limits(velocity=[0, 1])
    motion = jounce.Motion.polynomial([[0.0, 0.3], [0.5, 0.2]], 1.0)
    slow = robot.slowdown(motion, 500)
    assert (slow.verdict, slow.motion) == (robot.check(motion, rate=500).verdict, motion)


def test_ends_in_motion_are_cured_by_speeds_that_are_as_low_as_that():
    robot = jounce.load("planar2r").with_limits(acceleration=20.0)
    motion = jounce.Motion.polynomial([[0.0, 0.3], [0.5, 0.2]], 1.0)
    slow = robot.slowdown(motion, 500)
    assert slow.factor == pytest.approx(20 / (0.3 * 500), rel=1e-5)  # the first difference of 0.3 rad/s at once
    assert worst_share(robot, slow.motion, 500) <= 1


@pytest.mark.parametrize("options", [{"rate": 0}, {"rate": "1 kHz"}, {"rate": 500, "differences": 5}])
def test_rates_that_are_none_are_refused(options):
    robot, motion = ARMS["planar2r"], rest_plan("planar2r", 1)
    refusal(lambda: robot.slowdown(motion, **options), next(reversed(options)))
    refusal(lambda: robot.retime(motion, **options), next(reversed(options)))
