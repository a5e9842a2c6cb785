"""Files of loops beside a URDF: legs in the manner of example-parallel-robots, against MuJoCo and differences."""

import json
import re
import warnings
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from ruamel.yaml import YAML

import jounce
from support.closed_legs import LEGS, MujocoLeg, two_legs
from support.commands import run
from support.refusals import refusal
from support.robots import WEIGHTS, relative_error

RECURSION = {"method": "recursion"}
SPINS = "ignore:.*nothing but inertia moves spherical_free_shin1_yaw, spherical_free_shin2_yaw"
SECOND_WEIGHTS = {1: 8 / 5, 2: -1 / 5, 3: 8 / 315, 4: -1 / 560}  # of nine points, for second derivatives
SLIDER, ANKLE = LEGS["slider_knee"], LEGS["rod_ankle"]


def written(folder, leg, **changes):
    """The URDF and the YAML of a leg in a folder; keys that are changed to None are left out."""
    data = {key: value for key, value in (leg.yaml() | changes).items() if value is not None}
    (folder / "robot.urdf").write_text(leg.urdf())
    YAML(typ="safe").dump(data, folder / "robot.yaml")
    return folder / "robot.urdf", folder / "robot.yaml"


def load_leg(folder, leg, options=None, **changes):
    """The closed robot of a leg."""
    urdf, loops = written(folder, leg, **changes)
    return jounce.load(urdf, loops=loops, **(options or {}))


@pytest.fixture(scope="module", params=LEGS)
def closed_leg(request, tmp_path_factory):
    leg = LEGS[request.param]
    with warnings.catch_warnings():
        warnings.filterwarnings("error")
        warnings.filterwarnings("ignore", message=SPINS.removeprefix("ignore:"))
        return leg, load_leg(tmp_path_factory.mktemp("leg"), leg)


def leg_state(robot, rng, order=2):
    """A state (order + 1 arrays) near the start: tenths of a radian, or centimeters."""
    c = robot.mechanism.closure
    sizes = np.where(robot.mechanism.tree.X[list(c.independent), :3].any(axis=1), 0.15, 0.02)
    rates = [3.0**k * sizes * rng.uniform(-1, 1, robot.n) for k in range(order + 1)]
    return [c.start[list(c.independent)] + rates[0], *rates[1:]]


def all_at(rates, robot, t, count=1):
    """All coordinates along the polynomial of time that a state begins."""
    factorials = np.cumprod([1, *range(1, len(rates))])
    return robot.coordinates(
        sum(x * t**k / f for k, (x, f) in enumerate(zip(rates, factorials, strict=True))), **RECURSION
    )


def check_same_forces(robot, other):
    """Two robots have the same coordinates, and forces with rates in a state near their start."""
    assert robot.joint_names == other.joint_names
    rates = leg_state(robot, np.random.default_rng(6), order=4)
    for found, expected in zip(
        robot.inverse_dynamics(*rates, **RECURSION), other.inverse_dynamics(*rates, **RECURSION), strict=True
    ):
        assert relative_error(found, expected) < 1e-12


def test_a_leg_loads_closed_with_what_its_motors_leave_loose(closed_leg):
    leg, robot = closed_leg
    m = robot.mechanism
    assert robot.joint_names[: len(leg.motors)] == tuple(leg.motors)
    assert robot.n == len(leg.motors) + leg.passive
    assert len(m.closure.passive) == leg.passive
    assert [loop.joint for loop in m.loops] == [
        {"3d": "spherical", "6d": "fixed"}[loop.kind.lower()] for loop in leg.loops
    ]


def mujoco_forces(robot, peer, state, h=2e-3):
    """MuJoCo's forces of motors, its velocities and accelerations from nine positions that it finds closed, too."""
    names = robot.mechanism.tree.coordinates
    places = {k: peer.positions(dict(zip(names, all_at(state, robot, k * h), strict=True))) for k in range(-4, 5)}
    assert np.abs(peer.gaps(places[0])).max() < 1e-12
    moved = {k: np.zeros(peer.model.nv) for k in places}
    for k, turned in moved.items():
        mujoco.mj_differentiatePos(peer.model, turned, 1.0, places[0], places[k])
    qvel = sum(w * (moved[k] - moved[-k]) for k, w in WEIGHTS.items()) / h
    qacc = sum(w * (moved[k] + moved[-k]) for k, w in SECOND_WEIGHTS.items()) / h**2
    forces, unbalanced = peer.forces(places[0], qvel, qacc)
    assert unbalanced < 1e-8
    return forces


def test_motor_forces_are_those_of_mujoco(closed_leg):
    leg, robot = closed_leg
    peer, rng, motors = MujocoLeg(leg), np.random.default_rng(3), len(leg.motors)
    for _ in range(3):
        u, ud, u2d = leg_state(robot, rng)
        if leg.passive > 0:  # nothing moves these
            u2d[list(robot.mechanism.closure.passive)] = robot.passive_accelerations(u, ud, u2d, **RECURSION)
        expected, found = mujoco_forces(robot, peer, (u, ud, u2d)), robot.actuator_forces(u, ud, u2d, **RECURSION)
        assert relative_error(found[:motors], expected) < 1e-8
        assert np.abs(found[motors:]).max(initial=0.0) < 1e-10 * np.abs(expected).max()


def test_rates_of_motor_forces_are_those_of_differences(closed_leg):
    _, robot = closed_leg
    rates, h = leg_state(robot, np.random.default_rng(4), order=4), 2e-3
    found = robot.actuator_forces(*rates, **RECURSION)

    def at(t):
        factorials = np.cumprod([1, 1, 2, 3, 4])
        return [
            sum(x * t**k / f for k, (x, f) in enumerate(zip(rates[order:], factorials, strict=False)))
            for order in range(3)
        ]

    along = {k: robot.actuator_forces(*at(k * h), **RECURSION) for k in range(-4, 5)}
    assert relative_error(found[0], along[0]) < 1e-12
    assert relative_error(found[1], sum(w * (along[k] - along[-k]) for k, w in WEIGHTS.items()) / h) < 1e-7
    second = sum(w * (along[k] + along[-k]) for k, w in SECOND_WEIGHTS.items()) - 205 / 72 * along[0]
    assert relative_error(found[2], second / h**2) < 1e-5


@pytest.mark.filterwarnings("ignore:.*nothing but inertia moves spherical_free_shin1")
@pytest.mark.parametrize("name", ["slider_knee", "rod_ankle", "two_legs"])
def test_a_leg_floats(tmp_path, name):
    """Forces on a base at rest, and those of the motors, are MuJoCo's."""
    leg = two_legs() if name == "two_legs" else LEGS[name]
    robot, peer = load_leg(tmp_path, leg, {"base": "floating"}), MujocoLeg(leg, floats=True)
    motors, base = len(leg.motors), (np.eye(4), np.zeros(6), np.zeros(6))
    assert robot.mechanism.floats
    assert (robot.n, len(robot.mechanism.closure.passive)) == (motors + leg.passive, leg.passive)
    u, ud, u2d = leg_state(robot, np.random.default_rng(5))
    if leg.passive > 0:
        u2d[list(robot.mechanism.closure.passive)] = robot.passive_accelerations(u, ud, u2d, base=base, **RECURSION)
    found, expected = (
        robot.inverse_dynamics(u, ud, u2d, base=base, **RECURSION),
        mujoco_forces(robot, peer, (u, ud, u2d)),
    )
    moment_and_force = expected[[*range(motors + 3, motors + 6), *range(motors, motors + 3)]]
    assert relative_error(found[:6], moment_and_force) < 1e-8
    assert relative_error(found[6 : 6 + motors], expected[:motors]) < 1e-8
    assert np.abs(found[6 + motors :]).max(initial=0.0) < 1e-10 * np.abs(expected).max()


# Joint types, and other ways to state the same.
@pytest.mark.filterwarnings(SPINS)
def test_motors_and_balls_may_be_named_by_a_part(tmp_path):
    """As in older files of the repository, which have places of motors, too."""
    robot = load_leg(tmp_path, ANKLE)
    names = [name for name in ANKLE.yaml()["joint_name"] if name != "ankle"]
    older = load_leg(
        tmp_path, ANKLE, name_mot="motor", rotule_name="spherical", joint_name=["ankle"], joint_type=["UJOINT_XY"],
        Lidmot=[1, 2], Lidvmot=[1, 2],
    )  # fmt: skip
    assert len(names) == 4
    check_same_forces(older, robot)


def test_a_frame_may_have_the_name_of_the_joint_that_carries_it(tmp_path):
    leg = LEGS["five_bar_6d"]
    robot = load_leg(tmp_path, leg)
    urdf, loops = written(tmp_path, leg, closed_loop=[["closedloop1_B_frame", "closedloop1_A_frame"]])
    check_same_forces(jounce.load(urdf, loops=loops), robot)
    text = urdf.read_text().replace('"closedloop1_A_frame"', '"shin_left"')
    urdf.write_text(text)
    loops.write_text(loops.read_text().replace("closedloop1_A_frame", "shin_left"))
    words = "'shin_left' is a link, and a joint that carries 'closedloop1_A'; rename one of them"
    refusal(lambda: jounce.load(urdf, loops=loops), words)


@pytest.mark.parametrize("kind", ["urdf", "xml", "xacro"])
def test_jounces_own_section_closes_the_same_loops(tmp_path, kind):
    robot = load_leg(tmp_path, SLIDER)
    path, loops = tmp_path / f"robot.{kind}", tmp_path / "loops.json"
    (tmp_path / "robot.urdf").rename(path)
    section = {"loops": [{"frames": ["closedloop1_B", "closedloop1_A"]}], "actuated": list(SLIDER.motors)}
    loops.write_text(json.dumps(section))
    check_same_forces(jounce.load(path, loops=loops), robot)


def test_a_fixed_joint_is_a_weld_at_its_zero(tmp_path):
    leg = LEGS["parallelogram_hip"]
    welded = load_leg(tmp_path, leg, joint_name=["motor_ankle"], joint_type=["Fixed"], name_mot=["motor_hip"])
    locked = load_leg(tmp_path, leg, {"lock": {"motor_ankle": 0}})
    rates = [x[:1] for x in leg_state(load_leg(tmp_path, leg), np.random.default_rng(7), order=4)]
    assert welded.joint_names == locked.joint_names == ("motor_hip",)
    for found, expected in zip(welded.inverse_dynamics(*rates), locked.inverse_dynamics(*rates), strict=True):
        assert relative_error(found, expected) < 1e-12


@pytest.mark.filterwarnings("ignore:.*nothing but inertia moves (motor|knee)_left")
@pytest.mark.parametrize("axes", ["XY", "YX", "YZ", "ZY", "ZX", "XZ"])
def test_a_universal_joint_turns_about_two_axes_in_turn(tmp_path, axes):
    """The foot's pose is that of the turns, about axes of the joint's own frame, one after the other."""
    leg = LEGS["five_bar_3d"]
    joints = {"joint_name": ["motor_left"], "joint_type": [f"UJOINT_{axes}"], "name_mot": ["motor_right"]}
    tree = jounce.Robot(load_leg(tmp_path, leg, **joints).mechanism.tree)
    names = [f"motor_left_{axis}" for axis in axes]
    assert tree.joint_names[:2] == tuple(names)
    q = np.zeros(tree.n)
    q[:2] = 0.3, -0.7
    turns = []
    for axis, angle in zip(axes, q[:2], strict=True):
        turn, matrix = np.zeros(4), np.zeros(9)
        mujoco.mju_axisAngle2Quat(turn, np.eye(3)["XYZ".index(axis)], angle)
        mujoco.mju_quat2Mat(matrix, turn)
        turns.append(matrix.reshape(3, 3))
    pose = tree.poses(q, body="thigh_left")
    np.testing.assert_allclose(pose[:3, :3], turns[0] @ turns[1], atol=1e-15)
    np.testing.assert_allclose(pose[:3, 3], leg.parts[0].point, atol=1e-15)


def test_the_spin_of_a_rod_can_be_locked(tmp_path):
    """Motors do what they do beside a spin that rests, and nothing is passive."""
    spins = {f"spherical_free_shin{k}_yaw": 0.0 for k in (1, 2)}
    with pytest.warns(jounce.JounceWarning, match=SPINS.removeprefix("ignore:")):
        robot, locked = load_leg(tmp_path, ANKLE), load_leg(tmp_path, ANKLE, {"lock": spins})
    assert locked.joint_names == tuple(ANKLE.motors)
    rates = leg_state(robot, np.random.default_rng(8), order=4)
    for x in rates:
        x[2:] = 0
    forces = robot.actuator_forces(*rates, **RECURSION)
    for found, expected in zip(locked.inverse_dynamics(*(x[:2] for x in rates), **RECURSION), forces, strict=True):
        assert relative_error(found, expected[:2]) < 1e-10
    assert max(np.abs(x[2:]).max() for x in forces) > 0  # what the lock carries


@pytest.mark.filterwarnings("ignore:.*starts, where loops are closed, at")
def test_the_start_decides_on_the_branch(tmp_path):
    """The foot is below the knees, or above them."""
    leg, heights = LEGS["five_bar_3d"], []
    for start in ({}, {"knee_left": -1.5, "knee_right": 1.5}):
        robot = load_leg(tmp_path, replace(leg, stated={"start": start}))
        heights.append(robot.poses([0.0, 0.0], body="closedloop1_A")[2, 3])
    assert heights[0] == pytest.approx(-0.36, abs=1e-12)
    assert heights[1] > -0.05


@pytest.mark.filterwarnings(SPINS)
def test_it_is_saved_with_its_loops(tmp_path):
    for leg in (ANKLE, SLIDER):
        robot = load_leg(tmp_path, leg)
        jounce.save(robot, tmp_path / "saved.yaml")
        check_same_forces(jounce.load(tmp_path / "saved.yaml"), robot)


@pytest.mark.parametrize(("turn", "warns"), [(0.02, False), (0.3, True)])
def test_loops_that_are_open_at_zero_are_said(tmp_path, turn, warns):
    """Unless the file states a start, nothing says which branch is meant."""
    urdf, loops = written(tmp_path, LEGS["five_bar_3d"])
    place = re.compile('(<joint name="motor_left" type="revolute"><origin xyz="[^"]*")')
    urdf.write_text(place.sub(rf'\1 rpy="0 {turn} 0"', urdf.read_text()))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        jounce.load(urdf, loops=loops)
    words = "loops are open where all joints are at 0, and were closed with 'knee_left' at"
    assert [words in str(warning.message) for warning in caught] == [True] * warns
    _, stated = written(tmp_path, LEGS["five_bar_3d"], start={"motor_left": -turn})
    jounce.load(urdf, loops=stated)


def test_lost_drive_terms_are_said(tmp_path):
    urdf, loops = written(tmp_path, SLIDER, joint_name=["free_cylinder"], joint_type=["CARDAN"])
    joint = re.compile('(<joint name="free_cylinder".*?)</joint>')
    urdf.write_text(joint.sub(r'\1<dynamics damping="0.5"/></joint>', urdf.read_text()))
    with pytest.warns(jounce.JounceWarning, match="damping and friction of free_cylinder are left out"):
        jounce.load(urdf, loops=loops)


def test_the_command_closes_a_leg(tmp_path):
    urdf, loops = written(tmp_path, SLIDER)
    text = run("info", urdf, "--loops", loops).stdout
    assert "slider_knee: 2 coordinates, 4 bodies" in text
    assert "loops, closed: closedloop1_B - closedloop1_A (spherical)" in text
    run("convert", urdf, "--loops", loops, "-o", tmp_path / "leg.yaml")
    assert "loops, closed" in run("info", tmp_path / "leg.yaml").stdout
    refused = run("info", tmp_path / "leg.yaml", "--loops", loops, code=2).stderr
    assert "state loops themselves; --loops is for URDF and xacro files: leave it out" in refused


# Refusals.
OWN = dict.fromkeys(["closed_loop", "type", "name_mot"])
REFUSED = {  # the leg, changes of its YAML, the line, words
    "no such frame": (SLIDER, {"closed_loop": [["closedloop1_B", "closedloop1_C"]]}, 2, "unknown link 'closedloop1_C'; did you mean 'closedloop1_B'? available: thigh, "),  # noqa: E501
    "one frame": (SLIDER, {"closed_loop": [["closedloop1_B"]]}, 2, "is ['closedloop1_B']; expected two names of links"),
    "no pair": (SLIDER, {"closed_loop": ["closedloop1_B"]}, 1, "entry 1 of closed_loop of the file of loops is 'closedloop1_B'; expected a list"),  # noqa: E501
    "no loops": (SLIDER, {"closed_loop": []}, 1, "closed_loop of the file of loops is empty"),
    "one body": (SLIDER, {"closed_loop": [["closedloop1_A", "piston"]]}, 2, "are on one body; expected frames on two bodies"),  # noqa: E501
    "no such motor": (SLIDER, {"name_mot": ["motor_hip", "motor_slide"]}, 3, "name_mot: unknown joint 'motor_slide'; did you mean 'motor_slider'?"),  # noqa: E501
    "no motor has the part": (SLIDER, {"name_mot": "Mot"}, 3, "name_mot of the file of loops is 'Mot'; expected a part of one of the names motor_hip, "),  # noqa: E501
    "a motor on a ball": (SLIDER, {"joint_name": ["knee"], "joint_type": ["spherical"], "name_mot": ["knee"]}, 5, "unknown joint 'knee'"),  # noqa: E501
    "an empty part": (SLIDER, {"name_mot": ""}, 3, "name_mot of the file of loops is ''; expected a part of one"),
    "no motors": (SLIDER, {"name_mot": None}, 1, "the file of loops has no 'name_mot'; expected closed_loop, type, name_mot"),  # noqa: E501
    "more types": (SLIDER, {"type": ["3d", "3d"]}, 4, "closed_loop has 1 entries and type 2; expected one for each"),
    "unknown type": (SLIDER, {"type": ["planar"]}, 4, "is 'planar'; expected 3d, origins meet, or 6d, frames coincide"),
    "no types": (SLIDER, {"type": None}, 1, "the file of loops has no 'type'"),
    "unknown joint type": (SLIDER, {"joint_name": ["knee"], "joint_type": ["BALL"]}, 4, "joint 'knee': unknown joint_type 'BALL'; available: SPHERICAL, FIXED, CARDAN, UJOINT_XY"),  # noqa: E501
    "fewer joint types": (SLIDER, {"joint_name": ["knee"], "joint_type": []}, 4, "joint_name has 1 entries and joint_type 0; expected one for each"),  # noqa: E501
    "no such joint": (SLIDER, {"joint_name": ["kne"], "joint_type": ["FIXED"]}, 3, "joint_name: unknown joint 'kne'; did you mean 'knee'?"),  # noqa: E501
    "a joint twice": (SLIDER, {"joint_name": ["knee"] * 2, "joint_type": ["FIXED"] * 2}, 3, "entry 2 of joint_name"),
    "unknown key": (SLIDER, {"joint_names": ["knee"]}, 3, "no key 'joint_names'; did you mean 'joint_name'?"),
    "both forms": (SLIDER, {"loops": []}, 1, "has both 'closed_loop' and 'loops'; expected one of them"),
    "neither form": (SLIDER, {"closed_loop": None}, 1, "has no key that identifies it, 'closed_loop' (with type, name_mot) or 'loops' (with actuated); its keys: name_mot, type"),  # noqa: E501
    "own form without motors": (SLIDER, OWN | {"loops": [{"frames": ["piston", "shin"]}]}, 1, "the file of loops has no 'actuated'"),  # noqa: E501
    "own form without the frame": (SLIDER, OWN | {"loops": [{"frames": ["piston", "shim"]}], "actuated": ["knee"]}, 3, "unknown body 'shim'; did you mean 'shin'?"),  # noqa: E501
    "too many motors": (SLIDER, {"name_mot": ["motor_hip", "motor_slider", "knee"]}, 1, "moves in 2 ways, yet 3 coordinates are named: motor_hip, motor_slider, knee; … (keys of robot.yaml: name_mot, independent, passive, weights, start)"),  # noqa: E501
    "too few of the own form": (ANKLE, OWN | {"actuated": list(ANKLE.motors), "loops": [{"frames": [f"closedloop{k}_A", f"closedloop{k}_B"], "joint": "fixed"} for k in (1, 2)]}, 5, "motor_shin1, motor_shin2 do not determine the motion, of 4 ways at the start"),  # noqa: E501
    "passive twice": (SLIDER, {"passive": ["motor_hip"]}, 1, "passive names motor_hip, which actuated names too"),
    "no such start": (SLIDER, {"start": {"motor_slide": 0.1}}, 1, "start has no joint 'motor_slide'"),
    "out of reach": (SLIDER, {"start": {"motor_slider": 3.0}, "independent": ["motor_hip"], "name_mot": ["motor_hip"], "passive": ["motor_slider"], "closed_loop": [["closedloop1_B", "base_link"]]}, 1, "the loops cannot be closed from this start"),  # noqa: E501
}  # fmt: skip


@pytest.mark.filterwarnings(SPINS)
@pytest.mark.parametrize("name", REFUSED)
def test_files_of_loops_are_refused(tmp_path, name):
    leg, changes, line, words = REFUSED[name]
    refusal(lambda: load_leg(tmp_path, leg, **changes), f"robot.yaml:{line}: …{words}")


def test_a_joint_that_follows_another_keeps_its_type(tmp_path):
    urdf, loops = written(tmp_path, SLIDER, joint_name=["knee"], joint_type=["FIXED"])
    joint = re.compile('(<joint name="knee".*?)</joint>')
    urdf.write_text(joint.sub(r'\1<mimic joint="motor_hip"/></joint>', urdf.read_text()))
    refusal(lambda: jounce.load(urdf, loops=loops), "joint 'knee' is FIXED, yet mimics 'motor_hip' at …robot.urdf:")


def test_robots_that_state_their_loops_take_no_file(tmp_path):
    _, loops = written(tmp_path, SLIDER)
    (tmp_path / "r.xml").write_text("<mujoco/>")
    (tmp_path / "r.yaml").write_text("bodies: []")
    leave = "loops= is for URDF and xacro files: leave it out"
    refusal(lambda: jounce.load("panda", loops=loops), "panda: bundled robots state loops themselves", leave)
    refusal(lambda: jounce.load(tmp_path / "r.yaml", loops=loops), "under the keys 'loops' and 'actuated'", leave)
    refusal(lambda: jounce.load(tmp_path / "r.xml", loops=loops), "MJCF states its loops itself, as <connect>", leave)


def test_other_files_of_loops_are_refused(tmp_path):
    urdf, _ = written(tmp_path, SLIDER)
    (tmp_path / "list.yaml").write_text("[1, 2]")
    refusal(lambda: jounce.load(urdf, loops=tmp_path / "none.yaml"), "none.yaml: no such file")
    refusal(lambda: jounce.load(urdf, loops=tmp_path / "list.yaml"), "list.yaml:1: …expected keys and values")
    refusal(lambda: jounce.load(urdf, loops=urdf), "robot.urdf:1: …expected keys and values")
    refusal(lambda: jounce.load(urdf, loops=3), "loops= is 3; expected the path of a file")


@pytest.mark.parametrize("suffix", ["sdf", "usd", "usda", "usdc", "usdz", "USDZ"])
def test_sdf_and_usd_are_refused_with_their_converters(suffix):
    converters = (
        ["sdf2mjcf …sdformat-mjcf", "gz sdf -p only writes SDF"] if suffix == "sdf" else ["usd_to_urdf …writes URDF"]
    )
    words = f"x.{suffix}: jounce does not read {suffix[:3].upper()}; convert it to URDF or MJCF: "
    refusal(lambda: jounce.load(f"x.{suffix}"), words, *converters[1:])


def test_sdf_is_known_by_its_root_element(tmp_path):
    (tmp_path / "model.xml").write_text("<sdf version='1.9'><model name='m'/></sdf>")
    refusal(
        lambda: jounce.load(tmp_path / "model.xml"), "model.xml: jounce does not read SDF; convert it to URDF or MJCF"
    )


def test_transmissions_of_a_closed_leg_are_left_out_in_words(tmp_path):
    urdf, loops = written(tmp_path, SLIDER)
    ends = "".join(
        f"<joint name='{name}'><role>joint{k}</role></joint>"
        f"<actuator name='m{k}'><role>actuator{k}</role><mechanicalReduction>9</mechanicalReduction></actuator>"
        for k, name in enumerate(jounce.load(urdf, loops=loops).joint_names, 1)
    )
    kind = "<type>transmission_interface/DifferentialTransmission</type>"
    urdf.write_text(urdf.read_text().replace("</robot>", f"<transmission name='t'>{kind}{ends}</transmission></robot>"))
    with pytest.warns(jounce.JounceWarning, match="transmissions are left out, .*'t', as the robot has closed loops"):
        robot = jounce.load(urdf, loops=loops)
    assert robot == jounce.load(urdf, loops=loops, transmissions=False)
