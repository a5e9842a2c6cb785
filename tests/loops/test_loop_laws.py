"""Laws that hold of every closed robot: rates, power, equations of motion, and independence of where loops are cut."""

import numpy as np
import pytest
from loops import LOOP_ROBOTS, content, loaded, fivebar_cut_at_elbow, motion_near_start, platform_on_leg_four
from robots import differentiated_at_once, relative_error

import jounce

FASTEST = {"method": "recursion"}


@pytest.fixture(scope="module")
def closed(tmp_path_factory):
    """The bundled robots with loops, read once."""
    folder = tmp_path_factory.mktemp("loops")
    return {name: loaded(content(name), folder) for name in LOOP_ROBOTS}


RATES = {  # of quantities: how many rates of q enter beyond the order
    "inverse_dynamics": 2,
    "mass_matrix": 0,
    "coriolis_matrix": 1,
    "coriolis_matrix skew": 1,
    "gravity_forces": 0,
    "jacobian": 0,
    "momentum": 1,
    "generalized_momentum": 1,
    "base_wrench": 2,
    "coordinates": 0,
}


@pytest.mark.parametrize("quantity", RATES)
@pytest.mark.parametrize("name", LOOP_ROBOTS)
def test_rates_are_derivatives_along_the_motion(closed, name, quantity):
    """The first rate against nine-point differences of the value, the second against those of the first."""
    robot, at_rest = closed[name], RATES[quantity]
    motion = motion_near_start(robot, np.random.default_rng(2), at_rest + 2)
    chosen = {} if quantity == "coordinates" else FASTEST
    named, _, form = quantity.partition(" ")

    def rates(t, order):
        given = motion(t)[: at_rest + order + 1]
        return getattr(robot, named)(*given, **chosen, **({"form": form} if form else {}))

    _, first, second = rates(0.0, 2)
    assert relative_error(first, differentiated_at_once(lambda t: rates(t, 0))) < 1e-8
    assert relative_error(second, differentiated_at_once(lambda t: rates(t, 1)[1])) < 1e-8


@pytest.mark.parametrize("name", LOOP_ROBOTS)
def test_forces_give_their_power_to_the_energy(closed, name):
    robot = closed[name]
    q, qd, q2d = motion_near_start(robot, np.random.default_rng(3), 2)(np.linspace(0, 2, 3))
    Q = robot.inverse_dynamics(q, qd, q2d, **FASTEST)
    gain = robot.kinetic_energy(q, qd, q2d, **FASTEST)[1] + robot.potential_energy(q, qd, **FASTEST)[1]
    assert relative_error(gain, np.sum(Q * qd, axis=-1)) < 1e-12


@pytest.mark.parametrize("name", LOOP_ROBOTS)
def test_equations_of_motion(closed, name):
    """Q = M q2d + C qd + Qgrav with both matrices, Md - 2 Cbar is skew, T = qd M qd / 2, p = M qd."""
    robot = closed[name]
    q, qd, q2d = motion_near_start(robot, np.random.default_rng(4), 2)(0.3)
    M, Md = robot.mass_matrix(q, qd, **FASTEST)
    Cbar = robot.coriolis_matrix(q, qd, form="skew", **FASTEST)
    rest = robot.inverse_dynamics(q, qd, q2d, **FASTEST) - M @ q2d - robot.gravity_forces(q, **FASTEST)
    assert relative_error(robot.coriolis_matrix(q, qd, **FASTEST) @ qd, rest) < 1e-11
    assert relative_error(Cbar @ qd, rest) < 1e-11
    assert np.abs(Md - 2 * Cbar + (Md - 2 * Cbar).T).max() < 1e-12 * np.abs(M).max()
    assert relative_error(robot.kinetic_energy(q, qd, **FASTEST), qd @ M @ qd / 2) < 1e-12
    assert relative_error(robot.generalized_momentum(q, qd, **FASTEST), M @ qd) < 1e-12


@pytest.mark.parametrize("name", LOOP_ROBOTS)
def test_bodies_move_as_those_of_the_tree(closed, name):
    robot = closed[name]
    tree, q = jounce.Robot(robot.mechanism.tree), motion_near_start(robot, np.random.default_rng(5), 3)(1.1)
    on_tree = robot.coordinates(*q)
    for quantity, given in {"poses": 2, "twists": 3, "momentum": 3, "base_wrench": 4}.items():
        found = getattr(robot, quantity)(*q[:given], **FASTEST)
        expected = getattr(tree, quantity)(*on_tree[:given], **FASTEST)
        for x, y in zip(found, expected, strict=True) if isinstance(found, tuple) else [(found, expected)]:
            assert relative_error(x, y) < 1e-12, quantity


@pytest.mark.parametrize("name", LOOP_ROBOTS)
def test_forward_dynamics_inverts_inverse_dynamics(closed, name):
    robot = closed[name]
    u = motion_near_start(robot, np.random.default_rng(6), 4)(0.9)
    Q = robot.inverse_dynamics(*u, **FASTEST)
    for method in ("recursion", "closed_form"):
        for found, expected in zip(robot.forward_dynamics(*u[:2], *Q, method=method), u[2:], strict=True):
            assert relative_error(found, expected) < 1e-10


ELSEWHERE = {"fivebar": fivebar_cut_at_elbow, "gough_stewart": platform_on_leg_four}


@pytest.mark.parametrize("name", ELSEWHERE)
def test_forces_do_not_depend_on_the_cut(closed, name, tmp_path):
    robot, other = closed[name], loaded(ELSEWHERE[name](), tmp_path)
    assert {loop.name for loop in other.mechanism.loops}.isdisjoint({loop.name for loop in robot.mechanism.loops})
    u = motion_near_start(robot, np.random.default_rng(7), 4)(0.4)
    for found, expected in zip(
        other.inverse_dynamics(*u, **FASTEST), robot.inverse_dynamics(*u, **FASTEST), strict=True
    ):
        assert relative_error(found, expected) < 1e-11
