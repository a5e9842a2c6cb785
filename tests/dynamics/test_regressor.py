"""The regressor times the inertial parameters is the force, at every order, by every method."""

from dataclasses import replace

import numpy as np
import pytest
from bases import moved_mechanisms, random_base
from files import refusal
from hypothesis import given, settings
from quantities import branched
from robots import Interpreted, floating, random_mechanism, relative_error

import jounce
from jounce.dynamics.computation import Computation
from jounce.model.drives import TERMS
from jounce.model.mechanism import ancestors
from jounce.native.forms import program


def of_one_state(drawn, order=2):
    m, rng = drawn
    return Interpreted(jounce.Robot(m)), rng.uniform(-2, 2, (order + 3, m.n)), random_base(rng, order + 3)


@settings(max_examples=20)
@given(moved_mechanisms(largest=5))
def test_it_gives_the_forces_and_their_rates_from_the_parameters(drawn):
    robot, q, base = of_one_state(drawn)
    forces = robot.inverse_dynamics(*q, base=base)
    for Y, Q in zip(robot.regressor(*q, base=base), forces, strict=True):
        assert relative_error(Y @ robot.inertial_parameters, Q) < 1e-12


@settings(max_examples=12)
@given(moved_mechanisms())
def test_every_column_is_that_of_the_closed_form(drawn):
    robot, q, base = of_one_state(drawn)
    for Y, dense in zip(
        *(robot.robot.regressor(*q, base=base, method=x) for x in ("recursion", "closed_form")), strict=True
    ):
        assert relative_error(Y, dense) < 1e-12


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
    m = replace(branched().mechanism, elasticity=None, acting=TERMS)
    m = floating(m, rng) if on_base else m
    robot, q, d = Interpreted(jounce.Robot(m)), rng.uniform(-1, 1, (5, 2, m.n)), m.drives
    base = random_base(rng, 5) if on_base else None
    offsets = rng.normal(size=m.nb)
    p = np.concatenate([robot.inertial_parameters, d.armature, d.damping, d.friction, d.stiffness, offsets])
    forces = robot.inverse_dynamics(*q, base=base)
    constant = np.concatenate([np.zeros(m.nv - m.n), m.G.T @ offsets])
    for k, (Y, Q) in enumerate(zip(robot.regressor(*q, base=base, drives=True), forces, strict=True)):
        assert relative_error(Y @ p, Q + constant * (k == 0)) < 1e-12
    Y = robot.regressor(
        *q[:3], base=base and base[:3], drives=("offset", "damping"), out=(out := 0 * Y[..., : -3 * m.nb])
    )
    assert Y is out
    assert relative_error(Y[..., -2 * m.nb :] @ np.append(d.damping, 0 * offsets), robot_damping(robot, q)) < 1e-12


def robot_damping(robot, q):
    Q = robot.drive_forces(*q[:3], terms="damping")
    return np.concatenate([np.zeros((2, robot.nv - robot.n)), Q], axis=-1)


def test_the_iiwa_takes_no_more_operations_than_measured():
    m = jounce.load("iiwa14").mechanism
    for order, most in enumerate((1303, 3488)):
        assert program(m, Computation("regressor", order)).operations <= most


def test_bad_input_is_refused_in_one_line():
    robot = jounce.load("planar2r")
    refusal(lambda: robot.with_inertial_parameters(np.ones((2, 10))), "p has shape (2, 10); expected (20,): m, mcx, ")
    p = np.where(np.arange(20) == 14, np.nan, 1.0)
    refusal(lambda: robot.with_inertial_parameters(p), "p: Ixx of 'body2' is nan; expected finite numbers")
    zeros = np.zeros((3, 2))
    refusal(lambda: robot.regressor(*zeros, drives="offsets"), "unknown drive column 'offsets'")
    refusal(lambda: robot.regressor(*zeros[:2], None), "q2d is None")
    refusal(lambda: robot.compile("regressor", wrench=True), "regressor takes no wrenches")
