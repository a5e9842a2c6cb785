"""Draws what limits make of a motion: ratios over time, and speed along the path.

`draw_limit_ratios` has one panel per kind of limit and one curve per joint; the limit is a line at 1. `draw_path_speed`
shows over the path what limits allow, and what time laws make of it.
"""

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from jounce.engine.engine import Engine
from jounce.figures import canvas
from jounce.figures.canvas import Style
from jounce.figures.panels import thin_points
from jounce.limits import path_terms
from jounce.limits.drive_terms import acting_friction
from jounce.limits.joints import joint_limits
from jounce.limits.limited_motion import validate_limits
from jounce.limits.motion_polynomials import evaluate_polynomials, split_motion
from jounce.limits.retime_problem import MAX_UNIFORM_SPEED, build_rows, without_friction
from jounce.model.limits import LIMIT_KINDS, no_limits
from jounce.motion.channel import Channel

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from jounce.limits.retime import Retiming
    from jounce.motion import Motion


RATIO_LIMIT_STYLE = {"color": "#b00020", "linewidth": 0.9, "linestyle": "solid", "zorder": 0.8}
MAX_RATIO_DRAWN = 50.0  # a larger ratio is cut there: the other curves would be flat


def draw_limit_ratios(robot: Engine, motion: "Motion") -> "Figure":
    """Panels of the ratios by kind of limit along a motion; what is above the line breaks its limit."""
    ratios = find_ratios(robot, motion)

    def paint(figure: "Figure") -> None:
        grid = figure.subplots(len(ratios), 1, sharex=True, squeeze=False)[:, 0]
        bounded: dict[str, Style] = {}
        for axes, channel in zip(grid, ratios, strict=True):
            for j, (joint, column) in enumerate(zip(channel.names, channel.values.T, strict=True)):
                if np.isfinite(column).any():
                    known = np.flatnonzero(~np.isnan(column))
                    shown = known[thin_points(column[known])]
                    axes.plot(channel.times[shown], column[shown].clip(None, MAX_RATIO_DRAWN), **canvas.line_style(j))
                    bounded[joint] = canvas.line_style(j)
            axes.axhline(1, **RATIO_LIMIT_STYLE)
            axes.axhspan(
                1, max(1.05, axes.get_ylim()[1]), color=RATIO_LIMIT_STYLE["color"], alpha=0.07, linewidth=0, zorder=0.1
            )
            axes.set_ylabel(f"{channel.symbol.replace('_', ' ')}\n/ limit")
            axes.margins(x=0.01, y=0)
        grid[-1].set_xlabel("t [s]")
        figure.align_ylabels(grid)
        canvas.legend_above(figure, bounded | {"limit": RATIO_LIMIT_STYLE})

    return canvas.painted(paint, 7.2, 0.7 + 1.6 * len(ratios))


def find_ratios(robot: Engine, motion: "Motion") -> list[Channel]:
    """The ratios of each kind of limit, as far as each is known well, or else NaN, at times that hold breaks twice.

    They are -inf where a joint has no such limit; the joints are all that have limits, those that follow in loops too.
    """
    b = validate_limits(robot, motion)
    times: list[np.ndarray] = []
    found: dict[str, list[np.ndarray]] = {kind: [] for kind in b.kinds}
    for pieces in split_motion(b):
        times.append(np.column_stack([pieces.start, (pieces.start + pieces.stop) / 2, pieces.stop]).ravel())
        for kind in set(b.kinds) - set(pieces.kinds):
            found[kind].append(np.full((3 * len(pieces.start), len(b.joints)), np.nan))
        for kind in pieces.kinds:
            left, right = pieces.left[kind], pieces.right[kind]
            middle = evaluate_polynomials(pieces.polynomials[kind], np.array(0.5)) if pieces.width.all() else left
            values = np.stack([left, middle, right], axis=1).reshape(-1, len(b.joints))
            found[kind].append(b.scales[kind].largest(values))
    t, units = np.concatenate(times), ("1",) * len(b.joints)
    return [Channel(kind, tuple(b.joints), units, t, (np.concatenate(parts),)) for kind, parts in found.items()]


PATH_POINTS = 801  # at even sigma: more than a picture has pixels across
SPEEDS_PER_POINT = 400  # tried over four decades: steps of 2.3 %, less than the line is wide
AXES_HEIGHT_PER_SPEED = 1.6  # over the largest speed: room for the limits above it
MIN_SPEED_SHARE = 1e-3  # of the largest speed: lower ones are on the axis of a picture
CURVE: Any = {"linewidth": 1.0, "linestyle": (0, (5, 2))}


def draw_path_speed(robot: Engine, motion: "Motion", found: "Retiming") -> "Figure":
    """The speed along the path over the distance on it: given, retimed, and the curves of the limits.

    The curve of efforts and accelerations is the maximum velocity curve: above it no acceleration along the path meets
    all of them. Torque rates have no curve of their own.
    """
    sigma = np.linspace(motion.start, motion.stop, PATH_POINTS)
    path = path_terms.sample_path(without_friction(robot), motion, sigma, 0)
    unit = np.linalg.norm(path.q[1], axis=1)
    way = np.concatenate([[0.0], np.cumsum((unit[1:] + unit[:-1]) / 2 * np.diff(sigma))])
    pace_found = np.sqrt(found.law.x(sigma))
    speed = unit * pace_found
    top = AXES_HEIGHT_PER_SPEED * float(speed.max())
    decided = {stretch.limit for stretch in found.binding}
    colours = {kind: canvas.COLOURS[i % len(canvas.COLOURS)] for i, kind in enumerate(LIMIT_KINDS)}
    t = found.law.times(sigma)

    def paint(figure: "Figure") -> None:
        axes = figure.subplots()
        axes.plot(way, speed, color=canvas.PALE, linewidth=1.5)
        entries: dict[str, Style] = {"as given": {"color": canvas.PALE, "linestyle": ":", "linewidth": 1.2}}
        axes.plot(way, unit, **entries["as given"])
        for name, curve in _curves(robot, path, pace_found).items():
            style = CURVE | {"color": colours["velocity" if name == "velocity limits" else "effort"]}
            with np.errstate(invalid="ignore"):  # at rest any pace will do
                height = unit * curve
            axes.plot(way, np.where(height < 4 * top, height, np.nan), **style)
            entries[name] = style
        for stretch in found.binding:
            inside = (t >= stretch.start) & (t <= stretch.stop)
            axes.plot(way[inside], speed[inside], color=colours[stretch.limit], linewidth=2.4)
        entries |= {
            f"retimed, at {k.replace('_', ' ')} limit": {"color": colours[k], "linewidth": 2.4}
            for k in LIMIT_KINDS
            if k in decided
        }
        axes.set_ylim(0, top)
        axes.set_xlim(0, way[-1])
        axes.set_xlabel("distance along the path [rad or m]")
        axes.set_ylabel("speed along the path [rad/s or m/s]")
        canvas.legend_above(figure, entries)

    return canvas.painted(paint, 7.2, 4.0)


def _curves(robot: Engine, path: path_terms.Path, reached: np.ndarray) -> dict[str, np.ndarray]:
    """The largest paces (N,) along a path that limits of velocity, and of effort and acceleration, allow.

    The second is the maximum velocity curve of Bobrow, Dubowsky & Gibson (1985). At a pace, each limit allows an
    interval of accelerations along the path, ``lower <= a sigma'' + rest <= upper``; the pace is possible where these
    intervals meet. Paces are tried in rising order, and the last before the first impossible one is taken: islands of
    possible paces above it are not drawn. Its error is the ratio of neighbouring tries.
    """
    limits = joint_limits(robot.mechanism)
    drawn = [[*LIMIT_KINDS].index(kind) for kind in ("velocity", "effort", "acceleration", *LIMIT_KINDS.stall_line)]
    table = no_limits(limits.table.shape[-1]).table
    table[drawn] = limits.table[drawn]
    rows, found = (
        build_rows(path, replace(limits, table=table), 1.0, MAX_UNIFORM_SPEED, acting_friction(robot.mechanism)),
        {},
    )
    if np.isfinite(limits.bounds("velocity")).any():
        found["velocity limits"] = rows.factors[:, 0, rows.used == path_terms.S1_2].ravel() ** -0.5
    first = [i for i, kind in enumerate(rows.kinds) if kind in ("effort", "acceleration", "stall_effort")]
    if not first:
        return found
    lower, upper = rows.lower[first], rows.upper[first]
    # the intervals (tries, N, limits) of accelerations; where a is 0, a limit allows all or none
    tries = reached.max() * np.geomspace(MIN_SPEED_SHARE, 10, SPEEDS_PER_POINT)
    rest = np.stack([rows.uniform(speed)[:, first] for speed in tries])
    a = rows.factors[:, first] @ (rows.used == path_terms.S2)
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = np.stack([(lower - rest) / a, (upper - rest) / a])
    least = np.where(a == 0, np.where((rest >= lower) & (rest <= upper), -np.inf, np.inf), ends.min(axis=0)).max(axis=2)
    most = np.where(a == 0, np.inf, ends.max(axis=0)).min(axis=2)
    # the last pace, point by point, below which all intervals meet
    possible = np.logical_and.accumulate(least <= most, axis=0)
    found["effort and acceleration limits"] = np.where(
        possible.all(axis=0), np.inf, tries[(possible.sum(axis=0) - 1).clip(0)]
    )
    return found
