"""Momentum, what the ground feels, and loads on bodies: against Newton, Euler and potential energies."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given

import jounce
from jounce.core.errors import JounceWarning
from jounce.spatial import lie
from support.comparisons import assert_close
from support.quantities import tupled
from support.refusals import expect_refusal
from support.robots import Interpreted, differentiated_at_once, harmonic, mechanisms, relative_error, with_tool


@given(drawn=mechanisms())
def test_momentum_is_that_of_the_moving_mass(drawn):
    """Linear: m_i times the velocity of the COM; angular: with the tensors turned into inertial axes."""
    mechanism, rng = drawn
    robot, path = Interpreted(jounce.Robot(mechanism)), harmonic(rng, mechanism.n, 1)
    q, qd = path(0)
    h = robot.momentum(q, qd)
    J, C = robot.jacobian(q, frame="world"), robot.poses(q)
    expected = np.zeros(6)
    for J_i, C_i, M in zip(J, C, mechanism.M, strict=True):
        w, v = (J_i @ qd)[:3], (J_i @ qd)[3:]
        R, r, m, first = C_i[:3, :3], C_i[:3, 3], M[3, 3], C_i[:3, :3] @ lie.axial(M[:3, 3:]) / 2
        p = m * v + np.cross(w, first)
        about_origin = R @ M[:3, :3] @ R.T @ w + np.cross(first, v)
        expected += np.concatenate([about_origin + np.cross(r, p), p])
    assert_close(h, expected)


@given(drawn=mechanisms())
def test_rates_of_momentum_and_base_wrench(drawn):
    mechanism, rng = drawn
    robot, path = Interpreted(jounce.Robot(mechanism)), harmonic(rng, mechanism.n, 5)
    w = harmonic(rng, 6 * mechanism.nb, 3)

    def loads(t, order):
        return tuple(x.reshape(*x.shape[:-1], -1, 6) for x in w(t)[: order + 1])

    h = robot.momentum(*path(0)[:4])
    F = robot.base_wrench(*path(0)[:5], wrench=loads(0, 2))
    for k in (1, 2):
        below = differentiated_at_once(lambda t, k=k: tupled(robot.momentum(*path(t)[: k + 1]))[-1])
        assert_close(h[k], below, 1e-8)
        below = differentiated_at_once(
            lambda t, k=k: tupled(robot.base_wrench(*path(t)[: k + 2], wrench=loads(t, k - 1)))[-1]
        )
        assert_close(F[k], below, 1e-8)


@given(drawn=mechanisms())
def test_base_wrench_is_the_rate_of_momentum_less_gravity_and_loads(drawn):
    mechanism, rng = drawn
    robot = Interpreted(jounce.Robot(mechanism))
    q, qd, q2d = rng.normal(size=(3, mechanism.n))
    W = rng.normal(size=(mechanism.nb, 6))
    _, hd = robot.momentum(q, qd, q2d)
    C = robot.poses(q)
    expected = hd.copy()
    for C_i, M, W_i in zip(C, mechanism.M, W, strict=True):
        weight, com = M[3, 3] * robot.gravity, C_i[:3, 3] * M[3, 3] + C_i[:3, :3] @ lie.axial(M[:3, 3:]) / 2
        expected -= np.concatenate([np.cross(com, robot.gravity), weight])
        expected += lie.Ad(lie.inverse(C_i)).T @ W_i
    assert_close(robot.base_wrench(q, qd, q2d, wrench=W), expected)


def test_what_the_ground_feels_of_a_balanced_mechanism_is_constant():
    """A 2R with its COM on both axes by counterweights, and a twin that turns the other way."""
    link = jounce.inertia_matrix(2.0, [0, 0, 0], np.diag([0.01, 0.02, 0.03]))  # COM on its own axis
    arm = jounce.inertia_matrix(1.5, [-1.0, 0, 0], np.diag([0.05, 0.06, 0.07]))  # carries link 2 at x = 0.75
    B = np.stack([np.eye(4)] * 4)
    B[[1, 3], 0, 3] = 0.75
    mirror = np.diag([1.0, -1.0, -1.0, 1.0])
    B[2] = mirror @ B[2]  # the twin turns about -z: equal coordinates, opposite momentum
    robot = jounce.Robot.from_screws(
        B, [[0, 0, 1, 0, 0, 0]] * 4, [arm, link, arm, link], [-1, 0, -1, 2], gravity=(0, -9.81, 0),
        G=[[1, 0], [0, 1], [1, 0], [0, 1]],
    )  # fmt: skip
    rng = np.random.default_rng(0)
    F, Fd, F2d = robot.base_wrench(*rng.normal(size=(5, 50, 2)))
    weight = robot.mechanism.M[:, 3, 3].sum() * 9.81
    assert_close(F, np.broadcast_to([0, 0, 0, 0, weight, 0], (50, 6)), 1e-13)
    assert np.abs(Fd).max() < 1e-12
    assert np.abs(F2d).max() < 1e-11
    unbalanced = jounce.load("planar2r").base_wrench(*rng.normal(size=(5, 50, 2)))
    assert np.ptp(unbalanced[0], axis=0).max() > 1


@given(drawn=mechanisms())
def test_a_constant_load_is_the_gradient_of_its_potential_energy(drawn):
    """-f . x(q), at a point of a merged link: Qext is its gradient, and the rates of Qext those of the gradient."""
    robot, rng, _ = with_tool(drawn)
    f, p = rng.normal(size=(2, 3))
    path = harmonic(rng, robot.n, 4)

    def potential(q):
        return -(robot.poses(q, body="tool") @ [*p, 1])[..., :3] @ f

    def gradient(t):  # along every coordinate
        q, steps = path(t)[0][..., None, :], (1,) * np.ndim(t) + (robot.n, robot.n)
        return differentiated_at_once(lambda s: potential(q + np.multiply.outer(s, np.eye(robot.n).reshape(steps))))

    W = robot.wrench(*path(0)[:3], body="tool", force=f, point=p)
    with_load = robot.inverse_dynamics(*path(0), wrench=W)
    extra = [Q - Q_0 for Q, Q_0 in zip(with_load, robot.inverse_dynamics(*path(0)), strict=True)]
    scale = 1 + max(np.abs(Q).max() for Q in with_load)
    assert np.abs(extra[0] - gradient(0)).max() < 1e-9 * scale
    assert np.abs(extra[1] - differentiated_at_once(gradient, 0.05)).max() < 1e-7 * scale


@pytest.mark.parametrize("frame", ["world", "body"])
@given(drawn=mechanisms())
def test_rates_of_a_wrench_are_its_time_derivatives(frame, drawn):
    robot, rng, _ = with_tool(drawn)
    path, load = harmonic(rng, robot.n, 3), harmonic(rng, 6, 3)
    p = rng.normal(size=3)

    def W(t, order):
        rates = load(t)[: order + 1]
        given = {"force": tuple(x[..., :3] for x in rates), "torque": tuple(x[..., 3:] for x in rates)}
        found = robot.wrench(*path(t)[: order + 1], body="tool", frame=frame, point=p, **given)
        return found if order == 0 else found[-1]

    for k in (1, 2):
        assert_close(W(0, k), differentiated_at_once(lambda t, k=k: W(t, k - 1)), 1e-8)


@given(drawn=mechanisms())
def test_a_wrench_does_the_work_of_its_load(drawn):
    """Qext qd = -(force . velocity of the point + torque . angular velocity)."""
    robot, rng, _ = with_tool(drawn)
    q, qd, f, tau, p = rng.normal(size=robot.n), rng.normal(size=robot.n), *rng.normal(size=(3, 3))
    W = robot.wrench(q, body="tool", force=f, torque=tau, point=p)
    J = robot.jacobian(q, body="tool", frame="world")
    arm = robot.poses(q, body="tool")[:3, :3] @ p
    w, v = (J @ qd)[:3], (J @ qd)[3:]
    power = f @ (v + np.cross(w, arm)) + tau @ w
    Qext = robot.inverse_dynamics(q, qd, qd, wrench=W) - robot.inverse_dynamics(q, qd, qd)
    assert abs(Qext @ qd + power) < 1e-10 * (1 + abs(power) + np.abs(robot.inverse_dynamics(q, qd, qd)).max())


@pytest.mark.parametrize("label", ["force", "torque"])
def test_a_list_is_one_load_and_a_tuple_holds_its_rates(label):
    robot, rng = jounce.load("iiwa14"), np.random.default_rng(3)
    q, f = rng.normal(size=(3, 7)), rng.normal(size=(4, 2, 3))

    def wrench(load):
        return robot.wrench(*q, body="link5", **{label: load})

    for load in (f, f[0, 0], f[:1, 0]):
        for W, expected in zip(wrench(load.tolist()), wrench(load), strict=True):
            assert (expected == W).all()
    assert (wrench(tuple(f[0, 0]))[2] == wrench(f[0, 0])[2]).all()  # of scalars: one vector, no rates
    for W, expected in zip(wrench(tuple(f[:3].tolist())), wrench(tuple(f[:3])), strict=True):
        assert (expected == W).all()


def test_a_list_of_loads_that_looks_like_rates_is_told():
    robot = jounce.load("iiwa14")
    q, f = np.zeros((2, 7)), [[0, 0, 1], [0, 0, 2]]
    with pytest.warns(JounceWarning, match="force is a list of 2 vectors, read as a batch; a tuple"):
        assert robot.wrench(*q, body="link5", force=f)[0].shape == (2, 7, 6)
    robot.wrench(*q[:, None], body="link5", force=f)  # a batch, as the state says
    robot.wrench(*q, body="link5", force=np.array(f))
    robot.wrench(q[0], body="link5", force=f)


def test_loads_take_batches_and_links_on_the_ground():
    robot = jounce.load("iiwa14")
    rng = np.random.default_rng(1)
    q, qd, f = rng.normal(size=(4, 7)), rng.normal(size=(4, 7)), rng.normal(size=(3, 1, 3))
    W, Wd = robot.wrench(q, qd, body="link5", force=f)
    assert W.shape == Wd.shape == (3, 4, 7, 6)
    one, _ = robot.wrench(q[2], qd[2], body="link5", force=f[1, 0])
    assert relative_error(W[1, 2], one) < 1e-13
    assert not W[:, :, [0, 1, 2, 3, 5, 6]].any()
    panda = jounce.load(Path(__file__).parents[2] / "examples" / "panda.urdf")
    assert not panda.wrench(np.zeros(8), body="panda_link0", force=(0, 0, 1)).any()


def test_a_point_without_a_force_is_warned_of():
    with pytest.warns(JounceWarning, match="^point has no effect on a torque"):
        jounce.load("iiwa14").wrench(np.zeros(7), body="link5", torque=(0, 0, 1), point=(0, 0, 1))


@pytest.mark.parametrize(("options", "message"), [
    ({"body": "link8"}, "unknown body 'link8'; did you mean 'link7'"),
    ({"frame": "spatial"}, "unknown frame of a load 'spatial'; available: world, body"),
    ({"force": (0, 0)}, "force has shape (2,); expected (..., 3)"),
    ({"force": ([0, 0, 1],) * 3}, "force gives 3 terms; order 1 takes it and its rates, 2 terms"),
    ({"torque": 1.0}, "torque has shape (); expected"),
    ({"force": None}, "neither force nor torque is given; expected force=, torque= or both"),
    ({"point": [[0, 0, 0]]}, "point has shape (1, 3); expected (3,)"),
    ({"force": np.zeros((2, 3)), "torque": np.zeros((5, 3))}, "batch axes do not fit together: torque (5,)"),
])  # fmt: skip
def test_bad_loads_are_refused_in_one_line(options, message):
    robot = jounce.load("iiwa14")
    with expect_refusal(message):
        robot.wrench(np.zeros(7), np.zeros(7), **{"body": "link7", "force": (0, 0, 1)} | options)
