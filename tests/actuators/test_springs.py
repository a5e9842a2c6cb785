"""Springs: laws, tables and their inverses, and forces and deflections that move."""

import pickle

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest
import sympy

import casadi
import jounce
from jounce.dynamics import joint_springs
from jounce.model import spring_deflection as deflection_solver
from jounce.model.spring_deflection import UnreachableError, spring_deflection
from jounce.model.springs import CubicSpring, SpringFunction, SpringTable, force_along
from jounce.program.program import Tape
from jounce.spatial.series import Series
from support.natives import native, signature
from support.refusals import expect_refusal, refusal

CUBIC = CubicSpring(500.0, 2e4)
ROW = np.linspace(-0.6, 0.6, 121)
LAWS = {
    "cubic": (CUBIC, lambda d: 500 * d + 2e4 * d**3),
    "softening": (CubicSpring(500.0, -100.0), lambda d: 500 * d - 100 * d**3),
    "function": (SpringFunction.of(lambda d: 500 * d + 2e4 * d**3), lambda d: 500 * d + 2e4 * d**3),
    "sinh": (SpringFunction.of(lambda d: 300 * np.sinh(2 * d) / 2), lambda d: 150 * mpmath.sinh(2 * d)),
    "quotient": (SpringFunction.of(lambda d: 90 * d / (4 - d * d)), lambda d: 90 * d / (4 - d * d)),
    "waves": (
        SpringFunction.of(lambda d: 90 * d + np.sin(5 * d) - np.cos(3 * d) + np.tanh(d) + np.exp(-d) + np.sqrt(d + 2)),
        lambda d: 90 * d + mpmath.sin(5 * d) - mpmath.cos(3 * d) + mpmath.tanh(d) + mpmath.exp(-d) + mpmath.sqrt(d + 2),
    ),
}
laws = pytest.mark.parametrize("name", LAWS)


def deflection_rates(t, order):
    """d = 0.3 sin(t + 0.2) and its rates."""
    return Series.of([0.3 * np.sin(t + 0.2 + k * np.pi / 2) for k in range(order + 1)])


@laws
def test_derivatives_are_those_of_the_law(name):
    spring, law = LAWS[name]
    d = np.array([-0.41, 0.0, 0.13, 0.5])
    found = spring._derivatives(d)
    with mpmath.workdps(40):
        for k in range(6):
            expected = [float(mpmath.diff(law, mpmath.mpf(x), k)) for x in d.tolist()]
            np.testing.assert_allclose(found[k], expected, rtol=1e-13, atol=1e-11)


@laws
def test_forces_of_a_moving_spring_have_their_rates(name):
    spring, law = LAWS[name]
    t = 0.4
    found = np.ravel(force_along(spring, deflection_rates(np.array([t]), 4)).upto(4))
    with mpmath.workdps(40):
        expected = [float(mpmath.diff(lambda t: law(mpmath.mpf("0.3") * mpmath.sin(t + 0.2)), t, k)) for k in range(5)]
    np.testing.assert_allclose(found, expected, rtol=1e-12)


@laws
def test_deflections_undo_forces_with_their_rates(name):
    spring, _ = LAWS[name]
    t = np.linspace(0, 6, 50)
    given = deflection_rates(t, 4)
    found = joint_springs.deflect_spring(spring, force_along(spring, given))
    for k in range(5):
        np.testing.assert_allclose(found[k], given[k], atol=1e-13 * 10**k)


@pytest.mark.parametrize("force", [0.0, 1e-300, -1e-12, 3.0, -1e4, 1e7])
def test_deflections_of_any_size_are_found(force):
    for spring in (CUBIC, LAWS["sinh"][0]):
        d = spring_deflection(spring, np.array([force]))
        np.testing.assert_allclose(spring._derivatives(d)[0], [force], rtol=1e-13)


def exact_deflection(spring, force):
    """x + x^3 = y, x = 2/sqrt(3) sinh(asinh(3 sqrt(3) y/2) / 3), to 60 digits."""
    with mpmath.workdps(60):
        k, k3, Q = map(mpmath.mpf, (spring.k, spring.k3, float(force)))
        y, root = Q / k * mpmath.sqrt(k3 / k), mpmath.sqrt(3)
        return float(mpmath.sqrt(k / k3) * 2 / root * mpmath.sinh(mpmath.asinh(3 * root * y / 2) / 3))


def traced_deflection(spring, Q):
    tape = Tape()
    return tape.program(spring_deflection(spring, tape.variables(1)))


def by_casadi(spring, Q):
    symbol = casadi.SX.sym("Q")
    function = casadi.Function("f", [symbol], list(spring_deflection(spring, np.array([symbol], dtype=object))))
    return [float(function(x)) for x in Q]


def by_jax(spring, Q):
    with jax.enable_x64(True):
        return np.asarray(spring_deflection(spring, jnp.asarray(Q)))


ON_SCALARS = {
    "NumPy": spring_deflection,
    "long doubles": lambda spring, Q: spring_deflection(spring, Q.astype(np.longdouble)),
    "tape": lambda spring, Q: [traced_deflection(spring, Q).run([x])[0] for x in Q.tolist()],
    "native": lambda spring, Q: native(traced_deflection(spring, Q), signature(((1,),), ((1,),), (0,)))(Q[:, None])[
        :, 0
    ],
    "SymPy": lambda spring, Q: spring_deflection(
        spring, np.array([sympy.Float(x, 25) for x in Q.tolist()], dtype=object)
    ),
    "CasADi": by_casadi,
    "JAX": by_jax,
}
SIZES = np.concatenate([[0.0, 1e-300, 3e-200], np.geomspace(1e-150, 1e150, 61), np.geomspace(1e-3, 1e7, 61)])


@pytest.mark.parametrize("kind", ON_SCALARS)
@pytest.mark.parametrize("spring", [CUBIC, CubicSpring(1e-3, 1e4), CubicSpring(1e9, 1e-200), CubicSpring(1e-20, 1e10)])
def test_cubic_springs_are_inverted_to_rounding_on_every_scalar_type(spring, kind):
    """Forces Q of all sizes, in units of k sqrt(k / k3) from 1e-300 to 1e150."""
    Q = SIZES[::3] if kind == "SymPy" else SIZES
    Q = Q * min(spring.k * (spring.k / spring.k3) ** 0.5, 1.0) * np.resize([1, -1], Q.size)
    expected = [exact_deflection(spring, x) for x in Q]
    found = np.asarray(ON_SCALARS[kind](spring, Q), dtype=float)
    np.testing.assert_allclose(found, expected, rtol=1e-15, atol=1e-307)  # JAX takes denormal numbers for 0


@pytest.mark.parametrize("kind", ["NumPy", "SymPy", "native"])
def test_start_values_and_steps_have_room(kind, monkeypatch):
    """One step less is not enough; so the test above sees whether they are."""
    monkeypatch.setattr(deflection_solver, "HALLEY_STEPS", 2)
    Q = np.array([1e150])
    found = np.asarray(ON_SCALARS[kind](CubicSpring(1.0, 1.0), Q), dtype=float)
    assert 1e-8 < abs(found[0] / exact_deflection(CubicSpring(1.0, 1.0), Q[0]) - 1) < 1e-6


def test_linear_springs_divide():
    np.testing.assert_array_equal(
        spring_deflection(CubicSpring(4.0), np.array([sympy.Symbol("Q")])), [sympy.Symbol("Q") * 0.25]
    )


def test_springs_soft_at_rest_have_deflection_rates_under_force():
    spring, Q = CubicSpring(0.0, 64.0), np.array([0.0, 1e-300, -8.0, 1e200])
    np.testing.assert_allclose(spring_deflection(spring, Q), np.cbrt(Q) / 4, rtol=1e-15)
    given = Series.of([np.array([-8.0, 1.0]), np.array([1.0, 3.0]), np.zeros(2)])
    found = joint_springs.deflect_spring(spring, given)
    for found_rate, rate in zip(force_along(spring, found).upto(2), given.upto(2), strict=True):
        np.testing.assert_allclose(found_rate, rate, rtol=1e-14, atol=1e-14)


@pytest.mark.parametrize(("Q", "refused"), [(0.0, True), (0.9e-8, True), (1.2e-8, False)])
def test_rates_are_refused_where_a_force_is_rounding_of_others(Q, refused):
    forces = Series.of([np.array([1.0, Q]), np.array([1.0, 1e-3])])
    found = joint_springs.deflect_spring(CubicSpring(0.0, 64.0), forces, 1.0)
    assert np.isfinite(found[0]).all()
    if refused:
        with expect_refusal("^the spring has no stiffness where it carries … k above 0", kind=UnreachableError) as e:
            found[1]
        assert e.value.state == 1
    else:
        np.testing.assert_allclose(found[1][1], 1e-3 / (3 * 4 * Q ** (2 / 3)), rtol=1e-14)


def test_forces_beyond_the_steps_are_refused():
    with expect_refusal("^no deflection of the spring carries 1e+200", kind=UnreachableError):
        spring_deflection(CubicSpring(1.0, 1.0), np.array([1e200]))


@pytest.mark.parametrize(("k", "fixed"), [(1.01e-60, True), (0.99e-60, False), (0.0, False)])
def test_springs_of_hardly_any_stiffness_have_no_fixed_steps(k, fixed):
    """sqrt(k3 / k) / k = 1e100 at k = 1e-60, k3 = 1e20."""
    spring = CubicSpring(k, 1e20)
    assert spring.has_fixed_steps == fixed
    if not fixed:
        with expect_refusal("springs for symbols are linear or stiffen$"):
            spring_deflection(spring, np.array([sympy.Symbol("Q")]))


def test_a_table_is_the_function_that_it_samples():
    """With the error of a spline of degree five: h^(6 - k) in derivative k."""
    law = LAWS["sinh"][0]
    d = np.linspace(-0.45, 0.45, 500)
    errors = []
    for rows in (ROW, ROW[::2]):
        table = SpringTable(rows, law._derivatives(rows)[0])
        np.testing.assert_allclose(table._derivatives(rows)[0], law._derivatives(rows)[0], rtol=1e-13, atol=1e-12)
        errors.append([np.abs(table._derivatives(d)[k] - law._derivatives(d)[k]).max() for k in range(5)])
    assert (np.array(errors[0]) < [1e-12, 1e-9, 1e-6, 1e-3, 1]).all()
    assert (np.log2(np.array(errors[1]) / errors[0]) > [5.5, 4.5, 3.5, 2.5, 1.5]).all()
    known = joint_springs.deflect_spring(law, force_along(law, deflection_rates(d, 3)))
    found = joint_springs.deflect_spring(table, force_along(law, deflection_rates(d, 3)))
    np.testing.assert_allclose(found[2], known[2], atol=1e-6)


def test_the_fourth_derivative_of_a_table_is_continuous():
    table = SpringTable(ROW, LAWS["sinh"][0]._derivatives(ROW)[0])
    knots = ROW[5:-5]
    for k in range(5):
        before, after = (table._derivatives(knots + side * 1e-12)[k] for side in (-1, 1))
        np.testing.assert_allclose(before, after, rtol=1e-7, atol=1e-6)


@pytest.mark.parametrize("name", [*LAWS, "table"])
def test_energies_are_the_work_of_forces(name):
    spring = SpringTable(ROW, CUBIC._derivatives(ROW)[0]) if name == "table" else LAWS[name][0]
    d = np.array([-0.4, 0.0, 0.25])
    points, weights = np.polynomial.legendre.leggauss(60)
    expected = [(spring._derivatives(x / 2 * (points + 1))[0] * weights).sum() * x / 2 for x in d]
    np.testing.assert_allclose(spring._energy(d), expected, rtol=1e-10, atol=1e-14)


@pytest.mark.parametrize("spring", [CUBIC, LAWS["sinh"][0], SpringTable(ROW, ROW)])
def test_springs_are_data(spring):
    again = pickle.loads(pickle.dumps(spring))
    assert again == spring
    assert hash(again) == hash(spring)


FUNCTION = "^a spring function may use + - * / **, and the functions sin, …; give a table instead$"


@pytest.mark.parametrize(("make", "words"), [
    (lambda: CubicSpring(0.0), "^CubicSpring(k=0.0, k3=0.0): expected a stiffness k above 0"),
    (lambda: CubicSpring(0.0, -1.0), "expected a stiffness k above 0, …; or k=0 with k3 above 0$"),
    (lambda: CubicSpring(np.nan), "^CubicSpring(k=nan"),
    (lambda: CubicSpring(1.0, np.inf), "expected a stiffness k above 0, in N m/rad or N/m, and a finite k3; or k=0"),
    (lambda: SpringFunction.of(lambda d: -d), "^a spring function has stiffness -1 at rest; expected a force"),
    (lambda: SpringFunction.of(lambda d: np.arctan(d)), FUNCTION),
    (lambda: SpringFunction.of(lambda d: d if d > 0 else 2 * d), FUNCTION),
    (lambda: SpringFunction.of(lambda d: d**1.5), FUNCTION),
    (lambda: SpringFunction.of(lambda: 1), FUNCTION),
    (lambda: SpringTable([0, 1, 2, 3, 4, 3], range(6)), "^spring table: deflections do not rise from row 4 (4)"),
    (lambda: SpringTable(range(6), [0, 1, 2, 3, 3, 4]), "forces do not rise …; expected a monotone table$"),
    (lambda: SpringTable(range(5), range(5)), "^a spring table has 5 deflections and 5 forces; expected as many"),
    (lambda: SpringTable(range(6), range(7)), "^a spring table has 6 deflections and 7 forces"),
    (lambda: SpringTable([[1]], [1]), "^spring table: deflections have shape (1, 1); expected finite numbers"),
    (lambda: SpringTable(range(6), [0, 1, 1.01, 1.02, 50, 51]),
     "^the spline through a spring table is not monotone: its force falls at the deflection"),
])  # fmt: skip
def test_what_is_no_spring_is_refused(make, words):
    refusal(make, words)


@pytest.mark.parametrize(
    ("spring", "Q"),
    [
        (SpringTable(ROW, CUBIC._derivatives(ROW)[0]), 5e3),
        (CubicSpring(5.0, -1.0), 4.31),
        (SpringFunction.of(lambda d: 3 * np.tanh(d)), -3.1),
    ],
)
def test_forces_that_a_spring_cannot_carry_are_refused(spring, Q):
    with expect_refusal(f"^no deflection of the spring carries {Q:g}; it carries -", kind=UnreachableError) as error:
        spring_deflection(spring, np.array([1.0, 2.0, Q, np.nan]))
    assert error.value.state == 2


@pytest.mark.parametrize("spring", [SpringTable(ROW, CUBIC._derivatives(ROW)[0]), CubicSpring(5.0, -1.0)])
def test_springs_say_nothing_of_deflections_beyond_their_ends(spring):
    """Rounding of theta - q at the ends is no such deflection."""
    low, high = spring.range
    arm = jounce.load("planar2r").elastic(spring=spring, rotor=0.1)
    inside, rest = [[low * (1 + 1e-12), high], [high, np.nan]], np.zeros(2)
    assert np.isfinite(spring.force(inside)).tolist() == [[True, True], [True, False]]
    assert np.isfinite(arm.elastic_energy(rest, rest, inside[0], rest).total)
    for beyond in (1.0001 * low, 1.0001 * high):
        said = f"a deflection of {beyond:.6g} is beyond the ends of the spring, -"
        theta = np.array([[0.0, 0.1 * high], [0.0, beyond]])
        for call in (spring.force, spring.stiffness):
            refusal(lambda call=call, theta=theta: call(theta), f"^{said}")
        for call in (arm.elastic_energy, arm.elastic_forward_dynamics, arm.feedback_linearization):
            with expect_refusal(f"^joint 'joint2': {said}"):
                call(rest, rest, theta, rest, *[rest] * (call != arm.elastic_energy))


def test_forces_that_are_not_known_have_no_deflection():
    for spring in (CUBIC, SpringTable(ROW, ROW)):
        assert np.isnan(spring_deflection(spring, np.array([np.nan, 0.1]))).tolist() == [True, False]


@pytest.mark.parametrize("spring", [SpringTable(ROW, ROW), LAWS["sinh"][0], CubicSpring(1.0, -1.0)])
def test_springs_that_need_numbers_say_so(spring):
    with expect_refusal("needs NumPy arrays of floats; springs for symbols are linear or stiffen$"):
        spring_deflection(spring, np.array([sympy.Symbol("Q")]))
