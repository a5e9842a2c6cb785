"""The paper's planar 2R: its six printed expressions, and its data."""

import numpy as np
import pytest
from robots import relative_error

import jounce


def printed(L1, L2, m1, m2, g, q, qd, q2d, q3d, q4d):
    """tau, tau-dot and tau-ddot as the paper prints them."""
    from numpy import cos, sin

    (q1, q2), (v1, v2), (a1, a2), (j1, j2), (s1, s2) = q, qd, q2d, q3d, q4d
    c1, c2, c12, n1, n2, n12 = cos(q1), cos(q2), cos(q1 + q2), sin(q1), sin(q2), sin(q1 + q2)
    tau1 = (
        L1**2 * a1 * m1 + L1**2 * a1 * m2 + L2**2 * a1 * m2 + L2**2 * a2 * m2 + L2 * g * m2 * c12 + L1 * g * m1 * c1
        + L1 * g * m2 * c1 - L1 * L2 * v2**2 * m2 * n2 + 2 * L1 * L2 * a1 * m2 * c2 + L1 * L2 * a2 * m2 * c2
        - 2 * L1 * L2 * v1 * v2 * m2 * n2
    )  # fmt: skip
    tau2 = L2 * m2 * (L1 * n2 * v1**2 + L2 * a1 + L2 * a2 + g * c12 + L1 * a1 * c2)
    tau1d = (
        L1**2 * j1 * m1 + L1**2 * j1 * m2 + L2**2 * j1 * m2 + L2**2 * j2 * m2 - L2 * v1 * g * m2 * n12
        - L2 * v2 * g * m2 * n12 + 2 * L1 * L2 * j1 * m2 * c2 + L1 * L2 * j2 * m2 * c2 - L1 * v1 * g * m1 * n1
        - L1 * v1 * g * m2 * n1 - L1 * L2 * v2**3 * m2 * c2 - 4 * L1 * L2 * a1 * v2 * m2 * n2
        - 2 * L1 * L2 * a2 * v1 * m2 * n2 - 3 * L1 * L2 * a2 * v2 * m2 * n2 - 2 * L1 * L2 * v1 * v2**2 * m2 * c2
    )  # fmt: skip
    tau2d = L2 * m2 * (
        L2 * j1 + L2 * j2 - v1 * g * n12 - v2 * g * n12 + L1 * j1 * c2 + 2 * L1 * a1 * v1 * n2 - L1 * a1 * v2 * n2
        + L1 * v1**2 * v2 * c2
    )  # fmt: skip
    tau1dd = (
        L1**2 * s1 * m1 + L1**2 * s1 * m2 + L2**2 * s1 * m2 + L2**2 * s2 * m2 - 3 * L1 * L2 * a2**2 * m2 * n2
        + L1 * L2 * v2**4 * m2 * n2 - L1 * v1**2 * g * m1 * c1 - L1 * v1**2 * g * m2 * c1 - L2 * a1 * g * m2 * n12
        - L2 * a2 * g * m2 * n12 + 2 * L1 * L2 * s1 * m2 * c2 + L1 * L2 * s2 * m2 * c2 - L1 * a1 * g * m1 * n1
        - L1 * a1 * g * m2 * n1 - L2 * v1**2 * g * m2 * c12 - L2 * v2**2 * g * m2 * c12
        - 6 * L1 * L2 * a1 * a2 * m2 * n2 - 6 * L1 * L2 * j1 * v2 * m2 * n2 - 2 * L1 * L2 * j2 * v1 * m2 * n2
        - 4 * L1 * L2 * j2 * v2 * m2 * n2 - 6 * L1 * L2 * a1 * v2**2 * m2 * c2 - 6 * L1 * L2 * a2 * v2**2 * m2 * c2
        + 2 * L1 * L2 * v1 * v2**3 * m2 * n2 - 2 * L2 * v1 * v2 * g * m2 * c12 - 6 * L1 * L2 * a2 * v1 * v2 * m2 * c2
    )  # fmt: skip
    tau2dd = -L2 * m2 * (
        v1**2 * g * c12 - L2 * s2 - L2 * s1 + v2**2 * g * c12 - 2 * L1 * a1**2 * n2 + a1 * g * n12 + a2 * g * n12
        - L1 * s1 * c2 + L1 * v1**2 * v2**2 * n2 + 2 * v1 * v2 * g * c12 + L1 * a1 * a2 * n2 - 2 * L1 * j1 * v1 * n2
        + 2 * L1 * j1 * v2 * n2 + L1 * a1 * v2**2 * c2 - L1 * a2 * v1**2 * c2 - 4 * L1 * a1 * v1 * v2 * c2
    )  # fmt: skip
    return [tau1, tau2], [tau1d, tau2d], [tau1dd, tau2dd]


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
