"""Native code as CasADi functions of many points: derivatives are those that CasADi makes of the recursion itself."""

import gc
from functools import cache

import numpy as np
import pytest

import casadi
import jounce
from support.quantities import branched
from support.refusals import refusal
from support.robots import relative_error

POINTS = 3
ROBOT = branched((-1, 0, -1))
IIWA = jounce.load("iiwa14")
REQUESTS = [
    (IIWA, "inverse_dynamics", 1, {}),
    (ROBOT, "inverse_dynamics", 2, {}),
    (ROBOT, "inverse_dynamics", 0, {"wrench": True}),
    (ROBOT, "poses", 0, {"body": "body2"}),
    (ROBOT, "jacobian", 1, {"body": "body2", "frame": "world"}),
    (ROBOT, "mass_matrix", 1, {}),
    (ROBOT, "kinetic_energy", 1, {}),
    (ROBOT, "forward_dynamics", 0, {}),
    (ROBOT, "inverse_dynamics_partials", 0, {}),
]
IDS = [f"{robot.name}-{quantity}-{order}" for robot, quantity, order, _ in REQUESTS]


def second_derivatives(F, rng):
    """Values, Jacobian, gradient and Hessian of a cost not linear in the results, and products along directions."""
    inputs = [casadi.MX.sym(name, *F.size_in(name)) for name in F.name_in()]
    results = F.call(inputs)
    x, y = casadi.veccat(*inputs), casadi.veccat(*results)
    weights = rng.uniform(-1, 1, y.numel())
    H, g = casadi.hessian(casadi.dot(weights, y) + casadi.sumsqr(y), x)
    along = casadi.jtimes(y, x, rng.uniform(-1, 1, (x.numel(), 2)))
    back = casadi.jtimes(y, x, rng.uniform(-1, 1, (y.numel(), 2)), True)
    found = [y, casadi.jacobian(y, x), g, H, along, back, casadi.jacobian(casadi.sumsqr(back), x)]
    return casadi.Function("derivatives", inputs, found), [rng.uniform(-1, 1, F.size_in(name)) for name in F.name_in()]


@pytest.mark.parametrize(("robot", "quantity", "order", "keywords"), REQUESTS, ids=IDS)
def test_derivatives_are_those_of_the_recursion(robot, quantity, order, keywords):
    F, S = (
        robot.casadi_function(quantity, order, native=native, points=POINTS, **keywords) for native in (True, False)
    )
    assert (F.name(), F.name_in(), F.name_out()) == (S.name().replace("map3_", ""), S.name_in(), S.name_out())
    (found, state), (expected, _) = (second_derivatives(f, np.random.default_rng(0)) for f in (F, S))
    for x, y in zip(found(*state), expected(*state), strict=True):
        assert relative_error(x.full(), y.full()) < 1e-13


def test_jacobians_and_hessians_are_diagonals_of_blocks():
    F = IIWA.casadi_function(order=1, native=True, points=POINTS)
    block = casadi.kron(casadi.DM.eye(POINTS), casadi.DM.ones(7, 7)).sparsity()
    by_name = F.jacobian()
    assert by_name.sparsity_out("jac_Qd_q3d") == by_name.sparsity_out("jac_Q_q") == block
    assert by_name.nnz_out("jac_Q_q3d") == 0  # on which Q does not depend
    second = F.reverse(1).jacobian()
    assert second.sparsity_out("jac_adj_q_q2d") == second.sparsity_out("jac_adj_q_adj_Qd") == block
    assert second.nnz_out("jac_adj_q_out_Q") == second.nnz_out("jac_adj_q3d_adj_Q") == 0


def test_graphs_outlive_the_function_and_the_robot():
    def gradient():
        F = jounce.load("planar2r", L1=0.7).casadi_function(order=0, native=True, points=2)
        q = casadi.MX.sym("q", 2, 2)
        return casadi.Function("gradient", [q], [casadi.gradient(casadi.sumsqr(F(q, 0, 0)), q)])

    found = gradient()
    gc.collect()
    assert found(1).shape == (2, 2)


def test_arrays_are_points_or_shared_by_all():
    F = IIWA.casadi_function(order=0, native=True, points=4)
    q, qd = np.random.default_rng(0).uniform(-1, 1, (2, 4, 7))
    expected = IIWA.inverse_dynamics(q, qd[0], 0 * q)
    assert relative_error(F(q.T, qd[0], 0).full().T, expected) < 1e-15
    assert relative_error(F(q=q.T, qd=qd[0])["Q"].full().T, expected) < 1e-15
    assert F(np.c_[q.T, q.T], 0, 0).shape == (7, 8)  # called twice, as CasADi does


@cache
def function():
    return IIWA.casadi_function(order=0, native=True, points=4)


Z = np.zeros((7, 4))


@pytest.mark.parametrize(("call", "words"), [
    (lambda: IIWA.casadi_function(points=0), "points is 0; expected how many … from 1 to 1000000"),
    (lambda: IIWA.casadi_function(points=2.0), "points is 2.0; expected"),
    (lambda: IIWA.casadi_function(points=True), "points is True; expected"),
    (lambda: IIWA.casadi_function(order=13, native=True), "native code"),
    (lambda: IIWA.casadi_function(native=1), "native is 1; expected True or False"),
    (lambda: IIWA.casadi_function(native=True, parameters=["masses"]), "no parameters, … native=False does"),
    (lambda: IIWA.casadi_function(native=True, moving_base=True), "takes base_pose…; native=False serves it"),
    (lambda: function()(Z[:, :2], Z, Z), "q has shape (7, 2); expected (7, 4) for points=4, or (7, 1)"),
    (lambda: function()(Z.T, Z, Z), "q has shape (4, 7); expected (7, 4)"),
    (lambda: function()(q2d=casadi.MX(7, 3)), "q2d has shape (7, 3); expected (7, 4)"),
    (lambda: function()(Z + 1j, Z, Z), "q is array…; expected real numbers, or a matrix of CasADi"),
    (lambda: function()("a", Z, Z), "q is 'a'; expected real numbers"),
    (lambda: function()(np.ma.masked_array(Z, True), Z, Z), "takes arrays without masks"),
    (lambda: function()(Z, Z), "takes 3 arrays in order, or some by name: q, qd, q2d"),
    (lambda: function()(q3d=Z), "has no input 'q3d'; …available: q, qd, q2d"),
])  # fmt: skip
def test_refusals_are_one_line(call, words):
    refusal(call, words)
