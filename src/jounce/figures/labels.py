"""Labels of a drawing, placed where they cover neither each other nor what is drawn.

A greedy search over fixed candidates (J. Christensen, J. Marks, S. Shieber, An empirical study of algorithms for
point-feature label placement, 1995): each label in turn takes the place of least cost, given those before it, and no
label moves again. It always ends; where all places are covered, the one that covers least is taken.
"""

from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from jounce.core.scalars import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.text import Annotation

LABEL = "label"  # the gid of texts that may be moved
LABEL_TURNS = np.radians(
    [0, 30, -30, 60, -60, 90, -90, 120, -120, 150, -150, 180]
)  # from where a label would stand best
LABEL_DISTANCES = (1.0, 1.4, 1.8, 2.4)
LABEL_GAP = 1.5  # points of free paper around a label
MIN_WIDE_LINE = 3.0  # points: of a wider line labels avoid both edges
OUTLINE_SPACING = 2.0  # points between those of an outline: less than a label is high
# Per label covered, per point of an outline covered, and of the move: each outweighs many of the next.
COST_ON_LABEL, COST_ON_LINE, COST_MOVED = 1000.0, 10.0, 1.0


def write_label(axes: "Axes", text: str, at: Array, offset: Array = (0, 0), **style: Any) -> None:
    """Write a label, in points from a place of the drawing; what lies beneath does not cross it."""
    from matplotlib.patheffects import withStroke

    halo = [withStroke(linewidth=2, foreground="white")]
    middle: Any = {"ha": "center", "va": "center", "path_effects": halo, "zorder": 6, "gid": LABEL}
    axes.annotate(text, at, tuple(offset), textcoords="offset points", **middle, **style)


def place_labels(figure: "Figure", axes: "Axes") -> None:
    """Move the labels, the shortest way, from where they cover each other, lines, arrows or discs.

    The layout is kept from then on: what is free of others on the page depends on it.
    """
    figure.draw_without_rendering()
    figure.set_layout_engine("none")
    scale = figure.dpi / 72
    labels: list[Annotation] = [text for text in axes.texts if text.get_gid() == LABEL]  # type: ignore[misc]
    drawn, taken = outline_points(axes), np.empty((0, 4))
    for label in labels:
        # the cost of every candidate: labels and outlines that its box covers, and how far it is from the best place
        best = np.array(label.xyann)
        box = label.get_window_extent().padded(LABEL_GAP * scale)
        here = np.array([*box.min, *box.max])
        costs = []
        for further in LABEL_DISTANCES:
            for turn in LABEL_TURNS:
                offset = further * best @ np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
                moved = here + np.tile((offset - best) * scale, 2)
                crossed = ((moved[2:] > taken[:, :2]) & (moved[:2] < taken[:, 2:])).all(axis=1).sum()
                covered = ((drawn > moved[:2]) & (drawn < moved[2:])).all(axis=1).sum()
                away = COST_MOVED * (further - 1 + abs(turn) / np.pi)
                costs.append((COST_ON_LABEL * crossed + COST_ON_LINE * covered + away, offset, moved))
        # the first of the cheapest is kept, and its box is taken from now on
        _, offset, place = min(costs, key=lambda cost: cost[0])
        label.xyann = tuple(offset)
        taken = np.vstack([taken, place])


def outline_points(axes: "Axes") -> np.ndarray:
    """Points on the page, close together, of the outlines of all lines, marks, arrows and discs of the axes."""
    points = axes.figure.dpi / 72
    paths = [patch.get_transform().transform_path(patch.get_path()) for patch in axes.patches]
    arrows = [arrow for text in axes.texts if (arrow := getattr(text, "arrow_patch", None))]
    paths += [arrow.get_transform().transform_path(arrow.get_path()) for arrow in arrows]
    outlines: list[Any] = [outline for path in paths for outline in path.to_polygons(closed_only=False)]
    circle = np.linspace(0, 2 * np.pi, 25)
    for line in axes.lines:
        run = axes.transData.transform(line.get_xydata())
        if line.get_marker() in ("o", "."):
            radius = line.get_markersize() / 2 * points
            outlines += [at + radius * np.stack([np.cos(circle), np.sin(circle)], axis=-1) for at in run]
        elif line.get_linewidth() > MIN_WIDE_LINE:
            x, y = run[-1] - run[0]
            across = line.get_linewidth() / 2 * points * np.array([-y, x]) / (np.hypot(x, y) or 1)
            outlines += [run + across, run - across]
        else:
            outlines.append(run)
    found = [np.empty((0, 2))]
    for outline in outlines:
        for start, end in pairwise(outline):
            count = 2 + int(np.linalg.norm(end - start) / (OUTLINE_SPACING * points))
            found.append(start + np.linspace(0, 1, count)[:, None] * (end - start))
    return np.concatenate(found)
