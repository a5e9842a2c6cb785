"""Coulomb friction that changes its sign within less time than samples are apart: nothing between them is missed."""

import numpy as np
import pytest
from scipy.optimize import brentq

import jounce
from support.robots import rubbing

PLANAR = jounce.load("planar2r")
MOTION = jounce.Motion.fourier([0, 0], [[0.3, 0.1]], [[0.1, 0.2]], 1.1, 10.0)


def turns(joint: int) -> np.ndarray:
    """When a joint turns round."""
    t = np.linspace(MOTION.start, MOTION.stop, 2001)
    qd = MOTION(t, 1)[1][:, joint]
    at = np.flatnonzero(qd[:-1] * qd[1:] < 0)
    return np.array([brentq(lambda t: MOTION(t, 1)[1][joint], t[i], t[i + 1], xtol=1e-15) for i in at])


@pytest.mark.parametrize("eps", [0.05, 1e-3, 1e-5, 1e-7, 1e-9])
@pytest.mark.parametrize("joint", [0, 1])
def test_the_torque_rate_at_a_reversal_is_found_at_any_eps(eps, joint):
    robot = rubbing(PLANAR, [3.0, 2.0], eps).with_limits(effort_rate=np.where(np.arange(2) == joint, 500.0, np.inf))
    near = turns(joint)[:, None] + np.linspace(-2, 2, 2001) * min(1.0, eps)
    t = np.unique(np.concatenate([near.ravel().clip(MOTION.start, MOTION.stop), np.linspace(0, 10, 20001)]))
    dense = np.abs(robot.inverse_dynamics(*MOTION(t, 3))[1][:, joint]).max()
    found = robot.check(MOTION)
    assert abs(found.worst.value) == pytest.approx(dense, rel=2e-3 if eps > 1e-8 else 0.05)  # rounding of the times
    assert abs(found.worst.value) >= dense * (1 - 1e-6)
    assert found.verdict == ("broken" if dense > 500 else "kept")


@pytest.mark.filterwarnings("ignore:planar2r. friction no longer acts in Q")
@pytest.mark.parametrize(("eps", "verdict"), [(1e-4, "kept"), (1e-7, "undecided")])
def test_too_fast_changes_are_undecided_near_a_limit_only(eps, verdict):
    arm = rubbing(PLANAR, [3.0, 2.0], eps).elastic([800, 600], rotor=0.1).with_limits(motor_torque=[80.0, 60.0])
    far = arm.check(MOTION)
    assert (far.verdict, far.notes) == ("kept", ())
    near = arm.with_limits(motor_torque=[abs(far.worst.value) + 0.5, 60.0]).check(MOTION)
    assert near.verdict == verdict
    assert [note[:52] for note in near.notes] == ["the motor torque of joint 'joint1' may be beyond its"] * (
        verdict != "kept"
    )
    assert sum(stop - start for start, stop in near.worst.undecided) < 1e-3
    assert 0.999 < near.judged["motor_torque"] <= 1


@pytest.mark.filterwarnings("ignore:planar2r. friction no longer acts in Q")
def test_a_slowdown_says_what_changes_too_fast_to_be_followed():
    arm = rubbing(PLANAR, [3.0, 2.0], 1e-7).elastic([800, 600], rotor=0.1).with_limits(motor_torque=[50.0, 60.0])
    turn = jounce.Motion.polynomial([[0, 0.3, -0.6], [0, 0.1, 0]], duration=0.5)  # joint 1 turns round at 0.25 s
    [note] = arm.slowdown(turn).notes
    assert note.startswith("the motor torque of joint 'joint1' may be beyond its limit between samples from t = ")
