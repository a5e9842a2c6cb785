"""Forward dynamics undoes inverse dynamics, with all rates, and agrees with Pinocchio and SymPy."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
import sympy
from files import refusal
from hypothesis import given, settings
from robots import Interpreted, mechanisms, on_its_axis, relative_error

import jounce
from jounce.checks.reference.pinocchio import _build
from jounce.model.drives import TERMS, Drives
from jounce.spatial.linear import Factors, solved
from jounce.spatial.series import Series

with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    import pinocchio


def driven(mechanism, rng):
    """With drives, all terms of which act."""
    names = ("armature", "damping", "friction", "stiffness", "rest")
    drives = Drives(eps=np.full(mechanism.nb, 0.5), **{name: rng.uniform(0.1, 1, mechanism.nb) for name in names})
    return Interpreted(jounce.Robot(replace(mechanism, drives=drives, acting=TERMS)))


@given(mechanisms())
@settings(max_examples=40)
def test_it_undoes_inverse_dynamics(drawn):
    """Trees and forests, joints that follow others, drives, wrenches; orders 0 to 4."""
    robot, rng = driven(*drawn), drawn[1]
    n, nb = robot.robot.n, drawn[0].nb
    q, W = rng.uniform(-1, 1, (7, n)), tuple(rng.uniform(-1, 1, (5, nb, 6)))
    condition = np.linalg.cond(robot.mass_matrix(q[0]))
    Q = robot.inverse_dynamics(*q, wrench=W)
    for method in ("recursion", "closed_form"):
        found = robot.robot.forward_dynamics(*q[:2], *Q, wrench=W, method=method)
        for k, (rate, expected) in enumerate(zip(found, q[2:], strict=True)):
            assert relative_error(rate, expected) < 1e-13 * (10 * condition) ** (k + 1)


@pytest.mark.parametrize("name", ["iiwa14", "panda", "ur5", "anymal"])
def test_native_code_undoes_inverse_dynamics(name):
    robot = jounce.load(name)
    q = np.random.default_rng(3).uniform(-1, 1, (5, 20, robot.n))
    found = robot.forward_dynamics(*q[:2], *robot.inverse_dynamics(*q), method="kernel")
    worst = np.linalg.cond(robot.mass_matrix(q[0])).max()
    for k, (rate, expected) in enumerate(zip(found, q[2:], strict=True)):
        assert relative_error(rate, expected) < 1e-13 * worst ** (k + 1)


@pytest.mark.parametrize("name", ["iiwa14", "ur5", "g1", "anymal"])
def test_accelerations_and_jerks_agree_with_pinocchio(name):
    """Jerks by the chain rule on the partial derivatives of its articulated-body algorithm."""
    robot = Interpreted(jounce.load(name))
    model = _build(pinocchio, robot.robot.mechanism)
    data, rng = model.createData(), np.random.default_rng(2)
    for q, qd, Q, Qd in rng.uniform(-1, 1, (5, 4, robot.robot.n)):
        q2d, q3d = robot.forward_dynamics(q, qd, Q, Qd)
        assert relative_error(q2d, pinocchio.aba(model, data, q, qd, Q)) < 1e-12
        by_q, by_qd, inverse = pinocchio.computeABADerivatives(model, data, q, qd, Q)
        assert relative_error(q3d, by_q @ qd + by_qd @ q2d + inverse @ Qd) < 1e-10


def test_the_planar_2r_to_forty_digits():
    lengths = dict(
        zip(("L1", "L2", "m1", "m2", "g"), map(sympy.Rational, ("0.7", "1.1", "2", "1.5", "9.81")), strict=True)
    )
    robot = jounce.load("planar2r", **lengths)
    state = [np.array([sympy.Float(f"0.{7 * i + k + 1}", 40) for i in range(2)], dtype=object) for k in range(5)]
    Q = robot.inverse_dynamics(*state)
    for rate, expected in zip(robot.forward_dynamics(*state[:2], *Q), state[2:], strict=True):
        assert max(abs(x - y) for x, y in zip(rate, expected, strict=True)) < 1e-37


def test_solved_obeys_the_product_rule():
    rng = np.random.default_rng(0)
    A0 = rng.normal(size=(3, 5, 5))
    A = Series.of([A0 @ A0.mT + np.eye(5), *(x + x.mT for x in rng.normal(size=(3, 3, 5, 5)))])
    X = Series.of(list(rng.normal(size=(4, 3, 5, 2))))
    for found, expected in zip(solved(A, A @ X).upto(3), X.upto(3), strict=True):
        assert relative_error(found, expected) < 1e-9
    b = rng.normal(size=(3, 5, 1))
    assert relative_error(Factors.of(A[0]).solve(b), np.linalg.solve(A[0], b)) < 1e-11


def test_a_singular_mass_matrix_is_refused_by_the_names_of_its_joints():
    m = on_its_axis().mechanism
    robot = jounce.Robot(replace(m, M=0 * m.M))
    assert np.isfinite(robot.inverse_dynamics([0.1], [0.2], [0.3])).all()
    refusal(lambda: robot.forward_dynamics([0.1], [0.2], [0.3]), "mass matrix", "singular", *m.coordinates)
    refusal(lambda: robot.compile("forward_dynamics"), "mass matrix", "singular", *m.coordinates)


def test_forces_are_named_where_they_are_wrong():
    robot = jounce.load("planar2r")
    refusal(lambda: robot.forward_dynamics([0, 0], [0, 0], [0, 0, 0]), "Q has shape (3,)")
    refusal(lambda: robot.forward_dynamics([0, 0], [0, 0], [0, 0], None, [0, 0]), "Qd is None, yet Q2d is given")
    refusal(lambda: robot.forward_dynamics([0, 0], [0, 0], None), "Q is None")
    refusal(lambda: robot.forward_dynamics([0, 0], [0, 0], [0, 0], wrench=(np.zeros((2, 6)),) * 2), "wrench gives")
