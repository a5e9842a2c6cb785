"""The primitive of JAX: the numbers of NumPy, one native call under every transformation, exact derivatives."""

import gc
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import casadi
import jounce
from jounce.engine import primitive
from jounce.native import memory_layout, xla
from jounce.spatial import lie
from support.refusals import refusal
from support.robots import floating, random_mechanism, random_pose, relative_error
from support.several_named import named_robot
from support.several_named import states as states_of

ROBOT = jounce.load("planar2r")
CALL = "custom_call @jounce_"


@pytest.fixture(autouse=True)
def _doubles():
    with jax.enable_x64(True):
        yield


def ragged_rates(*shapes, n=ROBOT.n, seed=0):
    rng = np.random.default_rng(seed)
    return [rng.uniform(-2, 2, (*shape, n)) for shape in shapes]


def assert_same_leaves(found, expected):
    found, expected = jax.tree.leaves(found), jax.tree.leaves(expected)
    for x, y in zip(found, expected, strict=True):
        assert isinstance(x, jax.Array)
        np.testing.assert_array_equal(x, y, strict=True)


def assert_close_leaves(found, expected, tolerance=1e-12):
    for x, y in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
        assert x.shape == y.shape
        assert relative_error(np.asarray(x), np.asarray(y)) < tolerance


def calls(function, *arrays):
    """How many native calls XLA compiles for a function."""
    return jax.jit(function).lower(*arrays).as_text().count(CALL)


@pytest.mark.parametrize(
    "shapes",
    [
        [(), (), ()], [(5,), (), (5,)], [(1,), (5,), ()], [(5, 1), (1, 4), (5, 4)], [(3,), (2, 3), ()],
        [(0,), (), ()], [(0,), (1,), (0,)], [(1, 1), (1,), ()], [(9,), (9,), (9,)],
    ],
)  # fmt: skip
def test_batch_axes_broadcast(shapes):
    q = ragged_rates(*shapes)
    arrays = [jnp.asarray(x) for x in q]
    assert_same_leaves(ROBOT.inverse_dynamics(*arrays), ROBOT.inverse_dynamics(*q))
    assert_same_leaves(ROBOT.inverse_dynamics(arrays[0], *q[1:]), ROBOT.inverse_dynamics(*q))  # of both kinds
    assert_same_leaves(ROBOT.kinetic_energy(*arrays[:2]), ROBOT.kinetic_energy(*q[:2]))


def test_a_mapped_call_is_one_call():
    """Over the second axis of one array, the last of another, a third shared: nothing is copied that all share."""
    q, qd, q2d = np.random.default_rng(0).normal(size=(4, 3, 2)), ragged_rates((3,))[0].T, np.ones(2)
    law = jax.vmap(jax.vmap(ROBOT.inverse_dynamics, in_axes=(0, None, None)), in_axes=(1, 1, None))
    expected = [[ROBOT.inverse_dynamics(q[j, i], qd[:, i], q2d) for j in range(4)] for i in range(3)]
    assert_same_leaves(jax.jit(law)(q, qd, q2d), np.array(expected))
    assert calls(law, q, qd, q2d) == 1
    of_rows = jax.make_jaxpr(jax.vmap(ROBOT.inverse_dynamics, in_axes=(0, None, None)))
    equations = [str(e.primitive) for e in of_rows(q[:, 0], q2d, q2d).eqns]
    assert equations.count("jounce_quantity") == 1
    assert [e.params["shape"] for e in of_rows(q[:, 0], q2d, q2d).eqns if "broadcast" in str(e.primitive)] == [
        (1, 2)
    ] * 2


def test_derivatives_are_the_products_of_the_kernel():
    kernel = ROBOT.compile(order=1, wrench=True)
    arrays, directions, weights = (
        [np.random.default_rng(seed).normal(size=(6, *port.shape)) for port in ports]
        for seed, ports in enumerate([*[kernel.signature.inputs] * 2, kernel.signature.outputs])
    )
    law = lambda *x: ROBOT.inverse_dynamics(*x[:4], wrench=x[4:])  # noqa: E731
    both = lambda x, d, w: (jax.jvp(law, x, d), jax.vjp(law, *x)[1](w))  # noqa: E731
    given = [tuple(map(jnp.asarray, x)) for x in (arrays, directions, weights)]
    (values, tangents), gradients = jax.jit(both)(*given)
    assert_same_leaves(values, kernel(*arrays))
    assert_same_leaves(tangents, kernel.jvp(arrays, directions))
    assert_same_leaves(gradients, kernel.vjp(arrays, weights))
    assert calls(both, *given) == 3
    shared = [jnp.asarray(x[0]) for x in arrays]  # the gradient by what all states share is their sum
    cost = lambda x: jnp.sum(law(*shared[:3], given[0][3], *x)[1] ** 2)  # noqa: E731
    found, Qd = jax.grad(cost)(shared[4:]), law(*shared[:3], given[0][3], *shared[4:])[1]
    each = kernel.vjp([*as_arrays(shared[:3]), arrays[3], *as_arrays(shared[4:])], (None, 2 * np.asarray(Qd)))
    assert_close_leaves(found, [g.sum(0) for g in each[4:]])


def as_arrays(given):
    return [np.asarray(x) for x in given]


def test_the_gradient_of_a_cost_of_Q2d_is_that_of_casadi():
    q = ragged_rates(*[()] * 5)
    symbols = [casadi.SX.sym("q", 2) for _ in q]
    *_, Q2d = ROBOT.casadi_function(order=2)(*symbols)
    gradient = casadi.gradient(casadi.dot(Q2d, Q2d), casadi.vertcat(*symbols))
    expected = casadi.Function("gradient", symbols, [gradient])(*q).full().reshape(5, 2)
    found = jax.jit(jax.grad(lambda q: jnp.sum(ROBOT.inverse_dynamics(*q)[2] ** 2)))(q)
    assert relative_error(np.array(found), expected) < 1e-13


def test_hessians_of_energy_are_jacobians_of_gravity_forces():
    """By the rules of both products, and of a batch: those of the traced law."""
    point, U = jnp.array([0.3, -0.7]), ROBOT.potential_energy
    stiffness = jax.jacfwd(ROBOT.gravity_forces)(point)
    assert_close_leaves(jax.jit(jax.hessian(U))(point), stiffness)
    assert_close_leaves(jax.jit(jax.vmap(jax.jacrev(jax.grad(U))))(point[None])[0], stiffness)


def test_a_pose_of_the_base_is_differentiated_along_displacements():
    """The gradient is that of the kernel, the second derivative that of the traced law."""
    rng = np.random.default_rng(0)
    robot = jounce.Robot(floating(random_mechanism(rng, [-1], ["revolute"], [1.0]), rng))
    q, base = [*rng.normal(size=(3, 2, 1))], [random_pose(rng), *rng.normal(size=(2, 2, 6))]

    def moved(d):  # as by the exponential, to the second derivative
        return base[0] @ (np.eye(4) + lie.wedge(d) + lie.wedge(d) @ lie.wedge(d) / 2)

    def forces(d):
        return robot.inverse_dynamics(*q, base=(moved(d), *base[1:]))

    def energy(d, method=None):
        return robot.potential_energy(q[0][0], base=moved(d), method=method)

    at, along = jnp.zeros(6), np.arange(6.0)
    kernel, both = (
        robot.compile(order=0, moving_base=True),
        lambda d, t: (jax.jvp(forces, (d,), (t,)), jax.jacrev(forces)(d)),
    )
    (values, tangents), jacobian = jax.jit(both)(at, along)
    assert_same_leaves(values, robot.inverse_dynamics(*q, base=tuple(base)))
    assert_close_leaves(tangents, kernel.jvp((*q, *base), (None, None, None, along, None, None)))
    assert_close_leaves(jnp.sum(jacobian, axis=(0, 1)), kernel.vjp((*q, *base), np.ones((2, 7)))[3].sum(0))
    second = lambda method: jax.jit(jax.hessian(lambda d: energy(d, method)))(at)  # noqa: E731
    assert_close_leaves(second(None), second("closed_form"))
    refusal(lambda: robot.potential_energy(q[0], base=2 * jnp.asarray(base[0])), "base: C is no pose: ")


def test_singles_are_doubles_inside():
    """Rounded once, at the end, with 64 bits enabled or not; converted in more than one part."""
    q = [x.astype(np.float32) for x in ragged_rates((5003,), (5003,), ())]
    exact = ROBOT.inverse_dynamics(*(x.astype(float) for x in q)).astype(np.float32)
    assert_same_leaves(jax.jit(ROBOT.inverse_dynamics)(*q), exact)
    assert_same_leaves(ROBOT.mass_matrix(jnp.asarray(q[0][:0])), np.zeros((0, 2, 2), np.float32))
    cost = lambda q, *more: ROBOT.inverse_dynamics(q, *more).sum()  # noqa: E731
    with jax.enable_x64(False):
        assert_same_leaves(ROBOT.inverse_dynamics(*map(jnp.asarray, q)), exact)
        single = jax.grad(cost)(*map(jnp.asarray, q))
    assert single.dtype == np.float32
    assert_close_leaves(single, jax.grad(cost)(*(jnp.asarray(x, float) for x in q)), 1e-6)
    assert ROBOT.mass_matrix(jnp.zeros(2, int)).dtype == np.float64
    assert ROBOT.mass_matrix(jnp.zeros(2, jnp.bfloat16)).dtype == jnp.bfloat16


def test_nothing_is_traced_twice():
    traced = []

    def law(*q):
        traced.append(None)
        return ROBOT.mass_matrix(*q)

    compiled = jax.jit(law)
    q = jnp.asarray(ragged_rates((4,))[0])
    before = primitive._run._cache_size()
    for _ in range(3):
        compiled(q)
        ROBOT.mass_matrix(q)
    assert len(traced) == 1
    assert primitive._run._cache_size() <= before + 1


def test_robots_of_equal_data_share_a_handler_that_outlives_them():
    q = ragged_rates((3,), (3,), (3,))
    robots = [jounce.load("planar2r", m1=2.5) for _ in range(2)]
    expected, before = robots[0].inverse_dynamics(*q), len(xla._targets)
    laws = [jax.jit(robot.inverse_dynamics).lower(*q).compile() for robot in robots]
    assert len(xla._targets) == before + 1
    del robots
    gc.collect()
    for law in laws:
        assert_same_leaves(law(*q), expected)


def test_threads_call_at_once():
    """A kernel in the loop form whose scratch memory is from a pool, even where two states are computed at once."""
    robot = jounce.Robot(random_mechanism(np.random.default_rng(0), range(-1, 29), ["revolute"] * 30, np.ones(30)))
    kernel = robot.compile(order=5)
    assert kernel.addresses[1]
    assert not memory_layout.is_straight(kernel.computation, robot.mechanism)
    q = ragged_rates(*[(50,)] * 8, n=robot.n)
    expected, law = kernel(*q), jax.jit(robot.inverse_dynamics)
    arrays = [jnp.asarray(x) for x in q]
    law(*arrays)

    def work(_):
        with jax.enable_x64(True):  # of each thread its own
            return law(*arrays)

    with ThreadPoolExecutor(4) as pool:
        for found in pool.map(work, range(16)):
            assert_same_leaves(found, expected)


def test_a_jaxlib_that_refuses_the_handler_calls_python_back(monkeypatch):
    monkeypatch.setattr(xla, "FFI_VERSION", (0, 99))
    robot, q = jounce.load("planar2r", m1=3.5), ragged_rates((4,), (), (4,))
    law = jax.jit(lambda *q: jax.vjp(robot.inverse_dynamics, *q)[0])
    assert_same_leaves(law(*q), robot.inverse_dynamics(*q))
    assert calls(robot.inverse_dynamics, *q) == 0
    assert_same_leaves(jax.jit(robot.mass_matrix)(q[1]), robot.mass_matrix(q[1]))
    single = [x.astype(np.float32) for x in q]
    exact = robot.inverse_dynamics(*(x.astype(float) for x in single)).astype(np.float32)
    assert_same_leaves(jax.jit(robot.inverse_dynamics)(*single), exact)


def test_jax_is_imported_by_its_users_alone():
    script = "import jounce, sys; jounce.load('planar2r').gravity_forces([0.0, 0.0]); sys.exit('jax' in sys.modules)"
    subprocess.run([sys.executable, "-c", script], timeout=60, check=True)


def test_other_platforms_get_the_traced_law():
    q = ragged_rates((4,))[0]
    for law in (ROBOT.gravity_forces, jax.grad(lambda q: ROBOT.gravity_forces(q).sum())):
        text = jax.jit(law).trace(q).lower(lowering_platforms=("cuda",)).as_text()
        assert CALL not in text
        assert "cosine" in text


def test_what_native_code_does_not_serve_is_traced():
    mesh, spec, q = jax.make_mesh((1,), ("states",)), jax.sharding.PartitionSpec("states"), ragged_rates((4,))[0]
    split = jax.device_put(q, jax.sharding.NamedSharding(mesh, spec))
    slope = jax.grad(lambda q: ROBOT.gravity_forces(q).sum())
    assert_close_leaves(jax.jit(jax.shard_map(slope, mesh=mesh, in_specs=spec, out_specs=spec))(split), slope(q))
    assert calls(ROBOT.gravity_forces, split) == 0
    steps = jax.jit(ROBOT.gravity_forces)(q[0] + 1e-30j * jnp.eye(2)).imag / 1e-30  # derivatives by the complex step
    assert_close_leaves(steps.T, jax.jacfwd(ROBOT.gravity_forces)(q[0]))


def test_what_fits_nothing_is_refused():
    q, kernel = jnp.ones((3, 2)), ROBOT.compile("mass_matrix", order=0)
    assert_same_leaves(ROBOT.mass_matrix(q, method="kernel"), ROBOT.mass_matrix(np.ones((3, 2))))
    refusal(lambda: ROBOT.mass_matrix(q, threads=2), "^threads=2 needs native code… runs on one thread")
    refusal(lambda: ROBOT.mass_matrix(1j * q, method="kernel"), "^method='kernel' is not available… of real numbers")
    refusal(lambda: jax.vmap(kernel)(q), "^<Kernel: … takes arrays of numbers, … methods of a Robot take both")
    traced = jax.jit(lambda q: ROBOT.mass_matrix([q[0], 1.0]))
    refusal(lambda: traced(q[0]), "^q holds numbers that JAX traces; …stack")
    refusal(lambda: ROBOT.inverse_dynamics(q, q[:2], q), "^batch axes do not fit together: q (3,), qd (2,)")


def test_joints_of_several_screws_have_gradients_by_positions():
    robot = named_robot({"cart": "planar", "foot": "ball"}, [-1, -1])
    q, qd, q2d = states_of(robot, 3, 3)
    weights = np.random.default_rng(3).normal(size=robot.n)

    def product(q):
        return robot.inverse_dynamics(q, qd[0], q2d[0]) @ weights

    assert_same_leaves(robot.inverse_dynamics(*map(jnp.asarray, (q, qd, q2d))), robot.inverse_dynamics(q, qd, q2d))
    assert_same_leaves(
        jax.vmap(lambda q: robot.inverse_dynamics(q, qd[0], q2d[0]))(q), robot.inverse_dynamics(q, qd[0], q2d[0])
    )
    gradient, steps = jax.jit(jax.grad(product)), 1e-6 * np.eye(robot.nq)
    assert calls(jax.grad(product), jnp.asarray(q[0])) > 0
    differences = np.array([(product(q[0] + h) - product(q[0] - h)) / 2e-6 for h in steps])
    assert_close_leaves(gradient(q[0]), differences, 1e-8)
    along = np.random.default_rng(4).normal(size=robot.nq)
    assert_close_leaves(jax.jvp(product, (q[0],), (along,))[1], differences @ along, 1e-8)
    assert_close_leaves(jax.vmap(gradient)(q), np.stack([gradient(x) for x in q]))
    differences = np.stack([(gradient(q[0] + h) - gradient(q[0] - h)) / 2e-6 for h in steps])
    assert_close_leaves(jax.jit(jax.jacfwd(gradient))(q[0]), differences, 1e-8)


BOTH_WAYS = [(jax.jacfwd, jax.jacrev), (jax.jacfwd, jax.jacfwd), (jax.jacrev, jax.jacrev), (jax.jacrev, jax.jacfwd)]


@pytest.mark.sweep(2)
@pytest.mark.parametrize(("outer", "inner"), BOTH_WAYS)
def test_second_derivatives_are_products_of_the_kernel(outer, inner):
    """Forward and reverse in any order, where displacements do not commute and where coordinates follow others."""
    rng, loops = np.random.default_rng(0), jounce.load("fivebar")
    robot = jounce.Robot(floating(random_mechanism(rng, [-1], ["revolute"], [1.0]), rng))
    (q, qd, q2d), C, (V, Vd), w = rng.normal(size=(3, 1)), random_pose(rng), rng.normal(size=(2, 6)), rng.normal(size=7)

    def of_base(d):
        moved = C @ (np.eye(4) + lie.wedge(d) + lie.wedge(d) @ lie.wedge(d) / 2)
        return robot.inverse_dynamics(q, qd, q2d, base=(moved, V, Vd)) @ w

    whole, own = loops.coordinates(np.zeros(2), method="recursion"), list(loops.mechanism.closure.independent)
    rates, dependent = rng.normal(size=(2, 2)), whole[list(loops.mechanism.closure.dependent)]

    def of_loops(d):
        return loops.inverse_dynamics(whole + np.eye(4)[:, own] @ d, *rates) @ w[:2]

    floats = robot.compile(order=0).hessian((q, qd, q2d, C, V, Vd), w, symmetric=True)["base_pose", "base_pose"]
    closed = loops.compile(order=0).hessian((whole[own], *rates, dependent), w[:2])["q", "q"]
    for law, expected in ((of_base, floats), (of_loops, closed)):
        assert_close_leaves(jax.jit(outer(inner(law)))(jnp.zeros(len(expected))), expected)
    text = jax.jit(outer(inner(of_base))).lower(jnp.zeros(6)).as_text()
    assert CALL in text
    assert "cosine" not in text


def test_hessians_by_quaternions_are_differences():
    robot = named_robot({"foot": "ball"}, [-1])
    q, qd, q2d = states_of(robot, 3)
    gradient = jax.jit(jax.grad(lambda q: robot.inverse_dynamics(q, qd, q2d).sum()))
    expected = [(gradient(q + h) - gradient(q - h)) / 2e-6 for h in 1e-6 * np.eye(robot.nq)]
    for derive in (jax.jacfwd, jax.jacrev):
        assert_close_leaves(jax.jit(derive(gradient))(q), np.array(expected), 1e-7)


def test_hessians_by_vmap_and_products_of_gradients_agree():
    q = jnp.asarray(np.random.default_rng(5).normal(size=(3, 4, 2)))
    cost = lambda x: jnp.sum(ROBOT.inverse_dynamics(*x)[1] ** 2)  # noqa: E731
    H, along = jax.jit(jax.vmap(jax.hessian(cost)))(q), jnp.ones((4, 2))
    product = jnp.tensordot(H[0], along, 2)
    assert_close_leaves(jax.jit(jax.hessian(cost))(q[0]), H[0])
    assert_close_leaves(jax.jit(lambda x: jax.jvp(jax.grad(cost), (x,), (along,))[1])(q[0]), product)
    assert_close_leaves(jax.jit(jax.grad(lambda x: jnp.vdot(jax.grad(cost)(x), along)))(q[0]), product)
    text = jax.jit(jax.hessian(ROBOT.potential_energy)).trace(q[0, 0]).lower(lowering_platforms=("cuda",)).as_text()
    assert CALL not in text
    assert "cosine" in text
