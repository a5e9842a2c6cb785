"""Batches in parts: all axes are split evenly, threads are kept, errors come back, and forks have their own."""

import os
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import jounce
from jounce.native.kernel import MIN_STATES_IN_ROUNDS, _cuts, boxes, compute_in_parts

BATCHES = st.lists(st.integers(0, 5), min_size=1, max_size=4).map(tuple)


@given(BATCHES, st.data())
def test_boxes_are_the_states_between_two_numbers_in_their_order(batch, data):
    count = np.prod(batch)
    start = data.draw(st.integers(0, count))
    end = data.draw(st.integers(start, count))
    numbers = np.arange(count).reshape(batch)
    found = list(boxes(batch, start, end))
    assert [number for box in found for number in numbers[box].ravel()] == list(range(start, end))
    assert len(found) < 2 * len(batch)


@pytest.mark.parametrize("batch", [(12,), (1, 12), (3, 4), (2, 1, 6), (5, 7), (0, 3)])
@pytest.mark.parametrize("parts", [1, 2, 5, 12])
def test_every_state_is_computed_once(batch, parts):
    """Also where the first axis is one, or shorter than there are threads."""
    found = np.zeros(batch, int)

    def work(box):
        found[box] += 1

    compute_in_parts(work, batch, parts)
    assert (found == 1).all()


@pytest.mark.parametrize("batch", [(2,), (1, 2), (1, 1, 2)])
def test_threads_work_at_the_same_time_and_are_kept(batch):
    both = threading.Barrier(2, timeout=30)
    idents = []

    def work(box):
        both.wait()  # another thread has begun with the other part
        idents.append(threading.get_ident())

    for _ in range(3):
        compute_in_parts(work, batch, 2)
    assert len(idents) == 6
    names = [thread.name for thread in threading.enumerate() if thread.name.startswith("jounce")]
    assert 1 <= len(names) <= max(1, os.cpu_count() - 1)
    assert idents.count(threading.get_ident()) == 3


def test_a_caller_computes_what_no_thread_has_begun():
    """All threads are held up by other callers."""
    held, done = threading.Event(), []
    with ThreadPoolExecutor(1) as other:
        first = other.submit(
            compute_in_parts, lambda box: held.wait(30), (9 * (os.cpu_count() or 1),), 9 * (os.cpu_count() or 1)
        )
        time.sleep(0.05)
        compute_in_parts(done.append, (8,), 4)
        held.set()
        first.result()
    assert len(done) == 4


LARGE = 8 * MIN_STATES_IN_ROUNDS


def test_a_late_thread_keeps_a_quarter_of_a_batch_to_itself():
    """The caller takes all parts but the one in which the other thread waits for the caller's last."""
    begun, freed, taken = threading.Event(), threading.Event(), {True: 0, False: 0}
    caller = threading.get_ident()

    def work(box):
        called = threading.get_ident() == caller
        if called:
            assert begun.wait(30)
        taken[called] += box[0].stop - box[0].start
        if sum(taken.values()) == LARGE:
            freed.set()
        if not called:
            begun.set()
            assert freed.wait(30)

    compute_in_parts(work, (LARGE,), 2)
    assert taken == {True: LARGE * 3 / 4, False: LARGE / 4}


@pytest.mark.parametrize("threads", [2, 3, 8])
@pytest.mark.parametrize(("states", "rounds"), [(LARGE // 8 - 1, 1), (LARGE // 8, 4)])
def test_parts_of_large_batches_become_smaller(states, rounds, threads):
    cuts = _cuts(states * threads, threads)
    sizes = [(end - start) / states for start, end in pairwise(cuts)]
    assert sizes == [x for x in ((1,) if rounds == 1 else (1 / 2, 1 / 4, 1 / 8, 1 / 8)) for _ in range(threads)]
    assert cuts[0] == 0


@pytest.mark.parametrize("wrong", [0, 3])
def test_an_error_of_any_part_comes_back_once_all_have_ended(wrong):
    running = []

    def work(box):
        running.append(box)
        if box[0].start == wrong:
            raise ValueError("a part")
        time.sleep(0.01)
        running.remove(box)

    with pytest.raises(ValueError, match="a part"):
        compute_in_parts(work, (4,), 4)
    assert [box[0].start for box in running] == [wrong]


@pytest.mark.parametrize("threads", [2, 3, 7])
@pytest.mark.parametrize(
    "leads", [[(1, 41)], [(1, 41), (1, 1)], [(41,), (3, 1)], [(2, 1, 5), (1, 3, 1)], [(1,), (1, 1, 9)]]
)
def test_batches_split_along_any_axis_have_the_same_digits(threads, leads):
    robot = jounce.load("planar2r")
    rng = np.random.default_rng(0)
    state = [rng.normal(size=(*leads[k % len(leads)], 2)) for k in range(4)]
    expected = robot.inverse_dynamics(*state)
    out = tuple(np.full_like(x, np.nan) for x in expected)
    for found in (
        robot.inverse_dynamics(*state, threads=threads),
        robot.inverse_dynamics(*state, out=out, threads=threads),
    ):
        for x, y in zip(found, expected, strict=True):
            np.testing.assert_array_equal(x, y)


FORKED = """
import os, threading
from jounce.native.kernel import compute_in_parts
compute_in_parts(lambda box: None, (2,), 2)
child = os.fork()
if child == 0:
    both = threading.Barrier(2, timeout=20)
    compute_in_parts(lambda box: both.wait(), (2,), 2)  # breaks where the caller does it all
    os._exit(0)
raise SystemExit(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="processes cannot be forked")
def test_a_forked_process_has_threads_of_its_own():
    """In a process without JAX, which does not want to be forked."""
    subprocess.run([sys.executable, "-c", FORKED], check=True, timeout=60)
