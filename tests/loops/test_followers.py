"""Coordinates of closed robots that follow by constant ratios: parallelograms, which have no singular position then."""

import numpy as np
import pytest

import jounce
from jounce.dynamics.loop_branches import with_solved_loops, without_ratios
from jounce.engine import generic_methods
from jounce.engine.plan import compute
from support.linkages import fourbar, palletizer, rods
from support.refusals import expect_refusal, refusal
from support.robots import relative_error

QUANTITIES = (
    "inverse_dynamics",
    "mass_matrix",
    "coriolis_matrix",
    "skew_coriolis_matrix",
    "gravity_forces",
    "coordinates",
    "jacobian",
    "twists",
    "regressor",
    "inverse_dynamics_partials",
    "forward_dynamics",
    "actuator_forces",
    "loop_wrenches",
)


def parallelogram(crank=0.5, coupler=1.0, start=0.7):
    return fourbar(coupler, crank, coupler, crank, [start, -start, start])


@pytest.mark.parametrize("lengths", [(0.5, 1.0), (0.513, 0.977)])  # the latter are rounded
@pytest.mark.parametrize("q", [0.0, 2e-4, 1e-9, 1.3, np.pi, -2.0])
def test_forces_of_a_parallelogram_are_those_of_a_pendulum(lengths, q):
    """Q = I q2d + g cos q, near and at change points, where the loop itself determines nothing."""
    crank, robot = lengths[0], parallelogram(*lengths)
    inertia, g = crank**2 * 5 / 3, 9.81 * crank * 2  # two cranks of 1 kg about their ends, and the coupler
    qd, q2d, q3d, q4d = 0.5, 0.2, -0.3, 0.7
    expected = (
        inertia * q2d + g * np.cos(q),
        inertia * q3d - g * np.sin(q) * qd,
        inertia * q4d - g * (np.cos(q) * qd**2 + np.sin(q) * q2d),
    )
    for method in (None, "recursion", "closed_form"):
        found = robot.inverse_dynamics([q], [qd], [q2d], [q3d], [q4d], method=method)
        for x, y in zip(found, expected, strict=True):
            np.testing.assert_allclose(x, [y], rtol=1e-13, atol=1e-13)


@pytest.mark.sweep(4)
@pytest.mark.parametrize("name", QUANTITIES)
def test_quantities_are_those_of_constraints_that_are_solved(name):
    """Of a robot with one loop of each kind."""
    robot, rng = palletizer(), np.random.default_rng(0)
    m = robot.mechanism
    assert (m.closure.ratios.places, m.closure.solved, len(with_solved_loops(m).loops)) == ((1, 2), (3, 4), 1)
    solved = jounce.Robot(without_ratios(m))
    q = robot.coordinates(rng.uniform(0.5, 1.0, (4, 1)))
    np.testing.assert_allclose(q[:, 1:3], q[:, :1] * [-1, 1], atol=1e-15)
    rates = rng.normal(size=(4, 4, 1))
    for method in (None, "recursion"):
        both = [generic_methods.as_tuple(compute(x, name, (q, *rates[:3]), method=method)) for x in (robot, solved)]
        for x, y in zip(*both, strict=True):
            assert relative_error(x, y) < 1e-10


def test_motions_cross_change_points():
    robot = parallelogram()
    motion = jounce.Motion.polynomial([[0.7, -2.0]], 1.0)
    along = robot.forces_along(motion, np.linspace(0, 1, 41), order=2)
    expected = 9.81 * np.cos(0.7 - 2 * along.t)
    np.testing.assert_allclose(along.forces[0][:, 0], expected, atol=1e-12)
    np.testing.assert_allclose(along.forces[2][:, 0], -4 * expected, atol=1e-11)


def test_products_of_derivatives_know_followers():
    kernel = palletizer().compile("inverse_dynamics", order=1)
    robot, rng = palletizer(), np.random.default_rng(1)
    q = robot.coordinates([0.8])
    x, d, w = rng.normal(size=(3, 3, 1)), rng.normal(size=(4, 1)), rng.normal(size=(2, 1))
    given = (q[:1], *x[0], q[1:])
    tangents, gradients = kernel.jvp(given, tuple(d)), kernel.vjp(given, tuple(w))

    def moved(h):
        rates = [y + h * e for y, e in zip((q[:1], *x[0]), d, strict=True)]
        return np.array(robot.inverse_dynamics(*rates))

    h = 1e-3
    expected = (8 * (moved(h) - moved(-h)) - (moved(2 * h) - moved(-2 * h))) / (12 * h)
    np.testing.assert_allclose(tangents, expected, rtol=1e-8, atol=1e-8)
    assert sum(float(a @ b) for a, b in zip(tangents, w, strict=True)) == pytest.approx(
        sum(float(a @ b) for a, b in zip(gradients, d, strict=True))
    )


def test_lengths_off_by_a_micrometer_are_no_parallelogram():
    near = fourbar(1.0, 0.5, 1.0 + 1e-6, 0.5, [0.7, -0.7, 0.7])
    assert not near.mechanism.closure.ratios.places
    rounded = fourbar(0.1 + 0.2, 0.5, 0.3, 0.5, [0.7, -0.7, 0.7])  # 0.30000000000000004
    assert rounded.mechanism.closure.ratios.places == (1, 2)


def test_the_crossed_branch_follows_by_no_ratio():
    crossed = fourbar(1.0, 0.5, 1.0, 0.5, [0.7, -1.9, -1.0])
    assert not crossed.mechanism.closure.ratios.places
    q, robot = crossed.coordinates([0.3]), parallelogram()
    refusal(lambda: robot.coordinates(q), "is on another branch; on that of the start it follows")
    nearly = [0.3, -0.299, 0.3]
    np.testing.assert_allclose(robot.coordinates(nearly), [0.3, -0.3, 0.3], atol=1e-15)


def test_followers_on_another_branch_are_refused_again_and_again():
    """The rod depends on the crank alone, so that the loop solved for it closes wherever the followers are."""
    tree = rods([(-1, 0.0, [0.5, 1.0]), (-1, 1.0, [0.5]), (0, 0.3, [0.9]), (-1, 1.5, [0.8])])
    loops = [("end0", "end1"), ("end2", "end3")]
    robot = tree.closed(loops, [tree.joint_names[0]], start=[0.7, -0.7, 0.7, 0.4, 1.0])
    good, other = robot.coordinates([0.3]), fourbar(1.0, 0.5, 1.0, 0.5, [0.7, -1.9, -1.0])
    crossed = np.concatenate([other.coordinates([0.3]), good[3:]])
    for _ in range(2):
        assert np.isfinite(robot.potential_energy(good))  # by the short way of calls from then on
        refusal(lambda: robot.potential_energy(crossed), "is on another branch; on that of the start it follows")


def test_wrenches_of_cuts_have_no_digits_at_change_points():
    """There the loop carries any tension: only the pin's share of the weight is determined."""
    robot = parallelogram()
    assert np.isfinite(robot.loop_wrenches([0.5], [0.0], [0.0])).all()
    for _ in range(2):
        with expect_refusal("Wl at q would be off by up to"):
            robot.loop_wrenches(np.array([1e-9]), np.zeros(1), np.zeros(1))
