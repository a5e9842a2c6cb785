"""The axioms of SE(3) and of its adjoint representation, at any scale and over batches."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm

from jounce.spatial import lie
from support.robots import random_pose, random_screw

seeds = st.integers(0, 2**32 - 1).map(np.random.default_rng)
amounts = st.one_of(st.floats(-10, 10), st.floats(-1e-9, 1e-9), st.just(0.0))
kinds = st.sampled_from(["revolute", "prismatic", "helical"])


def near(x, y, scale=1.0):
    assert np.abs(x - y).max() < 1e-13 * scale


def hat4(X):
    H = np.zeros((4, 4))
    H[:3, :3], H[:3, 3] = lie.hat(X[:3]), X[3:]
    return H


@given(seeds)
def test_hat_is_the_cross_product_and_axial_its_inverse(rng):
    x, y = rng.normal(size=(2, 3))
    near(lie.hat(x) @ y, np.cross(x, y))
    T = rng.normal(size=(3, 3))
    near(lie.hat(lie.axial(T)), T - T.T)


@given(seeds, kinds, amounts)
def test_exp_is_the_matrix_exponential(rng, kind, phi):
    X = random_screw(rng, kind)
    near(lie.exp(X, np.array([[phi]])), expm(phi * hat4(X)), 30)


@given(seeds, kinds, amounts, amounts)
def test_exp_is_a_one_parameter_group(rng, kind, phi, psi):
    X = random_screw(rng, kind)
    together = lie.exp(X, np.array([[phi + psi]]))
    near(lie.exp(X, np.array([[phi]])) @ lie.exp(X, np.array([[psi]])), together, 30)
    near(lie.inverse(lie.exp(X, np.array([[phi]]))), lie.exp(X, np.array([[-phi]])), 10)


@given(seeds)
def test_adjoint_is_a_homomorphism(rng):
    C, D = random_pose(rng), random_pose(rng)
    near(lie.Ad(C @ D), lie.Ad(C) @ lie.Ad(D))
    near(lie.Ad(lie.inverse(C)) @ lie.Ad(C), np.eye(6))


@given(seeds)
def test_adjoint_transforms_screws_as_matrices_are_conjugated(rng):
    C, X = random_pose(rng), rng.normal(size=6)
    near(hat4(lie.Ad(C) @ X), C @ hat4(X) @ np.linalg.inv(C), 10)


@given(seeds)
def test_ad_is_the_bracket(rng):
    X, Y = rng.normal(size=(2, 6))
    near(hat4(lie.ad(X) @ Y), hat4(X) @ hat4(Y) - hat4(Y) @ hat4(X), 10)
    near(lie.ad(X) @ Y, -lie.ad(Y) @ X)


@given(seeds, kinds)
def test_ad_is_the_rate_of_the_adjoint(rng, kind):
    X, h = random_screw(rng, kind), 1e-3
    ahead, behind = (lie.Ad(lie.exp(X, np.array([[s * h]]))) for s in (1, -1))
    assert np.abs((ahead - behind) / (2 * h) - lie.ad(X)).max() < 1e-5


@pytest.mark.parametrize("batch", [(), (1,), (3, 2), (0,)])
def test_batches_are_worked_entry_by_entry(batch):
    rng = np.random.default_rng(1)
    X, phi = random_screw(rng, "helical"), rng.normal(size=(*batch, 1, 1))
    C = lie.exp(X, phi)
    assert C.shape == (*batch, 4, 4)
    for index in np.ndindex(batch):
        near(C[index], lie.exp(X, phi[index]))
        near(lie.Ad(C)[index], lie.Ad(C[index]))
        near(lie.inverse(C)[index], lie.inverse(C[index]))
