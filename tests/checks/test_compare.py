"""`jounce compare`: libraries and paths agree on good robots; a robot that is not that of its file is found."""

import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import jounce
from jounce.checks.compare import compare
from jounce.engine.plan import compute
from jounce.spatial.lie import pose
from support.commands import call
from support.files import BODY, GOOD, OTHER, joint, link, origin, robot_file
from support.robots import floating, mechanisms, on_its_axis, random_mechanism
from support.several_named import named_robot
from support.units import SI

FLIES = joint("fly", "w", "base", "floating", inner=origin((0.3, 0, 0), (0, 0.4, 0)))
PANDA = Path(__file__).parents[2] / "examples" / "panda.urdf"


def checks_against(checks, library):
    return [check for check in checks if library in check.against]


@settings(max_examples=8)
@given(mechanisms(4, units=st.just(SI)))
def test_libraries_and_paths_agree_on_random_mechanisms(drawn):
    mechanism, _ = drawn
    checks = compare(jounce.Robot(mechanism), states=3, order=1)
    assert [check for check in checks if not check.passed] == []
    assert [check.quantity for check in checks_against(checks, "Pinocchio")] == ["Q", "Qgrav", "M"]
    helical = any(X[:3].any() and abs(X[:3] @ X[3:]) > 1e-12 for X in mechanism.X)
    [*others] = checks_against(checks, "MuJoCo")
    assert ("helical" in others[0].remark) if helical else len(others) == 3


def test_libraries_and_paths_agree_on_a_robot_that_floats():
    """Two trees on the base, and a joint that follows another."""
    rng = np.random.default_rng(4)
    arms = random_mechanism(rng, [-1, 0, -1], ["revolute", "prismatic", "revolute"], [1.0, 2.0, 0.5], mimic=True)
    checks = compare(jounce.Robot(floating(arms, rng)), states=2, order=1)
    assert [check for check in checks if not check.passed] == []
    for library in ("Pinocchio", "MuJoCo"):
        assert [check.quantity for check in checks_against(checks, library)] == ["Q", "Qgrav", "M"]


def test_libraries_read_the_file_of_a_robot_that_floats(tmp_path):
    glue = joint("glue", "arm", "lid", "fixed", inner=origin((0.1, 0.2, 0.3)))
    bounds = '<limit lower="-1" upper="1" effort="1" velocity="1"/>'
    items = (
        link("base", OTHER),
        link("arm", BODY),
        joint("turn", "base", "arm", inner=bounds),
        link("lid", OTHER),
        glue,
    )
    for path in (robot_file(tmp_path, *items), robot_file(tmp_path, link("w"), *items, FLIES, name="w.urdf")):
        checks = compare(jounce.load(path, base="floating"), path, order=0, states=2)
        assert [check for check in checks if not check.passed] == []
        assert {check.remark for check in checks_against(checks, "Pinocchio")} == {"its own reading of the file"}
    path = tmp_path / "r.xml"
    arm = "<body name='arm'><joint name='j'/><geom size='.1' pos='.2 0 0'/></body>"
    path.write_text(f"<mujoco><worldbody><body name='b'><freejoint/><geom size='.3'/>{arm}</body></worldbody></mujoco>")
    checks = compare(jounce.load(path, base="floating"), path, order=0, states=2)
    assert [check for check in checks if not check.passed] == []
    assert {check.remark for check in checks_against(checks, "MuJoCo")} == {"its own reading of the file"}


BALLS = """<mujoco><worldbody>
<body name='arm' pos='0 0 .3'><joint name='turn' axis='0 1 0'/><geom size='.2' pos='.3 0 0'/>
<body name='rod' pos='.4 0 0'><joint name='ball' type='ball' pos='0 .1 0'/><geom size='.1' pos='.2 0 0'/></body></body>
<body name='stone' pos='3 0 0'><freejoint name='fly'/><geom type='box' size='.1 .2 .3' pos='.1 0 0'/></body>
</worldbody></mujoco>"""


def test_libraries_and_paths_agree_on_joints_of_several_screws(tmp_path):
    path = tmp_path / "balls.xml"
    path.write_text(BALLS)
    robot = jounce.load(path)
    for source, remark in ((path, "its own reading of the file"), (None, "our data")):
        checks = compare(robot, source, order=1, states=2)
        assert [check for check in checks if not check.passed] == []
        assert {check.remark for check in checks_against(checks, "MuJoCo")} == {remark}
        assert [check.quantity for check in checks_against(checks, "Pinocchio")] == ["Q", "Qgrav", "M"]
    path = robot_file(tmp_path, link("w"), link("base", BODY), FLIES.replace("floating", "planar"))
    checks = compare(jounce.load(path), path, order=1, states=2)
    assert "no planar joints" in checks_against(checks, "MuJoCo")[0].remark
    assert {check.remark for check in checks_against(checks, "Pinocchio")} == {"its own reading of the file"}
    path = robot_file(tmp_path, link("w"), link("base", BODY), joint("slide", "w", "base", "planar", axis="1 0 0"))
    checks = compare(jounce.load(path), path, order=0, states=2)
    assert [check for check in checks if not check.passed] == []
    assert "takes z for the normal" in checks_against(checks, "Pinocchio")[0].remark


def test_warnings_of_mujoco_are_passed_on_and_leave_no_log(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    B, X, M = [np.eye(4)] * 2, [[0, 0, 1, 0, 0, 0]] * 2, jounce.inertia_matrix(1, [1, 0, 0], np.zeros((3, 3)))
    odd = M.copy()
    odd[1, 2] = odd[2, 1] = 1e100  # no body has it, and M(q) is far from regular for MuJoCo
    with pytest.warns(jounce.JounceWarning, match="MuJoCo warns: .*singular"):
        compare(jounce.Robot.from_screws(B, X, [M, odd]), states=1, order=0)
    assert list(tmp_path.iterdir()) == []


def test_libraries_read_the_file_themselves_where_they_can():
    checks = compare(jounce.load(PANDA), PANDA)
    assert {check.remark for check in checks_against(checks, "Pinocchio")} == {"its own reading of the file"}
    assert {check.remark for check in checks_against(checks, "MuJoCo")} == {"our data"}
    assert [check for check in checks if not check.passed] == []


def test_a_robot_that_is_not_that_of_its_file_is_found():
    robot = jounce.load(PANDA)
    M = robot.mechanism.M.copy()
    M[3] *= 1.001
    checks = compare(jounce.Robot(replace(robot.mechanism, M=M)), PANDA, order=0)
    assert [check.passed for check in checks_against(checks, "Pinocchio")] == [False, False, False]
    assert all(check.passed for check in checks_against(checks, "MuJoCo"))  # which is given our data


def test_a_robot_with_locked_joints_is_handed_to_the_library():
    checks = checks_against(
        compare(jounce.load(PANDA, lock={"panda_joint3": 0.2}), PANDA, order=0, states=2), "Pinocchio"
    )
    assert checks[0].remark.startswith("joints differ")
    assert [(check.quantity, check.remark, check.passed) for check in checks[1:]] == [
        (quantity, "our data", True) for quantity in ("Q", "Qgrav", "M")
    ]


def test_a_file_that_pinocchio_refuses_is_compared_all_the_same(tmp_path, capfd):
    path = robot_file(tmp_path, *GOOD)  # a revolute joint without limits
    checks = checks_against(compare(jounce.load(path), path, order=0, states=2), "Pinocchio")
    assert checks[0].error is None
    assert "refuses the file: " in checks[0].remark
    assert "does not specify limits" in checks[0].remark
    assert [check.passed for check in checks[1:]] == [True] * 3
    assert capfd.readouterr() == ("", "")  # where urdfdom would print it on four lines


def test_rotors_of_actuators_are_left_out_as_all_drives_are(tmp_path):
    path = tmp_path / "arm.xml"
    body = '<body><joint name="k" axis="0 1 0" armature="0.1"/><geom size=".1" pos=".3 0 0"/></body>'
    motor = '<motor joint="k" gear="50" armature="0.01"/>'
    path.write_text(f"<mujoco><worldbody>{body}</worldbody><actuator>{motor}</actuator></mujoco>")
    try:
        robot = jounce.load(path)
    except jounce.JounceError:
        pytest.skip("this MuJoCo knows no rotors of actuators")
    assert robot.drives.armature.tolist() == [0.1 + 50**2 * 0.01]
    checks = checks_against(compare(robot, path, order=0, states=2), "MuJoCo")
    assert [(check.remark, check.passed) for check in checks] == [("its own reading of the file", True)] * 3


@pytest.mark.parametrize("mass", [1e-6, 2.0, 1e7])
def test_forces_that_are_zero_are_no_false_alarm(mass):
    robot = on_its_axis(mass)
    assert [check for check in compare(robot, states=3) if not check.passed] == []
    assert np.abs(robot.gravity_forces([[0.3]])).max() < 1e-14 * mass


def test_heavy_bodies_are_no_false_alarm():
    """MuJoCo's model keeps no mass of those that it was compiled with."""
    boom = jounce.inertia_matrix(12_000, [6, 0.2, 0.3], np.diag([3e4, 2e5, 2e5]))
    tool = jounce.inertia_matrix(3, [0.1, 0, 0], 0.01 * np.eye(3))
    B, X, M = [np.eye(4), pose(np.eye(3), np.array([[12], [0], [0]]))], np.eye(6)[[1, 2]], [boom, tool]
    checks = compare(jounce.Robot.from_screws(B, X, M, name="boom"), states=5, order=0)
    assert [check for check in checks if not check.passed] == []
    assert len(errors := [check.error for check in checks_against(checks, "MuJoCo")]) == 3
    assert max(errors) < 1e-13


@pytest.mark.parametrize("added", [1e-3, 1e-6])
def test_a_force_that_should_be_zero_is_found(monkeypatch, added):
    def wrong_gravity(mechanism, name, *given, **options):
        return compute(mechanism, name, *given, **options) + (added if name == "gravity_forces" else 0)

    monkeypatch.setattr("jounce.checks.compare.compute", wrong_gravity)
    wrong = [check for check in compare(on_its_axis(), states=3, order=0) if not check.passed]
    assert {check.quantity for check in wrong} == {"Qgrav"}


def test_differences_show_a_rate_that_is_wrong(monkeypatch):
    def wrong(robot, name, given, **options):
        results = compute(robot, name, given, **options)
        return (results[0], 1.001 * results[1], *results[2:]) if len(given) > 3 else results

    monkeypatch.setattr("jounce.checks.compare.compute", wrong)
    [first, _] = [check for check in compare(jounce.load("planar2r")) if "differences" in check.against]
    assert not first.passed


@pytest.mark.parametrize("path", [None, PANDA])
@pytest.mark.parametrize("library", ["mujoco", "pinocchio"])
def test_libraries_that_are_not_there_are_said_to_be_missing(monkeypatch, library, path):
    monkeypatch.setitem(sys.modules, library, None)
    checks = compare(jounce.load(path or "planar2r"), path, states=2, order=0)
    assert [check.remark for check in checks if check.error is None] == ["not installed"]


def test_massless_and_impossible_bodies_are_compared_too():
    mechanism = random_mechanism(np.random.default_rng(0), [-1, 0, 1], ["revolute"] * 3, [1.0] * 3)
    M = mechanism.M.copy()
    M[1] = 0
    M[2, 0, 0] += 5
    checks = compare(jounce.Robot(replace(mechanism, M=M)), states=3)
    assert len(checks_against(checks, "MuJoCo")) == 3
    assert [check for check in checks if not check.passed] == []


@pytest.mark.parametrize("robot", ["iiwa14", PANDA])
def test_the_command_prints_a_table_of_the_worst_errors(robot):
    result = call("compare", robot, "--states", "4")
    assert result.exit_code == 0, result.output
    assert "4 random states: all agree" in result.output
    assert all(word in result.output for word in ("Pinocchio", "MuJoCo", "differences of Qd", "worst error"))


def test_the_command_prints_json():
    result = call("compare", "planar2r", "--states", "3", "--order", "1", "--json")
    data = json.loads(result.output)
    assert data["passed"]
    assert {"quantity", "against", "error", "allowed", "remark", "passed"} == set(data["checks"][0])


def test_the_command_ends_with_1_where_something_differs(monkeypatch):
    monkeypatch.setattr("jounce.checks.compare.MAX_COMPARISON_ERRORS", {"exact": 0.0, "differences": 0.0})
    result = call("compare", "planar2r", "--states", "3")
    assert result.exit_code == 1
    assert "TOO LARGE" in result.output


@pytest.mark.parametrize("floats", [False, True])
def test_joints_of_several_screws_are_compared_along_motions(floats):
    checks = compare(named_robot(floats=floats), states=3, order=2)
    assert [check for check in checks if not check.passed] == []
    assert max(check.error for check in checks_against(checks, "differences")) < 1e-11
    assert max(check.error for check in checks_against(checks, "closed form")) < 1e-13
