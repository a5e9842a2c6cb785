"""Methods of Robot on closed robots: each holds for the closed robot, or says in one line what it takes."""

import pickle
from dataclasses import replace

import dask.array
import mujoco
import numpy as np
import pytest
import sympy

import jounce
import jounce.dask
from jounce.checks.compare import compare
from jounce.dynamics import loop_assembly
from support.random_loops import looped
from support.refusals import expect_refusal, refusal
from support.robots import differentiated_at_once, relative_error

RECURSION = {"method": "recursion"}
DRIVEN = looped("cylindrical with mimic joint and drives")
SHARED = looped("two that share joints")
FLOATING = looped("fixed to a floating base")
FIVEBAR = jounce.load("fivebar")


def state_near_start(robot, count=3, seed=3):
    """q near the start, and rates."""
    closure, rng = robot.mechanism.closure, np.random.default_rng(seed)
    q = closure.start[list(closure.independent)] + rng.uniform(-0.05, 0.05, robot.n)
    return [q, *rng.uniform(-1, 1, (count - 1, robot.n))]


def tree_of(robot):
    return jounce.Robot(robot.mechanism.tree)


def test_forces_of_drives_are_what_they_add():
    q = state_near_start(DRIVEN, 5)
    with_all, without = (DRIVEN.with_drives(x).inverse_dynamics(*q, **RECURSION) for x in (True, False))
    for found, a, b in zip(DRIVEN.drive_forces(*q), with_all, without, strict=True):
        assert relative_error(found, a - b) < 1e-11


def test_regressor_with_columns_of_drives():
    q, m = state_near_start(DRIVEN, 4), DRIVEN.mechanism
    parts = [DRIVEN.inertial_parameters, m.drives.armature, m.drives.damping]
    expected = DRIVEN.with_drives(["armature", "damping"]).inverse_dynamics(*q, **RECURSION)
    for Y, Q in zip(DRIVEN.regressor(*q, drives=("armature", "damping"), **RECURSION), expected, strict=True):
        assert relative_error(Y @ np.concatenate(parts), Q) < 1e-11


@pytest.mark.parametrize(("quantity", "size"), [("momentum_regressor", 1), ("energy_regressor", 0)])
def test_regressors_without_accelerations(quantity, size):
    q, m = state_near_start(DRIVEN, 2), DRIVEN.mechanism
    Y = getattr(DRIVEN, quantity)(*q, drives=("armature",), **RECURSION)
    p = np.concatenate([DRIVEN.inertial_parameters, m.drives.armature])
    driven = DRIVEN.with_drives("armature")
    kinetic, potential = driven.kinetic_energy(*q, **RECURSION), driven.potential_energy(q[0], **RECURSION)
    expected = driven.generalized_momentum(*q, **RECURSION) if size else kinetic + potential
    assert relative_error(Y @ p, expected) < 1e-11


@pytest.mark.parametrize("frame", ["world", "body"])
def test_wrench_of_a_load_is_that_of_the_tree(frame):
    q, load = state_near_start(SHARED), {"body": "body8", "force": (1, 2, 3), "point": (0.1, 0.2, 0.3), "frame": frame}
    on_tree = SHARED.coordinates(*q, **RECURSION)
    for x, y in zip(SHARED.wrench(*q, **load), tree_of(SHARED).wrench(*on_tree, **load), strict=True):
        assert relative_error(x, y) < 1e-12


def test_wrench_of_a_load_on_a_floating_robot():
    (q,), base = state_near_start(FLOATING, 1), np.eye(4)
    load = {"body": "body3", "force": (0, 0, -1), "base": base}
    expected = tree_of(FLOATING).wrench(FLOATING.coordinates(q, **RECURSION), **load)
    assert relative_error(FLOATING.wrench(q, **load), expected) < 1e-12


@pytest.mark.parametrize("robot", [DRIVEN, SHARED], ids=["driven", "shared"])
def test_base_parameters_are_the_fewest_that_determine_the_forces(robot):
    rng, found, places = (
        np.random.default_rng(5),
        robot.base_parameters(),
        loop_assembly.sample_positions(robot.mechanism, 40),
    )
    Y = robot.regressor(places, *rng.uniform(-2, 2, (2, 40, robot.n)), **RECURSION)
    assert relative_error(Y[..., found.columns] @ found.values, Y @ robot.inertial_parameters) < 1e-10
    assert found.count < tree_of(robot).base_parameters().count
    Y = (Y / np.abs(Y).max(axis=(1, 2), keepdims=True)).reshape(-1, Y.shape[-1])  # loops may be near singular
    sizes = np.linalg.svd(Y, compute_uv=False)
    assert sizes[found.count - 1] > 1e-8 * sizes[0] > 1e4 * sizes[found.count]


def test_locking_an_independent_coordinate():
    q, (first, _) = state_near_start(SHARED, 4), SHARED.mechanism.coordinates
    locked = SHARED.locked({first: q[0][0]})
    q[1:] = [x * [0, 1] for x in q[1:]]
    found = locked.inverse_dynamics(*(x[1:] for x in q), **RECURSION)
    for x, y in zip(found, SHARED.inverse_dynamics(*q, **RECURSION), strict=True):
        assert relative_error(x, y[1:]) < 1e-11


def test_massless_bodies_behind_the_cut():
    """The mass matrix of the tree is singular, that of the closed robot is not: the motors feel the other bodies."""
    m = SHARED.mechanism
    light = jounce.Robot(replace(m, M=np.where(np.isin(np.arange(m.nb), (3, 4, 7))[:, None, None], 0.0, m.M)))
    q = state_near_start(light)
    Q = light.inverse_dynamics(*q, **RECURSION)
    assert relative_error(light.forward_dynamics(*q[:2], Q, **RECURSION), q[2]) < 1e-9
    refusal(lambda: tree_of(light).forward_dynamics(*np.zeros((3, 8)), **RECURSION), "the mass matrix is singular")
    with expect_refusal("singular, of rank 0 for 2 coordinates"):
        jounce.Robot(replace(m, M=0 * m.M)).forward_dynamics(*q[:2], Q, **RECURSION)


def test_limits_of_dependent_joints_stay():
    robot = SHARED.with_limits(velocity={"joint8": 2.0}, effort={SHARED.joint_names[0]: 3.0})
    assert robot.limits.velocity[7] == 2.0
    assert robot.with_drives(False).with_inertial_parameters(2 * robot.inertial_parameters).limits is robot.limits


@pytest.mark.parametrize("robot", [SHARED, FLOATING], ids=["shared", "floating"])
def test_copies_are_equal(robot, tmp_path):
    assert pickle.loads(pickle.dumps(robot)) == robot != tree_of(robot)
    assert robot.closed() == robot
    if not robot.mechanism.floats:
        jounce.save(robot, tmp_path / "robot.yaml")
        assert jounce.load(tmp_path / "robot.yaml") == robot


def test_long_doubles_close_to_their_precision():
    """So that differences of rates show fifteen digits."""
    u, *rates = (x.astype(np.longdouble) / (1 + 19 * (k > 0)) for k, x in enumerate(state_near_start(SHARED, 5)))

    def along(t):
        powers = [np.multiply.outer(t.astype(np.longdouble) ** j, x) for j, x in enumerate((u, *rates))]
        q = powers[0] + powers[1] + powers[2] / 2
        return np.stack([SHARED.potential_energy(q)], axis=1)

    assert SHARED.coordinates(u).dtype == np.longdouble
    found = SHARED.potential_energy(u, rates[0])[1]
    assert abs(float(found - differentiated_at_once(along, 0.02)[0])) < 1e-14 * abs(float(found)) + 1e-15


def test_symbols_of_all_coordinates():
    """Of SymPy, as of CasADi in tests/matrix: positions are those of the tree, which symbols cannot close."""
    robot = jounce.load("fourbar_leg")
    q, qd = state_near_start(robot, 2)
    whole, names = robot.coordinates(q, **RECURSION), robot.mechanism.closure.coordinates
    expected = robot.generalized_momentum(q, qd, **RECURSION)
    symbols, rates = list(sympy.symbols(names)), list(sympy.symbols(["rate1", "rate2"]))
    of_symbols = sympy.lambdify([symbols, rates], list(robot.generalized_momentum(symbols, rates)))
    assert relative_error(of_symbols(whole, qd), expected) < 1e-12
    with expect_refusal("^q holds 2 symbols, or an array of JAX; expected all 4 coordinates"):
        robot.generalized_momentum(symbols[:2], rates)


def test_compare_checks_closed_robots_against_themselves():
    checks = compare(jounce.load("fivebar"), order=1, states=2)
    assert all(check.passed for check in checks)
    assert {check.against for check in checks} >= {"closed form", "long doubles", "differences of Q", "other libraries"}


def test_dask_computes_blocks_of_closed_robots():
    robot = jounce.load("fourbar_leg")
    q = np.stack([state_near_start(robot, 1, seed)[0] for seed in range(4)])
    for given in (q, robot.coordinates(q, **RECURSION)):  # zeros close no loop
        found = jounce.dask.apply(robot, "mass_matrix", dask.array.from_array(given, chunks=(2, -1)), **RECURSION)
        np.testing.assert_array_equal(found.compute(), robot.mass_matrix(given, **RECURSION))


MODEL = mujoco.MjModel.from_xml_string("<mujoco><worldbody/></mujoco>")
REFUSED = {
    "a dependent joint": (lambda: SHARED.locked({"joint8": 0.1}), "'joint8'…follows others in closed loops"),
    "all joints": (lambda: SHARED.locked(dict.fromkeys(SHARED.mechanism.coordinates, 0.1)), "all 2 joints are locked"),
    "a state of MuJoCo": (lambda: SHARED.state_from("mujoco", [], model=MODEL), "in loops or…convert states of"),
    "forces of MuJoCo": (lambda: SHARED.state_to("mujoco", Q=[1, 2], model=MODEL), "in loops or…convert states"),
    "some of those that follow": (lambda: SHARED.mass_matrix(dict.fromkeys(SHARED.mechanism.tree.coordinates[:4], 0.1)),
        "^q: leave out 'joint3', which follows others in closed loops"),
    "endless weights": (lambda: SHARED.closed(weights=[1, np.inf]), "weights is [1, inf]; expected positive"),
    "no joint that follows": (lambda: SHARED.closed(coordinates=SHARED.mechanism.closure.coordinates),
        "all 8 coordinates are named"),
    "a loop that names no frame": (lambda: tree_of(FLOATING).closed([("body3", "grund")], ["joint1"]),
        "loops[0]: unknown body 'grund'"),
    "too few coordinates on the ground": (lambda: tree_of(FLOATING).closed([("body3", "ground")], ["joint1"]),
        "with these held base_x, … can move"),
    "a weight without end": (lambda: SHARED.closed(weights=[1, np.inf]), "weights is …expected positive finite"),
    "some of the joints that follow": (lambda: SHARED.mass_matrix({"joint1": 0, "joint2": 0, "joint8": 0}),
        "leave out 'joint8', which follows others"),
    "effort of a joint without a motor": (lambda: SHARED.with_limits(effort={"joint8": 1}),
        "'joint8': it has no motor, …one of joint1, joint2,"),
    "positions far from closed": (lambda: FIVEBAR.mass_matrix([2.2, 0, 0.9, 0]),
        "given: …open by 0.459 m…close with right_elbow = 1.6"),
    "a branch that no line leads to": (lambda: FIVEBAR.mass_matrix([2.2 + 4 * np.pi, 0.9]),
        "no straight line of the coordinates leads there; from"),
}  # fmt: skip


def test_efforts_are_limited_at_motors_that_are_no_coordinates():
    platform = jounce.load("delta").closed(coordinates=["x", "y", "z"]).with_limits(effort=2.0)
    assert (
        platform.limits.effort[[platform.mechanism.joints.index(f"motor{k}") for k in (1, 2, 3)]].tolist() == [2.0] * 3
    )
    refusal(lambda: platform.with_limits(effort=[1, 2]), "expected one number, (3,) one per motor")


def test_a_start_in_degrees_is_told():
    tree, start = tree_of(FIVEBAR), np.rad2deg(FIVEBAR.mechanism.closure.start)
    with pytest.warns(jounce.JounceWarning, match="'left_shoulder' starts, .* 126.* deg are 2.2"):
        tree.closed(actuated=FIVEBAR.joint_names, start=start)


@pytest.mark.parametrize(("call", "words"), REFUSED.values(), ids=REFUSED)
def test_what_closed_robots_do_not_take_is_refused_in_one_line(call, words):
    refusal(call, words)
