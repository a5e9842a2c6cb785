"""The facade: the one rule of rates, paths, batches, `out=`, and errors that say what came and what was expected."""

import pickle

import numpy as np
import pytest
from hypothesis import given

import jounce
from jounce.errors import JounceError
from robots import golden, mechanisms, random_state, relative_error

METHODS = ("recursion", "closed_form", "paper")
QUANTITIES = {  # the fewest rates each takes, and the shape of its result
    "inverse_dynamics": (3, (7,)),
    "mass_matrix": (1, (7, 7)),
    "coriolis_matrix": (2, (7, 7)),
    "gravity_forces": (1, (7,)),
    "jacobian": (1, (7, 6, 7)),
}


@pytest.fixture(scope="module")
def robot():
    return jounce.Robot(golden("tree7")[0])


def state(robot, batch=(), rates=7, seed=0):
    return list(np.random.default_rng(seed).uniform(-2, 2, (rates, *batch, robot.n)))


@pytest.mark.parametrize("quantity", QUANTITIES)
def test_each_further_rate_returns_one_more_time_derivative(robot, quantity):
    least, shape = QUANTITIES[quantity]
    compute, q = getattr(robot, quantity), state(robot)
    plain = compute(*q[:least])
    assert isinstance(plain, np.ndarray)
    assert plain.shape == shape
    for further in range(1, 5):
        results = compute(*q[: least + further])
        assert isinstance(results, tuple)
        assert len(results) == 1 + further
        assert relative_error(results[0], plain) < 1e-14  # native code of another order rounds otherwise


@pytest.mark.parametrize("method", METHODS)
def test_every_path_gives_the_same(robot, method):
    q, W = random_state(np.random.default_rng(1), robot.mechanism)
    for found, expected in zip(
        robot.inverse_dynamics(*q, wrench=tuple(W), method=method),
        robot.inverse_dynamics(*q, wrench=tuple(W)),
        strict=True,
    ):
        assert relative_error(found, expected) < 1e-13
    for quantity in ("mass_matrix", "gravity_forces"):
        compute = getattr(robot, quantity)
        for found, expected in zip(compute(*q[:3], method=method), compute(*q[:3]), strict=True):
            assert relative_error(found, expected) < 1e-12


def test_both_forms_of_the_coriolis_matrix(robot):
    q = state(robot)
    M, Md = robot.mass_matrix(*q[:2])
    C, Cbar = (robot.coriolis_matrix(*q[:2], form=form) for form in ("paper", "skew"))
    assert relative_error(C @ q[1], Cbar @ q[1]) < 1e-13
    assert np.abs(Md - Cbar - Cbar.T).max() < 1e-13 * np.abs(Md).max()
    assert np.abs(Md - C - C.T).max() > 0.1
    for found, expected in zip(
        robot.coriolis_matrix(*q[:4], method="paper"), robot.coriolis_matrix(*q[:4]), strict=True
    ):
        assert relative_error(found, expected) < 1e-12
    assert relative_error(robot.inverse_dynamics(*q[:3]), M @ q[2] + C @ q[1] + robot.gravity_forces(q[0])) < 1e-13


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("batch", [(), (1,), (3, 2), (0,)])
def test_batches_give_what_a_loop_gives(robot, method, batch):
    q, W = state(robot, batch, 5), [np.random.default_rng(k).normal(size=(*batch, 7, 6)) for k in range(3)]
    found = robot.inverse_dynamics(*q, wrench=tuple(W), method=method)
    for Q in found:
        assert Q.shape == (*batch, 7)
    for i in np.ndindex(batch):
        one = robot.inverse_dynamics(*(x[i] for x in q), wrench=tuple(w[i] for w in W), method=method)
        for Q, expected in zip(found, one, strict=True):
            assert relative_error(Q[i], expected) < 1e-13


@given(drawn=mechanisms(largest=3))
def test_batches_of_every_quantity_have_their_shape_and_values(drawn):
    """Also where a quantity depends on no state, as the mass matrix of a gantry or a single pendulum."""
    mechanism, rng = drawn
    robot, q = jounce.Robot(mechanism), rng.uniform(-2, 2, (4, 3, mechanism.n))
    for quantity, (least, _) in QUANTITIES.items():
        compute = getattr(robot, quantity)
        for method in METHODS if quantity not in ("jacobian", "coriolis_matrix") else (None,):
            options = {"method": method} if method else {}
            found = compute(*q[: least + 1], **options)
            for i in range(3):
                for x, one in zip(found, compute(*(x[i] for x in q[: least + 1]), **options), strict=True):
                    assert x.shape == (3, *one.shape)
                    assert np.abs(x[i] - one).max() < 1e-12 * (1 + np.abs(one).max())


@pytest.mark.parametrize("method", ["recursion", "closed_form"])
def test_ten_thousand_states(method):
    robot = jounce.load("planar2r" if method == "closed_form" else "iiwa14")
    q = state(robot, (10_000,), 5)
    found = robot.inverse_dynamics(*q, method=method)
    for i in range(0, 10_000, 487):
        for Q, expected in zip(found, robot.inverse_dynamics(*(x[i] for x in q), method=method), strict=True):
            assert relative_error(Q[i], expected) < 1e-13


def test_long_batches_are_worked_in_pieces_without_a_seam(robot, monkeypatch):
    q, W = state(robot, (5, 7), 5), np.random.default_rng(3).normal(size=(7, 6))
    whole = robot.inverse_dynamics(*q, wrench=(W, W, W))
    monkeypatch.setattr("jounce.evaluation.PIECE", 8 * 4 * 7 * 4)  # four states a piece: the last one ragged
    pieces = robot.inverse_dynamics(*q, wrench=(W, W, W))
    for a, b in zip(whole, pieces, strict=True):
        assert relative_error(b, a) < 1e-14


def test_batch_axes_broadcast(robot):
    q = state(robot, (4,), 5)
    q[1], q[2] = q[1][0], q[2][:1]
    W = np.random.default_rng(0).normal(size=(3, 1, 7, 6))
    found = robot.inverse_dynamics(*q[:3], wrench=W)
    assert found.shape == (3, 4, 7)
    one = robot.inverse_dynamics(q[0][2], q[1], q[2][0], wrench=W[1, 0])
    assert relative_error(found[1, 2], one) < 1e-13


def test_memory_order_integers_and_short_floats_do_not_matter(robot):
    q = state(robot, (6,), 5)
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
    q, W = state(robot, (3,), 5), np.ones((7, 6))
    copies = [x.copy() for x in q]
    for x in (*q, W):
        x.flags.writeable = False
    robot.inverse_dynamics(*q, wrench=(W, W, W))
    assert all((x == y).all() for x, y in zip(q, copies, strict=True))
    with pytest.raises(ValueError, match="read-only"):
        robot.mechanism.M[0, 0, 0] = 1.0


def test_results_are_written_into_out(robot):
    q = state(robot, (4,), 5)
    expected = robot.inverse_dynamics(*q)
    out = tuple(np.full((4, 7), np.nan) for _ in range(3))
    results = robot.inverse_dynamics(*q, out=out)
    assert all(r is o for r, o in zip(results, out, strict=True))
    assert all((o == e).all() for o, e in zip(out, expected, strict=True))
    M = np.zeros((4, 7, 7))
    assert robot.mass_matrix(q[0], out=M) is M
    view = np.zeros((4, 14))[:, ::2]
    assert (robot.gravity_forces(q[0], out=view) == view).all()


@pytest.mark.parametrize(
    ("out", "message"),
    [
        ((np.zeros((4, 7)),), "out has 1 arrays; expected 2"),
        (
            (np.zeros((4, 7)), np.zeros((7, 4))),
            r"out\[1\] has shape \(7, 4\); expected a NumPy array of shape \(4, 7\)",
        ),
        ((np.zeros((4, 7)), [[0.0] * 7] * 4), r"out\[1\] has type list"),
        ((np.zeros((4, 7)), np.zeros((4, 7), dtype=int)), r"out\[1\] is of dtype int64"),
        ((np.zeros((4, 7)), np.broadcast_to(0.0, (4, 7))), r"out\[1\] is read-only"),
        ((np.zeros((4, 7)),) * 2, r"out\[0\] and out\[1\] share memory"),
    ],
)
def test_an_out_that_does_not_fit_is_refused_and_none_is_written(robot, out, message):
    with pytest.raises(JounceError, match=message):
        robot.inverse_dynamics(*state(robot, (4,), 4), out=out)
    assert not np.any(out[0])


def test_rates_may_be_named(robot):
    q, qd, q2d, q3d, q4d = state(robot, (), 5)
    named = robot.inverse_dynamics(q=q, qd=qd, q2d=q2d, q3d=q3d, q4d=q4d)
    assert all((a == b).all() for a, b in zip(named, robot.inverse_dynamics(q, qd, q2d, q3d, q4d), strict=True))
    assert isinstance(robot.inverse_dynamics(q, qd, q2d, None), np.ndarray)


def bad(robot, **changes):
    given = dict(zip(("q", "qd", "q2d", "q3d"), state(robot, (), 4), strict=True)) | changes
    return robot.inverse_dynamics(**given)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"qd": np.zeros(6)}, r"qd has shape \(6,\); expected \(\.\.\., 7\): joint1, joint2"),
        ({"q": 1.0}, r"q has shape \(\); expected \(\.\.\., 7\)"),
        ({"q2d": None}, "q2d is None, yet q3d is given"),
        ({"q3d": None, "q4d": np.zeros(7)}, "q3d is None, yet q4d is given"),
        ({"q": np.zeros((3, 7)), "qd": np.zeros((4, 7))}, r"batch axes do not fit together: q \(3,\), qd \(4,\)"),
        ({"q": [1j] * 7}, "q holds complex numbers; expected real"),
        ({"q": ["a"] * 7}, "q holds text"),
        ({"q": [[1.0], [1.0, 2.0]]}, "q is not an array of numbers"),
        ({"q": [None] * 7}, "q holds None"),
        ({"method": "kernal"}, r"no method for inverse_dynamics 'kernal'; did you mean 'kernel'\?"),
        ({"method": "recursoin"}, "did you mean 'recursion'"),
        ({"wrench": np.zeros((7, 6))}, "wrench gives W; order 1 takes W and its rates up to Wd"),
        ({"wrench": ()}, "wrench gives nothing; order 1"),
        ({"wrench": (np.zeros((7, 6)),) * 3}, "wrench gives W, Wd, W2d; order 1 takes"),
        (
            {"wrench": ({"body1": np.zeros((2, 6)), "body2": np.zeros((3, 6))},) * 2},
            "batch axes do not fit together: bodies",
        ),
        (
            {"q": {"joint1": 0.0}},
            "q: missing .joint2., .joint3., .joint4., .joint5., .joint6., .joint7.; expected joint1",
        ),
        ({"wrench": (np.zeros((7, 6)), np.zeros((6, 6)))}, r"Wd has shape \(6, 6\); expected \(\.\.\., 7, 6\)"),
        ({"wrench": ({"hand": np.zeros(6)},) * 2}, "no body 'hand'; there are: body0, body1"),
        ({"wrench": ({"body6": np.zeros(3)},) * 2}, r"W\['body6'\] has shape \(3,\); expected \(\.\.\., 6\)"),
    ],
)
def test_bad_states_are_refused_in_one_line(robot, changes, message):
    with pytest.raises(JounceError, match=message) as refusal:
        bad(robot, **changes)
    assert "\n" not in str(refusal.value)


def test_one_wrench_may_be_rows_of_numbers(robot):
    q, W = state(robot, (), 3), np.random.default_rng(0).normal(size=(7, 6))
    assert (robot.inverse_dynamics(*q, wrench=W.tolist()) == robot.inverse_dynamics(*q, wrench=W)).all()
    assert (robot.inverse_dynamics(*q, wrench=[W]) == robot.inverse_dynamics(*q, wrench=W)).all()


def test_a_robot_is_made_of_a_mechanism():
    with pytest.raises(JounceError, match="not of str"):
        jounce.Robot("arm.urdf")


def test_unknown_forms_frames_and_orders_are_refused(robot):
    q = state(robot)
    with pytest.raises(JounceError, match="no form of the Coriolis matrix 'skwe'; did you mean 'skew'"):
        robot.coriolis_matrix(*q[:2], form="skwe")
    with pytest.raises(JounceError, match="no frame 'base'; there are: body, world, spatial"):
        robot.jacobian(q[0], frame="base")
    with pytest.raises(JounceError, match="up to order 2; order 3 needs"):
        robot.inverse_dynamics(*q[:6], method="paper")


def test_nan_in_a_state_comes_out_as_nan_of_that_state_only(robot):
    q = state(robot, (3,), 3)
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


def test_public_names():
    robot = jounce.load("iiwa14")
    assert (robot.n, robot.joint_names[0], robot.body_names[-1]) == (7, "joint1", "link7")
    assert robot.gravity.tolist() == [0, 0, -9.80665]
    assert robot.name == "iiwa14"
    assert set(jounce.__all__) >= {"load", "load_motion", "Robot", "inertia_matrix", "JounceError", "JounceWarning"}
    assert issubclass(jounce.JounceWarning, Warning)
