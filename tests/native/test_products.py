"""Products of derivatives in native code: exact, transposes of each other, and called as kernels are."""

import pickle
import re
import warnings
from dataclasses import replace

import jax
import numpy as np
import pytest
from scipy.linalg import expm

import jounce
from jounce._codegen.test_vectors import derivative_product
from jounce.core.errors import JounceWarning
from jounce.dynamics.computation import DERIVATIVE_PRODUCTS, Computation
from jounce.dynamics.quantities import QUANTITIES
from jounce.dynamics.quantities.row import CLOSED
from jounce.native import code_forms, jit, memory_layout
from jounce.native import kernel as module
from jounce.program.differentiate import jvp, vjp
from jounce.spatial.lie import wedge
from support.bases import random_base
from support.comparisons import assert_all_close
from support.quantities import REQUESTS, branched, ids
from support.refusals import expect_refusal, refusal
from support.robots import floating
from support.several_named import named_chain, states
from support.states import random_inputs

ROBOT = branched()  # with a mimic joint and drives
TWO = jounce.load("planar2r")
ALL = [
    (quantity, keywords)
    for quantity, keywords in REQUESTS
    if keywords == ({"frame": "body"} if quantity.gives.frames else {})
    or ids([(quantity, keywords)]) == ["jacobian:tool:world"]
]


def of_product(quantity, order, name, wrench=False, **keywords):
    return replace(Computation(quantity, order, wrench, **keywords), product=name)


def inner(x, y):
    return sum(np.sum(a * b) for a, b in zip(x, y, strict=True))


@pytest.mark.sweep(8)
@pytest.mark.parametrize(("quantity", "keywords"), ALL, ids=ids(ALL))
def test_products_of_every_quantity_are_those_of_the_complex_step(quantity, keywords):
    m, wrench = ROBOT.mechanism, quantity.takes.wrenches
    values = code_forms.trace_program(m, Computation(quantity.name, 1, wrench, **keywords))
    for name, differentiate in (("vjp", vjp), ("jvp", jvp)):
        asked = of_product(quantity.name, 1, name, wrench, **keywords)
        given = random_inputs(asked.signature(m).inputs)
        expected = derivative_product(asked, "closed_form" if "closed_form" in quantity.laws else "recursion", m, given)
        found = differentiate(values).run([float(x) for array in given for x in array.flat])
        ports = asked.signature(m).outputs
        assert_all_close([np.reshape(found[p.start : p.end], p.shape) for p in ports], expected, 1e-11)


@pytest.mark.parametrize("base", [False, True])
@pytest.mark.parametrize("name", DERIVATIVE_PRODUCTS)
def test_the_arrays_of_products_have_names_of_their_own(name, base):
    for m in (TWO.mechanism, jounce.load("fivebar").mechanism):
        for quantity in (row for row in QUANTITIES.values() if m.closure or CLOSED not in row.needs):
            asked = of_product(quantity.name, 0, name, quantity.takes.wrenches, base=base)
            highest = memory_layout.highest_order(asked, m)
            for order in (min(3, highest), highest):
                signature = replace(asked, order=quantity.highest(order)).signature(m)
                names = [port.name for port in (*signature.inputs, *signature.outputs)]
                assert len(set(names)) == len(names)
                assert len(names) <= 64  # which NumPy's functions can take


@pytest.fixture(scope="module")
def wrench_kernel():
    return ROBOT.compile("inverse_dynamics", order=1, wrench=True)


@pytest.fixture(scope="module")
def vectors(wrench_kernel):
    batch = (6,)
    x = random_inputs(wrench_kernel.signature.inputs, *batch)
    return (
        x,
        random_inputs(wrench_kernel.signature.inputs, *batch, seed=1),
        random_inputs(wrench_kernel.signature.outputs, *batch, seed=2),
    )


def test_native_products_are_transposes_and_match_complex_steps(wrench_kernel, vectors):
    x, directions, weights = vectors
    gradients, tangents = wrench_kernel.vjp(x, weights), wrench_kernel.jvp(x, directions)
    assert [g.shape for g in gradients] == [a.shape for a in x]
    assert abs(inner(gradients, directions) - inner(tangents, weights)) < 1e-12 * abs(inner(gradients, directions))
    m = ROBOT.mechanism
    assert_all_close(
        gradients,
        derivative_product(replace(wrench_kernel.computation, product="vjp"), "closed_form", m, [*x, *weights]),
    )
    assert_all_close(
        tangents,
        derivative_product(replace(wrench_kernel.computation, product="jvp"), "closed_form", m, [*x, *directions]),
    )


@pytest.mark.outside
def test_products_agree_with_jax():
    kernel = TWO.compile(order=0, wrench=True)
    x, directions = (tuple(random_inputs(kernel.signature.inputs, 3, seed=seed)) for seed in (0, 1))
    (weights,) = random_inputs(kernel.signature.outputs, 3, seed=2)
    law = lambda *q: TWO.inverse_dynamics(*q[:3], wrench=q[3], method="recursion")  # noqa: E731
    with jax.enable_x64(True):
        both = jax.jit(lambda x, w, d: (jax.vjp(law, *x)[1](w), jax.jvp(law, x, d)[1]))
        gradients, tangents = both(x, weights, directions)
    assert_all_close(kernel.vjp(x, weights), [np.asarray(y) for y in gradients])
    assert_all_close([kernel.jvp(x, directions)], [np.asarray(tangents)])


@pytest.mark.parametrize("floats", [True, False])
def test_products_by_a_pose_are_those_of_displacements(floats):
    """Steps C exp(wedge(d)), and transposes of each other."""
    robot = jounce.Robot(floating(TWO.mechanism, np.random.default_rng(0))) if floats else TWO
    kernel, rng = robot.compile("base_wrench", order=1, moving_base=True), np.random.default_rng(1)
    C, *rest = random_base(rng, 4)
    x, given = [*rng.uniform(-1, 1, (4, 2)), C, *rest], kernel.signature.inputs
    directions, weights = [rng.uniform(-1, 1, (3, *port.displacement)) for port in given], rng.uniform(-1, 1, (2, 3, 6))
    gradients, tangents = kernel.vjp(x, tuple(weights)), kernel.jvp(x, directions)
    assert [g.shape for g in gradients] == [d.shape for d in directions]
    assert abs(inner(gradients, directions) - inner(tangents, weights)) < 1e-12 * abs(inner(gradients, directions))
    by_pose = kernel.jvp(x, [None] * 4 + [directions[4]] + [None] * 3)
    h = 1e-5
    higher, lower = (
        kernel(*x[:4], np.stack([C @ expm(s * h * wedge(d)) for d in directions[4]]), *rest) for s in (1, -1)
    )
    assert_all_close(by_pose, [(a - b) / (2 * h) for a, b in zip(higher, lower, strict=True)], 1e-8)
    for name, others, found in (("vjp", [*weights], gradients), ("jvp", directions, tangents)):
        batch = [np.broadcast_to(a, (3, *port.shape)) for a, port in zip(x, given, strict=True)]
        assert_all_close(
            found,
            derivative_product(
                replace(kernel.computation, product=name), "closed_form", robot.mechanism, [*batch, *others]
            ),
        )


def test_batches_threads_and_out_change_no_bit(wrench_kernel, vectors):
    x, directions, weights = vectors
    gradients, tangents = wrench_kernel.vjp(x, weights), wrench_kernel.jvp(x, directions)
    later = [a[1:] for a in x], [w[1:] for w in weights]
    for found in (wrench_kernel.vjp(x, weights, threads=2), wrench_kernel.vjp(*later)):
        for a, b in zip(found, gradients, strict=True):
            np.testing.assert_array_equal(a, b[-len(a) :])
    out = tuple(np.full(g.shape, np.nan) for g in gradients)
    assert wrench_kernel.vjp(x, weights, out=out)[0] is out[0]
    np.testing.assert_array_equal(out[-1], gradients[-1])
    out = [np.full(t.shape, np.nan) for t in tangents]
    wrench_kernel.jvp(x, directions, out=out, threads=2)
    np.testing.assert_array_equal(out, tangents)
    shared = wrench_kernel.vjp([a[0] for a in x], weights)  # a gradient for each weight, none of them added up
    np.testing.assert_array_equal(shared[0], wrench_kernel.vjp([np.broadcast_to(a[0], a.shape) for a in x], weights)[0])


def test_none_is_zero(wrench_kernel, vectors):
    x, directions, weights = vectors
    for a, b in zip(
        wrench_kernel.vjp(x, (None, weights[1])), wrench_kernel.vjp(x, [0 * weights[0], weights[1]]), strict=True
    ):
        np.testing.assert_array_equal(a, b)
    first = [directions[0], *[None] * 5]
    for a, b in zip(
        wrench_kernel.jvp(x, first),
        wrench_kernel.jvp(x, [directions[0], *(0 * d for d in directions[1:])]),
        strict=True,
    ):
        np.testing.assert_array_equal(a, b)
    assert not np.any(wrench_kernel.vjp(x, (None, None))[0])


def test_products_are_kernels_kept_on_disk_and_pickled(wrench_kernel, vectors, monkeypatch):
    x, _, weights = vectors
    gradients = wrench_kernel.vjp(x, weights)
    module.Kernel(
        wrench_kernel.mechanism, wrench_kernel.computation
    )  # kept in the folder of this test, whoever made the first one
    monkeypatch.setattr(jit, "assemble", None)  # nothing is compiled any more
    monkeypatch.setattr(module, "_living", {})
    direct = pickle.loads(pickle.dumps(ROBOT.compile("inverse_dynamics", order=1, wrench=True, product="vjp")))
    assert repr(direct) == f"<Kernel: vjp of inverse_dynamics of {ROBOT.name!r} to order 1, with wrenches>"
    out = tuple(np.empty(g.shape) for g in gradients)
    direct.bind(*x, *weights, out=out)()
    for a, b, c in zip(direct(*x, *weights), gradients, out, strict=True):
        np.testing.assert_array_equal(a, b)
        np.testing.assert_array_equal(a, c)
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(wrench_kernel)).vjp(x, weights)[0], gradients[0])


def test_what_is_not_finite_makes_nan_of_what_depends_on_it(wrench_kernel, vectors):
    x, directions, weights = vectors
    bad = [*directions[:3], np.full_like(directions[3], np.inf), *directions[4:]]  # of q3d, on which Q does not depend
    with np.errstate(invalid="ignore"):
        dQ, dQd = wrench_kernel.jvp(x, bad)
        gradients = wrench_kernel.vjp(x, (weights[0], np.nan * weights[1]))
    assert np.isfinite(dQ).all()
    assert np.isnan(dQd).all()
    assert all(np.isnan(g).all() for g in gradients)


def test_scalars_and_single_results_take_and_give_arrays():
    kernel = TWO.compile("kinetic_energy", order=0)
    q, qd, d = np.random.default_rng(0).normal(size=(3, 4, 2))
    gq, gqd = kernel.vjp((q, qd), np.ones(4))
    np.testing.assert_allclose(gqd, TWO.generalized_momentum(q, qd), rtol=1e-13)
    with pytest.warns(JounceWarning, match="no effect on one state"):
        np.testing.assert_array_equal(kernel.vjp((q[0], qd[0]), (1.0,), threads=2)[1], gqd[0])
    np.testing.assert_array_equal(kernel.vjp((q, qd), np.ones(4), threads=2), [gq, gqd])
    np.testing.assert_allclose(kernel.jvp((q, qd), (None, d)), np.sum(gqd * d, axis=-1), rtol=1e-13)


ONES = [np.ones((5, 2))] * 4
REFUSED = {
    "few weights": (lambda k: k.vjp(ONES, [1.0]), "^vjp of <…>: there are 1 weights; expected a tuple of 2: wQ"),
    "few directions": (lambda k: k.jvp(ONES, ONES[1:]), ": there are 3 directions; expected a tuple of 4: dq, dqd, "),
    "one array": (lambda k: k.vjp(np.ones((4, 2)), ONES[2:]), ": arrays are of type ndarray; expected a tuple of 4"),
    "a shape": (lambda k: k.vjp(ONES, (ONES[0], np.ones(3))), ": wQd has shape (3,); expected (..., 2)$"),
    "batches": (lambda k: k.vjp(ONES, (ONES[0], np.ones((3, 2)))), "broadcast"),
    "a dtype": (lambda k: k.jvp(ONES, [1j * ONES[0], None, None, None]), "not supported for the input types"),
    "names": (lambda k: k.vjp(ONES, ({"a": 1, "b": 2}, None)), "takes arrays without names"),
    "a mask": (lambda k: k.vjp([np.ma.masked_equal(ONES[0], 2), *ONES[1:]], (None, None)), "without masks"),
    "no state": (lambda k: k.vjp([None, *ONES[1:]], (None, None)), ": q has shape (); expected"),
    "no number of threads": (lambda k: k.vjp(ONES, (None, None), threads=0), "^threads = 0"),
    "out of another number": (lambda k: k.vjp(ONES, (None, None), out=(np.ones(2),)), "exactly one entry"),
    "second derivatives": (lambda k: TWO.compile(order=1, product="vjp").jvp(ONES, ONES), "has no jvp: it computes"),
    "another product": (lambda k: TWO.compile(product="hesse"), "^unknown product 'hesse'; …: vjp, jvp, hvp, jjvp, "),
    "the order": (lambda k: TWO.compile(order=12, product="vjp"), "^native code supports orders up to 9, not 12"),
}  # fmt: skip


@pytest.mark.parametrize(("call", "words"), REFUSED.values(), ids=REFUSED)
def test_what_does_not_fit_is_refused_in_one_line(call, words):
    refusal(lambda: call(TWO.compile(order=1)), words)


def test_what_takes_long_to_compile_waits_for_compile(monkeypatch, tmp_path):
    monkeypatch.setenv("JOUNCE_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(memory_layout, "MAX_COMPILE_SECONDS", 0.001)
    robot = jounce.load("ur5", gravity=(0, 0, 1))
    kernel = robot.compile("gravity_forces", order=0)
    q = np.ones(6)
    asked = r"robot\.compile\('gravity_forces', order=0, product='vjp'\)"
    with expect_refusal(re.compile(rf"takes longer than 0\.001 s to compile; {asked} compiles it once$")):
        kernel.vjp((q,), q)
    compiled = robot.compile("gravity_forces", order=0, product="vjp")
    np.testing.assert_array_equal(kernel.vjp((q,), q)[0], compiled(q, q))


def test_robots_of_the_loop_form_have_products_in_a_straight_line():
    asked = Computation("inverse_dynamics", 9)
    m = jounce.load("ur5").mechanism
    assert not memory_layout.is_straight(asked, m)
    assert memory_layout.is_straight(replace(asked, product="vjp"), m)


def test_long_chains_with_a_ball_take_straight_code_or_none():
    robot = named_chain(40)
    for order in (0, 3):  # the second takes long to compile, which is told
        given = states(robot, order + 3)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", JounceWarning)
            found = robot.inverse_dynamics(*given)
        assert memory_layout.is_straight(Computation("inverse_dynamics", order), robot.mechanism)
        expected = robot.inverse_dynamics(*given, method="closed_form")
        np.testing.assert_allclose(
            np.vstack([found]), np.vstack([expected]), rtol=1e-10, atol=1e-10 * np.abs(found).max()
        )
