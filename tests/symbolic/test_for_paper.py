"""Expressions as a paper prints them: sums are grouped, sines have short names, closed robots have their constraint."""

from dataclasses import replace

import numpy as np
import pytest
import sympy
from benchmarks.robots import start_of_iiwa
from sympy import cos, sin

import jounce
from jounce.model.frame import Frame
from support.planar2r import L1, L2, g, m1, m2, symbolic_planar2r
from support.refusals import refusal
from support.robots import relative_error


def point_on_arm(l, m):  # noqa: E741
    """A turning arm along which a point mass slides, l from its axis at q2 = 0."""
    B = [np.eye(4, dtype=int), [[1, 0, 0, l], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]]
    none = np.zeros((3, 3), dtype=int)
    M = [jounce.inertia_matrix(mass, [0, 0, 0], none) for mass in (0, m)]
    return jounce.Robot.from_screws(B, [[0, 0, 1, 0, 0, 0], [0, 0, 0, 1, 0, 0]], M, gravity=[0, -g, 0])


def test_sums_of_rates_are_grouped():
    S = symbolic_planar2r().symbolic()
    (q1, q2), (v1, v2), (a1, a2), (j1, j2) = S.q, S.qd, S.q2d, S.q3d
    assert str(S.Q[0]) == str(
        L1**2 * a1 * (m1 + m2) + L2**2 * m2 * (a1 + a2) + L1 * L2 * m2 * (2 * a1 + a2) * cos(q2)
        - L1 * L2 * m2 * v2 * (2 * v1 + v2) * sin(q2) + L1 * g * (m1 + m2) * cos(q1) + L2 * g * m2 * cos(q1 + q2)
    )  # fmt: skip
    assert str(S.Qgravd[1]) == str(-L2 * g * m2 * (v1 + v2) * sin(q1 + q2))
    squared = [term for term in sympy.Add.make_args(S.Q2d[0]) if term.has(cos(q1 + q2))]
    assert [str(term) for term in squared] == [str(-L2 * g * m2 * (v1 + v2) ** 2 * cos(q1 + q2))]
    assert S.Qd[1].has(j1 + j2)


def test_what_multiplies_one_sine_or_cosine_is_joined():
    l, m = sympy.symbols("l m")  # noqa: E741
    S = point_on_arm(l, m).symbolic()
    (q1, q2), (v1, v2), (a1, a2) = S.q, S.qd, S.q2d
    assert str(S.poses("body2")[:2, 3]) == str(sympy.Matrix([(l + q2) * cos(q1), (l + q2) * sin(q1)]))
    assert str(S.Q[1]) == str(m * (g * sin(q1) + a2 - v1**2 * (l + q2)))
    expected = m * (l + q2) ** 2 * a1 + 2 * m * (l + q2) * v1 * v2 + m * g * (l + q2) * cos(q1)
    assert sympy.expand(S.Q[0] - expected) == 0


@pytest.mark.parametrize("robot", [symbolic_planar2r(), start_of_iiwa(3)], ids=["symbols", "numbers"])
def test_each_sine_and_cosine_stands_in_one_term(robot):
    """Where nothing but factors stands in front of the sum."""
    for x in robot.symbolic().Q:
        terms = next((part for part in sympy.Mul.make_args(x) if part.is_Add), x).args
        waves = [term.atoms(sin, cos) for term in terms]
        assert all(len(found) <= 1 for found in waves)
        found = [wave for each in waves for wave in each]
        assert len(set(found)) == len(found) > 1


def test_grouped_decimals_keep_their_values():
    robot = start_of_iiwa(3)
    S = robot.symbolic()
    state = np.random.default_rng(0).uniform(-1, 1, (4, 3))
    values = dict(zip([*S.q, *S.qd, *S.q2d, *S.q3d], state.ravel().tolist(), strict=True))
    found = np.array(S.Qd.subs(values), dtype=float)[:, 0]
    assert relative_error(found, robot.inverse_dynamics(*state)[1]) < 1e-12


def test_short_names_stand_for_sines_and_cosines():
    S = symbolic_planar2r().symbolic()
    short, names = S.abbreviate(S.Q)
    q1, q2 = S.q
    assert {str(name): f for name, f in names.items()} == {
        "c_1": cos(q1), "c_12": cos(q1 + q2), "c_2": cos(q2), "s_2": sin(q2),
    }  # fmt: skip
    assert not short.atoms(sin, cos)
    assert short.subs(names) == S.Q
    assert [sympy.latex(sympy.Symbol(name)) for name in ("c_12", "c_{1-2}")] == ["c_{12}", "c_{1-2}"]


def test_short_names_of_differences_multiples_and_other_angles():
    S = symbolic_planar2r().symbolic()
    q1, q2 = S.q
    alpha = sympy.Symbol("alpha")
    x = sin(q1 - q2) + cos(2 * q1 + q2) + sin(alpha + q1) + cos(q1 / 2)
    short, names = S.abbreviate(x)
    assert {str(name) for name in names} == {"s_{1-2}", "c_112"}
    assert short.atoms(sin, cos) == {sin(alpha + q1), cos(q1 / 2)}
    assert short.subs(names) == x


def test_numbers_beyond_nine_are_separated():
    n = 11
    B, M = [np.eye(4)] * n, [jounce.inertia_matrix(1, [1, 0, 0], np.zeros((3, 3)))] * n
    S = jounce.Robot.from_screws(B, [[0, 0, 1, 0, 0, 0]] * n, M).symbolic()
    _, names = S.abbreviate(sympy.sin(S.q[0] + S.q[9]))
    assert [str(name) for name in names] == ["s_1,10"]


def test_short_names_refuse_what_they_would_hide():
    S = symbolic_planar2r().symbolic()
    refusal(lambda: S.abbreviate(sympy.Symbol("c_1") * cos(S.q[0])), "contains the symbol c_1, a short name; rename it")
    refusal(lambda: S.abbreviate("cos(q1)"), "expects a SymPy expression, matrix or array")


CLOSED = ["fivebar", "fourbar_leg"]


def closed_state(robot):
    """A state of a closed robot, and its rates in all coordinates of the tree."""
    rng = np.random.default_rng(3)
    u = robot.mechanism.closure.start[list(robot.mechanism.closure.independent)] + 0.1
    rates = [u, *rng.uniform(-1, 1, (3, robot.n))]
    return rates, robot.coordinates(*rates)


@pytest.mark.parametrize("name", CLOSED)
def test_the_constraint_of_a_closed_robot_holds_along_its_motions(name):
    robot = jounce.load(name)
    S, (_, whole) = robot.symbolic(), closed_state(robot)
    values = {x: float(v) for k, rate in enumerate(whole) for x, v in zip(S.series["q"][k], rate, strict=True)}
    for gap in (S.gap, S.gapd, S.gap2d, S.gap3d):
        assert gap.shape == (2, 1)  # of a loop in a plane
        assert np.abs(np.array(gap.subs(values), dtype=float)).max() < 1e-12
    apart = values | {S.q[len(S.q) - 1]: 0.3 + values[S.q[len(S.q) - 1]]}
    assert np.abs(np.array(S.gap.subs(apart), dtype=float)).max() > 1e-3
    assert (S.gapd - S.gap.jacobian(S.q) * S.qd).expand() == sympy.zeros(2, 1)


@pytest.mark.parametrize("name", CLOSED)
def test_equations_in_all_coordinates_have_the_forces_of_the_motors(name):
    """With multipliers y, S.Q - A^T y acts at the motors alone, as `inverse_dynamics` of the closed robot says."""
    robot = jounce.load(name)
    S, (rates, whole) = robot.symbolic(), closed_state(robot)
    values = {x: float(v) for k, rate in enumerate(whole) for x, v in zip(S.series["q"][k], rate, strict=True)}
    A, Q = (np.array(x.subs(values), dtype=float) for x in (S.gap.jacobian(S.q), S.Q))
    passive = list(robot.mechanism.closure.dependent)
    y = np.linalg.solve(A[:, passive].T, Q[passive])
    forces = (Q - A.T @ y)[:, 0]
    assert np.abs(forces[passive]).max() < 1e-12
    expected = robot.inverse_dynamics(*rates[:3])
    assert relative_error(forces[list(robot.mechanism.closure.independent)], expected) < 1e-10


def test_a_loop_in_space_has_all_its_rows():
    S = jounce.load("delta").symbolic()
    assert S.gap.shape[1] == 1
    assert S.gap.shape[0] >= 9


def test_a_four_bar_of_symbols_has_its_constraint():
    """A tree with loops that nobody closes: crank a, coupler b on it, rocker c at d, as any textbook writes them."""
    a, b, c, d = sympy.symbols("a b c d", positive=True)

    def at(x):
        return np.array([[1, 0, 0, x], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]], dtype=object)

    rods = [jounce.inertia_matrix(m1, [l / 2, 0, 0], np.diag([0, 0, m1 * l**2 / 12])) for l in (a, b, c)]  # noqa: E741
    tree = jounce.Robot.from_screws([at(0), at(a), at(d)], [[0, 0, 1, 0, 0, 0]] * 3, rods, parent=[-1, 0, -1])
    pin = jounce.Loop(Frame("a", 1, at(b)), Frame("b", 2, at(c)), "revolute", np.array([0, 0, 1]))
    S = jounce.Robot(replace(tree.mechanism, loops=(pin,))).symbolic()
    q1, q2, q3 = S.q
    x = a * cos(q1) + b * cos(q1 + q2) - d - c * cos(q3)
    y = a * sin(q1) + b * sin(q1 + q2) - c * sin(q3)
    turned = sympy.Matrix([[cos(q1 + q2), sin(q1 + q2)], [-sin(q1 + q2), cos(q1 + q2)]])  # to the axes of the coupler
    assert sympy.simplify(S.gap + turned * sympy.Matrix([x, y])) == sympy.zeros(2, 1)
