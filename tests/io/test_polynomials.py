"""Joints that follow others by polynomials, of MJCF and of files, against MuJoCo and the chain rule."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
from numpy.polynomial import Polynomial

import jounce
from jounce.model.polynomials import polynomial_laws
from support.refusals import expect_refusal
from support.robots import differentiated, harmonic, relative_error

KNEE = Path(__file__).parents[1] / "data" / "actuators" / "polynomial_knee.xml"
MASSLESS = pytest.mark.filterwarnings("ignore:.*bodies without mass that carry mass:jounce.JounceWarning")
LAW = Polynomial([0.001, 0.02, -0.03, 0.005])


def legs(equalities, more="", base=""):
    """MJCF of a chain of hinges and a slide, j0 to j3, that starts at other places than zero."""
    bodies = ""
    for k, kind in enumerate(("hinge", "slide", "hinge", "hinge")):
        bodies += (
            f"<body name='b{k}' pos='.1 {0.1 * k} .2'><joint name='j{k}' type='{kind}' axis='{k} 1 .3'"
            f" ref='{0.2 * k - 0.1}' armature='.1' damping='.2'/>"
            f"<inertial mass='{1 + k}' pos='.05 .02 .1' diaginertia='.02 .03 .01'/>"
        )
    world = f"<worldbody>{base}{bodies}{'</body>' * 4}{'</body>' * (base != '')}</worldbody>"
    ties = "".join(f"<joint joint1='{a}' joint2='{b}' polycoef='{c}'/>" for a, b, c in equalities)
    return f"<mujoco model='m'><compiler angle='radian'/>{world}<equality>{ties}</equality>{more}</mujoco>"


TIES = {
    "one": [("j1", "j0", ".1 .2 -.3 .1 .05")],
    "two of one": [("j1", "j0", ".1 .2 -.3 0 0"), ("j3", "j0", "0 0 .5 0 .2")],
    "through a mimic": [("j0", "j2", ".1 -2 0 0 0"), ("j1", "j0", "0 .1 .2 0 0")],
    "one through the other": [("j1", "j0", ".1 .2 -.3 0 0"), ("j3", "j1", "0 .5 .4 0 0")],
}


def followed(model, ties, theta, speeds):
    """Positions, velocities and accelerations of all joints of a model, by MuJoCo's laws and the chain rule."""
    q, qd, q2d = theta.copy(), *(x.copy() for x in speeds)
    index = {model.joint(j).name: j for j in range(model.njnt)}
    for a, b, coefficients in ties:
        i, j, p = index[a], index[b], Polynomial([float(c) for c in coefficients.split()])
        x = q[j] - model.qpos0[j]
        q[i] = model.qpos0[i] + p(x)
        qd[i] = p.deriv()(x) * qd[j]
        q2d[i] = p.deriv()(x) * q2d[j] + p.deriv(2)(x) * qd[j] ** 2
    return q, qd, q2d


@pytest.mark.parametrize("name", TIES)
def test_followers_by_polynomials_agree_with_mujoco(name):
    ties = TIES[name]
    model = mujoco.MjModel.from_xml_string(legs(ties))
    robot = jounce.Robot.from_mujoco(model)
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    driven, data = robot.with_drives(["armature", "damping"]), mujoco.MjData(model)
    leaders = [model.joint(name).id for name in robot.joint_names]
    assert robot.n == model.nv - len(ties)
    rng = np.random.default_rng(1)
    for _ in range(10):
        theta, *speeds = rng.uniform(-0.8, 0.8, (3, model.nv))
        q, qd, q2d = followed(model, ties, theta, speeds)
        data.qpos[:], data.qvel[:], data.qacc[:] = q, qd, q2d
        mujoco.mj_inverse(model, data)
        # F of virtual work: the velocities of all joints where one leader has the speed 1.
        F = np.stack([followed(model, ties, theta, (np.eye(model.nv)[j], 0 * theta))[1] for j in leaders], axis=1)
        assert (
            relative_error(driven.inverse_dynamics(q[leaders], qd[leaders], q2d[leaders]), F.T @ data.qfrc_inverse)
            < 1e-12
        )
        whole = dict(
            zip(robot.mechanism.joints, robot.mechanism.closure.G @ robot.coordinates(q[leaders]), strict=True)
        )
        for j in range(model.nv):
            place = robot.mechanism.joints.index(model.joint(j).name)
            assert whole[model.joint(j).name] + robot.mechanism.closure.g[place] == pytest.approx(q[j], abs=1e-13)


@pytest.mark.parametrize("name", TIES)
def test_rates_and_partial_derivatives_agree_with_differences(name):
    robot = jounce.Robot.from_mujoco(mujoco.MjModel.from_xml_string(legs(TIES[name])))
    robot = robot.with_drives(["armature", "damping"])
    motion = harmonic(np.random.default_rng(3), robot.n, 5)

    def forces(t, k):
        exact = [x.astype(np.longdouble) for x in motion(np.longdouble(t))[: 3 + k]]
        return np.atleast_2d(robot.inverse_dynamics(*exact))[k]

    for k, rate in enumerate(robot.inverse_dynamics(*motion(0.0))[1:]):
        assert relative_error(rate, differentiated(lambda t, k=k: forces(t, k), h=0.004)) < 1e-10
    q, qd, q2d = rates = motion(0.0)[:3]
    K, D, M = robot.inverse_dynamics_partials(q, qd, q2d)
    for which, ours in enumerate((K, D, M)):

        def along(h, j, which=which):
            moved = [x + h * np.eye(robot.n)[j] * (k == which) for k, x in enumerate(rates)]
            return robot.inverse_dynamics(*moved)

        columns = [differentiated(lambda h, j=j, along=along: along(h, j), h=0.01) for j in range(robot.n)]
        assert relative_error(ours, np.stack(columns, axis=-1)) < 1e-9
    assert relative_error(robot.forward_dynamics(q, qd, robot.inverse_dynamics(q, qd, q2d)), q2d) < 1e-10


@MASSLESS
def test_a_knee_that_slides_as_it_bends_has_two_coordinates():
    robot = jounce.load(KNEE)
    assert robot.joint_names == ("hip", "knee")
    assert robot.coordinates([0.3, 0.7])[1] == pytest.approx(LAW(0.7), abs=1e-15)
    # Rates of any order: d^k/dt^k of p(k(t)) by the chain rule of polynomials in t.
    knee = Polynomial([0.7, 0.2, -0.3, 0.4, 0.1])
    rates = [np.array([0.0, knee.deriv(k)(0.0) if k else knee(0.0)]) for k in range(5)]
    slide = LAW(knee)
    for k, x in enumerate(robot.coordinates(*rates)):
        assert x[1] == pytest.approx(slide.deriv(k)(0.0) if k else slide(0.0), abs=1e-14)


@MASSLESS
def test_a_slope_that_vanishes_is_no_singular_position():
    """At k = 0.3708 the knee slides to its end and turns round: the slope of the polynomial is 0 there."""
    robot, [end, *_] = jounce.load(KNEE), LAW.deriv().roots()
    F = robot.jacobian([0.1, end], body="slider")
    assert np.isfinite(F).all()
    Q = robot.inverse_dynamics([0.1, end], [0.2, 0.3], [0.1, -0.4])
    near = robot.inverse_dynamics([0.1, end + 1e-9], [0.2, 0.3], [0.1, -0.4])
    np.testing.assert_allclose(Q, near, atol=1e-7)


@MASSLESS
def test_limits_of_a_follower_by_a_polynomial_are_checked():
    robot = jounce.load(KNEE).with_limits(velocity={"knee": 50.0, "hip": 50.0, "knee_x": 0.02})
    motion = jounce.Motion.polynomial([[0.0, 0.1, 0.0], [0.0, 0.0, 1.5]], 1.0)
    found = robot.check(motion)
    t = np.linspace(0, 1, 20001)
    speed = np.abs(LAW.deriv()(1.5 * t**2) * 3 * t)
    assert found.worst.joint == "knee_x"
    assert found.worst.ratio == pytest.approx(speed.max() / 0.02, rel=1e-4)
    slow = robot.slowdown(motion)
    assert slow.factor == pytest.approx(0.02 / speed.max(), rel=1e-4)
    way = jounce.Motion.polynomial([[0, 0, 0, 0, 35 * b, -84 * b, 70 * b, -20 * b] for b in (0.2, 1.5)], 1.0)
    faster = robot.with_limits(acceleration={"knee_x": 0.5}, effort=200).retime(way)
    rates = faster.motion(np.linspace(0, faster.duration, 4001), 2)
    x = robot.coordinates(*rates)
    assert np.abs(x[1][:, 1]).max() < 0.02 * (1 + 1e-3)
    assert np.abs(x[2][:, 1]).max() < 0.5 * (1 + 1e-3)


@MASSLESS
def test_files_and_locks_keep_the_laws(tmp_path):
    robot = jounce.load(KNEE)
    jounce.save(robot, tmp_path / "knee.yaml")
    again = jounce.load(tmp_path / "knee.yaml")
    assert again == robot
    assert polynomial_laws(again.mechanism) == polynomial_laws(robot.mechanism)
    # A locked leader locks its follower where it places it; other locks leave the law.
    stiff, still = robot.locked({"knee": 0.7}), robot.locked({"hip": 0.1})
    assert stiff.joint_names == ("hip",)
    assert stiff.mechanism.closure is None
    q, zero = np.array([0.2, 0.7]), np.zeros(2)
    assert relative_error(stiff.gravity_forces(q[:1]), robot.gravity_forces(q)[:1]) < 1e-12
    q = np.array([0.1, 0.4])
    knee = robot.inverse_dynamics(q, zero, np.array([0.0, 2.0]))[1:]
    assert relative_error(still.inverse_dynamics(q[1:], zero[1:], [2.0]), knee) < 1e-12


def test_a_floating_robot_has_followers():
    base = "<body name='trunk'><freejoint/><inertial mass='3' pos='0 0 0' diaginertia='.1 .1 .1'/>"
    model = mujoco.MjModel.from_xml_string(legs(TIES["one"], base=base))
    robot = jounce.Robot.from_mujoco(model, base="floating")
    q, qd, q2d = np.random.default_rng(0).uniform(-0.5, 0.5, (3, robot.n))
    M = robot.mass_matrix(q)
    V, Vd = np.random.default_rng(1).uniform(-1, 1, (2, 6))
    Q, still = (robot.inverse_dynamics(q, qd, x, base=(np.eye(4), V, y)) for x, y in ((q2d, Vd), (0 * q2d, 0 * Vd)))
    assert relative_error(Q - still, M @ np.concatenate([Vd, q2d])) < 1e-12


FILE = """name: cam
units: SI
bodies:
  - name: thigh
    parent: ground
    joint: {name: hip, type: revolute, axis: [0, 1, 0]}
    inertia: {mass: 2, com: [0, 0, -0.2], inertia: [0.02, 0, 0, 0.02, 0, 0.01]}
  - name: shank
    parent: thigh
    joint: {name: cam, type: prismatic, axis: [1, 0, 0], follows: FOLLOWS}
    inertia: {mass: 1, com: [0, 0, -0.2], inertia: [0.02, 0, 0, 0.02, 0, 0.01]}
"""
BAD = {
    "an unknown leader": (
        "{coordinate: knee, polynomial: [0, 1, 2]}",
        ["joint 'cam' has no coordinate 'knee'; available: hip, cam"],
    ),
    "itself": ("{coordinate: cam, polynomial: [0, 1, 2]}", ["in a circle: cam -> cam"]),
    "no numbers": ("{coordinate: hip, polynomial: [a]}", ["expected a finite number"]),
    "no coefficient": ("{coordinate: hip, polynomial: []}", ["polynomial", "expected"]),
    "factors too": ("{coordinates: {hip: 1}, polynomial: [0, 1]}", ["coordinates"]),
    "other motors": (
        "{coordinate: hip, polynomial: [0, 1, 2]}\nactuated: [hip]",
        ["none: joints follow by polynomials"],
    ),
}


@pytest.mark.parametrize("name", BAD)
def test_laws_that_cannot_be_are_refused_in_one_line(tmp_path, name):
    stated, words = BAD[name]
    stated, _, more = stated.partition("\n")
    (tmp_path / "cam.yaml").write_text(FILE.replace("FOLLOWS", stated) + more)
    with expect_refusal("cam.yaml", *words):
        jounce.load(tmp_path / "cam.yaml")


@MASSLESS
def test_what_goes_with_no_polynomial_is_refused_by_name():
    robot = jounce.load(KNEE)
    with expect_refusal("knee_x follow by polynomials, without any loops"):
        robot.closed(actuated=["hip"])
    with expect_refusal("has loops, a transmission"):
        robot.with_transmission(np.eye(2), ["a", "b"])


def test_loops_beside_polynomials_are_left_out_in_words():
    more = "<equality><connect body1='b1' body2='b3' anchor='0 0 0'/></equality>"
    with pytest.warns(jounce.JounceWarning, match="its loops are left out, since j1 follow"):
        robot = jounce.Robot.from_mujoco(mujoco.MjModel.from_xml_string(legs(TIES["one"], more)))
    assert robot.n == 3


def test_motors_of_several_joints_beside_polynomials_are_left_out():
    tendons = "".join(
        f"<fixed name='t{k}'><joint joint='j2' coef='1'/><joint joint='j3' coef='{c}'/></fixed>"
        for k, c in enumerate((1, -1))
    )
    motors = "".join(f"<motor name='m{k}' tendon='t{k}'/>" for k in range(2))
    more = f"<tendon>{tendons}</tendon><actuator>{motors}</actuator>"
    with pytest.warns(jounce.JounceWarning, match="as the robot has joints that follow by polynomials: m0, m1"):
        robot = jounce.Robot.from_mujoco(mujoco.MjModel.from_xml_string(legs(TIES["one"], more)))
    assert robot.joint_names == ("j0", "j2", "j3")
