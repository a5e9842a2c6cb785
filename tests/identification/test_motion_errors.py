"""Identification from logs whose accelerations are not exact: no bias, and deviations that hold the truth."""

import numpy as np
import pytest
from benchmarks.pendulum import DAMPING, double_pendulum, swing

import jounce
from jounce.identification.averaging import CellAverages
from jounce.identification.motion_errors import AccelerationErrors, find_acceleration_errors
from jounce.identification.regression import MAX_VARIANCE_FACTOR, MIN_NOISE_SHARE, Equations, _starts, fit_forces

SEEDS = 3
ROBOT = double_pendulum()
TRUE = np.append(ROBOT.base_parameters().values, DAMPING)


@pytest.mark.sweep(1)  # the case where accelerations that count as exact are worst
@pytest.mark.parametrize(("bits", "passive"), [(12, True), (12, False), (17, True), (17, False)])
def test_errors_of_accelerations_make_no_bias(bits, passive):
    """As if accelerations were exact, 12 bits and a passive joint make parameters less than half as large."""
    model = ROBOT.with_inertial_parameters(1.3 * ROBOT.inertial_parameters)
    errors, over = [], []
    for seed in range(SEEDS):
        t, q, Q = swing(ROBOT, seed, bits, passive)
        found = model.identify(jounce.Motion.fit(t, q, allow_noise=True), Q, t=t, drives=("damping",), prior=10.0)
        errors.append([row.value for row in found.table] - TRUE)
        over.append(errors[-1] / np.sqrt(np.diag(found.covariance)))
        known = [note.startswith("half a step of the encoder of") for note in found.notes]
        assert all(known), "errors of the motion explain what is left"
        assert len(known) <= (bits == 12), "finer encoders have no such note"
    large = np.abs(TRUE) > 1e-9
    assert np.abs(np.mean(errors, axis=0)[large] / TRUE[large]).max() < 0.015
    assert np.mean(np.abs(over) < 2) > 0.85
    assert 0.4 < np.sqrt(np.mean(np.square(over))) < 1.3


def test_forces_of_acceleration_errors_follow_from_the_mass_matrix():
    """For corrections of the parameters too: differences of the regressor against M of the corrected robot."""
    columns, rng = ROBOT.base_parameters().columns, np.random.default_rng(3)
    q, a = rng.normal(size=(2, 5, 2))
    errors = AccelerationErrors(ROBOT, (), columns, q, np.ones((5, 2)), np.ones(5, bool))
    change = rng.normal(size=ROBOT.inertial_parameters.shape) * ROBOT.inertial_parameters
    other = ROBOT.with_inertial_parameters(ROBOT.inertial_parameters + change)
    corrections = other.base_parameters().values - ROBOT.base_parameters().values
    M = errors.mass_matrix(corrections)
    assert pytest.approx(other.mass_matrix(q), abs=1e-12) == M
    moved = other.inverse_dynamics(q, 0 * q, a) - other.inverse_dynamics(q, 0 * q, 0 * q)
    assert errors.regressor(a) @ other.base_parameters().values == pytest.approx(moved, abs=1e-12)


def test_exact_motions_have_no_errors():
    motion = jounce.Motion.fourier([0, 0], [[0.5, 0.2], [0.1, 0.4]], [[0.1, 0.3], [0.5, 0.2]], 3.0, 4.0)
    deviations, place = motion.deviations(motion.times, 2), np.zeros(len(motion.times), int)
    cells = motion.times, place
    errors = find_acceleration_errors(ROBOT, motion, cells, (), columns=np.array([0]), deviations=deviations)
    assert not errors.variances.any()


@pytest.mark.parametrize(("rho", "least", "most"), [(0.0, 0.8, 1.25), (0.9, 0.7, 1.4), (0.98, 0.7, 1.6)])
def test_deviations_hold_for_white_and_for_slow_noise(rho, least, most):
    """Root mean squares of errors over deviations of one column that varies slowly, of 60 draws of noise."""
    from scipy.signal import lfilter

    count, rng, over = 400, np.random.default_rng(5), []
    s = np.arange(count) / count
    Y = np.stack([np.sin(6 * np.pi * s), np.cos(14 * np.pi * s), np.sin(40 * np.pi * s)], axis=-1)[:, None]
    one = np.ones((count, 1))
    for _ in range(60):
        noise = lfilter([np.sqrt(1 - rho**2)], [1, -rho], rng.normal(size=(count + 300, 1)), axis=0)[300:]
        found = fit_forces(CellAverages(Y, noise, 0 * one, one, 0 * one), np.arange(3), None, known=False)
        over.append(found.x / np.sqrt(np.diag(found.covariance)))
    assert least < np.sqrt(np.mean(np.square(over))) < most


def test_a_start_has_little_noise_and_large_errors_of_the_motion():
    """All others end at parameters near 0 where the motion has larger errors than it states."""
    rng, errors = (
        np.random.default_rng(0),
        AccelerationErrors(ROBOT, (), np.arange(4), *np.ones((2, 30, 2)), np.ones(30, bool)),
    )
    Y, off = rng.normal(size=(30, 2, 4)), rng.normal(size=(30, 2))
    given = Equations(Y, off, 0 * off, np.ones((30, 2)), 0 * off, errors, False, np.full(2, 1e-9))
    *_, last = _starts(given)
    assert not last.x.any()
    assert last.noise == pytest.approx(MIN_NOISE_SHARE * given.mean_square(off))
    assert (last.factors == MAX_VARIANCE_FACTOR).all()
