"""Accelerations and their rates where drives are steep for light bodies: right in 50 digits, or refused by name."""

from dataclasses import replace

import jax
import numpy as np
import pytest
import sympy
from hypothesis import given

import jounce
from jounce import UncertainError
from jounce.dynamics.computation import Computation
from jounce.engine.certain_digits import drive_growth, is_steep, least_inertias
from jounce.model.drive_trains import AMOUNTS, UNDRIVEN, Drives
from support import own_equations
from support.bases import random_base
from support.linkages import fourbar, rods
from support.quantities import tupled
from support.refusals import expect_refusal, refusal
from support.robots import floating, mechanisms

PROMISED, EARLY = 1e-6, 1e-9  # of the size of a result: errors of what is returned, and of what may be refused
ORDER = 4
STEEP = [1.0, 1e1, 1e2, 1e3, 1e4, 1e5]  # 1/s, about: how fast errors grow, of a tip of 4e-5 kg m^2


def arm(**drives):
    """Two rods of 1 kg and 1 g in a plane, the light one with drives, all of which act."""
    m = rods([(-1, 0.0, [0.5, 0.35])]).mechanism
    return with_last_drives(replace(m, M=m.M * np.array([1.0, 1e-3])[:, None, None]), **drives)


def with_last_drives(m, **drives):
    """A robot with drives at its last joint."""
    at = np.arange(len(m.joints)) == len(m.joints) - 1
    table = {name: np.where(at, drives.get(name, value), value) for name, value in UNDRIVEN.items()}
    acting = tuple(term for term, amount in AMOUNTS.items() if amount in drives)
    return jounce.Robot(replace(m, drives=Drives(**table), acting=acting))


def on_a_base(**drives):
    """The same arm on a base that floats."""
    m = arm().mechanism
    return with_last_drives(floating(m, np.random.default_rng(1)), **drives)


def four_bar(**drives):
    """A four-bar of light rods far from singular positions, whose rocker has drives."""
    m = fourbar(1.0, 0.4, 1.1, 0.7, [1.0, -0.8, 1.3]).mechanism
    return with_last_drives(replace(m, M=m.M * 1e-3), **drives)


CASES = {  # the robot by how fast errors grow, and whether its base moves
    "damping": (lambda x: arm(damping=4e-5 * x), False),
    "friction": (lambda x: arm(friction=8e-5 * x, eps=1.0), False),
    "stribeck": (lambda x: arm(stribeck=8e-5 * x, eps=1.0, stribeck_velocity=3.0), False),
    "spring": (lambda x: arm(stiffness=4e-5 * x * x, rest=0.3), False),
    "floating": (lambda x: on_a_base(damping=4e-5 * x), True),
    "closed": (lambda x: four_bar(damping=2e-4 * x), False),
}
METHODS = (None, "recursion", "closed_form", "kernel")


def state(robot, moves, order=ORDER):
    """q, qd, Q, Qd, ... of a motion with rates of about 1, all coordinates of a closed robot; and the base."""
    rng = np.random.default_rng(5)
    rates, base = rng.uniform(0.3, 1, (order + 3, robot.n)), random_base(rng, order + 3) if moves else None
    closure = robot.mechanism.closure
    rates = [closure.start, *rates[1:]] if closure else [*rates]
    Q = robot.inverse_dynamics(*rates, base=base)
    return [*rates[:2], *tupled(Q)], base[:2] if moves else None


def attempt(call, *arrays, **options):
    """The results of a call, and which are refused."""
    try:
        found = tupled(call(*arrays, **options))
        return found, [False] * len(found)
    except UncertainError as error:
        return error.results, [bool(np.any(x)) for x in error.uncertain]


@pytest.mark.sweep(4)
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", CASES)
def test_rates_are_right_or_refused(name, method):
    make, moves = CASES[name]
    asked, returned, refused = Computation("forward_dynamics", ORDER, base=moves), [], []
    for steep in STEEP:
        robot = make(steep)
        arrays, base = state(robot, moves)
        found, lost = attempt(robot.forward_dynamics, *arrays, base=base, method=method)
        exact = own_equations.results(robot, asked, [*arrays, *(base or ())])
        values = tupled(robot.compile("forward_dynamics", ORDER, moving_base=moves)(*_of_kernel(robot, arrays, base)))
        for x, value, right, gone in zip(found, values, exact, lost, strict=True):
            size = np.abs(right).max()
            assert np.isnan(x).all() if gone else np.abs(x - right).max() <= PROMISED * size
            (refused if gone else returned).append(np.abs(value - right).max() / size)
    assert len(returned) > len(STEEP)
    assert len(refused) > len(STEEP) / 2
    assert min(refused) > EARLY
    assert max(refused) > 1


def _of_kernel(robot, arrays, base):
    """The arrays as kernels take them: q of a closed robot in two parts, checked by no one."""
    c = robot.mechanism.closure
    if c is None:
        return [*arrays, *(base or ())]
    whole = arrays[0]
    return [whole[list(c.independent)], *arrays[1:], whole[list(c.dependent)]]


def test_digits_of_higher_rates_are_not_lost_in_silence():
    """q7d was 147 where 1 is true, and q4d off by a thousandth."""
    robot, rng = arm(damping=0.2), np.random.default_rng(0)
    rates = [*rng.uniform(0.3, 1, (8, 2))]
    Q = robot.inverse_dynamics(*rates)
    unchecked = robot.compile("forward_dynamics", 5)(*rates[:2], *Q)
    assert np.abs(unchecked[-1] - rates[-1]).max() > 100
    with expect_refusal("q4d, q5d, q6d, q7d at q … damping, friction or springs are", kind=UncertainError):
        robot.forward_dynamics(*rates[:2], *Q)
    for x, true in zip(robot.forward_dynamics(*rates[:2], *Q[:2]), rates[2:], strict=False):
        np.testing.assert_allclose(x, true, atol=PROMISED * np.abs(true).max())


def test_batches_name_the_first_state_and_write_nothing():
    robot = arm(friction=0.04, eps=1.0)  # of which fast joints have no more
    arrays, _ = state(robot, False, order=3)
    arrays = [np.tile(x, (4, 1)) for x in arrays]
    arrays[1][[0, 2], 1] = 60.0
    out = tuple(np.full((4, 2), 7.0) for _ in range(4))
    with expect_refusal(" at q of 2 of 4 samples, first 1, would be off by up to", kind=UncertainError) as error:
        robot.forward_dynamics(*arrays, out=out)
    assert all((x == 7).all() for x in out)
    np.testing.assert_array_equal(error.value.uncertain[-1], [False, True, False, True])
    np.testing.assert_array_equal(np.isnan(error.value.results[-1]).any(axis=1), [False, True, False, True])
    good = [x[::2] for x in arrays]
    for _ in range(3):  # by the long way of calls, and by what may serve later ones
        for x, y in zip(robot.forward_dynamics(*good), error.value.results, strict=True):
            np.testing.assert_array_equal(x, y[::2])


def test_arrays_of_jax_are_checked_where_they_have_numbers():
    with jax.enable_x64(True):
        gentle, steep = arm(damping=4e-4), arm(damping=0.4)
        for robot in (gentle, steep):
            arrays = [jax.numpy.asarray(x) for x in state(robot, False, order=2)[0]]
            if robot is gentle:
                assert all(isinstance(x, jax.Array) for x in robot.forward_dynamics(*arrays))
                continue
            refusal(lambda arrays=arrays, robot=robot: robot.forward_dynamics(*arrays), "q4d at q", kind=UncertainError)


@pytest.mark.parametrize("qd", [0.0, 1.0])
def test_robots_at_rest_and_in_steady_motion_have_accelerations(qd):
    """Their rates vanish, and rounding of them is no loss."""
    robot = arm(damping=4e-3)
    q, still = np.array([0.4, 0.7]), np.zeros(2)
    speed = np.array([0.0, qd])
    Q = robot.inverse_dynamics(q, speed, still, still)
    assert is_steep(robot.mechanism, Computation("forward_dynamics", 2))
    for found in robot.forward_dynamics(q, speed, *Q, still):
        assert np.isfinite(found).all()
    for found in robot.forward_dynamics(q, still, robot.gravity_forces(q), still, still):
        assert np.abs(found).max() < 1e-7


@pytest.mark.parametrize("steep", [1e5, 1e7, 1e10, 1e15])
def test_accelerations_behind_stiff_springs_are_right_or_refused(steep):
    """Those of the motion of which the motors are, in 50 digits, whose positions are rounded to doubles."""
    robot = arm().elastic(4e-5 * steep, rotor=[1.0, 1e-4])
    rates = [*np.random.default_rng(2).uniform(0.3, 1, (5, 2))]
    motors = own_equations.results(robot, Computation("motor_commands", 0), rates)
    rotors = own_equations.results(robot, Computation("motor_positions", 2), rates)[2]
    for method in (None, "recursion", "closed_form"):
        found, lost = attempt(robot.elastic_forward_dynamics, *rates[:2], *motors, method=method)
        for x, true, gone in zip(found, (rates[2], rotors), lost, strict=True):
            assert np.isnan(x).all() if gone else np.abs(x - true).max() <= PROMISED * np.abs(true).max()
        assert lost[0] == (steep > 1e8)


@pytest.mark.parametrize("steep", [1e5, 1e7, 1e10, 1e15])
def test_feedback_linearization_behind_stiff_springs(steep):
    robot = arm().elastic(4e-5 * steep, rotor=[1.0, 1e-4])
    rates = [*np.random.default_rng(2).uniform(0.3, 1, (5, 2))]
    theta, thetad, tau = own_equations.results(robot, Computation("motor_commands", 0), rates)
    [found], [lost] = attempt(robot.feedback_linearization, *rates[:2], theta, thetad, rates[4])
    assert np.isnan(found).all() if lost else np.abs(found - tau).max() <= PROMISED * np.abs(tau).max()
    assert lost == (steep > 1e12)


def test_accelerations_of_passive_joints_with_dampers():
    """They are large where dampers are steep and nothing balances these, and not off for it."""
    start, order = [2.0, -1.5, 1.0, 1.7], 3
    m = rods([(-1, 0.0, [0.5, 0.7]), (-1, 1.0, [0.6, 1.2])]).mechanism
    for steep in (1.0, 1e2, 1e4, 1e6):
        tree = with_last_drives(replace(m, M=m.M * 1e-3), damping=1e-4 * steep)
        left, _, right, _ = tree.joint_names
        with pytest.warns(jounce.JounceWarning, match="passive without a spring"):
            robot = tree.closed([("end0", "end1")], [left], passive=[right], start=start)
        q, rng = robot.mechanism.closure.start, np.random.default_rng(1)
        arrays = [q, *rng.uniform(0.3, 1, (order + 2, 2))]
        asked = Computation("passive_accelerations", order)
        assert is_steep(robot.mechanism, asked) == (steep > 1)
        found, exact = robot.passive_accelerations(*arrays), own_equations.results(robot, asked, arrays)
        for x, true in zip(found, exact, strict=True):
            np.testing.assert_allclose(x, true, atol=PROMISED * np.abs(true).max())


@given(mechanisms(largest=4))
def test_the_growth_is_a_bound(drawn):
    """Eigenvalues of M^-1 D at any position, and J theta'^2 of the energy of any motion, for all kinds of joints."""
    m, rng = drawn
    damping = rng.uniform(0.1, 1, len(m.joints))
    table = {name: np.full(len(m.joints), value) for name, value in UNDRIVEN.items()} | {"damping": damping}
    m = replace(m, drives=Drives(**table), acting=("damping",))
    robot, J, growth = jounce.Robot(m), least_inertias(m), drive_growth(m)
    for _ in range(5):
        M = robot.mass_matrix(rng.uniform(-3, 3, m.n))
        D = m.G.T @ np.diag(damping) @ m.G
        assert np.linalg.eigvals(np.linalg.solve(M, D)).real.max() <= growth * (1 + 1e-9)
        for g, least in zip(m.G, J, strict=True):
            assert least * g @ np.linalg.solve(M, g) <= 1 + 1e-9


@pytest.mark.parametrize(
    ("quantity", "order", "steep"),
    [
        ("forward_dynamics", 0, False),
        ("forward_dynamics", 2, False),
        ("forward_dynamics", 4, True),
        ("inverse_dynamics", 4, False),
    ],
)
def test_common_calls_are_computed_once(quantity, order, steep):
    """A panda with all its drives to the second rate, and anything without drive terms."""
    assert is_steep(jounce.load("panda", drives=True).mechanism, Computation(quantity, order)) == steep
    assert not is_steep(jounce.load("panda").mechanism, Computation(quantity, order))


@pytest.mark.parametrize("quantity", ["elastic_forward_dynamics", "feedback_linearization"])
def test_motors_of_symbols_are_not_looked_at(quantity):
    """Stiffness without a number bounds nothing."""
    stiff = jounce.load("planar2r").elastic([1e15, 1e15], rotor=[0.1, 0.1]).mechanism
    symbols = replace(stiff.elasticity, stiffness=np.array(sympy.symbols("k:2", positive=True), dtype=object))
    assert is_steep(stiff, Computation(quantity, 2))
    assert not is_steep(replace(stiff, elasticity=symbols), Computation(quantity, 2))
