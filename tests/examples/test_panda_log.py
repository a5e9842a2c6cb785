"""The log of examples/panda_log.csv: an arm that reaches while its tool polishes, as an encoder at 250 Hz has it."""

from pathlib import Path

import numpy as np

import jounce

EXAMPLES = Path(__file__).parents[2] / "examples"
START = np.array([0, -0.785, 0, -2.356, 0, 1.571, 0.785])
WAY = np.array([0.5, 0.1, -0.2, 0.2, 0.3, 0.2, -0.3])
NOISE, DIGITS = 1e-7, 6  # rad


def log_of_a_polishing_arm():
    """Return t and the angles of the joints: two seconds, with strokes of 0.6 mrad at 16 Hz."""
    t = np.arange(501) / 250
    s = t / t[-1]
    reach = s**5 * (126 - 420 * s + 540 * s**2 - 315 * s**3 + 70 * s**4)
    strokes = 6e-4 * np.sin(np.pi * s) ** 4 * np.sin(2 * np.pi * 16 * t)
    q = START + np.outer(reach, WAY) + np.outer(strokes, [0, 1, 0, -1, 0, 0, 0])
    return t, (q + NOISE * np.random.default_rng(1).normal(size=q.shape)).round(DIGITS)


def test_the_log_is_that_of_the_formula():
    table = np.loadtxt(EXAMPLES / "panda_log.csv", delimiter=",", skiprows=1)
    t, q = log_of_a_polishing_arm()
    np.testing.assert_allclose(table[:, 0], t, atol=1e-12)
    np.testing.assert_allclose(table[:, 1:], q, atol=1.5 * 10**-DIGITS)  # sines round differently elsewhere


def test_the_log_breaks_a_limit_of_torque_rates_alone():
    robot = jounce.load(EXAMPLES / "panda.urdf", lock={"panda_finger_joint1": 0.02}).with_limits("panda")
    check = robot.check(jounce.load_motion(EXAMPLES / "panda_log.csv", robot))
    broken = {(row.limit, row.joint) for row in check.table if row.verdict == "broken"}
    assert broken == {("effort_rate", "panda_joint2"), ("effort_rate", "panda_joint4")}
