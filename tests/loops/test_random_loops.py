"""Laws of random closed robots: all kinds of cut joints, loops that share joints, mimic joints, floating bases."""

import numpy as np
import pytest
from scipy.linalg import expm

import jounce
from jounce.arguments.rates import dependent_coordinates
from jounce.dynamics.loop_branches import LoopEnds
from jounce.dynamics.loops import ClosedMotion
from jounce.dynamics.partials import curvature
from jounce.model.loops import all_coordinates
from jounce.spatial.lie import wedge
from jounce.spatial.series import Series, column_series
from support.bases import base_path
from support.random_loops import LOOPED, looped
from support.robots import Interpreted, differentiated_at_once, harmonic, relative_error

NAMES = list(LOOPED)
H = 0.01  # s, of differences over nine points: with rates of all joints below 1 / s


class Moving:
    """A closed robot, its motion q(t) about the start with rates up to q4d, its base's, and wrenches on its bodies."""

    def __init__(self, name):
        closed, rng = looped(name), np.random.default_rng(7)
        self.robot, self.m = Interpreted(closed), closed.mechanism
        self.tree = Interpreted(jounce.Robot(self.m.tree))
        self.own = list(self.m.closure.independent)
        wave, self.base_path = harmonic(rng, self.m.n, 4), base_path(rng, 4)
        self.wave = lambda t: [0.05 * x for x in wave(t)]
        self.offset = self.m.closure.start[self.own] - self.wave(np.zeros(()))[0]
        self.rng, self.wrench = rng, tuple(rng.uniform(-1, 1, (3, self.m.nb, 6)))
        self.options = {"wrench": self.wrench}

    def rates(self, t):
        """q, qd, ..., q4d, and the motion of the base, if it floats."""
        q, *higher = self.wave(t)
        return [q + self.offset, *higher], {"base": self.base_path(t)} if self.m.floats else {}

    @property
    def now(self):
        q, base = self.rates(np.zeros(()))
        return q, base | self.options


@pytest.fixture(scope="module", params=NAMES)
def moving(request):
    return Moving(request.param)


def first(base, count):
    """The motion of a base with fewer rates."""
    return {key: x[:count] if key == "base" else x for key, x in base.items()}


def tangent(moving, q):
    """F, the velocities of the tree from those of the closed robot, by the coordinates' own rates."""
    n, nv = moving.m.n, moving.m.nv
    joints = np.stack([moving.robot.coordinates(q, e)[1] for e in np.eye(n)], axis=-1)
    F = np.zeros((nv - n + len(joints), nv))
    F[: nv - n, : nv - n], F[nv - n :, nv - n :] = np.eye(nv - n), joints
    return F


def test_forces_and_matrices_are_those_of_the_tree_on_the_tangent(moving):
    q, given = moving.now
    F, on_tree = tangent(moving, q[0]), moving.robot.coordinates(*q[:3])
    Q = moving.tree.inverse_dynamics(*on_tree, **first(given, 3) | {"wrench": moving.wrench[0]})
    found = moving.robot.inverse_dynamics(*q, **given)
    assert relative_error(found[0], F.T @ Q) < 1e-12
    assert relative_error(moving.robot.mass_matrix(q[0]), F.T @ moving.tree.mass_matrix(on_tree[0]) @ F) < 1e-12


def test_rates_are_derivatives_along_the_motion(moving):
    def along(t):
        q, base = moving.rates(t)
        return np.stack(moving.robot.inverse_dynamics(*q[:4], **first(base, 4), wrench=(W, 0 * W)), axis=1)

    (q, given), W = moving.now, moving.wrench[0]
    _, *found = moving.robot.inverse_dynamics(*q, **given | {"wrench": (W, 0 * W, 0 * W)})
    assert relative_error(found, differentiated_at_once(along, H)) < 1e-8


def test_power_is_the_rate_of_the_energy(moving):
    """Without drives, which dissipate; the wrench on a base that floats has power too."""
    q, base = moving.rates(np.zeros(()))
    robot = Interpreted(moving.robot.robot.with_drives(False))
    kinetic = robot.kinetic_energy(*q[:3], **first(base, 3))[1]
    gain = kinetic + robot.potential_energy(*q[:2], **first(base, 2))[1]
    velocities = np.concatenate([base["base"][1], q[1]]) if base else q[1]
    assert abs(robot.inverse_dynamics(*q[:3], **first(base, 3)) @ velocities - gain) < 1e-12 * abs(gain)


def test_forward_dynamics_inverts_inverse_dynamics(moving):
    q, given = moving.now
    Q = moving.robot.inverse_dynamics(*q, **given)
    found = moving.robot.robot.forward_dynamics(
        *q[:2], *Q, **first(given, 2), method="closed_form" if moving.m.acting else "recursion"
    )
    expected = q[2:] if not moving.m.floats else [np.concatenate(x) for x in zip(given["base"][2:], q[2:], strict=True)]
    for x, y in zip(found, expected, strict=True):
        assert relative_error(x, y) < 1e-9


def test_partial_derivatives_are_those_of_differences(moving):
    """Along one direction of all rates of q, and of the base: dQ^(k) = sum of P[j] dq^(j)."""
    q, given = moving.now
    directions = moving.rng.uniform(-1, 1, (5, moving.m.nv))

    def along(t):
        moved = [x + np.multiply.outer(t, d[-moving.m.n :]) for x, d in zip(q, directions, strict=True)]
        base = {}
        if moving.m.floats:
            C, *V = given["base"]
            X = np.array([expm(s * wedge(directions[0, :6])) for s in t])
            base = {"base": (C @ X, *(x + np.multiply.outer(t, d[:6]) for x, d in zip(V, directions[1:], strict=True)))}
        return np.stack(moving.robot.inverse_dynamics(*moved, **given | base), axis=1)

    differences = differentiated_at_once(along, 0.003)
    for method in ("recursion", "closed_form"):
        partials = moving.robot.robot.inverse_dynamics_partials(*q, **given, method=method)
        for P, expected in zip(partials, differences, strict=True):
            assert relative_error(np.einsum("jab,jb->a", P, directions[: len(P)]), expected) < 1e-7
    M = moving.robot.mass_matrix(q[0])
    np.testing.assert_allclose(partials[0][2], M, atol=1e-12 * np.abs(M).max())


@pytest.fixture
def closed_motion(moving):
    """The motion of the tree now."""
    q, _ = moving.now
    position = all_coordinates(moving.m.closure, q[0], dependent_coordinates(moving.m, q[0], None))
    return ClosedMotion(moving.m, column_series(q), position[:, None])


def test_constraints_of_screws_are_those_of_sweeps(moving, closed_motion):
    """A and its rates by the screws that the ends see, and by twists and wrenches from joint to joint."""
    ends = LoopEnds(moving.m, closed_motion.q)
    outward = ends.constrain(Series.constant(np.eye(moving.m.tree.n)))
    inward = ends.forces(Series.constant(np.eye(len(ends.A[0])))).mT
    for k in range(4):
        assert relative_error(ends.A[k], outward[k]) < 1e-12
        assert relative_error(ends.A[k], inward[k]) < 1e-12


def test_curvature_along_closed_loops_is_symmetric(moving, closed_motion):
    """Whatever cut joints exert: second derivatives of the gaps are."""
    ends = LoopEnds(moving.m, closed_motion.q)
    y = Series.constant(moving.rng.uniform(-1, 1, (len(ends.A[0]), 1)))
    F = closed_motion.F.map(lambda F: F[-moving.m.tree.n :])
    along = F.mT @ curvature(ends, y) @ F
    for k in range(3):
        assert np.abs(along[k] - along[k].T).max() <= 1e-11 * np.abs(along[k]).max()


def test_partials_of_forward_dynamics_agree_with_differences(moving):
    (q, qd, *_), given = moving.now
    given, n = first(given, 2) | {"wrench": moving.wrench[0]}, moving.m.n
    Q, direction = moving.rng.uniform(-1, 1, (2, moving.m.nv))
    dq, dqd, Minv = moving.robot.forward_dynamics_partials(q, qd, Q, **given)
    d, dd = moving.rng.uniform(-1, 1, (2, n))

    def along(t):
        moved = (x + np.multiply.outer(t, y) for x, y in ((q, d), (qd, dd), (Q, direction)))
        return moving.robot.forward_dynamics(*moved, **given)

    expected = dq[:, -n:] @ d + dqd[:, -n:] @ dd + Minv @ direction
    assert relative_error(expected, differentiated_at_once(along, 0.003)) < 1e-7
