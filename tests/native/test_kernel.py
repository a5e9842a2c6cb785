"""Native code against the recursion, and against itself: the same digits wherever and however a state is given."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import jounce
from jounce.dynamics.computation import Computation
from jounce.native import code_forms
from jounce.spatial.series import column_series
from support.machine_code import optimized
from support.natives import WAYS, assembled, target
from support.quantities import tupled
from support.recursion import inverse_dynamics
from support.refusals import expect_refusal
from support.robots import (
    floating,
    loads,
    mechanisms,
    random_mechanism,
    random_state,
    relative_error,
)
from support.states import random_inputs

BATCHES = [(), (1,), (7,), (8,), (9,), (17,), (64,), (3, 5), (0,), (2, 0)]
QUANTITIES = {"inverse_dynamics": 3, "gravity_forces": 1, "mass_matrix": 1}


def random_pendulum():
    return jounce.Robot(random_mechanism(np.random.default_rng(0), [-1], ["revolute"], [1.0]))


def forest():
    kinds, masses = ["revolute", "helical", "prismatic", "revolute"], [1.0, 2.0, 0.5, 3.0]
    return jounce.Robot(random_mechanism(np.random.default_rng(1), [-1, 0, 0, -1], kinds, masses, mimic=True))


def large_tree():
    """Of more bodies than are written in a straight line."""
    kinds = ["revolute", "prismatic", "helical", "revolute"] * 6
    return jounce.Robot(random_mechanism(np.random.default_rng(2), [-1, 0, 0, *range(2, 23)], kinds, [1.0] * 24))


def afloat(robot):
    return jounce.Robot(floating(robot.mechanism, np.random.default_rng(3)))


KERNELS = {
    "one coordinate": lambda: random_pendulum().compile(order=2),
    "two coordinates": lambda: jounce.load("planar2r").compile(order=1),
    "a forest with wrenches": lambda: forest().compile(order=1, wrench=True),
    "seven coordinates": lambda: jounce.load("iiwa14").compile(order=2),
    "many coordinates in a loop": lambda: large_tree().compile(order=4, wrench=True),
    "many coordinates in a straight line": lambda: large_tree().compile(order=1, wrench=True),
    "a matrix of many coordinates": lambda: large_tree().compile(order=0, quantity="mass_matrix"),
    "a matrix": lambda: jounce.load("planar2r").compile(order=1, quantity="mass_matrix"),
    "gravity": lambda: forest().compile(order=0, quantity="gravity_forces"),
    "one coordinate on moving ground": lambda: random_pendulum().compile(order=1, moving_base=True),
    "many coordinates on a floating base in a loop": lambda: afloat(large_tree()).compile(order=4, wrench=True),
}


@pytest.fixture(scope="module", params=KERNELS)
def any_kernel(request):
    with optimized():  # a fixture of a module comes before those of its tests
        return KERNELS[request.param]()


def results_alone(kernel, arrays, batch):
    """The results of each state on its own."""
    shapes = [port.shape for port in kernel.signature.inputs]
    whole = [np.broadcast_to(x, (*batch, *shape)) for x, shape in zip(arrays, shapes, strict=True)]
    results = [np.empty((*batch, *shape)) for shape in [port.shape for port in kernel.signature.outputs]]
    for i in np.ndindex(*batch):
        for result, x in zip(results, tupled(kernel(*(x[i].copy() for x in whole))), strict=True):
            result[i] = x
    return results


def assert_same_bits(found, expected):
    for x, y in zip(tupled(found), expected, strict=True):
        assert x.dtype == np.float64
        np.testing.assert_array_equal(x, y, strict=True)


def misaligned(x):
    """The same numbers at an odd address."""
    raw = np.empty(x.nbytes + 1, np.uint8)[1:].view(np.float64).reshape(x.shape)
    raw[...] = x
    return raw


def read_only(x):
    x = x.copy()
    x.flags.writeable = False
    return x


LAYOUTS = {
    "plain": np.copy,
    "every other state": lambda x: np.repeat(x, 2, axis=0)[::2],
    "every other row": lambda x: np.repeat(x, 2, axis=-2)[..., ::2, :],
    "reversed rows": lambda x: x[..., ::-1, :].copy()[..., ::-1, :],
    "every other entry": lambda x: np.repeat(x, 2, axis=-1)[..., ::2],
    "reversed": lambda x: x[::-1].copy()[::-1],
    "reversed entries": lambda x: x[..., ::-1].copy()[..., ::-1],
    "Fortran": np.asfortranarray,
    "read-only": read_only,
    "misaligned": misaligned,
    "big-endian": lambda x: x.astype(">f8"),
    "of the narrowest strides": lambda x: np.lib.stride_tricks.as_strided(x.copy(), x.shape, x.strides),
}


@settings(max_examples=6)
@given(mechanisms(4), st.integers(0, 4), st.booleans(), st.sampled_from(sorted(QUANTITIES)))
def test_agrees_with_the_recursion_on_random_mechanisms(drawn, order, loaded, quantity):
    mechanism, rng = drawn
    robot = jounce.Robot(mechanism)
    q = [rng.uniform(-2, 2, (11, robot.n)) for _ in range(order + QUANTITIES[quantity])]
    W = [rng.uniform(-3, 3, (11, mechanism.nb, 6)) for _ in range(order + 1)]
    options = {"wrench": tuple(W)} if loaded and quantity == "inverse_dynamics" else {}
    law = getattr(robot, quantity)
    found, expected = law(*q, **options, method="kernel"), law(*q, **options, method="recursion")
    for k, (x, y) in enumerate(zip(tupled(found), tupled(expected), strict=True)):
        assert relative_error(x, y) < 1e-13 * (1 + k), k


@settings(max_examples=4)
@given(mechanisms(4, spread=True))
def test_agrees_with_extended_precision_from_1_mg_to_10_t(drawn):
    mechanism, rng = drawn
    q, W = random_state(rng, mechanism)
    exact = [[x.astype(np.longdouble) for x in y] for y in (q, W)]
    expected = inverse_dynamics(mechanism, column_series(exact[0]), loads(exact[1])).upto(2)
    found = jounce.Robot(mechanism).inverse_dynamics(*q, wrench=tuple(W), method="kernel")
    for x, y in zip(found, expected, strict=True):
        assert relative_error(x, y[:, 0]) < 1e-13


@pytest.mark.parametrize("angle", [1e3, 1e6, 1e9])
@pytest.mark.parametrize("name", ["iiwa14", "planar2r"])
def test_agrees_with_extended_precision_at_large_angles(name, angle):
    robot = jounce.load(name)
    rng = np.random.default_rng(3)
    q = [rng.uniform(-angle, angle, robot.n), *rng.uniform(-2, 2, (4, robot.n))]
    expected = robot.inverse_dynamics(*(x.astype(np.longdouble) for x in q))
    for x, y in zip(robot.inverse_dynamics(*q, method="kernel"), expected, strict=True):
        assert relative_error(x, y) < 1e-14


@pytest.mark.parametrize("way", WAYS[1:])
def test_agrees_with_the_host_on_other_targets(way):
    robot = forest()
    quantity = Computation("inverse_dynamics", 1, wrench=True)
    function = assembled(
        code_forms.kernel_modules(robot.mechanism, quantity, target(way)), quantity.signature(robot.mechanism), way
    )
    kernel = robot.compile(order=1, wrench=True)
    for count in (1, 3, 29):
        arrays = random_inputs(kernel.signature.inputs, count)
        for x, y in zip(function(*arrays), kernel(*arrays), strict=True):
            assert relative_error(x, y) < 1e-14
        one = function(*(x[0] for x in arrays))
        assert all((x == y[0]).all() for x, y in zip(one, function(*arrays), strict=True))


@pytest.mark.parametrize("batch", BATCHES)
def test_a_state_has_the_same_digits_in_any_batch(any_kernel, batch):
    arrays = random_inputs(any_kernel.signature.inputs, *batch)
    assert_same_bits(any_kernel(*arrays), results_alone(any_kernel, arrays, batch))


@pytest.mark.parametrize("layout", LAYOUTS)
def test_a_state_has_the_same_digits_in_any_layout(any_kernel, layout):
    arrays = random_inputs(any_kernel.signature.inputs, 21)
    expected = tupled(any_kernel(*arrays))
    assert_same_bits(any_kernel(*map(LAYOUTS[layout], arrays)), expected)
    for k in range(len(arrays)):
        assert_same_bits(any_kernel(*arrays[:k], LAYOUTS[layout](arrays[k]), *arrays[k + 1 :]), expected)


@pytest.mark.filterwarnings("ignore:threads=.* has no effect on one state")
@pytest.mark.parametrize("leads", [((), (19,)), ((5, 1), (4,)), ((1,), (19,)), ((1, 3), (6, 1)), ((2, 1, 3), (4, 1))])
def test_batches_are_broadcast(any_kernel, leads):
    batch = np.broadcast_shapes(*leads)
    arrays = [
        random_inputs(any_kernel.signature.inputs, *leads[k % 2])[k]
        for k in range(len(random_inputs(any_kernel.signature.inputs)))
    ]
    if len(arrays) == 1:
        arrays, batch = random_inputs(any_kernel.signature.inputs, *leads[0]), leads[0]
    expected = results_alone(any_kernel, arrays, batch)
    assert_same_bits(any_kernel(*arrays), expected)
    assert_same_bits(any_kernel(*arrays, threads=3), expected)


@pytest.mark.parametrize(
    "layout", ["plain", "every other state", "every other entry", "reversed", "Fortran", "misaligned"]
)
@pytest.mark.filterwarnings("ignore:threads=.* has no effect on one state")
@pytest.mark.parametrize("threads", [1, 3])
def test_results_are_written_into_arrays_of_any_layout(any_kernel, layout, threads):
    arrays = random_inputs(any_kernel.signature.inputs, 21)
    out = [
        LAYOUTS[layout](np.full((21, *shape), np.nan))
        for shape in [port.shape for port in any_kernel.signature.outputs]
    ]
    around = [x.base.copy() if layout == "every other state" else None for x in out]
    results = any_kernel(*arrays, out=tuple(out), threads=threads)
    assert all(x is y for x, y in zip(tupled(results), out, strict=True))
    assert_same_bits(tuple(out), tupled(any_kernel(*arrays)))
    for x, before in zip(out, around, strict=True):
        assert before is None or np.isnan(x.base[1::2]).all()


@pytest.mark.filterwarnings("ignore:threads=.* has no effect on one state")
@pytest.mark.parametrize("threads", [2, 3, 16, 1000, np.int64(4)])
@pytest.mark.parametrize("batch", [(), (1,), (0,), (5,), (64,), (257,), (3, 5), (2, 0)])
def test_threads_change_no_digit(any_kernel, batch, threads):
    arrays = random_inputs(any_kernel.signature.inputs, *batch)
    assert_same_bits(any_kernel(*arrays, threads=threads), [np.asarray(x) for x in tupled(any_kernel(*arrays))])


@pytest.mark.parametrize("threads", [1, 4])
def test_results_may_lie_over_the_states(threads):
    kernel = jounce.load("planar2r").compile(order=0)
    q, qd, q2d = random_inputs(kernel.signature.inputs, 5000)
    expected = kernel(q, qd, q2d)
    for step in (1, -1):
        x = q.copy()
        assert_same_bits(kernel(x, qd, q2d, out=x[::step], threads=threads), [expected])
    x = np.concatenate([q, q[:1]])
    assert_same_bits(kernel(x[:-1], qd, q2d, out=x[1:], threads=threads), [expected])


@pytest.mark.parametrize("wrong", [np.nan, np.inf, -np.inf])
def test_nan_spoils_only_the_results_that_depend_on_it(any_kernel, wrong):
    """Entry by entry: NaN in all results from the order that the array matters to, in its own state alone."""
    arrays = random_inputs(any_kernel.signature.inputs, 20)
    expected = tupled(any_kernel(*arrays))
    for k, matters in enumerate([port.first_order for port in any_kernel.signature.inputs]):
        for entry in np.ndindex(arrays[k].shape[1:]):
            i = (3, 17)[k % 2]  # in a block of rows, and in the last lanes
            spoilt = [x.copy() for x in arrays]
            spoilt[k][(i, *entry)] = wrong
            with np.errstate(invalid="ignore"):
                results = tupled(any_kernel(*spoilt))
            for order, (x, y) in enumerate(zip(results, expected, strict=True)):
                assert np.isnan(x[i]).all() == (order >= matters)
                np.testing.assert_array_equal(np.delete(x, i, axis=0), np.delete(y, i, axis=0))
                assert order >= matters or (x[i] == y[i]).all()


def test_which_inputs_matter_is_what_the_recursion_says():
    robot, rng = forest(), np.random.default_rng(4)
    q = [rng.normal(size=robot.n) for _ in range(5)]
    for k in range(5):
        spoilt = [x * np.nan if j == k else x for j, x in enumerate(q)]
        for x, y in zip(*(robot.inverse_dynamics(*spoilt, method=m) for m in ("kernel", "recursion")), strict=True):
            assert (np.isnan(x).all(), np.isnan(x).any()) == (np.isnan(y).any(), np.isnan(y).any())


def test_threads_for_one_state_are_warned_of():
    robot, state = jounce.load("planar2r"), np.ones((3, 2))
    expected = robot.inverse_dynamics(*state)
    for call in (robot.inverse_dynamics, robot.compile(order=0)):
        with pytest.warns(jounce.JounceWarning, match=r"^threads=2 has no effect on one state"):
            found = call(*state, threads=2)
        assert found.tolist() == expected.tolist()
    robot.inverse_dynamics(*state[:, None], threads=2)  # a batch of one is a batch


@pytest.mark.parametrize("threads", [0, -1, "2", 2.0, None, True, [2]])
def test_threads_that_are_no_number_are_refused(threads):
    robot = jounce.load("planar2r")
    with expect_refusal("^threads = …; expected how many, 1 or more$"):
        robot.inverse_dynamics(*np.ones((3, 4, 2)), threads=threads)


def test_errors_and_silence_of_numpy_reach_every_thread():
    kernel = jounce.load("planar2r").compile(order=0)
    arrays = [np.full((9, 2), np.inf)] * 3
    for threads in (1, 3):
        with np.errstate(invalid="ignore"):
            assert np.isnan(kernel(*arrays, threads=threads)).all()
        with np.errstate(invalid="raise"), pytest.raises(FloatingPointError):
            kernel(*arrays, threads=threads)


def test_nothing_is_written_beside_the_results(any_kernel):
    for count in range(1, 41):
        arrays = random_inputs(any_kernel.signature.inputs, count)
        around = [
            np.full((count + 20, *shape), np.nan) for shape in [port.shape for port in any_kernel.signature.outputs]
        ]
        any_kernel(*arrays, out=tuple(x[10:-10] for x in around))
        for x in around:
            assert not np.isnan(x[10:-10]).any()
            assert np.isnan(x[:10]).all()
            assert np.isnan(x[-10:]).all()
