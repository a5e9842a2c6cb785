"""`slowdown` and `retime` at a controller's rate: differences of the result keep every limit, by an oracle."""

import numpy as np
import pytest

import jounce
from jounce.limits import tried_speeds
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


@pytest.mark.sweep(4)
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
    fast = robot.with_limits(velocity=[0, 0.3]).slowdown(motion, 500, up_to_limits=True)
    assert (fast.factor, fast.binding[:2]) == (pytest.approx(1.5, rel=1e-5), ("joint2", "velocity"))


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


def one_joint_quintic(way, duration, start=0.0):
    """One joint of two from rest to rest: its velocity is largest in the middle, 15/8 of the mean."""
    powers = np.array([0, 0, 0, 10, -15, 6]) / duration ** np.arange(6)
    return jounce.Motion.polynomial(np.outer([way, 0], powers), duration, start=start)


@pytest.mark.parametrize("rate", [400, 500])
def test_the_limit_that_a_speed_at_a_rate_meets(rate):
    """To a millionth, which rounded tables leave, and when in the given motion; the result is no table of commands."""
    motion, robot = one_joint_quintic(0.4, 0.5, start=7.0), jounce.load("planar2r").with_limits(velocity=0.9)
    slow = robot.slowdown(motion, rate)
    assert slow.factor == pytest.approx(0.9 / (15 / 8 * 0.4 / 0.5), rel=1e-4)
    assert robot.check(slow.motion, rate).worst.ratio == pytest.approx(1 - 1e-6, abs=2e-8)
    assert slow.binding == ("joint1", "velocity", pytest.approx(7.25, abs=1.01 / rate))
    assert slow.motion.duration == pytest.approx(0.5 / slow.factor, rel=1e-12)
    assert slow.motion.samples is None


def test_a_limit_that_the_last_command_breaks_binds_at_the_end():
    robot = jounce.load("planar2r").with_limits(acceleration=20.0)
    slow = robot.slowdown(jounce.Motion.polynomial([[0, 0, 0.45, -0.15], [0, 0, 0, 0]], 1.0), 500)  # ends at 0.45 rad/s
    assert slow.binding == ("joint1", "acceleration", 1.0)


def test_speeds_at_a_rate_on_either_side_of_those_that_break_a_limit():
    """A swing about the lowest point: gravity and inertia cancel at 0.8 of its speed; 0.35 to 0.62 break the limit."""
    arm = jounce.load("planar2r", m2=0.5).locked({"joint2": 0.0}).with_limits(effort_rate=3.4)
    sines = 0.1 * np.array([-0.5, 1, -0.5])  # of 9, 10 and 11 times: in all 1 - cos, from rest to rest
    swing = jounce.Motion.fourier(
        [-np.pi / 2], np.zeros((11, 1)), np.append(np.zeros(8), sines)[:, None], 0.3, 2 * np.pi / 0.3
    )

    def ratio(speed):
        return arm.check(swing.scaled(1 / speed), rate=50).worst.ratio

    assert ratio(0.8) < 0.5 < 1.1 < ratio(0.5)
    for speed, up, between in ((0.34, True, (0.34, 0.36)), (1.5, False, (0.95, 0.97))):
        found = arm.slowdown(swing.scaled(1 / speed), 50, up_to_limits=up).factor * speed
        assert between[0] < found < between[1]
        assert ratio(found) <= 1 < ratio(1.001 * found)


@pytest.mark.parametrize("share", [1.5e-3, 0.8e-3])
def test_no_plan_is_slowed_down_more_than_a_thousand_times(share):
    """The first difference of 0.3 rad/s at once is 15 rad/s^2, and falls with the speed."""
    robot = jounce.load("planar2r").with_limits(acceleration=15 * share)
    motion = jounce.Motion.polynomial([[0.0, 0.3], [0.5, 0.0]], 0.2)
    if share > 1e-3:
        assert robot.slowdown(motion, 50).factor == pytest.approx(share, rel=1e-5)
    else:
        words = ["at 50 Hz the acceleration of joint 'joint1' is beyond its limit at t = ", "motion.blended(time)"]
        refusal(lambda: robot.slowdown(motion, 50), *words)


@pytest.mark.parametrize(("most", "works"), [(1500, False), (2500, True)])
def test_a_plan_of_too_many_commands_is_not_slowed_down(monkeypatch, most, works):
    monkeypatch.setattr(tried_speeds, "_MAX_SLOWED_COMMANDS", most)  # 100 commands, that need 20 times as many
    robot = jounce.load("planar2r").with_limits(velocity=0.9 / 20)
    motion = one_joint_quintic(0.9 * 8 / 15 * 2, 2.0)
    if works:
        assert robot.slowdown(motion, 50).factor == pytest.approx(1 / 20, rel=1e-2)
    else:
        refusal(lambda: robot.slowdown(motion, 50), "velocity of joint 'joint1' is beyond its limit")


def test_a_limit_of_0_on_the_side_that_a_plan_moves_to_is_refused():
    robot = jounce.load("planar2r").with_limits(velocity={"joint1": (-1, 0)})
    motion = jounce.Motion.polynomial([[0.0, 0.3], [0.5, 0.0]], 1.0, start=2.0)
    words = ["velocity of joint 'joint1'", "at t = 2.002 s even at 1 times the speed"]
    refusal(lambda: robot.slowdown(motion, 500), *words)


COMMANDS = one_joint_quintic(1.0, 4.0).sampled(1000)


def judged_speeds(monkeypatch, ratio):
    """Speeds of 4001 commands whose ratios to limits are a function of the factor, and the factors that are tried."""
    tried = []

    def judge(_, factor):
        tried.append(factor)
        return ratio(factor), ("velocity", 0, 0.0)

    monkeypatch.setattr(tried_speeds.CommandSpeeds, "_judge", judge)
    robot = jounce.load("planar2r").with_limits(velocity=0.1)
    return tried_speeds.find_command_speeds(robot, COMMANDS, None, 3), tried


def test_a_plan_is_slowed_down_to_two_million_commands(monkeypatch):
    """Slower, it takes too much time and memory: steps are of less than a factor of 2."""
    speeds, tried = judged_speeds(monkeypatch, lambda factor: 2.0)
    refusal(speeds.fall, "velocity of joint 'joint1' is beyond its limit")
    assert 2e6 / 2 < 4000 / min(tried) < 2e6


def test_a_speed_is_found_to_nine_digits_by_thirty_checks(monkeypatch):
    """Each of them takes as long as that of the whole plan."""
    speeds, tried = judged_speeds(monkeypatch, lambda factor: 0.5 + (factor > 1.23456))
    factor, _ = speeds.rise()
    assert 0 <= 1.23456 - factor < 4e-9
    assert len(tried) <= 30


@pytest.mark.parametrize(("share", "kept"), [(1.0, True), (1 + 1e-9, False)])
def test_a_plan_at_the_ratio_that_is_sought_is_kept(monkeypatch, share, kept):
    speeds, _ = judged_speeds(monkeypatch, lambda factor: share * tried_speeds.KEPT_RATIO)
    assert speeds.keeps() == kept


@pytest.mark.parametrize(("factor", "largest"), [(900, 900), (1500, np.inf)])
def test_no_plan_is_made_a_thousand_times_as_fast(factor, largest):
    robot = jounce.load("planar2r").with_limits(velocity=factor * 15 / 8 / 500)
    assert robot.slowdown(one_joint_quintic(1.0, 500.0), 20).largest == pytest.approx(largest, rel=2e-2)


@pytest.mark.parametrize(("factor", "largest"), [(7, 7), (11, np.inf)])
def test_a_plan_of_five_commands_is_made_no_faster(factor, largest):
    """Of 50 commands, which is a tenth of them."""
    robot = jounce.load("planar2r").with_limits(velocity=factor * 15 / 8)
    slow = robot.slowdown(one_joint_quintic(1.0, 1.0), 50)
    assert slow.largest == pytest.approx(largest, rel=0.1)
    assert (slow.factor, slow.binding) == (1, None)


@pytest.mark.parametrize(("share", "verdict"), [(0.9, "broken"), (1.00001, "undecided"), (1.2, "kept")])
def test_commands_of_a_log_are_made_as_fast_as_is_surely_kept(share, verdict):
    """Slower than given where two deviations do not fit in: of a tenth of a percent more the check says so."""
    t = np.linspace(0, 2, 1001)
    way = np.polynomial.Polynomial([0, 0, 0, 10, -15, 6])(t / 2)
    noise = np.random.default_rng(0).normal(0, 1e-4, (len(t), 2))
    motion = jounce.Motion.fit(t, np.stack([way, -way / 2], axis=1) + noise)
    largest = jounce.load("planar2r").with_limits(velocity=9).check(motion, rate=250.0).worst
    robot = jounce.load("planar2r").with_limits(velocity={largest.joint: share * abs(largest.value)})
    found = robot.check(motion, rate=250.0)
    assert (found.verdict, found.worst.value) == (verdict, pytest.approx(largest.value))
    slow, fast = robot.slowdown(motion, 250.0), robot.slowdown(motion, 250.0, up_to_limits=True)
    assert (slow.factor, slow.motion is motion) == (fast.factor if share < 1 else 1, share > 1)
    assert (fast.factor < 1) == (verdict != "kept")
    assert fast.factor == pytest.approx(share, rel=0.02)
    assert robot.check(fast.motion, rate=250.0).verdict == "kept"
    assert robot.check(motion.scaled(0.999 / fast.factor), rate=250.0).verdict != "kept"
