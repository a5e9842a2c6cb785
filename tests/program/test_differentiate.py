"""Derivatives of programs: exact, transposes of each other, and as cheap as measured."""

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import jounce
from jounce.dynamics.computation import Computation
from jounce.native import code_forms
from jounce.program import differentiate, operations
from jounce.program.differentiate import FreeInputs
from jounce.program.passes import factor, fuse
from jounce.program.program import Program, Step, Tape
from support.programs import expressions, nested, one_of_each, run_exactly

POINT, WEIGHTS = (0.7, -1.3, 0.45), (1.7, -0.6, 2.3)


def of_nested():
    tape = Tape()
    return tape.program([nested(*tape.variables(3))])


def jacobian(program, point):
    """The derivatives of the outputs by the inputs, to some 40 digits."""
    with mpmath.workdps(60):
        x = tuple(mpmath.mpf(a) for a in point)
        return np.array(
            [
                [
                    float(mpmath.diff(lambda *at, k=k: run_exactly(program, at)[k], x, tuple(np.eye(3, dtype=int)[j])))
                    for j in range(3)
                ]
                for k in range(len(program.outputs))
            ]
        )


@pytest.mark.parametrize("program", [one_of_each(), of_nested(), fuse(of_nested())], ids=["each", "nested", "fused"])
def test_products_of_every_operation_are_exact(program):
    expected, weights = jacobian(program, POINT), np.linspace(-1, 2, len(program.outputs))
    np.testing.assert_allclose(differentiate.jvp(program).run([*POINT, *WEIGHTS]), expected @ WEIGHTS, rtol=1e-13)
    np.testing.assert_allclose(differentiate.vjp(program).run([*POINT, *weights]), expected.T @ weights, rtol=1e-13)


def test_one_of_each_has_every_operation():
    assert set(one_of_each().counts()) == {*operations.OPERATIONS, "input"}


@given(expressions(), st.lists(st.integers(-3, 3), min_size=8, max_size=8))
def test_products_are_transposes_of_each_other_to_the_last_bit(drawn, numbers):
    program, inputs, outputs = drawn
    directions, weights = numbers[:3], numbers[3 : 3 + len(outputs)]
    forward, reverse = (
        differentiate.jvp(program).run([*inputs, *directions]),
        differentiate.vjp(program).run([*inputs, *weights]),
    )
    if max(map(abs, [*forward, *reverse])) < 2**40:  # so that doubles hold all of it exactly
        assert np.dot(forward, weights) == np.dot(reverse, directions)
    passed = differentiate.vjp(fuse(factor(program))).run([*inputs, *weights])
    assert passed == reverse or max(map(abs, reverse)) > 2**40


def test_inputs_repeated_unused_or_returned_have_derivatives():
    steps = (Step("input", value=1.0), Step("input", value=1.0), Step("mul", (0, 1)))
    program = Program(steps, (2, 0, 2), 3)
    assert differentiate.vjp(program).run([9, 5, 9, 1, 10, 100]) == [0, 101 * 2 * 5 + 10, 0]
    assert differentiate.jvp(program).run([9, 5, 9, 7, 1, 7]) == [10, 1, 10]


def test_parameters_have_no_derivative():
    tape = Tape()
    x, y, z = tape.variables(3)
    program = tape.program([x * y * z, x])
    assert differentiate.vjp(program, FreeInputs(1)).run([2, 3, 5, 1, 1]) == [10, 6]
    assert differentiate.jvp(program, FreeInputs(1)).run([2, 3, 5, 1, 1]) == [16, 0]


def test_zero_weights_and_directions_write_no_step():
    tape = Tape()
    inputs = tape.variables(3)
    x, y, z = inputs
    evaluation = differentiate.evaluate(tape.program([x * y, (y * z).sin()]), tape, inputs)
    written = len(tape.nodes)
    assert differentiate.adjoints(evaluation, [1, 0]) == [y, x, tape.node(0)]
    assert differentiate.tangents(evaluation, [0, 0, 0]) == [tape.node(0)] * 2
    assert differentiate.tangents(evaluation, [1, 0, 0]) == [y, tape.node(0)]
    assert {node.kind for node in tape.nodes[written:]} <= {"constant"}


@pytest.mark.parametrize(("order", "most"), [(0, 1356), (2, 5568)])
def test_products_of_the_iiwa_take_no_more_operations_than_measured(order, most):
    """A gradient of Q, Qd, Q2d takes 2.52 times the operations of the values."""
    program = code_forms.trace_program(jounce.load("iiwa14").mechanism, Computation("inverse_dynamics", order))
    assert differentiate.vjp(program).operations <= most
    assert differentiate.jvp(program).operations <= 1.01 * most
    tape = Tape()
    evaluation = differentiate.evaluate(program, tape, tape.variables(program.inputs))
    rows = [
        differentiate.adjoints(evaluation, [float(i == k) for i in range(7)]) for k in range(7 if order == 0 else 0)
    ]
    assert factor(tape.program(np.ravel(rows))).operations <= 4276


@pytest.mark.parametrize("x", [0.0, 1e-9, 0.7, -5.0, 19.0, -25.0, 150.0, 1e4])
def test_derivatives_of_tanh_have_the_digits_of_its_slope(x):
    """However small the slope is, and where exp overflows."""
    found, program = [], one_function("tanh")
    for _ in range(3):
        tape = Tape()
        program = tape.program(differentiate.tangents(differentiate.evaluate(program, tape, tape.variables(1)), [1]))
        found += program.run([x])
    with mpmath.workdps(400):
        y = mpmath.tanh(x)
        s = 1 / mpmath.cosh(x) ** 2
        expected = [float(z) for z in (s, -2 * y * s, s * (6 * y * y - 2))]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * float(s))


def one_function(kind):
    tape = Tape()
    return tape.program([tape.function(kind, *tape.variables(1))])
