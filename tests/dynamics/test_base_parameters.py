"""Base parameters, found without states, are as many as the regressor has independent columns at random states."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import qr

import jounce
from jounce.dynamics import loop_assembly
from jounce.dynamics.base_parameters import base_parameters
from jounce.model import body_parameters, equivalent_mechanisms
from jounce.model.frame import Frame
from jounce.spatial import inertia
from support.bases import random_base
from support.refusals import refusal
from support.robots import floating, mechanisms, random_mechanism, random_pose, relative_error
from support.several_named import KINDS, PARENTS, named_robot, states
from support.units import SI

AXES = [s * e for e in np.eye(3) for s in (1, -1)]


def columns_of_regressor(m, count=40):
    """Of one size each, at random states."""
    rng = np.random.default_rng(1)
    q = rng.uniform(-2, 2, (3, count, m.n))
    base = random_base(rng, 3) if m.floats else None
    base = base and (base[0], *rng.uniform(-2, 2, (2, count, 6)))
    Y = jounce.Robot(m).regressor(*q, base=base, method="recursion")
    return Y.reshape(-1, Y.shape[-1])


def check(m):
    """As many as singular values, and as pivots of QR, that are not rounding; random axes may be nearly parallel."""
    found, Y = base_parameters(m), columns_of_regressor(m)
    sizes = np.linalg.norm(Y, axis=0)
    Y = Y / np.where(sizes > 1e-12 * sizes.max(initial=1), sizes, 1)
    s = np.append(np.linalg.svd(Y, compute_uv=False), 0.0) / np.sqrt(len(Y))
    pivots = np.append(np.abs(np.diag(qr(Y, mode="r", pivoting=True)[0])), 0.0)
    smallest = s[found.count - 1] if found.count else 1.0
    assert smallest > 1e-11
    assert max(s[found.count], pivots[found.count]) < 1e-13
    named = np.linalg.svd(Y[:, found.columns], compute_uv=False)
    assert named.min(initial=1) > 1e-11
    matrix = found.matrix * np.where(sizes > 0, sizes, 1)[found.columns, None] / np.where(sizes > 0, sizes, 1)
    assert np.abs(Y - Y[:, found.columns] @ matrix).max() * smallest < 1e-12
    np.testing.assert_array_equal(found.matrix[:, found.columns], np.eye(found.count))
    return found


@st.composite
def special(draw, floats=True):
    """Trees whose axes are parallel or at right angles, many of them intersecting, gravity along one."""
    m, rng = draw(mechanisms(largest=4, units=st.just(SI)))
    turns = [draw(st.permutations(range(3))) for _ in range(m.nb)]
    B, X = np.array(m.B), np.zeros((m.nb, 6))
    for i, turn in enumerate(turns):
        R = np.eye(3)[list(turn)]
        B[i, :3, :3] = R * np.linalg.det(R)
        B[i, :3, 3] *= np.array(draw(st.tuples(*[st.booleans()] * 3)))
        X[i, 3 * (not m.X[i, :3].any()) :][:3] = AXES[draw(st.integers(0, 5))]
    m = replace(m, B=B, X=X, gravity=9.81 * AXES[draw(st.integers(0, 5))] * draw(st.booleans()))
    return floating(m, rng) if floats and draw(st.booleans()) else m


@given(special())
def test_they_are_as_many_as_independent_columns(m):
    check(m)


@settings(max_examples=12)
@given(mechanisms(units=st.just(SI)))
def test_they_are_as_many_for_axes_in_general_position(drawn):
    check(drawn[0])


@pytest.mark.parametrize(
    ("name", "base", "count"),
    [("iiwa14", None, 43), ("g1", None, 189), ("g1", "floating", 213), ("solo12", "floating", 94)],
)
def test_those_of_real_robots_are_as_many_as_measured(name, base, count):
    m = jounce.load(name, base=base).mechanism
    assert base_parameters(m).count == count


def test_a_joint_that_follows_by_the_factor_0_is_as_good_as_locked():
    m = jounce.load("panda").mechanism
    G = np.array(m.G)
    G[m.joints.index("panda_finger_joint2")] = 0
    check(replace(m, G=G))


@given(special(floats=False).filter(lambda m: m.nb > 1), st.integers(0, 3), st.integers(0, 2**16))
def test_a_joint_with_the_factor_0_leaves_those_of_the_locked_robot(m, joint, seed):
    """Where bodies stand still, at odd angles, columns that are zero in exact arithmetic are rounding."""
    T, joint = random_pose(np.random.default_rng(seed)), joint % m.nb
    turned = np.where((np.array(m.parent) < 0)[:, None, None], T @ m.B, m.B)
    m = replace(m, B=turned, gravity=T[:3, :3] @ m.gravity, G=np.eye(m.nb), g=np.zeros(m.nb), coordinates=m.joints)
    names = tuple(np.delete(m.joints, joint).tolist())
    still = replace(m, G=np.delete(m.G, joint, 1), g=0.4 * m.G[joint], coordinates=names)
    found = base_parameters(still)
    assert found.count == jounce.Robot(m).locked({m.joints[joint]: 0.4}).base_parameters().count
    assert np.abs(found.matrix).max(initial=0) < 1e3


@pytest.mark.parametrize(("factor", "count"), [(1e-4, 5), (3e-9, 5), (3e-10, 3)])
def test_what_hardly_moves_counts_down_to_the_rounding(factor, count):
    """A pendulum that follows another: what gravity does to it is in proportion to the factor."""
    X, M = [0, 0, 1, 0, 0, 0], jounce.inertia_matrix(1.0, [0.3, 0, 0], np.eye(3))
    geared = jounce.Robot.from_screws(
        [np.eye(4)] * 2, [X, X], [M, M], [-1, -1], G=[[1], [factor]], g=[0, 0.4], gravity=[0, -9.81, 0]
    )
    assert geared.base_parameters().count == count


def tilted_fourbar(rng):
    """Crank, coupler and rocker in any plane, whose last pin is on a body welded to the ground."""
    lengths, angles = (0.2, 0.5, 0.4), np.array([0.7, -0.6, -1.4])
    B = np.stack([random_pose(rng), *[np.eye(4)] * 3])
    B[1:, 0, 3] = lengths
    m = random_mechanism(rng, [-1, 0, 1, 2], ["revolute"] * 4, [1.0] * 4)
    m = replace(m, B=B, X=np.tile([0.0, 0, 1, 0, 0, 0], (4, 1)))
    q = np.append(angles, 0.3)
    C = jounce.Robot(m).poses(q, method="recursion")
    pin = random_pose(rng)
    m = replace(m, frames=(Frame("ground", -1, C[3] @ pin), Frame("pin", 3, pin)))
    return jounce.Robot(m).closed([("ground", "pin", "fixed")], ["joint1"], start=q)


@pytest.mark.parametrize("seed", range(6))
def test_a_body_that_is_welded_to_the_ground_by_a_loop_has_none(seed):
    robot = tilted_fourbar(np.random.default_rng(seed))
    found = robot.base_parameters()
    assert (found.count, np.abs(found.matrix).max() < 10) == (8, True)
    assert not [name for name in found.names if name.startswith("body4")]
    assert not found.matrix[:, 30:].any()
    q = loop_assembly.sample_positions(robot.mechanism, 40)
    Y = robot.regressor(q, *np.random.default_rng(seed).uniform(-2, 2, (2, 40, 1)), method="recursion")
    sizes = np.linalg.svd(Y.reshape(-1, 40), compute_uv=False)
    assert sizes[7] > 1e-6 * sizes[0] > 1e6 * sizes[8]
    np.testing.assert_allclose(Y[..., found.columns] @ found.values, Y @ robot.inertial_parameters, rtol=1e-10)


def test_joints_that_are_locked_leave_fewer():
    assert check(jounce.load("iiwa14").locked({"joint3": 0.2, "joint5": 0.1}).mechanism).count < 43


@given(special())
def test_the_regrouping_of_the_recursion_leaves_them_as_they_are(m):
    m = equivalent_mechanisms.align_frames(m)
    found, reduced = base_parameters(m), equivalent_mechanisms.reduce_inertias(m)
    p = inertia.parameters(reduced.M).ravel()
    np.testing.assert_allclose(found.matrix @ p, found.values, atol=1e-12 * max(1, np.abs(p).max()))


def test_lengths_in_millimetres_give_as_many():
    m = jounce.load("iiwa14").mechanism
    B = np.array(m.B)
    B[:, :3, 3] *= 1e-3
    assert base_parameters(replace(m, B=B)).count == 43


def test_the_table_names_what_is_combined():
    found = jounce.load("planar2r", L1=0.5).base_parameters()
    assert found.names[2] == "body1 Izz"
    assert found.combinations[2] == "body1 Izz + 0.25 body2 m"
    assert str(found).startswith("6 base parameters of 20 inertial parameters\n")
    assert not found.matrix.flags.writeable


def test_symbols_are_refused():
    sympy = pytest.importorskip("sympy")
    robot = jounce.load("planar2r", L1=sympy.Symbol("L"))
    refusal(robot.base_parameters, "contains symbols; base parameters need numbers")


@pytest.mark.sweep(3)
@pytest.mark.parametrize("kinds", [{"foot": "ball"}, {"cart": "planar"}, {"box": "free"}, KINDS])
@pytest.mark.parametrize("floats", [False, True])
def test_joints_of_several_screws(kinds, floats):
    robot = named_robot(kinds, PARENTS[: len(kinds)], floats=floats)
    x = states(robot, 3, 40)
    Y, Q = robot.regressor(*x), robot.inverse_dynamics(*x)
    p = body_parameters.inertial_parameters(robot.mechanism).ravel()
    assert relative_error(Y @ p, Q) < 1e-12
    energies = robot.kinetic_energy(*x[:2]) + robot.potential_energy(x[0])
    assert relative_error(np.sum(robot.energy_regressor(*x[:2]) * p, axis=-1), energies) < 1e-12
    s = np.linalg.svd(Y.reshape(-1, Y.shape[-1]), compute_uv=False)
    count = base_parameters(robot.mechanism).count
    assert s[count - 1] > 1e-6 * s[0]
    assert s[count:].max(initial=0) < 1e-12 * s[0]
