"""Products of derivatives of closed robots: the dependent coordinates follow those by which they differentiate."""

from dataclasses import replace

import jax
import numpy as np
import pytest

import jounce
from jounce._codegen.test_vectors import derivative_product
from support.closed_robots import motion_near_start
from support.robots import differentiated_at_once, relative_error

ROBOT = jounce.load("fivebar")
DEPENDENT = list(ROBOT.mechanism.closure.dependent)


@pytest.fixture(scope="module")
def force_kernel():
    return ROBOT.compile(order=0)


@pytest.fixture(scope="module")
def closed_inputs():
    """A state with its dependent coordinates, directions and weights."""
    rng = np.random.default_rng(0)
    x = [x[0] for x in motion_near_start(ROBOT, rng, 2)(np.zeros(1))]
    dependent = ROBOT.coordinates(x[0], method="recursion")[DEPENDENT]
    return (*x, dependent), tuple(rng.uniform(-1, 1, (3, 2))), rng.uniform(-1, 1, 2)


def test_native_products_follow_the_motion(force_kernel, closed_inputs):
    """Against differences of forces whose loops are closed at every step, and against the complex step."""
    x, directions, weights = closed_inputs
    gradients, tangents = force_kernel.vjp(x, weights), force_kernel.jvp(x, directions)
    assert [g.shape for g in gradients] == [(2,)] * 3  # none by the dependent coordinates
    moved = lambda t: [a + np.multiply.outer(t, d) for a, d in zip(x, directions, strict=False)]  # noqa: E731
    along = lambda t: ROBOT.inverse_dynamics(*moved(t), method="recursion")  # noqa: E731
    assert relative_error(tangents, differentiated_at_once(along, 0.01)) < 1e-9
    assert abs(np.sum(np.multiply(gradients, directions)) - tangents @ weights) < 1e-12 * np.abs(tangents).max()
    m = ROBOT.mechanism
    for name, others, found in (("vjp", [weights], gradients), ("jvp", directions, [tangents])):
        expected = derivative_product(replace(force_kernel.computation, product=name), "closed_form", m, [*x, *others])
        for a, b in zip(found, expected, strict=True):
            assert relative_error(a, b) < 1e-12


def test_products_of_motor_torques_follow_the_motion():
    """With wrenches, by the complex step, and by q along differences whose loops are closed at every step."""
    arm, rng = ROBOT.elastic([90.0, 70.0], rotor=[0.01, 0.02]), np.random.default_rng(1)
    kernel = arm.compile("motor_torques", 0, wrench=True)
    q, *rates = [x[0] for x in motion_near_start(ROBOT, rng, 4)(np.zeros(1))]
    W, dq, weights = rng.uniform(-1, 1, (3, 4, 6)), rng.uniform(-1, 1, 2), rng.uniform(-1, 1, 2)
    x = [q, *rates, *W, ROBOT.coordinates(q, method="recursion")[DEPENDENT]]
    directions = [dq, *rng.uniform(-1, 1, (4, 2)), *rng.uniform(-1, 1, (3, 4, 6))]
    gradients, tangents = kernel.vjp(x, weights), kernel.jvp(x, directions)
    for name, others, found in (("vjp", [weights], gradients), ("jvp", directions, [tangents])):
        asked = replace(kernel.computation, product=name)
        for a, b in zip(found, derivative_product(asked, "closed_form", arm.mechanism, [*x, *others]), strict=True):
            assert relative_error(a, b) < 1e-12

    def along(t):
        states = [q + np.multiply.outer(t, dq), *(np.broadcast_to(rate, (len(t), 2)) for rate in rates)]
        wrench = tuple(np.broadcast_to(w, (len(t), 4, 6)) for w in W)
        return arm.motor_torques(*states, wrench=wrench, method="recursion")

    assert relative_error(gradients[0] @ dq, differentiated_at_once(along, 0.01) @ weights) < 1e-8


def test_gradients_hold_more_than_those_at_held_dependent_coordinates(force_kernel, closed_inputs):
    (q, *rates, dependent), _, weights = closed_inputs
    held = lambda t: force_kernel(q + np.multiply.outer(t, [1, 0]), *rates, dependent) @ weights  # noqa: E731
    at_held = differentiated_at_once(held, 0.01)
    assert abs(force_kernel.vjp((q, *rates, dependent), weights)[0][0] - at_held) > 0.1 * abs(at_held)


def test_jax_differentiates_along_the_motion(closed_inputs):
    """Both its primitive and its own derivatives of the traced law; the dependent coordinates have none of it."""
    whole, own = ROBOT.coordinates(closed_inputs[0][0], method="recursion"), list(ROBOT.mechanism.closure.independent)
    expected = np.zeros(4)
    expected[own] = ROBOT.gravity_forces(closed_inputs[0][0], method="recursion")
    with jax.enable_x64(True):
        gradient = jax.grad(ROBOT.potential_energy)(jax.numpy.asarray(whole))
        traced = jax.jit(lambda q: ROBOT.potential_energy(q, method="recursion"))
        tangent = jax.jit(lambda q, d: jax.jvp(traced, (q,), (d,))[1])(whole, np.arange(1.0, 5.0))
    assert relative_error(gradient, expected) < 1e-12
    assert relative_error(tangent, expected @ np.arange(1.0, 5.0)) < 1e-12
