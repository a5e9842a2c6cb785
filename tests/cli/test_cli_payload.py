"""`jounce payload`: from two logs with torques to the load, and a robot file with it."""

import json

import numpy as np
import pytest

import jounce
from jounce.spatial import inertia
from support.commands import run
from support.refusals import refused

LOAD = inertia.parameters(jounce.inertia_matrix(2.0, [0.1, 0.05, 0], 0.01 * np.eye(3)))


@pytest.fixture
def logs(tmp_path):
    """Two logs of a planar arm, with a load on its second body and without one."""
    robot = jounce.load("planar2r")
    rng, t = np.random.default_rng(0), np.linspace(0, 6, 1201)
    q, qd, q2d = jounce.Motion.fourier([0.3, 0.2], *rng.uniform(-0.5, 0.5, (2, 3, 2)), 2.0, 6.0)(t, 2)
    names = [f"joint{j}{rate}" for rate in (".q", ".qd", ".q2d", ".tau") for j in (1, 2)]
    for name, load in (("with.csv", LOAD), ("without.csv", 0 * LOAD)):
        arm = robot.with_inertial_parameters(robot.inertial_parameters + np.append(np.zeros(10), load))
        Q = arm.inverse_dynamics(q, qd, q2d) + 0.01 * rng.normal(size=q.shape)
        columns = np.stack([t, *q.T, *qd.T, *q2d.T, *Q.T], axis=1)
        np.savetxt(tmp_path / name, columns, delimiter=",", header=",".join(["t", *names]), comments="")
    return tmp_path / "with.csv", tmp_path / "without.csv"


def test_the_load_and_the_robot_with_it(logs, tmp_path):
    out = tmp_path / "loaded.yaml"
    result = run("payload", "planar2r", *logs, "--drives", "none", "-o", out, "--json")
    said = json.loads(result.stdout)
    assert "do not determine com z" in said["notes"][0]
    assert result.stderr == ""
    assert said["parameters"][0]["value"] == pytest.approx(2.0, abs=0.02)
    assert said["com"][:2] == pytest.approx([0.1, 0.05], abs=2e-3)
    assert said["parameters"][3]["deviation"] is None
    assert said["halves"][0]["mass"] == pytest.approx(2.0, abs=0.02)
    assert jounce.load(out).mechanism.M[1][3, 3] == pytest.approx(3.0, abs=0.02)
    text = run("payload", "planar2r", *logs, "--drives", "none", "-o", out).stdout
    for part in ("load on planar2r, in the frame of body2", "com z", "not seen", "franka: robot.setLoad(", str(out)):
        assert part in text


def test_one_log_and_the_robot(logs):
    said = json.loads(run("payload", "planar2r", logs[0], "--drives", "none", "--body", "body2", "--json").stdout)
    assert (said["without"], said["output"], said["factors"]) == (None, None, None)
    assert said["mass"] == pytest.approx(2.0, abs=0.02)


def test_a_known_mass(logs):
    said = json.loads(run("payload", "planar2r", *logs, "--drives", "none", "--mass", 2.2, "--json").stdout)
    assert [row["value"] for row in said["factors"].values()] == pytest.approx([1.1, 1.1], abs=0.02)


@pytest.mark.parametrize(("options", "words"), [
    ("-o out.urdf", "unknown type of robot file"),
    ("--body hand", "unknown body 'hand'; available: body1, body2"),
    ("--drives stiction", "unknown drive term 'stiction'"),
    ("--mass -1", "expected kg > 0"),
    ("", "they seem to be swapped"),
])  # fmt: skip
def test_refuses(logs, tmp_path, options, words):
    given = "without.csv with.csv" if "swapped" in words else "with.csv without.csv"
    refused(tmp_path, f"payload planar2r {given} {options}", words)


def test_excite_for_a_load(tmp_path):
    out = tmp_path / "x.yaml"
    words = ("excite", "ur5", "--starts", 1, "--harmonics", 4, "-o", out, "--json")
    said = json.loads(run(*words, "--payload", "--body", "forearm_link").stdout)
    assert said["parameters"][0] == "forearm_link m"
    refused(tmp_path, [*words, "--body", "tool0"], "--body 'tool0' needs --payload")
