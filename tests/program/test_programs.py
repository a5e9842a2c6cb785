"""Programs: traced, factored and fused ones give the same outputs, by operations that are guarded in number."""

import gc
import signal

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import jounce
from jounce.dynamics.computation import Computation
from jounce.native import code_forms
from jounce.program.operations import FREE_KINDS, OPERATIONS
from jounce.program.passes import factor, fuse
from jounce.program.program import Tape, TapeFullError, interruptible, topological_order, uncollected
from jounce.spatial.series import Series, column_series
from support.natives import WAYS, native, signature
from support.programs import expressions
from support.recursion import inverse_dynamics
from support.robots import loads, mechanisms, random_mechanism, random_state, relative_error

PASSES = {"traced": lambda program: program, "factored": factor, "fused": lambda program: fuse(factor(program))}


def traced_recursion(mechanism, order, loaded):
    """The recursion written down, before any pass."""
    tape = Tape()
    q = [tape.variables(mechanism.n) for _ in range(order + 3)]
    W = [tape.variables(6 * mechanism.nb, 1) for _ in range(order + 1)]
    Q = inverse_dynamics(mechanism, column_series(q), Series.of(W) if loaded else None).upto(order)
    return tape.program([x for rate in Q for x in rate[:, 0]])


def assert_in_order(program):
    """Each step takes earlier ones only, is needed, and is there once."""
    assert all(j < i for i, step in enumerate(program.steps) for j in step.operands)
    assert set(program.uses()) == set(range(len(program.steps)))
    assert len(set(program.steps)) == len(program.steps)


@pytest.mark.parametrize(("order", "operations"), [(0, 562), (1, 1225), (2, 2213)])
def test_the_iiwa_takes_no_more_operations_than_measured(order, operations):
    """A guard of the economy of recursion, trace and factoring, sines and cosines among the operations."""
    program = code_forms.trace_program(jounce.load("iiwa14").mechanism, Computation("inverse_dynamics", order))
    assert program.operations <= operations
    counts = fuse(program).counts()
    assert (counts["sin"], counts["cos"]) == (7, 7) or (counts["sin"], counts["cos"]) == (6, 6)
    assert fuse(program).operations < 0.8 * operations


@given(mechanisms(), st.integers(0, 3), st.booleans())
def test_programs_give_the_forces_after_every_pass(drawn, order, loaded):
    mechanism, rng = drawn
    q, W = random_state(rng, mechanism, order)
    expected = inverse_dynamics(mechanism, column_series(q), loads(W) if loaded else None).upto(order)
    inputs = [float(x) for array in (q + W if loaded else q) for x in np.ravel(array)]
    program = traced_recursion(mechanism, order, loaded)
    for name, run in PASSES.items():
        passed = run(program)
        assert_in_order(passed)
        found = np.reshape(passed.run(inputs), (order + 1, -1))
        for Q, Q_k in zip(found, expected, strict=True):
            assert relative_error(Q, Q_k[:, 0]) < 1e-12, name
    assert factor(program).operations <= program.operations


@pytest.mark.parametrize("name", PASSES)
@given(drawn=expressions())
def test_programs_of_random_expressions_are_exact_after_every_pass(name, drawn):
    program, inputs, expected = drawn
    passed = PASSES[name](program)
    assert_in_order(passed)
    assert passed.run(inputs) == expected
    assert passed.operations <= program.operations


def test_operations_are_counted_without_what_is_free():
    tape = Tape()
    x, y = tape.variables(2)
    program = tape.program([x * y + 2, -(x * y), x.sin() - y.cos(), y])
    assert program.counts() == {"input": 2, "constant": 1, "neg": 1, "mul": 1, "add": 1, "sub": 1, "sin": 1, "cos": 1}
    assert program.operations == 5


@pytest.mark.parametrize(
    ("expression", "kinds"),
    [
        (lambda x, y: x + 0, ["input"]),
        (lambda x, y: 0 + x, ["input"]),
        (lambda x, y: x - 0, ["input"]),
        (lambda x, y: 0 - x, ["input", "neg"]),
        (lambda x, y: x * 0, ["constant"]),
        (lambda x, y: -0.0 * x, ["constant"]),
        (lambda x, y: x * 1, ["input"]),
        (lambda x, y: -1 * x, ["input", "neg"]),
        (lambda x, y: x - x, ["constant"]),
        (lambda x, y: x + -x, ["constant"]),
        (lambda x, y: 0 - (0 - x), ["input"]),
        (lambda x, y: (x - y) + (y - x), ["constant"]),
        (lambda x, y: x * y - y * x, ["constant"]),
        (lambda x, y: (-x) * (-y), ["input", "input", "mul"]),
        (lambda x, y: x * -2, ["constant", "input", "mul", "neg"]),
    ],
)
def test_the_tape_folds_what_is_trivial(expression, kinds):
    tape = Tape()
    program = tape.program([expression(*tape.variables(2))])
    assert sorted(step.kind for step in program.steps) == sorted(kinds)


def test_equal_expressions_are_one_step_and_an_equal_node():
    tape = Tape()
    x, y = tape.variables(2)
    assert x + y is y + x
    assert x * y is y * x
    assert 0 - (0 - x) is x
    assert (-x).sin() is (-x).sin()
    assert tape.program([(x - y) * (y - x)]).counts()["sub"] == 1


def test_what_the_outputs_need_comes_once_and_operands_first():
    operands = {0: (), 1: (0,), 2: (0, 1), 3: (2, 2), 4: (3,), 5: ()}
    assert list(topological_order([3, 1, 3], operands.__getitem__)) == [0, 1, 2, 3]
    assert list(topological_order([5, 4], operands.__getitem__)) == [5, 0, 1, 2, 3, 4]
    assert list(topological_order([], operands.__getitem__)) == []


def everything():
    """A program of every kind of step, with outputs that are inputs, constants, repeated and signed."""
    tape = Tape()
    x, y, z = tape.variables(3)
    constant = tape.node(0.5)
    outputs = [
        *(x * x + z, y * y - z, x - z * z, (x + y) * (x - z), -(x * y * z), x, x, -x, constant, tape.node(-2.0)),
        *((x + y).sin(), (x + y).cos(), x.sin() * y.cos(), constant.cos(), y.cos(), x * y + x * z, 3 * x - 3 * y),
    ]
    return tape.program(outputs)


@pytest.mark.parametrize("run", PASSES.values(), ids=PASSES)
@pytest.mark.parametrize("way", WAYS)
def test_native_code_does_every_operation_in_every_lane(way, run):
    program = run(everything())
    assert run is not PASSES["fused"] or {"fma", "fms", "fnma"} <= set(program.counts()) <= {*OPERATIONS, *FREE_KINDS}
    function = native(program, signature(((3,),), ((len(program.outputs),),), (0,)), way)
    states = np.random.default_rng(0).uniform(-3, 3, (37, 3))
    expected = [program.run(list(state)) for state in states]
    np.testing.assert_allclose(function(states), expected, rtol=1e-14, atol=1e-14)


def test_wherever_a_tape_fills_the_trace_ends_with_its_own_error():
    """Products of object arrays with batch axes, as regressors have, go on calling operators after one has raised."""
    mechanism, regressor = random_mechanism(np.random.default_rng(0), [-1, 0], ["helical"] * 2, [1.0, 1.0]), "regressor"
    whole = Tape()
    code_forms.trace_program(mechanism, Computation(regressor, 1), whole)
    for most in range(500, len(whole.nodes), 150):
        with pytest.raises(TapeFullError):
            code_forms.trace_program(mechanism, Computation(regressor, 1), Tape(most))
    code_forms.trace_program(mechanism, Computation(regressor, 1), Tape(len(whole.nodes)))


@pytest.mark.parametrize("at", range(500, 3500, 600))
def test_a_signal_in_a_trace_is_an_interruption_wherever_it_comes(monkeypatch, at):
    """NumPy's products of object arrays with batch axes go on after it, and end in a SystemError."""
    chain = random_mechanism(np.random.default_rng(0), [-1, 0], ["helical"] * 2, [1.0, 1.0])
    write, steps = Tape.write, []

    def stop(self, *step, **value):
        steps.append(step)
        if len(steps) == at:
            signal.raise_signal(signal.SIGINT)
        return write(self, *step, **value)

    monkeypatch.setattr(Tape, "write", stop)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # which jobs in the background ignore
    try:
        with pytest.raises(KeyboardInterrupt):
            code_forms.trace_program(chain, Computation("regressor", 1))
    finally:
        signal.signal(signal.SIGINT, before)
    assert len(steps) >= at


def test_another_system_error_of_a_trace_stays_one():
    with pytest.raises(SystemError, match="of another kind"), interruptible():
        raise SystemError("of another kind")


def test_series_compute_no_further_term_on_a_full_tape():
    tape, asked = Tape(8), []
    (x,) = tape.variables(1)

    def term(k):
        asked.append(k)
        return np.array([x + k + 1, x * (k + 2)])

    with pytest.raises(TapeFullError):
        Series(term).upto(9)
    assert asked == [0, 1]
    assert len(tape.nodes) == 8


@pytest.mark.parametrize("was_enabled", [True, False])
def test_garbage_is_collected_after_a_trace_as_before(was_enabled, monkeypatch):
    monkeypatch.setattr(gc, "isenabled", lambda: was_enabled)
    calls = []
    for name in ("enable", "disable"):
        monkeypatch.setattr(gc, name, lambda name=name: calls.append(name))

    @uncollected()
    def broken():
        calls.append("traced")
        raise ValueError("broken")

    with pytest.raises(ValueError, match="broken"):
        broken()
    assert calls == ["disable", "traced", *["enable"] * was_enabled]
