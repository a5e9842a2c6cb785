"""Motors of a plan whose jerk is not zero at its ends would have to start at a speed: one note, and only then."""

import json

import numpy as np
import pytest

import jounce
from support.commands import call

K = 800.0
POWERS = {
    "quintic": [0, 0, 0, 10, -15, 6],
    "degree 7": [0, 0, 0, 0, 35, -84, 70, -20],
    "jerk at the end alone": [0, 0, 0, 0, 15, -24, 10],
    "in motion": [0, 1, 0.3],
}


def polynomial_plan(name, duration=1.0):
    powers = np.array(POWERS[name]) / duration ** np.arange(len(POWERS[name]))
    return jounce.Motion.polynomial(np.array([[0.5], [-0.8]]) * powers, duration)


@pytest.mark.parametrize("name", POWERS)
@pytest.mark.parametrize("duration", [0.5, 2.0])
def test_the_motor_that_would_have_to_start_at_a_speed_is_named(name, duration):
    """At rest thetad = Qd / K = M q3d / K, of the mass matrix alone."""
    links, motion = jounce.load("planar2r"), polynomial_plan(name, duration)
    notes = links.elastic(K, rotor=0.1).motors_along(motion).notes
    speeds = [np.abs(links.mass_matrix(motion(t, 0)[0]) @ motion(t, 3)[3] / K) for t in (0.0, motion.stop)]
    if name in ("degree 7", "in motion"):
        assert notes == ()
        return
    [note] = notes
    at, joint = np.unravel_index(np.argmax(speeds), (2, 2))
    verb = ("start", "stop")[at]
    assert note.startswith(
        f"the motor of joint{joint + 1} would have to {verb} at {speeds[at][joint]:.2g} rad/s at t = "
    )


@pytest.mark.parametrize(("share", "noted"), [(0.3e-6, 0), (3e-6, 1)])
def test_a_millionth_of_the_largest_speed_is_rest(share, noted):
    robot, smooth = jounce.load("planar2r").elastic(K, rotor=0.1), polynomial_plan("degree 7")
    largest = np.abs(robot.motors_along(smooth).positions[1]).max()
    M = jounce.load("planar2r").mass_matrix([0.0, 0.0])
    jerk = share * largest * K / np.abs(M[:, 0]).max()
    powers = np.array([[0.5], [-0.8]]) * np.array([*POWERS["degree 7"]])
    powers[0, 3] += jerk / 6
    powers[0, 4] -= jerk / 6  # at the end it moves by little, and no longer rests
    assert len(robot.motors_along(jounce.Motion.polynomial(powers, 1.0)).notes) == noted


def test_the_command_notes_it(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    motion = polynomial_plan("quintic")
    columns = [motion.times, *(rate[:, j] for j in range(2) for rate in motion(motion.times, 4))]
    header = ",".join(["t", *(f"joint{j}.{x}" for j in (1, 2) for x in ("q", "qd", "q2d", "q3d", "q4d"))])
    np.savetxt("plan.csv", np.column_stack(columns), "%.17g", ",", header=header, comments="")
    command = ["motors", "planar2r", "plan.csv", "--stiffness", "800", "--rotor", "0.1", "-o", "motors.csv"]
    [note] = [line for line in call(*command).stdout.splitlines() if "would have to" in line]
    [same] = json.loads(call(*command, "--json").stdout)["notes"]
    assert note == same
    assert "rad/s" in note
    assert "--blend" in note
