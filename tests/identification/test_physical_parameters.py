"""Physically consistent parameters: the only minimum, near the data, near the robot where these say nothing."""

from dataclasses import replace

import numpy as np
import pytest
from bases import random_base
from files import refusal
from hypothesis import given, settings
from hypothesis import strategies as st
from robots import floating, golden, mechanisms, random_mechanism
from scipy.optimize import minimize

import jounce
from jounce.dynamics.base_parameters import base_parameters
from jounce.identification.physical import WEIGHT, consistent_parameters
from jounce.model import equivalent
from jounce.model.inertial import parameters_of, with_parameters
from jounce.spatial import inertia
from jounce.spatial.lie import exp

TERMS = ("armature", "damping", "friction", "offset")
UNIT_MOMENTS = inertia.moment_matrix(inertia.from_parameters(np.eye(10)))
ROWS, COLUMNS = np.triu_indices(4)


def moments(p):
    """The pseudo-inertias of inertial parameters."""
    return np.tensordot(p.reshape(-1, 10), UNIT_MOMENTS, axes=1)


def log_cholesky(x, T):
    """The inertial parameters of bodies by the upper triangular factors of their pseudo-inertias, after T."""
    U = np.zeros((len(T), 4, 4))
    x = x.reshape(-1, 10)
    U[:, ROWS, COLUMNS] = np.where(ROWS == COLUMNS, np.exp(np.where(ROWS == COLUMNS, x, 0)), x)
    root = T @ U
    return inertia.parameters(inertia.from_moment_matrix(root @ root.mT)).ravel()


def other_bodies(m, rng, far):
    """Parameters of bodies that can exist; the logarithms of their sizes are off by `far`."""
    return log_cholesky(far * rng.normal(size=(len(m.body_names), 10)), np.linalg.cholesky(moments(parameters_of(m))))


def data(m, rng, p, d=(), terms=(), deviation=0.1, count=60):
    """The information, the least-squares estimate and the true values, of forces at random states."""
    base, q = base_parameters(m), rng.uniform(-2, 2, (3, count, m.n))
    moved = (random_base(rng, 3)[0], *rng.uniform(-2, 2, (2, count, 6))) if m.base else None
    Y = jounce.Robot(m).regressor(*q, base=moved, drives=terms, method="recursion")
    Y = np.concatenate([Y[..., base.columns], Y[..., len(p) :]], axis=-1)
    Y = Y.reshape(-1, Y.shape[-1]) / deviation
    true = np.append(base.matrix @ p, d)
    noise = rng.normal(size=len(Y)) if deviation > 1e-4 else 0.0
    return base, Y.T @ Y, np.linalg.lstsq(Y, Y @ true + noise, rcond=None)[0], true


def divergence(Pi, Pi0):
    x = np.linalg.solve(Pi0, Pi)
    return (np.trace(x, axis1=1, axis2=2) - np.linalg.slogdet(x)[1] - 4).sum()


def slopes(found, m, base, A, estimate, weight):
    """The derivative of what is minimised, by relative changes of the pseudo-inertias, and by drive parameters."""
    of_values = A @ (found.values - estimate)
    of_parameters = (base.matrix.T @ of_values[: base.count]).reshape(-1, 10)
    G = (np.linalg.pinv(UNIT_MOMENTS.reshape(10, 16)) @ of_parameters.T).T.reshape(-1, 4, 4)
    Pi, Pi0 = moments(found.parameters), moments(parameters_of(m))
    V = np.linalg.cholesky(Pi)
    return V.mT @ (G + weight * (np.linalg.inv(Pi0) - np.linalg.inv(Pi))) @ V, of_values[base.count :]


@settings(max_examples=8)
@given(mechanisms(largest=3), st.booleans(), st.sampled_from([0.3, 3.0]))
def test_it_is_the_minimum_of_a_convex_function(drawn, floats, deviation):
    """At any estimate, most of them of impossible bodies."""
    m, rng = drawn
    m = floating(m, rng) if floats else m
    base, A, estimate, _ = data(m, rng, parameters_of(m), np.zeros(4 * m.nb), TERMS, deviation)
    estimate += rng.normal(size=len(estimate))
    found = consistent_parameters(m, base, A, estimate, TERMS)
    assert np.linalg.eigvalsh(moments(found.parameters)).min() > 0
    of_bodies, of_drives = slopes(found, m, base, A, estimate, WEIGHT)
    assert np.abs(of_bodies).max() < 1e-4 * WEIGHT
    d = np.concatenate(list(found.drives.values()))
    scale = np.sqrt(estimate @ A @ estimate / np.diag(A)[base.count :])
    slope = of_drives * scale + WEIGHT * d / scale
    held = (d == 0) & np.repeat([True, True, True, False], m.nb)
    assert (d[: 3 * m.nb] >= 0).all()
    assert np.abs(slope[~held]).max(initial=0) < 1e-4 * WEIGHT
    assert slope[held].min(initial=0) > -1e-4 * WEIGHT


def test_another_optimiser_in_other_variables_finds_the_same():
    """Of impossible data, with weights that go to zero: the residual is the smallest of bodies that can exist."""
    rng = np.random.default_rng(0)
    m = random_mechanism(rng, [-1, 0], ["revolute", "revolute"], [2.0, 1.0])
    base, A, estimate, _ = data(m, rng, parameters_of(m), deviation=1.0, count=10)
    estimate = estimate - 0.5 * np.abs(estimate)
    T = np.linalg.cholesky(moments(parameters_of(m)))

    def objective(x, weight):
        p = log_cholesky(x, T)
        off = base.matrix @ p - estimate
        return off @ A @ off / 2 + weight * divergence(moments(p), moments(parameters_of(m)))

    x, excess = np.zeros(20), []
    for weight in (1e-1, 1e-2):
        found = consistent_parameters(m, base, A, estimate, weight=weight)
        own = found.excess / 2 + weight * divergence(moments(found.parameters), moments(parameters_of(m)))
        x = minimize(objective, x, (weight,), method="BFGS", options={"maxiter": 400}).x
        print(weight, found.excess, own, objective(x, weight))
    for weight in (1e-4, 1e-6):
        print(consistent_parameters(m, base, A, estimate, weight=weight).excess)


def test_counts():
    for far in 0.3, 1, 2:
        for seed in range(2):
            rng = np.random.default_rng(seed)
            m = random_mechanism(rng, [-1, 0, 1], ["revolute", "revolute", "revolute"], [2.0, 1.0, 1.0])
            base, A, estimate, _ = data(m, rng, other_bodies(m, rng, far), deviation=0.1, count=60)
            for off in 0, 1:
                estimate = estimate - 0.5 * off * np.abs(estimate)
                for weight in 1e-2, 1e-4, 1e-6:
                    print("COUNT", far, seed, off, weight)
                    consistent_parameters(m, base, A, estimate, weight=weight)
