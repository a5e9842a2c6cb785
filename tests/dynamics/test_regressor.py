"""Regressors times the inertial parameters are forces, momenta and energies, at every order, by every method."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings

import jounce
from jounce.dynamics.computation import Computation
from jounce.model.drive_trains import DRIVE_TERMS
from jounce.model.mechanism import ancestors
from jounce.native.code_forms import trace_program
from support.bases import moved_mechanisms, random_base
from support.quantities import branched
from support.refusals import refusal
from support.robots import Interpreted, floating, random_mechanism, relative_error


def of_one_state(drawn, order=2):
    m, rng = drawn
    return Interpreted(jounce.Robot(m)), rng.uniform(-2, 2, (order + 3, m.n)), random_base(rng, order + 3)


def energy(robot, q, base=None):
    """T + U and its rates, one for each term of q but the first."""
    U = robot.potential_energy(*q[:-1], base=base and base[:-1])
    return np.add(robot.kinetic_energy(*q, base=base), U)


@given(moved_mechanisms(largest=5))
def test_it_gives_the_forces_and_their_rates_from_the_parameters(drawn):
    robot, q, base = of_one_state(drawn)
    forces = robot.inverse_dynamics(*q, base=base)
    for Y, Q in zip(robot.regressor(*q, base=base), forces, strict=True):
        assert relative_error(Y @ robot.inertial_parameters, Q) < 1e-12


@settings(max_examples=8)
@given(moved_mechanisms(largest=4))
def test_those_of_momentum_and_energy_give_them_and_their_rates(drawn):
    robot, q, base = of_one_state(drawn)
    p = robot.inertial_parameters
    for Yp, momentum in zip(
        robot.momentum_regressor(*q, base=base), robot.generalized_momentum(*q, base=base), strict=True
    ):
        assert relative_error(Yp @ p, momentum) < 1e-12
    for YE, E in zip(robot.energy_regressor(*q, base=base), energy(robot, q, base), strict=True):
        assert relative_error(YE @ p, E) < 1e-12


@settings(max_examples=10)
@given(moved_mechanisms())
def test_forces_are_the_momentum_rate_plus_terms_of_q_and_qd(drawn):
    robot, q, base = of_one_state(drawn, 0)
    rests = []
    for q2d, Vd in ((q[2], base[2]), (0 * q[2], 0 * base[2])):
        moving = {"base": (*base[:2], Vd)}
        rests.append(robot.regressor(*q[:2], q2d, **moving) - robot.momentum_regressor(*q[:2], q2d, **moving)[1])
    assert relative_error(*rests) < 1e-12


@settings(max_examples=10)
@given(moved_mechanisms())
def test_the_power_of_the_forces_is_the_rate_of_the_energy(drawn):
    robot, q, base = of_one_state(drawn, 0)
    if not robot.mechanism.floats:
        base = None  # a ground that moves has power too
    speeds = q[1] if base is None else np.append(base[1], q[1])
    power = speeds @ robot.regressor(*q, base=base)
    Ed = robot.energy_regressor(*q, base=base)[1]
    assert relative_error(power, Ed) < 1e-12


@settings(max_examples=10)
@given(moved_mechanisms())
def test_other_parameters_give_the_forces_of_another_robot(drawn):
    robot, q, base = of_one_state(drawn, 0)
    p = drawn[1].normal(size=robot.inertial_parameters.shape)
    other = robot.robot.with_inertial_parameters(p)
    np.testing.assert_array_equal(other.inertial_parameters, p)
    Q = Interpreted(other).inverse_dynamics(*q, base=base)
    assert relative_error(robot.regressor(*q, base=base) @ p, Q) < 1e-12


def test_joints_do_not_feel_bodies_that_they_do_not_carry():
    m = replace(random_mechanism(np.random.default_rng(3), [-1, 0, 1, 0, -1], ["revolute"] * 5, [1.0] * 5))
    Y = Interpreted(jounce.Robot(m)).regressor(*np.random.default_rng(4).uniform(-1, 1, (3, m.n)))
    felt = np.abs(Y.reshape(m.n, m.nb, 10)).max(axis=-1) > 0
    np.testing.assert_array_equal(felt, ancestors(m).T)


@pytest.mark.parametrize("on_base", [False, True])
def test_columns_of_drive_terms_give_the_forces_of_the_drives(on_base):
    rng = np.random.default_rng(5)
    m = replace(branched().mechanism, elasticity=None, acting=DRIVE_TERMS)
    m = floating(m, rng) if on_base else m
    robot, q, d = Interpreted(jounce.Robot(m)), rng.uniform(-1, 1, (5, 2, m.n)), m.drives
    base = random_base(rng, 5) if on_base else None
    amounts = [d.armature, d.damping, d.friction, d.stribeck, d.stiffness, d.offset]
    p = np.concatenate([robot.inertial_parameters, *amounts])
    for Y, Q in zip(robot.regressor(*q, base=base, drives=True), robot.inverse_dynamics(*q, base=base), strict=True):
        assert relative_error(Y @ p, Q) < 1e-12
    nc = len(m.joints)
    Y = robot.regressor(
        *q[:3], base=base and base[:3], drives=("offset", "damping"), out=(out := 0 * Y[..., : -4 * nc])
    )
    assert Y is out
    of_damping = Y[..., -2 * nc :] @ np.append(d.damping, np.zeros(nc))
    assert relative_error(of_damping, robot_damping(robot, q)) < 1e-12


@pytest.mark.parametrize("on_base", [False, True])
def test_drive_columns_give_momentum_and_energy_of_the_drives(on_base):
    rng = np.random.default_rng(6)
    m = replace(branched().mechanism, elasticity=None, acting=("armature", "spring"))
    m = floating(m, rng) if on_base else m
    robot, q, d = Interpreted(jounce.Robot(m)), rng.uniform(-1, 1, (4, 2, m.n)), m.drives
    base = random_base(rng, 4) if on_base else None
    ones = np.ones(len(m.joints))
    p = np.concatenate([robot.inertial_parameters, d.armature, ones, ones, ones, d.stiffness, ones])
    momenta = robot.generalized_momentum(*q, base=base)
    for Yp, momentum in zip(robot.momentum_regressor(*q, base=base, drives=True), momenta, strict=True):
        assert relative_error(Yp @ p, momentum) < 1e-12
    for YE, E in zip(robot.energy_regressor(*q, base=base, drives=True), energy(robot, q, base), strict=True):
        assert relative_error(YE @ p, E) < 1e-12


def robot_damping(robot, q):
    Q = robot.drive_forces(*q[:3], terms="damping")
    return np.concatenate([np.zeros((2, robot.nv - robot.n)), Q], axis=-1)


def test_the_iiwa_takes_no_more_operations_than_measured():
    m = jounce.load("iiwa14").mechanism
    for name, counts in {
        "regressor": (1303, 3488), "momentum_regressor": (821, 2369), "energy_regressor": (258, 665),
    }.items():  # fmt: skip
        for order, most in enumerate(counts):
            assert trace_program(m, Computation(name, order)).operations <= most, name


def test_bad_input_is_refused_in_one_line():
    robot = jounce.load("planar2r")
    refusal(lambda: robot.with_inertial_parameters(np.ones((2, 10))), "p has shape (2, 10); expected (20,): m, mcx, ")
    p = np.where(np.arange(20) == 14, np.nan, 1.0)
    refusal(lambda: robot.with_inertial_parameters(p), "p: Ixx of 'body2' is nan; expected finite numbers")
    zeros = np.zeros((3, 2))
    refusal(lambda: robot.regressor(*zeros, drives="offsets"), "unknown linear drive term 'offsets'")
    refusal(lambda: robot.regressor(*zeros[:2], None), "q2d is None")
    refusal(lambda: robot.compile("regressor", wrench=True), "regressor takes no wrenches")
