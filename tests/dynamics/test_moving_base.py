"""Matrices, momenta and energies with a base that moves: the laws that tie them."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings

import jounce
from jounce.spatial.inertia import moments
from jounce.spatial.lie import Ad, hat, inverse
from jounce.spatial.series import Series, from_rate, join_series
from support.bases import base_path, moved_mechanisms, random_base
from support.comparisons import assert_close
from support.refusals import expect_refusal
from support.robots import (
    Interpreted,
    differentiated_at_once,
    floating,
    harmonic,
    random_mechanism,
    random_pose,
    relative_error,
)

few = settings(max_examples=8)


def state_on_base(drawn, count=5):
    """A robot, its coordinates and base with rates, and velocities with those of the base: all that it has."""
    mechanism, rng = drawn
    q, base = list(rng.uniform(-2, 2, (count, mechanism.n))), random_base(rng, count)
    nu = [np.concatenate(x) for x in zip(base[1:], q[1:], strict=True)] if mechanism.floats else q[1:]
    return Interpreted(jounce.Robot(mechanism)), q, base, nu


@few
@given(drawn=moved_mechanisms())
def test_energy_changes_by_the_power_of_the_joints_and_of_the_base(drawn):
    """d/dt (T + U) = qd . Q + V . F, of the wrench on the base in its axes: on ground that moves too."""
    robot, q, base, _ = state_on_base(drawn)
    T, U = robot.kinetic_energy(*q[:3], base=base[:3]), robot.potential_energy(*q[:2], base=base[:2])
    Q, F = robot.inverse_dynamics(*q[:3], base=base[:3]), robot.base_wrench(*q[:3], base=base[:3])
    on_base = Ad(base[0]).T @ F
    if robot.mechanism.floats:
        assert_close(on_base, Q[:6])
    assert_close(T[1] + U[1], q[1] @ Q[-len(q[1]) :] + base[1] @ on_base)


@few
@given(drawn=moved_mechanisms())
def test_matrices_are_those_of_the_forces_and_of_the_momentum(drawn):
    robot, q, base, nu = state_on_base(drawn)
    M, Md = robot.mass_matrix(*q[:2], base=base[:2] if robot.mechanism.floats else None)
    p, pd = robot.generalized_momentum(*q[:3], base=base[:3])
    T = robot.kinetic_energy(*q[:2], base=base[:2])
    Cbar = robot.coriolis_matrix(*q[:2], base=base[:2], form="skew")
    assert_close(M, M.T)
    assert_close(Md, Cbar + Cbar.T)
    assert np.linalg.eigvalsh(M)[0] > 0
    if robot.mechanism.floats:
        Q, Qgrav = robot.inverse_dynamics(*q[:3], base=base[:3]), robot.gravity_forces(q[0], base=base[0])
        for C in (Cbar, robot.coriolis_matrix(*q[:2], base=base[:2])):
            assert_close(M @ nu[1] + C @ nu[0] + Qgrav, Q)
        assert_close(p, M @ nu[0])
        assert_close(pd, M @ nu[1] + Md @ nu[0])
        assert_close(T, nu[0] @ p / 2)


@few
@given(drawn=moved_mechanisms())
def test_the_rate_of_momentum_is_base_wrench_plus_weight(drawn):
    """About the inertial origin and about the centre of mass, in which the mass is gathered."""
    robot, q, base, nu = state_on_base(drawn)
    m = robot.mechanism.M[:, 3, 3].sum()
    c, cd = robot.center_of_mass(*q[:2], base=base[:2])
    h, hd = robot.momentum(*q[:3], base=base[:3])
    hG, hGd = robot.centroidal_momentum(*q[:3], base=base[:3])
    F, weight = robot.base_wrench(*q[:3], base=base[:3]), m * robot.gravity
    assert_close(hd, F + np.concatenate([np.cross(c, weight), weight]))
    assert_close(hGd, np.concatenate([F[:3] - np.cross(c, F[3:]), F[3:] + weight]))
    assert_close(hG[3:], m * cd)
    assert_close(h[:3], hG[:3] + np.cross(c, m * cd))
    if robot.mechanism.floats:
        A, Ad_ = robot.centroidal_momentum_matrix(*q[:2], base=base[:2])
        assert_close(A @ nu[0], hG)
        assert_close(A @ nu[1] + Ad_ @ nu[0], hGd)


@few
@given(drawn=moved_mechanisms())
def test_the_choice_of_the_inertial_frame_does_not_matter(drawn):
    """Pose and gravity are turned together; momenta, energy and centre of mass are seen from the new frame."""
    mechanism, rng = drawn
    robot, q, base, _ = state_on_base(drawn)
    G = random_pose(rng)
    R, r = G[:3, :3], G[:3, 3]
    turned = Interpreted(jounce.Robot(replace(mechanism, gravity=R @ mechanism.gravity)))
    moved = (G @ base[0], *base[1:])

    def both(name, count, **keywords):
        x, y = (
            getattr(of, name)(*q[:count], base=given[:count], **keywords)
            for of, given in ((robot, base), (turned, moved))
        )
        return x, y

    for name, count in (
        ("inverse_dynamics", 4),
        ("coriolis_matrix", 3),
        ("generalized_momentum", 3),
        ("kinetic_energy", 3),
    ):
        for x, y in zip(*both(name, count), strict=True):
            assert_close(y, x)
    for x, y in zip(*both("momentum", 3), strict=True):
        assert_close(y, Ad(inverse(G)).T @ x)
    for x, y in zip(*both("centroidal_momentum", 3), strict=True):
        assert_close(y, np.concatenate([R @ x[:3], R @ x[3:]]))
    (c, cd), (found, foundd) = both("center_of_mass", 2)
    assert_close(found, R @ c + r)
    assert_close(foundd, R @ cd)
    U, found = both("potential_energy", 1)
    weight = robot.mechanism.M[:, 3, 3].sum()
    assert_close(found, U - weight * (R @ mechanism.gravity) @ r)


@few
@given(drawn=moved_mechanisms(largest=3))
def test_rates_with_a_moving_base_are_time_derivatives(drawn):
    mechanism, rng = drawn
    robot = Interpreted(jounce.Robot(mechanism))
    path, base = harmonic(rng, mechanism.n, 5), base_path(rng, 5)
    moving = {"coriolis_matrix": 2, "momentum": 2, "inverse_dynamics": 3, "centroidal_momentum_matrix": 1}
    for name, count in {**moving, "mass_matrix": 1, "potential_energy": 1, "kinetic_energy": 2}.items():

        def at(t, order, name=name, count=count):
            t = np.asarray(t, dtype=np.longdouble)
            given = [x[: count + order] for x in (path(t), base(t))]
            taken = given[1] if name != "mass_matrix" or mechanism.floats else None
            results = getattr(robot, name)(*given[0], base=taken)
            return results if order == 0 else results[order]

        for order in (1, 2):
            assert_close(
                at(0, order), differentiated_at_once(partial(at, order=order - 1), np.longdouble(0.004)), 1e-11
            )


def test_free_fall():
    """No forces at all: the robot tumbles, its momentum about the centre of mass stays, and that point falls."""
    rng = np.random.default_rng(4)
    m = floating(random_mechanism(rng, [-1, 0, -1], ["revolute", "prismatic", "helical"], [1.0, 2.0, 0.5]), rng)
    robot, n, orders = Interpreted(jounce.Robot(m)), m.n, 4
    q, base = list(rng.uniform(-1, 1, (2, n))), list(random_base(rng, 2))
    M = robot.mass_matrix(q[0])
    for _ in range(orders):  # the next rate of the velocities, in which forces are affine with the factor M
        q, base = [*q, np.zeros(n)], [*base, np.zeros(6)]
        Q = robot.inverse_dynamics(*q, base=tuple(base))
        rate = -np.linalg.solve(M, Q if len(q) == 3 else Q[-1])
        base[-1], q[-1] = rate[:6], rate[6:]
    assert np.abs(robot.inverse_dynamics(*q, base=tuple(base))).max() < 1e-9 * np.abs(rate).max()
    assert np.abs(rate).max() > 1
    hG = robot.centroidal_momentum(*q, base=tuple(base))
    assert np.abs(hG[1][:3]).max() < 1e-12
    assert max(np.abs(x).max() for x in hG[2:]) < 1e-9 * np.abs(rate).max()
    c = robot.center_of_mass(*q, base=tuple(base))
    assert np.abs(c[2] - m.gravity).max() < 1e-12
    assert np.abs(c[3]).max() < 1e-10 * np.abs(rate).max()


def test_a_rigid_body_that_tumbles_by_eulers_equations_takes_no_force():
    """At no order, as seen from a frame off its centre of mass, and whatever a joint without mass beyond does."""
    rng = np.random.default_rng(1)
    m = floating(random_mechanism(rng, [-1], ["revolute"], [0.0]), rng)
    C, (mass, h, _) = random_pose(rng), moments(m.M[0])
    center = h / mass
    inertia = m.M[0, :3, :3] + mass * (hat(center[:, 0]) @ hat(center[:, 0]))

    def cross(w, x):
        return w.map(lambda w: hat(w[:, 0])) @ x

    w = from_rate(rng.normal(size=(3, 1)), lambda w: -(np.linalg.inv(inertia) @ cross(w, inertia @ w)))
    field = from_rate(C[:3, :3].T @ m.gravity[:, None], lambda g: -cross(w, g))
    u = from_rate(rng.normal(size=(3, 1)), lambda u: field - cross(w, u))  # of the centre of mass
    V = join_series([w, u - cross(w, Series.constant(center))], axis=-2)
    base = (C, *(V[k][:, 0] for k in range(6)))
    Q = Interpreted(jounce.Robot(m)).inverse_dynamics(*rng.normal(size=(7, 1)), base=base)
    for k in range(5):
        assert np.abs(Q[k]).max() < 1e-13 * mass * max(np.abs(V[j]).max() for j in range(k + 2))


@pytest.mark.parametrize("far", [0.0, 1e6])
def test_centroidal_momentum_far_from_the_origin_keeps_its_digits(far):
    rng = np.random.default_rng(2)
    m = floating(random_mechanism(rng, [-1, 0], ["revolute"] * 2, [1.0, 2.0]), rng)
    q, base = rng.uniform(-1, 1, (3, 2)), list(random_base(rng, 3))
    robot = Interpreted(jounce.Robot(m))
    expected = robot.centroidal_momentum(*q, base=tuple(base))
    base[0] = base[0] + far * np.eye(4, k=3)
    for x, y in zip(robot.centroidal_momentum(*q, base=tuple(base)), expected, strict=True):
        assert relative_error(x, y) < 1e-13


def test_a_robot_without_mass_has_no_center_of_mass():
    robot = jounce.load("planar2r", m1=0, m2=0)
    for name in ("center_of_mass", "centroidal_momentum_matrix"):
        with expect_refusal("^'planar2r' has no centre of mass, as all masses are 0; give"):
            getattr(robot, name)([0, 0])
    assert robot.mass_matrix([0, 0], method="closed_form").shape == (2, 2)
