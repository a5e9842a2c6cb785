"""What memory safety and warnings of native code rest on, by the methods of robots: overlaps, long lists, underflow.

Methods are called again and again, as the third call may run other code than the first.
"""

import warnings

import numpy as np
import pytest

import jounce
from support.refusals import refusal
from support.robots import random_mechanism

CALLS = 3
ARM = jounce.load("iiwa14")
N = ARM.n
BATCH = 40
SPANS = {  # where the positions and the forces lie in one row of memory, of how many numbers
    "the same": (0, 0),
    "one entry later": (0, 1),
    "one entry earlier": (1, 0),
    "one state later": (0, N),
    "one state earlier": (N, 0),
}


def overlapping(span, *shape):
    """Two arrays of a shape in the same memory, the first one random."""
    size = int(np.prod(shape))
    memory = np.random.default_rng(7).uniform(-1, 1, size + N)
    return [memory[start : start + size].reshape(shape) for start in SPANS[span]]


@pytest.mark.parametrize("shape", [(N,), (BATCH, N)], ids=["one state", "batch"])
@pytest.mark.parametrize("method", [None, "recursion", "closed_form"])
@pytest.mark.parametrize("span", SPANS)
def test_results_may_lie_over_positions(span, method, shape):
    for _ in range(CALLS):
        q, out = overlapping(span, *shape)
        expected = ARM.gravity_forces(q.copy(), method="recursion")
        assert ARM.gravity_forces(q, out=out, method=method) is out
        np.testing.assert_allclose(out, expected, rtol=0, atol=1e-11)


@pytest.mark.parametrize("shape", [(N,), (BATCH, N)], ids=["one state", "batch"])
@pytest.mark.parametrize("span", SPANS)
def test_results_with_rates_may_lie_over_positions(span, shape):
    rates = np.random.default_rng(8).uniform(-1, 1, (3, *shape))
    for _ in range(CALLS):
        q, out = overlapping(span, *shape)
        expected = ARM.inverse_dynamics(q.copy(), *rates, method="recursion")
        found = ARM.inverse_dynamics(q, *rates, out=(np.empty(shape), out))
        for x, y in zip(found, expected, strict=True):
            np.testing.assert_allclose(x, y, rtol=0, atol=1e-11)


@pytest.mark.parametrize("apart", [0, 1, N - 1, N])
def test_results_that_lie_over_each_other_are_refused(apart):
    state, memory = np.random.default_rng(9).uniform(-1, 1, (2, N)), np.zeros(2 * N)
    out = memory[:N], memory[apart : apart + N]
    expected = ARM.gravity_forces(*state, method="recursion")
    for _ in range(CALLS):
        ARM.gravity_forces(*state)
        if apart < N:
            refusal(lambda: ARM.gravity_forces(*state, out=out), "share memory")
            assert not memory.any()
        else:
            ARM.gravity_forces(*state, out=out)
            np.testing.assert_allclose(out, expected, rtol=0, atol=1e-11)


@pytest.mark.parametrize("threads", [1, 2, 3])
@pytest.mark.parametrize("span", SPANS)
def test_kernels_may_write_over_positions(span, threads):
    q, out = overlapping(span, BATCH, N)
    expected = ARM.gravity_forces(q.copy(), method="recursion")
    ARM.compile("gravity_forces", order=0)(q, out=out, threads=threads)
    np.testing.assert_allclose(out, expected, rtol=0, atol=1e-11)


@pytest.mark.parametrize("span", SPANS)
def test_bound_kernels_refuse_results_over_positions(span):
    q, out = overlapping(span, N)
    kernel = ARM.compile("gravity_forces", order=0)
    if np.shares_memory(q, out):
        refusal(lambda: kernel.bind(q, out=out), "shares memory")
    else:
        kernel.bind(q, out=out)()
        np.testing.assert_allclose(out, ARM.gravity_forces(q), rtol=0, atol=1e-11)


@pytest.mark.sweep(4)
@pytest.mark.parametrize("n", [100, 102, 103, 120, 400])
def test_lists_of_many_numbers_are_taken(n):
    """As lists of 5 n numbers, 600 among them, in one call."""
    parent = [-1, *((i - 1) // 2 for i in range(1, n))]  # a tree that branches at each body
    robot = jounce.Robot(random_mechanism(np.random.default_rng(2), parent, ["revolute"] * n, [1.0] * n))
    state = np.random.default_rng(3).uniform(-1, 1, (5, n))
    expected = robot.inverse_dynamics(*state, method="recursion")
    for _ in range(CALLS):
        found = robot.inverse_dynamics(*state.tolist())
        for x, y in zip(found, expected, strict=True):
            np.testing.assert_allclose(x, y, rtol=0, atol=1e-11 * np.abs(y).max())


FAULTS = {  # a velocity, and what NumPy calls what it does to the kinetic energy
    "underflow": 1e-170,
    "overflow": 1e200,
    "invalid": np.inf,
}


@pytest.mark.parametrize("lists", [False, True])
@pytest.mark.parametrize("fault", FAULTS)
def test_faults_of_numbers_are_reported_as_numpy_is_asked_to(fault, lists):
    robot, q, qd = jounce.load("planar2r"), np.array([0.1, 0.2]), np.full(2, FAULTS[fault])
    given = (q.tolist(), qd.tolist()) if lists else (q, qd)
    for _ in range(CALLS):
        assert robot.kinetic_energy(q, q) > 0
        asked = {"underflow": "under", "overflow": "over"}.get(fault, fault)
        with np.errstate(all="ignore", **{asked: "raise"}), pytest.raises(FloatingPointError, match=fault):
            robot.kinetic_energy(*given)
        with np.errstate(all="ignore"), warnings.catch_warnings():
            warnings.simplefilter("error")
            robot.kinetic_energy(*given)
