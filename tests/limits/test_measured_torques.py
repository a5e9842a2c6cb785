"""Limits of effort that computed torques break and measured ones keep are undecided."""

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.pendulum import DAMPING, double_pendulum

import jounce
from jounce.motion import resmoothing

ROBOT, PLAY, STEP = double_pendulum(), 4e-3, 2 * np.pi / 2**14
QUIET = pytest.mark.filterwarnings("ignore::jounce.JounceWarning")


@pytest.fixture(scope="module")
def dragged():
    """A log of encoders at rotors that links drag through some play, with torques."""
    rng, t = np.random.default_rng(0), np.arange(0, 6, 1 / 500)
    exact = jounce.Motion.fourier([-1.5, 0.0], *rng.uniform(-0.4, 0.4, (2, 4, 2)), 2.0, 6.0)
    q, qd, q2d = exact(t, 2)
    rotor = q.copy()
    for k in range(1, len(t)):
        rotor[k] = np.clip(rotor[k - 1], q[k] - PLAY / 2, q[k] + PLAY / 2)
    Q = ROBOT.inverse_dynamics(q, qd, q2d) + DAMPING * qd + 0.02 * rng.normal(size=q.shape)
    motion = jounce.Motion.fit(t, np.floor(rotor / STEP + rng.uniform(size=2)) * STEP, allow_noise=True)
    return replace(motion, torques=(t, Q)), np.abs(Q).max(axis=0)


def checked(motion, bound):
    found = ROBOT.with_limits(effort=[1e3, bound]).check(motion)
    [row] = [row for row in found.table if row.joint == ROBOT.joint_names[1]]
    return found, row


@QUIET
def test_torques_that_were_not_measured_are_not_certain(dragged):
    motion, most = dragged
    found, row = checked(motion, 1.3 * most[1])
    assert abs(row.value) > 2 * most[1]
    assert (found.verdict, row.violations) == ("undecided", ())
    assert row.cause.startswith(f"computed {row.value:.3g} N m, measured ")
    assert any(row.cause in note for note in found.notes)
    assert found.judged["effort"] < 1
    bandwidth = float(row.cause.rpartition("=")[2])
    t, Q = (x[200:-200] for x in motion.torques)  # without the ends, which are uncertain
    errors = [
        np.sqrt(((ROBOT.forces_along(of, t, order=0).forces[0] - Q) ** 2).mean())
        for of in (motion, jounce.Motion.fit(*motion.samples, bandwidth=bandwidth))
    ]
    assert errors[1] < 0.3 * errors[0]


@QUIET
def test_without_them_computed_ones_stand(dragged):
    motion, most = dragged
    assert checked(replace(motion, torques=None), 1.3 * most[1])[0].verdict == "broken"


PLAY_NOTE = "the encoder of 'joint2' stands still at "


@QUIET
def test_play_is_said_where_no_torques_are_measured(dragged):
    """Torques that are measured decide; commands do not, nor do positions that are smoothed to less."""
    motion, most = dragged
    alone = replace(motion, torques=None)

    def notes(of):
        return [note for note in checked(of, 1.3 * most[1])[0].notes if PLAY_NOTE in note]

    assert len(notes(alone)) == 1
    assert notes(alone)[0].endswith("may be those of no link, and measured torques decide")
    assert notes(motion) == []
    assert len(notes(replace(motion, commanded=True))) == 1
    assert notes(jounce.Motion.fit(*motion.samples, bandwidth=2.0, allow_noise=True)) == []


@QUIET
def test_columns_that_no_joint_names_are_numbered(dragged):
    """As of balls, which have more of them than velocities."""
    play = resmoothing.find_play(dragged[0], ("joint1", "joint2"))
    assert list(play) == ["joint1", "joint2"]
    assert list(resmoothing.find_play(dragged[0], ("ball.wx", "ball.wy", "ball.wz"))) == ["column 1", "column 2"]


@QUIET
def test_commands_contradict_no_computed_torque(dragged):
    motion, most = dragged
    assert checked(replace(motion, commanded=True), 1.3 * most[1])[0].verdict == "broken"


@pytest.mark.parametrize(
    ("columns", "pattern", "commanded"),
    [
        ("tau_d_{}", "tau_d_{joint}", True),
        ("{}.effort_cmd", "{joint}.effort_cmd", True),
        ("desired torque {}", "desired torque {joint}", True),
        ("tau_{}", None, False),
        ("measured_{}", "measured_{joint}", False),
    ],
)
def test_commands_are_known_by_the_names_of_their_columns(tmp_path, columns, pattern, commanded):
    t, names = np.arange(0, 2, 0.01), ROBOT.joint_names
    table = {"t": t} | {name: np.sin(t) for name in names} | {columns.format(name): np.cos(t) for name in names}
    np.savetxt(
        tmp_path / "log.csv", np.stack([*table.values()], axis=1), delimiter=",", header=",".join(table), comments=""
    )
    motion = jounce.load_motion(tmp_path / "log.csv", ROBOT, torques=pattern)
    assert motion.torques is not None
    assert motion.commanded == commanded
    assert any("torques are commands" in note for note in motion.notes) == commanded


@QUIET
@pytest.mark.parametrize(("share", "said"), [(0.79, True), (0.81, False)])
def test_what_torques_confirmed_of_a_robot_is_remembered(dragged, share, said, tmp_path):
    """In its file too, and up to four fifths of what a log is smoothed to."""
    alone = replace(dragged[0], torques=None)
    band = share * resmoothing.chosen_bandwidth(alone)
    robot = jounce.Robot(replace(ROBOT.mechanism, confirmed_band=band)).with_limits(effort=1e3)
    jounce.save(robot, tmp_path / "robot.yaml")
    for one in (robot, jounce.load(tmp_path / "robot.yaml")):
        notes = "".join(one.check(alone).notes)
        assert (f"torques confirmed positions of this robot up to {band:.3g} Hz" in notes) == said
        assert (f"bandwidth={band:.3g}" in notes) == said


def test_identified_robots_remember_the_band(dragged):
    """The least of all logs; one that is identified anew without play forgets it."""
    t, Q = dragged[0].torques
    with pytest.warns(jounce.JounceWarning, match="torques confirm the positions up to"):
        found = ROBOT.identify(dragged[0], Q, t=t, drives=("damping",))
    assert found.robot.mechanism.confirmed_band == found.confirmed[0]
    exact = jounce.Motion.fourier([-1.5, 0.0], [[0.3, 0.2], [0.2, 0.4]], [[0.1, 0.3], [0.4, 0.1]], 2.0, 6.0)
    forces = found.robot.forces_along(exact, t, order=0).forces[0]
    assert found.robot.identify(exact, forces, t=t, drives=("damping",)).robot.mechanism.confirmed_band is None


@QUIET
@pytest.mark.parametrize(("level", "verdict"), [(1.02, "broken"), (0.87, "broken"), (0.82, "undecided")])
def test_measured_torques_near_the_bound_confirm_it(dragged, level, verdict):
    """Drives clip there. Torques that alternate by 0.02 N m have a noise of 0.067 by differences of order 8."""
    motion, _ = dragged
    t, Q = motion.torques
    even = level + 0.02 * (-1.0) ** np.arange(len(t))[:, None] + 0 * Q
    assert checked(replace(motion, torques=(t, even)), 1.0)[0].verdict == verdict


@QUIET
def test_torques_that_are_missing_contradict_nothing(dragged):
    motion, most = dragged
    t, Q = motion.torques
    for missing in (Q * [1, np.nan], np.where(np.arange(len(t))[:, None] % 400 < 380, np.nan, Q)):
        assert checked(replace(motion, torques=(t, missing)), 1.3 * most[1])[0].verdict == "broken"


@QUIET
def test_torques_of_another_pace_say_nothing(dragged):
    motion, most = dragged
    assert checked(motion.scaled(0.9), 1.3 * most[1])[0].verdict == "broken"


@QUIET
def test_rates_of_efforts_are_not_judged_by_them(dragged):
    motion, _ = dragged
    assert ROBOT.with_limits(effort_rate=20.0).check(motion).verdict == "broken"
