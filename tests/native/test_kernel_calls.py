"""Kernels in users' hands: what they refuse, what they leave to the recursion, how they are bound, sent and dropped."""

import gc
import multiprocessing
import pickle
import re
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from threading import Barrier

import numpy as np
import pytest
import sympy

import jounce
from jounce.core.errors import JounceWarning
from jounce.dynamics.computation import Computation
from jounce.engine import backends
from jounce.native import jit, memory_layout
from jounce.native import kernel as module
from jounce.native.kernel import Kernel
from support.refusals import expect_refusal, refusal
from support.robots import golden, relative_error
from support.states import random_rates

ROBOT = jounce.load("planar2r")
ONES = [np.ones((5, 2))] * 4


def compiled_kernel(**options):
    return ROBOT.compile(order=1, **options)


REFUSED = {
    "too few": (ONES[:3], {}, "expects 4 arrays, got 3: it takes q, qd, q2d, q3d$"),
    "too many": ([*ONES, np.ones((5, 2))], {}, "expects 4 arrays, got 5: it takes q, qd, q2d, q3d$"),
    "none": ([], {}, "expects 4 arrays, got 0: it takes q, qd, q2d, q3d$"),
    "another number of coordinates": ([np.ones(3), *ONES[1:]], {}, ": q has shape (3,); expected (..., 2)$"),
    "one coordinate": ([np.ones((5, 1)), *ONES[1:]], {}, ": q has shape (5, 1); expected (..., 2)$"),
    "a scalar": ([1.0, *ONES[1:]], {}, ": q has shape (); expected"),
    "batches that do not fit": ([np.ones((4, 2)), *ONES[1:]], {}, "broadcast"),
    "objects": ([np.ones((5, 2), object), *ONES[1:]], {}, "not supported for the input types"),
    "complex numbers": ([np.ones((5, 2), complex), *ONES[1:]], {}, "not supported for the input types"),
    "text": (["text", *ONES[1:]], {}, ": q has shape (); expected"),
    "a ragged list": ([[[1], [1, 2]], *ONES[1:]], {}, "inhomogeneous"),
    "out of another kind": (ONES, {"out": 3}, re.compile(r"ArrayType|tuple of arrays|exactly one entry")),
    "out of one array": (ONES, {"out": np.ones((5, 2))}, re.compile(r"tuple|entry")),
    "out of three arrays": (ONES, {"out": tuple(np.ones((3, 5, 2)))}, "exactly one entry per"),
    "out of another batch": (ONES, {"out": (np.ones((9, 2)), np.ones((9, 2)))}, "broadcast"),
    "out of another shape": (ONES, {"out": (np.ones((5, 2)), np.ones((5, 3)))}, "size 3 is different from 2"),
    "a masked array": ([np.ma.masked_less(ONES[0], 2), *ONES[1:]], {}, "takes arrays without masks; x.astype"),
    "a list of masked arrays": ([list(np.ma.masked_less(ONES[0], 2)), *ONES[1:]], {}, "takes arrays without masks;"),
    "out with a mask": (ONES, {"out": tuple(np.ma.masked_less([ONES[0]] * 2, 2))}, "writes into arrays without masks"),
    "another body": (ONES, {"body": "body1"}, "robot.compile('inverse_dynamics', order=1) fixed …with body='body1'$"),
    "out of integers": (ONES, {"out": (np.ones((5, 2), int), np.ones((5, 2)))}, "Cannot cast"),
}


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize(("arrays", "options", "words"), REFUSED.values(), ids=REFUSED)
def test_calls_that_do_not_fit_are_refused_in_one_line(arrays, options, words, threads):
    out = options.get("out")
    given = [x for x in (*arrays, *(out if isinstance(out, tuple) else ())) if isinstance(x, np.ndarray)]
    before = [x.copy() for x in given]
    refusal(lambda: compiled_kernel()(*arrays, threads=threads, **options), words)
    assert all((np.asarray(x) == np.asarray(y)).all() for x, y in zip(before, given, strict=True))  # beneath masks too


@pytest.mark.parametrize("threads", [1, 2])
def test_arrays_to_write_into_may_be_listed_and_short(threads):
    arrays = random_rates(2, 4, 9)
    expected = compiled_kernel()(*arrays)
    out = [np.empty((9, 2)), np.empty((9, 2), np.float32)]
    results = compiled_kernel()(*arrays, out=out, threads=threads)
    assert all(x is y for x, y in zip(results, out, strict=True))
    np.testing.assert_array_equal(out[0], expected[0])
    np.testing.assert_array_equal(out[1], expected[1].astype(np.float32))


@pytest.mark.parametrize(("options", "match"), [
    ({"quantity": "mass_matrx"}, "^unknown quantity 'mass_matrx'; did you mean 'mass_matrix'? available: inverse_"),
    ({"quantity": 3}, "^unknown quantity 3; available: "),
    ({"quantity": ["mass_matrix"]}, "^unknown quantity ['mass_matrix']; available: "),
    ({"body": "body1"}, "^inverse_dynamics takes no body; these do: poses, twists, jacobian"),
    ({"quantity": "jacobian", "body": "body9"},
     re.compile(r"^unknown body 'body9'; did you mean 'body\d'\? available: ")),
    ({"quantity": "jacobian", "frame": "wrld"}, "^unknown frame 'wrld'; did you mean 'world'? available: "),
    ({"order": -1}, "^order is -1; expected 0 to 100$"),
    ({"order": 1.0}, "^order is 1.0;"),
    ({"order": True}, "^order is True;"),
    ({"order": "2"}, "^order is '2';"),
    ({"order": 13}, "^native code supports orders up to 12, not 13; use method='recursion'$"),
    ({"wrench": np.ones((2, 6))}, "^wrench is array(…; expected True or False"),
    ({"wrench": True, "quantity": "mass_matrix"}, "^mass_matrix takes no wrenches; these do: inverse_dyn"),
])  # fmt: skip
def test_what_cannot_be_compiled_is_refused_in_one_line(options, match):
    refusal(lambda: ROBOT.compile(**options), match)


def test_symbols_in_the_data_are_refused_and_left_to_the_recursion():
    robot = jounce.load("planar2r", m1=sympy.Symbol("m"))
    symbols = "native code needs a robot of numbers; this one contains symbols; use method='recursion'$"
    refusal(robot.compile, f"^{symbols}")
    assert robot.gravity_forces([0.0, 0.0]).dtype == object
    refusal(lambda: robot.gravity_forces([0.0, 0.0], method="kernel"), f"^method='kernel' is not available: {symbols}")


@pytest.fixture
def no_kernel(monkeypatch):
    """Native code that must not be asked for."""

    def compiled(*given):
        raise AssertionError("native code asked for")

    monkeypatch.setattr(backends, "compile_kernel", compiled)


STATES = {
    "long doubles": lambda x: x.astype(np.longdouble),
    "SymPy": lambda x: np.array([sympy.Float(float(v)) for v in x], dtype=object),
}


@pytest.mark.parametrize("kind", STATES)
@pytest.mark.usefixtures("no_kernel")
def test_other_scalars_go_to_the_recursion(kind):
    robot = jounce.load("planar2r")
    q = list(np.random.default_rng(1).uniform(-1, 1, (3, 2)))
    given = [STATES[kind](x) for x in q]
    expected = robot.inverse_dynamics(*q, method="recursion")
    found = robot.inverse_dynamics(*given)
    assert np.asarray(given[0]).dtype == np.asarray(found).dtype
    np.testing.assert_allclose(np.asarray(found, dtype=float), expected, rtol=1e-6)
    why = "native code needs NumPy arrays of float64, got …; "
    kernel, threads = "^method='kernel' is not available: ", "^threads=2 needs native code, which is not available: "
    refusal(lambda: robot.inverse_dynamics(*given, method="kernel"), f"{kernel}{why}use method='recursion'$")
    refusal(lambda: robot.inverse_dynamics(*given, threads=2), f"{threads}{why}leave threads out$")


@pytest.mark.usefixtures("no_kernel")
def test_what_takes_long_to_compile_goes_to_the_recursion():
    robot = jounce.load("planar2r")
    q = [np.ones(2)] * 14
    assert len(robot.gravity_forces(*q)) == 14
    with expect_refusal("not available: native code supports orders up to 12, not 13;"):
        robot.gravity_forces(*q, method="kernel")
    with pytest.raises(AssertionError, match=r"^native code asked for$"):
        robot.gravity_forces(*q[:13])
    with expect_refusal("^native code supports orders up to 12, not 13; use method='recursion'$"):
        robot.compile(order=13, quantity="mass_matrix")


def test_high_orders_of_many_bodies_take_the_loop_form():
    """The last order in a straight line and the first in a loop agree with the recursion, and with each other."""
    robot = jounce.Robot(golden("iiwa")[0])
    q = np.random.default_rng(3).uniform(-1, 1, (10, 3, 7))
    expected = robot.inverse_dynamics(*q, method="recursion")
    for order, straight in ((6, True), (7, False)):
        kernel = robot.compile(order=order)
        assert memory_layout.is_straight(kernel.computation, kernel.mechanism) == straight
        for found, other in zip(kernel(*q[: order + 3]), expected, strict=False):
            assert relative_error(found, other) < 1e-14


@pytest.mark.parametrize("kind", [list, np.float32, np.int64, np.float16, ">f8", "unpickled"])
def test_what_becomes_doubles_is_served(kind):
    q = np.ones((3, 3, 2))
    expected = ROBOT.inverse_dynamics(*q)
    given = q.tolist() if kind is list else pickle.loads(pickle.dumps(q)) if kind == "unpickled" else q.astype(kind)
    np.testing.assert_array_equal(ROBOT.inverse_dynamics(*given, method="kernel"), expected)


def test_without_llvmlite_the_recursion_serves_and_says_so(monkeypatch):
    monkeypatch.setitem(sys.modules, "llvmlite.binding", None)
    monkeypatch.setattr(backends, "is_available", cache(backends.is_available.__wrapped__))
    robot, q = jounce.load("planar2r"), random_rates(2, 3, 3)  # a robot that no kernel was made for
    with pytest.warns(
        JounceWarning, match=r"^native code is not available, the recursion is used instead: llvmlite cannot be"
    ):
        found = robot.inverse_dynamics(*q)
    np.testing.assert_array_equal(found, robot.inverse_dynamics(*q, method="recursion"))
    for call in (lambda: robot.compile(order=0), lambda: robot.inverse_dynamics(*q, method="kernel")):
        refusal(call, "native code needs llvmlite, which cannot be imported; use method='recursion'$")


def test_without_llvmlite_a_process_warns_once():
    program = """
import sys, warnings
sys.modules["llvmlite"] = None
import jounce
robot = jounce.load("planar2r")
with warnings.catch_warnings(record=True) as seen:
    warnings.simplefilter("always")
    for _ in range(3):
        robot.inverse_dynamics([0.0, 0.0], [0.0, 0.0], [0.0, 0.0])
        robot.mass_matrix([0.0, 0.0])
print(len(seen), seen[0].category.__name__, seen[0].filename)
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True, timeout=60)
    assert done.stdout.split() == ["1", "JounceWarning", "<string>"]  # at the caller's line


def test_a_kernel_is_pickled_as_what_it_is_of():
    kernel, arrays = compiled_kernel(wrench=True), random_rates(2, 4, 6)
    W = [np.ones((6, 2, 6))] * 2
    again = pickle.loads(pickle.dumps(kernel))
    assert again.computation == kernel.computation
    assert repr(again) == repr(kernel) == "<Kernel: inverse_dynamics of 'planar2r' to order 1, with wrenches>"
    for x, y in zip(again(*arrays, *W), kernel(*arrays, *W), strict=True):
        np.testing.assert_array_equal(x, y)


def test_a_kernel_can_be_sent_to_another_process():
    kernel, arrays = compiled_kernel(), random_rates(2, 4, 6)
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        found = pool.apply_async(kernel, arrays).get(timeout=60)
    for x, y in zip(found, kernel(*arrays), strict=True):
        np.testing.assert_array_equal(x, y)


@pytest.mark.parametrize("batch", [(), (0,), (1,), (9,), (40,)])
@pytest.mark.parametrize("step", [1, -1, 2])
def test_a_bound_call_computes_from_what_its_arrays_hold_now(batch, step):
    kernel = compiled_kernel()
    wide = np.random.default_rng(0).uniform(-2, 2, (6, *(abs(step) * count for count in batch), 2))
    arrays = [x[::step] if batch else x for x in wide]
    call = kernel.bind(*arrays[:4], out=arrays[4:])
    for _ in range(3):
        assert call() is None
        for x, y in zip(arrays[4:], kernel(*arrays[:4]), strict=True):
            np.testing.assert_array_equal(x, y)
        for x in arrays[:4]:
            x += 0.5


def test_a_bound_call_keeps_its_arrays_and_its_code_alive():
    q = random_rates(2, 4, 9)
    expected = compiled_kernel()(*q)
    out = [np.zeros((9, 2)), np.zeros((9, 2))]
    call = Kernel(ROBOT.mechanism, Computation("inverse_dynamics", 1)).bind(*(x.copy() for x in q), out=out)
    gc.collect()
    rubbish = [np.full((9, 2), np.nan) for _ in range(50)]
    call()
    assert len(rubbish) == 50
    for x, y in zip(out, expected, strict=True):
        np.testing.assert_array_equal(x, y)


OUT = [np.zeros((5, 2)), np.zeros((5, 2))]
ONE = np.zeros((6, 2))
LOCKED = np.zeros((5, 2))
LOCKED.flags.writeable = False
UNBOUND = {
    "too few": (ONES[:3], OUT, "binds 4 arrays and 2 to write into, not 3 and 2: it takes q, qd, q2d, q3d$"),
    "one result": (ONES, OUT[0], "binds 4 arrays and 2 to write into, not 4 and 1: it takes q, qd, q2d, q3d$"),
    "no results": (ONES, None, "not 4 and 1: it takes q, qd, q2d, q3d$"),
    "lists": ([[[1.0, 2.0]] * 5, *ONES[1:]], OUT, "binds float64 arrays of NumPy only$"),
    "short floats": ([np.ones((5, 2), np.float32), *ONES[1:]], OUT, "binds float64 arrays of NumPy only$"),
    "big-endian": ([np.ones((5, 2), ">f8"), *ONES[1:]], OUT, "binds float64 arrays of NumPy only$"),
    "batches to broadcast": ([np.ones(2), *ONES[1:]], OUT, "all with one batch axis or none"),
    "two batch axes": ([np.ones((5, 1, 2))] * 4, [x[:, None] for x in OUT], "all with one batch axis or none"),
    "a number": ([np.array(1.0), *ONES[1:]], OUT, "all with one batch axis or none"),
    "another size": ([np.ones((5, 3)), *ONES[1:]], OUT, "not [(5, 3)]$"),
    "a read-only result": (ONES, [LOCKED, OUT[0]], "^out[0] is read-only or shares memory"),
    "one result twice": (ONES, [OUT[0], OUT[0]], "^out[1] is read-only or shares memory"),
    "results that overlap": (ONES, [ONE[1:], ONE[:-1]], "^out[1] is read-only or shares memory"),
    "a result over a state": ([ONE[1:], *ONES[1:]], [OUT[0], ONE[:-1]], "^out[1] is read-only or shares memory"),
}


def test_what_is_to_be_bound_in_place_of_other_arrays_is_said():
    single, lists, whole = ONES[0].astype(np.float32), [[1.0, 2.0]] * 5, [OUT[0], OUT[1].astype(int)]
    refusal(lambda: compiled_kernel().bind(single, *ONES[1:], out=OUT), "^q is of dtype float32, numpy.zeros((5, 2))")
    refusal(
        lambda: compiled_kernel().bind(ONES[0], lists, *ONES[2:], out=OUT), "^qd is of type list, numpy.zeros((2,))"
    )
    refusal(lambda: compiled_kernel().bind(*ONES, out=whole), "^out[1] is of dtype int64, numpy.zer")


def test_of_which_body_a_kernel_is_cannot_be_asked_when_it_is_called():
    kernel = ROBOT.compile("jacobian", order=0, body="body1")
    own, other = "('jacobian', order=0, body='body1')", "body='body2', frame='world'"
    fixed = f"^robot.compile{own} fixed what <Kernel: …> computes; compile another one with {other}$"
    refusal(lambda: kernel(np.ones(2), body="body2", frame="world"), fixed)
    refusal(lambda: kernel.bind(np.ones(2), out=np.empty((6, 2)), body="body2", frame="world"), fixed)


@pytest.mark.parametrize(("arrays", "out", "words"), UNBOUND.values(), ids=UNBOUND)
def test_arrays_that_native_code_could_not_trust_are_not_bound(arrays, out, words):
    refusal(lambda: compiled_kernel().bind(*arrays, out=out), words)


def test_many_threads_may_ask_for_the_same_kernel_first():
    robots = [jounce.load("planar2r", L1=1 + i / 8) for i in range(3)]
    q = random_rates(2, 3, 4)
    together = Barrier(6)

    def first(i):
        together.wait(timeout=60)
        return robots[i % 3].inverse_dynamics(*q, method="kernel")

    with ThreadPoolExecutor(6) as pool:
        found = list(pool.map(first, range(6)))
    for i, Q in enumerate(found):
        np.testing.assert_array_equal(Q, found[i % 3])
        np.testing.assert_allclose(Q, robots[i % 3].inverse_dynamics(*q, method="recursion"), rtol=1e-12)


def test_kernels_come_and_go_while_others_are_in_use():
    """More kernels than are kept, some called from another thread, some bound while nothing else holds them."""
    quantity, q, out = Computation("gravity_forces", 0), np.ones((300, 2)), np.empty((300, 2))
    expected = ROBOT.gravity_forces(q)
    with ThreadPoolExecutor(2) as pool:
        waiting = []
        for i in range(150):
            kernel = Kernel(ROBOT.mechanism, quantity)
            waiting.append(pool.submit(kernel, q))
            if i % 10 == 0:
                call = kernel.bind(q, out=out)
            del kernel
            gc.collect(0)
        for future in waiting:
            np.testing.assert_array_equal(future.result(), expected)
    gc.collect()
    call()
    np.testing.assert_array_equal(out, expected)


def test_native_code_is_freed_with_its_kernel(monkeypatch):
    loaded, engines = jit.load_object, []

    class Engine:
        def __init__(self, engine):
            self.engine, self.get_function_address = engine, engine.get_function_address

        def __del__(self):
            engines.append(self.engine)

    def watched(*given):
        return jit.Code(Engine(loaded(*given).engine))

    monkeypatch.setattr(module.jit, "load_object", watched)
    kernel = Kernel(ROBOT.mechanism, Computation("gravity_forces", 0))
    call = kernel.bind(np.ones(2), out=np.empty(2))
    del kernel
    gc.collect()
    assert engines == []
    del call
    gc.collect()
    assert len(engines) == 1


@pytest.fixture
def _unknown_table(monkeypatch):
    """NumPy with another table of functions, in which the type of ufuncs stands elsewhere."""
    monkeypatch.setattr(jit, "UFUNC_TYPE_ENTRY", jit.FROM_SIGNATURE_ENTRY)
    monkeypatch.setattr(module, "_living", {})
    jit.has_known_table.cache_clear()
    yield
    jit.has_known_table.cache_clear()


def test_the_table_of_functions_of_numpy_is_the_known_one():
    assert jit.has_known_table()


@pytest.mark.usefixtures("_unknown_table")
@pytest.mark.parametrize(("name", "order"), [("mass_matrix", 0), ("inverse_dynamics", 2), ("kinetic_energy", 0)])
def test_with_another_table_plain_calls_give_the_same(name, order):
    robot, rng = jounce.load("iiwa14"), np.random.default_rng(4)
    with pytest.warns(JounceWarning, match="the table of C functions of NumPy"):
        kernel = robot.compile(name, order=order)
    assert isinstance(kernel.ufunc, jit.PlainCall)
    arrays = [rng.normal(size=(4, 1, 7)), *rng.normal(size=(len(kernel.signature.inputs) - 1, 5, 7))]
    found, expected = (
        results if isinstance(results, tuple) else (results,)
        for results in (kernel(*arrays), getattr(robot, name)(*arrays, method="recursion"))
    )
    into = tuple(map(np.empty_like, found))
    kernel(*arrays, out=into)
    assert len(found) == len(expected)
    for x, y, z in zip(found, expected, into, strict=True):
        assert relative_error(x, y) < 1e-12
        assert np.array_equal(x, z)
    refusal(lambda: kernel(np.zeros(6), *arrays[1:]), "expected")
