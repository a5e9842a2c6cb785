"""Physically consistent parameters: the only minimum, near the data, near the robot where these say nothing."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize
from scipy.stats import chi2

import jounce
from jounce.checks.audit import check_inertias
from jounce.dynamics.base_parameters import base_parameters
from jounce.identification.physical_consistency import DEFAULT_DIVERGENCE_WEIGHT, fit_consistent_parameters
from jounce.model import body_parameters, equivalent_mechanisms
from jounce.spatial import inertia
from support.bases import random_base
from support.refusals import refusal
from support.robots import floating, mechanisms, random_inertia, random_mechanism, random_pose
from support.units import ANY_UNITS, SI, Units, coordinate_factors, in_units, joint_factors, velocity_factors

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
    return log_cholesky(
        far * rng.normal(size=(m.nb, 10)), np.linalg.cholesky(moments(body_parameters.inertial_parameters(m)))
    )


def information_and_estimate(m, rng, p, d=(), terms=(), deviation=0.1, count=60, u=SI):
    """The information, the least-squares estimate and the true values, of forces at random states in units u."""
    base, q = base_parameters(m), rng.uniform(-2, 2, (3, count, m.n)) * coordinate_factors(m, u)
    moved = None
    if m.floats:
        moved = (u.pose(random_base(rng, 3)[0]), *rng.uniform(-2, 2, (2, count, 6)) * u.twist)
    Y = jounce.Robot(m).regressor(*q, base=moved, drives=terms, method="recursion")
    Y = np.concatenate([Y[..., base.columns], Y[..., len(p) :]], axis=-1)
    Y = (Y * (velocity_factors(m, u) / u.of(2, 1) / deviation)[:, None]).reshape(-1, Y.shape[-1])
    true = np.append(base.matrix @ p, d)
    noise = rng.normal(size=len(Y)) if deviation > 1e-4 else 0.0
    size = np.where(Y.any(axis=0), np.linalg.norm(Y, axis=0), 1.0)  # where columns depend, the least relative values
    return base, Y.T @ Y, np.linalg.lstsq(Y / size, Y @ true + noise, rcond=None)[0] / size, true


def sizes(m, u, base, terms):
    """How many new units an old one is: of inertial parameters, and of what is fitted."""
    of_bodies, v = np.tile(u.inertial, m.nb), joint_factors(m, u)
    of_drives = [u.of(2, 1) / (v * v if term in ("armature", "damping") else v) for term in terms]
    return of_bodies, np.concatenate([of_bodies[base.columns], *of_drives])


def divergence(Pi, Pi0):
    x = np.linalg.solve(Pi0, Pi)
    return (np.trace(x, axis1=1, axis2=2) - np.linalg.slogdet(x)[1] - 4).sum()


def can_exist(m, found):
    return not check_inertias(body_parameters.with_inertial_parameters(m, found.parameters))


def slopes(found, m, base, A, estimate, weight, unit):
    """The derivative of what is minimised, by relative changes of the pseudo-inertias, and by drive parameters."""
    of_values = A @ (found.values - estimate)
    of_parameters = (base.matrix.T @ of_values[: base.count] * unit).reshape(-1, 10)
    G = (np.linalg.pinv(UNIT_MOMENTS.reshape(10, 16)) @ of_parameters.T).T.reshape(-1, 4, 4)
    Pi, Pi0 = (
        moments(found.parameters / unit),
        moments(body_parameters.inertial_parameters(m) / unit),
    )  # inverses take equal sizes
    V = np.linalg.cholesky(Pi)
    return V.mT @ (G + weight * (np.linalg.inv(Pi0) - np.linalg.inv(Pi))) @ V, of_values[base.count :]


@settings(max_examples=8)
@given(mechanisms(largest=3, units=st.just(SI)), ANY_UNITS, st.booleans(), st.sampled_from([0.3, 3.0]))
@example(
    (
        random_mechanism(np.random.default_rng(0), [-1, 0], ["revolute", "prismatic"], [2.0, 1.0]),
        np.random.default_rng(1),
    ),
    Units(1e-6, 1e9),
    True,
    0.3,
)
@example(
    (
        random_mechanism(np.random.default_rng(2), [-1, 0], ["helical", "revolute"], [2.0, 1.0]),
        np.random.default_rng(3),
    ),
    Units(1e4, 1e-9),
    False,
    0.3,
)
def test_it_is_the_minimum_of_a_convex_function(drawn, u, floats, deviation):
    """At any estimate, most of them of impossible bodies."""
    m, rng = drawn
    m = in_units(floating(m, rng) if floats else m, u)
    base, A, estimate, _ = information_and_estimate(
        m, rng, body_parameters.inertial_parameters(m), np.zeros(4 * len(m.joints)), TERMS, deviation, u=u
    )
    unit, of_values = sizes(m, u, base, TERMS)
    estimate += rng.normal(size=len(estimate)) * of_values
    found = fit_consistent_parameters(m, base, A, estimate, TERMS)
    assert np.linalg.eigvalsh(moments(found.parameters / unit)).min() > 0
    of_bodies, of_drives = slopes(found, m, base, A, estimate, DEFAULT_DIVERGENCE_WEIGHT, unit)
    assert np.abs(of_bodies).max() < 1e-4 * DEFAULT_DIVERGENCE_WEIGHT
    d = np.concatenate(list(found.drives.values()))
    deviations = np.diag(A)[base.count :] ** -0.5
    scale = np.sqrt(estimate @ A @ estimate) * deviations
    slope = (of_drives + DEFAULT_DIVERGENCE_WEIGHT * d / scale**2) * deviations
    held = (d == 0) & np.repeat([True, True, True, False], len(m.joints))
    assert (d[: 3 * len(m.joints)] >= 0).all()
    assert np.abs(slope[~held]).max(initial=0) < 1e-3
    assert slope[held].min(initial=0) > -1e-3


def test_another_optimiser_in_log_cholesky_parameters_finds_the_same():
    rng = np.random.default_rng(0)
    m = random_mechanism(rng, [-1], ["revolute"], [2.0])
    base, A, estimate, _ = information_and_estimate(
        m, rng, body_parameters.inertial_parameters(m), deviation=1.0, count=10
    )
    Pi0 = moments(body_parameters.inertial_parameters(m))
    estimate = estimate * [1.0, 2.0, -0.5]
    found = fit_consistent_parameters(m, base, A, estimate)

    def objective(p):
        off = base.matrix @ p - estimate
        return off @ A @ off / 2 + DEFAULT_DIVERGENCE_WEIGHT * divergence(moments(p), Pi0)

    T = np.linalg.cholesky(Pi0)
    other = minimize(lambda x: objective(log_cholesky(x, T)), np.zeros(10), method="BFGS")
    assert objective(found.parameters) <= other.fun
    np.testing.assert_allclose(objective(found.parameters), other.fun, rtol=1e-4)


def test_impossible_data_get_the_best_fit_of_possible_bodies():
    """A moment of inertia below zero becomes almost zero: that of a mass on the axis, with small arms."""
    M = random_inertia(np.random.default_rng(0), 1.0)
    m = jounce.Robot.from_screws([np.eye(4)], [[0, 0, 1, 0, 0, 0]], [M], gravity=[0, -9.81, 0]).mechanism
    base, scale = base_parameters(m), 1e3
    estimate = np.array([0.0, 0.0, -1.0])
    assert [name[-3:] for name in base.names] == ["mcx", "mcy", "Izz"]
    for weight in (1.0, 1e-2, 1e-4):
        found = fit_consistent_parameters(m, base, scale * np.eye(3), estimate, weight=weight)
        assert scale < scale * np.sum((found.values - estimate) ** 2) < scale + 8 * weight


@pytest.mark.parametrize("far", [0.1, 1.0])
@pytest.mark.parametrize("floats", [False, True])
def test_exact_data_of_bodies_that_can_exist_are_met(far, floats):
    rng = np.random.default_rng(1)
    m = random_mechanism(rng, [-1, 0, 1], ["revolute", "prismatic", "helical"], [3.0, 1.0, 0.5])
    m = floating(m, rng) if floats else m
    p, d = other_bodies(m, rng, far), np.append(rng.uniform(0, 1, 9), rng.normal(size=3))
    base, A, estimate, true = information_and_estimate(m, rng, p, d, TERMS, deviation=1e-5)
    found = fit_consistent_parameters(m, base, A, estimate, TERMS)
    off = (
        found.values - true
    )  # in what is seen: armature and the moment of inertia of the first joint are not told apart
    assert off @ A @ off < 1e-12 * (true @ A @ true)
    assert list(found.drives) == list(TERMS)
    np.testing.assert_array_equal(np.concatenate(list(found.drives.values())), found.values[base.count :])
    np.testing.assert_allclose(base.matrix @ found.parameters, found.values[: base.count], rtol=1e-12)
    assert can_exist(m, found)


@settings(max_examples=6)
@given(mechanisms(largest=3, units=st.just(SI)), ANY_UNITS, st.integers(0, 10))
def test_what_the_data_do_not_see_stays(drawn, u, rank):
    """Data of few directions, whose estimate is that of the robot, or nothing."""
    m, rng = drawn
    m = in_units(replace(m, drives=replace(m.drives, friction=rng.uniform(0, 2, m.nb))), u)
    base, terms = base_parameters(m), ("friction", "offset")
    unit, of_values = sizes(m, u, base, terms)
    own = body_parameters.inertial_parameters(m) / unit
    Y = rng.normal(size=(rank, base.count + 2 * m.nb)) * 1e3 / of_values
    d = np.append(m.drives.friction, np.zeros(m.nb))
    found = fit_consistent_parameters(m, base, Y.T @ Y, np.append(base.values, d), terms)
    scale = np.abs(own).max()
    np.testing.assert_allclose(found.parameters / unit, own, rtol=1e-6, atol=1e-7 * scale)
    np.testing.assert_allclose((found.values[base.count :] - d) / of_values[base.count :], 0, atol=1e-6)
    estimate = rng.normal(size=base.count + 2 * m.nb) * of_values
    nothing = fit_consistent_parameters(m, base, 0 * Y.T @ Y, estimate, terms)
    np.testing.assert_allclose(nothing.parameters / unit, own, rtol=1e-12, atol=1e-12 * scale)
    np.testing.assert_array_equal(nothing.values[base.count :], d)


def test_a_robot_that_does_nothing_stays_as_it_is():
    """At rest without gravity an offset is seen, which is zero."""
    m = replace(jounce.load("iiwa14").mechanism, gravity=np.zeros(3))
    base = base_parameters(m)
    A = np.diag(np.repeat([0.0, 1.0], [base.count, 7]))
    found = fit_consistent_parameters(m, base, A, np.zeros(len(A)), ("offset",))
    np.testing.assert_array_equal(found.drives["offset"], 0.0)
    np.testing.assert_array_equal(A @ found.values, 0.0)


def test_noise_is_followed_within_its_deviations():
    """Bodies that can exist are no farther from the data than the truth is, and no farther from it than the data."""
    rng = np.random.default_rng(2)
    m = random_mechanism(rng, [-1, 0, 1], ["revolute"] * 3, [3.0, 1.0, 0.5])
    chi = []
    for _ in range(20):
        p = other_bodies(m, rng, 0.3)
        base, A, estimate, true = information_and_estimate(m, rng, p, deviation=0.5, count=30)
        found = fit_consistent_parameters(m, base, A, estimate)
        off, noise = found.values - true, estimate - true
        prior = 2 * DEFAULT_DIVERGENCE_WEIGHT * divergence(moments(p), moments(body_parameters.inertial_parameters(m)))
        assert (found.values - estimate) @ A @ (found.values - estimate) <= noise @ A @ noise + prior
        chi.append((noise @ A @ noise, off @ A @ off))
        assert can_exist(m, found)
    low, high = chi2.ppf([1e-3, 1 - 1e-3], 20 * base.count)
    of_data, of_bodies = np.sum(chi, axis=0)
    assert low < of_data < high
    assert of_bodies < 1.1 * of_data


def test_frames_of_bodies_do_not_matter():
    rng = np.random.default_rng(3)
    m = random_mechanism(rng, [-1, 0], ["revolute"] * 2, [3.0, 1.0])
    p, T = other_bodies(m, rng, 0.3), [random_pose(rng) for _ in range(2)]

    def in_frames(p):
        return body_parameters.inertial_parameters(
            equivalent_mechanisms.reframe(body_parameters.with_inertial_parameters(m, p), T)
        )

    found = [
        fit_consistent_parameters(
            x, *information_and_estimate(x, np.random.default_rng(4), parameters, deviation=0.5, count=10)[:3]
        ).parameters
        for x, parameters in ((m, p), (equivalent_mechanisms.reframe(m, T), in_frames(p)))
    ]
    np.testing.assert_allclose(in_frames(found[0]), found[1], atol=1e-6 * np.abs(found[1]).max())


def test_points_get_an_extent_and_what_has_no_mass_keeps_none():
    m = jounce.load("planar2r").mechanism
    p = body_parameters.inertial_parameters(m)
    base, A, estimate, _ = information_and_estimate(m, np.random.default_rng(5), 2 * p)
    found = fit_consistent_parameters(m, base, A, estimate)
    assert (found.thickened, found.massless) == (("body1", "body2"), ())
    assert np.linalg.eigvalsh(moments(found.parameters)).min() > 0
    np.testing.assert_allclose(found.values, 2 * base.values, atol=0.1)
    blind = fit_consistent_parameters(m, base, 0 * A, estimate).parameters - p
    extent = 1e-3 * np.array([0, 0, 0, 0, 2, 0, 2, 0, 0, 2])  # of a thousandth of the squared distance of the joints
    np.testing.assert_allclose(blind, np.tile(extent, 2), atol=1e-12)
    light = body_parameters.with_inertial_parameters(m, p * np.repeat([0, 1], 10))
    found = fit_consistent_parameters(light, base_parameters(light), A, estimate)
    assert (found.thickened, found.massless) == (("body2",), ("body1",))
    np.testing.assert_array_equal(found.parameters[:10], 0.0)


def test_an_impossible_robot_gets_the_bodies_near_it():
    robot = jounce.load("iiwa14")  # rounded parameters: link2 is flat, the others break the triangle inequality
    base, k = robot.base_parameters(), robot.base_parameters().count
    found = fit_consistent_parameters(robot.mechanism, base, np.eye(k), base.values)
    assert found.thickened == ("link2", "link4", "link7")
    assert can_exist(robot.mechanism, found)


@pytest.mark.parametrize(("factors", "words"), [
    ([0, 0], "no body has mass"),
    ([1, -1], "body 'body2' has mass -1 kg"),
    ([1, np.append(0, np.ones(9))], "body 'body2' has mass 0 kg and moments"),
])  # fmt: skip
def test_without_a_start_there_is_one_line(factors, words):
    m = jounce.load("planar2r").mechanism
    p = body_parameters.inertial_parameters(m).reshape(2, 10) * np.stack([np.broadcast_to(x, 10) for x in factors])
    m = body_parameters.with_inertial_parameters(m, p.ravel())
    refusal(lambda: fit_consistent_parameters(m, base_parameters(m), np.eye(6), np.ones(6)), words)
