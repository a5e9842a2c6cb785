"""What must hold of any mechanism: properties over random trees and forests of any joints."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import jounce
from jounce.dynamics.closed_form import closed_form
from jounce.dynamics.computation import Computation
from jounce.model import screws
from jounce.model.mechanism import reference_poses
from jounce.spatial import lie
from jounce.spatial.series import column_series
from support.recursion import inverse_dynamics
from support.robots import (
    Interpreted,
    differentiated_at_once,
    harmonic,
    loads,
    mechanisms,
    random_state,
    relative_error,
)

ORDERS = (0, 1, 2)


def closed_form_state(drawn, order=2):
    mechanism, rng = drawn
    q, W = random_state(rng, mechanism, order)
    return mechanism, [x[:, None] for x in q], closed_form(mechanism, column_series(q), loads(W))


def assert_vanishes(x, scale):
    assert np.abs(x).max() <= 1e-11 * max(scale, 1e-9)


def size(*arrays):
    return max(float(np.abs(x).max()) for x in arrays)


@given(mechanisms())
def test_the_mass_matrix_is_symmetric_positive_definite(drawn):
    _, _, F = closed_form_state(drawn)
    for k in ORDERS:
        assert_vanishes(F.gM[k] - F.gM[k].T, size(F.gM[k]))
    eigenvalues = np.linalg.eigvalsh(F.gM[0])
    assert eigenvalues[0] > 0


@given(mechanisms())
def test_mdot_less_twice_the_skew_form_is_skew_with_its_rates(drawn):
    _, _, F = closed_form_state(drawn)
    S = F.gM.dot - 2 * F.gCbar
    for k in ORDERS:
        assert_vanishes(S[k] + S[k].T, size(F.gM[0], F.gM[k + 1], F.gCbar[k]))


@given(mechanisms())
def test_both_forms_of_c_give_the_same_forces_and_power(drawn):
    _, q, F = closed_form_state(drawn)
    qd = q[1]
    for C in (F.gC, F.gCbar):
        S = F.gM[1] - 2 * C[0]
        assert_vanishes(qd.T @ S @ qd, size(F.gM[0], S) * size(qd) ** 2)
    assert_vanishes((F.gC[0] - F.gCbar[0]) @ qd, size(F.gM[0], F.gC[0]) * size(qd))


@given(mechanisms())
def test_forces_of_every_order_are_reassembled_from_the_matrices(drawn):
    _, (_, qd, q2d, q3d, q4d), F = closed_form_state(drawn)
    M, C, G, E, Q = F.gM, F.gC, F.Qgrav, F.Qext, F.Q
    first = M[0] @ q3d + (M[1] + C[0]) @ q2d + C[1] @ qd + G[1] + E[1]
    second = M[0] @ q4d + (2 * M[1] + C[0]) @ q3d + (M[2] + 2 * C[1]) @ q2d + C[2] @ qd + G[2] + E[2]
    assert relative_error(M[0] @ q2d + C[0] @ qd + G[0] + E[0], Q[0]) < 1e-12  # (EOM1)
    assert relative_error(first, Q[1]) < 1e-12  # (EOM1stOrder)
    assert relative_error(second, Q[2]) < 1e-12  # (EOM2ndOrder)


def potential_energy(mechanism, q):
    """From the heights of the bodies alone."""
    C = Interpreted(jounce.Robot(mechanism)).poses(q)
    moments = np.stack([lie.axial(M[:3, 3:]) / 2 for M in mechanism.M])  # m c
    heights = np.einsum("...bij,bj->...bi", C[..., :3, :3], moments) + mechanism.M[:, 3, 3, None] * C[..., :3, 3]
    return -np.sum(heights @ mechanism.gravity, axis=-1)


@given(mechanisms())
def test_power_is_the_rate_of_energy(drawn):
    """d/dt (T + V) = qd^T (Q - Qext), energies from twists and heights alone."""
    mechanism, rng = drawn
    path = harmonic(rng, mechanism.n, 2)

    def energy(t):
        q, qd, _ = path(t)
        V = closed_form(mechanism, column_series([q, qd])).V[0].reshape(*q.shape[:-1], -1, 6)
        return 0.5 * np.einsum("...bi,bij,...bj", V, mechanism.M, V) + potential_energy(mechanism, q)

    q = path(0)
    Q = inverse_dynamics(mechanism, column_series(q))[0][:, 0]
    power = q[1] @ Q
    assert abs(differentiated_at_once(energy) - power) < 1e-8 * (1 + size(Q))


@pytest.mark.parametrize("order", [1, 2, 3])
@given(drawn=mechanisms())
def test_each_order_is_the_time_derivative_of_the_one_below(order, drawn):
    mechanism, rng = drawn
    path = harmonic(rng, mechanism.n, order + 2)
    w = harmonic(rng, mechanism.nb * 6, order)

    def forces(t, k):
        W = [x.reshape(*x.shape[:-1], -1, 6) for x in w(t)]
        return inverse_dynamics(mechanism, column_series(path(t)), loads(W))[k][..., 0]

    exact = forces(0, order)
    assert np.abs(differentiated_at_once(lambda t: forces(t, order - 1)) - exact).max() < 1e-8 * (1 + size(exact))


@given(mechanisms(), st.floats(-2, 2))
def test_forces_are_linear_in_the_inertial_parameters(drawn, factor):
    mechanism, rng = drawn
    q, _ = random_state(rng, mechanism)
    other = rng.permutation(mechanism.M)

    def forces(M):
        options = screws.ScrewOptions(gravity=mechanism.gravity, G=mechanism.G, g=mechanism.g)
        same = screws.from_screws(mechanism.B, mechanism.X, M, mechanism.parent, options)
        return inverse_dynamics(same, column_series(q)).upto(2)

    for Q, Q_a, Q_b in zip(forces(mechanism.M + factor * other), forces(mechanism.M), forces(other), strict=True):
        assert_vanishes(Q - Q_a - factor * Q_b, size(Q_a, Q_b))


@given(mechanisms())
def test_matrices_formed_from_spatial_twists_are_the_same(drawn):
    """gM = sum J_i^T M_i J_i and gC, with spatial Jacobians and inertias in the place of body-fixed ones."""
    mechanism, rng = drawn
    q, _ = random_state(rng, mechanism)
    F, qd = closed_form(mechanism, column_series(q)), q[1]
    J = Computation("jacobian", order=2, frame="spatial").series("recursion", mechanism, q[:3])
    back = lie.Ad(lie.inverse(Interpreted(jounce.Robot(mechanism)).poses(q[0])))
    M = back.mT @ mechanism.M @ back
    b = lie.ad(J[0] @ qd)
    JT = J[0].mT
    gM = (JT @ M @ J[0]).sum(axis=0)
    gC = (JT @ (M @ J[1] - M @ b @ J[0] - b.mT @ M @ J[0])).sum(axis=0)
    assert relative_error(gM, F.gM[0]) < 1e-12
    assert_vanishes(gC - F.gC[0], size(F.gC[0], gM))


@given(mechanisms())
def test_spatial_data_make_the_same_robot(drawn):
    mechanism, rng = drawn
    A = reference_poses(mechanism)
    Y = [lie.Ad(A_i) @ X for A_i, X in zip(A, mechanism.X, strict=True)]
    data = {"gravity": mechanism.gravity, "G": mechanism.G, "g": mechanism.g}
    same = Interpreted(jounce.Robot.from_spatial_screws(A, Y, mechanism.M, mechanism.parent, **data))
    assert np.abs(same.mechanism.B - mechanism.B).max() < 1e-14 * (1 + mechanism.nb)
    assert np.abs(same.mechanism.X - mechanism.X).max() < 1e-14 * (1 + mechanism.nb)
    q, _ = random_state(rng, mechanism)
    for Q, expected in zip(
        same.inverse_dynamics(*q), Interpreted(jounce.Robot(mechanism)).inverse_dynamics(*q), strict=True
    ):
        assert relative_error(Q, expected) < 1e-12


@given(mechanisms())
def test_a_mimic_joint_equals_its_constraint_eliminated_by_hand(drawn):
    """theta = G q + g: the forces are G^T times those of the free mechanism at theta."""
    mechanism, rng = drawn
    q, W = random_state(rng, mechanism)
    options = screws.ScrewOptions(gravity=mechanism.gravity)
    free = screws.from_screws(mechanism.B, mechanism.X, mechanism.M, mechanism.parent, options)
    theta = [mechanism.G @ x + (mechanism.g if k == 0 else 0) for k, x in enumerate(q)]
    for Q, Q_free in zip(
        Interpreted(jounce.Robot(mechanism)).inverse_dynamics(*q, wrench=tuple(W)),
        Interpreted(jounce.Robot(free)).inverse_dynamics(*theta, wrench=tuple(W)),
        strict=True,
    ):
        assert_vanishes(Q - mechanism.G.T @ Q_free, size(Q_free))


@given(mechanisms())
def test_gravity_forces_are_the_gradient_of_the_potential_energy(drawn):
    mechanism, rng = drawn
    q, along = random_state(rng, mechanism)[0][0], np.eye(mechanism.n)
    gradient = differentiated_at_once(lambda t: potential_energy(mechanism, q + np.multiply.outer(t, along)))
    found = Interpreted(jounce.Robot(mechanism)).gravity_forces(q)
    assert np.abs(found - gradient).max() < 1e-9 * (1 + size(found))
