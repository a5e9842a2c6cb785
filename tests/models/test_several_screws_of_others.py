"""Balls, planar and free joints amid trees: the forces of Pinocchio and MuJoCo, and rates of these."""

from math import factorial

import mujoco
import numpy as np
import pytest
from test_from_pinocchio import FREE, composite, random_model

import jounce
from jounce.model import positions
from support.files import BODY, OTHER, joint, link, origin, robot_file
from support.pinocchio_of_urdf import pinocchio
from support.refusals import refusal
from support.robots import parts, relative_error

TREES = {
    "one ball": ([FREE["spherical"]], [0]),
    "one planar": ([FREE["planar"]], [0]),
    "one free body": ([FREE["floating"]], [0]),
    "a ball in a chain": ([pinocchio.JointModelRX, FREE["spherical"], pinocchio.JointModelPY], [0, 1, 2]),
    "several branches": (
        [
            *(pinocchio.JointModelRX, FREE["spherical"], FREE["planar"], pinocchio.JointModelPZ, FREE["floating"]),
            *(pinocchio.JointModelRUBY, FREE["spherical"]),
        ],
        [0, 1, 1, 2, 3, 4, 5],
    ),
    "composites": (
        [
            lambda: composite(FREE["spherical"](), pinocchio.JointModelRUBY(), FREE["planar"](), FREE["floating"]()),
            pinocchio.JointModelRX,
        ],
        [0, 1],
    ),
}


def pinocchio_tree(name):
    kinds, parents = TREES[name]
    return random_model([kind() for kind in kinds], parents)


def subgroup_motion(model, t, x, q):
    """q, v, a at t of a motion along x from q: every joint moves on a one-parameter subgroup of its motions."""
    return pinocchio.integrate(model, q, x * np.sin(t)), x * np.cos(t), -x * np.sin(t)


def start(model, seed=0):
    rng = np.random.default_rng(seed)
    return rng.normal(size=model.nv), pinocchio.integrate(model, pinocchio.neutral(model), rng.normal(size=model.nv))


@pytest.mark.parametrize("name", TREES)
def test_forces_and_states_are_those_of_pinocchio(name):
    model = pinocchio_tree(name)
    robot = jounce.Robot.from_pinocchio(model)
    assert (robot.nv, sum(len(x.group.axes) for x in positions.multiscrew_joints(robot.mechanism).values()) > 0) == (
        model.nv,
        True,
    )
    x, q = start(model)
    vectors = subgroup_motion(model, 0.4, x, q)
    tau = pinocchio.rnea(model, model.createData(), *vectors)
    state = robot.state_from("pinocchio", *vectors, forces=tau, model=model)
    for method in ("recursion", "closed_form"):
        assert relative_error(robot.inverse_dynamics(*state.rates, method=method), state.Q) < 1e-12
    back = robot.state_to("pinocchio", *state.rates, Q=state.Q, model=model)
    assert back[1] @ tau == pytest.approx(state.qd @ state.Q, rel=1e-13)
    for ours, theirs in zip(back, (*vectors, tau), strict=True):
        assert relative_error(ours, theirs) < 1e-14


@pytest.mark.parametrize("name", TREES)
def test_rates_of_forces_are_those_of_pinocchio_along_a_motion(name):
    """The derivatives of the polynomial through Pinocchio's forces at 15 times: to the limit of differences."""
    model = pinocchio_tree(name)
    robot, data = jounce.Robot.from_pinocchio(model), model.createData()
    x, q = start(model, 1)
    x *= 0.3
    own = robot.state_from("pinocchio", *subgroup_motion(model, 0.0, x, q), model=model)
    rates = [own.q, *(own.qd * np.sin(k * np.pi / 2) for k in range(1, 6))]
    times = 0.5 * np.arange(-7, 8) / 7
    taus = [pinocchio.rnea(model, data, *subgroup_motion(model, t, x, q)) for t in times]
    along = [robot.state_from("pinocchio", subgroup_motion(model, t, x, q)[0], forces=tau, model=model).Q
        for t, tau in zip(times, taus, strict=True)]  # fmt: skip
    coefficients = np.linalg.solve(np.vander(times, increasing=True), along)
    for method in ("recursion", "closed_form"):
        found = robot.inverse_dynamics(*rates, method=method)
        for k, (ours, allowed) in enumerate(zip(found, (1e-12, 1e-10, 1e-9, 1e-8), strict=True)):
            assert relative_error(ours, factorial(k) * coefficients[k]) < allowed, (method, k)


def test_a_base_and_balls_behind_it_are_those_of_pinocchio():
    model = random_model(
        [FREE["floating"](), pinocchio.JointModelRX(), FREE["spherical"](), FREE["planar"]()], [0, 1, 1, 2]
    )
    robot = jounce.Robot.from_pinocchio(model, base="floating")
    vectors = subgroup_motion(model, 0.3, *start(model, 2))
    tau = pinocchio.rnea(model, model.createData(), *vectors)
    state = robot.state_from("pinocchio", *vectors, forces=tau, model=model)
    assert relative_error(robot.inverse_dynamics(*state.rates, base=state.base), state.Q) < 1e-12
    for ours, theirs in zip(
        robot.state_to("pinocchio", *state.rates, base=state.base, Q=state.Q, model=model), (*vectors, tau), strict=True
    ):
        assert relative_error(ours, theirs) < 1e-14


MJCF = """<mujoco model='odd'><option gravity='1 -2 -9'/><worldbody>
<body name='arm' pos='.1 .2 .3' quat='.5 .6 -.3 .2'>
 <joint name='lift' type='slide' axis='1 2 3' ref='.1'/><joint name='roll' axis='1 0 .2' pos='0 -.2 .1' ref='20'/>
 <joint name='rod' type='ball' pos='.1 .2 -.1' armature='.3' damping='.2'/>
 <joint name='slide' type='slide' axis='1 0 .2' pos='0 -.2 .1' ref='.2'/>
 <inertial mass='2' pos='.1 .05 .2' fullinertia='.04 .05 .06 .01 -.005 .002'/>
 <body name='head' pos='0 .2 .5' euler='20 0 -10'><joint name='neck' type='ball'/>
  <geom type='box' size='.1 .2 .05' pos='.1 0 0'/></body></body>
<body name='stone' pos='3 1 2' quat='.6 0 .8 0'><freejoint name='fly'/><geom type='box' size='.1 .2 .3' pos='.1 .2 0'/>
 <site name='top'/><body name='lid'><joint name='hinge' pos='.1 0 0'/><geom size='.2' pos='.2 0 0'/></body></body>
<body name='box' pos='3 0 0'><freejoint name='drift'/><geom size='.1' pos='.1 0 0'/></body>
</worldbody></mujoco>"""


@pytest.fixture
def mujoco_pair():
    model = mujoco.MjModel.from_xml_string(MJCF)
    robot = jounce.Robot.from_mujoco(model)
    data, rng = mujoco.MjData(model), np.random.default_rng(1)
    mujoco.mj_integratePos(model, data.qpos, rng.normal(size=model.nv), 1.0)
    data.qvel[:], data.qacc[:] = rng.normal(size=(2, model.nv))
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    return robot, model, data


@pytest.mark.parametrize("drives", [False, True])
def test_forces_and_states_are_those_of_mujoco(mujoco_pair, drives):
    robot, model, data = mujoco_pair
    if drives:
        robot = robot.with_drives()
    else:
        model.dof_armature[:] = model.dof_damping[:] = 0
    mujoco.mj_inverse(model, data)
    theirs = data.qpos, data.qvel, data.qacc, data.qfrc_inverse
    state = robot.state_from("mujoco", *theirs[:3], forces=theirs[3], model=model)
    for method in ("recursion", "closed_form"):
        Q = robot.inverse_dynamics(*state.rates, method=method)
        assert relative_error(Q, state.Q) < 1e-12
        assert relative_error(Q[2:5], state.Q[2:5]) < 1e-12  # of the ball, whose drive train is small
    for ours, expected in zip(robot.state_to("mujoco", *state.rates, Q=state.Q, model=model), theirs, strict=True):
        assert relative_error(ours, expected) < 1e-13


def test_what_is_not_a_number_stays_where_it_is(mujoco_pair):
    robot, model, data = mujoco_pair
    data.joint("lift").qpos[:] = np.nan
    q = robot.state_from("mujoco", data.qpos, model=model).q
    assert np.flatnonzero(np.isnan(q)).tolist() == [robot.joint_names.index("lift")]


def test_q_means_what_qpos_means_in_mujoco(mujoco_pair):
    """But for the order of quaternions: a free joint has the pose of its body in the world, a ball starts at 1."""
    robot, model, data = mujoco_pair
    q = robot.state_from("mujoco", data.qpos, model=model).q
    at = {x.name: q[x.numbers] for x in positions.multiscrew_joints(robot.mechanism).values()}
    for name in ("fly", "drift"):
        np.testing.assert_allclose(at[name][[0, 1, 2, 6, 3, 4, 5]], data.joint(name).qpos, atol=1e-15)
    for name in ("rod", "neck"):
        np.testing.assert_allclose(at[name][[3, 0, 1, 2]], data.joint(name).qpos, atol=1e-15)
    mujoco.mj_kinematics(model, data)
    for name in ("arm", "head", "stone", "lid", "box"):
        C = robot.poses(q, body=name)
        assert np.abs(C[:3, 3] - data.body(name).xpos).max() < 1e-14
        assert np.abs(C[:3, :3].ravel() - data.body(name).xmat).max() < 1e-14


def test_base_fixed_welds_free_bodies_where_the_file_has_them(mujoco_pair):
    _, model, _ = mujoco_pair
    with pytest.warns(jounce.JounceWarning, match=r"welds at zero: fly \(floating\), drift \(floating\)"):
        robot = jounce.Robot.from_mujoco(model, base="fixed")
    still = mujoco.MjModel.from_xml_string(STILL)
    q = robot.state_from("mujoco", still.qpos0, model=still).q
    assert robot.poses(q, body="box")[:3, 3].tolist() == [3, 0, 0]


STILL = MJCF.replace("<freejoint name='fly'/>", "").replace("<freejoint name='drift'/>", "")


@pytest.mark.filterwarnings("ignore:.*physically inconsistent inertia:jounce.JounceWarning")
@pytest.mark.filterwarnings("ignore:.*bodies without mass that carry mass:jounce.JounceWarning")
@pytest.mark.parametrize("suffix", [".yaml", ".json"])
def test_files_hold_such_joints_to_the_last_bit(mujoco_pair, tmp_path, suffix):
    trees = [mujoco_pair[0], *(jounce.Robot.from_pinocchio(pinocchio_tree(name)) for name in TREES)]
    for robot in trees:
        path, again = tmp_path / f"robot{suffix}", tmp_path / f"again{suffix}"
        jounce.save(robot, path)
        same = jounce.load(path)
        assert (same, parts(same)) == (robot, parts(robot))
        jounce.save(same, again)
        assert again.read_bytes() == path.read_bytes()


PLACED = origin((0.3, -0.2, 0.5), (0.1, 0.7, -0.4))
LIMIT = '<limit lower="-1" upper="1" effort="1" velocity="1"/>'
DISC = (link("world"), link("disc", BODY), link("arm", OTHER), joint("turn", "disc", "arm", inner=LIMIT))


@pytest.mark.parametrize("axis", ["0 0 1", "1 0 0", "", "0 3 -4", "0 0 -2"])
def test_the_axis_of_a_planar_joint_is_the_normal_of_its_plane(tmp_path, axis):
    path = robot_file(tmp_path, *DISC, joint("slide", "world", "disc", "planar", axis=axis, inner=PLACED))
    robot = jounce.load(path)
    assert robot.mechanism.default_axes == (() if axis else ("slide.wz",))
    normal = np.array(axis.split() or [1, 0, 0], dtype=float)
    normal /= np.linalg.norm(normal)
    X = robot.mechanism.X[:3]
    np.testing.assert_allclose(X[0], [*normal, 0, 0, 0], atol=1e-15)
    assert np.abs(X[1:, 3:] @ normal).max() < 1e-15
    placed, moved = (robot.poses([*p, 0.1], body="disc") for p in ([0, 0, 1, 0], [2, 3, 0.6, 0.8]))
    C = np.linalg.inv(placed) @ moved
    assert np.abs(C[:3, :3] @ normal - normal).max() < 1e-15
    assert abs(normal @ C[:3, 3]) < 1e-15
    assert np.linalg.norm(C[:3, 3]) == pytest.approx(np.sqrt(13))
    if axis == "0 0 1":
        model = pinocchio.buildModelFromUrdf(str(path))
        vectors = subgroup_motion(model, 0.3, *start(model))
        tau = pinocchio.rnea(model, model.createData(), *vectors)
        state = robot.state_from("pinocchio", *vectors, forces=tau, model=model)
        assert relative_error(robot.inverse_dynamics(*state.rates), state.Q) < 1e-12


@pytest.mark.parametrize("kind", ["link alone", "floating joint"])
def test_a_single_link_floats_as_a_free_joint_of_the_ground(tmp_path, kind):
    alone = link("world"), link("stone", BODY), joint("fly", "world", "stone", "floating", inner=PLACED)
    path = robot_file(tmp_path, *(alone[1:2] if kind == "link alone" else alone))
    robot = jounce.load(path, base="floating")
    assert (robot.nq, robot.n, robot.mechanism.floats, robot.body_names) == (7, 6, False, ("stone",))
    q, v = [1, 2, 3, 0, 0.6, 0, 0.8], [0, 0, 0, 0, 0, 0]
    assert robot.poses(q, body="stone")[:3, 3].tolist() == [1, 2, 3]
    fall = robot.forward_dynamics(q, v, v)
    assert np.abs(robot.poses(q, body="stone")[:3, :3] @ fall[3:] - robot.gravity).max() < 1e-13
    if kind == "link alone":
        refusal(lambda: jounce.load(path), "no movable joint among 1 link and 0 joints", "base='floating'")
    else:
        assert jounce.load(path).nq == 7  # its q is the pose in the axes of the joint


def test_a_free_body_of_mujoco_is_a_robot(tmp_path):
    path = tmp_path / "stone.xml"
    path.write_text("<mujoco><worldbody><body name='stone' pos='1 2 3'><freejoint/><geom size='.1'/><site name='top'/>"
                    "</body></worldbody></mujoco>")  # fmt: skip
    for options in ({}, {"base": "floating"}):
        robot = jounce.load(path, **options)
        assert (robot.nq, robot.n, robot.mechanism.floats) == (7, 6, False)
        np.testing.assert_array_equal(robot.mechanism.B, [np.eye(4)])


def test_such_joints_are_locked_as_a_whole():
    robot = jounce.Robot.from_pinocchio(pinocchio_tree("several branches"))
    refusal(lambda: robot.locked({"j2.wx": 0.1}), "'j2.wx' is one velocity of the ball joint 'j2'", "{'j2': [0.0,")
    refusal(lambda: robot.locked({"j2": 0.1}), "ball joint 'j2' is locked at 0.1", "qx, qy, qz, qw")
    refusal(lambda: robot.locked({"j2": [0, 0, 0, 0]}), "ball joint 'j2' is locked at [0, 0, 0, 0]")
    held = robot.locked({"j2": [0, 1.2, 0, 1.6], "j4": 0.3})
    rng = np.random.default_rng(0)
    q, v, a = rng.normal(size=robot.nq), *rng.normal(size=(2, robot.n))
    j2 = next(x for x in positions.multiscrew_joints(robot.mechanism).values() if x.name == "j2")
    q[j2.numbers], still = [0, 0.6, 0, 0.8], [*range(*j2.coordinates.indices(99)), robot.joint_names.index("j4")]
    v[still] = a[still] = 0
    at = np.ones(robot.nq, dtype=bool)
    at[j2.numbers] = False
    j4 = positions.names(robot.mechanism).index("j4")
    q[j4], at[j4] = 0.3, False
    Q = robot.inverse_dynamics(q, v, a)
    kept = [j for j in range(robot.n) if j not in still]
    assert relative_error(held.inverse_dynamics(q[at], v[kept], a[kept]), Q[kept]) < 1e-12


def screw_refusals():
    model = pinocchio_tree("a ball in a chain")
    robot = jounce.Robot.from_pinocchio(model)
    q, bad = pinocchio.neutral(model), pinocchio.neutral(model)
    bad[1:5] = 0.9
    other = random_model([pinocchio.JointModelRX(), FREE["planar"](), pinocchio.JointModelPY()], [0, 1, 2])
    yield lambda: robot.state_from("pinocchio", bad, model=model), ["q of 'j2': the quaternion has norm 1.8"]
    yield lambda: robot.state_from("pinocchio", q[:-1], model=other), ["no ball joint 'j2'"]
    scene = mujoco.MjModel.from_xml_string(MJCF)
    odd = jounce.Robot.from_mujoco(scene)
    yield lambda: odd.state_to("mujoco", Q=np.zeros(odd.nv), model=scene), ["q is None"]
    yield lambda: odd.state_to("mujoco", np.zeros(odd.n), model=scene), ["q has shape (22,)"]
    yield lambda: odd.state_from("mujoco", 2 * scene.qpos0, model=scene), ["qpos of 'rod': the quaternion has norm 2"]


def test_refuses():
    for call, words in screw_refusals():
        refusal(call, *words)


OWN = """\
units: SI
bodies:
  - name: a
    parent: ground
    joint: {name: rod, type: ball, point: [0, 0, 0.1], velocities: {wx: {drive: {damping: 1}}}}
"""


@pytest.mark.parametrize(("old", "new", "words"), [
    ("type: ball", "type: bal", [":5", "joint 'rod'", "unknown joint type 'bal'", "ball"]),
    ("type: ball", "type: ball, axis: [0, 0, 1]", [":5", "no key 'axis'"]),
    ("point: [0, 0, 0.1]", "point: [0, 0.1]", [":5", "point", "3 numbers"]),
    ("point: [0, 0, 0.1]", "screws: [[1, 0, 0, 0, 0, 0]]", [":5", "screws", "3 rows of 6 numbers"]),
    ("point: [0, 0, 0.1]", "screws: [[1,0,0,0,0,0],[1,0,0,0,0,0],[0,0,1,0,0,0]]", [":5", "wx, wy, wz in some frame"]),
    ("point", "screws: [], point", [":5", "both 'screws' and 'point'"]),
    ("{wx:", "{vx:", [":5", "velocities of joint 'rod'", "no key 'vx'"]),
    ("{wx:", "{wx: 3, wy:", [":5", "wx of velocities", "keys and values"]),
    ("damping: 1", "damping: -1", [":5", "damping is -1"]),
    ("type: ball", "type: ball, follows: {coordinates: {}}", [":5", "no key 'follows'"]),
])  # fmt: skip
def test_bad_joints_in_a_file_are_refused(tmp_path, old, new, words):
    path = tmp_path / "arm.yaml"
    assert old in OWN
    path.write_text(OWN.replace(old, new, 1))
    refusal(lambda: jounce.load(path), str(path), *words)
