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
def panda_without_hand():
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
def smooth_move(panda_without_hand):
    """From rest to rest in a second, six rates zero at both ends: the integral of u^6 (1 - u)^6."""
    s = np.array([*[0.0] * 7, *(comb(6, k) * (-1) ** k / (7 + k) for k in range(7))])
    c = np.outer(GOAL - HOME, s / s.sum())
    c[:, 0] += HOME
    return jounce.Motion.polynomial(c, duration=1.0, joint_names=panda_without_hand.joint_names)


def drift(links, motion, theta, torques, force, rotor=ROTOR, tolerance=1e-10):
    """How far the links leave their motion when motors are driven by torques over T; springs exert `force`.

    Motors are in rows (m, n): two of them where two springs pull at each joint.
    """
    tau, n, m = make_interp_spline(T, torques, k=9), len(HOME), len(theta)

    def rate(t, x):
        q, qd, theta, thetad = np.split(x, [n, 2 * n, (2 + m) * n])
        carried = force(theta.reshape(m, n) - q, thetad.reshape(m, n) - qd)
        theta2d = (tau(t) - carried) / rotor
        return np.concatenate([qd, links(q, qd, carried.sum(axis=0)), thetad, theta2d.ravel()])

    start = np.concatenate([HOME, np.zeros(n), theta.ravel(), np.zeros(m * n)])
    found = solve_ivp(rate, (0, 1), start, method="DOP853", rtol=tolerance, atol=tolerance / 10, t_eval=T)
    return np.abs(found.y[:n].T - motion(T, 0)[0]).max()


def test_links_on_linear_springs_follow(panda_without_hand, links, smooth_move):
    along = panda_without_hand.elastic(STIFFNESS, rotor=ROTOR).motors_along(smooth_move, T)
    theta, tau = along.positions[0][:1], along.torques[0][:, None]
    assert drift(links, smooth_move, theta, tau, lambda d, _: STIFFNESS * d) < 1e-10
    without = panda_without_hand.inverse_dynamics(*along.rates[:3]) + ROTOR * along.rates[2]
    left = drift(links, smooth_move, theta, without[:, None], lambda d, _: STIFFNESS * d, tolerance=1e-6)
    assert left > 1e-4  # the test can tell


def test_links_on_cubic_springs_follow(panda_without_hand, links, smooth_move):
    along = panda_without_hand.elastic(spring=jounce.CubicSpring(3e3, 1e7), rotor=ROTOR).motors_along(smooth_move, T)
    theta, tau = along.positions[0][:1], along.torques[0][:, None]
    assert drift(links, smooth_move, theta, tau, lambda d, _: 3e3 * d + 1e7 * d**3) < 1e-10


def test_links_on_damped_springs_follow(panda_without_hand, links, smooth_move):
    damping = STIFFNESS / 500
    along = panda_without_hand.elastic(STIFFNESS, rotor=ROTOR, damping=damping).motors_along(smooth_move, T)
    theta, tau = along.positions[0][:1], along.torques[0][:, None]
    assert drift(links, smooth_move, theta, tau, lambda d, rate: STIFFNESS * d + damping * rate) < 1e-10


def test_links_on_antagonists_follow_while_the_stiffness_changes(panda_without_hand, links, smooth_move):
    """The stiffness rises from rest to rest by a half, while the arm moves."""
    k, k3 = 1e3, 1e6
    tendon = jounce.CubicSpring(k, k3)
    rise = [rate[:, :1] * np.ones(7) for rate in smooth_move(T, 2)]  # of joint 1, from 0 to 1
    wanted = (8e3 + 4e3 * rise[0], 4e3 * rise[1], 4e3 * rise[2])
    arm = panda_without_hand.elastic(spring=jounce.AntagonisticSprings(tendon, tendon), rotor=0.2)
    along = arm.motors_along(smooth_move, T, stiffness=wanted)
    pairs = [x.reshape(-1, 7, 2).swapaxes(1, 2) for x in (along.positions[0], along.torques[0])]
    assert drift(links, smooth_move, pairs[0][0], pairs[1], lambda d, _: k * d + k3 * d**3, rotor=0.2) < 1e-10
