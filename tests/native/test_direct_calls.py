"""Direct calls: the bits of the ufunc for what they accept, today's answers for all else, and nothing leaked."""

import gc
import inspect
import pickle
import sys
import warnings
import weakref
from concurrent.futures import ThreadPoolExecutor
from types import BuiltinFunctionType

import numpy as np
import pytest

import jounce
from jounce.dynamics.quantities import QUANTITIES
from jounce.native import direct_interpreter, direct_layout
from jounce.native.direct import DirectCalls, decline
from support.refusals import refusal
from support.robots import floating

pytestmark = pytest.mark.skipif(not direct_interpreter.fits(), reason="direct calls are off on this interpreter")
SERVED = BuiltinFunctionType


@pytest.fixture
def iiwa14():
    return jounce.load("iiwa14")


@pytest.fixture(scope="module")
def kernel():
    return jounce.load("iiwa14").compile(order=2)


@pytest.fixture
def rates7():
    return [x.copy() for x in np.random.default_rng(5).uniform(-1, 1, (5, 7))]


def random_arrays(kernel, seed=0):
    rng = np.random.default_rng(seed)
    return [np.eye(4) if p.shape == (4, 4) else rng.uniform(-1, 1, p.shape) for p in kernel.signature.inputs]


def as_list(results):
    return list(results) if isinstance(results, tuple) else [results]


def signature_without_types(method):
    """What machine code states of a method: a signature in one line of text."""
    signature = inspect.signature(method)
    given = [x.replace(annotation=x.empty) for x in signature.parameters.values()]
    return signature.replace(parameters=given, return_annotation=signature.empty)


def same_results(found, expected):
    assert type(found) is type(expected)
    for x, y in zip(as_list(found), as_list(expected), strict=True):
        assert type(x) is type(y)
        assert (x.shape, x.dtype) == (y.shape, y.dtype)
        assert np.array_equal(x, y)
        if isinstance(x, np.ndarray):
            assert x.flags.owndata
            assert x.flags.writeable


@pytest.mark.sweep(8)
@pytest.mark.parametrize("afloat", [False, True])
@pytest.mark.parametrize("name", list(QUANTITIES))
def test_the_bits_of_the_ufunc(name, afloat):
    m = jounce.load("planar2r").mechanism
    robot = jounce.Robot(floating(m, np.random.default_rng(1)) if afloat else m)
    try:
        kernel = robot.compile(name, order=0)
    except jounce.JounceError as error:
        pytest.skip(str(error))
    arrays = random_arrays(kernel)
    found, expected = kernel.attempt(*arrays), kernel.ufunc(*arrays)
    same_results(found, expected)
    into = [np.full(p.shape, 7.0) for p in kernel.signature.outputs]
    written = kernel.attempt(*arrays, out=into[0] if len(into) == 1 else into)
    assert all(x is y for x, y in zip(as_list(written), into, strict=True))
    assert all(map(np.array_equal, into, as_list(expected)))


def test_lists_are_taken_as_arrays(kernel, rates7):
    lists = [rates7[0].tolist(), [1, -1, 0, 2, 3, -4, 5], list(rates7[2]), rates7[3], [-1.0, *rates7[4].tolist()[1:]]]
    same_results(kernel.attempt(*lists), kernel.ufunc(*map(np.array, lists)))


class Subclass(np.ndarray):
    pass


class Numbers(list):
    pass


WRONG = {
    "subclass": lambda x: x.view(Subclass),
    "masked": np.ma.masked_array,
    "single": lambda x: x.astype(np.float32),
    "integers": lambda x: x.astype(int),
    "swapped": lambda x: x.astype(x.dtype.newbyteorder()),
    "strided": lambda x: np.repeat(x, 2)[::2],
    "unaligned": lambda x: np.frombuffer(b"\0" + x.tobytes(), dtype=np.float64, offset=1),
    "batch of one": lambda x: x[None],
    "batch": lambda x: np.stack([x, x]),
    "short": lambda x: x[:-1].copy(),
    "0-d": lambda x: np.array(0.5),
    "empty": lambda x: np.empty((0, 7)),
    "objects": lambda x: x.astype(object),
    "tuple": tuple,
    "texts": lambda x: [str(y) for y in x],
    "truths": lambda x: [True] * 7,
    "nested list": lambda x: [x.tolist()],
    "short list": lambda x: x.tolist()[:-1],
    "empty list": lambda x: [],
    "list subclass": lambda x: Numbers(x.tolist()),
    "huge integers": lambda x: [10**400] * 7,
    "none": lambda x: None,
    "number": lambda x: 0.5,
    "dict": lambda x: {"joint1": 0.1},
}


@pytest.mark.parametrize("place", [0, 4])
@pytest.mark.parametrize("kind", WRONG)
def test_what_is_not_accepted_goes_to_the_callable(kernel, rates7, kind, place):
    rates7[place] = WRONG[kind](rates7[place])
    seen = []
    call = kernel.direct.make(lambda *given: seen.append(given) or "served")
    assert call(*rates7) == "served"
    assert all(x is y for x, y in zip(seen[0], rates7, strict=True))


def test_wrong_numbers_of_arguments_and_keywords_go_to_the_callable(kernel, rates7):
    call = kernel.direct.make(lambda *given, **named: (len(given), named))
    assert call() == (0, {})
    assert call(*rates7[:4]) == (4, {})
    assert call(*rates7, rates7[0]) == (6, {})
    assert call(*rates7, method=None) == (5, {"method": None})


def into(state):
    return [np.zeros(7) for _ in range(3)]


REFUSED = {
    "read-only": lambda out, state: out[1].setflags(write=False),
    "one twice": lambda out, state: out.__setitem__(2, out[0]),
    "overlap": lambda out, state: out.__setitem__(slice(0, 2), (lambda x: [x[:7], x[3:10]])(np.zeros(10))),
    "an input": lambda out, state: out.__setitem__(1, state[4]),
    "list": lambda out, state: out.__setitem__(1, [0.0] * 7),
    "single": lambda out, state: out.__setitem__(1, np.zeros(7, np.float32)),
    "shape": lambda out, state: out.__setitem__(2, np.zeros(8)),
    "strided": lambda out, state: out.__setitem__(2, np.zeros(14)[::2]),
}


@pytest.mark.parametrize("kind", REFUSED)
def test_nothing_is_written_into_what_is_not_accepted(kernel, rates7, kind):
    out = into(rates7)
    REFUSED[kind](out, rates7)
    before = [np.copy(x) for x in (*out, *rates7)]
    assert kernel.attempt(*rates7, out=out) is None
    assert all(map(np.array_equal, before, (*out, *rates7)))


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e200, 1e-200])
@pytest.mark.parametrize("given", ["arrays", "lists"])
def test_warnings_are_those_of_the_ufunc(iiwa14, kernel, rates7, value, given):
    for _ in range(2):
        iiwa14.inverse_dynamics(*rates7)
    assert type(iiwa14.inverse_dynamics) is SERVED
    rates7[1][3] = value
    asked = [x.tolist() for x in rates7] if given == "lists" else rates7

    def outcome(call, arrays):
        with warnings.catch_warnings(record=True) as found:
            warnings.simplefilter("always")
            results = call(*arrays)
        raised = ""
        with np.errstate(all="raise"):
            try:
                call(*arrays)
            except FloatingPointError as error:
                raised = str(error)
        return [str(x.message) for x in found], raised, [x.tobytes() for x in results]

    assert outcome(iiwa14.inverse_dynamics, asked) == outcome(kernel.ufunc, rates7)


def test_flags_of_the_processor_from_before_do_not_matter(kernel, rates7):
    with np.errstate(all="ignore"):
        np.float64(1e300) * np.array([1e300]) / 0.0
    assert kernel.attempt(*rates7) is not None


@pytest.mark.parametrize("failing", range(6))
def test_memory_that_is_short_leaves_nothing_behind(kernel, rates7, failing):
    testing = pytest.importorskip("_testcapi")
    kernel.attempt(*rates7)
    before = [sys.getrefcount(x) for x in rates7]
    try:
        testing.set_nomemory(failing, failing + 1)
        try:
            found = kernel.attempt(*rates7)
        finally:
            testing.remove_mem_hooks()
    except MemoryError:
        found = None
    del found
    assert [sys.getrefcount(x) for x in rates7] == before


def test_references_and_memory_stay_as_they_are(kernel, rates7):
    lists, out = [x.tolist() for x in rates7], into(rates7)
    declined = [*rates7[:4], np.zeros((2, 7))]
    calls = [
        lambda: kernel.attempt(*rates7),
        lambda: kernel.attempt(*lists),
        lambda: kernel.attempt(*rates7, out=out),
        lambda: kernel.attempt(*declined),
        lambda: kernel.attempt(*rates7, out=(*out[:2], out[0])),
        lambda: kernel.attempt([10**400] * 7, *rates7[1:]),
    ]
    watched = [*rates7, *lists, *out, *declined, np.float64, np.ndarray, np.dtype(float), lists[0][0], kernel.direct]
    for call in calls:
        call()
        before, blocks = [sys.getrefcount(x) for x in watched], sys.getallocatedblocks()
        for _ in range(20_000):
            call()
        assert [sys.getrefcount(x) for x in watched] == before
        assert sys.getallocatedblocks() < blocks + 500
    results = kernel.attempt(*rates7)
    assert sys.getrefcount(results) == 2
    assert [sys.getrefcount(x) for x in results] == [3] * 3  # of the tuple, the name, the call


class TestMethods:
    def test_each_order_is_served_once_it_was_asked_for(self, iiwa14, rates7):
        for count in (5, 3, 4):
            method = iiwa14.inverse_dynamics if type(iiwa14.inverse_dynamics) is not SERVED else None
            expected = iiwa14.inverse_dynamics(*rates7[:count], method="kernel")
            for _ in range(3):
                same_results(iiwa14.inverse_dynamics(*rates7[:count]), expected)
            if method is not None:
                same_results(method(*rates7[:count]), expected)
        assert type(iiwa14.inverse_dynamics) is SERVED

    def test_lists_are_served_from_the_second_call_on(self, iiwa14, rates7):
        expected = iiwa14.mass_matrix(rates7[0], method="recursion")
        for served in (False, False, True):
            assert (type(iiwa14.mass_matrix) is SERVED) == served
            assert np.allclose(iiwa14.mass_matrix(rates7[0].tolist()), expected, rtol=0, atol=1e-12)
        assert np.allclose(iiwa14.mass_matrix(rates7[0].tolist()), expected, rtol=0, atol=1e-12)

    @pytest.mark.parametrize("wrong", [["a"] * 7, [0.1] * 6, [[0.1] * 7, [0.2]], "text"])
    def test_wrong_arguments_have_their_one_line(self, iiwa14, wrong):
        before = refusal(lambda: iiwa14.mass_matrix(wrong))
        for _ in range(2):
            iiwa14.mass_matrix(np.zeros(7))
        assert type(iiwa14.mass_matrix) is SERVED
        assert refusal(lambda: iiwa14.mass_matrix(wrong)) == before

    def test_signature_and_docstring_are_those_of_the_method(self, iiwa14, rates7):
        signature, text = signature_without_types(iiwa14.inverse_dynamics), iiwa14.inverse_dynamics.__doc__
        for _ in range(2):
            iiwa14.inverse_dynamics(*rates7)
        assert type(iiwa14.inverse_dynamics) is SERVED
        assert (inspect.signature(iiwa14.inverse_dynamics), iiwa14.inverse_dynamics.__doc__) == (signature, text)
        assert iiwa14.inverse_dynamics.__name__ == "inverse_dynamics"
        with pytest.raises(TypeError, match=r"missing .* 'qd' and 'q2d'"):
            iiwa14.inverse_dynamics(rates7[0])

    def test_it_is_pickled_as_a_method_of_the_robot(self, iiwa14, rates7):
        expected = [iiwa14.inverse_dynamics(*rates7) for _ in range(2)][-1]
        assert type(iiwa14.inverse_dynamics) is SERVED
        method = pickle.loads(pickle.dumps(iiwa14.inverse_dynamics))
        same_results(method(*rates7), expected)
        assert isinstance(pickle.loads(pickle.dumps(iiwa14)), jounce.Robot)

    def test_a_robot_is_freed_at_once_and_its_method_outlives_it(self, rates7):
        iiwa14 = jounce.load("iiwa14")
        expected, orders = iiwa14.inverse_dynamics(*rates7), [iiwa14.inverse_dynamics(*rates7[:3])]
        iiwa14.inverse_dynamics(*rates7), iiwa14.inverse_dynamics(*rates7[:3])
        assert type(iiwa14.inverse_dynamics) is SERVED
        method, left = iiwa14.inverse_dynamics, weakref.ref(iiwa14)
        gc.disable()
        try:
            del iiwa14
            assert left() is None
        finally:
            gc.enable()
        same_results(method(*rates7), expected)
        same_results(method(*rates7[:3]), orders[0])
        assert len(method(*rates7[:4])) == 2

    def test_methods_of_subclasses_stay(self, rates7):
        class Doubled(jounce.Robot):
            def gravity_forces(self, *given, **options):
                return 2 * super().gravity_forces(*given, **options)

        iiwa14 = Doubled(jounce.load("iiwa14").mechanism)
        once = jounce.load("iiwa14").gravity_forces(rates7[0])
        for _ in range(3):
            assert np.array_equal(iiwa14.gravity_forces(rates7[0]), 2 * once)
        for _ in range(2):
            iiwa14.mass_matrix(rates7[0])
        assert type(iiwa14.mass_matrix) is SERVED

    def test_links_of_elastic_joints_are_still_asked_for_by_name(self, iiwa14, rates7):
        arm = iiwa14.elastic(1e4, rotor=0.1)
        for _ in range(3):
            arm.inverse_dynamics(*rates7[:3], side="links")
        refusal(lambda: arm.inverse_dynamics(*rates7[:3]), "side='links'")

    def test_further_rates_of_other_orders_are_not_written_into(self, iiwa14, rates7):
        for _ in range(2):
            iiwa14.gravity_forces(rates7[0])
        kept = rates7[1].copy()
        iiwa14.gravity_forces(rates7[0], rates7[1])
        assert np.array_equal(rates7[1], kept)

    def test_threads_share_them(self, iiwa14, rates7):
        expected = iiwa14.inverse_dynamics(*rates7)  # the threads make the direct call

        def run(_):
            return all(np.array_equal(iiwa14.inverse_dynamics(*rates7)[2], expected[2]) for _ in range(500))

        with ThreadPoolExecutor(4) as pool:
            assert all(pool.map(run, range(8)))


def test_a_direct_call_keeps_its_code(kernel, rates7):
    """The process may forget the code that all direct calls share, as the test below makes it."""
    call, code = kernel.direct.make(decline), weakref.ref(direct_interpreter.code())
    direct_interpreter.code.cache_clear()
    gc.collect()
    assert code() is not None
    same_results(call(*rates7), kernel(*rates7))


def test_without_direct_calls_everything_is_served_as_before(monkeypatch, rates7):
    expected = jounce.load("iiwa14").inverse_dynamics(*rates7)
    direct_interpreter.code.cache_clear()
    monkeypatch.setattr(direct_interpreter, "fits", lambda: False)
    try:
        iiwa14 = jounce.load("iiwa14")
        kernel = iiwa14.compile(order=2)
        plain = DirectCalls(kernel.addresses, kernel.signature)
        assert not plain.are_possible
        assert plain.make(decline) is decline
        monkeypatch.setattr(kernel, "direct", plain)
        monkeypatch.setattr(kernel, "attempt", decline)
        out = into(rates7)
        for _ in range(3):
            same_results(iiwa14.inverse_dynamics(*rates7), expected)
            iiwa14.inverse_dynamics(*rates7, out=out)
            assert all(map(np.array_equal, out, expected))
        same_results(iiwa14.inverse_dynamics(*[x.tolist() for x in rates7]), expected)
        assert type(iiwa14.inverse_dynamics) is not SERVED
    finally:
        direct_interpreter.code.cache_clear()


@pytest.mark.parametrize(("name", "value"), [("LIST_LENGTH", 24), ("ARRAY_DTYPE", 64), ("TABLE_SLOT", 24)])
def test_fields_in_other_places_are_noticed(monkeypatch, name, value):
    monkeypatch.setattr(direct_layout, name, value)
    assert not direct_interpreter.fits()


@pytest.mark.parametrize("without", ["lock", "processor", "implementation"])
def test_it_is_off_where_it_was_not_tested(monkeypatch, without):
    if without == "lock":
        monkeypatch.setattr(direct_interpreter.sysconfig, "get_config_var", lambda name: 1)
    elif without == "processor":
        monkeypatch.setattr(direct_interpreter.platform, "machine", lambda: "riscv64")
    else:
        monkeypatch.setattr(direct_interpreter.sys.implementation, "name", "pypy")
    assert not direct_interpreter.fits()
