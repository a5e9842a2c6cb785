"""States and forces of Pinocchio and MuJoCo: poses, velocities, accelerations and forces agree with the libraries."""

from functools import partial

import mujoco
import numpy as np
import pinocchio
import pytest

import jounce
from jounce.engine import generic_methods
from jounce.spatial import lie
from support.files import BODY, OTHER, joint, link, origin, robot_file
from support.pinocchio_of_urdf import REAL
from support.refusals import refusal
from support.robots import random_pose, relative_error

PLACED = origin((0.3, -0.2, 0.5), (0.1, 0.7, -0.4))
LIMIT = '<limit lower="-2" upper="2" effort="1" velocity="1"/>'
URDF = (  # the joints of Pinocchio are in another order than those of the file
    link("world"), link("trunk", BODY), link("z", BODY), link("b", OTHER), link("eye"), link("a", OTHER),
    joint("flight", "world", "trunk", "floating", inner=PLACED),
    joint("leg_z", "trunk", "z", axis="1 0 0", inner=LIMIT),
    joint("leg_b", "z", "b", "prismatic", inner=PLACED + LIMIT),
    joint("leg_a", "trunk", "a", "continuous", inner=PLACED),
    joint("glue", "trunk", "eye", "fixed", inner=PLACED),
)  # fmt: skip
NAMES = {"pin": "pinocchio", "muj": "mujoco"}
MJCF = """<mujoco model='m'><option gravity='1 2 -9'/><worldbody>
<body name='box' pos='3 0 0'><freejoint/><geom size='.1'/></body>
<body name='trunk' pos='1 2 3' quat='.6 0 .8 0'><freejoint/><inertial pos='.1 .2 .3' quat='.8 .6 0 0' mass='3'
 diaginertia='.1 .2 .25'/><body name='arm' pos='.1 .2 .3'><joint name='turn' ref='20'/><geom size='.2' pos='.3 0 0'/>
 <body name='hand'><joint name='slide' type='slide' axis='1 0 0'/><geom size='.1'/>
 <body name='finger'><joint name='follow' axis='0 1 0'/><geom size='.1' pos='0 0 .1'/></body></body></body></body>
</worldbody><equality><joint joint1='follow' joint2='turn' polycoef='.2 -2 0 0 0'/></equality></mujoco>"""


@pytest.fixture(scope="module")
def pin(tmp_path_factory):
    path = robot_file(tmp_path_factory.mktemp("pin"), *URDF)
    return jounce.load(path, base="floating"), pinocchio.buildModelFromUrdf(str(path))


@pytest.fixture(scope="module")
def muj():
    model = mujoco.MjModel.from_xml_string(MJCF)
    return jounce.Robot.from_mujoco(model, base="floating", root="trunk"), model


def random_state_on_base(robot, rng, batch=()):
    """q, qd, q2d and C, V, Vd, random."""
    C = np.stack([random_pose(rng) for _ in range(int(np.prod(batch)))]).reshape(*batch, 4, 4)
    return rng.uniform(-1, 1, (3, *batch, robot.n)), (C, *rng.normal(size=(2, *batch, 6)))


def test_poses_velocities_and_accelerations_are_those_of_pinocchio(pin):
    robot, model = pin
    rng = np.random.default_rng(2)
    q = pinocchio.integrate(model, pinocchio.neutral(model), rng.normal(size=model.nv))
    v, a = rng.normal(size=(2, model.nv))
    state = robot.state_from("pinocchio", q, v, a, model=model)
    data = model.createData()
    pinocchio.forwardKinematics(model, data, q, v, a)
    pinocchio.updateFramePlacements(model, data)
    C = robot.poses(state.q, base=state.base[0])
    V, Vd = robot.twists(*state.rates, base=state.base)
    for i, name in enumerate(robot.body_names):
        frame = model.getFrameId(name)
        assert np.abs(C[i] - data.oMf[frame].homogeneous).max() < 1e-14
        for ours, of in ((V, pinocchio.getFrameVelocity), (Vd, pinocchio.getFrameAcceleration)):
            theirs = of(model, data, frame, pinocchio.LOCAL)
            assert relative_error(ours[i], np.concatenate([theirs.angular, theirs.linear])) < 1e-14


def test_forces_are_those_of_pinocchio(pin):
    robot, model = pin
    rates, base = random_state_on_base(robot, np.random.default_rng(3))
    q, v, a = robot.state_to("pinocchio", *rates, base=base, model=model)
    tau = pinocchio.rnea(model, model.createData(), q, v, a)
    Q = robot.inverse_dynamics(*rates, base=base, method="recursion")
    assert relative_error(robot.state_from("pinocchio", q, forces=tau, model=model).Q, Q) < 1e-14
    assert relative_error(robot.state_to("pinocchio", Q=Q, model=model), tau) < 1e-14
    assert tau @ v == pytest.approx(Q @ np.concatenate([base[1], rates[1]]), rel=1e-13)


def test_poses_are_those_of_mujoco(muj):
    robot, model = muj
    rng = np.random.default_rng(4)
    data = mujoco.MjData(model)
    mujoco.mj_integratePos(model, data.qpos, rng.normal(size=model.nv), 1.0)
    data.qpos[-1] = 0.2 - 2 * (data.qpos[-3] - model.qpos0[-3])
    state = robot.state_from("mujoco", data.qpos, model=model)
    mujoco.mj_kinematics(model, data)
    C = robot.poses(state.q, base=state.base)
    for i, name in enumerate(robot.body_names):
        assert np.abs(C[i, :3, 3] - data.body(name).xpos).max() < 1e-14
        assert np.abs(C[i, :3, :3].ravel() - data.body(name).xmat).max() < 1e-14


def moved_pose(C, x):
    """The pose C after a twist x for one second."""
    angle = np.linalg.norm(x[:3])
    return C @ lie.exp(x / angle, np.array([[angle]]))


@pytest.mark.parametrize("library", ["pin", "muj"])
def test_velocities_and_accelerations_are_rates_of_positions(request, library):
    """Differences of the libraries' own vectors along a motion of the base, whose rates there are V and Vd."""
    robot, model = request.getfixturevalue(library)
    (q, qd, q2d), (C, V, Vd) = random_state_on_base(robot, np.random.default_rng(5))
    to = partial(robot.state_to, NAMES[library], model=model)
    h = 1e-4

    def at(t):
        base = moved_pose(C, V * t + Vd * t * t / 2), V + t * Vd
        return to(q + t * qd + t * t * q2d / 2, qd + t * q2d, base=base)

    (before, v0), (after, v1) = at(-h), at(h)
    if library == "pin":
        difference = pinocchio.difference(model, before, after)
    else:
        mujoco.mj_differentiatePos(model, difference := np.empty(model.nv), 1, before, after)
    _, v, a = to(q, qd, q2d, base=(C, V, Vd))
    assert relative_error(difference / (2 * h), v) < 1e-7
    assert relative_error((v1 - v0) / (2 * h), a) < 1e-7


def test_forces_are_those_of_mujoco(muj):
    """The box next to the robot stays out of it."""
    robot, model = muj
    rates, base = random_state_on_base(robot, np.random.default_rng(6))
    data = mujoco.MjData(model)
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    data.qpos[:], data.qvel[:], data.qacc[:] = robot.state_to("mujoco", *rates, base=base, model=model)
    assert data.qpos[:7].tolist() == model.qpos0[:7].tolist()
    mujoco.mj_inverse(model, data)
    Q = robot.inverse_dynamics(*rates, base=base, method="recursion")
    assert relative_error(robot.state_from("mujoco", data.qpos, forces=data.qfrc_inverse, model=model).Q, Q) < 1e-13
    qfrc = robot.state_to("mujoco", Q=Q, base=base[0], model=model)
    assert relative_error(robot.state_from("mujoco", data.qpos, forces=qfrc, model=model).Q, Q) < 1e-14
    model.opt.disableflags = 0
    assert qfrc @ data.qvel == pytest.approx(Q @ np.concatenate([base[1], rates[1]]), rel=1e-12)


@pytest.mark.parametrize("batch", [(), (3,), (2, 3)])
@pytest.mark.parametrize("library", ["pin", "muj"])
def test_states_come_back(request, library, batch):
    robot, model = request.getfixturevalue(library)
    to, back = (partial(way, NAMES[library], model=model) for way in (robot.state_to, robot.state_from))
    rates, base = random_state_on_base(robot, np.random.default_rng(7), batch)
    for count in (1, 2, 3):
        vectors = generic_methods.as_tuple(to(*rates[:count], base=base[:count]))
        assert [x.shape for x in vectors] == [(*batch, model.nq), *[(*batch, model.nv)] * (count - 1)]
        state = back(*vectors)
        assert (len(state.rates), len(state.base)) == (count, count)
        for ours, expected in zip((*state.rates, *state.base), (*rates[:count], *base[:count]), strict=True):
            assert np.abs(ours - expected).max() < 1e-13


def test_both_quaternions_of_a_pose_are_that_pose(pin, muj):
    for (robot, model), name, at in ((pin, "pinocchio", slice(3, 7)), (muj, "mujoco", slice(10, 14))):
        to, back = (partial(way, name, model=model) for way in (robot.state_to, robot.state_from))
        rates, base = random_state_on_base(robot, np.random.default_rng(8), (20,))
        q = to(rates[0], base=base[:1])
        other = q.copy()
        other[:, at] *= -1
        np.testing.assert_array_equal(back(other).base[0], back(q).base[0])
        again = to(rates[0], base=back(other).base)
        assert np.abs(again - q).max() < 1e-14


def test_robots_that_stand_are_matched_by_name():
    model = pinocchio.buildSampleModelManipulator()
    robot = jounce.Robot.from_pinocchio(model)
    m, names = robot.mechanism, robot.joint_names
    swapped = jounce.Robot.from_screws(m.B, m.X, m.M, m.parent, joint_names=names, G=np.eye(6)[::-1], name="swapped")
    state = robot.state_from("pinocchio", np.arange(6.0), model=model)
    assert (state.q.tolist(), state.base, state.qd) == (list(range(6)), None, None)
    assert robot.inverse_dynamics(state.q, state.q, state.q, base=state.base).shape == (6,)
    refusal(lambda: swapped.state_from("pinocchio", np.arange(6.0), model=model), "no joint")


def test_a_wheel_that_follows_another_is_where_both_are_turned(tmp_path):
    """Of a joint without bounds Pinocchio knows no turns: 2.5 rad twice is 5 - 2 pi."""
    mimic = '<mimic joint="one" multiplier="2"/>'
    wheels = (joint("one", "world", "a", "continuous"), joint("two", "world", "b", "continuous", inner=mimic))
    path = robot_file(tmp_path, link("world"), link("a", BODY), link("b", BODY), *wheels)
    robot, model = jounce.load(path), pinocchio.buildModelFromUrdf(str(path))
    q, v = robot.state_to("pinocchio", [2.5], [0.3], model=model)
    assert sorted(v.tolist()) == [0.3, 0.6]
    assert robot.state_from("pinocchio", q, v, model=model).q == pytest.approx([2.5])
    assert robot.state_from("pinocchio", q, forces=[1.0, 1.0], model=model).Q.tolist() == [3.0]
    q[2:] = 1, 0
    refusal(lambda: robot.state_from("pinocchio", q, model=model), "'two' at 0; it follows one, expected 5")


def wrong_states(pin, muj):
    robot, model = pin
    mobile, scene = muj
    q, qpos, v, C = pinocchio.neutral(model), scene.qpos0, np.zeros(model.nv), np.eye(4)
    bad, late, off, held = q.copy(), np.stack([q, q]), qpos.copy(), qpos.copy()
    bad[3:7], late[1, 3], off[-1], held[-1] = 1, 0.2, off[-1] + 0.5, 0.2
    part = jounce.Robot.from_pinocchio(model, base="floating", root="z")
    standing = pinocchio.buildSampleModelManipulator()
    still = jounce.Robot.from_pinocchio(standing)
    simple = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><body><joint/><geom size='1'/></body></worldbody></mujoco>"
    )
    arm = jounce.Robot.from_mujoco(simple)
    yield lambda: robot.state_from("pinocchio", q[:3], model=model), ["q has shape (3,)", f"(..., {model.nq})"]
    yield lambda: robot.state_from("pinocchio", q, q, model=model), ["v has shape", f"(..., {model.nv})"]
    yield lambda: robot.state_from("pinocchio", q, None, v, model=model), ["v is None", "expected an array"]
    yield lambda: robot.state_from("pinocchio", bad, model=model), ["q: the quaternion has norm 2", "expected 1 within"]
    yield lambda: robot.state_from("pinocchio", late, model=model), ["quaternion of sample 1 has norm 1.0198"]
    yield lambda: robot.state_from("pinocchio", q, model=scene), ["model= expects a pinocchio.Model"]
    yield lambda: robot.state_from("mujoco", q, model=model), ["model= expects a mujoco.MjModel"]
    yield lambda: robot.state_from("mujoco", qpos, model=scene), ["has no joint 'leg_z'", "turn"]
    yield lambda: robot.locked({"leg_z": 0.3}).state_from("pinocchio", q, model=model), ["'leg_z' moves", "holds"]
    yield lambda: still.state_to("pinocchio", Q=[0] * 6, base=C, model=standing), ["does not float"]
    yield lambda: still.state_to("pinocchio", model=standing), ["q"]
    yield lambda: still.state_from("drake", q, model=model), ["unknown library 'drake'", "pinocchio, mujoco"]
    yield lambda: still.state_from("pinocchio", q, model=model), ["has no joint"]
    yield lambda: part.state_from("pinocchio", q, model=model), ["no floating joint moves 'z'", "trunk"]
    yield lambda: mobile.state_from("mujoco", off, model=scene), ["'follow' at", "it follows turn", "within 0.01"]
    yield lambda: mobile.state_to("mujoco", [0, 0], model=scene), ["base is None", "floats"]
    yield lambda: mobile.state_to("mujoco", [0, 0], [0, 0], base=(C,), model=scene), ["base gives C alone"]
    yield lambda: mobile.state_to("mujoco", [0, 0], base=2 * C, model=scene), ["no pose"]
    yield lambda: mobile.state_to("mujoco", np.zeros((2, 2)), base=np.stack([C] * 3), model=scene), ["q (2,), C (3,)"]
    yield lambda: still.state_to("pinocchio", [0] * 6, base=C, model=standing), ["does not float"]
    yield lambda: mobile.state_from("mujoco", held, forces=v, model=scene), ["qfrc has shape", f"(..., {scene.nv})"]
    yield lambda: mobile.state_to("mujoco", Q=np.zeros(8), model=scene), ["base is None"]
    yield lambda: arm.state_to("mujoco", Q=[0], base=C, model=simple), ["does not float"]
    yield lambda: mobile.state_to("mujoco", Q=np.zeros(2), base=C, model=scene), ["Q has shape (2,)", "(..., 8)"]


def test_refuses(pin, muj):
    for call, words in wrong_states(pin, muj):
        refusal(call, *words)


def test_a_fixed_robot_refuses_the_state_of_a_floating_one(pin):
    with pytest.warns(jounce.JounceWarning):
        robot = jounce.Robot.from_pinocchio(pin[1], base="fixed")
    q = pinocchio.neutral(pin[1])
    refusal(lambda: robot.state_from("pinocchio", q, model=pin[1]), "'flight' moves", "load it with base='floating'")


NOT_LOADED = ("alex_psyonic_hands.urdf", "quadrotor_base.urdf", "iris_simple.urdf", "ur3.urdf")  # nor with a fixed base


@pytest.mark.sweep(12)
@pytest.mark.filterwarnings("ignore::jounce.JounceWarning")
@pytest.mark.parametrize("name", sorted(name for name in REAL if not name.endswith(NOT_LOADED)))
def test_robots_of_example_robot_data_float_as_in_pinocchio(name):
    robot = jounce.load(REAL[name], base="floating")
    model = pinocchio.buildModelFromUrdf(str(REAL[name]), pinocchio.JointModelFreeFlyer())
    rates, base = random_state_on_base(robot, np.random.default_rng(1))
    q, v, a = robot.state_to("pinocchio", *rates, base=base, model=model)
    tau = pinocchio.rnea(model, model.createData(), q, v, a)
    Q = robot.inverse_dynamics(*rates, base=base, method="recursion")
    assert relative_error(robot.state_from("pinocchio", q, forces=tau, model=model).Q, Q) < 1e-12
