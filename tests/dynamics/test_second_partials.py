"""Tensors of second derivatives: those of gradients of weighted forces, and differences of the first, on all robots."""

import re

import numpy as np
import pytest
from hypothesis import given, settings
from test_partials import state_and_wrenches

import jounce
from jounce.dynamics.computation import Computation
from jounce.native.code_forms import trace_program
from jounce.spatial.lie import exp
from support.bases import moved_mechanisms, random_base
from support.refusals import expect_refusal
from support.robots import mechanisms, relative_error, with_drives
from support.several_named import named_robot, states


def contracted(m, x, weights, wrench=False, base=False):
    """The four blocks of the Hessian of weighted forces, by q, qd, q2d and those of the base before them."""
    asked = Computation("inverse_dynamics", 0, wrench, product="hessian", base=base)
    flat = [float(a) for array in (*x, weights) for a in np.ravel(array)]
    size = asked.signature(m).outputs[0].shape[0]
    H = np.reshape(trace_program(m, asked).run(flat), (size, size))
    free = [port for port in asked.signature(m).inputs if port.is_free and port.role != "weight"]
    starts = np.cumsum([0, *(int(np.prod(port.displacement)) for port in free)])
    roles = ("base", "state") if m.floats else ("state",)
    rates = [
        np.concatenate(
            [
                np.arange(start, start + np.prod(port.displacement), dtype=int)
                for role in roles
                for port, start in zip(free, starts, strict=False)
                if (port.role, port.rate) == (role, rate)
            ]
        )
        for rate in range(3)
    ]
    return [H[np.ix_(rates[a], rates[b])] for a, b in ((0, 0), (0, 1), (1, 1), (0, 2))]


def check_tensors(m, tensors, x, seed=0, **keywords):
    weights = np.random.default_rng(seed).uniform(-1, 1, m.nv)
    found = [np.einsum("i,ijk", weights, T) for T in tensors]
    expected = contracted(m, x, weights, **keywords)
    size = max(np.abs(H).max() for H in expected)
    for one, other in zip(found, expected, strict=True):
        assert one.shape == other.shape
        assert np.abs(one - other).max() <= 1e-13 * size


@given(mechanisms(largest=4))
@settings(max_examples=10)
def test_weighted_sums_are_hessians_of_weighted_forces(drawn):
    """Trees and forests, joints that follow others, drives, wrenches."""
    m, rng = with_drives(*drawn), drawn[1]
    (q, (W,)) = state_and_wrenches(m, 0, int(rng.integers(2**32)))
    robot = jounce.Robot(m)
    found = robot.inverse_dynamics_second_partials(*q, wrench=W, method="recursion")
    check_tensors(m, found, [*q, W], wrench=True)
    Qqq, _, Qqdqd, Qqq2d = found
    np.testing.assert_allclose(Qqq, Qqq.swapaxes(1, 2), atol=1e-13 * np.abs(Qqq).max())
    np.testing.assert_allclose(Qqdqd, Qqdqd.swapaxes(1, 2), atol=1e-13 * (1 + np.abs(Qqdqd).max()))
    np.testing.assert_allclose(Qqq2d, Qqq2d.swapaxes(0, 2), atol=1e-13 * (1 + np.abs(Qqq2d).max()))


@given(moved_mechanisms(largest=3))
@settings(max_examples=8)
def test_weighted_sums_are_hessians_on_a_moving_base(drawn):
    m, rng = drawn
    robot, (q, _) = jounce.Robot(m), state_and_wrenches(m, 0, int(rng.integers(2**32)))
    base = random_base(rng, 3)
    found = robot.inverse_dynamics_second_partials(*q, base=base, method="recursion")
    check_tensors(m, found, [*q, *base], base=True)


@pytest.mark.parametrize("kinds", ["ball revolute", "revolute planar revolute", "revolute free ball"])
def test_joints_of_several_columns_are_displaced_in_order(kinds):
    named = {f"j{i}": kind for i, kind in enumerate(kinds.split())}
    robot = named_robot(named, range(-1, len(named) - 1))
    x = states(robot, 3)
    found = robot.inverse_dynamics_second_partials(*x, method="recursion")
    check_tensors(robot.mechanism, found, x)
    assert np.abs(found[0] - found[0].swapaxes(1, 2)).max() > 1e-3 * np.abs(found[0]).max()


def test_accelerations_have_those_of_their_first_derivatives():
    """By differences along coordinates and velocities, with drives; of a floating robot along a twist of its base."""
    m = with_drives(jounce.load("ur5").mechanism, np.random.default_rng(1))
    robot, (q, qd, Q) = jounce.Robot(m), np.random.default_rng(2).uniform(-1, 1, (3, 6))
    found = robot.forward_dynamics_second_partials(q, qd, Q, method="recursion")
    steps = 1e-5 * np.eye(6)
    by_q, by_qd = (
        [(a - b) / 2e-5 for a, b in zip(*pair, strict=True)]
        for pair in (
            [robot.forward_dynamics_partials(q + s * steps, qd, Q) for s in (1, -1)],
            [robot.forward_dynamics_partials(q, qd + s * steps, Q) for s in (1, -1)],
        )
    )
    expected = [np.moveaxis(a, 0, -1) for a in (by_q[0], by_qd[0], by_qd[1])]
    for one, other in zip(found, [*expected, np.moveaxis(by_q[2], 0, 1)], strict=True):
        assert relative_error(one, other) < 1e-7
    humanoid = jounce.load("solo12", base="floating")
    rng = np.random.default_rng(3)
    base, (q, qd) = random_base(rng, 2), rng.uniform(-1, 1, (2, 12))
    Q = rng.uniform(-1, 1, 18)
    dqdq = humanoid.forward_dynamics_second_partials(q, qd, Q, base=base, method="recursion")[0]
    ahead, behind = (
        humanoid.forward_dynamics_partials(q, qd, Q, base=(base[0] @ exp(np.eye(6)[1], s), base[1]))[0]
        for s in (1e-5, -1e-5)
    )
    assert relative_error(dqdq[..., 1], (ahead - behind) / 2e-5) < 1e-6


def test_native_code_batches_and_jax_trace_agree():
    robot = jounce.load("ur5")
    x = np.random.default_rng(4).uniform(-1, 1, (3, 5, 6))
    native, found = (robot.inverse_dynamics_second_partials(*x, method=method) for method in ("kernel", "recursion"))
    for one, other in zip(native, found, strict=True):
        assert one.shape == (5, 6, 6, 6)
        assert relative_error(one, other) < 1e-13


def test_closed_robots_are_sent_to_weighted_sums():
    robot = jounce.load("fivebar")
    for name in ("inverse_dynamics_second_partials", "forward_dynamics_second_partials"):
        with expect_refusal(re.compile(rf"^{name} of 'fivebar' .*kernel\.hessian and kernel\.hvp")):
            getattr(robot, name)(*np.ones((3, 2)))
