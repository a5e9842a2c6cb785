"""Makes the panels of a report: the data of their templates and scripts.

`PANELS` are functions in the order of the page; each returns a `ReportPanel`, or None where a robot has no use for it.

The panel of sliders computes on the page. `sliders_code` generates JavaScript for the forces of a robot at rest that is
pulled. `sliders_data` are the data of its script: ranges of the joints, cut joints, and points that may be pulled.
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
MAX_SLIDER_BODIES = 100  # of a robot with sliders: its code has some 200 kB


@dataclass(frozen=True)
class PulledPoint:
    """A point that may be pulled, in the frame of its body."""

    body: int
    point: list[float]


@dataclass(frozen=True)
class CutFrame:
    """A frame of a cut joint: its body, and the first three rows of its pose."""

    body: int
    T: list[float]


@dataclass(frozen=True)
class CutLoop:
    """A cut joint: its frames, and the directions of turns and slides that it blocks."""

    frames: list[CutFrame]
    turns: list[list[float]]
    slides: list[list[float]]
    axis: list[float]


@dataclass(frozen=True)
class Sliders:
    """The data of the sliders: ranges of joints, points to pull, bounds of Q."""

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
    """A part of the page: the template ``panels/NAME.html.jinja``, with a title and a place.

    `content` are the data of the template. `data` are those of the script, page.js or ``panels/NAME.js``, which reads
    them as JSON by ``panelData("NAME")``.
    """

    name: str
    title: str
    place: str  # "robot", "values", "wide" or "below"
    content: Mapping[str, Any]
    data: ChartFigure | Drawing | Sliders | None = None
    code: str = ""  # JavaScript generated for this robot; it stands before the script of the panel
    fold: str | None = None  # what follows the title of a panel that is folded at first; None leaves it open


@dataclass(frozen=True)
class CursorColumn:
    """A column of the values at the cursor: a quantity, its units, and its number."""

    symbol: str
    units: list[str]
    number: int


@dataclass(frozen=True)
class WorstSize:
    """The largest size of a force or moment, with time and frame."""

    value: float
    t: float
    frame: int


@dataclass(frozen=True)
class LoadedCut:
    """A cut joint of a loop, with its largest force and moment."""

    name: str
    joint: str
    force: WorstSize
    moment: WorstSize


def robot(s: ReportData) -> ReportPanel:
    """Make the panel of the moving robot."""
    content = {"meshes": bool(s.meshes.shapes), "robot": s.robot}
    return ReportPanel("robot", "Robot", "robot", content, drawing(s))


def values(s: ReportData) -> ReportPanel:
    """Make the panel of forces at the cursor.

    Its boxes select the joints to draw.
    """
    content = _tables(s, of_forces=True) | {"uncertain": s.has_uncertain_ends}
    return ReportPanel("values", "Values at the cursor", "values", content)


def _tables(s: ReportData, of_forces: bool) -> dict[str, Any]:
    """Return the tables of forces at the cursor, or of all others."""
    columns = [
        CursorColumn(x.symbol, list(dict.fromkeys(map(raise_powers, x.units))), k)
        for k, (key, x) in enumerate(s.quantities.items())
        if key in s.keys(of_forces) and key not in LIMIT_KINDS.totals
    ]
    joints = [joint_style(j) | {"name": joint} for j, joint in enumerate(s.joints)]
    # Each table has at most three columns, so that it fits a phone; those of motors follow the five of q to q4d.
    lines = [columns] if of_forces else [columns[:5], columns[5:]]
    tables = [line[k : k + 3] for line in lines for k in range(0, len(line), 3)]
    return {"tables": tables, "joints": joints, "ticked": of_forces}


def curves(s: ReportData) -> ReportPanel:
    """Make the panel of the curves of forces over time."""
    content = {
        "symbols": [s.quantities[key].symbol for key in s.keys(of_forces=True)],
        "uncertain": any(x.deviations is not None for x in s.at_frames.values()), "ends": s.has_uncertain_ends,
        "measured": s.motion.torques is not None, "breaks": bool(s.motion.breaks), "checked": s.check is not None,
    }  # fmt: skip
    return ReportPanel("curves", "Curves", "wide", content, figure(s, of_forces=True))


def rates(s: ReportData) -> ReportPanel:
    """Make the folded panel of q, its rates, power and motors."""
    keys, rows = s.keys(of_forces=False), s.check.table if s.check is not None else ()
    symbols = [s.quantities[key].symbol for key in keys]
    count = sum(row.limit in keys and row.verdict == "broken" for row in rows)
    broken = {0: "", 1: "1 limit broken"}.get(count, f"{count} limits broken")
    content = _tables(s, of_forces=False) | {"symbols": symbols}
    return ReportPanel("rates", ", ".join(symbols), "wide", content, figure(s, of_forces=False), fold=broken)


def sliders(s: ReportData) -> ReportPanel | None:
    """Make the panel of sliders, for forces of a robot at rest.

    It is None for robots that the code of the page does not cover.
    """
    m, is_coupled = s.robot.mechanism, s.robot.mechanism.is_closed and not s.robot.mechanism.loops
    if m.nb > MAX_SLIDER_BODIES or positions.multiscrew_joints(m) or s.along.base is not None or is_coupled:
        return None
    data = sliders_data(s)
    joints = [joint_style(j) | {"name": s.joints[j]} for j in s.own]
    content = {"joints": joints, "ends": end_names(m), "first": data.first, "force": data.force,
               "closed": bool(data.loops)}  # fmt: skip
    code = sliders_code(s.robot)
    return ReportPanel("sliders", "Forces at rest", "wide", content, data, code, fold="move joints, pull an end")


def limits(s: ReportData) -> ReportPanel:
    """Make the panel of all limits and of the slow-down factor."""
    rows = sorted(s.check.table, key=lambda row: -row.ratio) if s.check is not None else []
    table = [{"row": row, "frame": s.frame(row.t)} for row in rows]
    thinned = {"states": MAX_SLOWDOWN_STATES} if len(s.motion.times) > MAX_SLOWDOWN_STATES else {}
    content = {"table": table, "check": s.check, "slowdown": s.slowdown, "duration": s.motion.duration, **thinned}
    notes = {"unjudged": _list_unjudged(s), "uncertain": any(row.certain for row in rows)}
    verdict = "none" if s.check is None else s.check.words
    return ReportPanel("limits", "Limits", "below", content | notes, fold=verdict)


def _list_unjudged(s: ReportData) -> list[str]:
    """List what is not checked: kinds without limits, spans of time, hidden vibrations."""
    missing = [
        kind.replace("_", " ") for kind in (*LIMIT_KINDS.motion, *LIMIT_KINDS.effort) if kind not in s.limits.kinds
    ]
    sentences = []
    if len(missing) > 0:
        sentences.append(f"there are no limits of {join_names(missing)}")
    if s.check is not None:
        sentences += describe_judged(s.check.judged, "judged only")
    hidden = hidden_vibrations.find_hidden_vibrations(s.robot, s.motion, len(s.along.forces) - 1)
    return [*sentences, hidden_vibrations.describe_worst_vibration(hidden)] if len(hidden) > 0 else sentences


def motion(s: ReportData) -> ReportPanel:
    """Make the panel of the motion: its source, deviations and breaks."""
    m = s.motion
    names = s.robot.joint_names
    # A break is of a joint by its number, or of a name such as that of a contact.
    breaks = [
        {
            "frame": s.frame(jump.t),
            "t": jump.t,
            "joint": names[jump.joint] if isinstance(jump.joint, int) else jump.joint,
            "what": rate_name(jump.symbol, jump.order),
            "jump": jump.jump,
        }
        for jump in m.breaks[:MAX_BREAKS_LISTED]
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
    return ReportPanel("motion", "Motion", "below", content, fold=f"{len(m.times)} states")


def robot_data(s: ReportData) -> ReportPanel:
    """Make the panel of joints and bodies."""
    m = s.robot.mechanism
    masses = np.asarray(m.M[:, 3, 3], dtype=float)
    leads, leads_in_tree = set(coordinates.leading_joints(m)), set(coordinates.leading_joints(m.tree))

    def role(j: int) -> str:
        """Describe how a joint follows others.

        In closed loops it follows several joints; otherwise it mimics another one.
        """
        if j in leads:
            return ""
        return ", follows others" if j in leads_in_tree else ", follows another"

    joints = [
        {
            "name": m.joints[j],
            "type": joint_kind(m, j),
            "parent": body_name(m, m.parent[i]),
            "body": m.bodies[i],
            "mass": masses[i],
            "role": role(j),
        }
        for j, i in enumerate(m.owners)
    ]
    content = {"robot": s.robot, "joints": joints, "mass": masses.sum(), "gravity": np.asarray(m.gravity).tolist()}
    floating_note = "the base floats: jounce run gives the wrench on it, which the page leaves out"
    content["notes"] = [*s.meshes.notes, *_several_screw_notes(m), *([floating_note] if m.floats else [])]
    content["loops"] = _cut_joints(s)
    return ReportPanel("robot_data", "Robot data", "below", content, fold="joints and bodies")


def _several_screw_notes(m: Mechanism) -> list[str]:
    """Describe how the page shows joints of several screws."""
    return [
        f"joint {joint.name} is a {joint.group.name} joint, so there are no sliders; its q are shown as"
        f" {', '.join(joint.group.extents)} in the places of {', '.join(joint.group.velocities)}"
        for joint in positions.multiscrew_joints(m).values()
    ]


def _cut_joints(s: ReportData) -> list[LoadedCut]:
    """Return the cut joints of loops with their largest forces and moments."""
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
    """Make the panel of units, signs and versions."""
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
    return ReportPanel("conventions", "Conventions and versions", "below", content, fold="")


HERE = Path(__file__).parent
# Sliders that compute on the page.
UNLIMITED_RANGE = {"rad": np.pi, "m": 0.5}  # rad, m: to either side of 0, of joints without limits
PULL_SIZES = (10.0, 20.0, 50.0)  # N, times powers of ten: the largest pull, at least the weight
COMMENT = re.compile(r"^(//| ?\*|/\*\*).*\n", re.MULTILINE)


def sliders_code(robot: Engine) -> str:
    """Generate JavaScript that defines `forcesAtRest`.

    Its arguments are the coordinates, and the wrenches that the bodies exert. Comments, which hold names of the file,
    are left out: no name of a file is ever part of a script.
    """
    outputs = ("inverse_dynamics", "gravity_forces")
    options = CodegenOptions(lang="javascript", order=0, outputs=outputs, wrench=True)
    code = generate.code(robot, options, "PREFIX.mjs")
    functions = COMMENT.sub("", code).replace("export function", "function")
    closing = (HERE / "closing.js").read_text(encoding="utf-8") if robot.mechanism.takes_dependent else ""
    return f"{closing}const forcesAtRest = (() => {{\n{functions}return {{{', '.join(outputs)}}};\n}})();\n"


def sliders_data(s: ReportData) -> Sliders:
    """Return the data of the script of the sliders."""
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
    """Return the lowest and the highest coordinates of sliders.

    They are the limits, or the extremes of a motion q (N, n) that goes beyond.
    """
    bounds = coordinates.limits(m).bounds("position").copy()
    free = np.array([UNLIMITED_RANGE[unit] for unit in coordinates.units(m)])
    # Limits of joints of several screws are of other numbers than those that sliders set.
    several = [j for joint in positions.multiscrew_joints(m).values() for j in range(m.n)[joint.coordinates]]
    bounds[:, several] = np.inf
    lower, upper = np.where(np.isfinite(bounds), bounds, [-free, free])
    return q.min(axis=0, initial=np.inf).clip(max=lower), q.max(axis=0, initial=-np.inf).clip(min=upper)


def _loop(loop: Loop) -> CutLoop:
    """Return a cut joint as plain data."""
    frames = [CutFrame(frame.body, np.asarray(frame.T[:3], dtype=float).ravel().tolist()) for frame in (loop.a, loop.b)]
    turns, slides = (directions.tolist() for directions in loop.held)
    return CutLoop(frames, turns, slides, np.asarray(loop.axis, dtype=float).tolist())


def end_names(m: Mechanism) -> list[str]:
    """Return the names of the points that may be pulled: bodies and merged links."""
    return [*m.bodies, *(frame.name for frame in m.frames if frame.body != GROUND_BODY)]


def _ends(m: Mechanism) -> list[PulledPoint]:
    """Return the points that may be pulled, in frames of their bodies.

    They are the origins of the bodies and links of `end_names`.
    """
    frames = [m.frame(name) for name in end_names(m)]
    return [PulledPoint(frame.body, np.asarray(frame.T[:3, 3], dtype=float).tolist()) for frame in frames]


def _first(m: Mechanism, ends: list[PulledPoint]) -> int:
    """Return the number of the end nearest to the last outermost point.

    It is the end that is pulled at first.
    """
    body, point = tips(m)[-1] if tips(m) else (m.nb - 1, np.zeros(3))
    ends_of_body = [k for k, end in enumerate(ends) if end.body == body]
    return min(ends_of_body, key=lambda k: float(np.linalg.norm(point - ends[k].point)))


def _largest_force(m: Mechanism) -> float:
    """Return the largest pull: a round number, at least the weight, N."""
    weight = float(np.asarray(m.M[:, 3, 3], dtype=float).sum()) * 9.81
    power = 10.0 ** max(0, np.floor(np.log10(max(weight, PULL_SIZES[0]))) - 1)
    return float(next((x * power for x in PULL_SIZES if x * power >= weight), 100 * power))


PANELS = (robot, values, curves, rates, sliders, limits, motion, robot_data, conventions)
