"""Retiming of random paths: on the path, within limits by an oracle of its own, as fast as toppra; or a true reason."""

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import strategies as st
from scipy.spatial import cKDTree

import jounce
from fuzz import newton_euler
from fuzz.paths import FORCES, RATES, SEPTIC, random_limits, random_path, smooth_from_rest, way_points
from fuzz.trees import random_tree, robot_of_tree
from jounce import JounceError, Motion

# random joints turn as far as they would in degrees
pytestmark = pytest.mark.filterwarnings("ignore:.* would be within limits if they were degrees:jounce.JounceWarning")
DENSE = 501  # times, even ones and those that are even on the path
BETWEEN = 1e-3  # of a limit, by which it may be exceeded between the points that `retime` looks at
SLOWER, FASTER = 0.006, 0.002  # than toppra at most, whose accelerations jump; the grids of both count besides
SAME = 1e-3  # of the duration of what is the same but for rounding: several times the gap of the program
DECIDES = 0.95  # of a limit, by which a stretch must come near to it
PARTS = 4  # of a piece, each integrated by itself: the path may have kinks of higher rates inside
BITTEN = 9  # a seed of a path that is retimed in a moment, with a margin of 1 %
SEEDS = st.integers(0, 2**32 - 1)
LEAVES, HOLDS, MOVES, JUMPS = (
    r"joint '(?P<joint>.+)' leaves its position limits at t = (?P<t>\S+) s",
    r"joint '(?P<joint>.+)' holds (?P<value>\S+) N( m)? at rest at t = (?P<t>\S+) s",
    r"the motion moves at its (start|end|start and end), and no time law",
    r"(?P<rate>q\S*) of joint '(?P<joint>.+)' jumps at t = (?P<t>\S+) s, where",
)
OTHERS = (
    r"the path does not move",
    r"no limit bounds the speed along part of the path",
    r"retiming fails: the paces of the motion differ by too much",
)


def drawn_path(seed):
    """A tree whose joints are the coordinates, as the oracle knows it and as a robot with limits, a path, a margin."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 5))
    tree = replace(random_tree(rng, n), coupling=np.eye(n), offset=np.zeros(n))
    motion = random_path(rng, n)
    robot = random_limits(rng, robot_of_tree(tree), motion)
    return rng, tree, robot, motion, float(rng.choice([0.01, 0.0, rng.uniform(0, 0.3)]))


def limit_shares(tree, robot, motion, t, side="right"):
    """Every limited quantity as a share of its bound (N, n), by kind: forces by the laws of Newton and Euler."""
    rates = motion(t, 4, side)
    whole, weightless = (newton_euler.forces(of, rates)[0] for of in (tree, replace(tree, gravity=np.zeros(3))))
    values = dict(zip(RATES, rates[1:], strict=True)) | {"power": whole[0] * rates[1]}
    for k, kind in enumerate(FORCES):
        values[kind] = (weightless if kind in robot.limits.without_gravity else whole)[k]
    found = {}
    for kind in set(robot.limits.kinds) - {"position"}:
        lower, upper = robot.limits.bounds(kind)
        value = values[kind].astype(float)
        found[kind] = np.where(value == 0, 0, value / np.where(value > 0, upper, lower))
    return found


def largest_share(found):
    return max(share.max() for share in found.values())


def is_true(message, tree, robot, motion, margin):
    """Whether the reason for which a path is refused is a true one."""
    names, dense = robot.joint_names, np.linspace(motion.start, motion.stop, 8001)
    if found := re.match(LEAVES, message):
        j, q = names.index(found["joint"]), motion(dense, 0)[0]
        return q[:, j].min() < robot.limits.lower[j] or q[:, j].max() > robot.limits.upper[j]
    if found := re.match(HOLDS, message):
        still = [motion(np.array([float(found["t"])]), 0)[0]] + 2 * [np.zeros((1, robot.n))]
        j, value = names.index(found["joint"]), newton_euler.forces(tree, still)[0][0, 0]
        lower, upper = robot.limits.bounds("effort")[:, j] * (1 - margin)
        return not lower * (1 - 1e-6) < value[j] < upper * (1 - 1e-6)
    if re.match(MOVES, message):
        ends = np.array([motion.start, motion.stop])
        speeds = np.abs(motion(ends, 1, "left")[1]).max()
        return speeds > 0 and largest_share(limit_shares(tree, robot, motion, dense[::20])) > 0.99 * (1 - margin)
    if found := re.match(JUMPS, message):
        order = 0 if found["rate"] == "q" else int(re.sub(r"\D", "", found["rate"]) or 1)
        return any(b.order == order and np.isclose(b.t, float(found["t"]), rtol=1e-4) for b in motion.breaks_to(order))
    return any(re.match(reason, message) for reason in OTHERS)


def on_path(found, motion, t):
    """That one path is the other one, from its start to its end: no point of either is far from points of the other."""
    fine = [part(np.linspace(part.start, part.stop, 10 * DENSE + 1), 0)[0] for part in (motion, found)]
    size = np.ptp(fine[0], axis=0).max() + 1e-12 * np.abs(fine[0]).max()
    for path, points in (fine, (fine[1], fine[0])):
        apart = cKDTree(path).query(points[::10])[0]
        chord = np.linalg.norm(np.diff(path, axis=0), axis=1).max()
        assert apart.max() <= chord + 1e-9 * size, f"{apart.max() / size:.1e} of the path off it"
    for end, of in ((found.start, motion.start), (found.stop, motion.stop)):
        assert np.abs(found(end, 0, "left")[0] - motion(of, 0, "left")[0]).max() <= 1e-9 * size
    sigma = found.curve.law.sigma(t)
    assert (np.diff(sigma) >= 0).all()
    assert np.abs(found(t, 0)[0] - motion(sigma, 0)[0]).max() <= 1e-9 * size


def derivatives(rng, motion, rate):
    """That each rate is the derivative of the one before: by its integral over some pieces in which all are smooth."""
    law = motion.curve.law
    knots = law.times(np.unique(law.x.t)).clip(motion.start, motion.stop)
    edges = np.unique([*knots, *(found.t for found in motion.breaks_to(rate + 2))])
    first = rng.integers(len(edges) - 1, size=30)
    (start, stop), (u, w) = (edges[first], edges[first + 1]), np.polynomial.legendre.leggauss(12)
    ends = np.linspace(start, stop, PARTS + 1, axis=1)
    half = np.diff(ends)[..., None] / 2
    t = ends[:, :-1, None] + half * (1 + u)
    inside = [x.reshape(*t.shape, -1) for x in motion(t.ravel(), rate)]
    for k, (a, b) in enumerate(zip(motion(start, rate)[:-1], motion(stop, rate, "left")[:-1], strict=True)):
        rise = (half[..., None] * w[:, None] * inside[k + 1]).sum(axis=(1, 2))
        rounding = np.spacing(np.abs(edges).max()) * np.abs(inside[k + 1]).max()
        assert np.abs(rise - (b - a)).max() < 1e-5 * np.abs(inside[k]).max() + 10 * rounding, f"rate {k + 1}"


def rests(found, motion):
    """At rest where the given motion is; otherwise as fast as it, but for the rounding of rates."""
    whole = np.abs(found(np.linspace(found.start, found.stop, DENSE), 1)[1]).max()
    for end, of in ((found.start, motion.start), (found.stop, motion.stop)):
        here, there = found(end, 1, "left")[1], motion(of, 1, "left")[1]
        if np.abs(there).max() > 1e-6 * np.abs(motion(np.linspace(motion.start, motion.stop, 101), 1)[1]).max():
            assert np.abs(here - there).max() < 1e-6 * whole + 1e-6 * np.abs(there).max()
        else:
            assert np.abs(here).max() < 1e-4 * whole


def check_limits(seed):
    rng, tree, robot, motion, margin = drawn_path(seed)
    try:
        result = robot.retime(motion, margin)
    except JounceError as error:
        result, message = None, str(error)
    if result is None:
        assert is_true(message, tree, robot, motion, margin), message
        return
    found, law = result.motion, result.law
    even = law.times(np.linspace(motion.start, motion.stop, DENSE)).clip(found.start, found.stop)
    t = np.unique([*np.linspace(found.start, found.stop, DENSE), *even])
    assert result.duration == found.duration == found.stop - found.start > 0
    assert found.start == motion.start
    on_path(found, motion, t)
    derivatives(rng, found, min(4, found.highest))
    rests(found, motion)
    dense = limit_shares(tree, robot, found, t)
    assert largest_share(dense) <= (1 - margin) * (1 + BETWEEN)
    checked = [row for row in robot.check(found).table if row.limit != "position"]
    worst = max(row.ratio for row in checked)
    assert largest_share(dense) * (1 - 1e-5) <= worst <= (1 - margin) * (1 + BETWEEN)
    assert worst >= DECIDES * (1 - margin)
    for row in checked:
        assert dense[row.limit][:, robot.joint_names.index(row.joint)].max() <= row.ratio + 1e-5
    for stretch in result.binding:
        inside = np.linspace(stretch.start, stretch.stop, 21)[1:-1]
        near = limit_shares(tree, robot, found, inside)[stretch.limit][:, robot.joint_names.index(stretch.joint)]
        assert near.max() > DECIDES * (1 - margin), stretch


def test_paths_and_limits(budget):
    budget.attack(check_limits, 2, seed=SEEDS)


def test_the_oracle_sees_a_hundredth(monkeypatch):
    """Of all limits, which a retiming takes for larger than they are."""
    true = jounce.Robot.retime
    monkeypatch.setattr(jounce.Robot, "retime", lambda robot, motion, margin: true(robot, motion, margin - 0.01))
    with pytest.raises(AssertionError):
        check_limits(BITTEN)


def from_rest(rng, n):
    """A spline through way points, from rest to rest."""
    while True:
        try:
            return smooth_from_rest(rng, way_points(rng, n))
        except JounceError:
            continue


def check_scales(seed):
    """k-fold speeds under limits k, k^2, ... times as large; the same speeds backwards, and from another given pace."""
    rng, tree, robot, _, _ = drawn_path(seed)
    tree = replace(tree, gravity=np.zeros(3))
    motion = from_rest(rng, robot.n)
    limits, powers = random_limits(rng, robot_of_tree(tree), motion).limits, {"power": 3}
    powers |= {kind: k for kinds, k in ((RATES, 1), (FORCES, 2)) for k, kind in enumerate(kinds, start=k)}
    bounds = {kind: limits.bounds(kind)[1] for kind in limits.kinds if kind != "position"}
    plain, k, (t, q) = robot_of_tree(tree).with_limits(**bounds), 10 ** rng.uniform(-1.5, 1.5), motion.samples
    fast = plain.with_limits(**{kind: x * k ** powers[kind] for kind, x in bounds.items()})
    other = motion.scaled(10 ** rng.uniform(-3, 3)).shifted(rng.uniform(-100, 100))
    again = [(fast, motion, k), (plain, Motion.through(t, q[::-1]), 1), (plain, other, 1)][rng.integers(3)]
    duration, then = (one.retime(path).duration * times for one, path, times in ((plain, motion, 1), again))
    assert then == pytest.approx(duration, rel=SAME)


def test_scales_and_directions(budget):
    budget.attack(check_scales, 1, seed=SEEDS)


def toppra(robot, geometry, points):
    """The duration that toppra finds along a curve, at rest at its ends, under velocity, acceleration and effort."""
    import toppra as ta
    from toppra import algorithm, constraint

    ta.setup_logging("ERROR")
    u = np.linspace(geometry.start, geometry.stop, points)
    path = ta.SplineInterpolator(u, geometry(u, 0)[0])
    scheme = {"discretization_scheme": constraint.DiscretizationType.Interpolation}
    velocity, acceleration, effort = (robot.limits.bounds(kind).T for kind in ("velocity", "acceleration", "effort"))
    solver = algorithm.TOPPRA(
        [
            constraint.JointVelocityConstraint(velocity),
            constraint.JointAccelerationConstraint(acceleration, **scheme),
            constraint.JointTorqueConstraint(robot.inverse_dynamics, effort, np.zeros(robot.n), **scheme),
        ],
        path,
        gridpoints=u,
        solver_wrapper="seidel",
    )
    found = solver.compute_trajectory(0, 0)
    return None if found is None else float(found.duration)


def check_toppra(seed):
    rng = np.random.default_rng(seed)
    robot = robot_of_tree(replace(random_tree(rng, 3), coupling=np.eye(3), offset=np.zeros(3)))
    points = rng.uniform(-1, 1, (int(rng.integers(8, 15)), 3))
    geometry = Motion.through(np.cumsum(rng.uniform(0.7, 1, len(points))), points)
    u = np.polyval(SEPTIC, np.linspace(0, 1, 401))
    motion = Motion.through(np.linspace(0, 2, len(u)), geometry(geometry.start + u * geometry.duration, 0)[0])
    t = np.linspace(motion.start, motion.stop, 501)
    along = robot.forces_along(motion, t, 0)
    peaks = [np.abs(x).max(axis=0) for x in (*along.rates[1:3], along.forces[0])]
    weight = np.abs(robot.gravity_forces(along.rates[0])).max(axis=0)
    size = rng.uniform(0.3, 3, (3, 3))
    robot = robot.with_limits(
        velocity=peaks[0] * size[0], acceleration=peaks[1] * size[1], effort=1.2 * weight + peaks[2] * size[2] + 1e-9
    )
    coarse, fine = (toppra(robot, geometry, count) for count in (1001, 2001))
    found = robot.retime(motion, margin=0).duration
    off = 3 * abs(coarse / fine - 1)
    assert 1 - FASTER - off < found / fine < 1 + SLOWER + off


def test_as_fast_as_toppra(budget):
    pytest.importorskip("toppra")
    budget.attack(check_toppra, 1, seed=SEEDS)
