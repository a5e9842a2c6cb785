"""Displays in notebooks: tables in HTML, and pictures where matplotlib is installed."""

from base64 import b64encode
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import jinja2
import numpy as np

from jounce.checks.description import describe, limit_in_words
from jounce.core.display import render_html
from jounce.core.errors import JounceError, shorten
from jounce.engine.engine import Engine
from jounce.figures import canvas
from jounce.figures.curves import draw_curves
from jounce.figures.drawing import View, draw, poses_on
from jounce.figures.labels import place_labels
from jounce.figures.panels import DrawnRun, Panel
from jounce.limits.retime import Retiming
from jounce.limits.slowdown import Slowdown
from jounce.limits.verdicts import Check, CheckedLimit
from jounce.model.positions import resting_position
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
DISPLAY_CURVE_POINTS = 400  # of a curve: a small SVG within a notebook


@render_html.register
def robot(robot: Engine) -> str:
    """The joints, bodies and limits of a robot, and a drawing of it where all coordinates are 0."""
    m, head = robot.mechanism, repr(robot)[1:-1]
    if not m.is_numeric:
        moved = [m.bodies[i] for i in m.owners]
        return _page(head, ("joint", "body"), list(zip(m.joints, moved, strict=True)))
    kinds = m.limits.kinds
    rows = [
        (
            *(x[key] for key in ("joint", "type")),
            *(body[key] for key in ("name", "parent")),
            f"{body['mass']:.4g} kg",
            *(limit_in_words(x, kind) for kind in kinds),
        )
        for body in describe(m)["bodies"]
        for x in body["velocities"] or [body]
    ]
    names = ("joint", "type", "body", "on", "mass", *(kind.replace("_", " ") for kind in kinds))

    def paint(figure: "Figure") -> None:
        axes = figure.subplots()
        draw(axes, m, poses_on(robot, resting_position(m), np.eye(4)), View(-55, 18))
        place_labels(figure, axes)

    drawing = _picture(lambda: canvas.painted(paint, 5, 5)) if len(m.moving_bodies) <= MAX_BODIES_DRAWN else ""
    return _page(head, names, rows, picture=drawing)


@render_html.register
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


@render_html.register
def check(found: Check) -> str:
    """The limits that a motion comes nearest to, or breaks."""
    rows = sorted(found.table, key=lambda row: -row.ratio)[:MAX_ROWS_SHOWN]
    names = ("", "joint", "limit", "worst", "bound", "unit", "at t [s]", "ratio")
    left = len(found.table) - len(rows)
    notes = (*([f"and {left} more limits, all of lower ratios"] if left else []), *found.notes)
    return _page(repr(found)[1:-1], names, [_limit_cells(row) for row in rows], notes)


@render_html.register
def slowdown(slow: Slowdown) -> str:
    """The factor of speed of a slow-down, the limit that decides it, and the motion."""
    return _page(repr(slow)[1:-1], notes=slow.notes, picture=motion(slow.motion))


@render_html.register
def retiming(faster: Retiming) -> str:
    """The duration of a retimed motion, the limits that decide it, and the motion."""
    rows = [
        (s.joint, s.limit.replace("_", " "), f"{s.start:.4g}", f"{s.stop:.4g}") for s in faster.binding[:MAX_ROWS_SHOWN]
    ]
    left = len(faster.binding) - len(rows)
    notes = [*([f"and {left} more stretches"] if left else []), *faster.notes]
    names = ("joint", "limit that decides", "from t [s]", "to t [s]")
    return _page(repr(faster)[1:-1], names, rows, notes, picture=motion(faster.motion))


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
    cells = [[shorten(cell) for cell in row] for row in rows]
    template = jinja2.Environment(autoescape=True).from_string(PAGE)
    return template.render(head=head, names=names, rows=cells, notes=notes, picture=picture)
