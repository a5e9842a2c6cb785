"""Draws a motion and its limits: ratios over time, speed along the path.

`draw_limit_ratios` has one panel per kind of limit and one curve per joint; the limit is a line at 1. `draw_path_speed`
shows the speeds along the path that limits allow, and those of the given and the retimed motion.
"""

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
from jounce.model.limits import LIMIT_KINDS, Limits, no_limits
from jounce.motion.channel import Channel

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from jounce.limits.retime import Retiming
    from jounce.motion import Motion


RATIO_LIMIT_STYLE = {"color": "#b00020", "linewidth": 0.9, "linestyle": "solid", "zorder": 0.8}
MAX_RATIO_DRAWN = 50.0  # a larger ratio is cut there: the other curves would be flat


def draw_limit_ratios(robot: Engine, motion: "Motion") -> "Figure":
    """Draw the ratios to limits along a motion, one panel per kind.

    Values above the line at 1 break their limit.
    """
    ratios = find_ratios(robot, motion)

    def paint(figure: "Figure") -> None:
        grid = figure.subplots(len(ratios), 1, sharex=True, squeeze=False)[:, 0]
        bounded: dict[str, Style] = {}
        for axes, channel in zip(grid, ratios, strict=True):
            for j, (joint, column) in enumerate(zip(channel.names, channel.values.T, strict=True)):
                # Joints without such a limit have no curve; unknown ratios are gaps that thinning must not see.
                if np.isfinite(column).any():
                    known = np.flatnonzero(~np.isnan(column))
                    shown = known[thin_points(column[known])]
                    axes.plot(channel.times[shown], column[shown].clip(None, MAX_RATIO_DRAWN), **canvas.line_style(j))
                    bounded[joint] = canvas.line_style(j)
            axes.axhline(1, **RATIO_LIMIT_STYLE)
            # The area above the line is where limits are broken.
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
    """Return the ratios of each kind of limit along a motion.

    Times hold breaks twice. Ratios are NaN where they are not known well, and -inf where a joint has no such limit. The
    joints are all joints with limits, including those that follow in loops.
    """
    # Each piece of the motion between breaks gives the ratios at its start, middle and end: (pieces, 3, joints).
    b = validate_limits(robot, motion)
    times: list[np.ndarray] = []
    ratios_by_kind: dict[str, list[np.ndarray]] = {kind: [] for kind in b.kinds}
    for pieces in split_motion(b):
        times.append(np.column_stack([pieces.start, (pieces.start + pieces.stop) / 2, pieces.stop]).ravel())
        for kind in set(b.kinds) - set(pieces.kinds):
            ratios_by_kind[kind].append(np.full((3 * len(pieces.start), len(b.names(kind))), np.nan))
        for kind in pieces.kinds:
            left, right = pieces.left[kind], pieces.right[kind]
            middle = evaluate_polynomials(pieces.polynomials[kind], np.array(0.5)) if pieces.width.all() else left
            values = np.stack([left, middle, right], axis=1).reshape(-1, len(b.names(kind)))
            ratios_by_kind[kind].append(b.scales[kind].largest(values))
    t = np.concatenate(times)
    # The columns of positions are those of their joints; a sum over all joints is of the robot.
    names = {kind: b.names(kind) if LIMIT_KINDS[kind].is_total else tuple(b.joints) for kind in b.kinds}
    return [
        Channel(kind, names[kind], ("1",) * len(names[kind]), t, (np.concatenate(parts),))
        for kind, parts in ratios_by_kind.items()
    ]


PATH_POINTS = 801  # at even sigma: more than a picture has pixels across
SPEEDS_PER_POINT = 400  # tried over four decades: steps of 2.3 %, less than the line is wide
AXES_HEIGHT_PER_SPEED = 1.6  # over the largest speed: room for the limits above it
MIN_SPEED_SHARE = 1e-3  # of the largest speed: lower ones are on the axis of a picture
CURVE: Any = {"linewidth": 1.0, "linestyle": (0, (5, 2))}


def draw_path_speed(robot: Engine, motion: "Motion", retiming: "Retiming") -> "Figure":
    """Draw the speed along the path over the distance on it.

    Curves show the given and the retimed motion, and the limits. The curve of efforts and accelerations is the maximum
    velocity curve: above it no acceleration along the path keeps all these limits. Torque rates have no curve.
    """
    # At pace 1 the speed is |dq/dsigma|, and the distance its integral. Other speeds are this one times their pace.
    sigma = np.linspace(motion.start, motion.stop, PATH_POINTS)
    path = path_terms.sample_path(without_friction(robot), motion, sigma, 0)
    original_speed = np.linalg.norm(path.q[1], axis=1)
    distance = np.concatenate([[0.0], np.cumsum((original_speed[1:] + original_speed[:-1]) / 2 * np.diff(sigma))])
    retimed_pace = np.sqrt(retiming.law.x(sigma))
    speed = original_speed * retimed_pace
    top = AXES_HEIGHT_PER_SPEED * float(speed.max())
    deciding_limits = {stretch.limit for stretch in retiming.binding}
    colours = {kind: canvas.COLOURS[i % len(canvas.COLOURS)] for i, kind in enumerate(LIMIT_KINDS)}
    t = retiming.law.times(sigma)

    def paint(figure: "Figure") -> None:
        axes = figure.subplots()
        axes.plot(distance, speed, color=canvas.PALE, linewidth=1.5)
        entries: dict[str, Style] = {"as given": {"color": canvas.PALE, "linestyle": ":", "linewidth": 1.2}}
        axes.plot(distance, original_speed, **entries["as given"])
        for name, curve in _curves(robot, path, retimed_pace).items():
            style = CURVE | {"color": colours["velocity" if name == "velocity limits" else "effort"]}
            # Where the path does not move, any pace is allowed.
            with np.errstate(invalid="ignore"):
                height = original_speed * curve
            axes.plot(distance, np.where(height < 4 * top, height, np.nan), **style)
            entries[name] = style
        # Each stretch of the retimed curve has the colour of the limit that decides there.
        for stretch in retiming.binding:
            inside = (t >= stretch.start) & (t <= stretch.stop)
            axes.plot(distance[inside], speed[inside], color=colours[stretch.limit], linewidth=2.4)
        entries |= {
            f"retimed, at {k.replace('_', ' ')} limit": {"color": colours[k], "linewidth": 2.4}
            for k in LIMIT_KINDS
            if k in deciding_limits
        }
        axes.set_ylim(0, top)
        axes.set_xlim(0, distance[-1])
        axes.set_xlabel("distance along the path [rad or m]")
        axes.set_ylabel("speed along the path [rad/s or m/s]")
        canvas.legend_above(figure, entries)

    return canvas.painted(paint, 7.2, 4.0)


def _curves(robot: Engine, path: path_terms.Path, reached_paces: np.ndarray) -> dict[str, np.ndarray]:
    """Return the largest paces (N,) that limits along a path allow.

    One curve is that of velocity limits. The other one, of limits of effort and acceleration, is the maximum velocity
    curve of Bobrow, Dubowsky & Gibson (1985). At a pace, each limit allows an interval of accelerations along the path,
    ``lower <= a sigma'' + rest <= upper``; the pace is possible where these intervals meet. Paces are tried in rising
    order, and the last pace before the first impossible one is taken: islands of possible paces above it are not drawn.
    The error is the ratio of neighbouring tries.
    """
    limits = joint_limits(robot.mechanism)
    drawn_rows = [
        [*LIMIT_KINDS].index(kind) for kind in ("velocity", "effort", "acceleration", *LIMIT_KINDS.stall_line)
    ]
    table = no_limits(limits.table.shape[-1]).table
    table[drawn_rows] = limits.table[drawn_rows]
    # Only these limits have curves.
    drawn_limits = Limits(table, limits.without_gravity)
    rows = build_rows(path, drawn_limits, 1.0, MAX_UNIFORM_SPEED, acting_friction(robot.mechanism))
    curves = {}
    if np.isfinite(limits.bounds("velocity")).any():
        curves["velocity limits"] = rows.factors[:, 0, rows.used == path_terms.S1_2].ravel() ** -0.5
    acceleration_rows = [i for i, kind in enumerate(rows.kinds) if kind in ("effort", "acceleration", "stall_effort")]
    if len(acceleration_rows) == 0:
        return curves
    lower, upper = rows.lower[acceleration_rows], rows.upper[acceleration_rows]
    # The intervals (tries, N, limits) of accelerations; where a is 0, a limit allows all or none.
    tries = reached_paces.max() * np.geomspace(MIN_SPEED_SHARE, 10, SPEEDS_PER_POINT)
    rest = np.stack([rows.uniform(speed)[:, acceleration_rows] for speed in tries])
    a = rows.factors[:, acceleration_rows] @ (rows.used == path_terms.S2)
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = np.stack([(lower - rest) / a, (upper - rest) / a])
    lowest_acceleration = np.where(
        a == 0, np.where((rest >= lower) & (rest <= upper), -np.inf, np.inf), ends.min(axis=0)
    ).max(axis=2)
    highest_acceleration = np.where(a == 0, np.inf, ends.max(axis=0)).min(axis=2)
    # The last pace, point by point, below which all intervals meet.
    possible = np.logical_and.accumulate(lowest_acceleration <= highest_acceleration, axis=0)
    curves["effort and acceleration limits"] = np.where(
        possible.all(axis=0), np.inf, tries[(possible.sum(axis=0) - 1).clip(0)]
    )
    return curves
