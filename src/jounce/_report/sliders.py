"""Sliders that compute on the page: generated JavaScript of the forces of a robot that rests and is pulled."""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from jounce._codegen import generate
from jounce._report.array_text import list_finite
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


@dataclass(frozen=True)
class PulledPoint:
    """A point that may be pulled, in the frame of its body."""

    body: int
    point: list[float]


@dataclass(frozen=True)
class CutFrame:
    """A frame of a cut joint: its body, and the rows of its pose, without the last."""

    body: int
    T: list[float]


@dataclass(frozen=True)
class CutLoop:
    """A cut joint for the page: its frames, and the directions in which it allows no turn and no slide."""

    frames: list[CutFrame]
    turns: list[list[float]]
    slides: list[list[float]]
    axis: list[float]


@dataclass(frozen=True)
class Sliders:
    """The stretches of the joints, the points that may be pulled, and the bounds of Q."""

    lower: list[float]
    upper: list[float]
    units: list[str]
    effort: list[list[float | None]]
    own: tuple[int, ...]
    loops: list[CutLoop]
    lengths: list[float]
    inertial: bool
    ends: list[PulledPoint]
    first: int
    force: float


def sliders_code(robot: Engine) -> str:
    """JavaScript that defines `forcesAtRest`: of coordinates, and wrenches that the bodies exert.

    Comments, which hold names of the file, are left out: no name of a file is ever part of a script.
    """
    outputs = ("inverse_dynamics", "gravity_forces")
    code = generate.code(robot, "javascript", "PREFIX.mjs", 0, outputs, wrench=True)
    functions = COMMENT.sub("", code).replace("export function", "function")
    closing = (HERE / "closing.js").read_text(encoding="utf-8") if robot.mechanism.takes_dependent else ""
    return f"{closing}const forcesAtRest = (() => {{\n{functions}return {{{', '.join(outputs)}}};\n}})();\n"


def sliders_data(s: ReportData) -> Sliders:
    """What the script of the sliders gets."""
    m, ends = s.robot.mechanism, _ends(s.robot.mechanism)
    units = coordinate_units(m)
    lower, upper = slider_ranges(m, s.along.rates[0])
    return Sliders(
        lower=lower.tolist(),
        upper=upper.tolist(),
        units=[derivative_unit("Q", 0, unit) for unit in units],
        effort=list_finite(s.limits.bounds("effort")[:, s.own]),
        own=s.own,
        loops=[_loop(loop) for loop in m.loops],
        lengths=(scales(m).coordinates if m.takes_dependent else np.ones(m.n)).tolist(),
        inertial="effort" in s.limits.without_gravity,
        ends=ends,
        first=_first(m, ends),
        force=_largest_force(m),
    )


def slider_ranges(m: Mechanism, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The lowest and the highest coordinates of sliders: the limits, or those of a motion q (N, n) that goes beyond."""
    bounds = coordinate_limits(m).bounds("position").copy()
    free = np.array([UNLIMITED_RANGE[unit] for unit in coordinate_units(m)])
    bounds[:, [j for x in multiscrew_joints(m).values() for j in range(m.n)[x.coordinates]]] = (
        np.inf
    )  # not of what sliders set
    lower, upper = np.where(np.isfinite(bounds), bounds, [-free, free])
    return q.min(axis=0, initial=np.inf).clip(max=lower), q.max(axis=0, initial=-np.inf).clip(min=upper)


def _loop(loop: Loop) -> CutLoop:
    frames = [CutFrame(of.body, np.asarray(of.T[:3], dtype=float).ravel().tolist()) for of in (loop.a, loop.b)]
    turns, slides = (directions.tolist() for directions in loop.held)
    return CutLoop(frames, turns, slides, np.asarray(loop.axis, dtype=float).tolist())


def end_names(m: Mechanism) -> list[str]:
    """The names of the points that may be pulled: bodies, and links merged into them."""
    return [*m.bodies, *(frame.name for frame in m.frames if frame.body != GROUND_BODY)]


def _ends(m: Mechanism) -> list[PulledPoint]:
    """The points that may be pulled: the origins of those that `end_names` lists, each in the frame of its body."""
    frames = [m.frame(name) for name in end_names(m)]
    return [PulledPoint(frame.body, np.asarray(frame.T[:3, 3], dtype=float).tolist()) for frame in frames]


def _first(m: Mechanism, ends: list[PulledPoint]) -> int:
    """The end that is pulled at first: the one that is nearest to the last outermost point."""
    body, point = tips(m)[-1] if tips(m) else (m.nb - 1, np.zeros(3))
    of_body = [k for k, end in enumerate(ends) if end.body == body]
    return min(of_body, key=lambda k: float(np.linalg.norm(point - ends[k].point)))


def _largest_force(m: Mechanism) -> float:
    weight = float(np.asarray(m.M[:, 3, 3], dtype=float).sum()) * 9.81
    power = 10.0 ** max(0, np.floor(np.log10(max(weight, PULL_SIZES[0]))) - 1)
    return float(next((x * power for x in PULL_SIZES if x * power >= weight), 100 * power))
