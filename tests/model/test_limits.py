"""Limits of the joint variables: checked at the door, read from URDF, kept by every pass, shown by `jounce info`."""

import copy
import inspect
import pickle
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given

import jounce
from jounce.model import coordinates, equivalent_mechanisms, screws
from jounce.model.frame import UNIT_ROUNDING
from jounce.model.limits import LIMIT_KINDS, Limits
from jounce.model.mechanism import with_exact_integers, with_extended_precision
from support.commands import run, summary
from support.files import GOOD, LINKS, joint, robot_file
from support.refusals import expect_refusal, refusal
from support.robots import mechanisms, random_inertia, random_rotation, random_screw

PANDA = Path(__file__).parents[2] / "examples" / "panda.urdf"
ONE = {"B": [np.eye(4)], "X": [[0, 0, 1, 0, 0, 0]], "M": [np.eye(6)]}
FREE = {"lower": -np.inf} | dict.fromkeys(LIMIT_KINDS.bound_names[1:], np.inf)


def stated_limits(robot):
    return {key: getattr(robot.limits, key).tolist() for key in LIMIT_KINDS.bound_names}


def of_one(limits):
    return jounce.Robot.from_screws(**ONE, limits=limits)


def test_limits_are_infinite_where_nothing_is_stated():
    assert stated_limits(jounce.load("planar2r")) == {key: [x, x] for key, x in FREE.items()}
    assert stated_limits(of_one({"velocity": [2]})) == {key: [x] for key, x in (FREE | {"velocity": 2.0}).items()}


def test_limits_given_to_another_robot_are_copied_and_frozen():
    lower = np.array([-1.0])
    robot = of_one({"lower": lower})
    other = of_one(robot.limits)
    lower[0] = 7.0
    for same in (robot, other, copy.deepcopy(robot)):
        assert same.limits.lower[0] == -1
        with pytest.raises(ValueError, match="read-only"):
            same.limits.lower[0] = 3.0


@pytest.mark.parametrize(("limits", "words"), [
    ({"lowr": [0]}, ["unknown limit 'lowr'; did you mean 'lower'", "lower, upper, velocity, acceleration"]),
    ({"lower": [0, 0]}, ["lower has shape (2,); expected numbers (1,)"]),
    ({"upper": 1.0}, ["upper has shape ()"]),
    ({"upper": ["a"]}, ["upper holds text"]),
    ({"lower": [2], "upper": [1]}, ["joint 0", "2 and 1; expected lower <= upper"]),
    ({"lower": [np.inf]}, ["expected lower <= upper"]),
    ({"upper": [-np.inf]}, ["expected lower <= upper"]),
    ({"lower": [np.nan]}, ["nan and inf; expected"]),
    ({"velocity": [-1]}, ["velocity is -1; expected 0 or more"]),
    ({"effort": [np.nan]}, ["effort is nan"]),
    ([1, 2], ["limits is of type list"]),
    (np.zeros(4), ["limits is of type ndarray"]),
])  # fmt: skip
def test_bad_limits_are_refused(limits, words):
    refusal(lambda: of_one(limits), *words)


@given(drawn=mechanisms(largest=3))
def test_passes_keep_limits(drawn):
    """Frames move, joint variables do not: what bounds them stays."""
    m, rng = drawn
    lower = rng.normal(size=m.nb)
    bounded = jounce.Robot.from_screws(m.B, m.X, m.M, m.parent, limits={"lower": lower}).mechanism
    aligned = equivalent_mechanisms.align_frames(bounded)
    passes = (
        aligned,
        equivalent_mechanisms.slide_origins(aligned),
        equivalent_mechanisms.reduce_inertias(aligned),
        equivalent_mechanisms.minimal_mechanism(bounded),
    )
    for other in (*passes, with_exact_integers(bounded), with_extended_precision(bounded)):
        assert other.limits.lower.tolist() == lower.tolist()


@pytest.mark.parametrize(
    ("kind", "attributes", "expected"),
    [
        ("revolute", 'lower="-1.5" upper="2" velocity="3" effort="4"', (-1.5, 2, 3, 4)),
        ("prismatic", 'upper="2" velocity="0"', (0, 2, 0, np.inf)),
        ("revolute", 'lower="-2" effort="1e3"', (-2, 0, np.inf, 1e3)),
        ("revolute", "", (0, 0, np.inf, np.inf)),
        ("continuous", 'lower="1" upper="-1" velocity="3"', (-np.inf, np.inf, 3, np.inf)),
        ("prismatic", None, (-np.inf, *[np.inf] * 3)),
    ],
)
def test_urdf_limits(tmp_path, kind, attributes, expected):
    inner = "" if attributes is None else f"<limit {attributes}/>"
    robot = jounce.load(robot_file(tmp_path, *LINKS, joint("turn", "base", "arm", kind, inner=inner)))
    given = dict(zip(("lower", "upper", "velocity", "effort"), expected, strict=True))
    assert stated_limits(robot) == {key: [x] for key, x in (FREE | given).items()}


@pytest.mark.parametrize(("attributes", "words"), [
    ('lower="1" upper="-1"', ["'turn'", "1 and -1; expected lower <= upper"]),
    ('lower="1"', ["'turn'", "1 and 0; expected lower <= upper"]),
    ('lower="0" upper="1" velocity="-3"', ["'turn'", "velocity is -3; expected 0 or more"]),
    ('effort="much"', ["<limit effort='much'>", "finite number"]),
    ('upper="nan"', ["<limit upper='nan'>"]),
])  # fmt: skip
def test_bad_urdf_limits_are_refused(tmp_path, attributes, words):
    path = robot_file(tmp_path, *LINKS, joint("turn", "base", "arm", inner=f"<limit {attributes}/>"))
    refusal(lambda: jounce.load(path), f"{path}:4", *words)


def test_mimic_joints_have_limits_of_their_own():
    robot = jounce.load(PANDA)
    assert robot.n == 8
    assert robot.limits.upper[-2:].tolist() == [0.04, 0.04]
    assert robot.limits.effort[[0, -1]].tolist() == [87, 100]


def test_info_shows_limits(tmp_path):
    words = run("info", PANDA).stdout
    assert max(map(len, words.splitlines())) <= 100
    assert "panda_joint1         -2.8973 .. 2.8973 rad   2.175 rad/s  87 N m" in words
    assert "panda_finger_joint2  0 .. 0.04 m             0.2 m/s      100 N" in words
    first = summary("info", PANDA)["bodies"][0]
    given = {"lower": -2.8973, "upper": 2.8973, "velocity": 2.175, "effort": 87}
    assert first["limits"] == dict.fromkeys(LIMIT_KINDS.bound_names) | given
    turn = joint("turn", "base", "arm", "continuous", inner='<limit velocity="2"/>')
    path = robot_file(tmp_path, *LINKS, turn)
    assert ["turn", "-", "2", "rad/s", "-"] in [line.split() for line in run("info", path).stdout.splitlines()]
    assert '"lower": null' in run("info", path, "--json").stdout
    assert "limits" not in run("info", robot_file(tmp_path, *GOOD)).stdout


def test_what_passed_the_door_passes_it_unchanged():
    """Poses, screws and inertias are made exact once: to the bit the same when they come back from a file."""
    rng = np.random.default_rng(0)
    for _ in range(300):
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = random_rotation(rng) * (1 + rng.uniform(-4e-10, 4e-10)), rng.normal(size=3)
        X = random_screw(rng, ["revolute", "prismatic", "helical"][rng.integers(3)]) * (1 + rng.uniform(-9e-10, 9e-10))
        M = random_inertia(rng, 10.0 ** rng.uniform(-3, 3))
        M = M + rng.uniform(-1e-10, 1e-10, (6, 6)) * np.sqrt(np.multiply.outer(np.diag(M), np.diag(M)))
        for exact, rough in ((screws.exact_pose, T), (screws.exact_screw, X), (screws.exact_inertia, M)):
            once = exact(rough, "x")
            assert exact(once, "x").tobytes() == once.tobytes()
            assert once.tobytes() != rough.tobytes()
            assert np.abs(once - rough).max() < 2e-9 * max(1, np.abs(rough).max())
        R = screws.exact_pose(T, "x")[:3, :3]
        assert np.abs(R.T @ R - np.eye(3)).max() < UNIT_ROUNDING
        M = screws.exact_inertia(M, "x")
        assert (M == M.T).all()
        assert (M[:3, 3:] == -M[:3, 3:].T).all()
        assert (np.diag(M)[3:] == M[3, 3]).all()


def test_no_data_are_negative_zeros():
    robot = jounce.Robot.from_screws(
        [np.diag([-1.0, -1, 1, 1]) * 1.0], [[-0.0, 0, 1, -0.0, 0, 0]], [-0.0 * np.eye(6)], gravity=(-0.0, 0, 0),
        g=[-0.0], G=[[1]], limits={"lower": [-0.0]},
    ).mechanism  # fmt: skip
    for array in (robot.B, robot.X, robot.M, robot.gravity, robot.g, robot.limits.lower):
        assert not (np.signbit(array) & (array == 0)).any()


def test_a_coordinate_that_moves_nothing_is_refused():
    refusal(lambda: jounce.Robot.from_screws(**ONE, G=[[1, 0]]), "G[:, 1] is zero")


def test_limits_are_replaced_by_number_array_or_joint():
    robot = jounce.load(PANDA)
    changed = robot.with_limits(
        effort_rate=1000, velocity=[[-1, 1]] * 7 + [[-0.1, 0.2]], lower={"panda_joint1": -1},
        effort={"panda_joint2": (-50, 60), "panda_finger_joint2": np.inf}, power={"panda_joint7": 3},
        of={"effort_rate": "Q - Qgrav"},
    )  # fmt: skip
    limits = changed.limits
    assert limits.effort_rate.tolist() == [1000.0] * 8 + [np.inf]  # of the coordinates; the second finger follows
    assert limits.bounds("velocity")[:, 7].tolist() == [-0.1, 0.2]
    assert limits.bounds("effort")[:, [1, 8]].tolist() == [[-50, -np.inf], [60, np.inf]]
    assert (limits.lower[0], limits.upper[0], limits.power[6]) == (-1, 2.8973, 3)
    assert [limits.of(kind) for kind in ("effort", "effort_rate", "second_effort_rate")] == ["Q", "Q - Qgrav", "Q"]
    assert changed != robot
    assert robot.limits.effort_rate.tolist() == [np.inf] * 9
    assert changed.with_limits(effort_rate=2000).limits.of("effort_rate") == "Q"
    assert changed.with_limits(velocity=3).limits.of("effort_rate") == "Q - Qgrav"


def test_limits_of_coordinates():
    """A follower bounds the motion of its leader through its own offset and factor; its effort bounds nothing."""
    robot = jounce.Robot.from_screws(
        [np.eye(4)] * 2, [[0, 0, 1, 0, 0, 0]] * 2, [np.eye(6)] * 2, G=[[1], [-2]], g=[0, 1], joint_names=["joint1"],
        limits={"lower": [-3, -1], "upper": [3, 5], "velocity": [1, 3], "effort": [[-1, 2], [-0.1, 0.1]]},
    )  # fmt: skip
    found = coordinates.limits(robot.mechanism)
    assert found.bounds("position")[:, 0].tolist() == [-2, 1]
    assert found.bounds("velocity")[:, 0].tolist() == [-1, 1]
    assert found.bounds("effort")[:, 0].tolist() == [-1, 2]
    assert coordinates.following_efforts(robot.mechanism) == ["joint2"]


@pytest.mark.parametrize(("names", "G", "moved"), [
    (["joint2", "joint1"], np.eye(2), "'joint2' moves 'joint1'"),
    (["joint1", "joint2"], [[0, 1], [1, 0]], "'joint1' moves 'joint2'"),
    (["joint2"], [[1], [0]], "'joint2' moves 'joint1'"),
    (["joint1", "joint2"], [[1, 0], [1, 1]], None),
    (["joint1", "joint2"], np.eye(2), None),
    (["joint2", "joint1"], [[0, 1], [1, 0]], None),
    (["b", "a"], np.eye(2), None),
    (["joint2", "joint1"], None, None),  # which names the joints themselves
])  # fmt: skip
def test_a_coordinate_moves_the_joint_of_its_name(names, G, moved):
    """Else limits go to another joint in silence: each coordinate has those of the joint that it moves."""
    data = {"B": [np.eye(4)] * 2, "X": [[0, 0, 1, 0, 0, 0]] * 2, "M": [np.eye(6)] * 2}
    spatial = {"A": data["B"], "Y": data["X"], "M": data["M"]}
    doors = ((jounce.Robot.from_screws, data), (jounce.Robot.from_spatial_screws, spatial))
    for door, arrays in doors:
        if moved:
            with expect_refusal(moved, "rename it by joint_names", "columns of G"):
                door(**arrays, joint_names=names, G=G)
            continue
        robot = door(**arrays, joint_names=names, G=G, limits={"velocity": [1, 3]})
        places = robot.mechanism.joints
        for j, name in enumerate(names):
            own = places.index(name) if name in places else int(np.flatnonzero(robot.mechanism.G[:, j])[0])
            most = coordinates.limits(robot.mechanism).bounds("velocity")[1, j]
            assert most == ([1, 3][own] if G is None or np.sum(G) == 2 else np.inf) or own == 0


@pytest.mark.parametrize(("given", "words"), [
    ({"effort": {"panda_joint9": 1}}, ["unknown joint 'panda_joint9'", "did you mean"]),
    ({"effort": -1}, ["joint 'panda_joint1'", "limit of effort is -1; expected 0 or more"]),
    ({"velocity": {"panda_joint2": (1, 2)}}, ["limits of velocity are 1 and 2; expected lower <= 0 <= upper"]),
    ({"lower": {"panda_joint1": 3}}, ["'panda_joint1'", "3 and 2.8973; expected lower <= upper"]),
    ({"upper": {"panda_joint1": (1, 2)}}, ["upper of joint 'panda_joint1' is (1, 2); expected a number"]),
    ({"jerk": [1, 2]}, ["jerk has shape (2,); expected one number, (8,)", "(8, 2)"]),
    ({"jerk": np.nan}, ["limit of jerk is nan"]),
    ({"effort": 1, "of": "gravity"}, ["unknown force of a limit 'gravity'", "Q, Q - Qgrav"]),
    ({"of": {"velocity": "Q"}}, ["unknown effort limit 'velocity'"]),
    ({"velocity": 1, "of": "Q"}, ["of='Q' says which force", "effort_rate"]),
])  # fmt: skip
def test_bad_limits_of_with_limits_are_refused(given, words):
    refusal(lambda: jounce.load(PANDA).with_limits(**given), *words)


@pytest.mark.parametrize("suffix", ["yaml", "json"])
def test_limits_of_all_kinds_come_back_from_a_file(tmp_path, suffix):
    robot = jounce.load("planar2r").with_limits(
        lower={"joint1": -1}, upper=[1, 2], velocity=[[-1, 0.3], [-np.inf, 2]], acceleration=0.1, jerk=1e3, snap=3,
        effort=[[-1, 2], [-3, 3]], effort_rate=1000, second_effort_rate=1e7, power={"joint2": 5},
        of={"effort_rate": "Q - Qgrav"},
    )  # fmt: skip
    path = tmp_path / f"arm.{suffix}"
    jounce.save(robot, path)
    assert jounce.load(path) == robot
    assert jounce.load(path).limits.of("effort_rate") == "Q - Qgrav"


@pytest.mark.parametrize(
    ("actuators", "expected"),
    [
        ("<motor joint='j' gear='2' forcerange='-10 20'/>", [-20, 40]),
        ("<motor joint='j' gear='-2' forcerange='-10 20'/><motor joint='j' forcerange='-1 1'/>", [-41, 21]),
        ("<motor joint='j' forcerange='-10 20'/><motor joint='j'/>", [-np.inf, np.inf]),
        ("", [-np.inf, np.inf]),
    ],
)
def test_forces_of_actuators_bound_the_effort(tmp_path, actuators, expected):
    body = "<body name='b'><joint name='j'/><geom size='1'/></body>"
    path = tmp_path / "arm.xml"
    path.write_text(f"<mujoco><worldbody>{body}</worldbody><actuator>{actuators}</actuator></mujoco>")
    assert jounce.load(path).limits.bounds("effort")[:, 0].tolist() == expected


def test_limits_equal_their_copies_and_no_others():
    limits = jounce.load("panda").with_limits("panda").limits
    again = pickle.loads(pickle.dumps(limits))
    assert again == limits
    assert hash(again) == hash(limits)
    other = Limits(limits.table * np.where(np.arange(limits.table.shape[-1]) == 2, 2.0, 1.0), limits.without_gravity)
    assert other != limits
    assert Limits(limits.table, ()) != limits
    assert limits != 3
    zero, negative = (Limits(np.full((16, 2, 1), x)) for x in (0.0, -0.0))
    assert (zero == negative, hash(zero) == hash(negative)) == (True, True)


def test_rows_of_limits_are_attributes_keywords_and_keys():
    robot = jounce.load("planar2r")
    assert {*inspect.signature(robot.with_limits).parameters} == {
        "source", *LIMIT_KINDS.bound_names, *LIMIT_KINDS.totals, "of",
    }  # fmt: skip
    assert len({getattr(Limits, key).__doc__ for key in LIMIT_KINDS.bound_names}) == len(LIMIT_KINDS.bound_names)
    for key in LIMIT_KINDS.bound_names:
        line = dict.fromkeys(LIMIT_KINDS.stall_line, 1.0) if key in LIMIT_KINDS.stall_line else {}
        limits = robot.with_limits(**line | {key: 1.5}).limits
        assert getattr(limits, key).tolist() == [1.5, 1.5]
        assert limits.stated(1)[key] == 1.5
        assert key in LIMIT_KINDS.stall_line or limits.kinds == tuple(
            row.name for row in LIMIT_KINDS.values() if key in row.keys
        )
