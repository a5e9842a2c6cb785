"""Commands at a controller's rate: sampled from a motion, read from a table, completed where it cannot be otherwise."""

import numpy as np
import pytest

import jounce
from jounce.motion import commands
from support.refusals import refusal

ROBOT = jounce.load("planar2r")
JERK = 40.0  # of three phases, each of a length that no row of a millisecond meets
PHASE = 0.1003


def three_phases(jerk=JERK, phase=PHASE):
    """From rest to rest with the jerks +j, -j, -j, +j, as a plan of constant jerk has them."""
    x, q, v, a, c = [0.0], 0.0, 0.0, 0.0, []
    for j in jerk * np.array([1, -1, -1, 1]):
        c.append([j / 6, a / 2, v, q])
        q, v, a = np.polyval(c[-1], phase), np.polyval(np.polyder(c[-1]), phase), a + j * phase
        x.append(x[-1] + phase)
    coefficients = np.array(c).T[:, :, None] * np.array([1.0, -0.5])
    return jounce.Motion.piecewise(x, coefficients, joint_names=ROBOT.joint_names)


def command_rows(motion, step=1e-3, digits=None):
    t = np.arange(0, motion.stop, step)
    q = motion(t, 0)[0]
    return t, q if digits is None else q.round(digits)


def command_motion(t, q, **options):
    return jounce.load_motion({"t": t, "joint1": q[:, 0], "joint2": q[:, 1]}, ROBOT, 1, as_="commands", **options)


def test_commands_are_the_positions_at_k_over_the_rate_and_the_end():
    motion = three_phases()
    sampled = motion.sampled(1000)
    t, q = sampled.samples
    np.testing.assert_allclose(t, np.arange(403) / 1000)  # 0.4012 s
    np.testing.assert_array_equal(q[:-1], motion(t[:-1], 0)[0])
    np.testing.assert_array_equal(q[-1], motion(motion.stop, 0)[0])
    assert sampled.notes == (
        "1000 Hz does not divide 0.4012 s: the last command, of t = 0.402 s, is the end of the motion",
    )
    assert three_phases(phase=0.1).sampled(1000).notes == ()
    assert sampled.sampled(1000).samples[1] is q


def test_the_jerk_of_the_curve_is_the_third_difference():
    sampled = three_phases().sampled(1000)
    t, q = sampled.samples
    third = np.diff(q, 3, axis=0) * 1000.0**3
    middle = (t[1:-2] + t[2:-1]) / 2
    np.testing.assert_allclose(sampled(middle, 3)[3], third, atol=1e-4)
    ends = sampled([sampled.start, sampled.stop], 2)
    np.testing.assert_allclose(ends[0], q[[0, -1]], atol=1e-15)
    assert np.abs(ends[1:]).max() < 1e-9


def test_a_curve_of_commands_does_not_overshoot_their_differences():
    sampled = three_phases().sampled(1000)
    fine = np.linspace(sampled.start, sampled.stop, 5001)
    for k, rate in enumerate(sampled(fine, 3)[1:], 1):
        most = np.abs(np.diff(sampled.samples[1], k, axis=0)).max(axis=0) * 1000.0**k
        assert (np.abs(rate).max(axis=0) <= most * (1 + 1e-9) + 1e-6).all()


@pytest.mark.parametrize("early", [0.0002, 0.0006, 0.0009])
def test_a_table_that_ends_before_the_stop_is_completed(early):
    """The last row is up to a period early; five rows lie within the last phase, whose jerk is theirs."""
    motion = three_phases()
    t = np.arange((motion.stop - early) % 1e-3, motion.stop, 1e-3)
    found = command_motion(t, motion(t, 0)[0])
    assert len(found.samples[0]) == len(t)  # rows as they are
    _, q = found.sampled(1000).samples
    assert len(q) == len(t) + 1
    np.testing.assert_allclose(q[-1], motion(motion.stop, 0)[0], atol=1e-10)
    assert "by the jerk there: the command of t = " in found.notes[-1]


@pytest.mark.parametrize("phase", [0.1, PHASE])
def test_a_table_that_ends_at_rest_has_nothing_to_note(phase):
    """On the grid, and with its end appended off the grid."""
    motion = three_phases(phase=phase)
    t = np.append(np.arange(0, motion.stop - 1e-9, 1e-3), motion.stop)
    assert command_motion(t, motion(t, 0)[0]).notes == ()
    assert len(command_motion(t, motion(t, 0)[0]).sampled(1000).samples[0]) == len(t)


def test_a_table_that_ends_in_motion_is_not_completed():
    motion = three_phases()
    for cut in (2, 120):  # more than a period from the stop
        t, q = (x[:-cut] for x in command_rows(motion))
        found = command_motion(t, q)
        assert len(found.sampled(1000).samples[0]) == len(t)
        assert found.notes[-1].startswith("it ends in motion, by up to ")
    rounded = command_motion(*command_rows(motion, digits=6))  # whose third differences are rounding
    assert not any("is added" in note for note in rounded.notes)


def test_a_motion_whose_jerk_stops_it_within_a_period_is_completed():
    whole = three_phases()
    x, c = whole.curve.x.copy(), whole.curve.c
    x[-1] -= 0.0004
    cut = jounce.Motion.piecewise(x, c)
    np.testing.assert_allclose(cut.sampled(1000).samples[1], whole.sampled(1000).samples[1], atol=1e-12)
    x[-1] -= 0.0009  # 1.3 ms before the stop
    assert jounce.Motion.piecewise(x, c).sampled(1000).notes[-1].startswith("it ends in motion")


def test_a_jerk_that_ends_the_acceleration_alone_stops_nothing():
    """q2d vanishes after half a period, and the velocity of 1 rad/s remains."""
    moving = jounce.Motion.polynomial([[0.0, 1.0, -0.005 - 2.5, 5 / 3], [0.0, 0.0, 0.0, 0.0]], 0.5)
    assert moving(0.5, 3)[3][0] == pytest.approx(10)
    assert moving.sampled(1000).notes[-1].startswith("it ends in motion, by up to ")


def test_a_table_of_a_quintic_ends_at_rest():
    """Its last step is not zero, nor is its jerk constant; the cubic through four rows leaves no velocity."""
    t = np.arange(1001) / 1000
    assert command_motion(t, (10 * t**3 - 15 * t**4 + 6 * t**5)[:, None] * [1.0, -0.5]).notes == ()


def test_late_commands_are_noted_and_the_curve_goes_on_across_them():
    t, q = command_rows(three_phases())
    found = command_motion(np.delete(t, 100), np.delete(q, 100, axis=0))
    np.testing.assert_allclose(found(t[99:300:50], 0)[0], q[99:300:50], atol=1e-5)
    assert found.notes[0] == "1 of 401 commands are late: the first at t = 0.101 s, 2 periods after the one before"
    assert found.source == "401 commands at 1000 Hz"


@pytest.mark.parametrize(("rate", "words"), [
    (0, ["rate is 0", "in Hz"]),
    (-1000, ["rate is -1000"]),
    ("1000", ["rate is '1000'"]),
    (float("nan"), ["rate is nan"]),
    (0.001, ["a rate of 0.001 Hz makes 1 commands in 0.4012 s", "1000 for 1 ms"]),
    (1e9, ["commands in 0.4012 s", "it is in Hz"]),
])  # fmt: skip
def test_rates_that_make_no_sense_are_refused(rate, words):
    refusal(lambda: three_phases().sampled(rate), *words)


def test_a_rate_that_looks_like_a_period_is_warned_of():
    motion = three_phases().scaled(20)
    with pytest.warns(jounce.JounceWarning, match="a rate of 1 Hz is unusually low; for a period of 1 ms give 1000"):
        motion.sampled(1)
    motion.sampled(commands.MIN_USUAL_RATE)


@pytest.mark.parametrize("differences", [0, 5, 2.0, True])
def test_differences_are_of_order_1_to_4(differences):
    refusal(lambda: three_phases().sampled(1000, differences), "differences is", "expected 1 to 4", "3 for jerk")


def test_bad_tables_of_commands_are_refused():
    t, q = command_rows(three_phases())
    refusal(lambda: command_motion(t, q).sampled(500), "commands at 1000 Hz, and rate is 500 Hz", "as_='commands'")
    assert command_motion(t, q).sampled(1010).samples[0].size == t.size + 1  # a clock that is off by 1 %
    refusal(lambda: command_motion(t, q).sampled(1030), "give the rate of the table")
    refusal(lambda: command_motion(t[:4], q[:4]), "4 rows; a table of commands has at least 5")
    t[7] = t[6]
    refusal(lambda: command_motion(t, q), "column 't' does not increase", "row 7")
    refusal(
        lambda: command_motion(*command_rows(three_phases()), degree=7),
        "commands are taken as they are",
        "leave out degree",
    )
    refusal(lambda: jounce.load_motion("paper", jounce.load("iiwa14"), as_="commands"), "as_ is for samples")
    refusal(lambda: jounce.load_motion({}, ROBOT, as_="positions"), "positions", "samples", "commands")


def test_commands_keep_through_shifts_and_other_orders_of_joints():
    t, q = command_rows(three_phases())
    swapped = command_motion(t, q).shifted(3.0)
    found = commands.find_commands(swapped.curve)
    np.testing.assert_allclose(found.t[:-1], t + 3)
    assert commands.find_commands(command_motion(t, q).scaled(2).curve) is None


def test_sampled_is_a_method_and_no_constructor():
    said = "Motion.sampled() is a method of a motion, got ndarray; Motion.fit(t, q) makes a motion of samples"
    refusal(lambda: jounce.Motion.sampled(np.arange(3.0), np.zeros((3, 2))), said)
