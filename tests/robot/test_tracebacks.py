"""Errors show the caller's line, at most two frames of jounce, and the message."""

import traceback
from copy import copy
from pathlib import Path

import numpy as np
import pytest

import jounce
from jounce.core.errors import door
from jounce.model.spring_deflection import UnreachableError

PACKAGE = Path(jounce.__file__).parent
MAX_FRAMES = 2  # of jounce: the method, and where the error leaves
MAX_LINES = 40  # of a terminal
WRONG_CALLS = {
    "shape": "robot.inverse_dynamics([1, 2], [1, 2], [1, 2])",
    "shape of an array": "robot.mass_matrix(np.zeros(5))",
    "body": 'robot.jacobian(zero, body="x")',
    "frame": 'robot.jacobian(zero, frame="x")',
    "form": 'robot.coriolis_matrix(zero, zero, form="x")',
    "method": 'robot.gravity_forces(zero, method="x")',
    "out": "robot.gravity_forces(zero, out=3)",
    "wrench": 'robot.inverse_dynamics(zero, zero, zero, wrench={"x": zero})',
    "drive terms": 'robot.regressor(zero, zero, zero, drives="x")',
    "rigid joints": "robot.motor_torques(zero, zero, zero, zero, zero)",
    "load on a body": 'robot.wrench(zero, body="x", force=[1])',
    "compile": 'robot.compile("x")',
    "kernel": 'robot.compile("gravity_forces", order=0)(np.zeros(5))',
    "vjp": 'robot.compile("gravity_forces", order=0).vjp(zero, zero)',
    "load": 'jounce.load("nofile.urdf")',
    "load_motion": 'jounce.load_motion({"t": np.linspace(0, 1, 50)}, robot)',
    "save": 'jounce.save(robot, "robot.txt")',
    "inertia_matrix": 'jounce.inertia_matrix("x", [0, 0, 0], np.eye(3))',
    "forces_along": "robot.forces_along(3)",
    "check": 'robot.check("x")',
    "retime": 'robot.retime("x")',
    "closed": 'robot.closed([("a", "b")])',
    "identify": "robot.identify(3)",
    "codegen": 'robot.codegen("x")',
    "Robot": "jounce.Robot(3)",
    "from_screws": "jounce.Robot.from_screws(1, 2, 3)",
    "with_limits": 'robot.with_limits(effort="x")',
    "motion of samples": 'jounce.Motion.through("x", [[1]])',
    "fit": "jounce.Motion.fit([0, 1], [[1], [2]])",
    "time": "motion(99.0)",
    "scaled": "motion.scaled(-1)",
    "sum": "motion + motion.shifted(9)",
    "live": "robot.live(1e-3, lag=0.01, noise=1e-4).update([1, 2])",
}


@pytest.fixture(scope="module")
def names():
    """What the calls take, by name."""
    robot, zero = jounce.load("ur5"), np.zeros(6)
    robot.inverse_dynamics(zero, zero, zero)  # further calls go the short way
    motion = jounce.Motion.trapezoidal([zero, zero + 0.5], velocity=1.0, acceleration=2.0)
    return {"np": np, "jounce": jounce, "robot": robot, "zero": zero, "motion": motion}


def error_of(call, *given):
    with pytest.raises(jounce.JounceError) as found:
        call(*given)
    return found.value


@pytest.mark.parametrize("call", WRONG_CALLS.values(), ids=WRONG_CALLS)
def test_wrong_calls_show_two_of_our_frames_at_most(names, call):
    error = error_of(eval, call, names)
    frames = [Path(frame.filename) for frame in traceback.extract_tb(error.__traceback__)]
    assert len([path for path in frames if path.is_relative_to(PACKAGE)]) <= MAX_FRAMES
    # No other error is printed ahead of it.
    assert error.__cause__ is None
    assert error.__suppress_context__ or error.__context__ is None


@pytest.mark.parametrize("call", WRONG_CALLS.values(), ids=WRONG_CALLS)
def test_wrong_calls_are_short_in_notebooks(names, call):
    formatter = pytest.importorskip("IPython.core.ultratb").AutoFormattedTB(mode="Context")
    error = error_of(eval, call, names)
    lines = formatter.text(type(error), error, error.__traceback__, tb_offset=1).splitlines()
    assert len(lines) <= MAX_LINES


def test_errors_that_leave_keep_kind_data_and_origin():
    first = UnreachableError("too far", 3)
    first.add_note("at the elbow")

    def compute():
        raise first

    error = error_of(door(compute))
    assert error is not first
    assert error.__context__ is first
    assert type(error) is UnreachableError
    assert (str(error), error.state, error.__notes__) == ("too far", 3, ["at the elbow"])


def test_uncertain_results_leave_with_their_error():
    first = jounce.UncertainError("uncertain", (np.ones(2),), ["Q"], [np.array(True)])
    error = copy(first)
    assert type(error) is jounce.UncertainError
    assert (str(error), error.results, error.names, error.uncertain) == (
        "uncertain", first.results, ("Q",), first.uncertain,
    )  # fmt: skip


def test_other_errors_leave_with_all_frames():
    def compute():
        raise NameError("planted")

    with pytest.raises(NameError, match="planted") as found:
        door(compute)()
    assert [frame.name for frame in traceback.extract_tb(found.value.__traceback__)][-1] == "compute"
