"""All the URDFs of example-robot-data: each agrees with Pinocchio, or is refused for a reason; the table is printed."""

import re

import numpy as np
import pytest

import jounce
from jounce.model.transmissions import with_followers
from support.pinocchio_of_urdf import REAL, control_bounds, crba, pinocchio, rnea
from support.refusals import refusal
from support.robots import differentiated, harmonic, relative_error

pytestmark = pytest.mark.filterwarnings("ignore::jounce.JounceWarning")  # of odd inertias, and of welded roots

REFUSED = {
    "alex/alex_psyonic_hands.urdf": ["mimic of 'Left_index_q2'", "unknown joint 'index_q1'"],
    "hector/robots/quadrotor_base.urdf": ["no movable joint among 1 link and 0 joints"],
    "iris/robots/iris_simple.urdf": ["no movable joint among 6 links and 5 joints"],
    "ur/ur3.urdf": ["no movable joint among 0 links and 0 joints"],
}
MOVING = [name for name in REAL if name not in REFUSED]
RATED = (  # those whose rates are proved, arms, hands on arms, quadrupeds, humanoids, some with mimic joints
    "a1/a1.urdf",
    "anymal_b_simple/robots/anymal.urdf",
    "baxter/baxter.urdf",
    "icub/robots/icub.urdf",
    "kinova/robots/kinova.urdf",
    "panda/panda.urdf",
    "pr2/pr2.urdf",
    "solo/robots/solo12.urdf",
    "talos_data/robots/talos_full_v2.urdf",
    "tiago_pro/robots/tiago_pro.urdf",
    "ur/ur5_robot.urdf",
    "xarm/xarm7.urdf",
    "z1/z1.urdf",
)


def test_there_are_enough():
    assert len(MOVING) >= 65
    assert {*REFUSED, *RATED} <= set(REAL)


def own_joints(robot, model):
    """Those of the file: a robot has motors of transmissions among its joints too, behind all others."""
    names = [name for name in robot.mechanism.joints if model.existJointName(name)]
    assert robot.mechanism.joints[: len(names)] == tuple(names)
    return names


@pytest.fixture(scope="module", params=MOVING)
def robot_and_model(request):
    robot = jounce.load(REAL[request.param], base="fixed")
    model = pinocchio.buildModelFromUrdf(str(REAL[request.param]))
    rows = [model.joints[model.getJointId(name)].idx_v for name in own_joints(robot, model)]
    return request.param, robot, model, rows


@pytest.mark.sweep(12)
def test_forces_and_mass_matrix_agree_with_pinocchio(robot_and_model, record_property):
    """Mimic joints folded by G, floating roots at rest, drives off; at 20 states."""
    name, robot, model, rows = robot_and_model
    tree = with_followers(robot.mechanism)
    G, g = tree.G[: len(rows)], tree.g[: len(rows)]
    q, qd, q2d = np.random.default_rng(5).uniform(-2, 2, (3, 20, robot.n))
    theta = np.zeros((3, 20, model.nv))
    theta[..., rows] = q @ G.T + g, qd @ G.T, q2d @ G.T
    Q = np.stack([G.T @ rnea(model, *state)[rows] for state in theta.swapaxes(0, 1)])
    M = np.stack([G.T @ crba(model, state)[np.ix_(rows, rows)] @ G for state in theta[0]])
    errors = [
        max(map(relative_error, ours, theirs))
        for ours, theirs in (
            (robot.inverse_dynamics(q, qd, q2d, method="recursion"), Q),
            (robot.mass_matrix(q, method="recursion"), M),
        )
    ]
    record_property("robots", (name, robot.n, robot.mechanism.nb, *(f"{error:.1e}" for error in errors)))
    assert max(errors) < 1e-11


def test_limits_and_drives_are_those_that_pinocchio_reads(robot_and_model):
    name, robot, model, rows = robot_and_model
    names, limits, drives = own_joints(robot, model), robot.limits.select(range(len(rows))), robot.drives
    for ours, theirs in (
        (drives.damping[: len(rows)], model.damping[rows]),
        (drives.friction[: len(rows)], model.friction[rows]),
        (limits.velocity, np.minimum(model.velocityLimit[rows], control_bounds(REAL[name], "velocity", names))),
        (limits.effort, model.effortLimit[rows]),
    ):
        np.testing.assert_array_equal(ours, theirs)
    joints = [model.joints[model.getJointId(name)] for name in names]
    for ours, theirs in ((limits.lower, model.lowerPositionLimit), (limits.upper, model.upperPositionLimit)):
        stated = [theirs[joint.idx_q] if joint.nq == 1 else x for x, joint in zip(ours, joints, strict=True)]
        np.testing.assert_array_equal(ours, stated)
        assert all(np.isinf(x) for x, joint in zip(ours, joints, strict=True) if joint.nq == 2)


@pytest.mark.parametrize("name", REFUSED)
def test_refuses_with_a_reason(name, record_property):
    message = refusal(lambda: jounce.load(REAL[name], base="fixed"), str(REAL[name]), *REFUSED[name])
    _, _, reason = message.removeprefix(str(REAL[name])).partition(": ")
    record_property("robots", (name, "", "", f"refused: {reason.partition(' available:')[0]}"))


@pytest.mark.parametrize("name", RATED)
def test_rates_agree_with_differences_and_with_extended_precision(name):
    """Along a harmonic motion; what is differentiated is Q and Qd in long doubles, over nine points."""
    robot = jounce.load(REAL[name])
    motion = harmonic(np.random.default_rng(6), robot.n, 4)
    rates = motion(0.0)
    _, Qd, Q2d = terms = robot.inverse_dynamics(*rates, method="recursion")

    def forces(t, k):
        exact = [x.astype(np.longdouble) for x in motion(np.longdouble(t))[: 3 + k]]
        return np.atleast_2d(robot.inverse_dynamics(*exact))[k]

    for k, ours in enumerate((Qd, Q2d)):
        assert relative_error(ours, differentiated(lambda t, k=k: forces(t, k), h=0.004)) < 1e-11
    exact = robot.inverse_dynamics(*(x.astype(np.longdouble) for x in rates))
    for ours, theirs in zip(terms, exact, strict=True):
        assert theirs.dtype == np.longdouble
        assert relative_error(ours, theirs) < 1e-12


HANDS = {  # a file, the link that the gripper hangs on, and what its joints are in the one coordinate
    "panda": ("panda/panda.urdf", "panda_hand", {"panda_finger_joint1": 1, "panda_finger_joint2": 1}),
    "talos": (
        "talos_data/robots/talos_full_v2.urdf",
        "gripper_left_base_link",
        {
            "gripper_left_joint": 1,
            "gripper_left_inner_double_joint": 1,
            "gripper_left_fingertip_1_joint": -1,
            "gripper_left_fingertip_2_joint": -1,
            "gripper_left_motor_single_joint": -1,
            "gripper_left_inner_single_joint": -1,
            "gripper_left_fingertip_3_joint": -1,
        },
    ),
}


@pytest.mark.parametrize("whole", [False, True], ids=["gripper", "whole robot"])
@pytest.mark.parametrize("hand", HANDS)
def test_a_mimic_gripper_has_its_constraint_eliminated(tmp_path, hand, whole):
    """The same file without <mimic> has free fingers; theta = F q makes of them Q = F^T Q_free, M = F^T M_free F."""
    name, palm, factors = HANDS[hand]
    free = tmp_path / "free.urdf"
    leader = next(iter(factors))
    free.write_text(re.sub(rf'<mimic joint="{leader}"[^>]*/>', "", REAL[name].read_text()))
    folded, unfolded = (jounce.load(path, root=None if whole else palm) for path in (REAL[name], free))
    F = np.array([
        [factors[joint] * (leader == q) if joint in factors else float(joint == q) for q in folded.joint_names]
        for joint in unfolded.joint_names
    ])  # fmt: skip
    assert unfolded.n == folded.n + len(factors) - 1
    assert whole or (set(unfolded.joint_names) == set(factors) and folded.joint_names == (leader,))
    rates = np.random.default_rng(7).uniform(-1, 1, (5, folded.n))
    theirs = unfolded.inverse_dynamics(*(rates @ F.T), method="recursion")
    for Q, Q_free in zip(folded.inverse_dynamics(*rates, method="recursion"), theirs, strict=True):
        assert relative_error(Q, F.T @ Q_free) < 1e-13
    M = unfolded.mass_matrix(rates[0] @ F.T, method="recursion")
    assert relative_error(folded.mass_matrix(rates[0], method="recursion"), F.T @ M @ F) < 1e-13
