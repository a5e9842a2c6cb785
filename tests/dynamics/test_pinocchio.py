"""Pinocchio, an independent implementation, at order 0 on real robots."""

import warnings
from importlib import metadata
from pathlib import Path

import numpy as np
import pytest

import jounce
from jounce.io.bundled import BUNDLED
from support.bases import random_base
from support.robots import Interpreted, relative_error
from support.states import random_rates

with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    import pinocchio

REAL = {  # bundled robots and the URDFs that they were converted from
    name: Path(str(file.locate()))
    for name, robot in BUNDLED.items()
    for file in metadata.files("example-robot-data") or []
    if robot.urdf and str(file).endswith(f"/robots/{robot.urdf}")
}
OURS = Path(__file__).parents[2] / "examples" / "panda.urdf"


@pytest.fixture(params=[*REAL.items(), (OURS, OURS)], ids=lambda pair: Path(pair[0]).name)
def robot_and_peer(request):
    source, urdf = request.param
    return jounce.load(source), pinocchio.buildModelFromUrdf(str(urdf))


def test_the_real_robots_are_there():
    assert set(REAL) == {name for name, robot in BUNDLED.items() if robot.urdf}


def by_name(robot, model):
    """The rows of Pinocchio's velocity vector in the order of our joints."""
    return [model.joints[model.getJointId(name)].idx_v for name in robot.mechanism.joints]


@pytest.mark.sweep(4)
def test_inverse_dynamics_agrees_with_mimic_joints_folded(robot_and_peer):
    robot, model = robot_and_peer
    data, G, g, rows = model.createData(), robot.mechanism.G, robot.mechanism.g, by_name(robot, model)
    for q, qd, q2d in zip(*random_rates(robot.n, 3, 20), strict=True):
        theta = [np.zeros(model.nv) for _ in range(3)]
        for x, rate in zip(theta, (G @ q + g, G @ qd, G @ q2d), strict=True):
            x[rows] = rate
        expected = G.T @ pinocchio.rnea(model, data, *theta)[rows]
        assert relative_error(robot.inverse_dynamics(q, qd, q2d), expected) < 1e-12


@pytest.mark.sweep(4)
def test_mass_matrix_and_gravity_forces_agree(robot_and_peer):
    robot, model = robot_and_peer
    data, G, g, rows = model.createData(), robot.mechanism.G, robot.mechanism.g, by_name(robot, model)
    for q, _, _ in zip(*random_rates(robot.n, 3, 5), strict=True):
        theta = np.zeros(model.nv)
        theta[rows] = G @ q + g
        upper = np.triu(pinocchio.crba(model, data, theta))
        M = (upper + np.triu(upper, 1).T)[np.ix_(rows, rows)]
        assert relative_error(robot.mass_matrix(q), G.T @ M @ G) < 1e-12
        gravity = pinocchio.computeGeneralizedGravity(model, data, theta)[rows]
        assert relative_error(robot.gravity_forces(q), G.T @ gravity) < 1e-12


@pytest.mark.sweep(4)
def test_wrenches_have_the_opposite_sign_of_forces_on_the_bodies(robot_and_peer):
    """Pinocchio takes the force ON a body, (linear; angular); W is what the body exerts, (angular; linear)."""
    robot, model = robot_and_peer
    data, G, g, rows = model.createData(), robot.mechanism.G, robot.mechanism.g, by_name(robot, model)
    W = np.random.default_rng(2).normal(size=6)
    q, qd, q2d = random_rates(robot.n, 3)
    theta = [np.zeros(model.nv) for _ in range(3)]
    for x, rate in zip(theta, (G @ q + g, G @ qd, G @ q2d), strict=True):
        x[rows] = rate
    forces = pinocchio.StdVec_Force()
    forces.extend([pinocchio.Force.Zero() for _ in range(model.njoints)])
    last = robot.body_names[5]
    forces[model.getJointId(robot.mechanism.joints[5])] = pinocchio.Force(-W[3:], -W[:3])
    expected = G.T @ pinocchio.rnea(model, data, *theta, forces)[rows]
    assert relative_error(robot.inverse_dynamics(q, qd, q2d, wrench={last: W}), expected) < 1e-12


@pytest.mark.sweep(4)
def test_joint_wrenches_agree(robot_and_peer):
    """Pinocchio's data.f, (linear; angular), in the same frames: those of the links behind the joints."""
    robot, model = robot_and_peer
    data, G, g, rows = model.createData(), robot.mechanism.G, robot.mechanism.g, by_name(robot, model)
    for q, qd, q2d in zip(*random_rates(robot.n, 3, 3), strict=True):
        theta = [np.zeros(model.nv) for _ in range(3)]
        for x, rate in zip(theta, (G @ q + g, G @ qd, G @ q2d), strict=True):
            x[rows] = rate
        pinocchio.rnea(model, data, *theta)
        forces = [data.f[model.getJointId(name)] for name in robot.mechanism.joints]
        expected = np.stack([np.concatenate([f.angular, f.linear]) for f in forces])
        assert relative_error(robot.joint_wrenches(q, qd, q2d), expected) < 1e-12


def regressor_columns(robot, model):
    """The columns of Pinocchio's regressor in the order of our bodies: it has ten for every joint."""
    return np.concatenate([10 * (model.getJointId(name) - 1) + np.arange(10) for name in robot.mechanism.joints])


def test_regressors_in_link_frames_agree(robot_and_peer):
    robot, model = robot_and_peer
    data, G, g, rows = model.createData(), robot.mechanism.G, robot.mechanism.g, by_name(robot, model)
    q, qd, q2d = random_rates(robot.n, 3)
    theta = [np.zeros(model.nv) for _ in range(3)]
    for x, rate in zip(theta, (G @ q + g, G @ qd, G @ q2d), strict=True):
        x[rows] = rate
    expected = (
        G.T @ pinocchio.computeJointTorqueRegressor(model, data, *theta)[np.ix_(rows, regressor_columns(robot, model))]
    )
    assert relative_error(Interpreted(robot).regressor(q, qd, q2d), expected) < 1e-12
    p = [model.inertias[model.getJointId(name)].toDynamicParameters() for name in robot.mechanism.joints]
    assert relative_error(robot.inertial_parameters, np.concatenate(p)) < 1e-12


def test_poses_and_jacobians_of_merged_links_agree(robot_and_peer):
    robot, model = robot_and_peer
    if set(robot.mechanism.joints) != set(robot.joint_names):
        pytest.skip("Pinocchio's Jacobian has a column for every joint, mimic ones too")
    data, rows = model.createData(), by_name(robot, model)
    q = random_rates(robot.n, 1)[0]
    theta = np.zeros(model.nv)
    theta[rows] = q
    for link in (frame.name for frame in robot.mechanism.frames):
        frame = model.getFrameId(link, pinocchio.FrameType.BODY)  # a joint may have the same name
        J = pinocchio.computeFrameJacobian(model, data, theta, frame, pinocchio.ReferenceFrame.LOCAL_WORLD_ALIGNED)
        J = np.concatenate([J[3:], J[:3]])[:, rows]
        assert np.abs(Interpreted(robot).jacobian(q, body=link, frame="world") - J).max() < 1e-12


def swapped_halves(x):
    """(angular; linear) of Pinocchio's (linear; angular), or back."""
    return np.concatenate([x[3:], x[:3]])


@pytest.mark.parametrize("name", ["solo12", "g1"])
def test_matrices_and_momenta_of_floating_robots_agree(name):
    """Whose twist of the base is (linear; angular) too, and whose rates are those of its components."""
    robot, rng = jounce.load(name, base="floating"), np.random.default_rng(3)
    model = pinocchio.buildModelFromUrdf(str(REAL[name]), pinocchio.JointModelFreeFlyer())
    data, compute = model.createData(), Interpreted(robot)
    joints = [model.joints[model.getJointId(joint)] for joint in robot.joint_names]
    places = [*range(3, 6), *range(3), *(joint.idx_v for joint in joints)]
    q, qd, q2d = rng.uniform(-1, 1, (3, robot.n))
    C, V, Vd = base = random_base(rng, 3)
    x, v, a = np.zeros(model.nq), np.zeros(model.nv), np.zeros(model.nv)
    x[:7] = pinocchio.SE3ToXYZQUAT(pinocchio.SE3(C))
    x[[joint.idx_q for joint in joints]] = q
    v[places], a[places] = np.concatenate([V, qd]), np.concatenate([Vd, q2d])
    two = {"base": base[:2]}
    hG, hGd = compute.centroidal_momentum(q, qd, q2d, base=base)
    c, cd, c2d = compute.center_of_mass(q, qd, q2d, base=base)
    A, A_rate = compute.centroidal_momentum_matrix(q, qd, **two)
    pinocchio.computeCentroidalMomentumTimeVariation(model, data, x, v, a)
    pairs = [(hG, swapped_halves(data.hg.np)), (hGd, swapped_halves(data.dhg.np))]
    pinocchio.centerOfMass(model, data, x, v, a)
    pairs += [(c, data.com[0]), (cd, data.vcom[0]), (c2d, data.acom[0])]
    pairs += [(A_rate, swapped_halves(pinocchio.computeCentroidalMapTimeVariation(model, data, x, v))[:, places])]
    pairs += [(A, swapped_halves(data.Ag)[:, places])]
    M = pinocchio.crba(model, data, x)
    pairs += [(compute.mass_matrix(q), (np.triu(M) + np.triu(M, 1).T)[np.ix_(places, places)])]
    bias = pinocchio.nonLinearEffects(model, data, x, v) - pinocchio.computeGeneralizedGravity(model, data, x)
    pairs += [(compute.coriolis_matrix(q, qd, **two) @ v[places], bias[places])]
    pairs += [(compute.kinetic_energy(q, qd, **two), pinocchio.computeKineticEnergy(model, data, x, v))]
    Y = pinocchio.computeJointTorqueRegressor(model, data, x, v, a)[places]
    ours = [*range(10), *regressor_columns(robot, model)]  # those of the free flyer first
    pairs += [(compute.regressor(q, qd, q2d, base=base), Y[:, ours])]
    for found, expected in pairs:
        assert relative_error(found, expected) < 1e-11
