"""`jounce motion`, `run` and `retime`'s tables of robots with balls, planar and free joints."""

import numpy as np
import pytest

import jounce
from jounce.io import tables
from support.commands import run, summary
from support.files import LINKS, OTHER, joint, link, robot_file

BALL = """<mujoco><worldbody><body name="arm"><joint name="turn" axis="0 0 1"/><geom size=".1"/>
<body name="foot" pos="0 0 1"><joint name="ankle" type="ball"/><geom size=".1" pos=".1 0 0"/></body></body></worldbody>
</mujoco>"""
LIMIT = '<limit lower="-2" upper="2" velocity="1.5" effort="1000"/>'  # which the motion breaks
TURN = '"turn": {"cosines": [{"amplitude": 1, "frequency": 2}]}'
TERMS = {
    "ball": '"ankle.rx": {"polynomial": [0.1, 1]}, "ankle.ry": {"offset": 0.2}, "ankle.rz": {"polynomial": [0, 0, 1]}',
    "planar": '"ankle.x": {"offset": 0.3}, "ankle.y": {"polynomial": [0, 1]}, "ankle.rz": {"polynomial": [0, 2]}',
    "floating": '"ankle.x": {"offset": 0.3}, "ankle.y": {"polynomial": [0, 1]}, "ankle.z": {"offset": 0},'
    ' "ankle.qx": {"offset": 0.2}, "ankle.qy": {"polynomial": [0, 2]}, "ankle.qz": {}, "ankle.qw": {"offset": 2}',
}  # fmt: skip


@pytest.fixture(scope="module", params=TERMS)
def robot_and_motion(request, tmp_path_factory):
    folder = tmp_path_factory.mktemp(request.param)
    if request.param == "ball":
        robot = folder / "robot.xml"
        robot.write_text(BALL)
    else:
        robot = robot_file(
            folder, *LINKS, joint("turn", "base", "arm", inner=LIMIT), link("foot", OTHER),
            joint("ankle", "arm", "foot", request.param)
        )  # fmt: skip
    time = '"time": {"start": 0.5, "stop": 1.5, "count": 101}'
    (folder / "motion.json").write_text(f'{{{time}, "joints": {{{TURN}, {TERMS[request.param]}}}}}')
    return robot, folder / "motion.json", folder


@pytest.mark.parametrize("suffix", ["csv", "npz", "parquet"])
def test_tables_of_motion_and_of_run_are_the_motion_again(robot_and_motion, suffix):
    path, motion, folder = robot_and_motion
    robot = jounce.load(path)
    given = jounce.load_motion(motion, robot)
    expected = robot.forces_along(given)
    if suffix != "parquet":
        run("motion", path, motion, "-o", folder / f"motion.{suffix}")
    run("run", path, motion, "-o", folder / f"forces.{suffix}", "--rates")
    found = tables.read(folder / f"forces.{suffix}")
    for k, rate in enumerate(("Q", "Qd", "Q2d")):
        forces = np.stack([found[f"{name}.{rate}"] for name in robot.joint_names], axis=1)
        np.testing.assert_array_equal(forces, expected.forces[k])
    for table in [f"forces.{suffix}"] + [f"motion.{suffix}"] * (suffix != "parquet"):
        again = jounce.load_motion(folder / table, robot)
        for ours, other in zip(again(given.times), given(given.times), strict=True):
            np.testing.assert_array_equal(ours, other)
        said = summary("run", path, folder / table, "-o", folder / "again.npz")
        assert (said["broken_limit"] or {}).get("joint") == (None if path.suffix == ".xml" else "turn")
        assert said["notes"] == ([f"other columns, ignored: {said['notes'][0][24:]}"] if "forces" in table else [])
        forces = tables.read(folder / "again.npz")
        np.testing.assert_array_equal(forces["ankle.wz.Q"], expected.forces[0][:, robot.joint_names.index("ankle.wz")])


def test_tables_by_parts_are_those_in_memory(robot_and_motion):
    path, motion, folder = robot_and_motion
    robot = jounce.load(path)
    run("motion", path, motion, "-o", folder / "whole.csv")
    run("run", path, folder / "whole.csv", "-o", folder / "by_parts.csv", "--on-error", "skip", "--rates")
    run("run", path, folder / "whole.csv", "-o", folder / "in_memory.csv", "--rates")
    parts, whole = (tables.read(folder / f"{name}.csv") for name in ("by_parts", "in_memory"))
    assert {*whole} <= {*parts}
    for name, column in whole.items():
        np.testing.assert_allclose(parts[name], column, atol=1e-12 * (1 + abs(column).max()), err_msg=name)
    assert len(robot.joint_names) < robot.nq


def test_flips_of_quaternions_are_told_in_one_line(robot_and_motion):
    path, motion, folder = robot_and_motion
    robot = jounce.load(path)
    given = jounce.load_motion(motion, robot)
    names = [name for name in given.joint_names if name.startswith("ankle.q")]
    columns = {"t": given.times} | dict(zip(given.joint_names, given(given.times, 0)[0].T, strict=True))
    columns |= {name: np.where(given.times < 1, 1, -1) * columns[name] for name in names}
    tables.write_pieces(folder / "samples.csv", [columns])
    said = run("run", path, folder / "samples.csv", "-o", folder / "flipped.csv", "--degree", 7).output
    told = [line for line in said.splitlines() if "sign flips" in line]
    assert len(told) == bool(names)
    found, exact = tables.read(folder / "flipped.csv"), robot.forces_along(given, order=0).forces[0]
    np.testing.assert_allclose(found["turn.Q"], exact[:, 0], atol=1e-6 * (1 + abs(exact).max()))
