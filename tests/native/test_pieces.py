"""Programs in pieces: the same operations in an order in which they can be done, and every value where it is read."""

from collections import Counter
from itertools import chain

import numpy as np
import pytest
from hypothesis import given

import jounce
from jounce.dynamics.computation import Computation
from jounce.native import code_forms, ir, jit, straight
from jounce.program import operations
from jounce.program.passes import fuse
from jounce.program.program import Tape
from support.natives import WAYS, assembled, native, signature, target
from support.programs import expressions, nested, one_of_each
from support.refusals import refusal
from support.robots import random_chain

FEW, MANY = 16, 32  # registers


def run_pieces(plan, inputs):
    """The outputs of a program as its pieces compute them: registers are empty at the start of each."""
    steps, memory, made = plan.program.steps, {}, {}
    called = ir.vector_calls(plan.program)

    def read(i):
        kind, value = steps[i].kind, steps[i].value
        return (
            memory[plan.homes[i]] if kind not in operations.LEAVES else inputs[int(value)] if kind == "input" else value
        )

    for piece in plan.pieces:
        registers = {}
        for i in piece:
            registers |= {j: read(j) for j in steps[i].operands if (i, j) in plan.loads}
            value = made[i] = operations.OPERATIONS[steps[i].kind].value(*(registers[j] for j in steps[i].operands))
            if i in plan.homes:
                memory[plan.homes[i]] = value
            if i not in called:
                registers[i] = value
    return [made[i] if i in made else read(i) for i in plan.program.outputs]


KINDS = ("revolute", "helical", "prismatic", "revolute")


def computed_by(plan):
    return list(chain.from_iterable(plan.pieces))


def traced_program(name, quantity, order):
    return fuse(code_forms.trace_program(jounce.load(name).mechanism, Computation(quantity, order)))


def nested_outputs():
    tape = Tape()
    x, y, z = tape.variables(3)
    return tape.program([nested(x, y, z), nested(y, z, x), x.sin().sin().cos(), nested(z, x, y).sin(), z, 2.0])


@pytest.fixture
def _short(monkeypatch):
    """Pieces of a few operations, so that those of small programs are many."""
    monkeypatch.setattr(straight, "MAX_WHOLE_STEPS", {FEW: 4, MANY: 4})
    monkeypatch.setattr(straight, "PIECE_STEPS", 3)
    monkeypatch.setattr(straight, "RELOAD_DISTANCE", 2)


@pytest.mark.usefixtures("_short")
@pytest.mark.parametrize("registers", [FEW, MANY])
@pytest.mark.parametrize(
    "program", [one_of_each(), nested_outputs(), traced_program("planar2r", "inverse_dynamics", 2)]
)
def test_pieces_compute_what_the_program_does(program, registers):
    plan = straight.cut_program(program, registers)
    inputs = np.random.default_rng(1).uniform(0.5, 1, program.inputs).tolist()
    assert run_pieces(plan, inputs) == program.run(inputs)
    assert len(plan.pieces) > 1
    assert Counter(computed_by(plan)) == Counter(
        i for i, step in enumerate(program.steps) if step.kind not in operations.LEAVES
    )


@pytest.mark.usefixtures("_short")
@given(expressions())
def test_pieces_of_random_programs_compute_the_same(drawn):
    program, inputs, expected = drawn
    for registers in (FEW, MANY):
        assert run_pieces(straight.cut_program(program, registers), inputs) == expected


@pytest.mark.parametrize("registers", [FEW, MANY])
def test_programs_are_whole_up_to_a_number_of_operations(registers, monkeypatch):
    program = traced_program("iiwa14", "mass_matrix", 0)
    count = sum(step.kind not in operations.LEAVES for step in program.steps)
    assert count < straight.MAX_WHOLE_STEPS[MANY]
    for most, whole in ((count, True), (count - 1, False)):
        monkeypatch.setitem(straight.MAX_WHOLE_STEPS, registers, most)
        plan = straight.cut_program(program, registers)
        assert (len(plan.pieces) == 1) == whole
        assert max(map(len, plan.pieces)) <= (count if whole else 1.5 * straight.PIECE_STEPS)


@pytest.mark.parametrize(
    ("quantity", "order", "recorded"),
    [("inverse_dynamics", 0, True), ("inverse_dynamics", 2, True), ("coriolis_matrix", 0, False)],
)
def test_forces_stay_as_recorded_and_matrices_go_depth_first(quantity, order, recorded):
    program = traced_program("iiwa14", quantity, order)
    called = ir.vector_calls(program)
    listed = [i for i in computed_by(straight.cut_program(program, FEW)) if i not in called]
    assert (listed == sorted(listed)) == recorded
    deep = [i for i in computed_by(straight.cut_program(program, MANY)) if i not in called]
    assert deep != sorted(deep)


def test_outputs_that_are_to_come_first_come_first():
    tape = Tape()
    x, y = tape.variables(2)
    program = tape.program([x + y, x * y, x - y])
    assert [program.steps[i].kind for i in computed_by(straight.cut_program(program, MANY))] == ["sub", "mul", "add"]
    assert [program.steps[i].kind for i in computed_by(straight.cut_program(program, MANY, [1]))] == [
        "mul",
        "add",
        "sub",
    ]


def test_values_used_shortly_before_are_not_loaded_again():
    tape = Tape()
    x, y = tape.variables(2)
    total = x
    for _ in range(straight.RELOAD_DISTANCE):
        total = total * y
    for more, loads in ((0, 1), (1, 2)):
        last = total
        for _ in range(more):
            last = last * y
        program = tape.program([last - x])
        [subtraction] = (i for i, step in enumerate(program.steps) if step.kind == "sub")
        of_x = [pair for pair in straight.cut_program(program, MANY).loads if program.steps[pair[1]].value == 0]
        assert len(of_x) == loads
        assert any(i == subtraction for i, _ in of_x) == (loads == 2)


@pytest.mark.usefixtures("_short")
@pytest.mark.parametrize("way", WAYS)
def test_native_pieces_of_functions_of_functions(way):
    program, whole = nested_outputs(), signature(((3,),), ((len(nested_outputs().outputs),),), (0,))
    values = np.random.default_rng(5).uniform(0.5, 1, (21, 3))
    found = native(program, whole, way)(values)
    np.testing.assert_allclose(found, [program.run(x) for x in values], rtol=1e-13)


ROBOTS = {
    "with wrenches": (lambda: jounce.Robot(random_chain(5, KINDS, seed=5)), {"order": 2, "wrench": True}),
    "on a moving base": (lambda: jounce.Robot(random_chain(4, KINDS, seed=4)), {"order": 1, "moving_base": True}),
    "closed": (lambda: jounce.load("delta"), {"order": 1}),
    "a matrix": (lambda: jounce.Robot(random_chain(6, KINDS, seed=6)), {"quantity": "coriolis_matrix", "order": 0}),
    "forward dynamics": (
        lambda: jounce.Robot(random_chain(4, KINDS, seed=4)),
        {"quantity": "forward_dynamics", "order": 1},
    ),
}


@pytest.mark.sweep(2)
@pytest.mark.parametrize("name", ROBOTS)
def test_cuts_and_registers_change_no_bit(name, monkeypatch):
    """Nor do ragged ends and places in a batch, where two blocks are computed at once; NaN stays in its state."""
    make, options = ROBOTS[name]
    kernel = make().compile(**options)
    interface = kernel.signature
    rng = np.random.default_rng(6)
    arrays = [rng.uniform(0.1, 0.4, (37, *port.shape)) for port in interface.inputs]
    arrays[0][3], arrays[-1][20] = np.nan, np.inf
    with np.errstate(invalid="ignore"):
        expected = kernel(*arrays)
    expected = expected if isinstance(expected, tuple) else (expected,)
    assert np.isnan(expected[-1]).any(axis=tuple(range(1, expected[-1].ndim))).sum() == 2
    for way in ("4 lanes, 16 registers", "2 lanes"):
        for size in (40, straight.PIECE_STEPS):
            monkeypatch.setattr(straight, "MAX_WHOLE_STEPS", {FEW: 60, MANY: 60})
            monkeypatch.setattr(straight, "PIECE_STEPS", size)
            texts = code_forms.kernel_modules(kernel.mechanism, kernel.computation, target(way))
            assert "@piece1(" in texts[0]
            function = assembled(texts, interface, way)
            for count in (1, 4, 8, 9, 16, 37):
                with np.errstate(invalid="ignore"):
                    found = function(*(x[:count] for x in arrays))
                for x, y in zip(found if isinstance(found, tuple) else (found,), expected, strict=True):
                    np.testing.assert_array_equal(x, y[:count])


def test_narrower_vectors_can_be_asked_for(monkeypatch):
    widest = jit.host()
    for lanes in filter(lambda lanes: lanes <= widest.lanes, (2, 4, 8)):
        monkeypatch.setenv("JOUNCE_LANES", str(lanes))
        found = jit.host()
        assert found.lanes == lanes
        assert found == widest or (found.registers, found.fma) == (FEW, widest.fma and lanes > 2)
        assert found.features.endswith(jit.NARROWER[str(lanes)] if found != widest else widest.features)
    for wrong in ("3", "16", "many", "-2"):
        monkeypatch.setenv("JOUNCE_LANES", wrong)
        refusal(lambda: jit.host(), "^JOUNCE_LANES is '…'; this processor has vectors of 2")
