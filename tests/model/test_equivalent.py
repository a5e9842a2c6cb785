"""Equivalent mechanisms have equal forces, whatever the passes move and however masses differ."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import jounce
from jounce.dynamics.closed_form import closed_form
from jounce.model import equivalent_mechanisms
from jounce.model.mechanism import robot_size
from jounce.spatial import lie
from jounce.spatial.inertia import from_moments, moments
from jounce.spatial.series import column_series
from support.recursion import inverse_dynamics
from support.robots import GOLDEN_NAMES, Interpreted, floating, golden, loads, mechanisms, random_pose, random_state

PASSES = {
    "aligned": equivalent_mechanisms.align_frames,
    "turned": lambda m: equivalent_mechanisms.turn_frames(equivalent_mechanisms.align_frames(m)),
    "slid": lambda m: equivalent_mechanisms.slide_origins(equivalent_mechanisms.align_frames(m)),
    "base_parameters": lambda m: equivalent_mechanisms.reduce_inertias(equivalent_mechanisms.align_frames(m)),
    "minimal": equivalent_mechanisms.minimal_mechanism,
}


def equal_forces(mechanism, other, rng, tolerance=1e-11):
    q, _ = random_state(rng, mechanism)
    given = closed_form(mechanism, column_series(q)).Q.upto(2)
    for Q, expected in zip(closed_form(other, column_series(q)).Q.upto(2), given, strict=True):
        assert np.abs(Q - expected).max() <= tolerance * max(np.abs(expected).max(), 1e-9)


@pytest.mark.parametrize("name", PASSES)
@given(drawn=mechanisms(spread=True))
def test_passes_leave_the_forces_unchanged(name, drawn):
    """Masses from 1e-6 to 1e4 kg side by side."""
    mechanism, rng = drawn
    equal_forces(mechanism, PASSES[name](mechanism), rng, 1e-10)


@given(drawn=mechanisms())
def test_frames_moved_by_rigid_transforms_leave_the_forces(drawn):
    mechanism, rng = drawn
    T = np.stack([random_pose(rng) for _ in range(mechanism.nb)])
    sizes = np.array([1, 1, 1, robot_size(mechanism)])
    T[:, :3] *= sizes
    moved = equivalent_mechanisms.reframe(mechanism, T)
    equal_forces(mechanism, moved, rng)
    off = equivalent_mechanisms.frame_shifts(mechanism, moved) - T
    assert np.abs(off[:, :3] / sizes).max() < 1e-13


def floating_mass_matrix(mechanism, q):
    """The sum of J^T M J over all bodies, J their Jacobians from (base, joints): M[3, 3] is the mass of all."""
    arm = replace(
        mechanism,
        B=mechanism.B[1:],
        M=mechanism.M[1:],
        parent=tuple(p - 1 for p in mechanism.parent[1:]),
        owners=tuple(i - 1 for i in mechanism.owners),
        bodies=mechanism.bodies[1:],
        floats=False,
    )
    C, J = (getattr(Interpreted(jounce.Robot(arm)), name)(q) for name in ("poses", "jacobian"))
    of_bodies = [np.hstack([lie.Ad(lie.inverse(C_i)), J_i]) for C_i, J_i in zip(C, J, strict=True)]
    of_base = np.eye(6, mechanism.nv)
    return sum(J.T @ M @ J for J, M in zip([of_base, *of_bodies], mechanism.M, strict=True))


@pytest.mark.parametrize("name", ["base_parameters", "minimal"])
@given(drawn=mechanisms())
def test_passes_leave_what_a_floating_base_feels_unchanged(name, drawn):
    """All of the mass matrix, whose first rows are the inertia of the whole robot: nothing is dropped at the base."""
    mechanism, rng = drawn
    given = floating(mechanism, rng)
    other = PASSES[name](given)
    q = rng.uniform(-2, 2, given.n)
    M = floating_mass_matrix(given, q)
    assert np.abs(floating_mass_matrix(other, q) - M).max() <= 1e-12 * np.abs(M).max()


@given(drawn=mechanisms(), seed=st.integers(0, 2**32 - 1))
def test_recursion_agrees_with_the_closed_form_under_wrenches(drawn, seed):
    mechanism, _ = drawn
    rng = np.random.default_rng(seed)
    q, W = random_state(rng, mechanism, 3)
    found = inverse_dynamics(mechanism, column_series(q), loads(W)).upto(3)
    for Q, expected in zip(found, closed_form(mechanism, column_series(q), loads(W)).Q.upto(3), strict=True):
        assert np.abs(Q - expected).max() < 1e-12 * (1 + np.abs(expected).max())


@given(drawn=mechanisms())
def test_what_a_turn_about_the_axis_does_is_split_off(drawn):
    """As of DH parameters: what is left leaves one of the parent's axes where it is, wherever that is possible."""
    chain = equivalent_mechanisms.align_to_axes(drawn[0])
    for i, (B, X) in enumerate(zip(chain.B, chain.X, strict=True)):
        S, Z = equivalent_mechanisms.split_turn(B, X)
        assert np.abs(S @ Z - B).max() < 4e-15
        assert (Z[2:, :] == np.eye(4)[2:]).all()
        assert (Z[:, 2:] == np.eye(4)[:, 2:]).all()
        p, only = chain.parent[i], list(chain.parent).count(chain.parent[i]) == 1
        if p >= 0 and only and X[2] and chain.X[p][2]:
            assert np.count_nonzero((S[:3, :3] != 0) & (np.abs(S[:3, :3]) != 1)) <= 4
            assert np.count_nonzero(S[:3, 3]) <= 2


def test_origins_do_not_slide_far_along_axes_that_are_nearly_parallel():
    R = lie.rotation(lie.exp(np.eye(6)[0], np.array(1e-6)))
    B = [np.eye(4), lie.pose(R, np.array([[0.1], [0.2], [0.3]]))]
    M = [np.diag([1.0, 1, 1, 1, 1, 1])] * 2
    chain = equivalent_mechanisms.align_to_axes(jounce.Robot.from_screws(B, [[0, 0, 1, 0, 0, 0]] * 2, M).mechanism)
    assert np.abs(chain.B[:, :3, 3]).max() < 1


@pytest.mark.parametrize("name", GOLDEN_NAMES)
def test_minimal_mechanisms_have_their_exact_zeros(name):
    chain = equivalent_mechanisms.minimal_mechanism(golden(name)[0])
    for X, M in zip(chain.X, chain.M, strict=True):
        turns, pitch = X[2], X[5]
        assert (X[[0, 1, 3, 4]] == 0).all()
        assert turns in (0, 1)
        m, h, P = moments(M)
        if turns:
            assert P[2, 2] == 0
        else:
            assert (P == 0).all()
        if turns and pitch == 0:
            assert m == 0
            assert h[2] == 0


def test_offsets_that_can_vanish_do():
    chain = equivalent_mechanisms.minimal_mechanism(golden("iiwa")[0])
    offsets = chain.B[:, :3, 3]
    assert np.count_nonzero(offsets) == 2  # the upper arm and the forearm, one number each
    assert set(np.unique(chain.B[:, :3, :3])) <= {-1.0, 0.0, 1.0}


@given(mechanisms(largest=1))
def test_moments_and_inertia_matrix_are_inverse(drawn):
    M = drawn[0].M[0]
    assert np.abs(from_moments(*moments(M)) - M).max() < 1e-14 * np.abs(M).max()


@pytest.mark.parametrize("e", [*np.eye(3), *-np.eye(3), np.array([1e-9, 0, -1]), np.ones(3) / np.sqrt(3)])
def test_alignment_turns_z_to_any_axis(e):
    e = e / np.linalg.norm(e)
    R = equivalent_mechanisms.turn_to(e)
    np.testing.assert_allclose(R[:, 2], e, atol=1e-15)
    np.testing.assert_allclose(R.T @ R, np.eye(3), atol=1e-15)
    assert np.linalg.det(R) > 0
    assert lie.pose(R, np.zeros((3, 1))).shape == (4, 4)
