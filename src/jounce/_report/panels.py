"""Makes the panels of a report: what the template part and the script of each get.

`PANELS` are functions in the order of the page; each returns a `ReportPanel`, or None where a robot has no use for it.

The panel of sliders computes on the page: `sliders_code` generates JavaScript of the forces of a robot that rests and
is pulled, `sliders_data` is what its script gets: ranges of the joints, cut joints, and points that may be pulled.
"""

import platform
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from jounce._codegen import generate
from jounce._codegen.options import CodegenOptions
from jounce._report.curves import ChartFigure, figure, joint_style, list_finite, raise_powers
from jounce._report.drawing import GROUND_BODY, Drawing, drawing, tips
from jounce._report.report_data import MAX_SLOWDOWN_STATES, ReportData
from jounce.checks.description import joint_kind
from jounce.core.errors import join_names
from jounce.core.version import __version__
from jounce.dynamics.loop_branches import scales
from jounce.engine import hidden_vibrations
from jounce.engine.engine import Engine
from jounce.limits.verdicts import describe_judged
from jounce.model import coordinates, positions
from jounce.model.limits import BOUNDED_FORCES, LIMIT_KINDS, derivative_unit
from jounce.model.loops import Loop
from jounce.model.mechanism import Mechanism, body_name
from jounce.spatial.series import rate_name

MAX_BREAKS_LISTED = 30  # rows of the page; their number is given
MAX_SIDE_JOINTS = 12  # whose values leave room for the robot below: a screen shows some 30 rows
MAX_SLIDER_BODIES = 100  # of a robot whose sliders compute: code of some 200 kB


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


@dataclass(frozen=True)
class ReportPanel:
    """A part of the page: the template part ``panels/NAME.html.jinja``, with a title and a place.

    `content` is what the template part gets; `data` is what its script gets, by ``panelData("NAME")``, as JSON: that of
    page.js, or one of its own, ``panels/NAME.js``.
    """

    name: str
    title: str
    place: str  # "side", "wide" or "below"
    content: Mapping[str, Any]
    data: ChartFigure | Drawing | Sliders | None = None
    code: str = ""  # JavaScript that is made for this robot, before the script of the panel


@dataclass(frozen=True)
class CursorColumn:
    """A column of the values at the cursor: a quantity, its units, and its number among those of the page."""

    symbol: str
    units: list[str]
    number: int


@dataclass(frozen=True)
class WorstSize:
    """The largest size of a force or moment, when, and the nearest frame."""

    value: float
    t: float
    frame: int


@dataclass(frozen=True)
class LoadedCut:
    """A joint at which a loop is cut, between two frames, and the largest force and moment that it transmits."""

    name: str
    joint: str
    force: WorstSize
    moment: WorstSize


def robot(s: ReportData) -> ReportPanel:
    """The robot that moves."""
    place = "side" if len(s.joints) <= MAX_SIDE_JOINTS else "wide"
    return ReportPanel("robot", "Robot", place, {"meshes": bool(s.meshes.shapes)}, drawing(s))


def values(s: ReportData) -> ReportPanel:
    """The values under the cursor, and which joints are drawn."""
    columns = [
        CursorColumn(x.symbol, list(dict.fromkeys(map(raise_powers, x.units))), k)
        for k, x in enumerate(s.quantities.values())
    ]
    forces, others = ([x for x in columns if (x.symbol[0] == "Q") == side] for side in (True, False))
    lines = [[x[k : k + 3] for k in range(0, len(x), 3)] for x in (forces, others[:5], others[5:]) if x]
    joints = [joint_style(j) | {"name": joint} for j, joint in enumerate(s.joints)]
    content = {"lines": lines, "joints": joints, "uncertain": s.has_uncertain_ends}
    return ReportPanel("values", "Values at the cursor", "side", content)


def curves(s: ReportData) -> ReportPanel:
    """The curves over time."""
    shown = {
        "symbols": [x.symbol for x in s.quantities.values()],
        "uncertain": any(x.deviations is not None for x in s.at_frames.values()), "ends": s.has_uncertain_ends,
        "measured": s.motion.torques is not None, "breaks": bool(s.motion.breaks), "checked": s.check is not None,
    }  # fmt: skip
    return ReportPanel("curves", "Curves", "wide", shown, figure(s))


def sliders(s: ReportData) -> ReportPanel | None:
    """Joints that the reader moves, and an end that is pulled: what holds the robot at rest there."""
    m, coupled = s.robot.mechanism, s.robot.mechanism.is_closed and not s.robot.mechanism.loops
    if m.nb > MAX_SLIDER_BODIES or positions.multiscrew_joints(m) or s.along.base is not None or coupled:
        return None
    data = sliders_data(s)
    joints = [joint_style(j) | {"name": s.joints[j]} for j in s.own]
    content = {"joints": joints, "ends": end_names(m), "first": data.first, "force": data.force,
               "closed": bool(data.loops)}  # fmt: skip
    return ReportPanel("sliders", "Forces at rest", "wide", content, data, sliders_code(s.robot))


def limits(s: ReportData) -> ReportPanel:
    """The worst ratio of every limit, and the slow-down factor."""
    rows = sorted(s.check.table, key=lambda row: -row.ratio) if s.check else []
    table = [{"row": row, "frame": s.frame(row.t)} for row in rows]
    slowed = {"states": MAX_SLOWDOWN_STATES} if len(s.motion.times) > MAX_SLOWDOWN_STATES else {}
    content = {"table": table, "check": s.check, "slowdown": s.slowdown, "duration": s.motion.duration, **slowed}
    return ReportPanel(
        "limits",
        "Limits",
        "below",
        content | {"unjudged": _list_unjudged(s), "uncertain": any(row.certain for row in rows)},
    )


def _list_unjudged(s: ReportData) -> list[str]:
    """What is checked against no limit: kinds that are not stated, some of the time, vibrations that would not show."""
    missing = [
        kind.replace("_", " ") for kind in (*LIMIT_KINDS.motion, *LIMIT_KINDS.effort) if kind not in s.limits.kinds
    ]
    found = [f"no limit is stated of {join_names(missing)}"] if missing else []
    found += describe_judged(s.check.judged, "judged only") if s.check else []
    hidden = hidden_vibrations.find_hidden_vibrations(s.robot, s.motion, len(s.along.forces) - 1)
    return [*found, *map(hidden_vibrations.describe_hidden_vibration, hidden)]


def motion(s: ReportData) -> ReportPanel:
    """Where the motion comes from, how uncertain it is, and where it is not smooth."""
    m = s.motion
    names = s.robot.joint_names
    breaks = [
        {
            "frame": s.frame(found.t),
            "t": found.t,
            "joint": names[found.joint] if isinstance(found.joint, int) else found.joint,
            "what": rate_name(found.symbol, found.order),
            "jump": found.jump,
        }
        for found in m.breaks[:MAX_BREAKS_LISTED]
    ]
    uncertain = [
        {"symbol": x.symbol, "deviations": np.median(x.deviations[0], axis=0).tolist()}
        for x in s.at_frames.values()
        if x.deviations is not None
    ]
    content = {
        "motion": m, "states": len(m.times), "residual": None if m.residual is None else float(np.max(m.residual)),
        "breaks": breaks, "all_breaks": len(m.breaks), "uncertain": uncertain, "joints": s.joints,
    }  # fmt: skip
    return ReportPanel("motion", "Motion", "below", content)


def robot_data(s: ReportData) -> ReportPanel:
    """The joints of the robot and the bodies that they move."""
    m = s.robot.mechanism
    masses = np.asarray(m.M[:, 3, 3], dtype=float)
    leads, moved = set(coordinates.leading_joints(m)), set(coordinates.leading_joints(m.tree))
    joints = [
        {
            "name": m.joints[j],
            "type": joint_kind(m, j),
            "parent": body_name(m, m.parent[i]),
            "body": m.bodies[i],
            "mass": masses[i],
            "role": "" if j in leads else ", follows others" if j in moved else ", follows another",
        }
        for j, i in enumerate(m.owners)
    ]
    content = {"robot": s.robot, "joints": joints, "mass": masses.sum(), "gravity": np.asarray(m.gravity).tolist()}
    floats = "the base floats: jounce run gives the wrench on it, which the page leaves out"
    content["notes"] = [*s.meshes.notes, *_several_screw_notes(m), *([floats] if m.floats else [])]
    content["loops"] = _cut_joints(s)
    return ReportPanel("robot_data", "Robot data", "below", content)


def _several_screw_notes(m: Mechanism) -> list[str]:
    """What the page shows as q of joints of several screws, and that it has no sliders of them."""
    return [
        f"joint {joint.name} is a {joint.group.name} joint, so that there are no sliders: its q are shown as"
        f" {', '.join(joint.group.extents)} in the places of {', '.join(joint.group.velocities)}"
        for joint in positions.multiscrew_joints(m).values()
    ]


def _cut_joints(s: ReportData) -> list[LoadedCut]:
    """The joints at which loops are cut, with the largest force and moment of each."""
    W, loops = s.loop_wrenches, s.robot.mechanism.loops
    if W is None:
        return []

    def worst(sizes: np.ndarray) -> WorstSize:
        k = int(sizes.argmax())
        return WorstSize(float(sizes[k]), float(s.t[k]), s.frame(s.t[k]))

    sizes = [np.linalg.norm(part, axis=-1).T for part in (W[..., 3:], W[..., :3])]
    return [
        LoadedCut(f"{loop.a.name} - {loop.b.name}", loop.joint, worst(force), worst(moment))
        for loop, force, moment in zip(loops, *sizes, strict=True)
    ]


def conventions(s: ReportData) -> ReportPanel:
    """Units, signs and versions."""
    from plotly.offline import get_plotlyjs_version

    versions = {
        "jounce": __version__, "Python": platform.python_version(), "NumPy": np.__version__,
        "plotly.js": get_plotlyjs_version(),
    }  # fmt: skip
    content = {
        "acting": s.robot.mechanism.acting, "loads": list(s.motion.loads), "elastic": s.robot.mechanism.elasticity,
        "inertial": BOUNDED_FORCES[1] if s.limits.without_gravity else None,
        "states": len(s.motion.times), "frames": len(s.frames), "versions": versions,
    }  # fmt: skip
    return ReportPanel("conventions", "Conventions and versions", "below", content)


HERE = Path(__file__).parent
# Sliders that compute on the page.
UNLIMITED_RANGE = {"rad": np.pi, "m": 0.5}  # rad, m: how far a joint without limits goes either way, a whole turn
PULL_SIZES = (10.0, 20.0, 50.0)  # N, times powers of ten: the largest pull, at least the weight
COMMENT = re.compile(r"^(//| ?\*|/\*\*).*\n", re.MULTILINE)


def sliders_code(robot: Engine) -> str:
    """JavaScript that defines `forcesAtRest`: of coordinates, and wrenches that the bodies exert.

    Comments, which hold names of the file, are left out: no name of a file is ever part of a script.
    """
    outputs = ("inverse_dynamics", "gravity_forces")
    options = CodegenOptions(lang="javascript", order=0, outputs=outputs, wrench=True)
    code = generate.code(robot, options, "PREFIX.mjs")
    functions = COMMENT.sub("", code).replace("export function", "function")
    closing = (HERE / "closing.js").read_text(encoding="utf-8") if robot.mechanism.takes_dependent else ""
    return f"{closing}const forcesAtRest = (() => {{\n{functions}return {{{', '.join(outputs)}}};\n}})();\n"


def sliders_data(s: ReportData) -> Sliders:
    """What the script of the sliders gets."""
    m, ends = s.robot.mechanism, _ends(s.robot.mechanism)
    units = coordinates.units(m)
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
    bounds = coordinates.limits(m).bounds("position").copy()
    free = np.array([UNLIMITED_RANGE[unit] for unit in coordinates.units(m)])
    bounds[:, [j for x in positions.multiscrew_joints(m).values() for j in range(m.n)[x.coordinates]]] = (
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


PANELS = (values, robot, curves, sliders, limits, motion, robot_data, conventions)
