"""Limits of joints along motions with a base: the forces on a base that floats are not limited, its motion counts."""

import numpy as np
from scipy.spatial.transform import Rotation

import jounce
from jounce import Motion
from support.refusals import refusal
from support.robots import floating

ARM = jounce.load("planar2r").with_limits(effort=[60, 20], velocity=5.0)
FLOATING = jounce.Robot(floating(ARM.mechanism, np.random.default_rng(3), mass=30.0))
T = np.linspace(0, 1, 61)
C = np.tile(np.eye(4), (61, 1, 1))
C[:, :3, :3] = Rotation.from_rotvec(np.outer(0.4 * (1 - np.cos(np.pi * T)), [0, 1, 0])).as_matrix()
C[:, 0, 3] = 0.3 * np.sin(np.pi * T) ** 2
REST = Motion.polynomial([[0, 0, 0, 5, -7.5, 3]] * 2, 1.0)
MOTION = REST.with_base(T, C, degree=7)


def test_values_are_those_of_the_joints_along_the_base():
    Q = FLOATING.forces_along(MOTION, np.linspace(0, 1, 2001), order=0).forces[0][:, 6:]
    found = {row.joint: row for row in FLOATING.check(MOTION).table if row.limit == "effort"}
    for j, joint in enumerate(FLOATING.joint_names):
        np.testing.assert_allclose(abs(found[joint].value), abs(Q[:, j]).max(), rtol=1e-5)


def test_the_base_goes_at_the_pace_that_limits_allow():
    slow = FLOATING.slowdown(MOTION, up_to_limits=True)
    np.testing.assert_allclose(FLOATING.check(slow.motion).worst.ratio, 1, atol=1e-8)
    fast = FLOATING.retime(MOTION, margin=0.02)
    assert fast.duration < slow.motion.duration * 1.001
    assert 0.97 < FLOATING.check(fast.motion).worst.ratio < 0.981
    jumping = FLOATING.retime(MOTION, margin=0.02, smooth=False)
    assert jumping.duration < fast.duration < 1.005 * jumping.duration
    assert 0.97 < FLOATING.check(jumping.motion).worst.ratio < 0.9805
    ends = [motion.base(motion.stop, 0)[0] for motion in (MOTION, slow.motion, fast.motion, jumping.motion)]
    np.testing.assert_allclose(ends[1:], [ends[0]] * 3, atol=1e-9)


def test_a_jump_of_the_base_breaks_limits_of_forces():
    later = Motion.polynomial([[0.5, 0]] * 2, 0.5).with_base(None, C[-1])
    kick = C.copy()
    kick[:, 0, 3] += T**2 - 1
    broken = REST.with_base(T, kick, degree=7) + later
    worst = FLOATING.check(broken).worst
    assert (worst.limit, worst.t, worst.ratio) == ("effort", 1.0, np.inf)
    refusal(lambda: FLOATING.retime(broken), "base")
