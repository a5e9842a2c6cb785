"""Displays in notebooks: tables in HTML, and pictures where matplotlib is installed."""

from base64 import b64encode
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import jinja2
import numpy as np

from jounce.actuators.motors import ElasticAlong
from jounce.checks.description import describe, limit_in_words
from jounce.core import display, errors
from jounce.core.errors import JounceError, join_names
from jounce.engine.along import Along
from jounce.engine.engine import Engine
from jounce.figures import canvas
from jounce.figures.curves import draw_curves
from jounce.figures.drawing import View, draw, place_labels, poses_on
from jounce.figures.measured_forces import draw_measured_forces
from jounce.figures.panels import DrawnRun, Panel, thin_points
from jounce.identification.payload import PARAMETER_COLUMNS, Payload
from jounce.identification.result import RESIDUAL_COLUMNS, Identification
from jounce.limits.retime import Retiming
from jounce.limits.slowdown import Slowdown
from jounce.limits.verdicts import Check, CheckedLimit
from jounce.model import positions
from jounce.model.drive_trains import Drives
from jounce.model.mechanism import Mechanism
from jounce.motion import channel
from jounce.motion.channel import Channel
from jounce.motion.motion import Motion

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Cells = Sequence[str]
PAGE = """<p>{{ head }}</p>
{% if rows %}<table>
<thead><tr>{% for cell in names %}<th>{{ cell }}</th>{% endfor %}</tr></thead>
<tbody>{% for row in rows %}<tr>{% for cell in row %}<td>{{ cell }}</td>{% endfor %}</tr>
{% endfor %}</tbody></table>{% endif %}
{% for note in notes %}<p>{{ note }}</p>
{% endfor %}{{ picture | safe }}"""
MAX_ROWS_SHOWN = 12  # of a table, as much as a screen has next to a picture: of a check those nearest to their limits
MAX_BODIES_DRAWN = 12  # of a robot: labels of more frames would cover each other
MAX_CURVES_SHOWN = 12  # of a quantity: more would be a page of axes
MAX_RATE_DRAWN = 2  # of a quantity: what users look at first
DISPLAY_CURVE_POINTS = 400  # of a curve: a small SVG within a notebook
MIN_POINTS_EACH = 30  # of each of many curves that share their times: ten pieces with their extremes


@display.render_html.register
def robot(robot: Engine) -> str:
    """The joints, bodies and limits of a robot, and a drawing of it where all coordinates are 0."""
    return _robot_page(repr(robot)[1:-1], robot)


@display.render_html.register
def mechanism(m: Mechanism) -> str:
    """What a robot of this mechanism shows."""
    return _robot_page(m.summary, Engine(m))


def _robot_page(head: str, robot: Engine) -> str:
    m = robot.mechanism
    if not m.is_numeric:
        moved = [m.bodies[i] for i in m.owners]
        return _page(head, ("joint", "body"), list(zip(m.joints, moved, strict=True)))
    kinds = m.limits.kinds
    rows = [
        (
            x.joint,
            x.type,
            body.name,
            body.parent,
            f"{body.inertia.mass:.4g} kg",
            *(limit_in_words(x, kind) for kind in kinds),
        )
        for body in describe(m).bodies
        for x in body.variables
    ]
    names = ("joint", "type", "body", "on", "mass", *(kind.replace("_", " ") for kind in kinds))

    def paint(figure: "Figure") -> None:
        axes = figure.subplots()
        draw(axes, m, poses_on(robot, positions.rest(m), np.eye(4)), View(-55, 18))
        place_labels(figure, axes)

    drawing = _picture(lambda: canvas.painted(paint, 5, 5)) if len(m.moving_bodies) <= MAX_BODIES_DRAWN else ""
    return _page(head, names, rows, picture=drawing)


@display.render_html.register
def motion(motion: Motion) -> str:
    """Where the joints of a motion start and end, their largest rates, and q, qd, q2d over time."""
    t = np.linspace(motion.start, motion.stop, DISPLAY_CURVE_POINTS)
    rates = motion(t, 2)
    joints = motion.joint_names or tuple(f"joint {j}" for j in range(1, rates[0].shape[-1] + 1))
    rows = [
        (joint, *(f"{x:.5g}" for x in (q[0], q[-1], abs(qd).max(), abs(q2d).max())))
        for joint, q, qd, q2d in zip(joints, *(rate.T for rate in rates), strict=True)
    ]
    q = Channel("q", joints, ("",) * len(joints), t, rates, breaks=motion.breaks)
    run = DrawnRun([Panel(q.rate(k).upto(0)) for k in range(len(rates))])
    names = ("joint", "start", "end", "largest |qd|", "largest |q2d|")
    return _page(repr(motion)[1:-1], names, rows, motion.notes, _picture(lambda: draw_curves([run])))


@display.render_html.register
def channel_page(found: Channel) -> str:
    """The largest values of each column and rate, and when; the curves."""
    titles, rows = found.peak_table
    notes = _count_left(len(rows), "columns")
    return _page(found.summary, titles, rows[:MAX_ROWS_SHOWN], notes, _curves([found]))


@display.render_html.register
def forces(found: Along) -> str:
    """The largest values of the coordinates, the forces and their rates; the curves of q, Q, Qd and Q2d."""
    return _channels_page("Along", found.channels, [found.coordinates[0].upto(0), found.efforts])


@display.render_html.register
def motors(found: ElasticAlong) -> str:
    """The largest values of links and motors and of their rates; the curves of q, theta, tau, i and u."""
    drawn = [of.upto(0) for of in (found.links[0], *found.motors)]
    return _channels_page("ElasticAlong", found.channels, drawn, found.notes)


@display.render_html.register
def drives(found: Drives) -> str:
    """The parameters that are stated, joint by joint."""
    rows = found.rows
    notes = _count_left(len(rows), "joints")
    return _page(found.summary, ("joint", *found.stated_parameters), rows[:MAX_ROWS_SHOWN], notes)


@display.render_html.register
def identification(found: Identification) -> str:
    """What is left of the forces, the parameters that the data do not determine, and forces measured and computed."""
    rows = found.residual_rows
    unseen = [f"not seen: {join_names(found.unseen)}"] if found.unseen else []
    notes = [*_count_left(len(rows), "forces"), *unseen, *found.notes]
    picture = _picture(lambda: draw_measured_forces(found))
    return _page(found.summary, RESIDUAL_COLUMNS, rows[:MAX_ROWS_SHOWN], notes, picture)


@display.render_html.register
def payload(found: Payload) -> str:
    """Mass, centre of mass and inertia of a payload, and what controllers take."""
    settings = [f"{who}: {text}" for who, text in found.settings.items()]
    return _page(found.summary, PARAMETER_COLUMNS, found.parameter_rows, [*found.notes, *settings])


@display.render_html.register
def check(found: Check) -> str:
    """The limits that a motion comes nearest to, or breaks."""
    rows = sorted(found.table, key=lambda row: -row.ratio)[:MAX_ROWS_SHOWN]
    names = ("", "joint", "limit", "worst", "bound", "unit", "at t [s]", "ratio")
    left = len(found.table) - len(rows)
    notes = (*([f"and {left} more limits, all of lower ratios"] if left else []), *found.notes)
    return _page(repr(found)[1:-1], names, [_limit_cells(row) for row in rows], notes)


@display.render_html.register
def slowdown(slow: Slowdown) -> str:
    """The factor of speed of a slow-down, the limit that decides it, and the motion."""
    return _page(repr(slow)[1:-1], notes=slow.notes, picture=motion(slow.motion))


@display.render_html.register
def retiming(faster: Retiming) -> str:
    """The duration of a retimed motion, the limits that decide it, and the motion."""
    rows = [
        (s.joint, s.limit.replace("_", " "), f"{s.start:.4g}", f"{s.stop:.4g}") for s in faster.binding[:MAX_ROWS_SHOWN]
    ]
    left = len(faster.binding) - len(rows)
    notes = [*([f"and {left} more stretches"] if left else []), *faster.notes]
    names = ("joint", "limit that decides", "from t [s]", "to t [s]")
    return _page(repr(faster)[1:-1], names, rows, notes, picture=motion(faster.motion))


def _channels_page(title: str, channels: Sequence[Channel], drawn: Sequence[Channel], notes: Cells = ()) -> str:
    """The largest values of channels at the same times, and the curves of some of them."""
    rows, also = channel.list_largest(channels, MAX_ROWS_SHOWN)
    head = f"{title}: {channel.describe_times(channels)}"
    return _page(head, channel.LARGEST_TITLES, rows[:MAX_ROWS_SHOWN], [*also, *notes], _curves(drawn))


def _curves(channels: Sequence[Channel]) -> str:
    """The curves of the first columns of channels and of their first rates, or nothing of arrays such as poses."""
    panels = [
        Panel(part.rate(k).upto(0))
        for drawn in channels
        if drawn.values.ndim == 2 and len(drawn.times)
        for part in [_thin(drawn.upto(MAX_RATE_DRAWN).columns(range(len(drawn.names))[:MAX_CURVES_SHOWN]))]
        for k in range(len(part.rates))
    ]
    return _picture(lambda: draw_curves([DrawnRun(panels)])) if panels else ""


def _thin(channel: Channel) -> Channel:
    """A channel at fewer times, the extremes of all columns and rates among them."""
    curves = [column for rate in channel.rates for column in rate.T]
    if len(channel.times) <= DISPLAY_CURVE_POINTS or not curves:
        return channel
    each = max(DISPLAY_CURVE_POINTS // len(curves), MIN_POINTS_EACH)
    at = np.unique(np.concatenate([thin_points(np.nan_to_num(column), each) for column in curves]))
    return channel.rows(at)


def _count_left(count: int, what: str) -> list[str]:
    """How many rows of a table are not shown."""
    return [f"and {count - MAX_ROWS_SHOWN} more {what}"] if count > MAX_ROWS_SHOWN else []


def _limit_cells(row: CheckedLimit) -> tuple[str, ...]:
    spread = f" ± {row.deviation:.2g}" if row.deviation else ""
    numbers = (f"{row.value:.5g}", f"{row.bound:.5g}", row.unit, f"{row.t:.4f}", f"{row.ratio:.4g}{spread}")
    return (row.verdict, row.joint, row.words, *numbers)


def _picture(paint: Callable[[], "Figure"]) -> str:
    """A picture as SVG, or nothing where matplotlib is missing: the table is complete without it."""
    try:
        content = canvas.svg(paint())
    except JounceError:
        return ""
    return f'<img alt="picture" src="data:image/svg+xml;base64,{b64encode(content).decode()}">'


def _page(head: str, names: Cells = (), rows: Sequence[Cells] = (), notes: Cells = (), picture: str = "") -> str:
    """A heading, a table, notes and a picture; names are escaped."""
    cells = [[errors.shorten(cell) for cell in row] for row in rows]
    template = jinja2.Environment(autoescape=True).from_string(PAGE)
    return template.render(head=head, names=names, rows=cells, notes=notes, picture=picture)
