"""Payloads: parameters within their deviations, what logs do not determine, wrong logs, calibration, controllers."""

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import jounce
from jounce.identification.payload import central_covariance, central_parameters, fit_loads, kuka_angles
from jounce.identification.physical_consistency import fit_consistent_body
from jounce.spatial import inertia
from support.refusals import expect_refusal, refusal

SECONDS = 6.0
T = np.linspace(0, SECONDS, 1501)
LOAD = jounce.inertia_matrix(2.0, [0.02, -0.03, 0.05], [[0.004, 1e-4, 0], [1e-4, 0.005, 0], [0, 0, 0.003]])
TRUE = inertia.parameters(LOAD)
NOISE = 0.05  # N m
QUIET = pytest.mark.filterwarnings("ignore::jounce.JounceWarning")  # what notes hold


def laden(arm, load=LOAD, frame="tool0", share=1.0):
    """The arm with a load in a frame, in which a share of it stays."""
    at = arm.mechanism.frame(frame)
    M = np.array(arm.mechanism.M)
    M[at.body] += share * inertia.shift_inertia(load, at.T)
    return arm.with_inertial_parameters(inertia.parameters(M).ravel())


def tool_log(robot, motion, seed=0, noise=NOISE, factors=1.0):
    """The motion with torques of a robot, friction of its own and noise."""
    rng, (q, qd, q2d) = np.random.default_rng(seed), motion(T, 2)
    friction = rng.uniform(1, 3, 3) * np.tanh(qd / 0.05) + rng.uniform(1, 3, 3) * qd + rng.normal(size=3)
    Q = robot.inverse_dynamics(q, qd, q2d) + friction + noise * rng.normal(size=q.shape)
    return replace(motion, torques=(T, Q / factors))


def over_deviations(found):
    return (found.parameters - TRUE) / np.sqrt(np.diag(found.covariance))


def test_exact_torques_give_the_load(arm, motion):
    """The model's own masses do not matter, nor does friction that differs from log to log."""
    model = arm.with_inertial_parameters(1.2 * arm.inertial_parameters)
    found = model.payload(tool_log(laden(arm), motion, 1, 0.0), tool_log(arm, motion, 2, 0.0), body="tool0")
    assert found.parameters == pytest.approx(TRUE, abs=1e-7)
    assert (found.mass, found.frame, found.notes, found.unseen) == (pytest.approx(2.0), "tool0", (), ())
    assert found.com == pytest.approx([0.02, -0.03, 0.05], abs=1e-6)
    assert found.inertia == pytest.approx(np.array([[0.004, 1e-4, 0], [1e-4, 0.005, 0], [0, 0, 0.003]]), abs=1e-6)
    q = [[0.1, -0.5, 0.8]]
    assert found.robot.mass_matrix(q) == pytest.approx(laden(model).mass_matrix(q), abs=1e-6)


def test_the_robot_without_the_load_serves_as_it_is(arm, motion):
    found = arm.payload(tool_log(laden(arm, frame="forearm_link"), motion, 1, 0.0))
    assert found.parameters == pytest.approx(TRUE, abs=1e-7)
    assert (found.frame, found.notes) == ("forearm_link", ())


def test_errors_are_as_large_as_their_deviations(arm, motion):
    over = []
    for seed in range(300, 308):
        found = arm.payload(tool_log(laden(arm), motion, seed), tool_log(arm, motion, 100 + seed), body="tool0")
        (a, s), (b, r) = found.halves
        assert abs(a - b) < 4 * np.hypot(s, r)
        assert found.notes == ()
        over.append(over_deviations(found))
    assert 0.75 < np.sqrt(np.mean(np.square(over))) < 1.25


def test_encoders_of_17_bits(arm, motion):
    over, step = [], 2 * np.pi / 2**17
    for seed in range(2):
        logs = []
        for robot, first in ((laden(arm), 300), (arm, 400)):
            exact = tool_log(robot, motion, first + seed)
            q = np.floor(motion(T, 0)[0] / step) * step
            logs.append(replace(jounce.Motion.fit(T, q), torques=exact.torques))
        found = arm.payload(*logs, body="tool0")
        assert found.notes == ()
        over.append(over_deviations(found))
    assert 0.5 < np.sqrt(np.mean(np.square(over))) < 1.5


def test_friction_of_each_log_is_found(arm, motion):
    """With friction that jumps, and more of it near rest; with eps of the model deviations are 0.006 to 0.009 kg."""
    qd = motion(T, 1)[1]
    added = np.sign(qd) * (1 + 0.6 * np.exp(-((qd / 0.08) ** 2))) - np.tanh(qd / 0.05)
    logs = [
        replace(motion, torques=(T, tool_log(robot, motion, seed).torques[1] + size * added))
        for robot, seed, size in ((laden(arm), 300, [1.0, 2.0, 3.0]), (arm, 400, [3.0, 2.0, 1.0]))
    ]
    found = arm.payload(*logs, body="tool0")
    row = found.table[0]
    assert abs(row.value - 2.0) < 3 * row.deviation < 3 * 0.004
    assert found.notes == ()


@QUIET
def test_no_load_is_no_load(arm, motion):
    found = arm.payload(tool_log(arm, motion, 1), tool_log(arm, motion, 2), body="tool0")
    row = found.table[0]
    assert abs(row.value) < 2 * row.deviation < 0.1
    assert row.seen
    assert "com x" in found.unseen
    assert found.notes[0].startswith("no load is seen")
    assert 0 <= found.mass < 0.1


def test_what_the_logs_do_not_determine_is_named():
    """A planar arm shows neither where a load sits along its axis nor how it resists other rotations."""
    robot = jounce.load("planar2r")
    motion = jounce.Motion.fourier([0.3, 0.2], [[0.5, 0.2], [0.1, 0.4]], [[0.1, 0.3], [0.5, 0.2]], 3.0, 4.0)
    heavy = laden(robot, jounce.inertia_matrix(1.0, [0.1, 0.05, 0], np.eye(3) * 0.01), "body2")
    logs = [
        replace(motion, torques=(motion.times, arm.forces_along(motion, order=0).forces[0])) for arm in (heavy, robot)
    ]
    with pytest.warns(jounce.JounceWarning, match="do not determine com z, Ixx, Ixy, Iyy, Ixz, Iyz: deviations"):
        found = robot.payload(*logs)
    assert found.unseen == ("com z", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz")
    assert np.isinf(found.table[3].deviation)
    assert [row.body for row in found.table[:3]] == pytest.approx([1.0, 0.1, 0.05], abs=1e-3)
    assert found.inertia[2, 2] == pytest.approx(0.01, rel=1e-3)
    along_axis = np.diag(found.inertia) @ [0.5, 0.5, -0.5]  # the second moment that no torque shows
    assert along_axis == pytest.approx((3 / (4 * np.pi * 1000.0)) ** (2 / 3) / 5, rel=0.05), "as of a ball of water"


@QUIET
@pytest.mark.parametrize("frame", ["tool0", "forearm_link"])
def test_a_known_mass_calibrates_torques(arm, motion, frame):
    factors = np.array([1.13, 0.9, 1.05])
    logs = [
        tool_log(laden(arm, frame=frame), motion, 1, factors=factors), tool_log(arm, motion, 2, factors=factors)
    ]  # fmt: skip
    found = arm.payload(*logs, body=frame, mass=2.0)
    values, deviations = found.factors
    assert np.abs(values - factors).max() < 0.02
    assert (np.abs(values - factors) < 3.5 * deviations).all()
    assert found.parameters[0] == 2.0
    assert found.com == pytest.approx([0.02, -0.03, 0.05], abs=2e-3)
    assert abs(arm.payload(*logs, body=frame).parameters[0] - 2.0) > 0.1, "without the mass they are off"


@QUIET
@pytest.mark.parametrize(("mass", "contradicts"), [(4.0, True), (2.5, False), (1.6, False), (1.0, True)])
def test_a_mass_that_contradicts_torque_constants_is_named(arm, motion, mass, contradicts):
    """2 kg are carried: 2.5 kg and 1.6 kg are torque constants that are off by a quarter."""
    found = arm.payload(tool_log(laden(arm), motion, 1), tool_log(arm, motion, 2), body="tool0", mass=mass)
    (*said,) = (note for note in found.notes if "contradicts the torques" in note)
    assert len(said) == contradicts
    if contradicts:
        assert said[0].startswith(f"mass is {mass:g} kg and contradicts the torques: the torques show 2 +- ")
        assert f"would be {mass / 2:.2g}" in said[0]


def test_the_scale_of_torques_is_said_to_be_assumed(arm, motion):
    logs = tool_log(laden(arm), motion, 1), tool_log(arm, motion, 2)
    found, calibrated = (arm.payload(*logs, body="tool0", mass=mass) for mass in (None, 2.0))
    assert "a load of known mass calibrates them" in found.assumption in str(found)
    assert calibrated.assumption is None
    assert "a load of known mass" not in str(calibrated)
    identified = arm.identify(logs[1])
    assert identified.assumption in str(identified)


def test_no_load_calibrates_nothing(arm, motion):
    with expect_refusal("too little to calibrate them"):
        arm.payload(tool_log(arm, motion, 1), tool_log(arm, motion, 2), body="tool0", mass=2.0)


def test_swapped_logs_are_refused(arm, motion):
    with expect_refusal("mass of the load is negative, -2", "they seem to be swapped"):
        arm.payload(tool_log(arm, motion, 2), tool_log(laden(arm), motion, 1), body="tool0")
    refusal(lambda: laden(arm).payload(tool_log(arm, motion, 2), body="tool0"), "expected ROBOT without the load")


def test_a_negative_mass_by_torques_in_another_unit_is_no_swap(arm, motion):
    logs = tool_log(laden(arm), motion, 1, factors=100.0), tool_log(arm, motion, 2)
    message = refusal(lambda: arm.payload(*logs, torques_as_given=True))
    assert "; log with the load: forces of all joints seem to have the wrong unit" in message
    assert "swapped" not in message


@QUIET
def test_a_load_that_changes_is_named(arm, motion):
    first, second = (tool_log(robot, motion, 1).torques[1] for robot in (laden(arm), arm))
    torques = np.where(T[:, None] < 3.0, first, second)
    found = arm.payload(replace(motion, torques=(T, torques)), tool_log(arm, motion, 2), body="tool0")
    assert found.notes[0].startswith("the load changes during the log: its halves have ")
    assert [m for m, _ in found.halves] == pytest.approx([2.0, 0.0], abs=0.1)
    assert not any("no load" in note for note in found.notes)


@QUIET
def test_logs_of_different_robots_are_named(arm, motion):
    p = arm.inertial_parameters.reshape(-1, 10) * np.array([1.0, 1.5, 1.0])[:, None]
    other = arm.with_inertial_parameters(p.ravel())
    found = arm.payload(tool_log(laden(arm), motion, 1), tool_log(other, motion, 2), body="tool0")
    assert found.notes[0].startswith("the logs differ by more than a load on tool0: chi")
    found = other.payload(tool_log(laden(arm), motion, 1), body="tool0")
    assert found.notes[0].startswith("the robot and the log differ by more than a load on tool0: chi")


@QUIET
def test_a_reference_with_a_load_is_named(arm, motion):
    found = arm.payload(tool_log(laden(arm), motion, 1), tool_log(laden(arm, share=0.5), motion, 2), body="tool0")
    said = r"the log without the load differs from the robot by a load of (1|1\.0\d*|0\.99\d*) \+- 0\.00"
    assert re.match(said, found.notes[0])
    assert found.parameters[0] == pytest.approx(1.0, abs=0.05)


@QUIET
def test_torques_in_motor_units_are_named(arm, motion):
    logs = tool_log(laden(arm), motion, 1, factors=100.0), tool_log(arm, motion, 2, factors=100.0)
    found = arm.payload(*logs, body="tool0", torques_as_given=True)
    for which in ("with", "without"):
        named = [note for note in found.notes if note.startswith(f"log {which} the load: ")]
        assert "forces of all joints seem to have the wrong unit" in named[0]
        assert "torques of shoulder_pan_joint, shoulder_lift_joint, elbow_joint are " in named[1]


@pytest.mark.parametrize(("options", "message"), [
    ({"body": "gripper"}, "unknown body 'gripper'; available: "),
    ({"body": "base_link"}, "a payload on 'base_link' has no effect"),
    ({"mass": 2.0}, "expected kg > 0 of a known load, and a log without it too"),
    ({"mass": -2.0}, "mass is -2.0; expected kg > 0"),
])  # fmt: skip
def test_refuses(arm, motion, options, message):
    refusal(lambda: arm.payload(tool_log(laden(arm), motion), **options), message)


def test_zero_torques_are_refused(arm, motion):
    zero = replace(motion, torques=(T, np.zeros((len(T), 3))))
    refusal(lambda: arm.payload(tool_log(arm, motion), zero), "all torques of the log without the load are 0")


def test_fits_of_logs_are_one_fit_of_all_rows():
    """With a load in two of three logs, drive terms of each log; the oracle stacks all rows."""
    rng, base, drives = np.random.default_rng(4), 12, 3
    K = rng.normal(size=(base, 10))
    rows = [rng.normal(size=(40, base + drives)) for _ in range(3)]
    right = [rng.normal(size=40) for _ in range(3)]
    logs = [
        SimpleNamespace(x=np.linalg.lstsq(Y, tau)[0], information=Y.T @ Y, rank=base + drives)
        for Y, tau in zip(rows, right, strict=True)
    ]
    found = fit_loads(logs, (0, None, 0), K, known=False)
    zero = np.zeros((40, drives))
    stacked = np.concatenate([
        np.hstack([Y[:, :base], *(Y[:, base:] if k == own else zero for own in range(3)), (k != 1) * Y[:, :base] @ K])
        for k, Y in enumerate(rows)
    ])  # fmt: skip
    u, left = np.linalg.lstsq(stacked, np.concatenate(right))[:2]
    within = sum(np.linalg.lstsq(Y, tau)[1][0] for Y, tau in zip(rows, right, strict=True))
    assert found.x[0] == pytest.approx(u[-10:], abs=1e-9)
    freedom = 3 * (base + drives) - stacked.shape[1]
    assert found.mismatch == pytest.approx((left[0] - within) / freedom)
    scale = max(1.0, found.mismatch)
    assert found.covariance == pytest.approx(scale * np.linalg.inv(stacked.T @ stacked)[-10:, -10:])
    assert found.information == pytest.approx(np.linalg.inv(found.covariance))


def test_central_parameters_and_their_deviations():
    central = central_parameters(TRUE)
    assert central == pytest.approx([2.0, 0.02, -0.03, 0.05, 0.004, 1e-4, 0.005, 0, 0, 0.003])
    rng, spread = np.random.default_rng(1), 1e-4 * np.diag(np.repeat([10.0, 1.0, 0.1], [1, 3, 6]))
    drawn = np.array([central_parameters(TRUE + spread @ rng.normal(size=10)) for _ in range(4000)])
    stated = central_covariance(TRUE, spread @ spread)
    assert np.std(drawn, axis=0) / np.sqrt(np.diag(stated)) == pytest.approx(np.ones(10), abs=0.05)


def test_the_nearest_body_exists():
    wrong = TRUE.copy()
    wrong[9] = 0.05  # Izz beyond the sum of the others
    prior = inertia.moment_matrix(LOAD)
    found = fit_consistent_body(wrong, 1e10 * np.eye(10), prior, 1.0)
    assert np.linalg.eigvalsh(inertia.moment_matrix(inertia.from_parameters(found))).min() > 0
    assert np.linalg.norm(found - wrong) > 1e-3
    assert fit_consistent_body(TRUE, 1e10 * np.eye(10), prior, 1.0) == pytest.approx(TRUE, abs=1e-6)


def test_controllers_get_the_body(arm, motion):
    found = arm.payload(tool_log(laden(arm), motion, 1, 0.0), tool_log(arm, motion, 2, 0.0), body="tool0")
    for text in ("setLoad(2.0000, {{0.02000, -0.03000, 0.05000}}", "set_payload(2.0000, [", "mass "):
        assert text in str(found)
    rng = np.random.default_rng(7)
    for _ in range(8):  # among them axes of both handednesses
        points = rng.normal(size=(20, 3))
        second = 1e-3 * points.T @ points
        other = replace(found, body=inertia.parameters(inertia.from_moments(*LOAD_MOMENTS, second + PARALLEL)))
        check_settings(other)


LOAD_MOMENTS = np.full((1, 1), 2.0), np.array([[0.04], [-0.06], [0.1]])
PARALLEL = LOAD_MOMENTS[1] @ LOAD_MOMENTS[1].T / 2.0


def check_settings(found):
    """Each line holds the mass, the centre of mass and the inertia about it."""
    numbers = {name: [float(x) for x in re.findall(r"-?\d+\.\d+", text)] for name, text in found.settings.items()}
    theta = found.inertia
    six = [theta[0, 0], theta[1, 1], theta[2, 2], theta[0, 1], theta[0, 2], theta[1, 2]]
    assert numbers["franka"] == pytest.approx([2.0, *found.com, *theta.ravel()], abs=1e-5)
    assert numbers["ur"] == pytest.approx([2.0, *found.com, *six], abs=1e-5)
    mass, x, y, z, a, b, c, *moments = numbers["iiwa"]
    assert [mass, x, y, z] == pytest.approx([2.0, 20, -30, 50], abs=0.01)
    turn = rotation("z", a) @ rotation("y", b) @ rotation("x", c)
    assert turn @ np.diag(moments) @ turn.T == pytest.approx(theta, abs=1e-5)


@pytest.mark.parametrize("angles", [(20.0, -40.0, 110.0), (30.0, 90.0, 0.0), (-50.0, -90.0, 0.0)])
def test_angles_of_kuka(angles):
    a, b, c = angles
    assert kuka_angles(rotation("z", a) @ rotation("y", b) @ rotation("x", c)) == pytest.approx(angles)


def rotation(axis, degrees):
    from scipy.spatial.transform import Rotation

    return Rotation.from_euler(axis, degrees, degrees=True).as_matrix()
