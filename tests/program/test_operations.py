"""The table of operations: for each of them values, native code, generated code and derivatives agree."""

import ctypes
import math
import re
import subprocess
from fractions import Fraction
from importlib.util import module_from_spec, spec_from_file_location

import jax.numpy as jnp
import mpmath
import numpy as np
import pytest
import sympy

import casadi
import jounce
from jounce._codegen.languages import LANGUAGE_NAMES, language
from jounce.core import scalars
from jounce.native import code_forms
from jounce.native.ir import Writer
from jounce.native.jit import host
from jounce.native.vector_functions import DEFINITIONS
from jounce.program.operations import FREE_KINDS, FUNCTION_KINDS, OPERATIONS
from jounce.program.passes import factor, fuse
from jounce.program.program import Tape
from support.natives import WAYS, native, signature
from support.programs import EXACT_OPERATIONS, nested, one_of_each, run_exactly
from support.refusals import expect_refusal
from support.tools import NODE, require

operations = pytest.mark.parametrize("name", OPERATIONS)
POINT = (0.7, -1.3, 0.45)
SPECIAL = [0.0, -0.0, 1.0, -1.0, np.inf, -np.inf, np.nan, 1e-308, 5e-324, -1e300, 0.1]


@operations
def test_partial_derivatives_are_those_of_the_value(name):
    operation = OPERATIONS[name]
    tape = Tape()
    program = tape.program(operation.partials(*tape.variables(operation.arity)))
    point = POINT[: operation.arity]
    with mpmath.workdps(60):
        x = [mpmath.mpf(a) for a in point]
        directions = [tuple(int(i == j) for j in range(len(x))) for i in range(len(x))]
        expected = [mpmath.diff(EXACT_OPERATIONS[name], tuple(x), n) for n in directions]
        for found, derivative in zip(run_exactly(program, x), expected, strict=True):
            assert abs(found - derivative) < mpmath.mpf(10) ** -40
    np.testing.assert_allclose(program.run(point), [float(x) for x in expected], rtol=1e-15)


@pytest.mark.parametrize("way", WAYS)
def test_native_code_gives_the_values_of_all_lanes(way):
    """Zeros, infinities, NaN and denormals among them, as IEEE 754 has it; no result here waits for a finite input."""
    program = one_of_each()
    function = native(program, signature(((3,),), ((len(OPERATIONS),),), (1,)), way)
    rng = np.random.default_rng(0)
    states = np.concatenate([rng.uniform(-3, 3, (40, 3)), rng.choice(SPECIAL, (200, 3))])
    with np.errstate(all="ignore"):
        found = function(states)
    for k, name in enumerate(OPERATIONS):
        expected = np.array([program.run(list(map(float, state)))[k] for state in states])
        if name in FUNCTION_KINDS:
            np.testing.assert_array_max_ulp(found[:, k], expected, 3)
        elif OPERATIONS[name].unfused:  # rounded once or twice
            np.testing.assert_allclose(found[:, k], expected, rtol=1e-14, atol=1e-14)
        else:
            np.testing.assert_array_equal(found[:, k], expected)


def test_native_code_defines_the_functions_that_operations_call():
    assert {row.function.name for row in OPERATIONS.values() if row.function} == set(DEFINITIONS)
    ir = Writer(host())
    for define in DEFINITIONS.values():
        define(ir)
    for name in DEFINITIONS:
        assert f"@{name}(" in ir.text()


@pytest.mark.parametrize("run", [lambda program: program, factor, lambda program: fuse(factor(program))])
def test_passes_keep_the_values_of_functions(run):
    tape = Tape()
    x, y, z = tape.variables(3)
    outputs = [nested(x, y, z), 1 / (x * y + x * z), (x - y) / z + (x - y) / (x * z), 1 / (-x * y), 2 / (1 / x + y)]
    program = tape.program(outputs)
    passed = run(program)
    np.testing.assert_allclose(passed.run(POINT), program.run(POINT), rtol=1e-14)
    assert passed.operations <= program.operations
    assert passed.counts()["inv"] <= program.counts()["inv"]


@pytest.mark.parametrize("name", [*FUNCTION_KINDS, "neg", "inv"])
@pytest.mark.parametrize("x", [0.3, -2.0, 0.0, 0.1])
def test_functions_of_numbers_are_numbers(name, x):
    tape = Tape()
    node = tape.function(name, tape.node(x))
    assert node.kind == "constant"
    np.testing.assert_array_equal(node.value, OPERATIONS[name].value(x))  # NaN of the root of a negative number


def test_reciprocals_are_folded():
    tape = Tape()
    x, y = tape.variables(2)
    assert 1 / (1 / x) is x
    assert x / y is x * (1 / y)
    assert 3 / x is 3 * (1 / x)
    assert x / 4 is x * 0.25
    assert x / 1 is x
    assert 0 / x is tape.node(0)
    assert 1 / -x is -(1 / x)
    assert x / -y is -(x / y)
    assert (1 / x).kind == "inv"
    assert np.reciprocal(np.array([x]))[0] is 1 / x
    assert (1 / tape.node(0)).value == math.inf


def test_what_costs_nothing_is_not_counted():
    program = one_of_each()
    assert {"input", "constant", "neg"} == set(FREE_KINDS)
    assert program.operations == len(OPERATIONS) - 1


def test_nodes_have_the_functions_of_the_table_and_no_others():
    (x,) = Tape().variables(1)
    for name in FUNCTION_KINDS:
        assert getattr(x, name)().kind == name
    assert not hasattr(x, "inv")
    with expect_refusal("^scalars of type Node have no method arctan(), which is required$"):
        scalars._make_elementwise("arctan")(np.array([x]))


SCALAR_FUNCTIONS = {
    "inv": scalars.reciprocal,
    "sin": scalars.sin,
    "cos": scalars.cos,
    "tanh": scalars.tanh,
    "exp": scalars.exp,
    "sqrt": scalars.sqrt,
}


def value_on_tape(function, x):
    tape = Tape()
    (node,) = tape.variables(1)
    return tape.program(function(np.array([node]))).run([x])[0]


def casadi_value(function, x):
    symbol = casadi.SX.sym("x")
    (found,) = function(scalars.asarray(symbol, "x"))
    return float(casadi.Function("f", [symbol], [found])(x))


ON_SCALARS = {
    "floats": lambda f, x: f(np.array([x]))[0],
    "long doubles": lambda f, x: f(np.array([x], dtype=np.longdouble))[0],
    "JAX": lambda f, x: f(jnp.asarray([x], dtype=float))[0],
    "SymPy": lambda f, x: f(np.array([sympy.Symbol("x")]))[0].subs("x", x),
    "CasADi": casadi_value,
    "nodes": value_on_tape,
    "objects": lambda f, x: f(np.array([x, sympy.Symbol("x")], dtype=object))[0],
}


@pytest.mark.parametrize("kind", ON_SCALARS)
@pytest.mark.parametrize("name", SCALAR_FUNCTIONS)
def test_functions_take_every_scalar_type(name, kind):
    for x in (0.7, 1.75 if name == "sqrt" else -1.75):
        found = ON_SCALARS[kind](SCALAR_FUNCTIONS[name], x)
        assert abs(float(found) - OPERATIONS[name].value(x)) < (1e-6 if kind == "JAX" else 1e-15)
    assert set(SCALAR_FUNCTIONS) == {*FUNCTION_KINDS, "inv"}


def test_reciprocals_of_numbers_among_symbols():
    half, minus, zero = Fraction(1, 2), -1, -0.0
    found = scalars.reciprocal(np.array([half, minus, zero, Fraction(0), sympy.Integer(3)], dtype=object))
    assert list(found) == [2, -1, -math.inf, math.inf, sympy.Rational(1, 3)]
    assert type(found[1]) is int
    with expect_refusal("^scalars of type object have no reciprocal 1 / x, which is required$"):
        scalars.reciprocal(np.array([object()]))


def mass_matrix_of_operations():
    """In place of the mass matrix of the iiwa: one of each operation, and some within others; 49 outputs."""
    tape = Tape()
    x, y, z, *_ = tape.variables(7)
    made = [tape.write(name, *[x.i, y.i, z.i][: operation.arity]) for name, operation in OPERATIONS.items()]
    made += [z / (x * y), -(1 / x), 1 / (x + y), y * (1 / x) * z, z - 1 / (x - y), 1 / x.sin(), (1 / y).tanh()]
    made += [x - (y - z), x - (y + z) * (x - y), -(x + y) * z, 1 / (1 / x - 1 / y), 3 / (x * x * y * z + 0.1)]
    return tape.program([*made, *[0] * (49 - len(made))]), len(made)


def generated(tmp_path, monkeypatch, lang, float32=False):
    program, count = mass_matrix_of_operations()
    with monkeypatch.context() as patch:
        patch.setattr(code_forms, "trace_program", lambda *_: program)
        jounce.load("iiwa14").codegen(lang, 0, tmp_path / lang, outputs=["mass_matrix"], prefix="arm", float32=float32)
    return program, count


def assert_outputs(found, program, count, inputs):
    expected = program.run(inputs)
    np.testing.assert_allclose(np.ravel(found)[:count], expected[:count], rtol=1e-15)


@pytest.fixture
def inputs():
    return [*POINT, 0.0, 0.0, 0.0, 0.0]


def test_generated_python_does_every_operation(tmp_path, monkeypatch, inputs):
    program, count = generated(tmp_path, monkeypatch, "python")
    spec = spec_from_file_location("arm", tmp_path / "python" / "arm.py")
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    assert_outputs(module.mass_matrix(inputs), program, count, inputs)


def test_generated_c_does_every_operation(tmp_path, monkeypatch, inputs):
    require("gcc")
    program, count = generated(tmp_path, monkeypatch, "c")
    library, source = tmp_path / "arm.so", tmp_path / "c" / "arm.c"
    flags = ["-std=c99", "-ffp-contract=off", "-Wall", "-Werror", "-shared", "-fPIC"]
    subprocess.run(["gcc", *flags, "-o", library, source, "-lm"], check=True)
    q, M = (ctypes.c_double * 7)(*inputs), (ctypes.c_double * 49)()
    ctypes.CDLL(str(library)).arm_mass_matrix(q, M)
    assert_outputs(list(M), program, count, inputs)


def test_generated_javascript_does_every_operation(tmp_path, monkeypatch, inputs):
    require(NODE)
    program, count = generated(tmp_path, monkeypatch, "javascript")
    call = f"import {{mass_matrix}} from './javascript/arm.mjs'; console.log(String(mass_matrix({list(inputs)})[0]))"
    done = subprocess.run([NODE, "--input-type=module", "-e", call], cwd=tmp_path, capture_output=True, check=True)
    assert_outputs([float(x) for x in done.stdout.split(b",")], program, count, inputs)


ONE = {"c": "1.0f", "cpp": "1.0f", "cuda": "1.0f", "julia": "1.0f0", "matlab": "1.0", "python": "1.0", "rust": "1.0"}


@pytest.mark.parametrize(
    ("lang", "float32"),
    [(name, x) for name in LANGUAGE_NAMES if name != "latex" for x in (False, True) if language(name).single or not x],
)
def test_reciprocals_are_written_in_the_precision_of_the_code(tmp_path, monkeypatch, lang, float32):
    generated(tmp_path, monkeypatch, lang, float32)
    text = "".join(path.read_text() for path in (tmp_path / lang).iterdir() if not path.name.startswith("test"))
    found = re.findall(r"(?<![\w.])(1\.0\w*) / ", text)
    assert len(found) >= 8
    assert set(found) == {ONE[lang] if float32 else "1.0"}
    assert "reciprocals" in text
