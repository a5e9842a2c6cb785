"""Half a step by which encoders that floor are off, in the deviations of identified parameters."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from benchmarks.pendulum import DAMPING, double_pendulum

import jounce
from jounce.identification.averaging import CellAverages
from jounce.identification.motion_errors import EncoderOffsets
from jounce.identification.regression import Regression, fit_forces
from jounce.motion import resmoothing
from jounce.motion.joint_matching import match_joints

ROBOT = double_pendulum()
MODEL = ROBOT.with_inertial_parameters(1.3 * ROBOT.inertial_parameters)
TRUE = np.append(ROBOT.base_parameters().values, DAMPING)
NOTE = "half a step of the encoder of "
WAYS = {"floors": np.floor, "rounds": np.round}


def swinging_log(seed, way, bits, seconds=10.0, step=0.002, noise=0.02):
    """Times, positions that encoders report, and torques with noise."""
    rng = np.random.default_rng(seed)
    offset = np.array([-np.pi / 2, 0]) + 0.1 * rng.normal(size=2)
    motion = jounce.Motion.fourier(offset, *(0.5 * rng.normal(size=(2, 3, 2))), 2.0, seconds).with_step(step)
    q, qd, q2d = motion(motion.times, 2)
    Q = ROBOT.inverse_dynamics(q, qd, q2d) + DAMPING * qd + noise * rng.normal(size=q.shape)
    unit = 2 * np.pi / 2**bits
    return motion.times, unit * WAYS[way](q / unit), Q


def identify_pendulum(t, q, Q):
    return MODEL.identify(jounce.Motion.fit(t, q, allow_noise=True), Q, t=t, drives=("damping",), prior=10.0)


def errors_in_deviations(found):
    return np.array([row.value for row in found.table] - TRUE) / np.sqrt(np.diag(found.covariance))


@pytest.mark.parametrize("bits", [12, 16])
@pytest.mark.parametrize("way", WAYS)
def test_deviations_hold_whether_encoders_floor_or_round(way, bits):
    over = np.array([errors_in_deviations(identify_pendulum(*swinging_log(seed, way, bits))) for seed in range(5)])
    assert np.sqrt(np.mean(over**2)) < 1.2
    assert np.abs(over).max() < 4.5


def test_an_encoder_that_floors_is_off_by_its_deviation(monkeypatch):
    """Gravity of both links is turned by half a step, and a note says so; residuals alone say a sixth of that."""
    bare, with_offsets = list[Regression](), Regression.with_offsets
    monkeypatch.setattr(Regression, "with_offsets", lambda solution: bare.append(solution) or with_offsets(solution))
    found = identify_pendulum(*swinging_log(1, "floors", 12, seconds=4.0, step=0.004, noise=0.005))
    turned, over = [row.name.endswith("mcy") for row in found.table], errors_in_deviations(found)
    assert np.abs(over).max() < 3
    assert over[turned] == pytest.approx(1.1, abs=0.4)
    of_residuals = np.sqrt(np.diag(bare[0].covariance) / np.diag(found.covariance))
    assert (over[turned] / of_residuals[turned] > 4.5).all()
    assert (of_residuals > 0.9).sum() == 6, "parameters that gravity does not turn"
    (note,) = [note for note in found.notes if note.startswith(NOTE)]
    assert note.startswith(f"{NOTE}joint1, joint2 makes more than half of the deviation of body1 mcy, body2 mcy: ")


def test_offsets_make_forces_of_the_corrected_robot():
    """Differences of its forces by half a step; joint 1 turns gravity alone, joint 2 the inertia too."""
    rng, base = np.random.default_rng(3), ROBOT.base_parameters()
    states, half, terms = tuple(rng.normal(size=(3, 5, 2))), np.array([2e-4, 5e-4]), ("damping",)
    model = np.append(MODEL.inertial_parameters, np.zeros(2))
    columns = np.append(base.columns, [20, 21])
    offsets = EncoderOffsets(MODEL, terms, columns, model, states, None, half)
    corrections = TRUE - np.append(MODEL.base_parameters().values, np.zeros(2))
    q, qd, q2d = states
    for j, made in enumerate(np.moveaxis(offsets.forces(corrections), -1, 0)):
        moved = ROBOT.inverse_dynamics(q + half * np.eye(2)[j], qd, q2d) - ROBOT.inverse_dynamics(q, qd, q2d)
        assert made == pytest.approx(moved, abs=1e-13)
    assert not EncoderOffsets(MODEL, terms, columns, model, states, None, 0 * half).forces(corrections).any()


def test_covariance_and_information_hold_the_same_offsets():
    """Of parameters that the data determine, one is the inverse of the other, before and after."""
    C, rng = 200, np.random.default_rng(4)
    Y, one = rng.normal(size=(C, 2, 3)), np.ones((C, 2))
    cells = CellAverages(Y, Y @ [1, 2, 3] + rng.normal(size=(C, 2)), 0 * one, one, 0 * one)
    made = rng.normal(size=(C, 2, 2))
    offsets = SimpleNamespace(forces=lambda x: made)
    bare = fit_forces(cells, np.arange(3), None, known=True, offsets=(offsets,))
    # what the fit makes of forces that are as much larger
    for j in range(2):
        more = fit_forces(replace(cells, off=cells.off + 1e-6 * made[..., j]), np.arange(3), None, known=True)
        assert (more.x - bare.x) / 1e-6 == pytest.approx(bare.offsets[:, j], abs=1e-8)
    found = bare.with_offsets()
    assert found.covariance - bare.covariance == pytest.approx(bare.offsets @ bare.offsets.T, abs=1e-12)
    for solution in (bare, found):
        assert solution.information @ solution.covariance == pytest.approx(np.eye(3), abs=1e-9)
    assert bare.offset_shares.sum(axis=1) == pytest.approx(1 - np.diag(bare.covariance) / np.diag(found.covariance))


def test_steps_are_those_of_smoothed_positions():
    """In the order of the robot, at any pace; exact motions and splines have none."""
    t, rng = np.arange(500) / 500, np.random.default_rng(5)
    q = np.sin(2 * np.pi * t[:, None] * [1.0, 1.5]) + 1e-7 * rng.normal(size=(500, 2))
    steps = 2 * np.pi / 2 ** np.array([12, 14])
    log = jounce.Motion.fit(t, steps * np.floor(q / steps), allow_noise=True, joint_names=("b", "a"))
    assert resmoothing.position_steps(log) == pytest.approx(steps)
    assert resmoothing.position_steps(log.scaled(2.0)) == pytest.approx(steps)
    arm = jounce.Robot.from_screws([np.eye(4)] * 2, [[0, 0, 1, 0, 0, 0]] * 2, [np.eye(6)] * 2, joint_names=("a", "b"))
    assert resmoothing.position_steps(match_joints(log, arm.mechanism)) == pytest.approx(steps[::-1])
    assert not resmoothing.position_steps(jounce.Motion.through(t[::50], q[::50])).any()
    assert not resmoothing.position_steps(jounce.Motion.fourier([0, 0], [[0.5, 0.2]], [[0.1, 0.3]], 3.0, 4.0)).any()
