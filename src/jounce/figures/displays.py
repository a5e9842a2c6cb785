"""Displays objects in notebooks: tables in HTML, and pictures with matplotlib."""

from base64 import b64encode
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import jinja2
import numpy as np

from jounce.actuators.motors import ElasticAlong
from jounce.checks.description import describe, limit_in_words, totals_in_words
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
from jounce.model.limits import LIMIT_KINDS
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
MAX_ROWS_SHOWN = 12  # of a table next to a picture on a screen; a check shows the limits nearest to their bounds
MAX_BODIES_DRAWN = 12  # of a robot: labels of more frames would cover each other
MAX_CURVES_SHOWN = 12  # of a quantity: more would be a page of axes
MAX_RATE_DRAWN = 2  # highest rate of a quantity: users look at the low ones first
DISPLAY_CURVE_POINTS = 400  # of a curve: a small SVG within a notebook
MIN_POINTS_EACH = 30  # of each of many curves that share their times: ten pieces with their extremes


@display.render_html.register
def robot(robot: Engine) -> str:
    """Show the joints, bodies and limits of a robot, and a drawing.

    All coordinates of the drawing are 0.
    """
    return _robot_page(repr(robot)[1:-1], robot)


@display.render_html.register
def mechanism(m: Mechanism) -> str:
    """Show the robot of a mechanism."""
    return _robot_page(m.summary, Engine(m))


def _robot_page(head: str, robot: Engine) -> str:
    """Return the page of a robot; with symbols it has names only."""
    m = robot.mechanism
    # Symbols have no limits to list, and no drawing.
    if not m.is_numeric:
        moved = [m.bodies[i] for i in m.owners]
        return _page(head, ("joint", "body"), list(zip(m.joints, moved, strict=True)))
    kinds = [kind for kind in m.limits.kinds if kind not in LIMIT_KINDS.totals]
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
    return _page(head, names, rows, totals_in_words(m.limits), picture=drawing)


@display.render_html.register
def motion(motion: Motion) -> str:
    """Show starts, ends and largest rates of joints, and curves.

    The curves are those of q, qd and q2d.
    """
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
def channel_page(shown_channel: Channel) -> str:
    """Show the largest values of each column and rate, and the curves."""
    titles, rows = shown_channel.peak_table
    notes = _count_left(len(rows), "columns")
    return _page(shown_channel.summary, titles, rows[:MAX_ROWS_SHOWN], notes, _curves([shown_channel]))


@display.render_html.register
def forces(along: Along) -> str:
    """Show the largest values along a motion, and curves.

    Values are those of coordinates, forces and their rates; curves those of q, Q, Qd and Q2d.
    """
    return _channels_page("Along", along.channels, [along.coordinates[0].upto(0), along.efforts])


@display.render_html.register
def motors(along: ElasticAlong) -> str:
    """Show the largest values of links and motors, and curves.

    The curves are those of q, theta, tau, i and u.
    """
    drawn_channels = [part.upto(0) for part in (along.links[0], *along.motors)]
    return _channels_page("ElasticAlong", along.channels, drawn_channels, along.notes)


@display.render_html.register
def drives(stated_drives: Drives) -> str:
    """Show the parameters of the drives, joint by joint."""
    rows = stated_drives.rows
    notes = _count_left(len(rows), "joints")
    return _page(stated_drives.summary, ("joint", *stated_drives.stated_parameters), rows[:MAX_ROWS_SHOWN], notes)


@display.render_html.register
def identification(identified: Identification) -> str:
    """Show residuals, undetermined parameters, and measured and computed forces."""
    rows = identified.residual_rows
    unseen = [f"not seen: {join_names(identified.unseen)}"] if len(identified.unseen) > 0 else []
    notes = [*_count_left(len(rows), "forces"), *identified.rest_notes, *unseen, *identified.notes]
    picture = _picture(lambda: draw_measured_forces(identified))
    return _page(identified.summary, RESIDUAL_COLUMNS, rows[:MAX_ROWS_SHOWN], notes, picture)


@display.render_html.register
def payload(identified: Payload) -> str:
    """Show mass, centre of mass and inertia of a payload.

    Settings for controllers follow.
    """
    settings = [f"{controller}: {text}" for controller, text in identified.settings.items()]
    notes = [*identified.rest_notes, *identified.notes, *settings]
    return _page(identified.summary, PARAMETER_COLUMNS, identified.parameter_rows, notes)


@display.render_html.register
def check(checked: Check) -> str:
    """Show the limits that a motion breaks or comes nearest to."""
    rows = sorted(checked.table, key=lambda row: -row.ratio)[:MAX_ROWS_SHOWN]
    names = ("", "joint", "limit", "worst", "bound", "unit", "at t [s]", "ratio")
    hidden_count = len(checked.table) - len(rows)
    notes = (*([f"and {hidden_count} more limits, all with lower ratios"] if hidden_count > 0 else []), *checked.notes)
    return _page(repr(checked)[1:-1], names, [_limit_cells(row) for row in rows], notes)


@display.render_html.register
def slowdown(slow: Slowdown) -> str:
    """Show the factor of a slow-down, the deciding limit, and the motion."""
    return _page(repr(slow)[1:-1], notes=slow.notes, picture=motion(slow.motion))


@display.render_html.register
def retiming(faster: Retiming) -> str:
    """Show the duration of a retimed motion, the deciding limits, the motion."""
    rows = [
        (stretch.joint, stretch.limit.replace("_", " "), f"{stretch.start:.4g}", f"{stretch.stop:.4g}")
        for stretch in faster.binding[:MAX_ROWS_SHOWN]
    ]
    hidden_count = len(faster.binding) - len(rows)
    notes = [*([f"and {hidden_count} more stretches"] if hidden_count > 0 else []), *faster.notes]
    names = ("joint", "limit that decides", "from t [s]", "to t [s]")
    return _page(repr(faster)[1:-1], names, rows, notes, picture=motion(faster.motion))


def _channels_page(title: str, channels: Sequence[Channel], drawn: Sequence[Channel], notes: Cells = ()) -> str:
    """Show the largest values of channels, and some of their curves.

    All channels have the same times.
    """
    rows, further_notes = channel.list_largest(channels, MAX_ROWS_SHOWN)
    head = f"{title}: {channel.describe_times(channels)}"
    return _page(head, channel.LARGEST_TITLES, rows[:MAX_ROWS_SHOWN], [*further_notes, *notes], _curves(drawn))


def _curves(channels: Sequence[Channel]) -> str:
    """Draw the first columns and rates of channels.

    Arrays such as poses have no curves.
    """
    panels = [
        Panel(part.rate(k).upto(0))
        for drawn_channel in channels
        if drawn_channel.values.ndim == 2 and len(drawn_channel.times)
        for part in [
            _thin(drawn_channel.upto(MAX_RATE_DRAWN).columns(range(len(drawn_channel.names))[:MAX_CURVES_SHOWN]))
        ]
        for k in range(len(part.rates))
    ]
    return _picture(lambda: draw_curves([DrawnRun(panels)])) if panels else ""


def _thin(channel: Channel) -> Channel:
    """Return a channel at fewer times, with all its extremes."""
    curves = [column for rate in channel.rates for column in rate.T]
    if len(channel.times) <= DISPLAY_CURVE_POINTS or not curves:
        return channel
    points_per_curve = max(DISPLAY_CURVE_POINTS // len(curves), MIN_POINTS_EACH)
    rows = np.unique(np.concatenate([thin_points(np.nan_to_num(column), points_per_curve) for column in curves]))
    return channel.rows(rows)


def _count_left(count: int, what: str) -> list[str]:
    """Return a note on the rows that are not shown."""
    return [f"and {count - MAX_ROWS_SHOWN} more {what}"] if count > MAX_ROWS_SHOWN else []


def _limit_cells(row: CheckedLimit) -> tuple[str, ...]:
    """Return the cells of a checked limit."""
    deviation = f" ± {row.deviation:.2g}" if row.deviation else ""
    numbers = (f"{row.value:.5g}", f"{row.bound:.5g}", row.unit, f"{row.t:.4f}", f"{row.ratio:.4g}{deviation}")
    return (row.verdict, row.joint, row.words, *numbers)


def _picture(paint: Callable[[], "Figure"]) -> str:
    """Return a picture as SVG, or nothing if matplotlib is missing.

    The table is complete without it.
    """
    try:
        content = canvas.svg(paint())
    except JounceError:
        return ""
    return f'<img alt="picture" src="data:image/svg+xml;base64,{b64encode(content).decode()}">'


def _page(head: str, names: Cells = (), rows: Sequence[Cells] = (), notes: Cells = (), picture: str = "") -> str:
    """Return a heading, a table, notes and a picture, with names escaped."""
    cells = [[errors.shorten(cell) for cell in row] for row in rows]
    template = jinja2.Environment(autoescape=True).from_string(PAGE)
    return template.render(head=head, names=names, rows=cells, notes=notes, picture=picture)
