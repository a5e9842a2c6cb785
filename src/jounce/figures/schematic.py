"""The planar 2R robot of Müller & Kumar, Section 6.1: a drawing with its angles, lengths and masses."""

from typing import TYPE_CHECKING

import numpy as np

from jounce.engine.dispatch import compute
from jounce.engine.engine import Engine
from jounce.figures.canvas import INK, painted
from jounce.figures.drawing import GREY, View, arrow, draw
from jounce.figures.labels import place_labels, write
from jounce.io.bundled import planar2r

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Q = np.radians([28.0, 37.0])  # a pose in which all can be seen


def schematic() -> "Figure":
    """The 2R robot seen along its joint axes: q1, q2, L1, L2, m1, m2 and the direction of gravity."""
    robot, view = Engine(planar2r()), View(-90, 90)

    def paint(figure: "Figure") -> None:
        axes = figure.subplots()
        bones = draw(axes, robot.mechanism, compute(robot, "poses", [Q]), view)
        base, elbow = view.of(bones.joints)
        tip = view.of(bones.coms[1])
        for i, (start, end) in enumerate(((base, elbow), (elbow, tip)), 1):
            heading = float(Q[:i].sum())
            _angle(axes, start, heading - Q[i - 1], Q[i - 1], f"$q_{i}$")
            across = 12 * np.array([-np.sin(heading), np.cos(heading)])
            write(axes, f"$L_{i}$", (start + end) / 2, across)
            write(axes, f"$m_{i}$", end, (15, -5))
        top = np.array([-0.25, 1.35])
        arrow(axes, top, top - [0, 0.25])
        write(axes, "$g$", top - [0, 0.12], (9, 0))
        place_labels(figure, axes)

    return painted(paint, 5.2, 5.2)


def _angle(axes: "Axes", at: np.ndarray, start: float, turned: float, label: str) -> None:
    """An arc from the direction in which an angle is zero."""
    ray = np.array([np.cos(start), np.sin(start)])
    axes.plot(*np.stack([at, at + 0.5 * ray]).T, color=GREY, linewidth=0.8, linestyle="--", zorder=0.5)
    along = start + np.linspace(0, turned, 40)
    axes.plot(*(at[:, None] + 0.36 * np.stack([np.cos(along), np.sin(along)])), color=INK, linewidth=0.9)
    middle = start + turned / 2
    outward = np.array([np.cos(middle), np.sin(middle)])
    write(axes, label, at + 0.36 * outward, 9 * outward)
