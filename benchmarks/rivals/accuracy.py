"""Errors of Q, Qd, Q2d and M against the 50 digits of tests/golden/lagrange/iiwa.json.

The robot is the iiwa of the paper, its states those of the golden cases without wrenches. Inputs are the doubles that
the file names; expected values have 50 digits, of which a double keeps 16. A library is called as in `calls`.
"""

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

import jounce
from benchmarks.rivals import Rival
from benchmarks.rivals.arms import GRAVITY, Arm
from benchmarks.rivals.calls import Worker
from benchmarks.rivals.robots import write_urdf
from benchmarks.rivals.tasks import TASKS, error
from benchmarks.rivals.worker import FAILED, NOT_SERVED, SERVED, Request

GOLDEN = Path(__file__).parents[2] / "tests/golden/lagrange/iiwa.json"
EXPECTED = {"forces": ("Q",), "force_rates": ("Q", "Qd", "Q2d"), "mass_matrix": ("M",)}
STATE = ("q", "qd", "q2d", "q3d", "q4d")
WRENCHES = ("W", "Wd", "W2d")

Row = dict[str, Any]


def measured(folder: Path, rivals: Sequence[Rival], report: Callable[[str], None]) -> list[Row]:
    """Return a row for each quantity and library: the largest error over the largest value of all cases, or a note."""
    golden = json.loads(GOLDEN.read_text(encoding="utf-8"))
    arm = _write(golden["robot"], folder)
    cases = [case for case in golden["cases"] if not any(np.any(case[rate]) for rate in WRENCHES)]
    rows = []
    for rival in rivals:
        worker = Worker(rival)
        report(f"accuracy of {rival.name}")
        for task in EXPECTED:
            row = {"task": task, "rival": rival.name} | _error(worker, arm, task, cases)
            if row.get("note") != NOT_SERVED:
                rows.append(row)
        worker.stop()
    return rows


def _write(data: dict[str, Any], folder: Path) -> Arm:
    """Write the robot of the golden data as a URDF file."""
    if data["gravity"] != [0.0, 0.0, GRAVITY]:
        raise ValueError(f"the golden robot has gravity {data['gravity']}, the libraries {GRAVITY}")
    joints = data["joints"]
    B, X = (np.array([joint[key] for joint in joints]) for key in ("B", "screw"))
    M = [jounce.inertia_matrix(joint["mass"], joint["com"], joint["inertia_com"]) for joint in joints]
    names = [joint["name"] for joint in joints]
    robot = jounce.Robot.from_screws(B, X, M, [joint["parent"] for joint in joints], joint_names=names)
    return write_urdf(robot, folder / "golden.urdf", robot.body_names[-1])


def _error(worker: Worker, arm: Arm, task: str, cases: Sequence[dict[str, Any]]) -> Row:
    """Return the largest error of a task over the cases, which are one batch, or a note."""
    inputs = tuple(_stack(cases, key) for key in STATE[: TASKS[task].inputs])
    request = Request(arm, task, inputs)
    status, found = worker.prepare(request)
    if status != SERVED:
        return {"note": found if status == FAILED else NOT_SERVED}
    off = error(found, [_stack(cases, key) for key in EXPECTED[task]])
    if not np.isfinite(off):
        return {"note": "not the numbers of the task"}
    return {"error": off}


def _stack(cases: Sequence[dict[str, Any]], key: str) -> np.ndarray:
    return np.array([case[key] for case in cases], float)
