"""Energy and momentum: what they are to each other, with their rates, drives included."""

import jax
import numpy as np
import pytest

import jounce
from jounce.spatial import lie
from support.quantities import branched, rigid
from support.robots import Interpreted, harmonic, relative_error

ROBOTS = {"a forest with drives": Interpreted(rigid(branched())), "iiwa14": Interpreted(jounce.load("iiwa14"))}
named = pytest.mark.parametrize("robot", ROBOTS.values(), ids=ROBOTS)


def harmonic_rates(robot, rates):
    return [
        np.stack(x)
        for x in zip(*(harmonic(np.random.default_rng(seed), robot.n, rates - 1)(0) for seed in range(4)), strict=True)
    ]


@named
def test_energy_changes_by_the_power_of_the_forces(robot):
    """d/dt (T + U) = qd . (Q - what is no force of a mass or a spring), and its rates."""
    q = harmonic_rates(robot, 6)
    T, U = robot.kinetic_energy(*q[:5]), robot.potential_energy(*q[:4])
    lost = robot.drive_forces(*q[:5], terms=["damping", "friction", "stribeck", "offset"])
    if not robot.mechanism.acting:
        lost = [0 * x for x in lost]
    driving = [Q - Q_lost for Q, Q_lost in zip(robot.inverse_dynamics(*q[:5]), lost, strict=True)]
    power = (q[1] * driving[0]).sum(-1)
    rate = (q[2] * driving[0] + q[1] * driving[1]).sum(-1)
    assert relative_error(T[1] + U[1], power) < 1e-12
    assert relative_error(T[2] + U[2], rate) < 1e-12


@named
def test_kinetic_energy_is_half_of_velocity_times_momentum(robot):
    q = harmonic_rates(robot, 4)
    p, pd = robot.generalized_momentum(*q[:3])
    T, Td = robot.kinetic_energy(*q[:3])
    assert relative_error(T, (q[1] * p).sum(-1) / 2) < 1e-13
    assert relative_error(Td, (q[2] * p + q[1] * pd).sum(-1) / 2) < 1e-13


@named
def test_generalized_momentum_is_mass_matrix_times_velocity(robot):
    q = harmonic_rates(robot, 4)
    M, Md, M2d = robot.mass_matrix(*q[:3])
    p, pd, p2d = robot.generalized_momentum(*q)
    v, a, j = (x[..., None] for x in q[1:])
    assert relative_error(p, (M @ v)[..., 0]) < 1e-13
    assert relative_error(pd, (M @ a + Md @ v)[..., 0]) < 1e-13
    assert relative_error(p2d, (M @ j + 2 * Md @ a + M2d @ v)[..., 0]) < 1e-12


def test_generalized_momentum_is_the_gradient_of_kinetic_energy():
    robot = ROBOTS["a forest with drives"]
    q, qd = harmonic_rates(robot, 2)
    with jax.enable_x64(True):
        gradient = jax.jit(jax.vmap(jax.grad(robot.kinetic_energy, argnums=1)))(q, qd)
        force = jax.jit(jax.vmap(jax.grad(robot.potential_energy)))(q)
    assert relative_error(robot.generalized_momentum(q, qd), gradient) < 1e-13
    springs = robot.drive_forces(q, qd, 0 * q, terms="spring")
    assert relative_error(robot.gravity_forces(q) + springs, force) < 1e-12


@named
@pytest.mark.parametrize("frame", ["body", "world", "spatial"])
def test_twists_are_jacobians_times_velocities(robot, frame):
    q = harmonic_rates(robot, 4)
    J, Jd, J2d = robot.jacobian(*q[:3], frame=frame)
    V, Vd, V2d = robot.twists(*q, frame=frame)
    v, a, j = (x[:, None, :, None] for x in q[1:])
    assert relative_error(V, (J @ v)[..., 0]) < 1e-13
    assert relative_error(Vd, (J @ a + Jd @ v)[..., 0]) < 1e-13
    assert relative_error(V2d, (J @ j + 2 * Jd @ a + J2d @ v)[..., 0]) < 1e-13


@named
def test_poses_move_by_their_twists(robot):
    """Hd = H wedge(V) with body twists, wedge(V) H with spatial ones, and the second rate by the product rule."""
    q = harmonic_rates(robot, 3)
    H, Hd, H2d = robot.poses(*q)
    V, Vd = map(lie.wedge, robot.twists(*q))
    assert relative_error(Hd, H @ V) < 1e-13
    assert relative_error(H2d, H @ (V @ V + Vd)) < 1e-13
    assert relative_error(Hd, lie.wedge(robot.twists(*q[:2], frame="spatial")) @ H) < 1e-13


@named
def test_potential_energy_is_that_of_the_centres_of_mass(robot):
    (q,) = harmonic_rates(robot, 1)
    rigid, m = robot.with_drives(False), robot.mechanism
    mass, h = m.M[:, 3, 3], lie.axial(m.M[:, :3, 3:]) / 2
    heights = (rigid.poses(q) @ np.concatenate([h, mass[:, None]], axis=1)[..., None])[..., :3, 0] @ m.gravity
    assert relative_error(rigid.potential_energy(q), -heights.sum(-1)) < 1e-13
