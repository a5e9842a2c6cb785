"""The filters against independent oracles: poles of Butterworth, the Riccati equation of SciPy, dense posteriors."""

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from jounce.live.estimator import correct, innovation_variance, predict, process_noise, start_filters, transition


def steady(h, states):
    """The filter at a scaled spacing h after many samples."""
    steps = np.array([h])
    F, W = transition(steps, states), process_noise(steps, steps, states)
    filters = start_filters(np.zeros(1), 1, 1, states)
    for _ in range(int(60 / h)):
        predict(filters, F, W, keep=False)
        correct(filters, np.zeros((1, 1)))
    predict(filters, F, W, keep=False)
    return filters, F[0], W[0]


@pytest.mark.parametrize("states", [5, 6, 8])
def test_steady_filter_is_that_of_butterworth(states):
    filters, F, _ = steady(0.01, states)
    gain = filters.covariance[0, :, 0, 0] / innovation_variance(filters)[0]
    poles = np.log(np.linalg.eigvals(F @ (np.eye(states) - np.outer(gain, np.eye(states)[0])))) / 0.01
    angles = np.pi / 2 + np.pi * (2 * np.arange(states) + 1) / (2 * states)
    expected = np.exp(1j * angles)
    assert np.abs(np.sort_complex(poles) - np.sort_complex(expected)).max() < 0.02


@pytest.mark.parametrize(("h", "states"), [(0.05, 6), (0.4, 6), (0.1, 5)])
def test_steady_covariance_solves_the_riccati_equation(h, states):
    filters, F, W = steady(h, states)
    expected = solve_discrete_are(F.T, np.eye(states)[:, :1], W, np.eye(1))
    np.testing.assert_allclose(filters.covariance[0, ..., 0], expected, rtol=1e-6)


def test_noise_of_two_steps_adds_up_to_that_of_one():
    a, b, h = np.array([0.3]), np.array([0.7]), np.array([0.1])
    F = transition(b, 6)
    both = F @ process_noise(a, h, 6) @ F.mT + process_noise(b, h, 6)
    np.testing.assert_allclose(both, process_noise(a + b, h, 6), rtol=1e-12)


def test_kept_states_are_those_of_all_samples_together():
    """The posterior of each state given all samples, by dense least squares, at uneven times and with a lost sample."""
    random, states, count, kept = np.random.default_rng(1), 4, 9, 4
    t = np.cumsum(random.uniform(0.05, 0.5, count))
    y, h, lost = random.normal(size=(count, 1)), np.array([0.2]), 5
    filters = start_filters(y[0], 1, kept, states)
    for k in range(1, count):
        steps = np.array([t[k] - t[k - 1]])
        predict(filters, transition(steps, states), process_noise(steps, h, states), keep=True)
        if k != lost:
            correct(filters, y[k] - filters.present)
    # all states at once: the first by its prior, each by the one before, samples of the first components
    size = states * count
    information, right = np.zeros((size, size)), np.zeros(size)
    first = np.linalg.inv(start_filters(y[0], 1, 1, states).covariance[0, ..., 0])
    information[:states, :states] += first
    right[:states] += first @ [y[0, 0], 0, 0, 0]
    for k in range(1, count):
        steps = np.array([t[k] - t[k - 1]])
        D = np.zeros((states, size))
        D[:, states * (k - 1) : states * k], D[:, states * k : states * (k + 1)] = (
            -transition(steps, states)[0], np.eye(states),
        )  # fmt: skip
        information += D.T @ np.linalg.solve(process_noise(steps, h, states)[0], D)
        if k != lost:
            information[states * k, states * k] += 1
            right[states * k] += y[k, 0]
    covariance = np.linalg.inv(information)
    for age in range(kept):
        part, place = slice(size - states * (age + 1), size - states * age), filters.place(age)
        np.testing.assert_allclose(filters.x[0, 0, :, place], (covariance @ right)[part], rtol=1e-4, atol=1e-5)
        np.testing.assert_allclose(
            filters.covariance[0, ..., place], covariance[part, part], rtol=1e-4
        )  # of a prior of 1e8
