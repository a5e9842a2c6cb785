"""Links on elastic joints from samples of their motors, against the motion that the motors were computed from."""

import numpy as np
import pytest

import jounce
from support.refusals import refusal
from support.states import sine_rates

ROBOT, PLANAR, STEP = jounce.load("iiwa14"), jounce.load("planar2r"), 2 * np.pi / 2**20
QUIET = {"noise": 1e-9, "bandwidth": 4}


def sine(t, frequency, n):
    """q to q4d (n,) of joints that swing by 0.3 rad with phases of their own."""
    return np.array(sine_rates(t, 4, 0.3, 2 * np.pi * frequency, np.arange(n)))


def motor_rates(arm, t, frequency, h=5e-3):
    """theta to theta4d: exact to second order, and the others by differences of fourth order."""
    theta2d = {k: arm.motor_positions(*sine(t + k * h, frequency, arm.n))[2] for k in range(-2, 3)}
    third = (8 * (theta2d[1] - theta2d[-1]) - theta2d[2] + theta2d[-2]) / (12 * h)
    fourth = (16 * (theta2d[1] + theta2d[-1]) - theta2d[2] - theta2d[-2] - 30 * theta2d[0]) / (12 * h**2)
    return *arm.motor_positions(*sine(t, frequency, arm.n)), third, fourth


def links_at(arm, t, frequency, covariance=None):
    """The links of exact rates of theta: without a filter."""
    live = arm.live(1e-3, **QUIET)
    live.t, live.rates = t, motor_rates(arm, t, frequency)
    live._covariance = np.zeros((arm.n, 5, 5)) if covariance is None else covariance
    return live, live.links()


@pytest.mark.parametrize("rounded", [False, True])
@pytest.mark.parametrize("robot", [ROBOT, PLANAR], ids=lambda x: x.name)
def test_links_differ_by_what_error_and_deviations_say(robot, rounded):
    arm, times = robot.elastic(1e4, rotor=0.5), 1e-3 * np.arange(1600)
    live = arm.live(1e-3, lag=0.05) if rounded else arm.live(1e-3, lag=0.05, noise=1e-9)
    theta = arm.motor_positions(*np.moveaxis([sine(t, 1.0, arm.n) for t in times], 1, 0)[:3])
    theta = np.round(theta / STEP) * STEP if rounded else theta
    errors, of_motors, bounds = [], [], []
    for k, t in enumerate(times):
        rates = live.update(theta[k], t)
        if k >= 1100 and k % 10 == 0:
            links, exact = live.links(), sine(live.t, 1.0, arm.n)[:3]
            errors.append(np.abs(np.array(links[:3]) - exact))
            of_motors.append(np.abs(rates[:3] - exact))
            bounds.append(2 * links.error + 5 * links.deviations)
    assert (np.array(errors) < bounds).all()
    gains = np.max(of_motors, axis=(0, 2)) / np.max(errors, axis=(0, 2))
    assert gains[0] > 10


@pytest.mark.parametrize("robot", [ROBOT, PLANAR], ids=lambda x: x.name)
def test_error_falls_as_the_square_of_the_stiffness(robot):
    times, found, stated, of_motors = [0.1, 0.25, 0.35, 0.6, 0.8, 0.95], [], [], []
    for K in (1e5, 1e6):
        arm = robot.elastic(K, rotor=0.5)
        all_links, exact = [links_at(arm, t, 1.0) for t in times], [sine(t, 1.0, arm.n)[:3] for t in times]
        found.append(np.linalg.norm(np.array([links[:3] for _, links in all_links]) - exact, axis=(0, 2)))
        of_motors.append(np.linalg.norm(np.array([live.rates[:3] for live, _ in all_links]) - exact, axis=(0, 2)))
        stated.append(np.linalg.norm([links.error for _, links in all_links], axis=(0, 2)))
    assert (of_motors[0][0] / found[0][0], of_motors[1][0] / found[1][0]) > (100, 1000)
    assert found[0] / found[1] == pytest.approx(100, rel=0.05)
    assert stated[0] / stated[1] == pytest.approx(100, rel=0.05)
    assert (found[0] < 1.2 * stated[0]).all()
    assert (stated[0] < 2 * found[0]).all()


def test_error_says_that_joints_are_too_soft():
    arm = PLANAR.elastic(100, rotor=0.5)
    live, links = links_at(arm, 0.3, 3.0)
    assert (links.error[0] > np.abs(live.rates[0] - links.q)).any()


def test_deviations_are_those_of_the_linearization():
    arm, random = PLANAR.elastic(2e3, rotor=0.5), np.random.default_rng(0)
    root = 1e-4 * random.normal(size=(2, 5, 5))
    live, links = links_at(arm, 0.3, 1.0, root @ root.mT)
    rates, found = live.rates, []
    for noise in random.normal(size=(2000, 2, 5)):
        live.rates = tuple(rates + np.einsum("jab,jb->aj", root, noise))
        found.append(live.links()[:3])
    np.testing.assert_allclose(links.deviations, np.std(found, axis=0), rtol=0.06)


def test_rigid_joints_move_as_their_motors():
    arm = PLANAR.elastic({"joint1": 1e4}, rotor=0.5)
    live, links = links_at(arm, 0.3, 1.0)
    assert links.q[1] == live.rates[0][1]
    assert links.error[:, 1].tolist() == [0, 0, 0]


def test_links_are_unknown_before_the_first_sample():
    assert np.isnan(np.vstack(PLANAR.elastic(1e4, rotor=0.5).live(1e-3).links())).all()


@pytest.mark.parametrize("arm", [
    PLANAR,
    PLANAR.elastic(spring=jounce.CubicSpring(500.0, 2e4), rotor=0.1),
    PLANAR.elastic(900, rotor=0.1, damping=1.0),
    PLANAR.elastic(spring=jounce.AntagonisticSprings(*[jounce.CubicSpring(500.0, 2e4)] * 2), rotor=0.1),
    PLANAR.elastic(900, motors=jounce.Motor(inertia=1e-5, gear=100, body="world"), coupling=0),
], ids=["rigid", "cubic", "damped", "two motors", "coupled"])  # fmt: skip
def test_other_springs_are_refused(arm):
    refusal(lambda: arm.live(1e-3).links(), "links() of 'planar2r'; expected elastic joints with linear springs")
