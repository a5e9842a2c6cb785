"""Base parameters, found without states, are as many as the regressor has independent columns at random states."""

from dataclasses import replace

import numpy as np
import pytest
from bases import random_base
from files import refusal
from hypothesis import given, settings
from hypothesis import strategies as st
from robots import floating, mechanisms
from scipy.linalg import qr

import jounce
from jounce.dynamics.base_parameters import base_parameters
from jounce.model import equivalent
from jounce.spatial import inertia

AXES = [s * e for e in np.eye(3) for s in (1, -1)]


def columns_of_regressor(m, count=40):
    """Of one size each, at random states."""
    rng = np.random.default_rng(1)
    q = rng.uniform(-2, 2, (3, count, m.n))
    base = random_base(rng, 3) if m.base else None
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
def special(draw):
    """Trees whose axes are parallel or at right angles, many of them intersecting, gravity along one."""
    m, rng = draw(mechanisms(largest=4))
    turns = [draw(st.permutations(range(3))) for _ in range(m.nb)]
    B, X = np.array(m.B), np.zeros((m.nb, 6))
    for i, turn in enumerate(turns):
        R = np.eye(3)[list(turn)]
        B[i, :3, :3] = R * np.linalg.det(R)
        B[i, :3, 3] *= np.array(draw(st.tuples(*[st.booleans()] * 3)))
        X[i, 3 * (not m.X[i, :3].any()) :][:3] = AXES[draw(st.integers(0, 5))]
    m = replace(m, B=B, X=X, gravity=9.81 * AXES[draw(st.integers(0, 5))] * draw(st.booleans()))
    return floating(m, rng) if draw(st.booleans()) else m


@settings(max_examples=20)
@given(special())
def test_they_are_as_many_as_independent_columns(m):
    check(m)


@settings(max_examples=12)
@given(mechanisms())
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


def test_joints_that_are_locked_leave_fewer():
    assert check(jounce.load("iiwa14").locked({"joint3": 0.2, "joint5": 0.1}).mechanism).count < 43


@settings(max_examples=15)
@given(special())
def test_the_regrouping_of_the_recursion_leaves_them_as_they_are(m):
    m = equivalent.align_frames(m)
    found, reduced = base_parameters(m), equivalent.base_parameters(m)
    p = inertia.parameters(reduced.inertias).ravel()
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
