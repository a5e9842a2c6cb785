"""`jounce stiffness`: from a log of motors and links to a robot file with springs."""

import json

import numpy as np
import pytest

import jounce
from support.commands import run
from support.refusals import refused

NAMES = ("joint1", "joint2")


@pytest.fixture(scope="module")
def rotor_log(tmp_path_factory):
    """A log with rotor angles of the second joint in front of a gear, and a row without a position."""
    arm = jounce.load("planar2r").elastic([800, 600], rotor=0.1)
    motion = jounce.Motion.fourier([0.3, 0.2], [[0.5, 0.2], [0.1, 0.4]], [[0.1, 0.3], [0.5, 0.2]], 2.5, 6.0)
    t, rng = np.arange(0, 6, 0.004), np.random.default_rng(0)
    along = arm.forces_along(motion, t, order=0)
    q, theta = (
        x + 1e-5 * rng.normal(size=x.shape) for x in (along.rates[0], along.rates[0] + along.forces[0] / [800, 600])
    )
    path = tmp_path_factory.mktemp("log") / "log.csv"
    theta[700, 0] = np.nan
    columns = np.column_stack([t, q, theta * [1, 30], along.forces[0]])
    header = ",".join(["t", *NAMES, *(f"theta_{name}" for name in NAMES), *(f"tau_{name}" for name in NAMES)])
    np.savetxt(path, columns, delimiter=",", header=header, comments="")
    return path


def test_springs_and_the_robot_with_them(rotor_log, tmp_path):
    out = tmp_path / "elastic.yaml"
    words = ("planar2r", rotor_log, "--gear", "joint2=30", "--rotor", 0.2, "--on-error", "skip", "-o", out)
    said = json.loads(run("stiffness", *words, "--json").stdout)
    assert [row["value"] for row in said["parameters"][::3]] == pytest.approx([800, 600], rel=1e-3)
    assert said["parameters"][0]["model"] is None, "rigid"
    assert (said["delay"], said["robot"], said["output"]) == (0.0, "planar2r", str(out))
    assert any("1 of 1500 rows left out" in note for note in said["notes"])
    text = run("stiffness", *words).stdout
    for part in ("joint1 stiffness", "N m/rad", "joint2 encoder delay", f"robot written to {out}"):
        assert part in text
    assert "other columns" not in text
    robot = jounce.load(out)
    assert robot.elasticity.stiffness == pytest.approx([800, 600], rel=1e-3)
    assert robot.elasticity.rotor == pytest.approx([0.2, 0.2])
    (tmp_path / "swing.yaml").write_text(
        "time: {start: 0, stop: 1, count: 11}\njoints: {joint1: {offset: 0.1}, joint2: {offset: 0.2}}\n"
    )
    motors = json.loads(run("motors", out, tmp_path / "swing.yaml", "-o", tmp_path / "m.csv", "--json").stdout)
    assert motors["states"] == 11


@pytest.mark.parametrize(("options", "words"), [
    ("--gear joint2=30 --rotor 0.1", "column 'theta_joint1' holds 'nan'"),
    ("--rotor 0.1 --on-error skip", "gear ratios (--gear [JOINT=]N), which are about 27.4 of joint2"),
    ("--gear joint2=30 --on-error skip", "; give it with --rotor, in kg m^2"),
    ("--motors motor{number} --rotor 0.1", "--motors 'motor{number}': no column 'motor1'"),
    ("--gear two", "--gear 'two'; expected a number, or JOINT=NUMBER"),
    ("-o x.urdf", "--output is given 2 times"),
])  # fmt: skip
def test_refuses(rotor_log, tmp_path, options, words):
    refused(tmp_path, f"stiffness planar2r {rotor_log} -o x.yaml {options}", words)


@pytest.mark.parametrize(
    ("unit", "words"), [("", ("--angles", "rad")), ("", ()), (" [deg]", ()), (" [rad]", ("--angles", "rad"))]
)
def test_units_of_motors(rotor_log, tmp_path, unit, words):
    """Angles of motors are in rad, in which they may turn far, unless their columns or an option state another unit."""
    lines = rotor_log.read_text().splitlines()
    names = lines[0].split(",")
    rows = np.genfromtxt(lines[1:], delimiter=",")
    motors = [names.index(f"theta_{name}") for name in NAMES]
    rows[:, motors] *= np.array([100.0, 100 / 30]) * (np.rad2deg(1.0) if unit == " [deg]" else 1.0)
    header = ",".join(name + unit * (k in motors) for k, name in enumerate(names))
    path = tmp_path / "log.csv"
    np.savetxt(path, rows, delimiter=",", header=header, comments="")
    given = ("--gear", 100, "--rotor", 0.2, "--on-error", "skip", *words)
    said = json.loads(run("stiffness", "planar2r", path, *given, "-o", tmp_path / "k.yaml", "--json").stdout)
    assert [row["value"] for row in said["parameters"][::3]] == pytest.approx([800, 600], rel=1e-3)


def test_angles_of_another_unit_are_named(rotor_log, tmp_path):
    """Nothing says whether motors are in degrees or in front of gears: both are said."""
    lines = rotor_log.read_text().splitlines()
    rows = np.genfromtxt(lines[1:], delimiter=",")
    rows[:, 3:5] = np.rad2deg(rows[:, 3:5] / [1, 30])
    path = tmp_path / "log.csv"
    np.savetxt(path, rows, delimiter=",", header=lines[0], comments="")
    asked = "stiffness planar2r log.csv --rotor 0.2 --on-error skip -o k.yaml"
    refused(tmp_path, asked, "; or all positions in rad, as 57.3 is 180 / pi")
