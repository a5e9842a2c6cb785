"""Second derivatives in native code: of products against each other, differences of the first, and other programs."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

import casadi
import jounce
from jounce import cuda
from jounce.dynamics.computation import Computation, change, commutator
from jounce.dynamics.quantities.row import ELASTIC
from jounce.native import code_forms, memory_layout
from jounce.program import differentiate
from jounce.spatial.lie import wedge
from support.bases import random_base
from support.closed_robots import motion_near_start
from support.quantities import REQUESTS, branched, ids
from support.refusals import expect_refusal, refusal
from support.robots import floating, relative_error
from support.several_named import named_robot

BRANCHED = branched()
TWO = jounce.load("planar2r")
ALL = [
    (quantity, keywords)
    for quantity, keywords in REQUESTS
    if keywords == ({"frame": "body"} if quantity.gives.frames else {})
    and len(quantity.gives.shape) < 3
    and (ELASTIC not in quantity.needs or quantity.name == "motor_torques")  # others of motors take long to trace
]


def given_of(robot, order=0, seed=0, **keywords):
    """A kernel with a state, its directions and weights; poses, quaternions and loops as they must be."""
    kernel, rng = robot.compile("inverse_dynamics", order, **keywords), np.random.default_rng(seed)
    ports = kernel.signature.inputs
    x = [rng.uniform(-1, 1, port.shape) for port in ports]
    if robot.mechanism.closure:
        q, *rates = (a[0] for a in motion_near_start(robot, rng, order + 2)(np.zeros(1)))
        whole = robot.coordinates(q, method="recursion")
        x[: order + 3], x[-1] = [q, *rates], whole[list(robot.mechanism.closure.dependent)]
    for k, port in enumerate(ports):
        if port.is_pose:
            x[k : k + order + 3] = random_base(rng, order + 3)
            x[k] = x[k].reshape(4, 4)
    x = [np.reshape(a, port.shape) for a, port in zip(x, ports, strict=True)]
    free = [port for port in ports if port.is_free]
    directions = [rng.uniform(-1, 1, port.displacement) for port in free]
    return kernel, free, x, directions, [rng.uniform(-1, 1, port.shape) for port in kernel.signature.outputs]


def several():
    return named_robot({"hip": "revolute", "ankle": "ball"}, [-1, 0], tilted=False)


ROBOTS = {
    "a chain with wrenches, with a rate": lambda: given_of(TWO, 1, wrench=True),
    "a floating base": lambda: given_of(jounce.Robot(floating(TWO.mechanism, np.random.default_rng(0)))),
    "a moving ground": lambda: given_of(TWO, moving_base=True),
    "a ball": lambda: given_of(several()),
    "a closed loop": lambda: given_of(jounce.load("fivebar")),
}


def moved_inputs(robot, free, x, directions, s):
    """The state moved by s along directions, as displacements move it; loops stay closed."""
    found = [*x]
    for k, (port, d) in enumerate(zip(free, directions, strict=True)):
        found[k] = x[k] @ expm(s * wedge(d)) if port.is_pose else x[k] + s * d if not port.directions else None
        if found[k] is None:
            found[k] = flow(robot, x[k], s * d)
    if robot.closure:
        whole = jounce.Robot(robot).coordinates(found[0], method="recursion")
        found[-1] = whole[list(robot.closure.dependent)]
    return found


def flow(m, q, d, steps=4):
    """Positions moved by a displacement, integrated by Runge and Kutta."""
    port = Computation("gravity_forces", 0).signature(m).inputs[0]
    for _ in range(steps):
        k1 = change(m, port, q, d / steps)
        k2 = change(m, port, q + k1 / 2, d / steps)
        k3 = change(m, port, q + k2 / 2, d / steps)
        k4 = change(m, port, q + k3, d / steps)
        q = q + (k1 + 2 * k2 + 2 * k3 + k4) / 6
    return q


def hessian_times(H, free, directions):
    flat = lambda x, port: np.sum(x * 1.0, axis=tuple(range(-len(port.displacement), 0)))  # noqa: E731
    return [sum(flat(H[a.name, b.name] * d, b) for b, d in zip(free, directions, strict=True)) for a in free]


@pytest.mark.parametrize("name", ROBOTS)
def test_products_are_derivatives_of_gradients(name):
    kernel, free, x, directions, weights = ROBOTS[name]()
    h = kernel.hvp(x, weights, directions)
    ahead, behind = (kernel.vjp(moved_inputs(kernel.mechanism, free, x, directions, s), weights) for s in (1e-5, -1e-5))
    size = max(np.abs(a).max() for a in h)
    for found, a, b in zip(h, ahead, behind, strict=True):
        assert np.abs(found - (a - b) / 2e-5).max() < 1e-8 * size
    for a, b in zip(hessian_times(kernel.hessian(x, weights), free, directions), h, strict=True):
        assert np.abs(a - b).max() < 1e-13 * size


@pytest.mark.parametrize("name", ROBOTS)
def test_hessians_are_symmetric_but_for_what_does_not_commute(name):
    """a . H b - b . H a = g . [b, a]; the symmetric one is that along a straight displacement."""
    kernel, free, x, directions, weights = ROBOTS[name]()
    H, gradient = kernel.hessian(x, weights), kernel.vjp(x, weights)
    symmetric = kernel.hessian(x, weights, symmetric=True)
    size, rng = max(np.abs(block).max() for block in H.values()), np.random.default_rng(9)
    for port, g in zip(free, gradient, strict=True):
        for other in free:
            if port is not other:
                axes = [*range(len(port.displacement), len(port.displacement) + len(other.displacement))]
                turned = np.transpose(H[other.name, port.name], [*np.argsort([*axes, *range(axes[0])])])
                np.testing.assert_array_equal(H[port.name, other.name], turned)
        if len(port.displacement) == 1:
            a, b = rng.uniform(-1, 1, (2, *port.displacement))
            difference = a @ H[port.name, port.name] @ b - b @ H[port.name, port.name] @ a
            assert abs(difference - g @ commutator(kernel.mechanism, port, b) @ a) < 1e-13 * size
            assert np.abs(symmetric[port.name, port.name] - symmetric[port.name, port.name].T).max() < 1e-15 * size
    h = kernel.hvp(x, weights, directions, symmetric=True)
    for one, other in zip(h, hessian_times(symmetric, free, directions), strict=True):
        assert np.abs(one - other).max() < 1e-13 * size
    if not kernel.mechanism.closure:
        along = lambda s: _weighted(kernel, moved_inputs(kernel.mechanism, free, x, directions, s), weights)  # noqa: E731
        curvature = sum(np.sum(a * d) for a, d in zip(h, directions, strict=True))
        step = 1e-3
        assert abs((along(step) + along(-step) - 2 * along(0.0)) / step**2 - curvature) < 1e-4 * size


def _weighted(kernel, x, weights):
    results = kernel(*x)
    return sum(
        np.sum(y * w) for y, w in zip(results if isinstance(results, tuple) else (results,), weights, strict=True)
    )


@pytest.mark.sweep(4)
@pytest.mark.parametrize(("quantity", "keywords"), ALL, ids=ids(ALL))
def test_both_orders_agree_for_every_quantity(quantity, keywords):
    m = BRANCHED.mechanism
    values = code_forms.trace_program(m, Computation(quantity.name, 0, quantity.takes.wrenches, **keywords))
    rng = np.random.default_rng(1)
    x, d, e, w = (rng.uniform(-1, 1, count) for count in (*[values.inputs] * 3, len(values.outputs)))
    by_hvp = d @ differentiate.hvp(values).run([*x, *w, *e])
    by_jjvp = w @ differentiate.jjvp(values).run([*x, *d, *e])
    swapped = w @ differentiate.jjvp(values).run([*x, *e, *d])
    assert abs(by_hvp - by_jjvp) < 1e-12 * (1 + abs(by_hvp))
    assert abs(by_hvp - swapped) < 1e-12 * (1 + abs(by_hvp))


@pytest.mark.outside
def test_the_hessian_of_forces_is_that_of_casadi():
    robot, rng = jounce.load("ur5"), np.random.default_rng(2)
    symbols = [casadi.SX.sym(name, robot.n) for name in ("q", "qd", "q2d", "w")]
    x, n = list(rng.uniform(-1, 1, (4, robot.n))), robot.n
    Q = robot.casadi_function(order=0)(*symbols[:3])
    H = casadi.hessian(casadi.dot(Q, symbols[3]), casadi.vertcat(*symbols[:3]))[0]
    expected = casadi.Function("hessian", symbols, [H])(*x).full()
    found = robot.compile("inverse_dynamics", 0, product="hessian")(*x)
    assert found.shape == (3 * n, 3 * n)
    assert relative_error(found, expected) < 1e-13


def test_batches_threads_and_out_change_no_bit():
    kernel = TWO.compile(order=1)
    rng = np.random.default_rng(3)
    x, d, w = list(rng.normal(size=(4, 6, 2))), list(rng.normal(size=(4, 6, 2))), list(rng.normal(size=(2, 6, 2)))
    H, h = kernel.hessian(x, w), kernel.hvp(x, w, d)
    out, into = np.full((6, 8, 8), np.nan), tuple(np.full((6, 2), np.nan) for _ in h)
    found = kernel.hessian(x, w, out=out, threads=2)
    assert np.shares_memory(found["q", "q3d"], out)
    assert kernel.hvp(x, w, d, out=into, threads=2)[0] is into[0]
    for name, block in H.items():
        np.testing.assert_array_equal(block, found[name])
        np.testing.assert_array_equal(block[2], kernel.hessian([a[2] for a in x], [a[2] for a in w])[name])
    np.testing.assert_array_equal(h, into)
    assert set(H) == {(a, b) for a in ("q", "qd", "q2d", "q3d") for b in ("q", "qd", "q2d", "q3d")}
    assert not np.any(kernel.hvp(x, w, [None] * 4))
    np.testing.assert_array_equal(kernel.hvp(x, (None, w[1]), d), kernel.hvp(x, (0 * w[0], w[1]), d))
    jjvp = TWO.compile(order=1, product="jjvp")
    close = np.sum(np.multiply(jjvp(*x, *d, *d), w)), np.sum(np.multiply(h, d))
    np.testing.assert_allclose(*close, rtol=1e-13)


X, W = [np.ones(2)] * 3, np.ones(2)
REFUSED = {
    "weights of a wrong shape": (lambda k: k.hessian(X, np.ones(3)), ": wQ has shape (3,); expected (..., 2)$"),
    "few directions": (lambda k: k.hvp(X, W, X[1:]), ": there are 2 directions; expected a tuple of 3: dq, "),
    "no weights": (lambda k: k.hvp(X, (), X), "there are 0 weights; expected a tuple of 1: wQ$"),
    "a word for symmetric": (lambda k: k.hessian(X, W, symmetric="yes"), "^symmetric is 'yes'"),
    "derivatives of products": (lambda k: TWO.compile(order=0, product="vjp").hvp(X, W, X), "has no hvp: it"),
    "the order": (lambda k: TWO.compile(order=8, product="hvp"), "^native code supports orders up to 7, not 8"),
    "generated code": (lambda k: TWO.codegen("c", outputs="inverse_dynamics.hvp"), "^code of inv…hvp is not"),
    "a GPU": (lambda k: cuda.compile(TWO, product="hessian"), "^CUDA code has no hessian; robot.compile"),
}  # fmt: skip


@pytest.mark.parametrize(("call", "words"), REFUSED.values(), ids=REFUSED)
def test_what_does_not_fit_is_refused_in_one_line(call, words):
    refusal(lambda: call(TWO.compile(order=0)), words)


def test_long_compilation_waits_for_compile_and_has_an_end(monkeypatch, tmp_path):
    monkeypatch.setenv("JOUNCE_CACHE_DIR", str(tmp_path))
    robot = jounce.load("ur5", gravity=(0, 1, 1))
    kernel, q = robot.compile("gravity_forces", order=0), np.ones(6)
    monkeypatch.setattr(memory_layout, "MAX_COMPILE_SECONDS", 0.001)
    refusal(lambda: kernel.hessian((q,), q), "robot.compile(…product='hessian') compiles it once, or hvp computes its")
    monkeypatch.setattr(code_forms, "MAX_SECOND_STEPS", 100)
    with expect_refusal("^hessian of gravity_forces of 'ur5' to order 0, 6x6, takes over 100 opera"):
        robot.compile("gravity_forces", order=0, product="hessian")
    assert memory_layout.is_straight(replace(kernel.computation, product="hvp"), robot.mechanism)


@pytest.mark.sweep(2)
@pytest.mark.parametrize(
    ("product", "order", "most"), [("hvp", 0, 2200), ("hvp", 1, 4820), ("hessian", 0, 5120), ("hvp", 2, 8830)]
)
def test_operations_of_the_panda_are_as_measured(product, order, most):
    arm = jounce.load("panda")
    arm = jounce.load("panda", lock=dict.fromkeys(arm.joint_names[7:], 0.0))
    program = code_forms.trace_program(arm.mechanism, Computation("inverse_dynamics", order, product=product))
    assert code_forms.fuse(program).operations <= most


@pytest.mark.parametrize("quantity", ["gravity_forces", "potential_energy", "center_of_mass", "mass_matrix"])
def test_the_hessian_is_the_second_rate_along_a_straight_motion(quantity):
    """Jets by the series of the recursion: d2f/dt2 = d . H d of f(q + t d), which depends on q alone."""
    robot = jounce.load("iiwa14")
    q, d = np.random.default_rng(1).uniform(-1, 1, (2, 7))
    second = getattr(robot, quantity)(q, d, 0 * d, method="recursion")[2]
    w = np.random.default_rng(2).uniform(-1, 1, np.shape(second))
    H = robot.compile(quantity, order=0).hessian((q,), w)["q", "q"]
    assert d @ H @ d == pytest.approx((w * second).sum(), rel=1e-13, abs=1e-13 * np.abs(H).max())
