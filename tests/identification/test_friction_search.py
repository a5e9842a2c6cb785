"""Laws of friction that samples show: smoothing velocities, Stribeck terms, and weights of slow samples."""

from dataclasses import replace

import numpy as np
import pytest

import jounce
from jounce.identification.fits import SPEED_BINS, with_friction_laws
from jounce.identification.measurements import Measurements

T = np.linspace(0, 8, 4001)
DAMPING, FRICTION, OFFSET = np.array([0.4, 0.3]), np.array([1.0, 0.7]), np.array([0.2, -0.1])
STRIBECK = 0.6 * FRICTION
NOISE = 0.02
ROBOT = jounce.load("planar2r")
TRUE = ROBOT.with_inertial_parameters(1.2 * ROBOT.inertial_parameters)
MOTION, OTHER = (
    jounce.Motion.fourier([0.3, 0.5], *np.random.default_rng(seed).uniform(-0.4, 0.4, (2, 3, 2)), 1.5, 8.0)
    for seed in (1, 2)
)


def true_torques(motion, law, seed=None):
    """The torques of the true robot with friction of a law of the speed, with noise if there is a seed."""
    q, qd, q2d = motion(T, 2)
    Q = TRUE.inverse_dynamics(q, qd, q2d) + DAMPING * qd + FRICTION * law(qd) + OFFSET
    return Q if seed is None else Q + NOISE * np.random.default_rng(seed).normal(size=Q.shape)


def stribeck(v):
    return np.tanh(v / 0.02) * (1 + STRIBECK / FRICTION * np.array([1, 0]) * np.exp(-((v / 0.15) ** 2)))


def law_error(found, law):
    """The root mean square of errors of the torques along a motion that was not fitted."""
    return np.sqrt(np.mean((found.robot.forces_along(OTHER, T, order=0).forces[0] - true_torques(OTHER, law)) ** 2))


@pytest.mark.parametrize("eps", [0.05, 0.01, 0.002])
def test_smoothing_velocities_are_found(eps):
    def law(v):
        return np.tanh(v / eps)

    found = ROBOT.identify(MOTION, true_torques(MOTION, law, 3), t=T)
    np.testing.assert_allclose(found.robot.drives.eps, eps)
    assert found.robot.mechanism.acting == ("damping", "friction", "offset"), "no joint has a Stribeck term"
    assert law_error(found, law) < 0.25 * NOISE


def test_friction_that_jumps_is_identified():
    found = ROBOT.identify(MOTION, true_torques(MOTION, np.sign, 4), t=T)
    held = ROBOT.identify(MOTION, true_torques(MOTION, np.sign, 4), t=T, eps=0.05)
    assert held.robot.drives.eps.tolist() == [0.05, 0.05]
    assert law_error(found, np.sign) < 0.3 * law_error(held, np.sign)


def test_a_stribeck_term_is_found_where_a_joint_has_one(tmp_path):
    Q = true_torques(MOTION, stribeck, 5)
    found = ROBOT.identify(MOTION, Q, t=T, prior=10.0)
    assert [name for name in found.names if "stribeck" in name] == ["joint1 stribeck"]
    row = next(row for row in found.table if row.name == "joint1 stribeck")
    assert row.unit == "N m"
    assert row.value == pytest.approx(STRIBECK[0], abs=4 * row.deviation)
    assert found.robot.drives.stribeck == pytest.approx([STRIBECK[0], 0], abs=0.05)
    assert found.robot.drives.stribeck_velocity[0] == 0.15
    without = ROBOT.identify(MOTION, Q, t=T, drives=("damping", "friction", "offset"), prior=10.0)
    assert law_error(found, stribeck) < 0.5 * law_error(without, stribeck)
    jounce.save(found.robot, tmp_path / "found.yaml")
    again = jounce.load(tmp_path / "found.yaml", drives=True)
    read = again.forces_along(MOTION, T, order=0).forces[0]
    np.testing.assert_allclose(read, found.predicted, rtol=0, atol=1e-9 * np.abs(Q).max())


def test_stribeck_terms_are_not_negative():
    """Friction that is less near rest: a negative term would explain it, which no robot has."""

    def law(v):
        return np.tanh(v / 0.02) * (1 - 0.5 * np.exp(-((v / 0.12) ** 2)))

    found = ROBOT.identify(MOTION, true_torques(MOTION, law, 9), t=T)
    assert [row.name for row in found.table if "stribeck" in row.name and row.value < 0] == []


def test_what_samples_do_not_show_stays_as_the_model_has_it():
    """Exact forces, and noise alone: eps of a robot file is not replaced by what noise prefers."""
    drives = replace(ROBOT.drives, eps=np.array([0.037, 0.4]), stribeck=np.array([0.0, 2.0]))
    model = jounce.Robot(replace(ROBOT.mechanism, drives=drives))
    q = MOTION(T, 2)
    for noise in (0.0, NOISE):
        Q = TRUE.inverse_dynamics(*q) + noise * np.random.default_rng(6).normal(size=q[0].shape)
        found = model.identify(MOTION, Q, t=T).robot.drives
        assert found.eps.tolist() == [0.037, 0.4]
        assert found.stribeck.tolist() == [0, 0], "samples show none"


def test_slow_samples_whose_friction_no_model_has_count_less():
    """Pushes of a joint while it is slow: they spoil its friction, and not the parameters of fast samples."""
    speed = np.abs(MOTION(T, 1)[1])
    Q = true_torques(MOTION, lambda v: np.tanh(v / 0.05), 7)
    terms = ("damping", "friction", "offset")
    one = np.ones_like(Q)
    clean = with_friction_laws(ROBOT, [(MOTION, Measurements(T, Q, one))], terms, True, False)[3][0].weights
    assert clean.mean() > 0.95
    pushed = Q + np.where(speed < SPEED_BINS[2], 0.5, 0.0) * [1, 0]
    weights = with_friction_laws(ROBOT, [(MOTION, Measurements(T, pushed, one))], terms, True, False)[3][0].weights
    assert (weights[speed >= SPEED_BINS[-1]] == 1).all()
    assert weights[speed[:, 0] < SPEED_BINS[2], 0].max() < 0.01
    assert weights[:, 1].mean() > 0.95, "of a joint that is not pushed"
    found = ROBOT.identify(MOTION, pushed, t=T, drives=terms, eps=0.05, prior=10.0)
    assert found.robot.drives.offset == pytest.approx(OFFSET, abs=0.02)
    left = next(row for row in found.residuals if row.force == "joint1")
    assert left.identified_samples > 2 * NOISE, "residuals count all samples alike"


def test_the_prior_says_how_much_it_moves_residuals():
    Q = true_torques(MOTION, lambda v: np.tanh(v / 0.05), 8)
    loose, tight = (ROBOT.identify(MOTION, Q, t=T, prior=prior) for prior in (10.0, 1e-4))
    for row in loose.residuals:
        assert row.identified == pytest.approx(row.least_squares, rel=1e-2)
    for row, other in zip(tight.residuals, loose.residuals, strict=True):
        assert row.least_squares == pytest.approx(other.least_squares, rel=1e-6)
        assert row.identified > 5 * row.least_squares
