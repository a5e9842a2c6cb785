"""Scratch memory of native code: on small stacks, from many threads, when memory is short, freed in the end."""

import ctypes
import gc
import re
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

import jounce
from jounce.dynamics.computation import Computation
from jounce.native import memory_layout, scratch_pool
from jounce.native.jit import host
from jounce.native.kernel import Kernel
from support.refusals import expect_refusal, refusal
from support.robots import random_chain

BODIES = 75  # whose scratch memory is not from the stack, even where two states are computed at once
STATE = np.random.default_rng(0).uniform(-1, 1, (5, 200, BODIES))
FORCES = Computation("inverse_dynamics", 2)


NEEDS = r"native code is limited to 0\.00781 MiB of scratch memory; this call needs 0\.\d+ MiB; use method='recursion'$"


@pytest.fixture(scope="module")
def long_chain_robot():
    return jounce.Robot(random_chain(BODIES, seed=1))


class Heap:
    """Python's heap as a kernel sees it, its buffers counted; beyond `most` at once there are none."""

    def __init__(self, monkeypatch, most=1000):
        self.used, self.largest = 0, 0
        allocate, free = scratch_pool._allocate, scratch_pool._free

        def counted_allocate(size):
            if self.used >= most:
                return None
            self.used += 1
            self.largest = max(self.largest, self.used)
            return allocate(size)

        def counted_free(buffer):
            self.used -= bool(buffer)
            free(buffer)

        monkeypatch.setattr(
            scratch_pool, "_allocate", ctypes.CFUNCTYPE(ctypes.c_void_p, ctypes.c_size_t)(counted_allocate)
        )
        monkeypatch.setattr(scratch_pool, "_free", ctypes.CFUNCTYPE(None, ctypes.c_void_p)(counted_free))


def same_from_four_threads(kernel, expected):
    with ThreadPoolExecutor(4) as threads:
        for found in threads.map(lambda _: kernel(*STATE), range(40)):
            np.testing.assert_array_equal(found, expected)


SMALL_STACK = """
import os, sys, threading
import numpy as np
import jounce
sys.path[:0] = sys.argv[1:]
from support.robots import random_chain

robot = jounce.Robot(random_chain(100, seed=1))
q = np.random.default_rng(0).uniform(-1, 1, (5, 30, 100))
W = tuple(np.random.default_rng(1).uniform(-1, 1, (3, 30, 100, 6)))
expected = robot.inverse_dynamics(*q, wrench=W)
kernel, others = robot.compile(order=2, wrench=True), [
    jounce.load("anymal").compile(name) for name in ("inverse_dynamics", "mass_matrix")
]
right = []

def work():
    for _ in range(20):
        found = kernel(*q, *W)
        out = [np.empty((30, 100)) for _ in range(3)]
        kernel.bind(*q, *W, out=out)()
        right.append(all((x == y).all() and (x == z).all() for x, y, z in zip(expected, found, out)))
    for other in others:
        other(*(np.ones(shape) for shape in [port.shape for port in other.signature.inputs]))

threading.stack_size(256 * 1024)
threads = [threading.Thread(target=work) for _ in range(3)]
for thread in threads:
    thread.start()
if hasattr(os, "fork") and not os.fork():  # while the others are at it
    os._exit(not all((x == y).all() for x, y in zip(expected, kernel(*q, *W))))
forked = os.wait()[1] if hasattr(os, "fork") else 0
for thread in threads:
    thread.join()
print(forked, len(right), all(right))
"""


def test_many_bodies_work_with_small_stacks_threads_and_forks():
    folder = Path(__file__).parent
    command = [sys.executable, "-W", "ignore", "-c", SMALL_STACK, folder, folder.parent]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert (done.returncode, done.stdout.split()) == (0, ["0", "60", "True"]), done.stderr


def test_a_call_takes_at_most_32_kib_of_the_stack(monkeypatch):
    """Whatever the robot, and however wide the vectors of the processor: what needs more is from the heap."""
    found = set()
    for bodies in (5, 10, 30):
        heap = Heap(monkeypatch)
        kernel = Kernel(random_chain(bodies, seed=1), Computation("gravity_forces", 6))
        size = ctypes.c_int64.from_address(kernel._code.address("scratch")).value
        assert heap.used == (size > 32 * 1024)
        found.add(heap.used)
    assert found == {0, 1}


def test_buffers_are_kept_for_the_next_call_and_freed_with_the_kernel(long_chain_robot, monkeypatch):
    heap = Heap(monkeypatch)
    kernel = Kernel(long_chain_robot.mechanism, FORCES)
    assert heap.used == 1
    same_from_four_threads(kernel, kernel(*STATE))
    assert 1 <= heap.largest == heap.used <= 4
    call = kernel.bind(*STATE[:, 0], out=list(np.empty((3, BODIES))))
    del kernel
    gc.collect()
    call()
    assert heap.used
    del call
    gc.collect()
    assert heap.used == 0


def test_more_calls_at_once_than_buffers_are_kept(long_chain_robot, monkeypatch, tmp_path):
    monkeypatch.setattr(scratch_pool, "MAX_KEPT_BUFFERS", 1)
    monkeypatch.setenv("JOUNCE_CACHE_DIR", str(tmp_path))  # other code under the same key
    heap = Heap(monkeypatch)
    kernel = Kernel(long_chain_robot.mechanism, FORCES)
    same_from_four_threads(kernel, kernel(*STATE))
    assert heap.used == 1


@pytest.mark.parametrize("name", ["inverse_dynamics", "gravity_forces"])
def test_nothing_that_memory_happens_to_hold_is_computed_with(long_chain_robot, name):
    kernel = Kernel(long_chain_robot.mechanism, Computation(name, 2))
    [buffer] = filter(None, kernel._pool.table[2:])
    size = memory_layout.scratch_size(kernel.computation, long_chain_robot.mechanism, host().lanes)
    found = []
    for content in (0x7FF4000000000000, 0x7FEFFFFFFFFFFFFF):  # a signalling NaN, the largest number
        np.frombuffer((ctypes.c_char * size).from_address(buffer), np.uint64)[:] = content
        found.append(kernel(*STATE[: len(kernel.signature.inputs)]))
    np.testing.assert_array_equal(*found)


def test_where_memory_is_short_calls_wait_for_each_other(long_chain_robot, monkeypatch):
    heap = Heap(monkeypatch, most=1)
    kernel = Kernel(long_chain_robot.mechanism, FORCES)
    expected = kernel(*STATE)
    for found, x in zip(kernel(*STATE, threads=4), expected, strict=True):
        np.testing.assert_array_equal(found, x)
    assert heap.largest == 1


def test_where_there_is_no_memory_a_kernel_is_refused_in_one_line(long_chain_robot, monkeypatch):
    Heap(monkeypatch, most=0)
    with expect_refusal(re.compile(r"^not enough memory for native code: it works in \d+ bytes$")):
        Kernel(long_chain_robot.mechanism, FORCES)


def test_robots_beyond_the_memory_limit_get_no_native_code(monkeypatch):
    robot, q = jounce.Robot(random_chain(125, seed=1)), np.random.default_rng(2).uniform(-1, 1, (3, 125))
    assert (
        memory_layout.scratch_size(Computation("inverse_dynamics", 12, wrench=True), random_chain(1000, seed=1), 8)
        < memory_layout.MAX_SCRATCH_BYTES
    )
    monkeypatch.setattr(memory_layout, "MAX_SCRATCH_BYTES", 2**13)
    expected = robot.inverse_dynamics(*q, method="recursion")
    np.testing.assert_array_equal(robot.inverse_dynamics(*q), expected)
    for call in (lambda: robot.compile(order=0), lambda: robot.inverse_dynamics(*q, method="kernel")):
        refusal(call, re.compile(NEEDS))


@pytest.mark.parametrize("parent", [[-1], [-1, -1, -1], [-1, 0, 0, -1, 3, 2, 1, 4], list(range(-1, 9)), [-1, *[0] * 9]])
def test_motions_stay_until_the_last_child_has_them(parent):
    slots = memory_layout.motion_slots(parent)
    for i in range(len(parent)):
        held = {slots[p + 1] for p in parent[i:] if p < i}  # of bodies that still have children, the parent among them
        assert slots[i + 1] not in held
    assert max(slots) <= len(parent)
    assert parent != list(range(-1, 9)) or max(slots) == 1
