"""Calls on NumPy's own arrays go a short way once one like them was served, which gives and refuses the same."""

import pickle
from dataclasses import replace
from weakref import ref

import numpy as np
import pytest

import jounce
from jounce.engine.plan import Plan
from jounce.native import kernel as module
from support.quantities import IDS, REQUESTS, affordable, branched, rigid, tupled
from support.refusals import refusal
from support.states import random_rates

ROBOT = branched()
N, NB = ROBOT.n, ROBOT.mechanism.nb


def wrenches(*batch):
    return tuple(np.random.default_rng(1).uniform(-2, 2, (4, *batch, NB, 6)))


def serve_once(robot):
    """A robot that has served a call of every form that is called below."""
    robot.inverse_dynamics(*random_rates(N, 4))
    robot.inverse_dynamics(*random_rates(N, 4), wrench=wrenches()[:2])
    robot.jacobian(*random_rates(N, 1), body="body3")
    robot.gravity_forces(*random_rates(N, 1))
    return robot


RIGID = rigid(branched())
SERVED = serve_once(rigid(branched()))


@pytest.mark.sweep(8)
@pytest.mark.parametrize(("quantity", "keywords"), REQUESTS, ids=IDS)
def test_what_was_served_once_is_not_checked_at_length_again(quantity, keywords, monkeypatch):
    order = affordable(quantity, 1)
    compute, q = getattr(ROBOT, quantity.name), random_rates(N, quantity.takes.rates + order, 3)
    W = wrenches(3)[: quantity.takes.wrench_rates + order]
    options = keywords | ({"wrench": W} if quantity.takes.wrenches else {})
    expected = tupled(compute(*q, **options, method="kernel"))
    assert tupled(compute(*q, **options))[0].shape == expected[0].shape
    monkeypatch.setattr(Plan, "compute", None)
    out = tuple(np.full(x.shape, np.nan) for x in expected)
    assert all(x is y for x, y in zip(tupled(compute(*q, **options, out=out)), out, strict=True))
    found = (out, compute(*q, **options), compute(*q, **options, out=[np.empty(x.shape) for x in expected]))
    for results in found:
        for x, y in zip(tupled(results), expected, strict=True):
            np.testing.assert_array_equal(x, y)


LOCKED = np.zeros((2, N))
LOCKED.flags.writeable = False
ONE = np.zeros(3 * N)
Q = random_rates(N, 4)
CALLS = {
    "another size": lambda robot: robot.inverse_dynamics(*Q[:3], np.zeros(N + 1)),
    "one coordinate": lambda robot: robot.inverse_dynamics(*Q[:3], np.zeros(1)),
    "a number": lambda robot: robot.gravity_forces(np.array(1.0)),
    "batches that do not fit": lambda robot: robot.inverse_dynamics(*Q[:2], np.zeros((3, N)), np.zeros((4, N))),
    "a skipped rate": lambda robot: robot.inverse_dynamics(*Q[:2], None, Q[3]),
    "complex numbers": lambda robot: robot.gravity_forces(np.zeros(N, complex)),
    "text": lambda robot: robot.gravity_forces(np.zeros(N, str)),
    "wrenches of another shape": lambda robot: robot.inverse_dynamics(
        *Q, wrench=(np.zeros((NB, 6)), np.zeros((6, NB)))
    ),
    "one wrench of two": lambda robot: robot.inverse_dynamics(*Q, wrench=np.zeros((NB, 6))),
    "no wrenches": lambda robot: robot.inverse_dynamics(*Q, wrench=()),
    "wrenches in place of rates": lambda robot: robot.inverse_dynamics(*Q, Q[0], wrench=(np.zeros((NB, 6)),)),
    "another body": lambda robot: robot.jacobian(Q[0], body="body9"),
    "no name of a body": lambda robot: robot.jacobian(Q[0], body=["body3"]),
    "another frame": lambda robot: robot.jacobian(Q[0], body="body3", frame="tool"),
    "another method": lambda robot: robot.gravity_forces(Q[0], method="rnea"),
    "true threads": lambda robot: robot.gravity_forces(Q[0], threads=True),
    "a fraction of threads": lambda robot: robot.gravity_forces(Q[0], threads=1.0),
    "one result": lambda robot: robot.inverse_dynamics(*Q, out=np.zeros(N)),
    "three results": lambda robot: robot.inverse_dynamics(*Q, out=tuple(np.zeros((3, N)))),
    "a result of a batch": lambda robot: robot.gravity_forces(Q[0], out=np.zeros((3, N))),
    "a result of one state": lambda robot: robot.gravity_forces(np.zeros((3, N)), out=np.zeros(N)),
    "a list in place of a result": lambda robot: robot.gravity_forces(Q[0], out=[[0.0] * N]),
    "a masked result": lambda robot: robot.gravity_forces(Q[0], out=np.ma.masked_array(np.zeros(N), mask=True)),
    "a read-only result": lambda robot: robot.inverse_dynamics(*Q, out=tuple(LOCKED)),
    "a result of integers": lambda robot: robot.inverse_dynamics(*Q, out=(np.zeros(N), np.zeros(N, int))),
    "one result twice": lambda robot: robot.inverse_dynamics(*Q, out=[LOCKED[0].copy()] * 2),
    "results that overlap": lambda robot: robot.inverse_dynamics(*Q, out=(ONE[:N], ONE[1 : N + 1])),
}


@pytest.mark.parametrize("case", CALLS)
def test_what_is_refused_is_refused_in_the_same_words_ever_after(case):
    first = refusal(lambda: CALLS[case](replace(RIGID)))
    assert refusal(lambda: CALLS[case](SERVED)) == first
    assert not ONE.any()


GIVEN = {
    "integers": lambda x: np.round(x).astype(int),
    "short floats": lambda x: x.astype(np.float32),
    "long floats": lambda x: x.astype(np.longdouble),
    "objects": lambda x: x.astype(object),
    "big-endian": lambda x: x.astype(">f8"),
    "masked": lambda x: np.ma.masked_greater(x, 1.0),
    "named": lambda x: np.array(tuple(x), [(name, float) for name in ROBOT.joint_names]),
    "a list": list,
}


@pytest.mark.filterwarnings("ignore:overflow encountered", "ignore:invalid value")  # of what masked numbers hold
@pytest.mark.parametrize("kind", GIVEN)
def test_arrays_of_other_kinds_are_taken_as_ever(kind):
    q = [GIVEN[kind](x) for x in Q]
    for x, y in zip(SERVED.inverse_dynamics(*q), replace(RIGID).inverse_dynamics(*q), strict=True):
        assert x.dtype == y.dtype
        np.testing.assert_array_equal(x, y)


def test_out_may_be_a_broadcast_state_or_hold_short_floats():
    q, qd, q2d, q3d = random_rates(N, 4, 5)
    expected = SERVED.inverse_dynamics(q[0], qd, q2d, q3d)
    out = np.empty((5, N)), np.empty((5, N), np.float32)
    SERVED.inverse_dynamics(q[0], qd, q2d, q3d, out=out)
    np.testing.assert_array_equal(out[0], expected[0])
    np.testing.assert_array_equal(out[1], expected[1].astype(np.float32))


def test_errors_that_a_caller_asks_numpy_for_come_through():
    for law in (SERVED.gravity_forces, SERVED.compile("gravity_forces", order=0)):
        with np.errstate(invalid="raise"), pytest.raises(FloatingPointError):
            law(np.full(N, np.inf))
        with np.errstate(invalid="warn"), pytest.raises(RuntimeWarning):  # an error by the filter of these tests
            law(np.full(N, np.inf))


def test_native_code_is_dropped_with_its_robot_and_not_sent_with_it():
    robot = jounce.load("planar2r")
    before = pickle.dumps(robot)
    robot.gravity_forces(np.zeros(2))
    robot.gravity_forces([0.0, 0.0])
    alive = ref(robot.compile("gravity_forces", order=0)), ref(robot.compile("mass_matrix", order=1))
    assert None not in [kernel() for kernel in alive]
    assert pickle.dumps(robot) == before
    del robot
    assert [kernel() for kernel in alive] == [None, None]


def test_robots_that_come_and_go_leave_no_native_code():
    before = len(module._living)
    for i in range(20):
        jounce.load("planar2r", L1=1 + i / 100).gravity_forces(np.zeros(2))
    assert len(module._living) <= before
