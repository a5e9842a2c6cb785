"""Draws a robot: links, joint axes, body frames and centres of mass.

They are projected on the page. `draw` draws into given axes, and writes labels at their best places; `place_labels`
then moves labels that cover each other or the drawing. If frames share an origin, as in a spherical wrist, they are
drawn next to it, with a leader line.

Labels are placed by a greedy search over fixed candidates (J. Christensen, J. Marks, S. Shieber, An empirical study of
algorithms for point-feature label placement, 1995): each label in turn takes the place of least cost, given the labels
before it, and does not move again. The search always ends; if all places are covered, it takes the least covered one.
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
    """The direction of view in degrees.

    Azimuth is about z, elevation above the xy plane.
    """

    azimuth: float
    elevation: float

    def of(self, points: np.ndarray) -> np.ndarray:
        """Project points (..., 3) in space onto the page, (..., 2)."""
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
    """Return the poses (..., nb, 4, 4) of all bodies for a base pose.

    C is the pose of a floating base or of the ground.
    """
    return np.asarray(compute(robot, "poses", [q], base=C))


def joint_points(mechanism: Mechanism) -> np.ndarray:
    """Return the points (nb, 3) of joint axes nearest to body origins.

    Each is in the frame of the body that the joint moves; the point of a base is its origin.
    """
    points = np.zeros((mechanism.nb, 3))
    points[list(mechanism.owners)] = positions.anchors(mechanism)
    return points


def skeleton(mechanism: Mechanism, poses: np.ndarray) -> Skeleton:
    """Return the points of a drawing, for poses of all bodies."""
    R, r, owners, first_moving = (
        poses[:, :3, :3],
        poses[:, :3, 3],
        list(mechanism.owners),
        mechanism.moving_bodies.start,
    )
    xi, eta = mechanism.X[:, :3], mechanism.X[:, 3:]
    axes = np.where(xi.any(axis=1)[:, None], xi, eta)
    m, h, _ = inertia.moments(mechanism.M)
    # Massless bodies have no centre of mass, NaN.
    with np.errstate(invalid="ignore"):
        com = h[..., 0] / m[..., 0]
    points, coms = (r + (R @ x[..., None])[..., 0] for x in (joint_points(mechanism), com))
    # Links run from the joint of the parent to that of the body, and on outer bodies to the centre of mass.
    moving = list(enumerate(mechanism.parent))[first_moving:]
    loose = positions.loose_bodies(mechanism)
    links = [(points[p] if p >= 0 else np.zeros(3), points[i]) for i, p in moving if i not in loose]
    links += [(points[i], coms[i]) for i in positions.outer_bodies(mechanism) if np.isfinite(coms[i]).all()]
    joints, coms = points[owners], coms[first_moving:]
    size = float(np.ptp(np.concatenate([joints, coms[np.isfinite(coms).all(axis=1)]]), axis=0).max())
    return Skeleton(poses[first_moving:], joints, (R[owners] @ axes[..., None])[..., 0], coms, links, size)


def draw(axes: "Axes", mechanism: Mechanism, poses: np.ndarray, view: View) -> Skeleton:
    """Draw a robot into axes of equal scales.

    e_i are its joint axes, c_i the centres of mass, bold numbers the frames.
    """
    bones = skeleton(mechanism, poses)
    axes.set_aspect("equal")
    axes.axis("off")
    if mechanism.base_body is None:
        _ground(axes, view, np.asarray(mechanism.gravity, dtype=float), bones.size)
    # A wide dark line beneath a narrower pale one is a link with an edge.
    for link in bones.links:
        points = view.of(np.stack(link)).T
        axes.plot(*points, color=canvas.INK, linewidth=9, solid_capstyle="round", zorder=1)
        axes.plot(*points, color="#e4e4e4", linewidth=7, solid_capstyle="round", zorder=1.1)
    multiscrew = positions.multiscrew_joints(mechanism)
    for i, (point, direction) in enumerate(zip(bones.joints, bones.axes, strict=True), 1):
        # A ball has a disc; planar and free joints have no axes of their own to show.
        joint = multiscrew.get(mechanism.owners[i - 1])
        if joint is None:
            _axis(axes, view, point, direction * 0.13 * bones.size, f"$e_{{{i}}}$")
        elif not joint.group.places:
            axes.plot(*view.of(point), "o", ms=11, mfc="white", mec=canvas.INK, mew=0.9, zorder=3)
    for i, com in enumerate(bones.coms, 1):
        if np.isfinite(com).all():
            _centre_of_mass(axes, view.of(com), 0.016 * bones.size, f"$c_{{{i}}}$")
    _frame(axes, view, np.eye(4), bones.size, -1, "0")
    for group in _group_by_origin(bones.poses, bones.size):
        for place, i in enumerate(group):
            offset = 0 if len(group) == 1 else place + 1
            _frame(axes, view, bones.poses[i], bones.size, offset, str(i + 1))
    _legend(axes)
    return bones


def arrow(axes: "Axes", start: Array, end: Array, colour: str = canvas.INK) -> None:
    """Draw an arrow on the page."""
    style = {"arrowstyle": "-|>", "color": colour, "linewidth": 1.4, "shrinkA": 0, "shrinkB": 0, "mutation_scale": 9}
    axes.annotate("", end, start, arrowprops=style, zorder=4)
    axes.update_datalim([start, end])


def _ground(axes: "Axes", view: View, gravity: np.ndarray, size: float) -> None:
    """Draw a slab across the direction of gravity, below the origin."""
    from scipy.spatial import ConvexHull

    up = -gravity / np.linalg.norm(gravity) if gravity.any() else np.array([0.0, 0.0, 1.0])
    # Two directions perpendicular to gravity.
    ground_axes = np.linalg.svd(up[None])[2][1:]
    corners = np.array(
        [x * ground_axes[0] + y * ground_axes[1] + z * up for x in (-1, 1) for y in (-1, 1) for z in (-0.25, 0)]
    )
    outline = view.of(0.13 * size * corners)
    outline = outline[ConvexHull(outline).vertices]
    axes.fill(*outline.T, facecolor="#f2f2f2", edgecolor=canvas.PALE, linewidth=0.8, hatch="////", zorder=0)


def _axis(axes: "Axes", view: View, point: np.ndarray, half: np.ndarray, label: str) -> None:
    """Draw the axis of a joint, with its arrow and label.

    An axis that points at the reader has none.
    """
    start, end = view.of(np.stack([point - half, point + half]))
    axes.plot(*np.stack([start, end]).T, color=LABEL_GREY, linewidth=0.9, dashes=(9, 2, 2, 2), zorder=2)
    axes.plot(*view.of(point), "o", ms=5, mfc="white", mec=canvas.INK, mew=0.9, zorder=3)
    arrow_vector = end - start
    if np.linalg.norm(arrow_vector) > MIN_ARROW_SHARE * np.linalg.norm(half):
        write_label(axes, label, end, 9 * arrow_vector / np.linalg.norm(arrow_vector), color=LABEL_GREY)


def _centre_of_mass(axes: "Axes", place: np.ndarray, radius: float, label: str) -> None:
    """Draw the usual symbol of a centre of mass, a quartered disc."""
    from matplotlib.patches import Circle, Wedge

    axes.add_patch(Circle(tuple(place), radius, facecolor="white", edgecolor=canvas.INK, linewidth=0.8, zorder=5))
    for start in (0, 180):
        axes.add_patch(Wedge(tuple(place), radius, start, start + 90, facecolor=canvas.INK, linewidth=0, zorder=5.1))
    write_label(axes, label, place, (-12, 5))


def _frame(axes: "Axes", view: View, pose: np.ndarray, size: float, offset: int, label: str) -> None:
    """Draw the axes of a frame at or near its origin.

    `offset` counts the places from the origin.
    """
    origin, length = view.of(pose[:3, 3]), 0.1 * size
    if offset:
        offset_origin = origin + np.array([(np.sign(offset) * 0.1 + 0.2 * offset) * size, 0])
        axes.plot(*np.stack([origin, offset_origin]).T, color=canvas.PALE, linewidth=0.8, linestyle=":", zorder=1.5)
        origin = offset_origin
    for (name, colour), direction in zip(AXIS_COLOURS.items(), pose[:3, :3].T, strict=True):
        tip = view.of(direction) * length
        # An axis that points at the reader or away is a dot in a circle.
        if np.linalg.norm(tip) > MIN_ARROW_SHARE * length:
            arrow(axes, origin, origin + tip, colour)
            write_label(axes, name, origin + tip, 6 * tip / np.linalg.norm(tip), color=colour, fontsize=7)
        else:
            axes.plot(*origin, "o", ms=13, mfc="none", mec=colour, mew=1.2, zorder=5)
            axes.plot(*origin, ".", ms=3, color=colour, zorder=4)
    write_label(axes, label, origin, (-7, -9), fontweight="bold")


def _group_by_origin(poses: np.ndarray, size: float) -> list[list[int]]:
    """Group bodies whose frames share an origin."""
    groups: list[list[int]] = []
    for i, r in enumerate(poses[:, :3, 3]):
        near_groups = [group for group in groups if np.linalg.norm(poses[group[0], :3, 3] - r) < 1e-6 * size]
        if len(near_groups) > 0:
            near_groups[0].append(i)
        else:
            groups.append([i])
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
# Angles of the candidates from the best place of a label.
LABEL_TURNS = np.radians([0, 30, -30, 60, -60, 90, -90, 120, -120, 150, -150, 180])
LABEL_DISTANCES = (1.0, 1.4, 1.8, 2.4)
LABEL_GAP = 1.5  # points of free paper around a label
MIN_WIDE_LINE = 3.0  # points: of a wider line labels avoid both edges
OUTLINE_SPACING = 2.0  # points of paper between those of an outline: less than the height of a label
# Costs per covered label, per covered point of an outline, and of the move: each outweighs many of the next.
COST_ON_LABEL, COST_ON_LINE, COST_MOVED = 1000.0, 10.0, 1.0


def write_label(axes: "Axes", text: str, place: Array, offset: Array = (0, 0), **style: Any) -> None:
    """Write a label at an offset in points from a place.

    What lies beneath does not cross it.
    """
    from matplotlib.patheffects import withStroke

    halo = [withStroke(linewidth=2, foreground="white")]
    look: Any = {"ha": "center", "va": "center", "path_effects": halo, "zorder": 6, "gid": LABEL}
    axes.annotate(text, place, tuple(offset), textcoords="offset points", **look, **style)


def place_labels(figure: "Figure", axes: "Axes") -> None:
    """Move labels that cover each other or the drawing, the shortest way.

    The layout does not change afterwards, since the free places on the page depend on it.
    """
    figure.draw_without_rendering()
    figure.set_layout_engine("none")
    scale = figure.dpi / 72
    labels: list[Annotation] = [text for text in axes.texts if text.get_gid() == LABEL]  # type: ignore[misc]
    outlines, taken_boxes = outline_points(axes), np.empty((0, 4))
    for label in labels:
        # The cost of a candidate counts labels and outlines that its box covers, and its distance from the best place.
        best_offset = np.array(label.xyann)
        box = label.get_window_extent().padded(LABEL_GAP * scale)
        best_box = np.array([*box.min, *box.max])
        costs = []
        for distance in LABEL_DISTANCES:
            for turn in LABEL_TURNS:
                offset = (
                    distance * best_offset @ np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
                )
                moved_box = best_box + np.tile((offset - best_offset) * scale, 2)
                labels_covered = (
                    ((moved_box[2:] > taken_boxes[:, :2]) & (moved_box[:2] < taken_boxes[:, 2:])).all(axis=1).sum()
                )
                points_covered = ((outlines > moved_box[:2]) & (outlines < moved_box[2:])).all(axis=1).sum()
                move_cost = COST_MOVED * (distance - 1 + abs(turn) / np.pi)
                costs.append(
                    (COST_ON_LABEL * labels_covered + COST_ON_LINE * points_covered + move_cost, offset, moved_box)
                )
        # The first of the cheapest candidates is taken, and later labels avoid its box.
        _, offset, box_of_label = min(costs, key=lambda cost: cost[0])
        label.xyann = tuple(offset)
        taken_boxes = np.vstack([taken_boxes, box_of_label])


def outline_points(axes: "Axes") -> np.ndarray:
    """Return points on the outlines of all that is drawn.

    They are close together, on lines, marks, arrows and discs of the axes.
    """
    scale = axes.figure.dpi / 72
    paths = [patch.get_transform().transform_path(patch.get_path()) for patch in axes.patches]
    arrow_patches = [getattr(text, "arrow_patch", None) for text in axes.texts]
    arrows = [arrow for arrow in arrow_patches if arrow is not None]
    paths += [arrow.get_transform().transform_path(arrow.get_path()) for arrow in arrows]
    outlines: list[Any] = [outline for path in paths for outline in path.to_polygons(closed_only=False)]
    circle = np.linspace(0, 2 * np.pi, 25)
    # Marks are circles, wide lines have two edges, narrow lines are their own outline.
    for line in axes.lines:
        line_points = axes.transData.transform(line.get_xydata())
        if line.get_marker() in ("o", "."):
            radius = line.get_markersize() / 2 * scale
            outlines += [
                centre + radius * np.stack([np.cos(circle), np.sin(circle)], axis=-1) for centre in line_points
            ]
        elif line.get_linewidth() > MIN_WIDE_LINE:
            x, y = line_points[-1] - line_points[0]
            half_width = line.get_linewidth() / 2 * scale * np.array([-y, x]) / (np.hypot(x, y) or 1)
            outlines += [line_points + half_width, line_points - half_width]
        else:
            outlines.append(line_points)
    # Edges are divided, so that a label cannot lie across one without covering a point.
    pieces = [np.empty((0, 2))]
    for outline in outlines:
        for start, end in pairwise(outline):
            count = 2 + int(np.linalg.norm(end - start) / (OUTLINE_SPACING * scale))
            pieces.append(start + np.linspace(0, 1, count)[:, None] * (end - start))
    return np.concatenate(pieces)
