"""A plant that jounce did not write follows its motor torques: Pinocchio moves the links, SciPy integrates.

The links start at rest and are driven open loop, without any feedback: an error of the torques, of Q2d in them above
all, would show at once, and grow.
"""

from math import comb
from pathlib import Path

import numpy as np
import pytest

import jounce

pinocchio = pytest.importorskip("pinocchio")
from scipy.integrate import solve_ivp  # noqa: E402
from scipy.interpolate import make_interp_spline  # noqa: E402

PANDA = Path(__file__).parents[2] / "examples" / "panda.urdf"
HOME, GOAL = np.array([[0, -0.785, 0, -2.356, 0, 1.571, 0.785], [1.0, 0.2, -0.4, -1.6, 0.5, 2.3, -0.4]])
STIFFNESS = np.array([7e3, 7e3, 7e3, 7e3, 3e3, 3e3, 3e3])  # N m/rad
ROTOR = np.array([0.6, 0.6, 0.5, 0.5, 0.2, 0.2, 0.2])  # kg m^2, seen from the links
T = np.linspace(0, 1, 401)  # s


@pytest.fixture(scope="module")
def robot():
    return jounce.load(PANDA, lock={"panda_finger_joint1": 0.0})


@pytest.fixture(scope="module")
def links():
    """Pinocchio's own reading of the same file: accelerations of the links from the forces on them."""
    full = pinocchio.buildModelFromUrdf(str(PANDA))
    fingers = [full.getJointId(name) for name in full.names if "finger" in name]
    model = pinocchio.buildReducedModel(full, fingers, pinocchio.neutral(full))
    data = model.createData()
    return lambda q, qd, force: pinocchio.aba(model, data, q, qd, force)


@pytest.fixture(scope="module")
def motion(robot):
    """From rest to rest in a second, six rates zero at both ends: the integral of u^6 (1 - u)^6."""
    s = np.array([*[0.0] * 7, *(comb(6, k) * (-1) ** k / (7 + k) for k in range(7))])
    c = np.outer(GOAL - HOME, s / s.sum())
    c[:, 0] += HOME
    return jounce.Motion.polynomial(c, duration=1.0, joint_names=robot.joint_names)


def drift(links, motion, theta, torques, force):
    """How far the links leave their motion when motors are driven by torques over T; springs exert `force`."""
    tau = make_interp_spline(T, torques, k=9)
    n, motors = len(HOME), torques.shape[1] // len(HOME)

    def rate(t, x):
        q, qd, theta, thetad = np.split(x, [n, 2 * n, (2 + motors) * n])
        carried = force(theta.reshape(motors, n) - q, thetad.reshape(motors, n) - qd)
        theta2d = (tau(t).reshape(motors, n) - carried) / ROTOR
        return np.concatenate([qd, links(q, qd, carried.sum(axis=0)), thetad, theta2d.ravel()])

    start = np.concatenate([HOME, np.zeros(n), theta, np.zeros(motors * n)])
    found = solve_ivp(rate, (0, 1), start, method="DOP853", rtol=1e-10, atol=1e-11, t_eval=T)
    return np.abs(found.y[:n].T - motion(T, 0)[0]).max()


def test_links_on_linear_springs_follow(robot, links, motion):
    arm = robot.elastic(STIFFNESS, rotor=ROTOR)
    rates = motion(T, 4)
    theta = arm.motor_positions(*(rate[0] for rate in rates[:3]))
    tau = arm.inverse_dynamics(*rates)
    assert drift(links, motion, theta, tau, lambda d, _: STIFFNESS * d) < 1e-10
    without = robot.inverse_dynamics(*rates[:3]) + ROTOR * rates[2]
    assert drift(links, motion, theta, without, lambda d, _: STIFFNESS * d) > 1e-4  # the test can tell
