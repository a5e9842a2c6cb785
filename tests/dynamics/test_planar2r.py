"""The paper's planar 2R: its six printed expressions, and its data."""

import numpy as np
import pytest

import jounce
from support.planar2r import printed
from support.robots import relative_error


@pytest.mark.parametrize("method", ["closed_form", "paper", "recursion"])
@pytest.mark.parametrize("seed", range(10))
def test_equals_the_printed_expressions(method, seed):
    rng = np.random.default_rng(seed)
    data = dict(zip(("L1", "L2", "m1", "m2", "g"), rng.uniform(0.3, 3, 5), strict=True))
    state = rng.uniform(-2, 2, (5, 2))
    found = jounce.load("planar2r", **data).inverse_dynamics(*state, method=method)
    for result, expected in zip(found, printed(*data.values(), *state), strict=True):
        assert relative_error(result, expected) < 1e-13


def test_point_masses_have_no_moment_about_their_own_axis():
    """Erratum: the paper prints m L^2 as xx entry of M_i, which no point mass at (L, 0, 0) has; it never enters Q."""
    robot = jounce.load("planar2r", L1=1.5, m1=2.0)
    M = robot.mechanism.M[0]
    assert M[0, 0] == 0
    assert M[1, 1] == M[2, 2] == 2.0 * 1.5**2
    printed_M = robot.mechanism.M.copy()
    printed_M[:, 0, 0] = printed_M[:, 1, 1]
    other = jounce.Robot.from_screws(robot.mechanism.B, robot.mechanism.X, printed_M, gravity=robot.gravity)
    state = np.random.default_rng(0).uniform(-2, 2, (5, 2))
    np.testing.assert_allclose(other.inverse_dynamics(*state), robot.inverse_dynamics(*state), rtol=1e-13)


def test_gravity_upwards_reverses_all_its_terms():
    """Erratum: the published script of this robot takes gravity along +y, against the printed expressions."""
    state = np.random.default_rng(1).uniform(-2, 2, (5, 2))
    data = {"L1": 1.5, "L2": 0.7, "m1": 2.0, "m2": 0.9}
    expected, without, published = (printed(*data.values(), g, *state) for g in (9.81, 0, -9.81))
    down, up = (jounce.load("planar2r", **data, g=g).inverse_dynamics(*state) for g in (9.81, -9.81))
    for k in range(3):
        np.testing.assert_allclose(down[k], expected[k], rtol=1e-12)
        np.testing.assert_allclose(up[k], published[k], rtol=1e-12)
        np.testing.assert_allclose(up[k] + down[k], 2 * np.array(without[k]), rtol=1e-12, atol=1e-12)
        assert np.abs(up[k] - expected[k]).max() > 0.1
