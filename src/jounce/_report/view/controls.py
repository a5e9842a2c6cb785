"""The controls of the live view: sliders of the joints, the values and curves of Q, and words."""

from html import escape
from typing import Any

import numpy as np

from jounce._report.single_screws import to_single_screws
from jounce._report.sliders import slider_ranges
from jounce._report.view.scene import Scene
from jounce._report.view.track import ShownState, Track
from jounce.core.errors import escape_text, shorten
from jounce.engine.engine import Engine
from jounce.figures.canvas import COLOURS
from jounce.model.coordinates import coordinate_limits, coordinate_units
from jounce.model.limit_kinds import derivative_unit
from jounce.model.positions import starting_position

VIEW_CURVE_POINTS = 400  # of a curve: it is sent again five times per second
TIME_MARK_WIDTH = 1e-4  # of the duration: how wide the mark of the time is


def joint_sliders(gui: Any, robot: Engine, along: Track | None) -> list[Any]:
    """A slider for each single screw: from limit to limit, and as far as the motion goes."""
    q = np.zeros((0, robot.n)) if along is None else to_single_screws(robot.mechanism, along.q.values)
    lowest, highest = slider_ranges(robot.mechanism, q)
    m = robot.mechanism
    rest = starting_position(m)[list(m.independent_places)] if m.is_closed else np.zeros(robot.n)
    starts = rest.clip(lowest, highest) if along is None else q[0]
    found = []
    columns = (robot.joint_names, coordinate_units(robot.mechanism), *(x.tolist() for x in (lowest, highest, starts)))
    for name, unit, lower, upper, start in zip(*columns, strict=True):
        label = f"{escape_text(shorten(name))} [{unit}]"
        found.append(gui.add_slider(label, lower, upper, max((upper - lower) / 2000, 1e-9), start))
    return found


def curves_of(along: Track, t: float) -> tuple[np.ndarray, ...]:
    """Times and Q of each joint as the plot takes them, and a curve that marks a time by a peak."""
    first, last = along.t[[0, -1]]
    width = TIME_MARK_WIDTH * (last - first)
    kept = np.unique(np.linspace(0, len(along.t) - 1, VIEW_CURVE_POINTS).astype(int))
    at = np.clip([t - width, t, t + width], first, last)
    times = np.unique([*along.t[kept], *at])
    Q = along.Q.values
    low, high = float(Q.min()), float(Q.max())
    mark = np.where(np.abs(times - t) < width / 2, high, low)
    return (times, *(np.interp(times, along.t, of_joint) for of_joint in Q.T), mark)


def series_of(robot: Engine) -> tuple[Any, ...]:
    """The looks of the curves of `curves_of`."""
    from viser import uplot

    joints = [
        uplot.Series(label=escape_text(shorten(name)), stroke=COLOURS[j % len(COLOURS)], width=2)
        for j, name in enumerate(robot.joint_names)
    ]
    return (uplot.Series(label="t [s]"), *joints, uplot.Series(label="now", stroke="#888888", width=1))


def table_of(robot: Engine, now: ShownState) -> str:
    """Q, its limits and the base wrench as a table of HTML; names of files are text there."""
    bounds = coordinate_limits(robot.mechanism).bounds("effort")
    rows = []
    for j, (name, unit) in enumerate(zip(robot.joint_names, coordinate_units(robot.mechanism), strict=True)):
        Q, (lower, upper) = float(now.Q[j]), bounds[:, j]
        beyond = " <b>beyond its limit</b>" if not lower <= Q <= upper else ""
        rows.append((escape_html(shorten(name)), f"{Q:.4g} {derivative_unit('Q', 0, unit)}{beyond}"))
    moment, force = (", ".join(f"{x:.4g}" for x in part) for part in (now.F[:3], now.F[3:]))
    rows += [("base force", f"({force}) N"), ("base moment", f"({moment}) N m")]
    body = "".join(f"<tr><td>{name}</td><td>{value}</td></tr>" for name, value in rows)
    return f"<table style='font-size: .8rem; margin: 0 1rem'>{body}</table>"


def legend_of(scene: Scene) -> str:
    """What the arrows are, and what is not drawn."""
    words = "Orange: the force of the ground on the robot, and the loads on its bodies. Blue: the moment of the ground."
    zmp = ["Blue ball: the zero-moment point, at the mean height of the contacts."] if "zmp" in scene.arrows else []
    return "<br>".join(map(escape_html, [words, *zmp, *scene.notes]))


def escape_html(given: str) -> str:
    """A text of a file as HTML."""
    return escape(escape_text(given))
