"""Sliders that compute on the page: generated JavaScript of the forces of a robot that rests and is pulled."""

import re
from pathlib import Path
from typing import Any

import numpy as np

from jounce._codegen import generate
from jounce._report.drawing import GROUND_BODY, tips
from jounce._report.report_data import ReportData
from jounce.dynamics.loop_branches import scales
from jounce.engine.engine import Engine
from jounce.model.coordinates import coordinate_limits, coordinate_units
from jounce.model.limit_kinds import derivative_unit
from jounce.model.loops import Loop
from jounce.model.mechanism import Mechanism
from jounce.model.positions import multiscrew_joints

HERE = Path(__file__).parent
UNLIMITED_RANGE = {"rad": np.pi, "m": 0.5}  # rad, m: how far a joint without limits goes either way, a whole turn
PULL_SIZES = (10.0, 20.0, 50.0)  # N, times powers of ten: the largest pull, at least the weight
COMMENT = re.compile(r"^(//| ?\*|/\*\*).*\n", re.MULTILINE)


def sliders_code(robot: Engine) -> str:
    """JavaScript that defines `forcesAtRest`: of coordinates, and wrenches that the bodies exert.

    Comments, which hold names of the file, are left out: no name of a file is ever part of a script.
    """
    outputs = ("inverse_dynamics", "gravity_forces")
    code = generate.code(robot, "javascript", "PREFIX.mjs", 0, outputs, wrench=True)
    functions = COMMENT.sub("", code).replace("export function", "function")
    closing = (HERE / "closing.js").read_text(encoding="utf-8") if robot.mechanism.takes_dependent else ""
    return f"{closing}const forcesAtRest = (() => {{\n{functions}return {{{', '.join(outputs)}}};\n}})();\n"


def sliders_data(s: ReportData) -> dict[str, Any]:
    """The stretches of the joints, the points that may be pulled, and the bounds of Q."""
    m, ends = s.robot.mechanism, _ends(s.robot.mechanism)
    units = coordinate_units(m)
    lower, upper = slider_ranges(m, s.along.rates[0])
    return {
        "lower": lower.tolist(),
        "upper": upper.tolist(),
        "units": [derivative_unit("Q", 0, unit) for unit in units],
        "effort": [
            [x if np.isfinite(x) else None for x in row] for row in s.limits.bounds("effort")[:, s.own].tolist()
        ],
        "own": s.own,
        "loops": [_loop(loop) for loop in m.loops],
        "lengths": (scales(m).coordinates if m.takes_dependent else np.ones(m.n)).tolist(),
        "inertial": "effort" in s.limits.without_gravity,
        "ends": ends,
        "first": _first(m, ends),
        "force": _largest_force(m),
    }


def slider_ranges(m: Mechanism, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The lowest and the highest coordinates of sliders: the limits, or those of a motion q (N, n) that goes beyond."""
    bounds = coordinate_limits(m).bounds("position").copy()
    free = np.array([UNLIMITED_RANGE[unit] for unit in coordinate_units(m)])
    bounds[:, [j for x in multiscrew_joints(m).values() for j in range(m.n)[x.coordinates]]] = (
        np.inf
    )  # not of what sliders set
    lower, upper = np.where(np.isfinite(bounds), bounds, [-free, free])
    return q.min(axis=0, initial=np.inf).clip(max=lower), q.max(axis=0, initial=-np.inf).clip(min=upper)


def _loop(loop: Loop) -> dict[str, Any]:
    """A cut joint for the page: its frames, and the directions in which it allows no turn and no slide."""
    frames = [
        {"body": frame.body, "T": np.asarray(frame.T[:3], dtype=float).ravel().tolist()} for frame in (loop.a, loop.b)
    ]
    turns, slides = (directions.tolist() for directions in loop.held)
    return {"frames": frames, "turns": turns, "slides": slides, "axis": np.asarray(loop.axis, dtype=float).tolist()}


def end_names(m: Mechanism) -> list[str]:
    """The names of the points that may be pulled: bodies, and links merged into them."""
    return [*m.bodies, *(frame.name for frame in m.frames if frame.body != GROUND_BODY)]


def _ends(m: Mechanism) -> list[dict[str, Any]]:
    """The points that may be pulled: the origins of those that `end_names` lists, each in the frame of its body."""
    frames = [m.frame(name) for name in end_names(m)]
    return [{"body": frame.body, "point": np.asarray(frame.T[:3, 3], dtype=float).tolist()} for frame in frames]


def _first(m: Mechanism, ends: list[dict[str, Any]]) -> int:
    """The end that is pulled at first: the one that is nearest to the last outermost point."""
    body, point = tips(m)[-1] if tips(m) else (m.nb - 1, np.zeros(3))
    of_body = [k for k, end in enumerate(ends) if end["body"] == body]
    return min(of_body, key=lambda k: float(np.linalg.norm(point - ends[k]["point"])))


def _largest_force(m: Mechanism) -> float:
    weight = float(np.asarray(m.M[:, 3, 3], dtype=float).sum()) * 9.81
    power = 10.0 ** max(0, np.floor(np.log10(max(weight, PULL_SIZES[0]))) - 1)
    return float(next((x * power for x in PULL_SIZES if x * power >= weight), 100 * power))
