"""Paths of way points: through all of them or along lines with rounded corners, and the motion from rest to rest."""

from itertools import pairwise

import numpy as np
import pandas as pd
import pytest
from scipy.interpolate import BPoly

import jounce
from jounce import Motion
from jounce.model import positions
from jounce.motion.joint_matching import take_points
from jounce.motion.way_points import MERGE_DISTANCE, MIN_CORNER_SHARE, SMALL_CORNER, path_along_lines, path_through
from support.refusals import refusal
from support.several_named import named_robot

CASE = np.array([(-1.62219, 0.0430026, 0.51164, 0.814931, 0.88985, -1.98603), (0, 0, 0, 0, 0.523599, 0), [0] * 6])
UR5 = jounce.load("ur5")


def uneven_points(seed):
    """Two to eight points of one to seven joints, some of them close together."""
    rng = np.random.default_rng(seed)
    count, joints = rng.integers(2, 9), rng.integers(1, 8)
    steps = rng.uniform(-1, 1, (count, joints)) * 10 ** rng.uniform(-3, 0, (count, 1))
    return np.cumsum(steps, axis=0) + rng.uniform(-2, 2, joints)


def sample(path, count=20_001):
    """Parameters of a path: even ones, the ends of its pieces and their middles, where blends are at their corners."""
    x = path.curve.x
    return np.concatenate([np.linspace(path.curve.start, path.curve.stop, count), x, (x[1:] + x[:-1]) / 2])


def differentiate(f, t, h):
    """The derivative of a smooth function by central differences of eight points."""
    weights = np.array([4 / 5, -1 / 5, 4 / 105, -1 / 280])
    return sum(w * (f(t + k * h) - f(t - k * h)) for k, w in enumerate(weights, 1)) / h


# The smooth path.
@pytest.mark.parametrize("seed", range(12))
def test_a_smooth_path_leads_through_all_points_with_four_derivatives(seed):
    points = uneven_points(seed)
    path = path_through(points)
    assert np.abs(path.curve.rates(path.curve.x, 0)[0] - points).max() < 1e-13
    assert np.abs(path.curve.rates(path.curve.x, 0, left=True)[0] - points).max() < 1e-13
    before, after = path.curve.rates(path.curve.x[1:-1], 4, left=True), path.curve.rates(path.curve.x[1:-1], 4)
    whole = path.curve.rates(sample(path), 4)
    for left, right, rate in zip(before, after, whole, strict=True):
        assert np.abs(left - right).max(initial=0) <= 1e-8 * np.abs(rate).max()
    # It begins and ends straight, as lines do.
    ends = path.curve.rates(path.curve.x[[0, -1]], 3)
    for rate, of_all in zip(ends[2:], whole[2:], strict=False):
        assert np.abs(rate).max() <= 1e-8 * np.abs(of_all).max() + 1e-12


@pytest.mark.parametrize("seed", range(40))
def test_a_smooth_path_overshoots_by_less_than_half_of_a_step(seed):
    """Uneven gaps make no wild loops: with the distances themselves as parameter it would be eight times as much."""
    points = uneven_points(seed)
    path = path_through(points)
    q = path.curve.rates(sample(path), 0)[0]
    beyond = np.maximum(q - points.max(axis=0), points.min(axis=0) - q).max()
    assert beyond < 0.5 * np.abs(np.diff(points, axis=0)).max()


@pytest.mark.parametrize("joints", [1, 2, 7])
def test_two_points_are_a_straight_line(joints):
    start, end = np.random.default_rng(joints).uniform(-3, 3, (2, joints))
    motion = Motion.waypoints([start, end], 2.0)
    q = motion(np.linspace(0, 2, 5001), 0)[0]
    share = (q - start) @ (end - start) / ((end - start) @ (end - start))
    assert np.abs(q - start - np.outer(share, end - start)).max() < 4e-15
    assert (np.diff(share) >= -1e-15).all()
    assert np.abs(motion([0.0, 2.0], 0)[0] - [start, end]).max() < 1e-15


def test_equal_neighbours_count_once():
    doubled = np.concatenate([CASE[[0, 0]], CASE, CASE[[2]]])
    motion = Motion.waypoints(doubled, 3.0)
    t = np.linspace(0, 3, 301)
    assert np.array_equal(motion(t, 4)[4], Motion.waypoints(CASE, 3.0)(t, 4)[4])
    assert motion.notes == ("points 1, 2, 5 from 0: equal to the one before; left out",)


@pytest.mark.parametrize(("distance", "notes"), [(0.9 * MERGE_DISTANCE, 1), (1.1 * MERGE_DISTANCE, 0)])
def test_neighbours_are_merged_below_a_distance(distance, notes):
    points = np.array([[0.0, 0.0], [1.0, 0.5], [1.0 + distance, 0.5], [0.5, 1.0]])
    motion = Motion.waypoints(points, 1.0)
    assert len(motion.notes) == notes
    passed = motion(np.linspace(0, 1, 100_001), 0)[0]
    assert all(np.abs(passed - point).max(axis=1).min() < 1e-4 for point in points)


# Lines with rounded corners.
def corner_distance(q, corner):
    """The least distance of a path from a corner, by the largest joint."""
    return np.abs(q - corner).max(axis=1).min()


@pytest.mark.parametrize("tolerance", [1e-5, 1e-3, 0.03, 0.5])
@pytest.mark.parametrize("seed", range(8))
def test_corners_are_rounded_within_the_tolerance(seed, tolerance):
    """At each corner the path is as far away as the tolerance, or as half of a neighbouring line allows."""
    points = uneven_points(seed)
    if len(points) == 2 or points.shape[1] == 1:
        points = np.random.default_rng(seed).uniform(-1, 1, (4, 3))
    path = path_along_lines(points, tolerance)
    steps = np.diff(points, axis=0)
    lengths = np.abs(steps).max(axis=1)
    turns = np.abs(np.diff(steps / lengths[:, None], axis=0)).max(axis=1)
    reached = np.minimum(tolerance, 35 / 256 * turns * np.minimum(lengths[1:], lengths[:-1]) / 2)
    q = path.curve.rates(sample(path), 0)[0]
    for corner, distance in zip(points[1:-1], reached, strict=True):
        assert corner_distance(q, corner) <= distance * (1 + 1e-9) + 1e-14
    assert path.distance.max() == pytest.approx(reached.max(), rel=1e-9)
    assert np.abs(path.curve.rates(path.curve.x[[0, -1]], 0)[0] - points[[0, -1]]).max() < 1e-13


@pytest.mark.parametrize("seed", range(8))
def test_a_rounded_path_is_lines_and_symmetric_blends(seed):
    points = np.random.default_rng(seed).uniform(-1, 1, (5, 4))
    path = path_along_lines(points, 0.01)
    lengths = np.abs(np.diff(points, axis=0)).max(axis=1)
    q = path.curve.rates(sample(path), 0)[0]
    # The distance of each sample from the nearest line, in the Euclidean norm: at most that from the corner.
    off = np.full(len(q), np.inf)
    for start, end in pairwise(points):
        share = ((q - start) @ (end - start) / ((end - start) @ (end - start))).clip(0, 1)
        off = np.minimum(off, np.linalg.norm(q - start - share[:, None] * (end - start), axis=1))
    assert off.max() < 0.01 * 2
    assert 0.2 < np.mean(off < 1e-12) < 1
    # q(P, -u) along one line mirrors q(P, u) along the other: of each blend both ends are as far from the corner.
    blends = [i for i in range(len(path.curve.x) - 1) if np.linalg.matrix_rank(path.curve.c[:-1, i], tol=1e-9) > 1]
    ends = path.curve.rates(path.curve.x, 0)[0]
    assert len(blends) == 3
    for i, corner in zip(blends, points[1:-1], strict=True):
        before, after = (np.abs(ends[j] - corner).max() for j in (i, i + 1))
        assert before == pytest.approx(after, rel=1e-9)
        assert before < lengths.max() / 2


@pytest.mark.parametrize("tolerance", [1e-5, 1e-3, 0.05, 2.0])
@pytest.mark.parametrize("seed", range(10))
def test_rounded_corners_have_four_continuous_derivatives(seed, tolerance):
    """Blends that fill half of a line meet; small corners beside long lines take more of the parameter."""
    rng = np.random.default_rng(seed)
    points = np.cumsum(rng.uniform(-1, 1, (6, 3)) * 10 ** rng.uniform(-2, 0, (6, 1)), axis=0)
    motion = Motion.waypoints(points, 2.0, tolerance=tolerance)
    assert motion.breaks_to(4) == ()
    curve = path_along_lines(points, tolerance).curve
    whole = curve.rates(np.linspace(curve.start, curve.stop, 50_001), 4)
    before, after = curve.rates(curve.x[1:-1], 4, left=True), curve.rates(curve.x[1:-1], 4)
    for left, right, rate in zip(before, after, whole, strict=True):
        assert np.abs(left - right).max() <= 1e-8 * np.abs(rate).max()


def test_the_path_never_stops_along_a_line_or_in_a_corner():
    """The parameter has a speed everywhere, and the smallest corner takes a share of it."""
    for tolerance in (1e-9, 1e-6, 1e-3, 0.1):
        path = path_along_lines(np.random.default_rng(3).uniform(-1, 1, (6, 4)), tolerance)
        speeds = np.abs(path.curve.rates(sample(path), 1)[1]).max(axis=1)
        assert speeds.min() > min(1e-3, 10 * tolerance)
        assert np.diff(path.curve.x).min() > 0.9 * MIN_CORNER_SHARE * np.ptp(path.curve.x)


@pytest.mark.parametrize(("size", "slower"), [(0.9 * SMALL_CORNER, True), (1.1 * SMALL_CORNER, False)])
def test_small_corners_take_more_of_the_parameter(size, slower):
    points = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]])
    path = path_along_lines(points, size * 35 / 256)
    assert (np.ptp(path.curve.x) > 2 * (1 + 1e-6)) == slower


def test_points_stay_within_their_hull_along_lines():
    points = np.random.default_rng(4).uniform(-1, 1, (7, 5))
    q = Motion.waypoints(points, 1.0, tolerance=0.2)(np.linspace(0, 1, 20_001), 0)[0]
    assert (q <= points.max(axis=0) + 1e-14).all()
    assert (q >= points.min(axis=0) - 1e-14).all()


# The motion from rest to rest.
MOTIONS = {
    "smooth": Motion.waypoints(CASE, 2.5),
    "lines": Motion.waypoints(CASE, 2.5, tolerance=0.02),
    "straight": Motion.waypoints(CASE[:2], 2.5),
}


@pytest.mark.parametrize("motion", MOTIONS.values(), ids=MOTIONS)
def test_rates_are_derivatives_of_the_position(motion):
    t = np.linspace(0.1, 2.4, 701)
    rates = motion(t, 4)
    for k in range(4):
        found = differentiate(lambda t, k=k: motion(t, k)[k], t, 2e-5)
        assert np.abs(found - rates[k + 1]).max() < 2e-6 * np.abs(rates[k + 1]).max()


@pytest.mark.parametrize("motion", MOTIONS.values(), ids=MOTIONS)
def test_a_motion_along_points_rests_at_both_ends(motion):
    ends = motion([0.0, 2.5], 4)
    inside = motion(np.linspace(0, 2.5, 501), 4)
    for rate, of_all in zip(ends[1:], inside[1:], strict=True):
        assert np.abs(rate).max() <= 1e-12 * np.abs(of_all).max()
    assert (motion.start, motion.stop, motion.breaks) == (0.0, 2.5, ())


def test_the_time_law_is_a_polynomial_of_degree_nine():
    """The Bernstein polynomial whose first five coefficients are 0 and whose last five are 1."""
    law = BPoly(np.repeat([0.0, 1.0], 5)[:, None], [0, 2.5])
    t = np.linspace(0, 2.5, 501)
    q = MOTIONS["straight"](t, 0)[0]
    assert np.abs(q - CASE[0] - np.outer(law(t), CASE[1] - CASE[0])).max() < 1e-14


def test_the_time_of_a_jump_is_that_of_its_point():
    """Only q5d jumps, at the points."""
    jumps = MOTIONS["smooth"].breaks_to(5)
    [t] = {jump.t for jump in jumps}
    assert np.abs(MOTIONS["smooth"](t, 0)[0] - CASE[1]).max() < 1e-14
    left, right = (MOTIONS["smooth"](t, 5, side)[5] for side in ("left", "right"))
    assert {jump.joint: jump.jump for jump in jumps} == pytest.approx(dict(enumerate(right - left)), rel=1e-6)


def test_short_motions_have_rows_in_every_piece():
    assert len(Motion.waypoints(CASE, 0.002).times) > 2 * 50
    assert len(Motion.waypoints(CASE, 3.0).times) == 3001


# How points are given.
def test_points_are_matched_by_joint_name():
    names = UR5.joint_names
    shuffled = [names[i] for i in (3, 1, 0, 5, 4, 2)]
    columns = {name: CASE[:, names.index(name)] for name in shuffled}
    rows = [{name: point[names.index(name)] for name in shuffled} for point in CASE]
    t = np.linspace(0, 1, 11)
    expected = UR5.forces_along(Motion.waypoints(CASE, 1.0), t, order=0).forces[0]
    for given in (columns, pd.DataFrame(columns), rows, [rows[0], rows[1], rows[2]]):
        found = UR5.forces_along(Motion.waypoints(given, 1.0), t, order=0).forces[0]
        assert np.abs(found - expected).max() < 1e-10
    stated = Motion.waypoints(rows, 1.0, joint_names=names)
    assert stated.joint_names == names


def test_balls_turn_the_short_way_between_points():
    """The signs and lengths of quaternions are free: with any of them the path is the same."""
    robot = named_robot().with_limits(velocity=2.0, acceleration=10.0)
    rng = np.random.default_rng(0)
    points = rng.normal(size=(3, robot.nq))
    for joint in positions.list_multiscrew_joints(robot.mechanism):
        points[:, joint.turn] /= np.linalg.norm(points[:, joint.turn], axis=1)[:, None]
    ball = positions.list_multiscrew_joints(robot.mechanism)[0].turn
    flipped = points.copy()
    flipped[1, ball] *= -3.0
    first, second = (take_points(robot.mechanism, x, 2.0) for x in (points, flipped))
    t = np.linspace(0, 2, 101)
    assert np.abs(first(t, 4)[4] - second(t, 4)[4]).max() < 1e-9 * np.abs(first(t, 4)[4]).max()
    Q = second(t, 0)[0][:, ball]
    assert (np.linalg.norm(Q, axis=1) > 0.5).all()


REFUSED = {
    "one point": (lambda: Motion.waypoints([[0.0, 1.0]], 1.0), ["points: 1 point; expected at least two different"]),
    "equal points": (lambda: Motion.waypoints([[0.5]] * 3, 1.0), ["points: 3 equal points; expected at least two"]),
    "no points": (lambda: Motion.waypoints(np.zeros((0, 2)), 1.0), ["points: 0 points; expected at least two"]),
    "NaN": (lambda: Motion.waypoints([[0, 0], [np.nan, 1]], 1.0), ["points holds nan; expected finite numbers"]),
    "no rows": (lambda: Motion.waypoints([0.0, 1.0], 1.0), ["points is [0.0, 1.0]; expected an array (N, n)"]),
    "uneven rows": (lambda: Motion.waypoints([[0.0], [1.0, 2.0]], 1.0), ["points is not an array of numbers"]),
    "duration": (lambda: Motion.waypoints(CASE, 0.0), ["duration is 0.0; expected a number of seconds > 0"]),
    "no duration": (lambda: Motion.waypoints(CASE, None), ["duration is None; expected a number of seconds > 0"]),
    "tolerance 0": (lambda: Motion.waypoints(CASE, 1.0, tolerance=0), ["tolerance is 0; expected a distance > 0"]),
    "no corner": (
        lambda: Motion.waypoints(CASE[:2], 1.0, tolerance=0.1),
        ["tolerance rounds the corners between straight lines, and the 2 points lie on one line", "leave it out"],
    ),
    "straight": (lambda: Motion.waypoints([[0.0, 0], [1, 2], [2, 4]], 1.0, tolerance=0.1), ["the 3 points lie on one"]),
    "names of some": (lambda: Motion.waypoints([[0.0], {"a": 1.0}], 1.0), ["some points name their joints"]),
    "other names": (lambda: Motion.waypoints([{"a": 0.0}, {"b": 1.0}], 1.0), ["point 1 from 0: missing 'a'"]),
    "names": (lambda: Motion.waypoints(CASE, 1.0, joint_names=["a"]), ["joint_names is ['a']; expected 6 different"]),
}


@pytest.mark.parametrize(("call", "words"), REFUSED.values(), ids=REFUSED)
def test_points_without_a_path_are_refused(call, words):
    refusal(call, *words)
