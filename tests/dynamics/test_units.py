"""Nothing depends on units: robots of other lengths and masses, and robots of very different bodies.

Results in other units are those in SI units times powers of both, of all quantities, methods and kernels. What a mass
matrix says is decided by comparing each joint with what it alone could move: regular ones are solved, as NumPy and 50
digits do, and those that are singular are refused in all units.
"""

from dataclasses import replace

import mpmath
import numpy as np
import pytest

import jounce
from jounce.dynamics import mobility
from jounce.dynamics.base_parameters import base_parameters
from jounce.dynamics.quantities import QUANTITIES
from jounce.dynamics.quantities.row import ELASTIC
from jounce.spatial.inertia import form_error
from support.quantities import IDS, REQUESTS, affordable, branched, rigid, served
from support.random_loops import LOOPED, looped, random_closed
from support.refusals import refusal
from support.robots import floating, on_its_axis, random_mechanism, relative_error, shifted
from support.units import UNIT_IDS, UNITS, Units, coordinate_factors, in_si, in_units, velocity_factors

I4, NOTHING = np.eye(4), np.zeros((6, 6))
X, Y, Z = ([*np.eye(3)[k], 0, 0, 0] for k in range(3))
ALONG_X, ALONG_Z = [0, 0, 0, 1, 0, 0], [0, 0, 0, 0, 0, 1]


def box(mass, size, com=(0.0, 0.0, 0.0)):
    """A body that is about as large in all directions."""
    return jounce.inertia_matrix(mass, com, mass * size**2 / 6 * np.diag([1.0, 1.1, 1.2]))


def station():
    """A station of 4e5 kg with a cross without mass, a link of 50 kg and a finger of 10 g."""
    B = [shifted(20.0), shifted(0.0), shifted(2.0)]
    M = [NOTHING, box(50.0, 1.0, (1.0, 0, 0)), box(0.01, 0.02, (0.03, 0, 0))]
    return jounce.Robot.from_screws(B, [X, Y, Z], M, base=box(4e5, 20.0), name="station")


def gantry():
    """A gantry of 1e4 kg with a universal joint that carries a tool of 1e-9 kg m^2."""
    M = [box(1e4, 3.0), NOTHING, jounce.inertia_matrix(1e-3, [0, 0, 0], np.diag([1.0, 1.2, 1.1]) * 1e-9)]
    return jounce.Robot.from_screws([I4, I4, I4], [ALONG_X, Y, X], M, name="gantry")


def small_arm():
    """An arm of a hinge and a slide, a cross without mass between them, of half a micrometre."""
    M = [NOTHING, box(2.0, 5e-8, (2e-7, 0, 0))]
    return jounce.Robot.from_screws([I4, shifted(5e-7)], [Z, ALONG_X], M, name="small arm")


def heavy_gripper():
    """A wrist without mass that moves a gripper of grams at the end of a crane of tons: two that follow each other."""
    M = [box(5e4, 10.0, (5.0, 0, 0)), NOTHING, box(1e-3, 1e-2, (1e-3, 0, 0)), box(1e-3, 1e-2, (0, 1e-3, 0))]
    G = [[1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0, -1]]
    return jounce.Robot.from_screws([I4, shifted(10.0), I4, I4], [Z, X, Y, Y], M, [-1, 0, 1, 1], G=G, name="crane")


UNEVEN = {"station": station, "gantry": gantry, "small arm": small_arm, "crane": heavy_gripper}


def precise_solution(M, b):
    """x of M x = b in 50 digits."""
    with mpmath.workdps(50):
        return np.array([float(x) for x in mpmath.lu_solve(mpmath.matrix(M.tolist()), mpmath.matrix(b.tolist()))])


def state_of(robot, seed=0):
    """q, qd, forces and a base, if it floats; slides go about as far as the robot is large."""
    rng, m = np.random.default_rng(seed), robot.mechanism
    far = np.where(coordinate_factors(m, UNITS[0]) == 1.0, 1.0, 0.5 * (1e-6 if robot.name == "small arm" else 1.0))
    base = (I4, rng.uniform(-1, 1, 6) * 0.1) if m.floats else None
    M = robot.mass_matrix(far * 0.3)
    return far * rng.uniform(0.3, 1, m.n), far * rng.uniform(-1, 1, m.n), np.sqrt(np.diag(M)), base


@pytest.mark.parametrize("method", [None, "kernel", "recursion", "closed_form"])
@pytest.mark.parametrize("robot", UNEVEN)
def test_light_bodies_on_heavy_ones_have_their_accelerations(robot, method, recwarn):
    robot = UNEVEN[robot]()
    assert mobility.may_be_singular(robot.mechanism)  # massless bodies: each state is looked at
    q, qd, Q, base = state_of(robot)
    at_rest = np.zeros(robot.n)
    bias = robot.inverse_dynamics(q, qd, at_rest, base=base and (*base, np.zeros(6)), method="recursion")
    expected = precise_solution(robot.mass_matrix(q, method="recursion"), Q - bias)
    found = robot.forward_dynamics(q, qd, Q, base=base, method=method)
    scale = np.maximum(np.abs(expected), np.abs(precise_solution(robot.mass_matrix(q, method="recursion"), Q)))
    assert (np.abs(found - expected) <= 1e-9 * scale).all()
    assert not recwarn.list


@pytest.mark.parametrize("name", ["forward_dynamics_partials", "forward_dynamics_second_partials"])
@pytest.mark.parametrize("robot", UNEVEN)
def test_partials_of_light_bodies_on_heavy_ones_are_finite(robot, name, recwarn):
    robot = UNEVEN[robot]()
    q, qd, Q, base = state_of(robot)
    found = getattr(robot, name)(q, qd, Q, base=base, method="recursion")
    assert all(np.isfinite(x).all() for x in found)
    if name == "forward_dynamics_partials":
        M = robot.mass_matrix(q, method="recursion")
        inverse = np.stack([precise_solution(M, e) for e in np.eye(len(M))], axis=1)
        scale = np.sqrt(np.multiply.outer(np.diag(inverse), np.diag(inverse)))
        assert (np.abs(found[2] - inverse) <= 1e-9 * scale).all()
    assert not recwarn.list


@pytest.mark.parametrize("robot", ["gantry", "small arm"])
def test_light_bodies_behind_springs_have_their_accelerations(robot, recwarn):
    """q2d = M^-1 (K (theta - q) - bias), where theta rests and rotors weigh what springs leave open."""
    rigid_robot = UNEVEN[robot]()
    q, qd, Q, _ = state_of(rigid_robot)
    M = rigid_robot.mass_matrix(q, method="recursion")
    K, rotor = 1e3 * np.diag(M), 0.1 * np.diag(M)
    robot = rigid_robot.elastic(K, rotor=rotor)
    theta = q + Q / K
    q2d, theta2d = robot.elastic_forward_dynamics(q, qd, theta, qd, 0 * q)
    bias = rigid_robot.inverse_dynamics(q, qd, 0 * q, method="recursion")
    expected = precise_solution(M, K * (theta - q) - bias)
    np.testing.assert_allclose(q2d, expected, rtol=1e-7)
    np.testing.assert_allclose(theta2d, -K * (theta - q) / rotor, rtol=1e-7)
    assert not recwarn.list


def reachable_singularity(mass, u):
    """A slide that carries a point mass across the axis of a hinge: at q2 = 0 the hinge moves nothing."""
    M = [NOTHING, jounce.inertia_matrix(mass, [0, 0, 0], np.zeros((3, 3)))]
    robot = jounce.Robot.from_screws([I4, shifted(1.0)], [Z, ALONG_X], M, name="trolley")
    return jounce.Robot(in_units(robot.mechanism, u))


@pytest.mark.parametrize("u", UNITS, ids=UNIT_IDS)
@pytest.mark.parametrize(("distance", "singular"), [(0.0, True), (1e-7, True), (1e-5, False), (1.0, False)])
def test_a_hinge_is_compared_with_what_it_could_move(u, distance, singular):
    """A millionth of the largest lever moves 1e-12 of the largest inertia: on both sides of `MASS_RANK_TOLERANCE`."""
    robot = reachable_singularity(3.0, u)
    q = np.array([0.3, (distance - 1.0) * u.length])
    M = robot.mass_matrix(q)
    assert mobility.is_singular(robot.mechanism, q, M) == singular
    with np.errstate(all="ignore"):
        found = robot.forward_dynamics(q, 0 * q, np.diag(M))
    assert np.isfinite(found).all() != singular


@pytest.mark.parametrize(("share", "rank"), [(0.3, 1), (3.0, 2)])
@pytest.mark.parametrize("u", UNITS, ids=UNIT_IDS)
def test_ranks_are_decided_by_what_joints_could_move(u, share, rank):
    """Two slides along one line, of which the first moves next to nothing of its own."""
    light = share * mobility.MASS_RANK_TOLERANCE
    robot = jounce.Robot.from_screws([I4, I4], [ALONG_X, ALONG_X], [box(light, 1.0), box(1.0, 1.0)])
    assert mobility.idle_coordinates(in_units(robot.mechanism, u))[0] == rank


@pytest.mark.parametrize(("share", "idle"), [(0.1, True), (10.0, False)])
@pytest.mark.parametrize("u", UNITS, ids=UNIT_IDS)
def test_a_coordinate_is_idle_by_what_it_could_move(u, share, idle):
    """A point mass, off the axis of its hinge by a share of its distance along it."""
    off = share * 0.4 * np.sqrt(mobility.MASS_RANK_TOLERANCE)
    point = jounce.inertia_matrix(2.0, [off, 0, 0.4], np.zeros((3, 3)))
    robot = jounce.Robot.from_screws([I4, I4], [ALONG_X, Z], [box(2e3, 0.1), point])
    assert mobility.find_idle_coordinates(in_units(robot.mechanism, u)).tolist() == [False, idle]


SINGULAR = {
    "a massless tip": (([I4, shifted(0.3)], [Z, Z], [box(2.0, 0.1, (0.2, 0, 0)), NOTHING]), ["joint2"]),
    "a point mass on its axis": (([I4], [Z], [jounce.inertia_matrix(2.0, [0, 0, 0.4], np.zeros((3, 3)))]), ["joint1"]),
    "two hinges about one axis": (([I4, I4], [Z, Z], [NOTHING, box(2.0, 0.3, (0.2, 0, 0))]), ["joint1", "joint2"]),
    "three slides in one plane": (([I4, I4, I4], [ALONG_X, ALONG_Z, ALONG_X], [NOTHING, NOTHING, box(2.0, 0.3)]),
        ["joint1", "joint3"]),
}  # fmt: skip


@pytest.mark.parametrize("u", UNITS, ids=UNIT_IDS)
@pytest.mark.parametrize(("data", "idle"), SINGULAR.values(), ids=SINGULAR)
@pytest.mark.parametrize("floats", [False, True])
def test_singular_mass_matrices_are_refused_in_all_units(u, data, idle, floats):
    mechanism = jounce.Robot.from_screws(*data).mechanism
    mechanism = floating(mechanism, np.random.default_rng(0)) if floats else mechanism
    robot = jounce.Robot(in_units(mechanism, u))
    rank = robot.mechanism.nv - 1
    zero, Q = np.zeros(robot.n), np.zeros(robot.mechanism.nv)
    base = (I4, np.zeros(6)) if floats else None
    refusal(lambda: robot.forward_dynamics(zero, zero, Q, base=base), f"singular, of rank {rank} for", *idle)


@pytest.mark.parametrize("u", UNITS, ids=UNIT_IDS)
@pytest.mark.parametrize("floats", [False, True])
def test_a_regular_mass_matrix_is_regular_in_all_units(u, floats):
    """And bodies that all resist their joints need no look at each state."""
    rng = np.random.default_rng(3)
    m = random_mechanism(rng, [-1, 0, 1, 0], ["revolute", "prismatic", "helical", "revolute"], [1, 2, 3, 1])
    m = in_units(floating(m, rng) if floats else m, u)
    assert mobility.idle_coordinates(m) == (m.nv, ())
    assert not mobility.may_be_singular(m)


def test_a_body_without_inertia_is_looked_at_in_all_units():
    for u in UNITS:
        m = on_its_axis().mechanism
        assert mobility.may_be_singular(in_units(replace(m, M=0 * m.M), u))
        assert not mobility.may_be_singular(in_units(m, u))


def test_very_long_chains_are_regular():
    """Pivots of articulated bodies do not shrink with the inertia that a stretched chain has as one body."""
    n = 3000
    chain = jounce.Robot.from_screws([shifted(0.1)] * n, [Z] * n, [box(1.0, 0.05, (0.05, 0, 0))] * n)
    assert mobility.idle_coordinates(chain.mechanism) == (n, ())


def inputs_in(m, u, quantity, order, floats):
    """Random inputs of a quantity in SI units, and the same in others, each with the motion of the base."""
    rng, count = np.random.default_rng(0), quantity.takes.rates + order
    own, force = coordinate_factors(m, u), u.of(2, 1) / velocity_factors(m, u)
    given, factors = [rng.uniform(-1, 1, m.n) for _ in range(count)], [own] * count
    if quantity.takes.forces:
        given[2:] = [rng.uniform(-1, 1, m.nv) for _ in given[2:]]
        factors[2:] = [force] * (count - 2)
    if quantity.takes.motors[-1:] == ("tau",):
        factors[-1] = force
    other = [x * factor for x, factor in zip(given, factors, strict=True)]
    if not floats:
        return (given, None), (other, None)
    C, *twists = np.eye(4), *rng.uniform(-1, 1, (1 if quantity.takes.forces else count - 1, 6))
    return (given, (C, *twists)), (other, (u.pose(C), *(x * u.twist for x in twists)))


def assert_same_in_units(m, u, name, given, other, **options):
    """Results in other units are those in SI units, all but rounding."""
    results = []
    for mechanism, (arrays, base) in ((m, given), (in_units(m, u), other)):
        moved = {} if base is None else {"base": base}
        results.append(getattr(jounce.Robot(mechanism), name)(*arrays, **moved, **options))
    expected = results[0] if isinstance(results[0], tuple) else (results[0],)
    for x, y in zip(in_si(name, m, u, results[1]), expected, strict=True):
        assert relative_error(x, y) < 1e-9


@pytest.mark.sweep(60)
@pytest.mark.parametrize("u", UNITS, ids=UNIT_IDS)
@pytest.mark.parametrize(("quantity", "keywords"), REQUESTS, ids=IDS)
@pytest.mark.parametrize("floats", [False, True], ids=["fixed", "floats"])
def test_results_in_other_units_are_the_same(quantity, keywords, u, floats):
    """Of every quantity, with rates, by every method of the recursion and of matrices."""
    robot = branched()
    if ELASTIC not in quantity.needs:
        robot = rigid(robot)
    robot, floats = served(robot, quantity), floats and ELASTIC not in quantity.needs
    m = floating(robot.mechanism, np.random.default_rng(0)) if floats else robot.mechanism
    given, other = inputs_in(m, u, quantity, affordable(quantity, 1), floats)
    for method in quantity.laws:
        assert_same_in_units(m, u, quantity.name, given, other, method=method, **keywords)


@pytest.mark.sweep(3)
@pytest.mark.parametrize("u", UNITS[3:], ids=UNIT_IDS[3:])
@pytest.mark.parametrize("name", ["inverse_dynamics", "forward_dynamics", "mass_matrix", "forward_dynamics_partials"])
def test_native_code_in_other_units_gives_the_same(name, u):
    m, quantity = rigid(branched()).mechanism, QUANTITIES[name]
    given, other = inputs_in(m, u, quantity, affordable(quantity, 1), floats=False)
    assert_same_in_units(m, u, name, given, other, method="kernel")


@pytest.mark.parametrize("u", UNITS, ids=UNIT_IDS)
@pytest.mark.parametrize("floats", [False, True])
def test_base_parameters_are_the_same_combinations(u, floats):
    rng = np.random.default_rng(1)
    m = random_mechanism(rng, [-1, 0, 1, 0], ["revolute", "prismatic", "helical", "revolute"], [1, 2, 3, 1], mimic=True)
    m = floating(m, rng) if floats else m
    expected, found = base_parameters(m), base_parameters(in_units(m, u))
    assert found.columns.tolist() == expected.columns.tolist()
    factors = np.tile(u.inertial, m.nb)
    np.testing.assert_allclose(found.matrix / factors[found.columns, None] * factors, expected.matrix, atol=1e-7)


@pytest.mark.sweep(6)
@pytest.mark.parametrize("u", UNITS, ids=UNIT_IDS)
@pytest.mark.parametrize("name", LOOPED)
def test_closed_robots_are_the_same_in_all_units(name, u):
    """Loops close, and forces and accelerations are the same, with all the digits."""
    expected, found = looped(name), random_closed(np.random.default_rng(1), **LOOPED[name], units=u)
    m, rng = expected.mechanism, np.random.default_rng(2)
    tree = coordinate_factors(m.tree, u)
    own, force = tree[list(m.closure.independent)], u.of(2, 1) / velocity_factors(m, u)
    np.testing.assert_allclose(found.mechanism.closure.start / tree, m.closure.start, rtol=1e-9, atol=1e-12)
    q = m.closure.start[list(m.closure.independent)]
    rates = [q, *rng.uniform(-1, 1, (2, m.n))]
    base = (np.eye(4), *np.zeros((2, 6))) if m.floats else None
    Q = expected.inverse_dynamics(*rates, base=base, method="recursion")
    other = found.inverse_dynamics(*(x * own for x in rates), base=base, method="recursion")
    assert relative_error(other / force, Q) < 1e-8
    base = base and base[:2]
    q2d = expected.forward_dynamics(*rates[:2], Q, base=base, method="recursion")
    other = found.forward_dynamics(rates[0] * own, rates[1] * own, Q * force, base=base, method="recursion")
    assert relative_error(other / velocity_factors(m, u), q2d) < 1e-8


@pytest.mark.parametrize("u", [*UNITS, Units(1e-6, 1e-9)], ids=[*UNIT_IDS, "1e-06m-1e-09kg"])
def test_peaks_between_rows_are_found_in_all_units(u):
    """Forces of small robots are far below 1e-7 N m; a check needs their digits nevertheless."""
    m = random_mechanism(np.random.default_rng(4), [-1, 0, 1], ["revolute"] * 3, [3.0, 2.0, 1.0])
    waves = np.zeros((2, 40, 3))
    waves[0, 0], waves[0, -1], waves[1, -2, 0] = 0.3, 1e-3, 2e-3
    motion = replace(jounce.Motion.fourier([0, 0, 0], *waves, 2.0, 4.0), grid=np.linspace(0, 4, 41))
    expected, found = (
        jounce.Robot(mechanism).with_limits(effort=[effort] * 3).check(motion).table
        for mechanism, effort in ((m, 40.0), (in_units(m, u), 40.0 * u.of(2, 1)))
    )
    assert [x.joint for x in found] == [x.joint for x in expected]
    np.testing.assert_allclose([x.ratio for x in found], [x.ratio for x in expected], rtol=1e-9)


@pytest.mark.parametrize("u", UNITS, ids=UNIT_IDS)
@pytest.mark.parametrize(("share", "fits"), [(1e-10, True), (1e-8, False)])
@pytest.mark.parametrize("at", [(0, 1), (0, 5), (1, 5), (3, 4), (4, 4)])
def test_the_form_of_inertias_is_checked_block_by_block(at, share, fits, u):
    """An asymmetric tensor of 1e-12 kg m^2 is as wrong as one of 1 kg m^2, however heavy the body is."""
    M = box(2.0, 0.5, (0.1, -0.2, 0.3))
    M[at] += share * np.sqrt(M[at[0], at[0]] * M[at[1], at[1]])
    assert (form_error(M * (u.wrench[:, None] / u.twist)) is None) == fits
