"""`jounce motors`: what the motors of elastic joints do along a motion, as a table."""

import json

import numpy as np
import pytest

import jounce
from jounce.io import tables
from support.commands import call
from support.refusals import refused

STIFFNESS, ROTOR = {"joint1": 300.0, "joint2": 200.0}, 0.3
ROBOT = jounce.load("planar2r")
OPTIONS = ("--stiffness", "300", "--stiffness", "joint2=200", "--rotor", "0.3")


@pytest.fixture
def swing_file(tmp_path):
    path = tmp_path / "swing.yaml"
    swing = "{offset: 0.1, cosines: [{amplitude: 0.5, frequency: 3, phase: 0}]}"
    path.write_text(f"time: {{start: 0, stop: 2, count: 41}}\njoints:\n  joint1: {swing}\n  joint2: {swing}\n")
    return path


@pytest.mark.parametrize("suffix", [".csv", ".npz"])
def test_it_writes_what_the_library_computes(tmp_path, swing_file, suffix):
    out = tmp_path / f"motors{suffix}"
    result = call("motors", "planar2r", swing_file, *OPTIONS, "-o", out, "--json")
    assert result.exit_code == 0, result.output
    summary = json.loads(result.stdout)
    robot = jounce.load("planar2r")
    along = robot.elastic(STIFFNESS, rotor=ROTOR).motors_along(jounce.load_motion(swing_file, robot))
    found = tables.read(out)
    columns = [f"{joint}.{name}" for joint in robot.joint_names for name in ("theta", "thetad", "tau")]
    assert set(found) == {"t", *columns}
    for j, joint in enumerate(robot.joint_names):
        for name, column in zip(("theta", "thetad", "tau"), (*along.positions[:2], *along.torques), strict=True):
            np.testing.assert_allclose(found[f"{joint}.{name}"], column[:, j], rtol=0, atol=1e-12 * abs(column).max())
            assert summary["peaks"][joint][name] == pytest.approx(abs(column[:, j]).max())
    units = {"theta": "rad", "thetad": "rad/s", "tau": "N m"}
    assert (summary["units"], summary["states"], summary["breaks"]) == ({"joint1": units, "joint2": units}, 41, [])


def test_rates_of_links_come_too_whole_and_by_parts(tmp_path, swing_file):
    """Whether a whole motion is read, or any rows of a table that states all rates; and motors of it alone."""
    whole, parts = tmp_path / "whole.csv", tmp_path / "parts.npz"
    assert call("motors", "planar2r", swing_file, *OPTIONS, "--rates", "-o", whole).exit_code == 0
    found, rates = tables.read(whole), jounce.load_motion(swing_file, ROBOT)(np.linspace(0, 2, 41), 4)
    for k, name in enumerate(("q", "qd", "q2d", "q3d", "q4d")):
        np.testing.assert_allclose(found[f"joint2.{name}"], rates[k][:, 1], atol=1e-12)
    (tmp_path / "logs").mkdir()
    whole.rename(tmp_path / "logs" / "log.csv")
    assert call("motors", "planar2r", tmp_path / "logs", *OPTIONS, "--rates", "-o", parts).exit_code == 0
    with np.load(parts) as again:
        for name in found:
            np.testing.assert_allclose(again[name], found[name], rtol=1e-9, atol=1e-9, err_msg=name)
    table = {name: found[name] for name in found}
    motors = jounce.load_motion(table, ROBOT, 0, columns="{joint}.theta")
    np.testing.assert_allclose(motors(found["t"], 0)[0][:, 0], found["joint1.theta"], atol=1e-6)
    assert any("other columns, ignored: joint1.q, " in note for note in motors.notes)


def test_a_measured_motion_brings_its_deviations(tmp_path):
    t = np.arange(2001) / 1000
    rng = np.random.default_rng(1)
    q = 0.4 * np.sin(np.outer(t, [2.0, 3.0])) + rng.normal(0, 1e-5, (len(t), 2))
    np.savetxt(tmp_path / "log.csv", np.c_[t, q], "%.17g", ",", header="t,joint1,joint2", comments="")
    result = call("motors", "planar2r", tmp_path / "log.csv", *OPTIONS, "-o", tmp_path / "motors.csv")
    assert result.exit_code == 0, result.output
    found = tables.read(tmp_path / "motors.csv")
    smooth = 0.4 * np.stack([w**k * np.sin(w * t + k * np.pi / 2) for k in range(5) for w in (2.0, 3.0)])
    exact = jounce.load("planar2r").elastic(STIFFNESS, rotor=ROTOR).motor_torques(*smooth.reshape(5, 2, -1).mT)
    middle = slice(500, 1500)
    for j in (0, 1):
        error = np.abs(found[f"joint{j + 1}.tau"] - exact[:, j])[middle]
        assert (error < 3 * found[f"joint{j + 1}.tau_sd"][middle]).mean() > 0.9
    assert "±" in result.stdout


def test_currents_and_voltages_follow_from_the_data_of_motors(tmp_path, swing_file):
    motors = {"joint1": jounce.Motor(gear=50, inertia=1e-4, resistance=0.5, inductance=1e-3, constant=0.05)}
    arm = jounce.load("planar2r").elastic(STIFFNESS, rotor={"joint2": 0.3}, motors=motors)
    jounce.save(arm, tmp_path / "arm.yaml")
    result = call("motors", tmp_path / "arm.yaml", swing_file, "-o", tmp_path / "motors.csv")
    assert result.exit_code == 0, result.output
    found, along = tables.read(tmp_path / "motors.csv"), arm.motors_along(jounce.load_motion(swing_file, arm), order=1)
    np.testing.assert_allclose(found["joint1.i"], along.currents[0][:, 0], rtol=1e-12)
    np.testing.assert_allclose(found["joint1.u"], along.voltages[0][:, 0], rtol=1e-9)
    assert not {"joint2.i", "joint2.u"} & set(found)
    assert " A " in result.stdout


@pytest.mark.parametrize(("options", "words"), [
    ("", "is unknown; give it with --stiffness, infinity for rigid joints"),
    ("--stiffness 300", "rotor inertia of joint 'joint1' is unknown, since it has no armature; give it with --rotor"),
    ("--stiffness 0 --rotor 1", "stiffness of joint 'joint1' is 0"),
    ("--stiffness -3 --rotor 1", "stiffness of joint 'joint1' is -3"),
    ("--stiffness soft --rotor 1", "--stiffness 'soft'; expected a number, or JOINT=NUMBER"),
    ("--stiffness nan --rotor 1", "--stiffness 'nan'; expected a number"),
    ("--stiffness 300 --rotor joint3=1", "unknown joint 'joint3'"),
    ("--stiffness 300 --stiffness 200 --rotor 1", "is the second value for all joints"),
    ("--rotor joint1=1 --rotor joint1=1", "is the second value for 'joint1'"),
])  # fmt: skip
def test_mistakes_are_refused_in_one_line(tmp_path, swing_file, options, words):
    refused(tmp_path, f"motors planar2r {swing_file.name} {options} -o motors.csv", words)
