"""The facade: the one rule of rates, paths, batches, `out=`, and errors that say what came and what was expected."""

import gc
import inspect
import pickle
import sys
import tracemalloc

import numpy as np
import pandas as pd
import pytest

import jounce
from support.refusals import expect_refusal, refusal
from support.robots import golden, relative_error
from support.states import random_rates

METHODS = ("recursion", "closed_form", "paper")
QUANTITIES = {  # the fewest rates each takes, and the shape of its result for a robot of two joints
    "inverse_dynamics": (3, (2,)),
    "mass_matrix": (1, (2, 2)),
    "coriolis_matrix": (2, (2, 2)),
    "gravity_forces": (1, (2,)),
    "jacobian": (1, (2, 6, 2)),
}


@pytest.fixture(scope="module")
def robot():
    return jounce.Robot(golden("tree7")[0])


@pytest.mark.parametrize("quantity", QUANTITIES)
def test_each_further_rate_returns_one_more_time_derivative(quantity):
    """Native code and what is beyond it: the default for each order."""
    robot = jounce.load("planar2r")
    least, shape = QUANTITIES[quantity]
    compute, q = getattr(robot, quantity), random_rates(robot.n, 7)
    plain = compute(*q[:least])
    assert isinstance(plain, np.ndarray)
    assert plain.shape == shape
    for further in range(1, 5):
        results = compute(*q[: least + further])
        assert isinstance(results, tuple)
        assert len(results) == 1 + further
        assert relative_error(results[0], plain) < 1e-14  # native code of another order rounds otherwise


def test_both_forms_of_the_coriolis_matrix(robot):
    q = random_rates(robot.n, 7)
    M, Md = robot.mass_matrix(*q[:2])
    C, Cbar = (robot.coriolis_matrix(*q[:2], form=form) for form in ("paper", "skew"))
    assert relative_error(C @ q[1], Cbar @ q[1]) < 1e-13
    assert np.abs(Md - Cbar - Cbar.T).max() < 1e-13 * np.abs(Md).max()
    assert np.abs(Md - C - C.T).max() > 0.1
    assert relative_error(robot.inverse_dynamics(*q[:3]), M @ q[2] + C @ q[1] + robot.gravity_forces(q[0])) < 1e-13


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("batch", [(), (1,), (3, 2), (0,)])
def test_batches_give_what_a_loop_gives(robot, method, batch):
    q, W = random_rates(robot.n, 5, *batch), [np.random.default_rng(k).normal(size=(*batch, 7, 6)) for k in range(3)]
    found = robot.inverse_dynamics(*q, wrench=tuple(W), method=method)
    for Q in found:
        assert Q.shape == (*batch, 7)
    for i in np.ndindex(batch):
        one = robot.inverse_dynamics(*(x[i] for x in q), wrench=tuple(w[i] for w in W), method=method)
        for Q, expected in zip(found, one, strict=True):
            assert relative_error(Q[i], expected) < 1e-13


@pytest.mark.parametrize("method", ["recursion", "closed_form"])
def test_ten_thousand_states(method):
    robot = jounce.load("planar2r" if method == "closed_form" else "iiwa14")
    q = random_rates(robot.n, 5, 10000)
    found = robot.inverse_dynamics(*q, method=method)
    some = robot.inverse_dynamics(*(x[::487] for x in q), method=method)
    for Q, expected in zip(found, some, strict=True):
        for x, y in zip(Q[::487], expected, strict=True):
            assert relative_error(x, y) < 1e-13


def test_long_batches_are_worked_in_pieces_without_a_seam(robot, monkeypatch):
    q, W = random_rates(robot.n, 5, 5, 7), np.random.default_rng(3).normal(size=(7, 6))
    whole = robot.inverse_dynamics(*q, wrench=(W, W, W))
    four_states = 8 * 4 * 7 * 4  # bytes: the last piece is ragged
    monkeypatch.setattr("jounce.engine.generic_methods.MAX_WORKING_BYTES", four_states)
    pieces = robot.inverse_dynamics(*q, wrench=(W, W, W))
    for a, b in zip(whole, pieces, strict=True):
        assert relative_error(b, a) < 1e-14


def test_batch_axes_broadcast(robot):
    q = random_rates(robot.n, 5, 4)
    q[1], q[2] = q[1][0], q[2][:1]
    W = np.random.default_rng(0).normal(size=(3, 1, 7, 6))
    found = robot.inverse_dynamics(*q[:3], wrench=W)
    assert found.shape == (3, 4, 7)
    one = robot.inverse_dynamics(q[0][2], q[1], q[2][0], wrench=W[1, 0])
    assert relative_error(found[1, 2], one) < 1e-13


def test_memory_order_integers_and_short_floats_do_not_matter(robot):
    q = random_rates(robot.n, 5, 6)
    expected = robot.inverse_dynamics(*q)
    fortran = [np.asfortranarray(x) for x in q]
    strided = [np.repeat(x, 2, axis=-1)[:, ::2] for x in q]
    for layout in (fortran, strided, [x.tolist() for x in q]):
        for Q, reference in zip(robot.inverse_dynamics(*layout), expected, strict=True):
            assert (reference == Q).all()
    whole = [np.round(x) for x in q]
    for dtype in (int, np.int8, np.float32):
        Q = robot.inverse_dynamics(*(x.astype(dtype) for x in whole[:3]))
        assert Q.dtype == np.float64
        assert (robot.inverse_dynamics(*whole[:3]) == Q).all()


def test_inputs_are_never_modified(robot):
    q, W = random_rates(robot.n, 5, 3), np.ones((7, 6))
    copies = [x.copy() for x in q]
    for x in (*q, W):
        x.flags.writeable = False
    robot.inverse_dynamics(*q, wrench=(W, W, W))
    assert all((x == y).all() for x, y in zip(q, copies, strict=True))
    with pytest.raises(ValueError, match="read-only"):
        robot.mechanism.M[0, 0, 0] = 1.0


def test_results_are_written_into_out(robot):
    q = random_rates(robot.n, 5, 4)
    expected = robot.inverse_dynamics(*q)
    out = tuple(np.full((4, 7), np.nan) for _ in range(3))
    results = robot.inverse_dynamics(*q, out=out)
    assert all(r is o for r, o in zip(results, out, strict=True))
    assert all((o == e).all() for o, e in zip(out, expected, strict=True))
    M = np.zeros((4, 7, 7))
    assert robot.mass_matrix(q[0], out=M) is M
    view = np.zeros((4, 14))[:, ::2]
    assert (robot.gravity_forces(q[0], out=view) == view).all()


@pytest.mark.parametrize(("out", "message"), [
    ((np.zeros((4, 7)),), "out has 1 arrays; expected 2"),
    ((np.zeros((4, 7)), np.zeros((7, 4))), "out[1] has shape (7, 4); expected a NumPy array of shape (4, 7)"),
    ((np.zeros((4, 7)), [[0.0] * 7] * 4), "out[1] has type list"),
    ((np.zeros((4, 7)), np.zeros((4, 7), dtype=int)), "out[1] is of dtype int64"),
    ((np.zeros((4, 7)), np.broadcast_to(0.0, (4, 7))), "out[1] is read-only"),
    ((np.zeros((4, 7)),) * 2, "out[0] and out[1] share memory"),
])  # fmt: skip
def test_an_out_that_does_not_fit_is_refused_and_none_is_written(robot, out, message):
    refusal(lambda: robot.inverse_dynamics(*random_rates(robot.n, 4, 4), out=out), message)
    assert not np.any(out[0])


def test_rates_may_be_named(robot):
    q, qd, q2d, q3d, q4d = random_rates(robot.n, 5)
    named = robot.inverse_dynamics(q=q, qd=qd, q2d=q2d, q3d=q3d, q4d=q4d)
    assert all((a == b).all() for a, b in zip(named, robot.inverse_dynamics(q, qd, q2d, q3d, q4d), strict=True))
    assert isinstance(robot.inverse_dynamics(q, qd, q2d, None), np.ndarray)


def bad(robot, **changes):
    given = dict(zip(("q", "qd", "q2d", "q3d"), random_rates(robot.n, 4), strict=True)) | changes
    return robot.inverse_dynamics(**given)


@pytest.mark.parametrize(("changes", "message"), [
    ({"qd": np.zeros(6)}, "qd has shape (6,); expected (..., 7): joint1, joint2"),
    ({"q": np.zeros(6)}, "expected … joint7; lock= of jounce.load, or Robot.locked, holds joints without a value$"),
    ({"q": np.zeros((7, 3))}, "q has shape (7, 3); …; transpose it: q.swapaxes(-1, -2) has the coordinates last$"),
    ({"qd": np.zeros((7, 1))}, "qd has shape (7, 1); …; transpose it: qd.swapaxes"),
    ({"q": np.zeros(9)}, "q has shape (9,); expected … joint7$"),
    ({"q": {f"joint{i}": 0 for i in range(1, 7)}}, "^q: missing 'joint7'; expected joint1, …; lock= of jounce.load"),
    ({"q": 1.0}, "q has shape (); expected (..., 7)"),
    ({"q2d": None}, "q2d is None, yet q3d is given"),
    ({"q3d": None, "q4d": np.zeros(7)}, "q3d is None, yet q4d is given"),
    ({"q": np.zeros((3, 7)), "qd": np.zeros((4, 7))}, "batch axes do not fit together: q (3,), qd (4,)"),
    ({"q": [1j] * 7}, "q holds complex numbers; expected real"),
    ({"q": ["a"] * 7}, "q holds text"),
    ({"q": [[1.0], [1.0, 2.0]]}, "q is not an array of numbers"),
    ({"q": [None] * 7}, "q holds None"),
    ({"method": "kernal"}, "inverse_dynamics has no method 'kernal'; did you mean 'kernel'?"),
    ({"method": "recursoin"}, "did you mean 'recursion'"),
    ({"wrench": np.zeros((7, 6))}, "wrench gives W alone; order 1 takes a tuple (W, Wd)"),
    ({"wrench": ()}, "wrench gives nothing; order 1"),
    ({"wrench": (np.zeros((7, 6)),) * 3}, "wrench gives W, Wd, W2d; order 1 takes"),
    ({"wrench": ({"body1": np.zeros((2, 6)), "body2": np.zeros((3, 6))},) * 2},
     "batch axes do not fit together: bodies"),
    ({"q": {"joint1": 0.0}}, "q: missing 'joint2', 'joint3', 'joint4', 'joint5', 'joint6', 'joint7'; expected joint1"),
    ({"wrench": (np.zeros((7, 6)), np.zeros((6, 6)))}, "Wd has shape (6, 6); expected (..., 7, 6)"),
    ({"wrench": ({"hand": np.zeros(6)},) * 2}, "unknown body 'hand'; available: body0, body1"),
    ({"wrench": ({"body6": np.zeros(3)},) * 2}, "W['body6'] has shape (3,); expected (..., 6)"),
])  # fmt: skip
def test_bad_states_are_refused_in_one_line(robot, changes, message):
    refusal(lambda: bad(robot, **changes), message)


@pytest.mark.parametrize("batch", [(), (3,), (1, 2), (7,), (2, 7)])
def test_a_list_is_one_wrench_and_a_tuple_holds_its_rates(robot, batch):
    q, W = random_rates(robot.n, 3), np.random.default_rng(0).normal(size=(*batch, 7, 6))
    expected = robot.inverse_dynamics(*q, wrench=W)
    assert expected.shape == (*batch, 7)
    for same in (W.tolist(), list(W), (W,), (W.tolist(),)):
        assert (robot.inverse_dynamics(*q, wrench=same) == expected).all()
    for Q, again in zip(
        robot.inverse_dynamics(*q, q[0], wrench=(W, -W)),
        robot.inverse_dynamics(*q, q[0], wrench=(W.tolist(), (-W).tolist())),
        strict=True,
    ):
        assert (again == Q).all()


@pytest.mark.parametrize("order", [1, 2, 4])
def test_rates_of_wrenches_in_a_list_are_refused_with_the_cure(robot, order):
    q, W = random_rates(robot.n, order + 3), np.zeros((7, 6))
    with expect_refusal("^wrench gives W alone; … takes a tuple (W, Wd…); a list is one array$"):
        robot.inverse_dynamics(*q, wrench=[W] * (order + 1))


def test_wrenches_of_all_bodies_under_the_name_of_one_are_refused(robot):
    q, rng = random_rates(robot.n, 3, 7), np.random.default_rng(0)
    W, one = rng.normal(size=(7, 6)), [x[0] for x in q]
    with expect_refusal("^W['body6'] has shape (7, 6), as W of all bodies has; expected (6,)"):
        robot.inverse_dynamics(*one, wrench={"body6": W})
    for states in (q, [x[None] for x in one]):
        found = robot.inverse_dynamics(*states, wrench={"body6": W})
        for i in range(7):
            single = robot.inverse_dynamics(*(x[i % len(x)] for x in states), wrench={"body6": W[i]})
            assert relative_error(found[i], single) < 1e-13
    assert robot.inverse_dynamics(*one, wrench={"body6": W[:3]}).shape == (3, 7)
    pendulum = jounce.Robot.from_screws([np.eye(4)], [[0, 0, 1, 0, 0, 0]], [np.eye(6)])
    assert pendulum.inverse_dynamics([0], [0], [0], wrench={"body1": W[:1]}).shape == (1, 1)


TWINS = jounce.Robot.from_screws([np.eye(4)] * 2, [[0, 0, 1, 0, 0, 0]] * 2, [np.eye(6)] * 2)  # on one axis


@pytest.mark.sweep(2)
@pytest.mark.parametrize(("method", "order"), [("closed_form", 90), ("recursion", 50), ("recursion", 90)])
def test_forces_of_orders_up_to_90(method, order):
    q = [np.sin(0.3 + k * np.pi / 2) * np.array([1.0, 0.0]) for k in range(order + 3)]
    for k, Q in enumerate(TWINS.inverse_dynamics(*q, method=method)):
        np.testing.assert_allclose(Q, [2 * q[k + 2][0], q[k + 2][0]], atol=1e-12)


@pytest.mark.parametrize("quantity", [*QUANTITIES, "momentum", "base_wrench"])
def test_calls_nest_no_deeper_at_higher_orders(quantity):
    q, depth = np.ones((27, 2)), len(inspect.stack(0))
    before = sys.getrecursionlimit()
    sys.setrecursionlimit(depth + 150)
    try:
        getattr(TWINS, quantity)(*q, **{} if quantity == "jacobian" else {"method": "recursion"})
    finally:
        sys.setrecursionlimit(before)


def test_no_order_is_beyond_the_highest(robot):
    for least, call in ((3, robot.inverse_dynamics), (1, robot.mass_matrix), (1, robot.jacobian)):
        with expect_refusal("is given, for order 101; expected rates for order 0 to 100$"):
            call(*np.zeros((101 + least, 7)))


def test_what_is_missing_comes_out_as_nan_of_its_state(robot):
    """Masked by NumPy, wherever it stands, or NA of pandas: as NaN in its place."""
    q = np.random.default_rng(0).normal(size=(3, 7))
    holed, mask = q.copy(), np.zeros((3, 7), dtype=bool)
    holed[1, 2], mask[1, 2] = np.nan, True
    masked, integers = np.ma.array(q, mask=mask), np.ma.array(np.ones((3, 7), dtype=int), mask=mask)
    frame = pd.DataFrame(q, columns=robot.joint_names).astype("Float64").mask(mask)
    objects = q.astype(object)
    objects[1, 2] = pd.NA
    for method in (None, "recursion", "closed_form"):
        expected = robot.gravity_forces(holed, method=method)
        for same in (masked, list(masked), masked.astype(object), frame, objects, objects.tolist()):
            np.testing.assert_array_equal(robot.gravity_forces(same, method=method), expected)
        assert np.isnan(robot.gravity_forces(integers, method=method)).any(axis=1).tolist() == [False, True, False]
    named = {name: masked[:, j] for j, name in enumerate(robot.joint_names)}
    np.testing.assert_array_equal(robot.gravity_forces(named), robot.gravity_forces(holed))
    W = np.ma.array(np.ones((7, 6)), mask=[[True] + [False] * 5] + [[False] * 6] * 6)
    assert np.isnan(robot.inverse_dynamics(q[0], q[0], q[0], wrench=W)).any()


def test_robots_and_compiled_kernels_take_no_masked_arrays():
    B, X, M = (np.ma.array(getattr(jounce.load("planar2r").mechanism, name)) for name in "BXM")
    M[1, 3, 3] = np.ma.masked
    refusal(lambda: jounce.Robot.from_screws(B, X, M), "^M[1, 3, 3] is nan; expected finite numbers")
    kernel, q = jounce.load("planar2r").compile("gravity_forces", order=0), np.ma.array([1.0, 2.0], mask=[1, 0])
    for call in (lambda: kernel(q), lambda: kernel(q, threads=2), lambda: kernel.bind(q, out=np.zeros(2))):
        refusal(call, "takes arrays without masks")
    refusal(lambda: jounce.load("planar2r").gravity_forces([0, 0], out=q), "out[0] is masked")


def test_what_is_unknown_is_refused(robot):
    q, form = random_rates(robot.n, 7), "coriolis_matrix has no form 'skwe'; did you mean 'skew'"
    refusal(lambda: robot.coriolis_matrix(*q[:2], form="skwe"), form)
    refusal(lambda: robot.jacobian(q[0], frame="base"), "unknown frame 'base'; available: body, world, spatial")
    refusal(lambda: robot.inverse_dynamics(*q[:6], method="paper"), "up to order 2; order 3 needs")
    refusal(lambda: jounce.Robot("arm.urdf"), "^Robot() expects a Mechanism, got str; try jounce.load$")


def test_nan_in_a_state_comes_out_as_nan_of_that_state_only(robot):
    q = random_rates(robot.n, 3, 3)
    q[0][1, 2] = np.nan
    Q = robot.inverse_dynamics(*q)
    assert np.isnan(Q[1]).any()
    assert np.isfinite(Q[[0, 2]]).all()


def test_robots_travel_to_other_processes():
    robot = jounce.load("iiwa14")
    copy = pickle.loads(pickle.dumps(robot))
    q = np.random.default_rng(0).normal(size=(3, 7))
    assert (copy.inverse_dynamics(*q) == robot.inverse_dynamics(*q)).all()
    assert repr(copy) == "<Robot 'iiwa14': 7 coordinates, 7 bodies>"


PUBLIC = [name for name, _ in inspect.getmembers(jounce.Robot, inspect.isfunction) if not name.startswith("_")]


@pytest.mark.parametrize("name", PUBLIC)
def test_calls_that_python_refuses_name_the_method(name):
    with pytest.raises(TypeError, match=rf"^\w+\.{name}\(\) (got an unexpected keyword|missing \d)"):
        getattr(jounce.Robot, name)(None, no_such_keyword=1)


def test_public_names():
    robot = jounce.load("iiwa14")
    assert (robot.n, robot.joint_names[0], robot.body_names[-1]) == (7, "joint1", "link7")
    assert robot.gravity.tolist() == [0, 0, -9.80665]
    assert robot.name == "iiwa14"
    assert set(jounce.__all__) >= {"load", "load_motion", "Robot", "inertia_matrix", "JounceError", "JounceWarning"}
    assert issubclass(jounce.JounceWarning, Warning)


def test_robots_that_come_and_go_take_no_more_memory():
    """What is kept of the last ones is bounded; native code, which is not counted here, goes with its robot."""

    def in_use(masses):
        for m1 in masses:
            robot = jounce.load("planar2r", m1=m1)
            robot.gravity_forces(np.zeros(2), method="recursion")
            robot.mass_matrix(np.zeros(2), method="closed_form")
        gc.collect()
        return tracemalloc.get_traced_memory()[0]

    tracemalloc.start()
    try:
        first, then = in_use(np.linspace(1, 2, 70)), in_use(np.linspace(3, 4, 20))
    finally:
        tracemalloc.stop()
    assert then < 1.05 * first
