"""A tick of a guard: the law in closed form, the set points that are tried, and what is verified, step by step."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

import jounce
from jounce.live import guard as module
from jounce.live.guard import LAW_RATES, Guard, advance

PLANAR = jounce.load("planar2r").with_limits(effort=[50, 20], effort_rate=[600, 200], velocity=4)
SWING = jounce.Motion.fourier([0.3, 0.2], [[0.9, 0.5], [0.2, -0.4]], [[0.1, -0.3], [0.3, 0.2]], 2.0, 0.5)
BLEND = [0, 0, 0, 0, 35, -84, 70, -20]  # from rest to rest
MOVE = jounce.Motion.polynomial(np.outer([1.0, -0.8], BLEND) / 0.5 ** np.arange(8), 0.5)
TRIED = np.array([[1, 0], [0.3, 0.7], [0.1, 0.9], [0, 1], [0, 0.8], [0.01, 0], [0.001, 0]])  # of set point and speed


@pytest.mark.parametrize("k", LAW_RATES)
def test_the_law_is_solved_by_its_closed_form(k):
    """s, v, a and the set point, by the exponential of the matrix of v'' = -2k v' - k^2 (v - r)."""
    A = np.array([[0, 1, 0, 0], [0, 0, 1, 0], [0, -(k**2), -2 * k, k**2], [0, 0, 0, 0]])
    x, r, times = (0.3, 0.4, -1.5), 0.7, np.array([0.0, 1e-3, 0.05, 0.4, 2.0])
    expected = np.array([expm(A * t) @ [*x, r] for t in times])[:, :3]
    np.testing.assert_allclose(np.stack(advance(x, r, k, times), axis=1), expected, rtol=1e-11, atol=1e-14)
    np.testing.assert_allclose(advance(x, r, k, 0.05), expected[2], rtol=1e-11)


def tries_of_no_guard(monkeypatch, count=10):
    """A list of what is tried by a guard none of whose tries is possible, each after so many states."""
    tried = []

    def refuse(self, x, r, law, top, left):
        tried.append((r, law, top, left))
        return count, (2, 0.1 * len(tried))

    monkeypatch.setattr(Guard, "_verify", refuse)
    return tried


@pytest.mark.parametrize(("v", "top", "slow", "first"), [(0.5, 0.8, 0.0, 0), (0.9, 0.5, 0.0, 0), (0.0, 1.0, 0.25, 2)])
def test_less_is_tried_after_the_set_point(monkeypatch, v, top, slow, first):
    """Quick laws first; where it goes too slowly, each try is the first in turn."""
    tried, guard = tries_of_no_guard(monkeypatch), PLANAR.guard(MOVE)
    guard._slow = slow
    assert guard._choose((0.1, v, 0.0), top) == (0.0, 0, (2, 0.1))  # the first that breaks
    r, laws, tops, left = zip(*tried, strict=True)
    expected = np.minimum(np.roll(TRIED, -first, axis=0) @ [top, v], top)
    np.testing.assert_allclose(r, np.repeat(expected, 2))
    assert (laws, {*tops}) == ((0, 1) * 7, {max(v, top)})
    assert left == tuple(range(guard.checks, guard.checks - 140, -10))


def test_a_set_point_of_zero_is_the_stop(monkeypatch):
    tried, guard = tries_of_no_guard(monkeypatch), PLANAR.guard(MOVE)
    guard._law = 1
    assert guard._choose((0.1, 0.5, 0.0), 0.0) == (0.0, 1, None)
    assert tried == []


def test_tries_end_with_the_work_of_a_tick(monkeypatch):
    guard = PLANAR.guard(MOVE)
    for count, tries in ((guard.checks + 1, 1), (guard.checks, 2)):
        with monkeypatch.context() as patch:
            tried = tries_of_no_guard(patch, count)
            assert guard._choose((0.1, 0.5, 0.0), 1.0)[0] == 0
            assert len(tried) == tries


def test_the_first_possible_try_is_taken(monkeypatch):
    guard = PLANAR.guard(MOVE)
    monkeypatch.setattr(Guard, "_verify", lambda self, x, r, law, top, left: (1, None if r < 0.6 and law else (3, r)))
    assert guard._choose((0.1, 0.5, 0.0), 0.8) == (pytest.approx(0.3 * 0.8 + 0.7 * 0.5), 1, (3, 0.8))


def verified(guard, x, r, law, top, left):
    """How many states are checked, and what breaks first: each state of the tick and of the stop, one after another."""
    tables, k, end = guard.tables, LAW_RATES[law], guard.tables.s[-1]
    y = advance(x, r, k, guard.dt)
    stop = y[0] + 2 * y[1] / k + y[2] / k**2  # where the law of a stop ends
    if (stop > end and not tables.rests) or y[2] + k * y[1] - k * top > 1e-9 or y[2] + k * y[1] < 0:
        return 0, -1

    def states():
        yield (*x, r)
        if y[0] < end:
            yield (*y, r)
        for i in range(left + 2):
            s, v, a = advance(y, 0.0, k, i * guard.dt)
            cell = max(0, min(int((tables.s <= s).sum()) - 1, len(tables.s) - 2))
            if (v <= tables.stop_speed[law, cell] and a <= 0) or s >= end:
                return
            yield s, v, a, 0.0

    count = 0
    for s, v, a, goal in states():
        count += 1
        if count > left:
            return count, -1
        [rows] = tables.values(*(np.array([z]) for z in (s, v, a, -2 * k * a - k**2 * (v - goal))))
        if not ((rows <= tables.upper) & (rows >= tables.lower)).all():
            return count, int(((rows > tables.upper) | (rows < tables.lower)).argmax())
    return count, None


@pytest.mark.parametrize(
    ("motion", "work"), [(SWING, 250_000), (MOVE, 250_000), (MOVE, 4_000)], ids=["moves on", "rests", "little work"]
)
def test_the_tick_and_its_whole_stop_are_verified(monkeypatch, motion, work):
    """At states of a run, and others; with work enough, and with less than a stop takes."""
    monkeypatch.setattr(module, "MAX_WORK", work)
    guard, rng, outcomes = PLANAR.guard(motion), np.random.default_rng(0), []
    for i in range(300):
        state = guard.step(1.0 if i % 100 < 60 else 0.4)
        if i % 6 and state.status != "end":
            continue
        x, left = tuple(map(float, state[:3])), int(rng.choice([guard.checks] * 6 + [guard.checks // 9, 2, 1]))
        if i % 24 == 0:
            x = (x[0], float(rng.uniform(0, 1)), float(rng.uniform(-20, 20)))
        for law in (0, 1):
            r = float(rng.choice([1.0, x[1], 0.5 * x[1], 0.0]))
            top = max(r, x[1]) if i % 30 == 0 else 1.0
            count, place = guard._verify(x, r, law, top, left)
            row = place if place is None else place[0]
            assert (count, row) == verified(guard, x, r, law, top, left)
            outcomes.append(row)
    assert {None, -1} < set(outcomes)
    assert sum(row is not None and row >= 0 for row in outcomes) > 5
    assert outcomes.count(None) > 10


def test_a_row_on_its_bound_is_kept():
    guard = PLANAR.guard(MOVE)
    state = [np.array([x, y]) for x, y in zip((0.2, 0.5, -1.0, 4.0), (0.25, 0.25, 2.0, -3.0), strict=True)]
    values = guard.tables.values(*state)
    low, high = values.min(axis=0), values.max(axis=0)
    guard.tables = replace(guard.tables, lower=low, upper=high)
    assert guard._find_broken(*state, 2) == (2, None)
    assert guard._find_broken(*state, 1) == (2, (-1, 0.2))  # more states than are left
    for row in range(len(low)):
        for name, bounds, at in (("lower", low, values.argmin(axis=0)), ("upper", high, values.argmax(axis=0))):
            beyond = bounds.copy()
            beyond[row] = np.nextafter(bounds[row], 9 if name == "lower" else -9)
            guard.tables = replace(guard.tables, **{"lower": low, "upper": high, name: beyond})
            assert guard._find_broken(*state, 2) == (at[row] + 1, (row, state[0][at[row]]))


@pytest.mark.parametrize(("beyond", "row"), [(0.9e-9, None), (1.1e-9, -1)])
def test_speeds_may_be_beyond_the_set_point_by_rounding(beyond, row):
    """Of 1e-9: v that is less than k times that above the set point, to which it goes."""
    guard = PLANAR.with_limits(effort=1e4, effort_rate=1e6, velocity=100.0).guard(MOVE)
    for law, k in enumerate(LAW_RATES):
        place = guard._verify((0.1, 0.3, 0.0), 0.3, law, 0.3 - beyond / k, guard.checks)[1]
        assert (place if place is None else place[0]) == row


def test_a_guard_that_rests_is_stopped_wherever_it_is():
    """Where a limit leaves no speed at which a stop is done, too."""
    guard = PLANAR.guard(MOVE)
    guard.tables = replace(guard.tables, stop_speed=0 * guard.tables.stop_speed)
    assert guard._verify((0.1, 0.0, 0.0), 0.0, 0, 1.0, 100) == (2, None)
    assert guard._verify((0.1, 1e-9, 0.0), 0.0, 0, 1.0, 100)[1][0] == -1


def test_rates_of_joints_are_those_along_the_path():
    """Of a cubic in s, where s is a cubic in time, by the composition of polynomials."""
    path, (s, v, a, j) = np.array([[0.1, 0.7, -0.4, 0.3], [0.2, -0.5, 0.6, 0.9]]), (0.4, 0.8, -3.0, 20.0)
    state = module.GuardState(s, v, a, j, "follow", None, jounce.Motion.polynomial(path, 1.0))
    place = np.polynomial.Polynomial([s, v, a / 2, j / 6])
    for k, rate in enumerate(state.rates):
        expected = [np.polynomial.Polynomial(c)(place).deriv(k)(0.0) for c in path]
        np.testing.assert_allclose(rate, expected, rtol=1e-12)


def test_the_work_of_a_tick_is_bounded(monkeypatch):
    guard = PLANAR.guard(MOVE)
    assert guard.checks == 250_000 // (2 * len(guard.tables.product) + 20)
    monkeypatch.setattr(module, "MAX_WORK", 5_000)
    guard, real, counts = PLANAR.guard(SWING), Guard._verify, []

    def counted(self, *given):
        found = real(self, *given)
        counts.append(found[0])
        return found

    monkeypatch.setattr(Guard, "_verify", counted)
    assert guard.checks == 5_000 // (2 * len(guard.tables.product) + 20)
    work, states = [], []
    for _ in range(400):
        counts.clear()
        states.append(guard.step())
        work.append(sum(counts))
    assert guard.checks <= max(work) <= guard.checks + 1
    Q, Qd = PLANAR.inverse_dynamics(*np.swapaxes([x.rates for x in states], 0, 1))
    assert (np.abs(Q) < 1.0005 * PLANAR.limits.effort).all()
    assert (np.abs(Qd) < 1.0005 * PLANAR.limits.effort_rate).all()


def held_guard(monkeypatch, place, law=0):
    """A guard of ticks of 1/8 s that never moves, for a reason."""
    guard = PLANAR.guard(MOVE, dt=0.125)
    monkeypatch.setattr(Guard, "_choose", lambda self, x, top: (0.0, law, place))
    return guard


def test_it_is_stuck_after_a_second_below_a_thousandth(monkeypatch):
    guard = held_guard(monkeypatch, (0, 0.1))
    statuses = [guard.step(x).status for x in [0.5] * 10 + [0.0] + [0.5] * 9]
    assert statuses == ["limited"] * 8 + ["stuck"] * 2 + ["follow"] + ["limited"] * 8 + ["stuck"]
    for v, slow in ((0.0005, 0.0), (np.nextafter(0.0005, 0), 1.25)):
        guard._next, guard._slow = (0.1, v, 0.0), 1.125
        guard.step(0.5)
        assert guard._slow == slow


def test_what_holds_it_is_named_but_for_the_end_of_the_path(monkeypatch):
    for row, kind in ((0, "velocity"), (1, "effort"), (3, "effort_rate")):
        limit = held_guard(monkeypatch, (row, 0.1)).step().limit
        assert (limit.limit, limit.t) == (kind, 0.1)
        assert limit.joint in ("joint1", "joint2")
    assert held_guard(monkeypatch, (-1, 0.1)).step().limit is None
    assert held_guard(monkeypatch, None).step().limit is None


@pytest.mark.parametrize("law", [0, 1])
def test_the_jerk_is_that_of_the_law(monkeypatch, law):
    guard = held_guard(monkeypatch, None, law)
    guard._next = (0.1, 0.5, -2.0)
    k, state = LAW_RATES[law], guard.step()
    assert state[:3] == (0.1, 0.5, -2.0)
    assert state.j == pytest.approx(-2 * k * -2.0 - k**2 * 0.5)
    np.testing.assert_allclose(guard._next, advance((0.1, 0.5, -2.0), 0.0, k, 0.125))


@pytest.mark.parametrize(("left", "status"), [(0.99e-6, "end"), (1.01e-6, "follow")])
def test_the_end_is_a_millionth_of_the_path(left, status):
    guard = PLANAR.with_limits(effort=1e4, effort_rate=1e6, velocity=100.0).guard(SWING)
    start, end = guard.tables.s[[0, -1]]
    guard._next = (end - left * (end - start), 0.0, 0.0)
    assert guard.step(0.0).status == status
    guard._next = (end + 1.0, 0.5, 0.5)
    assert guard.step()[:5] == (end, 0.0, 0.0, 0.0, "end")


def test_stops_are_looked_at_until_they_are_done():
    """At the last time that is looked at any stop is below the least speed at which one is done, or it is too long."""
    for guard in (PLANAR.guard(SWING), PLANAR.guard(MOVE, dt=0.02)):
        lowest = guard.tables.stop_speed.min()
        for k, times in zip(LAW_RATES, guard._stop_times, strict=True):
            np.testing.assert_allclose(times, guard.dt * np.arange(len(times)), rtol=1e-12)
            speeds = (1 + k * times) * np.exp(-k * times)  # of the slowest stop, from v + a / k = 1
            assert speeds[-1] <= lowest or len(times) == guard.checks
            assert speeds[-3] > lowest
