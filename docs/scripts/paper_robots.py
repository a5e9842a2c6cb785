"""The robots of Müller & Kumar, Section 6, drawn for README and pages: run it, and both stand among the pictures."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

import jounce
from jounce.figures import canvas
from jounce.figures.drawing import LABEL_GREY, View, arrow, draw, place_labels, write_label

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PICTURES = Path(__file__).parents[1] / "pictures"
PLANAR_POSE = np.radians([28.0, 37.0])  # in which all can be seen
IIWA_POSE = np.array([0, -0.2, 0, 0.45, 0, 0.55, 0])  # rad, a little bent, so that its axes can be told apart


def planar2r() -> "Figure":
    """The 2R robot seen along its joint axes: q1, q2, L1, L2, m1, m2 and the direction of gravity."""
    robot, view, q = jounce.load("planar2r"), View(-90, 90), PLANAR_POSE

    def paint(figure: "Figure") -> None:
        axes = figure.subplots()
        bones = draw(axes, robot.mechanism, robot.poses(q), view)
        base, elbow = view.of(bones.joints)
        tip = view.of(bones.coms[1])
        for i, (start, end) in enumerate(((base, elbow), (elbow, tip)), 1):
            heading = float(q[:i].sum())
            _angle(axes, start, heading - q[i - 1], q[i - 1], f"$q_{i}$")
            across = 12 * np.array([-np.sin(heading), np.cos(heading)])
            write_label(axes, f"$L_{i}$", (start + end) / 2, across)
            write_label(axes, f"$m_{i}$", end, (15, -5))
        top = np.array([-0.25, 1.35])
        arrow(axes, top, top - [0, 0.25])
        write_label(axes, "$g$", top - [0, 0.12], (9, 0))
        place_labels(figure, axes)

    return canvas.painted(paint, 5.2, 5.2)


def iiwa14() -> "Figure":
    """The iiwa with its frames, joint axes and centres of mass."""
    robot = jounce.load("iiwa14")

    def paint(figure: "Figure") -> None:
        axes = figure.subplots()
        draw(axes, robot.mechanism, robot.poses(IIWA_POSE), View(-55, 18))
        place_labels(figure, axes)

    return canvas.painted(paint, 6, 6)


def _angle(axes: "Axes", at: np.ndarray, start: float, turned: float, label: str) -> None:
    """An arc from the direction in which an angle is zero."""
    ray = np.array([np.cos(start), np.sin(start)])
    axes.plot(*np.stack([at, at + 0.5 * ray]).T, color=LABEL_GREY, linewidth=0.8, linestyle="--", zorder=0.5)
    along = start + np.linspace(0, turned, 40)
    axes.plot(*(at[:, None] + 0.36 * np.stack([np.cos(along), np.sin(along)])), color=canvas.INK, linewidth=0.9)
    middle = start + turned / 2
    outward = np.array([np.cos(middle), np.sin(middle)])
    write_label(axes, label, at + 0.36 * outward, 9 * outward)


if __name__ == "__main__":
    for picture in (planar2r, iiwa14):
        canvas.save(picture(), PICTURES / f"{picture.__name__}.svg")
