"""Forward dynamics undoes inverse dynamics, with all rates, and agrees with Pinocchio and SymPy."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
import sympy
from hypothesis import given, settings
from hypothesis import strategies as st

import casadi
import jounce
from jounce.checks.compare import build_pinocchio_model
from jounce.dynamics import mobility
from jounce.dynamics.recursion import matrices
from jounce.dynamics.recursion.articulated import ArticulatedBodies, has_deep_branches
from jounce.model.drive_trains import ALL_DRIVE_TERMS
from jounce.model.mechanism import with_exact_integers
from jounce.program.passes import factor
from jounce.program.program import Tape
from jounce.spatial.linear import Factors, solve_series
from jounce.spatial.series import Series, column_series
from support.bases import moved_mechanisms, random_base
from support.refusals import refusal
from support.robots import (
    Interpreted,
    floating,
    mechanisms,
    on_base,
    on_its_axis,
    random_chain,
    random_mechanism,
    relative_error,
    with_drives,
)

with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    import pinocchio


def driven_robot(drawn):
    return Interpreted(jounce.Robot(with_drives(*drawn, ALL_DRIVE_TERMS)))


def long_chain(n=14):
    """A chain of joints at odd angles, long enough for articulated bodies."""
    return random_chain(n, ("revolute", "helical"), seed=1)


def load_robot(name):
    """A bundled robot, or the chain."""
    return jounce.Robot(long_chain()) if name == "chain" else jounce.load(name)


def undoes_inverse_dynamics(robot, rng, order, methods, base=None):
    """Whether rates come back, all but rounding of them and of what forces alone would cause.

    Rounding of forces grows by the condition of M; of rates, each takes on that of those below it.
    """
    n, nb = robot.robot.n, len(robot.robot.body_names)
    q, W = rng.uniform(-1, 1, (order + 3, n)), tuple(rng.uniform(-1, 1, (order + 1, nb, 6)))
    M = robot.mass_matrix(q[0])
    Q = robot.inverse_dynamics(*q, wrench=W, base=base)
    floats = robot.mechanism.floats
    rates = [np.concatenate(x) for x in zip(base[2:], q[2:], strict=True)] if floats else q[2:]
    given = base[:2] if floats else base
    for method in methods:
        found = robot.robot.forward_dynamics(*q[:2], *Q, wrench=W, base=given, method=method)
        for k, (rate, expected) in enumerate(zip(found, rates, strict=True)):
            scale = max(np.abs(expected).max(), np.linalg.norm(np.linalg.inv(M), 2) * np.abs(Q[k]).max())
            assert np.abs(rate - expected).max() < 1e-13 * (k + 1) ** 3 * np.linalg.cond(M) * scale


@given(mechanisms())
def test_it_undoes_inverse_dynamics(drawn):
    """Trees and forests, joints that follow others, drives, wrenches; orders 0 to 4."""
    undoes_inverse_dynamics(driven_robot(drawn), drawn[1], 4, ["recursion", "closed_form"])


@given(moved_mechanisms())
@settings(max_examples=12)
def test_it_undoes_inverse_dynamics_on_a_base_that_moves(drawn):
    """The accelerations of a floating base are found, those of the ground given; wrenches on the base too."""
    base = random_base(drawn[1], 6)
    undoes_inverse_dynamics(driven_robot(drawn), drawn[1], 3, ["recursion", "closed_form"], base)


def test_no_force_changes_the_momentum_about_the_center_of_mass():
    """Whatever the joints do; the center of mass falls."""
    rng = np.random.default_rng(5)
    robot = Interpreted(jounce.Robot(floating(random_mechanism(rng, [-1, 0, -1], ["revolute"] * 3, [1.0] * 3), rng)))
    q, base, Q = rng.uniform(-1, 1, (2, 3)), random_base(rng, 2), rng.uniform(-1, 1, (4, 9))
    Q[:, :6] = 0
    rates = robot.forward_dynamics(*q, *Q, base=base)
    motion, moved = [*q, *(x[6:] for x in rates)], (*base, *(x[:6] for x in rates))
    scale = np.abs(rates[-1]).max()
    for hGd in robot.centroidal_momentum(*motion, base=moved)[1:]:
        assert np.abs(hGd[:3]).max() < 1e-12 * scale
    c = robot.center_of_mass(*motion, base=moved)
    assert np.abs(c[2] - robot.gravity).max() < 1e-12
    assert np.abs(c[3:]).max() < 1e-12 * scale


def test_it_undoes_inverse_dynamics_of_long_chains():
    rng = np.random.default_rng(4)
    undoes_inverse_dynamics(driven_robot((long_chain(), rng)), rng, 2, ["recursion"])


@given(mechanisms(), st.booleans(), st.booleans())
def test_articulated_bodies_agree_with_factors(drawn, armature, floats):
    m, rng = with_drives(*drawn, ALL_DRIVE_TERMS), drawn[1]
    m = floating(m, rng) if floats else m
    m = replace(
        m, acting=("armature",) if armature else ("damping",), G=np.eye(len(m.joints)), coordinates=m.joints
    )  # each joint on its own
    q, b = rng.uniform(-1, 1, (2, 3, m.n, 1)), rng.uniform(-1, 1, (3, m.nv, 2))
    M = jounce.Robot(m).mass_matrix(q[0, ..., 0], method="recursion")
    found, expected = ArticulatedBodies.of(m, q[0]).solve(b), Factors.of(M).solve(b)
    assert relative_error(found, expected) < 1e-13 * np.linalg.cond(M).max()


@pytest.mark.parametrize(("n", "floats"), [(7, False), (14, False), (2, True), (7, True)])
def test_the_way_with_fewer_operations_is_taken(n, floats):
    m = long_chain(n)
    m = with_exact_integers(floating(m, np.random.default_rng(3)) if floats else m)
    counts = []
    for solver in (
        lambda q: ArticulatedBodies.of(m, q),
        lambda q: Factors.of(matrices.mass_matrix(m, column_series([q[:, 0]]))[0]),
    ):
        tape = Tape()
        q, b = tape.variables(n, 1), tape.variables(m.nv, 1)
        counts.append(factor(tape.program(solver(q).solve(b)[:, 0])).operations)
    assert (counts[0] < counts[1]) == has_deep_branches(m)


def test_articulated_bodies_take_symbols_as_pitches():
    h, q = casadi.SX.sym("h"), np.array([[0.3]])
    robot = jounce.Robot.from_screws([np.eye(4)], np.array([[0, 0, 1, 0, 0, h]], dtype=object), [np.eye(6)])
    [[x]] = ArticulatedBodies.of(robot.mechanism, q).solve(np.array([[2.0]]))  # of M = 1 + h^2
    assert float(casadi.Function("x", [h], [x])(3.0)) == pytest.approx(0.2, rel=1e-14)


def test_joints_that_follow_others_need_factors():
    m = long_chain()
    assert has_deep_branches(m)
    assert not has_deep_branches(replace(m, G=m.G[:, :-1], coordinates=m.coordinates[:-1]))


@pytest.mark.parametrize(("name", "order"), [("panda", 2), ("chain", 0)])
def test_native_code_undoes_inverse_dynamics(name, order):
    robot = load_robot(name)
    q = np.random.default_rng(3).uniform(-1, 1, (3 + order, 20, robot.n))
    Q = robot.inverse_dynamics(*q, method="recursion")
    found = robot.compile("forward_dynamics", order=order)(*q[:2], *(Q if order else [Q]))
    worst = np.linalg.cond(robot.mass_matrix(q[0], method="recursion")).max()
    for k, (rate, expected) in enumerate(zip(found if order else [found], q[2:], strict=True)):
        assert relative_error(rate, expected) < 1e-13 * worst ** (k + 1)


@pytest.mark.parametrize("name", ["iiwa14", "ur5", "g1", "anymal", "chain"])
def test_accelerations_and_jerks_agree_with_pinocchio(name):
    """Jerks by the chain rule on the partial derivatives of its articulated-body algorithm."""
    robot = Interpreted(load_robot(name))
    model = build_pinocchio_model(pinocchio, robot.robot.mechanism)
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
    for found, expected in zip(solve_series(A, A @ X).upto(3), X.upto(3), strict=True):
        assert relative_error(found, expected) < 1e-9
    b = rng.normal(size=(3, 5, 1))
    assert relative_error(Factors.of(A[0]).solve(b), np.linalg.solve(A[0], b)) < 1e-11


def test_a_singular_mass_matrix_is_refused_by_the_names_of_its_joints():
    m = on_its_axis().mechanism
    robot = jounce.Robot(replace(m, M=0 * m.M))
    assert np.isfinite(robot.inverse_dynamics([0.1], [0.2], [0.3])).all()
    refusal(lambda: robot.forward_dynamics([0.1], [0.2], [0.3]), "mass matrix", "singular", *m.coordinates)
    refusal(lambda: robot.compile("forward_dynamics"), "mass matrix", "singular", *m.coordinates)


def with_massless_wrist():
    """The iiwa14 without the mass of links 5 and 6: where joints 5 and 7 are parallel, at q6 = 0, M is singular."""
    m = jounce.load("iiwa14").mechanism
    return jounce.Robot(replace(m, M=np.where(np.isin(np.arange(7), (4, 5))[:, None, None], 0.0, m.M)))


SINGULAR_WARNING = "(divide by zero|invalid value) encountered"


@pytest.mark.parametrize("method", [None, "kernel", "recursion", "closed_form"])
@pytest.mark.parametrize("given_out", [False, True])
def test_a_mass_matrix_singular_at_one_position_gives_infinities(method, given_out):
    """Pivots are rounding there, not zero: plain results would be numbers that no two methods agree on."""
    robot, rng = with_massless_wrist(), np.random.default_rng(2)
    q, qd, Q = rng.uniform(-1, 1, (3, 2, 3, 7))
    q[0, 1, 5] = q[1, 2, 5] = 0.0
    singular = q[..., 5] == 0
    out = (np.empty((2, 3, 7)),) * given_out or None
    for _ in range(2):  # later calls take no shorter way
        with pytest.warns(RuntimeWarning, match=SINGULAR_WARNING):
            found = robot.forward_dynamics(q, qd, Q, method=method, out=out and out[0])
        assert not np.isfinite(found[singular]).any()
        accelerations = found[~singular]
        back = robot.inverse_dynamics(q[~singular], qd[~singular], accelerations)
        np.testing.assert_allclose(back, Q[~singular], atol=1e-8)
    assert out is None or found is out[0]
    with pytest.warns(RuntimeWarning, match=SINGULAR_WARNING):
        partials = robot.forward_dynamics_partials(q[0, 1], qd, Q)  # at one position, for many velocities
    assert not any(np.isfinite(x).any() for x in partials)


@pytest.mark.parametrize(("q6", "singular"), [(1e-7, True), (1e-9, True), (1e-4, False), (0.3, False)])
def test_a_mass_matrix_of_rounding_errors_is_singular(q6, singular):
    """The least pivot grows with the square of q6."""
    robot, q = with_massless_wrist(), np.array([0.3, 0.4, 0.5, 0.6, 0.7, q6, 0.2])
    with warnings.catch_warnings(record=True) as said, np.errstate(all="warn"):
        warnings.simplefilter("always")
        found = robot.forward_dynamics(q, np.zeros(7), np.ones(7))
    assert (bool(said), np.isfinite(found).all()) == (singular, not singular)


def test_mass_matrices_are_checked_if_a_body_resists_no_motion():
    for name in ("iiwa14", "planar2r", "g1"):
        assert not mobility.may_be_singular(jounce.load(name).mechanism)
    robot = with_massless_wrist()
    assert mobility.may_be_singular(robot.mechanism)
    m = on_its_axis().mechanism
    geared = replace(m, M=0 * m.M, drives=replace(m.drives, armature=np.ones(1)))
    assert not mobility.may_be_singular(replace(geared, acting=("armature",)))
    assert mobility.may_be_singular(geared)
    assert mobility.may_be_singular(on_base(m, np.diag([1.0, 1, 0, 1, 1, 1])))
    assert not mobility.may_be_singular(on_base(m, np.eye(6)))


@pytest.mark.parametrize(("of_base", "of_body", "idle"), [(0, 1, "base, joint1"), (1, 0, "joint1")])
def test_a_floating_robot_without_inertia_is_refused_by_its_base(of_base, of_body, idle):
    m = on_its_axis().mechanism
    M = jounce.inertia_matrix(1, [0, 0, 0], np.eye(3))
    robot = jounce.Robot(on_base(replace(m, M=of_body * m.M), of_base * M))
    given = [0.1], [0.2], np.zeros(7)
    words = f"singular, of rank 6 for 7 velocities: {idle} can move"
    refusal(lambda: robot.forward_dynamics(*given, base=(np.eye(4), np.zeros(6))), words)


def test_the_acceleration_of_a_floating_base_is_not_given():
    robot = jounce.Robot(floating(on_its_axis().mechanism, np.random.default_rng(0)))
    base, state = (np.eye(4), *np.zeros((2, 6))), ([0.1], [0.2], np.zeros(7))
    words = "base gives 3 terms, up to Vd; forward_dynamics of order 0 with these rates of q takes base=(C, V)"
    refusal(lambda: robot.forward_dynamics(*state, base=base), words)
    refusal(lambda: robot.forward_dynamics([0.1], [0.2], [0.3], base=base[:2]), "Q has shape (1,); expected (..., 7)")


def test_symbolic_form_names_the_quantities_to_solve_with():
    robot = jounce.load("planar2r")
    with pytest.raises(AttributeError, match=r"forward_dynamics has no symbolic form, .* mass_matrix"):
        robot.symbolic().forward_dynamics  # noqa: B018
    refusal(lambda: robot.codegen("latex", outputs=["forward_dynamics"]), "forward_dynamics", "mass_matrix")


def test_forces_are_named_where_they_are_wrong():
    robot = jounce.load("planar2r")
    refusal(lambda: robot.forward_dynamics([0, 0], [0, 0], [0, 0, 0]), "Q has shape (3,)")
    refusal(lambda: robot.forward_dynamics([0, 0], [0, 0], [0, 0], None, [0, 0]), "Qd is None, yet Q2d is given")
    refusal(lambda: robot.forward_dynamics([0, 0], [0, 0], None), "Q is None")
    refusal(lambda: robot.forward_dynamics([0, 0], [0, 0], [0, 0], wrench=(np.zeros((2, 6)),) * 2), "wrench gives")
