"""The tables of a guard, held against the definition of what they hold."""

from dataclasses import replace

import numpy as np
import pytest

import jounce
from jounce import JounceError, JounceWarning
from jounce.limits import path_terms
from jounce.live import guard
from jounce.live.guard import _STOP_SPEEDS, LAW_RATES, _find_rough, _find_stop_speeds, build_tables

PLANAR = jounce.load("planar2r").with_limits(effort=[50, 20], effort_rate=[600, 200], velocity=4)
BLEND = [0, 0, 0, 0, 35, -84, 70, -20]  # from rest to rest
JUMPS = jounce.Motion.trapezoidal([[0, 0], [1, -1]], 4.0, 30.0).blended(0.05, 2)


def blended_move(duration):
    return jounce.Motion.polynomial(np.outer([1.0, -0.8], BLEND) / duration ** np.arange(8), duration)


def exact_rows(tables, s, left=False):
    """Factors (N, R, K) of all products at s, straight from the limits."""
    path = path_terms.sample_path(tables.problem.robot, tables.problem.motion, s, tables.problem.order, left)
    rows = tables.problem.rows(path, 10.0)
    found = np.zeros((*rows.joints.shape, 7))
    found[:, :, rows.used] = rows.factors
    return found


def dense(tables, nodes):
    """Factors (N, R, 7) of all products at some nodes."""
    found = np.zeros((len(nodes), len(tables.kinds), 7))
    row = np.repeat(np.arange(len(tables.kinds)), np.diff(tables.first))
    found[:, row, tables.product] = tables.factors[nodes]
    return found


def worst(tables, off, exact):
    """The largest errors (N,) of rows: v is 1 at most, a and j by the quick law, and no term is twice its limit."""
    products = np.minimum([1, 1, 1, 30, 1, 30, 900], 2 / np.maximum(np.abs(exact).max(axis=1), 1e-300))
    return (np.abs(off) * products[:, None]).sum(axis=2).max(axis=1)


WIDE = jounce.Motion.polynomial(np.outer([40.0, -30.0], BLEND) / 0.5 ** np.arange(8), 0.5)


@pytest.mark.parametrize("motion", [blended_move(0.5), WIDE, JUMPS], ids=["smooth", "wide", "jumps"])
def test_cells_are_halved_until_they_are_exact_and_no_further(motion):
    tables = build_tables(PLANAR, motion)
    s = tables.s
    assert (s[0], s[-1]) == (motion.start, motion.stop)
    cells = np.flatnonzero(np.diff(s))
    middles = (s[cells] + s[cells + 1]) / 2
    exact = exact_rows(tables, middles)
    off = exact - (dense(tables, cells) + dense(tables, cells + 1)) / 2
    assert worst(tables, off, exact).max() <= 2e-4
    first = (motion.stop - motion.start) / 100
    assert np.diff(s).max() <= min(first, 0.005) * (1 + 1e-9)
    breaks = {*tables.problem.breaks}
    assert all(np.count_nonzero(s == t) >= 2 for t in breaks)
    # Two cells of equal size that one was halved to were not exact as one.
    sizes = np.diff(s)
    pairs = [i for i in range(1, len(s) - 1) if sizes[i] and 0 < sizes[i] < 0.6 * min(first, 0.005)
             and abs(sizes[i] - sizes[i - 1]) < 1e-9 and not {*s[i - 1 : i + 2]} & breaks
             and abs((s[i - 1] - s[0]) / (2 * sizes[i]) % 1 - 0.5) > 0.49]  # fmt: skip
    if motion is not JUMPS:
        assert pairs
        whole = dense(tables, np.array(pairs))
        off = whole - (dense(tables, np.array(pairs) - 1) + dense(tables, np.array(pairs) + 1)) / 2
        assert worst(tables, off, whole).min() > 2e-4


def test_cells_are_halved_beyond_the_error_alone(monkeypatch):
    """Of two cells that are as exact as is asked for, and less so by rounding."""
    exact = np.zeros((2, 1, 7))
    exact[:, 0, 0] = 2e-4, np.nextafter(2e-4, 1)
    monkeypatch.setattr(guard, "_sample_rows", lambda problem, t: (t, exact, np.zeros((2, 1), dtype=int)))
    after, middles, *_ = _find_rough(None, np.arange(3.0), np.zeros((3, 1, 7)), np.arange(2))
    assert (after.tolist(), middles.tolist()) == ([2], [1.5])


def test_nodes_at_breaks_are_those_before_and_after():
    tables = build_tables(PLANAR, JUMPS)
    s, breaks = tables.s, tables.problem.breaks
    inner = breaks[(breaks > s[0]) & (breaks < s[-1])]
    assert len(inner) == 4
    before, after = np.searchsorted(s, inner), np.searchsorted(s, inner, side="right") - 1
    left, right = exact_rows(tables, inner, left=True), exact_rows(tables, inner)
    np.testing.assert_allclose(dense(tables, before), left, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(dense(tables, after), right, rtol=1e-9, atol=1e-12)
    assert np.abs(right - left).max() > 1e-3


def test_rows_are_sums_of_factors_between_nodes():
    tables, rng = build_tables(PLANAR, blended_move(0.5)), np.random.default_rng(0)
    s, v, a, j = rng.uniform([0.0, 0, -10, -300], [0.5, 1, 10, 300], (50, 4)).T
    products = [1 + 0 * v, v, v**2, a, v**3, v * a, j]
    assert tables.first[-1] == len(tables.product) == tables.factors.shape[1]
    assert (len(tables.first) - 1, len(tables.lower), len(tables.upper)) == (len(tables.kinds),) * 3
    for i, (first, last) in enumerate(zip(tables.first[:-1], tables.first[1:], strict=True)):
        terms = range(first, last)
        row = sum(np.interp(s, tables.s, tables.factors[:, t]) * products[tables.product[t]] for t in terms)
        np.testing.assert_allclose(tables.values(s, v, a, j)[:, i], row, rtol=1e-12, atol=1e-12)
    assert tables.kinds == ("velocity", "effort", "effort", "effort_rate", "effort_rate")
    assert tables.cells(np.array([-1.0, 0.0, 0.25, 0.5, 9.0])).tolist() == [
        0, 0, np.flatnonzero(tables.s <= 0.25)[-1], len(tables.s) - 2, len(tables.s) - 2,
    ]  # fmt: skip
    assert tables.work == 2 * len(tables.product) + 20


def test_limits_are_named_by_row_and_place():
    tables = build_tables(PLANAR.with_limits(velocity=[4, 1]), blended_move(0.5))
    for row, joint, kind in ((0, "joint2", "velocity"), (1, "joint1", "effort"), (4, "joint2", "effort_rate")):
        found = tables.describe(row, 0.25)
        assert (found.joint, found.limit, found.t) == (joint, kind, 0.25)


def slowing_motion(left):
    """A joint slows down smoothly from a speed of 1 to this."""
    return jounce.Motion.polynomial([[0, 1, -(1 - left), (1 - left) / 3], [0, 0, 0, 0]], 1.0)


@pytest.mark.parametrize(("left", "rests"), [(0.9e-9, True), (1.1e-9, False)])
def test_a_motion_rests_at_its_end_below_a_billionth_of_its_speed(left, rests):
    assert build_tables(PLANAR, slowing_motion(left)).rests == rests


def test_a_motion_rests_at_the_rate_of_rest_too(monkeypatch):
    """Of a speed at the end that is the share to the last bit."""
    monkeypatch.setattr(guard, "_REST_RATE", 2.0**-30)
    assert build_tables(PLANAR, slowing_motion(2.0**-30)).rests


@pytest.mark.parametrize(("duration", "nodes"), [(0.25, 101), (0.5, 101), (0.501, 102), (0.999, 201), (1.0, 201)])
def test_first_nodes_are_five_milliseconds_apart(duration, nodes):
    """Of limits of velocity along a straight line, which take few more."""
    robot = jounce.load("planar2r").with_limits(velocity=100)
    tables = build_tables(robot, jounce.Motion.polynomial([[0, 1e-3], [0, 1e-3]], duration))
    assert len(np.unique(tables.s)) == nodes


def test_motions_of_too_many_nodes_are_refused(monkeypatch):
    monkeypatch.setattr(guard, "_MAX_NODES", 201)
    with pytest.raises(JounceError, match=r"the motion takes 1\.001 s; expected up to 1 s, divide it"):
        build_tables(PLANAR, blended_move(1.001))
    with pytest.raises(JounceError, match=r"change too fast for tables of 201 nodes"):
        build_tables(PLANAR.with_limits(effort=[1e3, 1e3]), blended_move(1.0))
    line = jounce.Motion.polynomial([[0, 1e-3], [0, 1e-3]], 1.0)
    assert len(build_tables(jounce.load("planar2r").with_limits(velocity=100), line).s) >= 201


def test_friction_leaves_less_of_efforts_and_no_power():
    rubbing = jounce.load("planar2r").with_limits(effort=[50, 20])
    m = rubbing.mechanism
    drives = replace(m.drives, friction=np.array([3.0, 2.0]))
    rubbing = jounce.Robot(replace(m, drives=drives)).with_drives(["friction"])
    tables = build_tables(rubbing, blended_move(0.5))  # no warning: nothing limits rates of efforts
    assert tables.problem.friction is None
    np.testing.assert_allclose(tables.problem.limits.bounds("effort"), [[-47, -18], [47, 18]])
    with pytest.raises(JounceError, match=r"no limits of power with Coulomb friction; .*with_limits\(power=inf\)"):
        build_tables(rubbing.with_limits(power=1e3), blended_move(0.5))
    with pytest.warns(JounceWarning, match="do not bound the rate of Coulomb friction"):
        build_tables(rubbing.with_limits(effort_rate=1e4), blended_move(0.5))


@pytest.mark.parametrize("k", LAW_RATES)
def test_speeds_of_stops_are_the_largest_possible(k):
    """Against a search speed by speed and node by node."""
    rng = np.random.default_rng(0)
    s = np.sort(np.concatenate([rng.uniform(0, 1, 50), [0.3, 0.3]]))
    size, slack = rng.uniform(0, 1, (52, 3, 7)) ** 8, rng.uniform(-0.01, 1, (52, 3)) ** 3
    own = []
    for i in range(len(s)):
        kept = [v for v in _STOP_SPEEDS if (size[i] @ [0, v, v**2, k * v, v**3, k * v**2, k**2 * v] <= slack[i]).all()]
        own.append(max(kept, default=0.0))
    after = np.append(s[1:], s[-1]) + 2 * _STOP_SPEEDS[0] / k
    expected = [min(own[i : max(i + 1, int((s <= after[i]).sum()))]) for i in range(len(s))]
    assert len({*own}) > 10
    np.testing.assert_array_equal(_find_stop_speeds(k, s, size, slack), expected)


def test_a_stop_may_take_all_that_is_left_of_a_limit():
    """Of one row that grows as v: the speed at which it is on its bound, and the next one below it."""
    s, size = np.linspace(0, 1, 3), np.zeros((3, 1, 7))
    size[:, :, 1] = 1.0
    for slack, found in ((_STOP_SPEEDS[20], 20), (np.nextafter(_STOP_SPEEDS[20], 0), 21)):
        speeds = _find_stop_speeds(30.0, s, size, np.full((3, 1), slack))
        np.testing.assert_array_equal(speeds, np.full(3, _STOP_SPEEDS[found]))


@pytest.mark.parametrize("k", LAW_RATES)
def test_each_product_of_a_stop_has_its_bound(k):
    """v, v^2, a up to k v, v^3, v a, and j up to k^2 v."""
    s, v = np.linspace(0, 1, 3), _STOP_SPEEDS[20]
    for product, value in enumerate((v, v * v, k * v, v * v * v, k * v * v, k * k * v), start=1):
        size = np.zeros((3, 1, 7))
        size[:, :, product] = 1.0
        for share, found in ((1 + 1e-12, 20), (1 - 1e-12, 21)):
            speeds = _find_stop_speeds(k, s, size, np.full((3, 1), share * value))
            np.testing.assert_array_equal(speeds, np.full(3, _STOP_SPEEDS[found]))


def test_gravity_leaves_less_to_stops_on_either_side():
    """On a path and its mirror image, whose forces at rest are near the upper limits and near the lower ones."""
    planar = jounce.load("planar2r")
    held = np.abs(planar.gravity_forces([0.0, 0.0]))
    path = np.outer([0.1, -0.1], BLEND)
    image = np.pi * np.outer([1, 0], np.eye(8)[0]) - path
    speeds = {}
    for share in (1.2, 3.0):
        robot = planar.with_limits(effort=share * held)
        of_path, of_image = (build_tables(robot, jounce.Motion.polynomial(x, 1.0)).stop_speed for x in (path, image))
        np.testing.assert_array_equal(of_path, of_image)
        speeds[share] = of_path.min()
    assert 0 < speeds[1.2] < speeds[3.0]


def test_blocks_of_nodes_make_the_same_tables(monkeypatch):
    robot = jounce.load("planar2r").with_limits(velocity=2, acceleration=20, effort=[90, 30])
    motion = jounce.Motion.trapezoidal([[0, 0], [1, 0.5]], 1.0, 5.0)
    whole = build_tables(robot, motion)
    monkeypatch.setattr(guard, "_NODES_PER_BLOCK", 7)
    parts = build_tables(robot, motion)
    for name in ("s", "factors", "product", "first", "lower", "upper", "joints", "stop_speed"):
        np.testing.assert_allclose(getattr(parts, name), getattr(whole, name), rtol=1e-12, atol=1e-12)
