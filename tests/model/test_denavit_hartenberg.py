"""Denavit-Hartenberg tables: published ones against URDFs of the same robots, each convention against elementary
turns and slides and against the other, arrays and files alike; and every table that is none."""

from importlib import metadata
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import sympy
from hypothesis import given
from hypothesis import strategies as st

import jounce
from jounce.spatial import inertia, lie
from support.refusals import refusal
from support.robots import Interpreted, random_inertia, random_pose, relative_error

ROOT = Path(__file__).parents[2]
FILES = {Path(file).name: Path(file.locate()) for file in metadata.files("example-robot-data") or []}
RIGHT = np.pi / 2

# Universal Robots, "DH parameters for calculations of kinematics and dynamics": theta, d, a, alpha of the standard form
UR5 = {"d": [0.089159, 0, 0, 0.10915, 0.09465, 0.0823], "a": [0, -0.425, -0.39225, 0, 0, 0]}
UR10 = {"d": [0.1273, 0, 0, 0.163941, 0.1157, 0.0922], "a": [0, -0.612, -0.5723, 0, 0, 0]}
UR_ALPHA = [RIGHT, 0, 0, RIGHT, -RIGHT, 0]
# Franka Emika, "Denavit-Hartenberg parameters" of the Panda: Craig's form, the flange 0.107 m behind joint 7
PANDA = {"a": [0, 0, 0, 0.0825, -0.0825, 0, 0.088], "d": [0.333, 0, 0.316, 0, 0.384, 0, 0]}
PANDA_ALPHA = [0, -RIGHT, RIGHT, RIGHT, -RIGHT, RIGHT, RIGHT]
IIWA = {"alpha": [0, 90, -90, -90, 90, 90, -90], "d": [0, 0, 0.42, 0, 0.4, 0, 0]}  # the paper's, degrees


def table_rows(n, **columns):
    return [{key: columns.get(key, [0] * n)[i] for key in ("theta", "d", "a", "alpha")} for i in range(n)]


def turn_about(axis, angle):
    T = np.eye(4)
    i, j = [(1, 2), (2, 0), (0, 1)][axis]
    T[[i, j, i, j], [i, j, j, i]] = np.cos(angle), np.cos(angle), -np.sin(angle), np.sin(angle)
    return T


def slide_along(axis, length):
    T = np.eye(4)
    T[axis, 3] = length
    return T


def elementary(convention, row, kind, q):
    """The pose of a frame in the one before, of the four motions in their order."""
    a, alpha, d, theta = row
    about_z = turn_about(2, theta + q * (kind == "revolute")) @ slide_along(2, d + q * (kind == "prismatic"))
    about_x = slide_along(0, a) @ turn_about(0, alpha)
    return about_z @ about_x if convention == "standard" else about_x @ about_z


def random_table(rng, n):
    return rng.uniform([-0.5, -3, -0.5, -3], [0.5, 3, 0.5, 3], (n, 4)), list(rng.choice(["revolute", "prismatic"], n))


@pytest.mark.parametrize("convention", ["standard", "modified"])
def test_frames_are_where_the_four_motions_put_them(convention):
    rng = np.random.default_rng(3)
    table, types = random_table(rng, 6)
    assert len(set(types)) == 2
    base, tool, q = random_pose(rng), random_pose(rng), rng.uniform(-2, 2, 6)
    M = [random_inertia(rng, 1.0)] * 6
    robot = jounce.Robot.from_dh(table, M, convention, types=types, base=base, tool=tool)
    C = base
    for i, (row, kind) in enumerate(zip(table, types, strict=True)):
        C = C @ elementary(convention, row, kind, q[i])
        np.testing.assert_allclose(robot.poses(q)[i], C, atol=1e-14)
    np.testing.assert_allclose(robot.poses(q, body="tool"), C @ tool, atol=1e-14)
    named = [
        dict(zip(("a", "alpha", "d", "theta", "type"), (*row, t), strict=True))
        for row, t in zip(table, types, strict=True)
    ]
    same = jounce.Robot.from_dh(named, M, convention, base=base, tool=tool).mechanism
    turned = jounce.Robot.from_dh(
        table * [1, 180 / np.pi, 1, 180 / np.pi], M, convention, types=types, degrees=True, base=base
    ).mechanism
    for label in ("B", "X"):
        assert (getattr(same, label) == getattr(robot.mechanism, label)).all()
        np.testing.assert_allclose(getattr(turned, label), getattr(robot.mechanism, label), atol=1e-14)


@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 6))
def test_both_conventions_of_an_arm_give_the_same_forces(seed, n):
    """The modified table holds a and alpha one row lower; frame i lies at the other end of link i."""
    rng = np.random.default_rng(seed)
    table, types = random_table(rng, n)
    lower = table.copy()
    lower[:, :2] = np.vstack([np.zeros(2), table[:-1, :2]])
    ends = [slide_along(0, a) @ turn_about(0, alpha) for a, alpha in table[:, :2]]
    M = [random_inertia(rng, 2.0) for _ in range(n)]
    tool, state = random_pose(rng), rng.uniform(-2, 2, (5, n))
    standard = Interpreted(jounce.Robot.from_dh(table, M, "standard", types=types, tool=tool))
    M = [inertia.shift_inertia(M_i, T) for M_i, T in zip(M, ends, strict=True)]
    modified = Interpreted(jounce.Robot.from_dh(lower, M, "modified", types=types, tool=ends[-1] @ tool))
    for rate, same in zip(*(robot.inverse_dynamics(*state) for robot in (standard, modified)), strict=True):
        assert relative_error(rate, same) < 1e-11
    np.testing.assert_allclose(standard.poses(state[0], body="tool"), modified.poses(state[0], body="tool"), atol=1e-13)


@pytest.mark.parametrize(("table", "file"), [(UR5, "ur5_robot.urdf"), (UR10, "ur10_robot.urdf")], ids=["ur5", "ur10"])
def test_ur_table_is_the_urdf(table, file):
    """Each frame of the table is fixed on a link of the URDF, whose right angles have nine digits; forces agree."""
    urdf, base = jounce.load(FILES[file]), turn_about(2, np.pi)
    table = table_rows(6, alpha=UR_ALPHA, **table)
    bare = jounce.Robot.from_dh(table, [np.zeros((6, 6))] * 6, "standard", base=base)
    rng = np.random.default_rng(5)
    K = lie.inverse(bare.poses(np.zeros(6))) @ urdf.poses(np.zeros(6))  # of the links in the frames of the table
    for q in rng.uniform(-3, 3, (20, 6)):
        np.testing.assert_allclose(bare.poses(q) @ K, urdf.poses(q), atol=1e-8)
    M = [inertia.shift_inertia(M_i, T) for M_i, T in zip(urdf.mechanism.M, K, strict=True)]
    tool = K[-1] @ urdf.mechanism.frame("tool0").T
    robot = jounce.Robot.from_dh(table, M, "standard", base=base, tool=tool, limits=urdf.limits)
    np.testing.assert_allclose(tool, np.eye(4), atol=1e-8)  # the last frame is the flange
    for state in rng.uniform(-2, 2, (20, 5, 6)):
        for rate, same in zip(robot.inverse_dynamics(*state), urdf.inverse_dynamics(*state), strict=True):
            assert relative_error(rate, same) < 1e-7
    assert (robot.limits.effort == urdf.limits.effort).all()


def test_panda_table_is_the_urdf():
    urdf = jounce.load(ROOT / "examples" / "panda.urdf")
    m = urdf.mechanism
    table = table_rows(7, alpha=PANDA_ALPHA, **PANDA)
    robot = jounce.Robot.from_dh(table, m.M[:7], "modified", tool=slide_along(2, 0.107))
    arm = jounce.Robot.from_screws(m.B[:7], m.X[:7], m.M[:7])
    np.testing.assert_allclose(robot.mechanism.B, m.B[:7], atol=1e-15)
    rng = np.random.default_rng(6)
    for state in rng.uniform(-2, 2, (20, 5, 7)):
        for rate, same in zip(robot.inverse_dynamics(*state), arm.inverse_dynamics(*state), strict=True):
            assert relative_error(rate, same) < 1e-12
        q = np.append(state[0], 0.0)
        np.testing.assert_allclose(robot.poses(state[0], body="tool"), urdf.poses(q, body="panda_link8"), atol=1e-14)


@pytest.mark.parametrize("degrees", [True, False])
def test_the_papers_iiwa_is_its_table_to_the_last_bit(degrees):
    iiwa = jounce.load("iiwa14").mechanism
    alpha = IIWA["alpha"] if degrees else [x / 90 * RIGHT for x in IIWA["alpha"]]
    made = jounce.Robot.from_dh(table_rows(7, alpha=alpha, d=IIWA["d"]), iiwa.M, "modified", degrees=degrees).mechanism
    assert (made.B.tobytes(), made.X.tobytes()) == (iiwa.B.tobytes(), iiwa.X.tobytes())


def test_scara():
    """Two links, a slide that points down, a wrist: the slide carries what hangs on it, the rest lies flat."""
    table = [[0.4, 0, 0.5, 0], [0.3, np.pi, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0]]
    types = ["revolute", "revolute", "prismatic", "revolute"]
    M = [jounce.inertia_matrix(m, [0, 0, 0], np.diag([0.01] * 3)) for m in (8, 5, 2, 1)]
    scara = jounce.Robot.from_dh(table, M, "standard", types=types)
    np.testing.assert_allclose(scara.gravity_forces([0.3, -1, 0.1, 2]), [0, 0, -3 * 9.81, 0], atol=1e-13)
    x, y, z = scara.poses([RIGHT, -RIGHT, 0.1, 2], body="body4")[:3, 3]
    np.testing.assert_allclose([x, y, z], [0.3, 0.4, 0.4], atol=1e-15)


def test_entries_may_be_symbols():
    L, d, t = sympy.symbols("L d t")
    zero = [np.zeros((6, 6))] * 2
    robot = jounce.Robot.from_dh([[L, RIGHT, 0, 0], [0, 0, d, t]], zero, "standard").mechanism
    assert sympy.Matrix(robot.B[0]) == sympy.Matrix([[1, 0, 0, L], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
    assert robot.X[0].tolist() == [0, 1, 0, 0, 0, -L]
    assert robot.B[1][2, 3] == d
    assert sympy.simplify(robot.B[1][0, 0] - sympy.cos(t)) == 0


M1, ROW = np.eye(6), [0.1, 0.2, 0.3, 0.4]
NAMED = dict(zip(("a", "alpha", "d", "theta"), ROW, strict=True))
TABLES = {
    "row too short": ([ROW, ROW[:3]], {}, ["table[1] has shape (3,)", "4 numbers: a, alpha, d, theta"]),
    "row too long": ([[*ROW, 0]], {}, ["table[0] has shape (5,)"]),
    "array too narrow": (np.ones((2, 3)), {}, ["table[0] has shape (3,)", "a, alpha, d, theta"]),
    "one row alone": (ROW, {}, ["table[0] has shape ()"]),
    "nothing": ([], {}, ["table is []", "rows of a, alpha, d, theta"]),
    "a text": ("ur5", {}, ["table is 'ur5'"]),
    "a mapping": (NAMED, {}, ["expected rows"]),
    "none": (None, {}, ["table is None"]),
    "what takes several lines": (pd.DataFrame([ROW]), {}, ["table is ", "expected rows"]),
    "degrees as a text": ([ROW], {"degrees": "yes"}, ["degrees is 'yes'; expected True or False"]),
    "degrees as a number": ([ROW], {"degrees": 90}, ["degrees is 90"]),
    "not finite": ([ROW, [0, np.nan, 0, 0]], {}, ["table[1] is [0.0, nan, 0.0, 0.0]", "finite"]),
    "text in a row": ([[0, "pi/2", 0, 0]], {}, ["table[0] holds text"]),
    "key left out": ([{"a": 0, "alpha": 0, "theta": 0}], {}, ["table[0] has no 'd'", "a, alpha, d, theta"]),
    "key misspelt": ([NAMED | {"alhpa": 0}], {}, ["table[0] has no key 'alhpa'; did you mean 'alpha'"]),
    "type misspelt": ([NAMED | {"type": "prismatc"}], {}, ["table[0]", "'prismatc'; did you mean 'prismatic'"]),
    "types misspelt": ([ROW], {"types": ["R"]}, ["joint of table[0]", "'R'", "revolute, prismatic"]),
    "types too few": ([ROW, ROW], {"types": ["revolute"]}, ["types is ['revolute']", "2 of revolute, prismatic"]),
    "types as a text": ([ROW], {"types": "R"}, ["types is 'R'"]),
    "types twice": ([NAMED], {"types": ["revolute"]}, ["rows of names have their own 'type'"]),
    "convention misspelt": ([ROW], {"convention": "standart"}, ["'standart'; did you mean 'standard'", "modified"]),
    "convention as a number": ([ROW], {"convention": 1}, ["convention 1;"]),
    "inertias too few": ([ROW, ROW], {"M": [M1]}, ["M has shape (1, 6, 6); expected (2, 6, 6)"]),
    "base of no pose": ([ROW], {"base": np.eye(3)}, ["base has shape (3, 3); expected a pose (4, 4)"]),
    "base that stretches": ([ROW], {"base": 2 * np.eye(4)}, ["base is not a pose"]),
    "tool that reflects": ([ROW], {"tool": np.diag([-1, 1, 1, 1])}, ["tool is not a pose", "det R = -1"]),
    "tool twice": ([ROW], {"tool": np.eye(4), "names": ["tool"]}, ["a body is named 'tool'"]),
}


@pytest.mark.parametrize(("table", "options", "words"), TABLES.values(), ids=TABLES)
def test_refuses(table, options, words):
    options = {"M": [M1], "convention": "standard", **options}
    refusal(lambda: jounce.Robot.from_dh(table, **options), *words)


@pytest.mark.parametrize("convention", ["standard", "modified"])
def test_angles_in_degrees_that_nobody_states_are_warned_of(convention):
    with pytest.warns(jounce.JounceWarning, match=r"table\[1\]: alpha is -90 rad, more than a turn; degrees=True"):
        jounce.Robot.from_dh([ROW, [0.5, -90, 0, 90]], [M1, M1], convention)
    jounce.Robot.from_dh([[0.5, -90, 0, 90]], [M1], convention, degrees=True)
