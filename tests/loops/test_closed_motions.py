"""Motions of robots with closed loops: branches, lost constraints, limits of passive joints, tables."""

import json
import re

import numpy as np
import pytest
from click import ClickException

import jounce
from jounce import Motion
from jounce.cli import main
from jounce.engine import closed_path
from jounce.io.tables import read
from support.closed_robots import fivebar_swing
from support.refusals import expect_refusal


def rod_body(name, joint, parent, x):
    rod = {"mass": 1, "com": [0.1, 0, 0], "inertia": [0.01, 0, 0, 0.01, 0, 0.01]}
    revolute = {"name": joint, "type": "revolute", "axis": [0, 0, 1]}
    return {"name": name, "parent": parent, "pose": {"position": [x, 0, 0]}, "joint": revolute, "inertia": rod}


# rods of 0.2 and 0.3 m on a base of 0.2 m: stretched, and singular, only where the shoulders are at pi and 0
SHORT = {
    "name": "short",
    "units": "SI",
    "gravity": [0, -9.81, 0],
    "bodies": [
        rod_body("l1", "a1", "ground", -0.1),
        rod_body("l2", "p1", "l1", 0.2),
        rod_body("r1", "a2", "ground", 0.1),
        rod_body("r2", "p2", "r1", 0.2),
    ],
    "frames": [{"name": f"t{body[0]}", "body": body, "pose": {"position": [0.3, 0, 0]}} for body in ("l2", "r2")],
    "loops": [{"frames": ["tl", "tr"]}],
    "actuated": ["a1", "a2"],
    "start": {"a1": 2.2, "p1": -1, "a2": 0.9, "p2": 1.0},
}
OTHER = {"left_shoulder": 2.2, "left_elbow": -3.4, "right_shoulder": 0.94, "right_elbow": 3.4}  # another branch
PASSIVE = ("left_elbow", "right_elbow")


@pytest.fixture(scope="module")
def short(tmp_path_factory):
    path = tmp_path_factory.mktemp("robots") / "short.json"
    path.write_text(json.dumps(SHORT))
    return jounce.load(path)


def through(short, at, off=0.0):
    """From the start in a straight line to the stretched configuration, or past it, and as far beyond."""
    way = np.array([np.pi - off, 0.0]) - short.mechanism.closure.start[[0, 2]]
    return Motion.polynomial([[x, v / at] for x, v in zip(short.mechanism.closure.start[[0, 2]], way, strict=True)], 1)


def test_forces_along_are_those_of_the_states(bundled_fivebar):
    motion = fivebar_swing()
    along = bundled_fivebar.forces_along(motion, [0.3, 1.7])
    for found, expected in zip(along.forces, bundled_fivebar.inverse_dynamics(*motion([0.3, 1.7])), strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-11, atol=1e-11)


def test_a_motion_leads_where_no_straight_line_from_the_start_does(short):
    """Both shoulders turn round once; the straight line from the start to any time leads along another branch."""
    motion = Motion.polynomial([[2.2, 2 * np.pi], [0.9, 2 * np.pi]], 1.0)
    along = short.forces_along(motion, [0.0, 1.0], order=0)
    np.testing.assert_allclose(*along.forces[0], atol=1e-12)


@pytest.mark.parametrize("at", [0.5, 1 / np.sqrt(5)])  # at a time that is looked at, and between such times
def test_a_singular_configuration_on_the_way_is_told_with_its_time(short, at):
    with expect_refusal(re.compile(rf"constraints are lost along the motion at t = {at:.3g}.*1/cond is \d")):
        short.forces_along(through(short, at), [0.0], order=0)


def test_a_step_does_not_end_on_a_branch_nearby(tmp_path):
    """Of a parallelogram of 0.2 and 0.3 m that is crossed, tan(d/2) = -5 tan(a/2); at a = 0 it meets the other one."""
    bodies = [rod_body("c", "a", "ground", 0), rod_body("r", "b", "c", 0.2), rod_body("o", "d", "ground", 0.3)]
    frames = [
        {"name": f"t{name}", "body": name, "pose": {"position": [x, 0, 0]}} for name, x in (("r", 0.3), ("o", 0.2))
    ]
    crossed = {"bodies": bodies, "frames": frames, "loops": [{"frames": ["tr", "to"]}], "actuated": ["a"]}
    (tmp_path / "crossed.json").write_text(json.dumps(SHORT | crossed | {"start": {"a": 0.3, "b": -1.3, "d": -1.3}}))
    found = jounce.load(tmp_path / "crossed.json").coordinates([0.01], method="recursion")
    assert found[2] == pytest.approx(-2 * np.arctan(5 * np.tan(0.005)), abs=1e-9)


@pytest.mark.parametrize("near", [0, 1e-7])
def test_a_singular_position_is_refused(short, near):
    """Newton's method comes near it, where 1/cond is the root of rounding: forces would have no right digit."""
    with expect_refusal("constraints are lost at q, where 1/cond is "):
        short.inverse_dynamics([np.pi - near, near], [1, 0], [0, 0])


def test_near_a_singular_configuration_the_branch_stays(short):
    """Rods that are nearly stretched bend to the same side again: the pin stays above the line between the elbows."""
    motion, t = through(short, 0.5, off=1e-3), np.linspace(0.4, 0.6, 5)
    a1, p1, a2, _ = closed_path.continue_positions(short, motion, t).T
    left, right = (0.2 * np.array([np.cos(a), np.sin(a)]) for a in (a1, a2))
    line, rod = right - left + [[0.2], [0]], np.array([np.cos(a1 + p1), np.sin(a1 + p1)])
    assert (line[0] * rod[1] > line[1] * rod[0]).all()


def test_a_motion_that_leaves_the_workspace_is_told_with_its_time(bundled_fivebar):
    with expect_refusal("constraints are lost along the motion at t = 0.44…cannot be closed"):
        bundled_fivebar.forces_along(Motion.polynomial([[2.2, 0.8], [0.94, -0.8]], 2.0), [0.0], order=0)


def test_limits_of_joints_that_follow_others(bundled_fivebar):
    """Passive joints are checked against rates that differences confirm, between samples too."""
    ends = {"lower": {"right_elbow": 1.0}, "upper": {"right_elbow": 1.6}}
    tree = jounce.Robot(bundled_fivebar.mechanism.tree).with_limits(effort={"left_elbow": 1.0})
    limited = tree.closed(
        actuated=bundled_fivebar.joint_names, start=bundled_fivebar.mechanism.closure.start
    ).with_limits(velocity={"left_elbow": 0.1}, **ends)
    motion, names = fivebar_swing(), bundled_fivebar.mechanism.tree.coordinates
    t = np.linspace(0, 2, 4001)
    q = bundled_fivebar.coordinates(motion(t, 0)[0])
    found = {(row.joint, row.limit): row for row in limited.check(motion).table}
    row = found["left_elbow", "velocity"]
    expected = np.gradient(q[:, names.index("left_elbow")], t)[1:-1]
    assert abs(row.value) == pytest.approx(np.abs(expected).max(), rel=1e-4)
    assert not row.ok
    assert row.violations
    assert found["right_elbow", "position"].value == pytest.approx(q[:, names.index("right_elbow")].max(), abs=1e-6)
    assert ("left_elbow", "effort") not in found


def test_a_slowdown_and_a_retiming_keep_limits_of_passive_joints(bundled_fivebar):
    limits = {"left_elbow": 0.2, "left_shoulder": 5, "right_shoulder": 5}
    limited = bundled_fivebar.with_limits(velocity=limits, effort=np.inf)
    motion = Motion.polynomial([[2.2, 0, 0, 2, -3, 1.2], [0.94, 0, 0, 1, -1.5, 0.6]], 1.0)
    slow = limited.slowdown(motion)
    assert slow.binding.joint == "left_elbow"
    assert limited.check(slow.motion).worst.ratio == pytest.approx(1.0, abs=1e-8)
    fast = limited.retime(motion)
    assert fast.duration < slow.motion.duration
    assert 0.98 < limited.check(fast.motion).worst.ratio < 1.0


def test_limits_of_redundant_motors_bound_their_shares(bundled_fivebar):
    """Three motors in two coordinates: efforts of the third are checked, and retiming refuses them."""
    motors = [*bundled_fivebar.joint_names, "left_elbow"]
    redundant = bundled_fivebar.closed(actuated=motors, coordinates=bundled_fivebar.joint_names).with_limits(
        effort={"left_elbow": 1e-3}
    )
    motion = fivebar_swing()
    row = next(row for row in redundant.check(motion).table if (row.joint, row.limit) == ("left_elbow", "effort"))
    u = redundant.actuator_forces(*motion(np.linspace(0, 2, 1001), 2))
    assert abs(row.value) == pytest.approx(np.abs(u[:, 2]).max(), rel=1e-4)
    joints = r"\['left_shoulder', 'left_elbow', 'right_shoulder'\]"
    with expect_refusal(re.compile(rf"retime supports .* where motors are at .*=dict.fromkeys\({joints}, float")):
        redundant.retime(motion)
    corner = Motion.polynomial([[2.2, 0.1], [0.94, 0.1]], 1.0) + Motion.polynomial([[2.3, 0], [1.04, 0]], 1.0)
    impulse = next(row for row in redundant.check(corner).table if row.limit == "effort")
    assert np.isinf(impulse.value)
    velocity = {"left_elbow": 0.2, "left_shoulder": 5, "right_shoulder": 5}
    effort = dict.fromkeys(["left_shoulder", "left_elbow", "right_shoulder"], np.inf)
    slow = redundant.with_limits(velocity=velocity, effort=effort)  # as the message says
    fast = slow.retime(motion)
    assert 0.98 < slow.check(fast.motion).worst.ratio < 1.0


def rate_columns(robot, motion, t, followers=()):
    """A table of all rates, and of the positions of joints that follow others."""
    table = {"t": t}
    for k, rate in enumerate(motion(t, 4)):
        table |= {f"{name}.{'q' if not k else 'qd' if k == 1 else f'q{k}d'}": rate[:, j]
                  for j, name in enumerate(robot.joint_names)}  # fmt: skip
    q = robot.coordinates(motion(t, 0)[0])
    return table | {f"{name}.q": q[:, robot.mechanism.tree.coordinates.index(name)] for name in followers}


def test_a_table_of_all_joints_states_the_branch(bundled_fivebar):
    """The first row decides, whatever the robot's own start is."""
    other, t = bundled_fivebar.closed(start=OTHER), np.linspace(0, 0.5, 51)
    table = rate_columns(other, fivebar_swing(), t, PASSIVE)
    expected = other.forces_along(fivebar_swing(), t, order=0).forces[0]
    assert np.abs(expected - bundled_fivebar.forces_along(fivebar_swing(), t, order=0).forces[0]).max() > 0.1
    np.testing.assert_allclose(
        bundled_fivebar.forces_along(jounce.load_motion(table, bundled_fivebar), order=0).forces[0], expected, atol=1e-9
    )


def save(path, table):
    np.savetxt(
        path, np.column_stack([*table.values()]), delimiter=",", header=",".join(table), comments="", fmt="%.17g"
    )


@pytest.mark.parametrize("followers", [(), PASSIVE])
def test_parts_of_a_table_give_what_the_whole_does(bundled_fivebar, followers, tmp_path, monkeypatch):
    """With and without the positions of passive joints; only with them rows do not depend on each other."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("jounce.io.motions.table_parts.MAX_PART_CELLS", 500)
    save("table.csv", rate_columns(bundled_fivebar, fivebar_swing(), np.linspace(0, 2, 201), followers))
    for output in ("whole.csv", "parts"):
        main(["run", "fivebar", "table.csv", "-o", output, "--order", "1"], standalone_mode=False)
    parts = sorted((tmp_path / "parts").glob("*.parquet"))
    assert (len(parts) > 1) == bool(followers)
    whole, found = read(tmp_path / "whole.csv"), [read(path) for path in parts]
    for name, column in whole.items():
        np.testing.assert_allclose(np.concatenate([part[name] for part in found]), column, rtol=1e-9, atol=1e-9)


def test_rows_on_another_branch_are_told_with_their_time(bundled_fivebar, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    t = np.linspace(0, 0.5, 51)
    table, flipped = (
        rate_columns(x, fivebar_swing(), t, PASSIVE) for x in (bundled_fivebar, bundled_fivebar.closed(start=OTHER))
    )
    save("table.csv", {name: np.where(t > 0.255, flipped[name], column) for name, column in table.items()})
    said = r"branch jumps between the rows at t = 0\.25 and 0\.26 s: joint '(left|right)_elbow'"  # both jump as far
    with pytest.raises(ClickException, match=said):
        main(["run", "fivebar", "table.csv", "-o", "parts"], standalone_mode=False)
