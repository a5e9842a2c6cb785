"""Draws a robot: links, joint axes, body frames and centres of mass, projected on the page.

`draw` paints into given axes, and writes labels as it goes; `place_labels` then moves them to where they cover neither
each other nor what is drawn. If frames share an origin, as in a spherical wrist, they are drawn next to it, with a
leader line.

Labels are placed by a greedy search over fixed candidates (J. Christensen, J. Marks, S. Shieber, An empirical study of
algorithms for point-feature label placement, 1995): each label in turn takes the place of least cost, given those
before it, and no label moves again. It always ends; where all places are covered, the one that covers least is taken.
"""

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from jounce.core.scalars import Array
from jounce.engine.engine import Engine
from jounce.engine.plan import compute
from jounce.figures import canvas
from jounce.model import positions
from jounce.model.mechanism import Mechanism
from jounce.spatial import inertia

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.text import Annotation


AXIS_COLOURS = {"x": canvas.COLOURS[1], "y": canvas.COLOURS[2], "z": canvas.COLOURS[0]}
LABEL_GREY = "#777777"
MIN_ARROW_SHARE = 0.08  # projected share of an arrow's length: a shorter one points at the reader or away


@dataclass(frozen=True)
class View:
    """The direction from which a reader looks, in degrees: azimuth about z, elevation above the xy plane."""

    azimuth: float
    elevation: float

    def of(self, points: np.ndarray) -> np.ndarray:
        """Points (..., 3) in space as points (..., 2) on the page."""
        a, e = np.radians([self.azimuth, self.elevation])
        right = [-np.sin(a), np.cos(a), 0]
        up = [-np.sin(e) * np.cos(a), -np.sin(e) * np.sin(a), np.cos(e)]
        return points @ np.array([right, up]).T


@dataclass(frozen=True)
class Skeleton:
    """A mechanism in a pose, as points in the inertial frame."""

    poses: np.ndarray  # (nb, 4, 4), without that of a floating base
    joints: np.ndarray  # (nc, 3) the point of each joint's axis nearest to the body's origin
    axes: np.ndarray  # (nc, 3) their directions
    coms: np.ndarray  # (nb, 3), NaN where a body has no mass; without that of a floating base
    links: list[tuple[np.ndarray, np.ndarray]]
    size: float


def poses_on(robot: Engine, q: np.ndarray, C: np.ndarray) -> np.ndarray:
    """The poses (..., nb, 4, 4) of the bodies of a robot whose base, or ground, has the pose C."""
    return np.asarray(compute(robot, "poses", [q], base=C))


def joint_points(mechanism: Mechanism) -> np.ndarray:
    """(nb, 3): the point of the axis that moves each body nearest to the body's origin; this one of a base."""
    points = np.zeros((mechanism.nb, 3))
    points[list(mechanism.owners)] = positions.anchors(mechanism)
    return points


def skeleton(mechanism: Mechanism, poses: np.ndarray) -> Skeleton:
    """The points of a drawing, for the poses of all the bodies."""
    R, r, owners, first = poses[:, :3, :3], poses[:, :3, 3], list(mechanism.owners), mechanism.moving_bodies.start
    xi, eta = mechanism.X[:, :3], mechanism.X[:, 3:]
    axes = np.where(xi.any(axis=1)[:, None], xi, eta)
    m, h, _ = inertia.moments(mechanism.M)
    with np.errstate(invalid="ignore"):
        com = h[..., 0] / m[..., 0]
    points, coms = (r + (R @ x[..., None])[..., 0] for x in (joint_points(mechanism), com))
    moved = list(enumerate(mechanism.parent))[first:]
    loose = positions.loose_bodies(mechanism)
    links = [(points[p] if p >= 0 else np.zeros(3), points[i]) for i, p in moved if i not in loose]
    links += [(points[i], coms[i]) for i in positions.outer_bodies(mechanism) if np.isfinite(coms[i]).all()]
    joints, coms = points[owners], coms[first:]
    size = float(np.ptp(np.concatenate([joints, coms[np.isfinite(coms).all(axis=1)]]), axis=0).max())
    return Skeleton(poses[first:], joints, (R[owners] @ axes[..., None])[..., 0], coms, links, size)


def draw(axes: "Axes", mechanism: Mechanism, poses: np.ndarray, view: View) -> Skeleton:
    """Draw a robot into axes of equal scales: e_i its joint axes, c_i centres of mass, bold numbers its frames."""
    bones = skeleton(mechanism, poses)
    axes.set_aspect("equal")
    axes.axis("off")
    if mechanism.base_body is None:
        _ground(axes, view, np.asarray(mechanism.gravity, dtype=float), bones.size)
    for link in bones.links:
        points = view.of(np.stack(link)).T
        axes.plot(*points, color=canvas.INK, linewidth=9, solid_capstyle="round", zorder=1)
        axes.plot(*points, color="#e4e4e4", linewidth=7, solid_capstyle="round", zorder=1.1)
    several = positions.multiscrew_joints(mechanism)
    for i, (point, direction) in enumerate(zip(bones.joints, bones.axes, strict=True), 1):
        joint = several.get(mechanism.owners[i - 1])
        if joint is None:
            _axis(axes, view, point, direction * 0.13 * bones.size, f"$e_{{{i}}}$")
        elif not joint.group.places:
            axes.plot(*view.of(point), "o", ms=11, mfc="white", mec=canvas.INK, mew=0.9, zorder=3)
    for i, com in enumerate(bones.coms, 1):
        if np.isfinite(com).all():
            _centre_of_mass(axes, view.of(com), 0.016 * bones.size, f"$c_{{{i}}}$")
    _frame(axes, view, np.eye(4), bones.size, -1, "0")
    for together in _group_by_origin(bones.poses, bones.size):
        for place, i in enumerate(together):
            aside = 0 if len(together) == 1 else place + 1
            _frame(axes, view, bones.poses[i], bones.size, aside, str(i + 1))
    _legend(axes)
    return bones


def arrow(axes: "Axes", start: Array, end: Array, colour: str = canvas.INK) -> None:
    """An arrow on the page."""
    style = {"arrowstyle": "-|>", "color": colour, "linewidth": 1.4, "shrinkA": 0, "shrinkB": 0, "mutation_scale": 9}
    axes.annotate("", end, start, arrowprops=style, zorder=4)
    axes.update_datalim([start, end])


def _ground(axes: "Axes", view: View, gravity: np.ndarray, size: float) -> None:
    """A slab across the direction of gravity, its top at the origin."""
    from scipy.spatial import ConvexHull

    up = -gravity / np.linalg.norm(gravity) if gravity.any() else np.array([0.0, 0.0, 1.0])
    across = np.linalg.svd(up[None])[2][1:]  # two directions square to it
    corners = np.array([x * across[0] + y * across[1] + z * up for x in (-1, 1) for y in (-1, 1) for z in (-0.25, 0)])
    outline = view.of(0.13 * size * corners)
    outline = outline[ConvexHull(outline).vertices]
    axes.fill(*outline.T, facecolor="#f2f2f2", edgecolor=canvas.PALE, linewidth=0.8, hatch="////", zorder=0)


def _axis(axes: "Axes", view: View, point: np.ndarray, half: np.ndarray, label: str) -> None:
    start, end = view.of(np.stack([point - half, point + half]))
    axes.plot(*np.stack([start, end]).T, color=LABEL_GREY, linewidth=0.9, dashes=(9, 2, 2, 2), zorder=2)
    axes.plot(*view.of(point), "o", ms=5, mfc="white", mec=canvas.INK, mew=0.9, zorder=3)
    along = end - start
    if np.linalg.norm(along) > MIN_ARROW_SHARE * np.linalg.norm(half):
        write_label(axes, label, end, 9 * along / np.linalg.norm(along), color=LABEL_GREY)


def _centre_of_mass(axes: "Axes", at: np.ndarray, radius: float, label: str) -> None:
    """Draw the usual symbol of a centre of mass, a quartered disc."""
    from matplotlib.patches import Circle, Wedge

    axes.add_patch(Circle(tuple(at), radius, facecolor="white", edgecolor=canvas.INK, linewidth=0.8, zorder=5))
    for start in (0, 180):
        axes.add_patch(Wedge(tuple(at), radius, start, start + 90, facecolor=canvas.INK, linewidth=0, zorder=5.1))
    write_label(axes, label, at, (-12, 5))


def _frame(axes: "Axes", view: View, pose: np.ndarray, size: float, aside: int, label: str) -> None:
    """Draw the axes of a frame at its origin, or offset from it by a number of places."""
    origin, length = view.of(pose[:3, 3]), 0.1 * size
    if aside:
        place = origin + np.array([(np.sign(aside) * 0.1 + 0.2 * aside) * size, 0])
        axes.plot(*np.stack([origin, place]).T, color=canvas.PALE, linewidth=0.8, linestyle=":", zorder=1.5)
        origin = place
    for (name, colour), direction in zip(AXIS_COLOURS.items(), pose[:3, :3].T, strict=True):
        tip = view.of(direction) * length
        if np.linalg.norm(tip) > MIN_ARROW_SHARE * length:
            arrow(axes, origin, origin + tip, colour)
            write_label(axes, name, origin + tip, 6 * tip / np.linalg.norm(tip), color=colour, fontsize=7)
        else:
            axes.plot(*origin, "o", ms=13, mfc="none", mec=colour, mew=1.2, zorder=5)
            axes.plot(*origin, ".", ms=3, color=colour, zorder=4)
    write_label(axes, label, origin, (-7, -9), fontweight="bold")


def _group_by_origin(poses: np.ndarray, size: float) -> list[list[int]]:
    groups: list[list[int]] = []
    for i, r in enumerate(poses[:, :3, 3]):
        near = [group for group in groups if np.linalg.norm(poses[group[0], :3, 3] - r) < 1e-6 * size]
        near[0].append(i) if near else groups.append([i])
    return groups


def _legend(axes: "Axes") -> None:
    from matplotlib.lines import Line2D

    marks = [Line2D([], [], color=colour, label=name) for name, colour in AXIS_COLOURS.items()]
    marks += [
        Line2D([], [], marker="$\\mathbf{1}$", color=canvas.INK, linestyle="none", label="frame of body 1"),
        Line2D([], [], color=LABEL_GREY, linewidth=0.9, dashes=(9, 2, 2, 2), label="joint axis $e_i$"),
        Line2D(
            [],
            [],
            marker="o",
            fillstyle="left",
            mfc=canvas.INK,
            mec=canvas.INK,
            linestyle="none",
            label="centre of mass $c_i$",
        ),
    ]
    axes.legend(handles=marks, loc="upper center", bbox_to_anchor=(0.5, 0), ncols=3, fontsize=8, handlelength=2.4)


# Labels: written where they would stand best, then moved.
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
