"""One source of the equations over every scalar type: JAX under jit and vmap, CasADi, SymPy, tracing scalars."""

import math
import re
from pathlib import Path

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest
import sympy

import casadi
import jounce
from jounce.model.mechanism import with_exact_integers
from jounce.program.program import Tape
from jounce.spatial.series import column_series
from support import recursion
from support.quantities import tupled
from support.refusals import expect_refusal, refusal
from support.robots import GOLDEN_NAMES, golden, golden_case, relative_error

jax.config.update("jax_enable_x64", True)

TOLERANCE = 1e-13
METHODS = ("recursion", "closed_form", "paper")


def agree(found, expected, tolerance=TOLERANCE):
    for x, y in zip(found, expected, strict=True):
        assert relative_error(x, y) < tolerance


@pytest.mark.sweep(1)
@pytest.mark.parametrize(
    ("name", "method"), [("mixed5", "recursion"), ("planar2r", "closed_form"), ("planar2r", "paper")]
)
def test_jax_arrays(name, method):
    robot, q, W = golden_case(
        name, order=1 if method == "recursion" else 0
    )  # JAX compiles every operation for every shape
    expected = robot.inverse_dynamics(*q, wrench=tuple(W), method=method)
    found = robot.inverse_dynamics(*map(jnp.asarray, q), wrench=tuple(map(jnp.asarray, W)), method=method)
    assert all(isinstance(Q, jax.Array) for Q in tupled(found))
    agree(tupled(found), tupled(expected))


def test_jax_under_jit_and_vmap():
    robot, q, W = golden_case("planar2r", order=1)
    rng = np.random.default_rng(0)
    q = [rng.normal(size=(5, robot.n)) for _ in q]
    W = [rng.normal(size=(5, *w.shape)) for w in W]

    def one(q, W):
        return robot.inverse_dynamics(*q, wrench=tuple(W), method="recursion")

    many = jax.jit(jax.vmap(one))
    agree(many([jnp.asarray(x) for x in q], [jnp.asarray(w) for w in W]), one(q, W))


def test_each_order_is_the_exact_derivative_of_the_one_below():
    """d/dt along q(t) by forward differentiation in JAX: rounding is all that is left."""
    robot, q, _ = golden_case("mixed5", order=3)
    n = len(q)

    def forces(t):
        path = [sum(q[k + j] * t**j / math.factorial(j) for j in range(n - k)) for k in range(n)]
        return robot.inverse_dynamics(*path[:5], method="recursion")

    _, rates = jax.jvp(forces, (0.0,), (1.0,))
    agree(rates, robot.inverse_dynamics(*q)[1:], 1e-12)


def symbols_of(robot, make, order=2):
    return [np.array([make(f"q{k}_{i}") for i in range(robot.n)], dtype=object) for k in range(order + 3)]


def vanishes(expression, paths):
    """Whether a polynomial in rates of paths, their sines and cosines is zero: without sin^2 its form is unique."""
    names, circles = {}, []
    for p in paths:
        s, c = names[sympy.sin(p)], names[sympy.cos(p)] = sympy.symbols(f"s_{p.func} c_{p.func}")
        circles.append(s**2 + c**2 - 1)
        names |= {
            d: sympy.Symbol(f"d_{p.func}_{d.derivative_count}") for d in (p.diff(p.args[0], k) for k in (1, 2, 3))
        }
    polynomial = sympy.expand_trig(expression.doit()).xreplace(names)
    assert not polynomial.atoms(sympy.Function)
    order = sorted(polynomial.free_symbols, key=lambda x: (not x.name.startswith("s_"), x.name))
    return sympy.reduced(polynomial, circles, *order)[1] == 0


@pytest.mark.sweep(1)
@pytest.mark.parametrize("method", METHODS)
def test_sympy_expressions_of_the_planar_2r_are_exact(method):
    """Symbols in the state and in the data; no floats creep in, and the difference to Lagrange's equations is zero."""
    L1, L2, m1, m2, g, t = sympy.symbols("L1 L2 m1 m2 g t", positive=True)
    robot = jounce.load("planar2r", L1=L1, L2=L2, m1=m1, m2=m2, g=g)
    paths = [sympy.Function(name)(t) for name in ("q1", "q2")]
    state = [np.array([p.diff(t, k) for p in paths], dtype=object) for k in range(4)]
    Q, Qd = robot.inverse_dynamics(*state, method=method)

    x = [L1 * sympy.cos(paths[0]), L1 * sympy.cos(paths[0]) + L2 * sympy.cos(sum(paths))]
    y = [L1 * sympy.sin(paths[0]), L1 * sympy.sin(paths[0]) + L2 * sympy.sin(sum(paths))]
    kinetic = sum(m * (a.diff(t) ** 2 + b.diff(t) ** 2) / 2 for m, a, b in zip((m1, m2), x, y, strict=True))
    lagrangian = kinetic - sum(m * g * b for m, b in zip((m1, m2), y, strict=True))
    for i, p in enumerate(paths):
        force = lagrangian.diff(p.diff(t)).diff(t) - lagrangian.diff(p)
        assert vanishes(Q[i] - force, paths)
        assert vanishes(Qd[i] - force.diff(t), paths)
        assert not sympy.sympify(Q[i]).atoms(sympy.Float)


@pytest.mark.parametrize("name", ["L1", "L2", "m1", "m2", "g"])
def test_parameters_of_the_planar_2r_may_be_symbols_of_casadi(name):
    symbol, state = casadi.SX.sym(name), np.array([[0.3, -0.4], [0.5, 0.6], [-0.7, 0.8]])
    Q = jounce.load("planar2r", **{name: symbol}).inverse_dynamics(*state)
    function = casadi.Function("Q", [symbol], [casadi.vertcat(*Q)])
    expected = jounce.load("planar2r", **{name: 1.7}).inverse_dynamics(*state)
    agree([np.array(function(1.7)).ravel()], [expected])
    with expect_refusal(" holds a CasADi MX; a robot's data may be SX: robot.casadi_function"):
        jounce.load("planar2r", **{name: casadi.MX.sym(name)})


@pytest.mark.parametrize("make", [sympy.Symbol, casadi.SX.sym])
@pytest.mark.parametrize("source", ["iiwa14", "panda", "examples/panda.urdf"])  # of code, of YAML, of URDF
def test_gravity_of_any_robot_may_hold_symbols(source, make, monkeypatch):
    monkeypatch.chdir(Path(__file__).parents[2])
    g = make("g")
    robot = jounce.load(source, gravity=(0, 0, -g), lock={jounce.load(source).joint_names[0]: 0.1})
    Q = robot.gravity_forces(np.zeros(robot.n))
    if make is sympy.Symbol:
        found = [float(sympy.sympify(x).subs(g, 3)) for x in Q]
    else:
        found = np.array(casadi.Function("Q", [g], [casadi.vertcat(*Q)])(3)).ravel()
    expected = jounce.load(source, gravity=(0, 0, -3)).gravity_forces(np.eye(robot.n + 1)[0] * 0.1)[1:]
    agree([found], [expected])


def test_sympy_states_of_a_robot_of_numbers():
    mixed5, q, _ = golden_case("mixed5")
    m = mixed5.mechanism
    robot = jounce.Robot.from_screws(m.B[1:3], m.X[1:3], m.M[1:3], gravity=m.gravity)  # prismatic, helical
    q = [x[1:3] for x in q]
    symbols = symbols_of(robot, sympy.Symbol, 0)
    Q = robot.inverse_dynamics(*symbols)
    function = sympy.lambdify(list(np.concatenate(symbols)), list(Q), "math", cse=True)
    agree([function(*np.concatenate(q[:3]))], [robot.inverse_dynamics(*q[:3])])


@pytest.mark.parametrize("name", GOLDEN_NAMES)
def test_tracing_scalars(name):
    robot, q, _ = golden_case(name)
    tape = Tape()
    Q = robot.inverse_dynamics(*(tape.variables(robot.n) for _ in q))
    found = np.reshape(tape.program(np.ravel(Q)).run(np.ravel(q)), (3, -1))
    agree(found, robot.inverse_dynamics(*q))


QUANTITIES = {  # laws with the rates of q that their values take
    "Q": (recursion.inverse_dynamics, 2),
    "M": (recursion.mass_matrix, 0),
    "C": (recursion.coriolis_matrix, 1),
    "Cbar": (recursion.skew_coriolis_matrix, 1),
    "G": (recursion.gravity_forces, 0),
    "h": (recursion.momentum, 1),
}


@pytest.mark.parametrize(
    ("quantities", "operations"),
    [
        ("Q", (574, 1272, 2328)),
        ("M", (334, 737, 1424)),
        ("C", (1289, 2990, 5665)),
        ("Cbar", (2070, 4678, 8498)),
        ("M C", (1314, 2994, 5669)),
        ("M C G", (1416, 3243, 6155)),
        ("h", (411, 918, 1617)),
    ],
)
def test_the_iiwa_takes_no_more_operations_than_measured(quantities, operations):
    """A guard of the recursion's economy: sums and products of one state, sine and cosine given, all rates together."""
    robot, _, _ = golden_case("iiwa")
    model = with_exact_integers(robot.mechanism)
    for order, most in enumerate(operations):
        tape = Tape()
        q, outputs = [tape.variables(robot.n) for _ in range(order + 3)], []
        for law, rates in (QUANTITIES[name] for name in quantities.split()):
            outputs += [x for term in law(model, column_series(q[: order + rates + 1])).upto(order) for x in term.flat]
        counts = tape.program(outputs).counts()
        assert counts["add"] + counts["sub"] + counts["mul"] <= most


def test_extended_precision_is_kept():
    """On the iiwa, whose axes are exact, both paths agree beyond what doubles could show."""
    robot, q, W = golden_case("iiwa")
    q, W = ([x.astype(np.longdouble) for x in y] for y in (q, W))
    for method in ("closed_form", "paper"):
        for found, Q in zip(
            robot.inverse_dynamics(*q, wrench=tuple(W)),
            robot.inverse_dynamics(*q, wrench=tuple(W), method=method),
            strict=True,
        ):
            assert found.dtype == Q.dtype == np.longdouble
            assert np.abs(found - Q).max() < 1e-18 * 100 * np.abs(Q).max()


def test_scalars_without_sine_are_refused_rather_than_rounded():
    numbers = np.array([mpmath.mpf("0.1")] * 2, dtype=object)
    with expect_refusal(re.compile(r"scalars of type mpf have no method (sin|cos)\(\)")):
        jounce.load("planar2r").inverse_dynamics(numbers, numbers, numbers)


def test_symbolic_pitch_and_direction():
    """A pitch may be a symbol on every path; a direction on the dense ones, and is refused elsewhere."""
    M = [jounce.inertia_matrix(2.0, [0.1, 0.2, 0.3], np.eye(3) * 0.1)]
    h, q = casadi.SX.sym("h"), np.array([casadi.SX.sym("q")], dtype=object)
    screw = np.array([[0, 0, 1, 0, 0, h]], dtype=object)
    robot = jounce.Robot.from_screws([np.eye(4)], screw, M)
    state = [q, np.array([1.0]), np.array([0.5])]
    number = jounce.Robot.from_screws([np.eye(4)], [[0, 0, 1, 0, 0, 0.3]], M)
    for method in ("recursion", "closed_form"):
        [Q] = robot.inverse_dynamics(*state, method=method)
        function = casadi.Function("Q", [h, q[0]], [Q])
        expected = number.inverse_dynamics([0.7], [1.0], [0.5])
        assert float(function(0.3, 0.7)) == pytest.approx(expected[0], rel=1e-13)
    turned = np.array([[casadi.cos(h), casadi.sin(h), 0, 0, 0, 0]], dtype=object)
    robot = jounce.Robot.from_screws([np.eye(4)], turned, M)
    refusal(lambda: robot.inverse_dynamics(*state), "is not made of numbers; use method='closed_form'")
    [Q] = robot.inverse_dynamics(*state, method="closed_form")
    number = jounce.Robot.from_screws([np.eye(4)], [[np.cos(0.3), np.sin(0.3), 0, 0, 0, 0]], M)
    expected = number.inverse_dynamics([0.7], [1.0], [0.5])
    assert float(casadi.Function("Q", [h, q[0]], [Q])(0.3, 0.7)) == pytest.approx(expected[0], rel=1e-12)


def test_data_of_a_robot_are_concrete():
    mechanism = golden("planar2r")[0]
    given = {name: jnp.asarray(getattr(mechanism, name)) for name in ("B", "X", "M", "gravity")}
    assert isinstance(jounce.Robot.from_screws(**given).mechanism.M, np.ndarray)
    with expect_refusal("M is not concrete: …; a state may be traced, the robot's data may not"):
        jax.jit(lambda M: jounce.Robot.from_screws(**given | {"M": M}).mass_matrix([0.0, 0.0]))(given["M"])
    refusal(lambda: jounce.Robot.from_screws(**given | {"B": 2 * given["B"]}), "B[0] is not a pose")


def test_scalars_of_numpy_are_numbers_of_numpy():
    expected = jounce.inertia_matrix(0.5, [0, 0, 1], np.eye(3))
    assert jounce.inertia_matrix(np.float16(0.5), [0, 0, 1], np.eye(3)).dtype == expected.dtype
    with expect_refusal("mass holds complex numbers; expected real numbers"):
        jounce.inertia_matrix(np.complex64(1j), [0, 0, 1], np.eye(3))


@pytest.mark.filterwarnings("ignore:invalid value:RuntimeWarning")
def test_infinity_among_symbols_comes_out_as_nan():
    Q = jounce.load("planar2r").gravity_forces({"joint1": [np.inf, sympy.Symbol("x")], "joint2": 0})
    assert all(np.isnan(float(x)) for x in Q[0])


def test_numbers_of_a_robot_leave_no_floats_among_symbols():
    robot = jounce.load("planar2r")
    q, qd = (np.array(sympy.symbols(names), dtype=object) for names in ("a b", "da db"))
    partly = jounce.load("planar2r", L1=sympy.Symbol("L1"))
    pushed = robot.inverse_dynamics([0, 1], [0, 0], [0, 0], wrench={"body2": sympy.symbols("w:6")})
    assert {type(x) for entry in partly.mechanism.M.flat for x in sympy.sympify(entry).atoms(sympy.Float)} == set()
    assert all("1.0*" not in str(entry) for entry in pushed)
    quantities = [*robot.jacobian(q, qd, body="body2", frame="world"), *robot.mass_matrix(q, qd), robot.poses(q)]
    for quantity in quantities:
        assert not any(sympy.sympify(entry).atoms(sympy.Float) for entry in quantity.flat)


@np.errstate(all="ignore")
def test_whole_numbers_beyond_the_doubles_overflow_as_doubles_do():
    """As integers of any size they would not, until one of them were divided."""
    B = np.stack([np.eye(4)] * 2)
    B[1, 0, 3] = 1e300
    M = jounce.inertia_matrix(1.0, [1, 0, 0], np.zeros((3, 3)))
    robot = jounce.Robot.from_screws(B, [[0, 0, 1, 0, 0, 0]] * 2, [M, M])
    for method in ("kernel", "recursion"):
        assert not np.isfinite(robot.inverse_dynamics(*np.ones((3, 2)), method=method)).all()
