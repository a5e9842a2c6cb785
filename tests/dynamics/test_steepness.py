"""How fast errors grow along known inertias, which calls are checked for it, and what refuses their results."""

from dataclasses import replace

import jax
import numpy as np
import pytest

import jounce
from jounce import UncertainError
from jounce.dynamics.computation import Computation
from jounce.engine import certain_digits
from jounce.engine.certain_digits import (
    Doubt,
    check_digits,
    displace_inputs,
    drive_growth,
    is_steep,
    least_inertias,
    plant_growth,
)
from jounce.model.drive_trains import AMOUNTS, UNDRIVEN, Drives
from jounce.model.elasticity import Elasticity
from jounce.model.springs import CubicSpring
from jounce.spatial.lie import Ad, exp
from support.linkages import fourbar, shift
from support.robots import random_inertia, random_pose, random_screw
from support.several_screws import screw_robot

EPS = 2.0**-52
SLIDE, TURN = [0, 0, 0, 1, 0, 0], [0, 0, 1, 0, 0, 0]
STATE = Computation("forward_dynamics", 0)


def chain(screw, inertias, G=None, **drives):
    """Bodies on top of each other along one screw, with drives, all of which act; inertias are kg or kg m^2."""
    M = [np.diag([x] * 6) for x in inertias]
    B, parent = [np.eye(4)] * len(M), [*range(-1, len(M) - 1)]
    return mechanism_with_drives(jounce.Robot.from_screws(B, [screw] * len(M), M, parent, G=G).mechanism, **drives)


def mechanism_with_drives(m, **drives):
    """A mechanism with drives, all of which act."""
    table = {name: np.broadcast_to(drives.get(name, x), len(m.joints)) * 1.0 for name, x in UNDRIVEN.items()}
    return replace(m, drives=Drives(**table), acting=tuple(term for term, name in AMOUNTS.items() if name in drives))


ALONE = {  # of a body of 4 kg
    "none": ({}, 0),
    "of no size": ({"damping": 0.0, "stiffness": 0.0}, 0),
    "damping": ({"damping": 6.0}, 6 / 4),
    "friction": ({"friction": 3.0, "eps": 0.5}, 3 / 0.5 / 4),
    "stribeck": ({"stribeck": 3.0, "eps": 0.5, "stribeck_velocity": 0.125}, 3 * (2 + 8) / 4),
    "spring": ({"stiffness": 36.0, "rest": 7.0}, 3),
    "spring that pushes": ({"stiffness": -36.0}, 3),
    "armature": ({"armature": 2.0, "damping": 12.0}, 12 / (4 + 2)),
    "offset": ({"offset": 5.0}, 0),
    "load friction": ({"load_friction": 0.1}, np.inf),
    "all": ({"damping": 6.0, "friction": 3.0, "eps": 0.5, "stribeck": 1.0, "stribeck_velocity": 0.5, "stiffness": 36.0},
            (6 + 6 + 4) / 4 + 3),
}  # fmt: skip


@pytest.mark.parametrize("screw", [SLIDE, TURN], ids=["slides", "turns"])
@pytest.mark.parametrize(("drives", "growth"), ALONE.values(), ids=ALONE)
def test_the_growth_of_a_body_alone(screw, drives, growth):
    m = chain(screw, [4.0], **drives)
    assert drive_growth(m) == pytest.approx(growth, rel=1e-12)
    assert drive_growth(replace(m, acting=())) == 0


@pytest.mark.parametrize("screw", [SLIDE, TURN], ids=["slides", "turns"])
def test_bodies_along_one_screw_resist_by_their_parallel_sum(screw):
    """Halved, as it might be less between the positions that are looked at."""
    m = chain(screw, [4.0, 12.0, 1.0], damping=[8.0, 6.0, 0.0], armature=[0.0, 0.0, 7.0])
    J = [4, 4 * 12 / 16 / 2, 12 * 1 / 13 / 2]
    np.testing.assert_allclose(least_inertias(m), np.add(J, [0, 0, 7]), rtol=1e-12)
    np.testing.assert_allclose(least_inertias(replace(m, acting=("damping",))), J, rtol=1e-12)
    assert drive_growth(m) == pytest.approx(8 / J[0] + 6 / J[1], rel=1e-12)
    assert drive_growth(chain(screw, [4.0, 12.0], stiffness=[0.0, 6.0])) == pytest.approx(2.0, rel=1e-12)


def test_least_inertias_are_those_of_eight_positions_halved():
    """Of any two bodies: the screw on the sum of their mobilities, whose inverse it is."""
    rng = np.random.default_rng(0)
    for kind in ("revolute", "helical", "prismatic"):
        B, X = [random_pose(rng) for _ in "ab"], [random_screw(rng, kind) for _ in "ab"]
        M = [random_inertia(rng, x) for x in (2.0, 0.5)]
        found, J = least_inertias(jounce.Robot.from_screws(B, X, M).mechanism), []
        for phi in np.arange(8) * np.pi / 4:
            A = Ad(B[1] @ exp(X[1], np.full((1, 1), phi)))
            J.append(X[1] @ np.linalg.solve(np.linalg.inv(M[1]) + np.linalg.inv(A.T @ M[0] @ A), X[1]))
        np.testing.assert_allclose(found, [X[0] @ M[0] @ X[0], min(J) / 2], rtol=1e-9)


def test_balls_on_the_ground_resist_by_their_least_inertia():
    m = screw_robot("forest").mechanism
    found, tree = least_inertias(m), m.tree
    ball = tree.X[:3] @ tree.M[0] @ tree.X[:3].T
    np.testing.assert_allclose(found[:3], np.linalg.eigvalsh(ball)[0])
    single = [places[0] for places in tree.columns if len(places) == 1]
    assert single
    assert (found[single] > 0).all()
    inner = [j for places, parent in zip(tree.columns, tree.parent, strict=True) if parent >= 0 and len(places) > 1
             for j in places]  # fmt: skip
    assert inner
    assert not found[inner].any()
    assert drive_growth(mechanism_with_drives(m, damping=1.0)) == np.inf


def elastic_mechanism(m, **stated):
    """A mechanism with elastic joints, by coordinate; the smoothing velocity of friction is 1 if not stated."""
    table = {"rotor": 1.0, "viscous": 0.0, "friction": 0.0, "eps": 1.0} | stated
    return replace(m, elasticity=Elasticity(**{name: np.broadcast_to(x, m.n) * 1.0 for name, x in table.items()}))


def test_the_growth_behind_springs():
    """Springs over links, and springs and the slope of friction over rotors; rigid joints add nothing."""
    m = chain(SLIDE, [4.0, 12.0])
    stated = {"rotor": [0.5, 0.25], "viscous": [3.0, 5.0], "friction": [1.0, 2.0], "eps": [0.5, 0.125]}
    links, found = [4, 1.5], elastic_mechanism(m, stiffness=[40.0, 60.0], **stated)
    parts = [40 / links[0] + (40 + 3 + 1 / 0.5) / 0.5, 60 / links[1] + (60 + 5 + 2 / 0.125) / 0.25]
    assert plant_growth(found) == pytest.approx(sum(parts), rel=1e-12)
    assert plant_growth(elastic_mechanism(m, stiffness=[np.inf, 60.0], **stated)) == pytest.approx(parts[1], rel=1e-12)
    assert plant_growth(replace(found, elasticity=replace(found.elasticity, level=1))) == np.inf
    law = (None, CubicSpring(60.0, 1.0))
    assert plant_growth(replace(found, elasticity=replace(found.elasticity, springs=law))) == np.inf
    assert plant_growth(replace(found, elasticity=replace(found.elasticity, springs=(None, None)))) < np.inf


def test_links_resist_at_joints_that_one_coordinate_moves():
    """By the square of their ratios, where several do by the largest."""
    for G, links in (
        ([[3.0, 0.0], [0.0, 1.0]], [4 * 9, 1.5]),
        ([[1.0, 0.0], [2.0, 1.0]], [4, 0]),
        ([[1.0], [2.0]], [max(4, 1.5 * 4)]),
    ):
        geared = elastic_mechanism(chain(SLIDE, [4.0, 12.0], G), stiffness=60.0, rotor=0.25)
        expected = sum(60 / x if x else np.inf for x in links) + len(links) * 60 / 0.25
        assert plant_growth(geared) == pytest.approx(expected, rel=1e-12)


def test_loops_have_the_links_of_their_independent_coordinates():
    robot = fourbar(1.0, 0.4, 1.1, 0.7, [1.0, -0.8, 1.3])
    crank = least_inertias(robot.mechanism)[0]
    assert plant_growth(robot.elastic(60.0, rotor=0.25).mechanism) == pytest.approx(60 / crank + 240, rel=1e-12)


STEEP = 1e-6 / (1e3 * EPS)  # a thousandth of the largest error over that of rounding


@pytest.mark.parametrize(("share", "steep"), [(1 - 1e-9, False), (1 + 1e-9, True)])
@pytest.mark.parametrize("order", range(4))
def test_calls_are_checked_from_a_growth_on(order, share, steep):
    """The power of the growth for each rate, and one more for accelerations."""
    growth = (share * STEEP) ** (1 / (order + 1))
    m = chain(SLIDE, [4.0], damping=4 * growth)
    assert is_steep(m, Computation("forward_dynamics", order)) == steep
    assert not is_steep(m, Computation("inverse_dynamics", order))


def test_calls_at_the_growth_itself_are_not_checked():
    m = chain(SLIDE, [4.0], damping=4 * STEEP)
    assert drive_growth(m) == STEEP
    assert not is_steep(m, STATE)


@pytest.mark.parametrize(("share", "steep"), [(1 - 1e-9, False), (1 + 1e-9, True)])
def test_calls_behind_springs_are_checked_from_a_growth_on(share, steep):
    k = share * STEEP / (1 / 4 + 1 / 0.5)
    m = elastic_mechanism(chain(SLIDE, [4.0]), stiffness=[k], rotor=[0.5])
    for name in ("elastic_forward_dynamics", "feedback_linearization"):
        assert is_steep(m, Computation(name, 0)) == steep
    assert not is_steep(m, Computation("forward_dynamics", 0))  # of the links


def test_symbols_are_not_checked():
    casadi = pytest.importorskip("casadi")
    m = elastic_mechanism(chain(SLIDE, [4.0]), stiffness=[1e12], rotor=[0.5])
    assert is_steep(m, Computation("elastic_forward_dynamics", 0))
    symbols = replace(m, elasticity=replace(m.elasticity, stiffness=np.array([casadi.SX.sym("k")], dtype=object)))
    assert not is_steep(symbols, Computation("elastic_forward_dynamics", 0))


def test_inputs_are_moved_by_what_rounding_leaves_open():
    """Rates one after the other by -4, -2, 4, 2 eps of their size; what is no rate of the state stays."""
    m = chain(SLIDE, [4.0, 12.0], damping=1.0)
    given = [np.array([[1.0, -1.0], [0.0, 0.5]])] * 6
    moved = displace_inputs(m, Computation("forward_dynamics", 2), given)  # q, qd, Q, Qd, Q2d
    for k, (x, y) in enumerate(zip(given, moved, strict=True)):
        np.testing.assert_array_equal((y - x) / EPS, [-4, -2, 4, 2, -4, 0][k] * np.abs(x))
    [single] = displace_inputs(m, Computation("forward_dynamics", 2), [np.ones(2, np.float32)])
    np.testing.assert_array_equal(1 - single, np.full(2, 2.0**-21))


def test_positions_are_moved_by_the_size_of_deflections():
    m = chain(SLIDE, [4.0, 12.0], stiffness=1.0, rest=[-3.0, 2.0])
    q, qd = np.array([1.0, -1.0]), np.array([1.0, 1.0])
    for G, more in ((np.eye(2), [3, 2]), (np.array([[0.0, -1.0], [1.0, 2.0]]), [2, 7])):
        moved = displace_inputs(replace(m, G=G), STATE, [q, qd])
        np.testing.assert_array_equal((moved[0] - q) / EPS, -4 * (1 + np.array(more)))
        np.testing.assert_array_equal((moved[1] - qd) / EPS, [-2, -2])
    [moved, _] = displace_inputs(replace(m, acting=("damping",)), STATE, [q, qd])
    np.testing.assert_array_equal((moved - q) / EPS, [-4, -4])


def test_closed_positions_are_moved_by_their_own_size():
    m = mechanism_with_drives(fourbar(1.0, 0.4, 1.1, 0.7, [1.0, -0.8, 1.3]).mechanism, stiffness=1.0, rest=5.0)
    [moved] = displace_inputs(m, STATE, [np.array([1.0])])
    np.testing.assert_array_equal((moved - 1) / EPS, [-4])


def test_accelerations_are_compared_with_more_than_rest():
    """0.1 rad/s^k, or a hundredth of the largest lower rate; in metres by the length of the robot."""
    m, asked = chain(TURN, [4.0, 12.0]), Computation("forward_dynamics", 2)
    arrays = [np.zeros((3, 2)), np.array([[0.0, 0.0], [-30.0, 5.0], [1.0, 2.0]]), *np.zeros((3, 3, 2))]
    results = (np.array([[7.0, 0.0], [0.0, 0.0], [40.0, -800.0]]), np.array([[0.0, -90.0], [np.nan, 0.0], [0.0, 1.0]]),
               np.zeros((3, 2)))  # fmt: skip
    found = certain_digits._least_sizes(m, asked, arrays, results)
    np.testing.assert_allclose(np.concatenate(found, axis=1), [[0.1, 0.1, 0.9], [0.3, 0.3, 0.3], [0.1, 8, 8]])
    tiny = replace(chain(SLIDE, [4.0]), B=shift(0.01)[None])
    for least in certain_digits._least_sizes(tiny, asked, np.zeros((2, 1)), np.zeros((3, 1))):
        assert least == pytest.approx(1e-3)
    B = np.stack([shift(0.25), shift(-3.0)])
    for screw, unit in ((SLIDE, 3.0), (TURN, 1.0)):
        placed = replace(chain(screw, [4.0, 12.0]), B=B)
        [least] = certain_digits._least_sizes(placed, asked, np.zeros((2, 2)), [np.zeros(2)])
        assert least == pytest.approx(0.1 * unit)
    assert certain_digits._least_sizes(m, Computation("mass_matrix", 0), arrays, results) == [0, 0, 0]


def test_arrays_of_jax_in_single_precision_are_compared_in_double():
    """Mixed with others too: rounding to single precision is none of the robot's doing."""
    robot = jounce.Robot(chain(TURN, [4.0, 1e-3], damping=[0.0, 5.0]))
    given = [np.array(x) for x in ([0.3, 0.4], [0.5, 0.25], [1.0, 1.251], [0.25, 0.125])]  # 1.25 N m of them damp
    assert is_steep(robot.mechanism, Computation("forward_dynamics", 1))
    exact = robot.forward_dynamics(*given)
    for places in ((0,), (1, 3), range(4)):
        mixed = [jax.numpy.asarray(x, "float32") if k in places else x for k, x in enumerate(given)]
        for x, y in zip(robot.forward_dynamics(*mixed), exact, strict=True):
            np.testing.assert_allclose(x, y, rtol=1e-2)


def test_results_are_computed_again_where_drives_are_steep():
    """At inputs that are moved; of errors below a millionth of 0.1 rad/s^2 nothing is lost."""
    gentle, steep = (chain(TURN, [4.0], damping=4 * growth) for growth in (4e6, 5e6))
    given, calls = [np.ones(1), np.ones(1), np.ones(1)], []

    def compute(m, factor):
        def run(arrays):
            calls.append(arrays)
            return (factor * (arrays[0] - 1),)

        calls.clear()
        return certain_digits.compute_certain_results(m, STATE, ["q2d"], given, run)

    assert compute(gentle, 1e9) is None
    assert calls == []
    assert compute(steep, 1e8) == (0.0,)  # off by 4 eps, 9e-8
    assert len(calls) == 2
    np.testing.assert_array_equal(np.ravel(calls[1]), np.ravel(displace_inputs(steep, STATE, given)))
    with pytest.raises(UncertainError) as error:
        compute(steep, 1.2e8)
    assert str(error.value).endswith(
        "q2d at q would be off by up to 1.1e-06 of the size, since damping, friction or springs are steep for the"
        " inertia that they move; expected an error below 1e-06; let fewer drive terms act, robot.with_drives([...]),"
        " or state a larger armature or rotor"
    )


def test_traced_calls_are_not_checked():
    robot = jounce.Robot(chain(TURN, [4.0, 1e-3], damping=[0.0, 40.0]))
    q, qd, *rates = (np.array(x) for x in ([0.3, 0.4], [0.5, 0.25], [0.3, 0.7], [0.9, 0.4], [0.6, 0.35]))
    Q = robot.inverse_dynamics(q, qd, *rates)
    with pytest.raises(UncertainError, match="q4d at q would be off by up to"):
        robot.forward_dynamics(q, qd, *Q)
    traced = jax.jit(lambda qd: robot.forward_dynamics(q, qd, *Q))
    assert all(np.isfinite(x).all() for x in traced(jax.numpy.asarray(qd)))


OWN, OTHER = Doubt([], "one cause", "one cure"), Doubt([], "another cause", "another cure")
NAMES = ["q2d", "q3d", "q4d"]
TWO = chain(SLIDE, [4.0, 12.0])


def judged(results, moved, least=(0.0, 0.0, 0.0), name="forward_dynamics", doubts=(OWN,), names=NAMES):
    """The error of results that were asked for, by results at displaced inputs."""
    asked = Computation(name, len(results) - 1 if name == "forward_dynamics" else 0)
    others = list(zip(doubts, moved, strict=True))
    with pytest.raises(UncertainError) as error:
        check_digits(TWO, asked, names, results, least, others)
    return error.value


@pytest.mark.parametrize("least", [1.0, 0.25])
def test_differences_up_to_a_millionth_of_the_size_are_none(least):
    x = np.array([[0.5, -0.25], [0.0, 0.125]])
    size = np.maximum(least, [[0.5], [0.125]])
    zeros = (0 * x,)
    for off in (1e-6 * size * [1, 0], -1e-6 * size * [0.5, 1]):
        assert check_digits(TWO, STATE, ["q2d"], zeros, [size], [(OWN, [zeros, (off,)])]) is None
    beyond = 1e-6 * size * [[0, 1 + 1e-9], [0.5, 0]]
    error = judged(zeros, [[zeros, (beyond,)]], [size], names=["q2d"])
    np.testing.assert_array_equal(error.uncertain[0], [True, False])
    error = judged((x,), [[(x,), (x + 4e-6 * size * [1, 0],)]], [1e-3], names=["q2d"])  # of sizes 0.5 and 0.125
    np.testing.assert_array_equal(error.uncertain[0], [True, True])
    assert check_digits(TWO, STATE, ["q2d"], (x,), [4.1 * size], [(OWN, [(x + 4e-6 * size * [1, 0],)])]) is None


def test_what_is_said_of_results_without_digits():
    x = tuple(np.array([[1.0, -2.0], [4.0, 1.0], [1.0, 8.0]]) for _ in NAMES)
    moved = (x[0], x[1] + [[0, 0], [2e-3, 0], [0, 0]], x[2] + [[0, 0], [0, 4e-3], [0, 0.4]])
    error = judged(x, [[x, moved]])
    words = "q3d, q4d at q of 2 of 3 samples, first 1, would be off by up to 0.05 of the size, since one cause;"
    assert f"{words} expected an error below 1e-06; q2d is certain there: give fewer rates" in str(error)
    assert [x.tolist() for x in error.uncertain] == [[False] * 3, [False, True, False], [False, True, True]]
    for y, z, bad in zip(x, error.results, error.uncertain, strict=True):
        np.testing.assert_array_equal(z, np.where(np.array(bad)[:, None], np.nan, y))
    error = judged(x, [[(x[0], x[1], moved[2])]])
    assert "; q2d, q3d are certain there: give fewer rates" in str(error)
    single = tuple(y[1] for y in x), tuple(y[1] + 1e-3 * (k > 0) for k, y in enumerate(moved))
    assert "q3d, q4d at q would be off" in str(judged(single[0], [[single[1]]]))


def test_causes_are_named_once_and_the_first_is_cured():
    x = (np.array([1.0, -2.0]),)
    off = (x[0] + 1e-3,)
    for moved, causes, cure in (
        ([[off], [off]], "one cause and another cause", "one cure"),
        ([[x], [off]], "another cause", "another cure"),
        ([[off], [x]], "one cause", "one cure"),
    ):
        error = judged(x, moved, doubts=(OWN, OTHER), names=["q2d"])
        assert f"since {causes}; expected an error below 1e-06; {cure}" in str(error)
    both = (x[0], x[0])
    error = judged(both, [[(off[0], off[0])]], (0.0, 0.0), names=["q2d", "q3d"])
    assert "since one cause; expected" in str(error)


def test_results_of_other_kinds_are_no_rates_to_leave_out():
    x = (np.array([1.0, -2.0]),) * 2
    error = judged(x, [[(x[0], x[1] + 1e-3)]], (0.0, 0.0), "elastic_forward_dynamics", names=["q2d", "theta2d"])
    assert str(error).endswith("expected an error below 1e-06; one cure")


def test_missing_results_are_no_loss_of_digits():
    x = (np.array([[np.nan, 1.0], [np.inf, 1.0], [1.0, 1.0]]),)
    moved = (x[0] + [[1, 1], [1, 1], [0, 0]],)
    assert check_digits(TWO, STATE, ["q2d"], x, [0.0], [(OWN, [moved])]) is None
    error = judged((np.ones((2, 2)),), [[(np.array([[np.nan, 1], [1, 1]]),)]], names=["q2d"])
    assert error.uncertain[0].tolist() == [True, False]
    assert "q2d at q of 1 of 2 samples, first 0, would be off" in str(error)
