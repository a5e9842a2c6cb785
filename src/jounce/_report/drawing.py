"""Draws a robot by triangles, which the poses of its bodies move.

`drawing` runs once per report. Links are meshes, or capsules between joints; joints are short cylinders along their
axes. Cut joints of loops connect links as other joints do; a body with many cut joints is drawn by its edges. Each part
is given in the frame of its body.

The page and its sliders know joints of one screw only. Joints of several are written as such, turns about x, y and z,
then shifts, by `to_single_screws`, and read back by `from_single_screws`: a pose in the group is
``exp(X_1 s_1) exp(X_2 s_2) ...`` over its screws, each in the axes that the former ones moved.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np

from jounce._report.curves import Packed, joint_style, pack_array
from jounce._report.meshes import Mesh
from jounce._report.report_data import ReportData
from jounce.engine import balance_points
from jounce.engine.engine import Engine
from jounce.engine.plan import compute
from jounce.figures.drawing import joint_points, skeleton
from jounce.model import coordinates, positions
from jounce.model.loops import Loop
from jounce.model.mechanism import Mechanism
from jounce.model.positions import Position
from jounce.spatial import inertia, lie

CIRCLE_CORNERS = 12  # looks round with smooth shading
LINK, CUT = "#b9bdc4", "#6a6e75"
LINK_RADIUS, SLIDE_RADIUS, JOINT_RADIUS, JOINT_HEIGHT = 0.032, 0.024, 0.05, 0.06  # of the robot's size
FORCE_LENGTH = 0.3  # of the robot's size: the longest force of a contact, below it
MIN_DRAWN_SIZE = 1e-3  # m, of a robot whose points all coincide
MIN_PLATE_CUTS = 3  # cut joints of a body that is drawn by its edges: three make a plane
MIN_EXTENT_SHARE = 0.6  # of the widest extent of the drawn space
SWEEP_MARGIN = 0.03  # of the robot's size, around what it sweeps: half the width of a link
GROUND_BODY = -1
BOX_DIRECTIONS = np.array(list(product((-1, 0, 1), repeat=3))).T


@dataclass(frozen=True)
class Solid:
    """Parts of one colour as one surface, each vertex with its body."""

    colour: str
    vertices: Packed
    bodies: Packed
    triangles: Packed


@dataclass(frozen=True)
class ContactForces:
    """The lines of soles and forces of contacts, and the largest length.

    They are those at the frames, see `contact_lines`.
    """

    lines: Packed
    names: list[str]
    longest: float


@dataclass(frozen=True)
class Drawing:
    """The drawing of a robot: triangles, the data of its poses, and the swept space."""

    parent: list[int]
    owners: list[int]
    B: Packed
    X: Packed
    G: Packed
    g: Packed
    q: Packed | None  # of joints of several screws, which page.js cannot compute by G and g
    floats: bool
    base: Packed | None
    solids: list[Solid]
    contacts: ContactForces
    zmp: Packed | None
    ends: list[Packed]
    space: list[list[float]]


def drawing(s: ReportData) -> Drawing:
    """Return the drawing of the robot at the frames of a report."""
    # The page knows joints of one screw only: positions of others are split.
    m = s.robot.mechanism.tree
    base = None if s.along.base is None else s.along.base[0][s.frames]
    poses, single_q = compute(Engine(m), "poses", [s.positions], base=base), to_single_screws(m, s.positions)
    size = robot_size(m, poses[0])
    # Bodies without meshes are drawn by their joints.
    bodies_with_meshes = {mesh.body for mesh in s.meshes.shapes}
    parts = [part for part in parts_of(m, size, single_q) if part.body not in bodies_with_meshes]
    parts += [mesh._replace(colour=_colour(m, mesh.body)) for mesh in s.meshes.shapes]
    colours = dict.fromkeys(part.colour for part in parts)
    # The swept space: the extreme points of every part at every pose, and the forces of contacts below them.
    ground = np.eye(4)[None] if base is None or m.floats else base
    parts_with_poses = [(part, ground if part.body == GROUND_BODY else poses[:, part.body]) for part in parts]
    swept_points = [
        (extreme_points(part.vertices) @ C[:, :3, :3].mT + C[:, None, :3, 3]).reshape(-1, 3)
        for part, C in parts_with_poses
    ]
    contacts, longest = balance_points.contact_lines_along(s.robot, s.motion, s.t[s.frames]), FORCE_LENGTH * size
    swept_points += [
        np.nan_to_num(ends) - (0, 0, longest)
        for ends in contacts[..., balance_points.FORCE_ENDS.start, :].swapaxes(0, 1)
    ]
    lowest = np.min([points.min(axis=0) for points in swept_points] + [np.zeros(3)], axis=0)
    highest = np.max([points.max(axis=0) for points in swept_points] + [np.zeros(3)], axis=0)
    return Drawing(
        parent=list(m.parent), owners=list(m.owners),
        B=pack_array(m.B[:, :3]), X=pack_array(m.X), G=pack_array(m.G), g=pack_array(m.g),
        q=pack_array(single_q) if positions.multiscrew_joints(m) else None, floats=m.floats,
        base=None if base is None else pack_array(base[:, :3]),
        solids=[_solid([part for part in parts if part.colour == colour]) for colour in colours],
        contacts=ContactForces(pack_array(contacts, "f4"), [x.frame for x in m.contacts], longest),
        zmp=pack_array(balance_points.zmp_along(s.robot, s.motion, s.t[s.frames]), "f4") if m.contacts else None,
        ends=[pack_array(poses[:, body, :3, 3] + poses[:, body, :3, :3] @ point, "f4") for body, point in tips(m)],
        space=np.stack(_space(lowest - SWEEP_MARGIN * size, highest + SWEEP_MARGIN * size), axis=1).tolist(),
    )  # fmt: skip


def _solid(parts: list[Mesh]) -> Solid:
    """Join parts of one colour to one surface.

    Triangles of a part count the vertices of the parts before it.
    """
    first = np.cumsum([0, *(len(part.vertices) for part in parts)])
    return Solid(
        parts[0].colour,
        vertices=pack_array(np.concatenate([part.vertices for part in parts]), "f4"),
        bodies=pack_array(np.repeat([part.body for part in parts], np.diff(first)), "i4"),
        triangles=pack_array(np.concatenate([p.triangles + k for p, k in zip(parts, first, strict=False)]).T, "i4"),
    )


def _space(lowest: np.ndarray, highest: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Grow the narrow extents of a space: the camera would see only a part of a flat one."""
    span = highest - lowest
    growth = (MIN_EXTENT_SHARE * span.max() - span).clip(min=0) / 2
    return lowest - growth, highest + growth


def extreme_points(points: np.ndarray) -> np.ndarray:
    """Return the points that are farthest in some directions.

    They span nearly the same space as all points.
    """
    return points[np.unique((points @ BOX_DIRECTIONS).argmax(axis=0))]


def robot_size(m: Mechanism, poses: np.ndarray) -> float:
    """Return the size of a robot, m, which is never 0."""
    return max(skeleton(m, poses).size, MIN_DRAWN_SIZE)


def parts_of(m: Mechanism, size: float, q: np.ndarray | None = None, joint_colour: str | None = None) -> list[Mesh]:
    """Return the parts of a robot of a size, m.

    Slides are as long as the limits and the coordinates (K, n) need. Joints have the colours of their curves, unless
    one colour is given.
    """
    # Links from the joint of each parent to the joint of the body, then to outer points and cut joints.
    centres = joint_points(m)
    radius = LINK_RADIUS * size
    parts, drawn_joints = [], [j for j in range(len(m.joints)) if not _is_virtual(m, j)]
    multiscrew, loose = positions.multiscrew_joints(m), positions.loose_bodies(m)
    for i in dict.fromkeys(m.owners[j] for j in drawn_joints if m.owners[j] not in loose):
        parent = m.parent[i]
        start = centres[parent] if parent != GROUND_BODY else np.zeros(3)
        end = m.B[i, :3, :3] @ centres[i] + m.B[i, :3, 3]
        parts.append(_capsule(parent, start, end, radius, LINK))
    parts += [_capsule(*placed, radius, LINK) for placed in (*_ends(m, centres), *_plates(m, centres))]
    drawn_joints = [j for j in drawn_joints if m.owners[j] not in multiscrew]
    parts += _slides(m, drawn_joints, centres, size, q)
    parts += [_cut_joint_mesh(loop, JOINT_RADIUS * size) for loop in m.loops]
    multiscrew_bodies = [i for i in multiscrew if i not in loose]
    parts += [
        _revolve(i, centres[i], np.zeros(3), _sphere(JOINT_RADIUS * size), _colour(m, i)) for i in multiscrew_bodies
    ]
    # Joints of one screw: cylinders along their axes, thinner and longer ones for slides.
    turns = m.X[:, :3].any(axis=1)
    axes = np.where(turns[:, None], m.X[:, :3], m.X[:, 3:])
    for i, j in ((m.owners[j], j) for j in drawn_joints):
        thick, high = (1.0, 1.0) if turns[j] else (0.7, 2.0)
        half, r = high * JOINT_HEIGHT * size, thick * JOINT_RADIUS * size
        profile = np.array([[0, -half], [r, -half], [r, half], [0, half]])
        parts.append(_revolve(i, centres[i], axes[j], profile, _colour(m, i)))
    if joint_colour is not None:
        parts = [part if part.colour == LINK else part._replace(colour=joint_colour) for part in parts]
    return parts


def _is_virtual(m: Mechanism, j: int) -> bool:
    """Whether a joint is a slide that only counts degrees of freedom.

    It is next to a massless body of a robot with loops; nothing slides there.
    """
    i = m.owners[j]
    massless = [not m.M[body, 3, 3] for body in (i, m.parent[i]) if _hangs_by_joint(m, body)]
    return bool(m.loops) and not m.X[j, :3].any() and any(massless)


def _hangs_by_joint(m: Mechanism, body: int) -> bool:
    """Whether a joint moves a body: none moves the ground or a floating base."""
    return body in m.owners


def _slides(
    m: Mechanism, drawn_joints: list[int], centres: np.ndarray, size: float, q: np.ndarray | None
) -> Iterator[Mesh]:
    """Yield rails on bodies that carry slides, and rods on sliding bodies.

    Rail and rod meet at every position that is reached.
    """
    # Positions of the motion, and limits, unless these are far beyond the size of the robot. (K + 2, joints)
    theta = m.g + (np.zeros((1, m.n)) if q is None else q) @ m.G.T
    bounds = np.stack([m.limits.lower, m.limits.upper])
    reached_positions = np.concatenate([theta, np.where(np.abs(bounds) <= 2 * size, bounds, theta[0])])
    for i, j in ((m.owners[j], j) for j in drawn_joints):
        if not m.X[j, :3].any():
            low, high = reached_positions[:, j].min(), reached_positions[:, j].max()
            origin, axis = m.B[i, :3, :3] @ centres[i] + m.B[i, :3, 3], m.X[j, 3:]
            # The rail spans the positions and 0, where the body's own frame is; if 0 is outside, a rod does the rest.
            contains_zero = low <= 0 <= high
            first, last = (low, high) if contains_zero else (min(0.0, high), max(0.0, low))
            start, end = (origin + x * (m.B[i, :3, :3] @ axis) for x in (first, last))
            yield _capsule(m.parent[i], start, end, SLIDE_RADIUS * size, LINK)
            if not contains_zero:
                offset = (low - high if low > 0 else high - low) * axis
                yield _capsule(i, centres[i] + offset, centres[i], SLIDE_RADIUS * size, LINK)


def _ends(m: Mechanism, centres: np.ndarray) -> Iterator[tuple[int, np.ndarray, np.ndarray]]:
    """Yield links from joints to outermost points and to few cut joints."""
    points_by_body = cut_points(m)
    few_points = {
        body: points
        for body, points in points_by_body.items()
        if len(points) < MIN_PLATE_CUTS or not _hangs_by_joint(m, body)
    }
    ends = {body: [*points] for body, points in few_points.items()}
    for body, end in tips(m):
        if len(points_by_body.get(body, ())) < MIN_PLATE_CUTS and not any(
            np.allclose(end, point) for point in ends.get(body, ())
        ):
            ends.setdefault(body, []).append(end)
    yield from (
        (body, np.zeros(3) if body == GROUND_BODY else centres[body], end) for body in ends for end in ends[body]
    )


def _plates(m: Mechanism, centres: np.ndarray) -> Iterator[tuple[int, np.ndarray, np.ndarray]]:
    """Yield the edges of bodies with many cut joints.

    Corners are the cut joints and the body's own joint, unless it lies inside.
    """
    for body, points in cut_points(m).items():
        if len(points) < MIN_PLATE_CUTS or not _hangs_by_joint(m, body):
            continue
        corners = np.array([*points, centres[body]])
        offsets = corners - corners.mean(axis=0)
        distances = np.linalg.norm(offsets, axis=1)
        # Corners in the order of their angles in the plane that fits them best; corners near the middle are left out.
        first, second = np.linalg.svd(offsets)[2][:2]
        order = np.argsort(np.arctan2(offsets @ second, offsets @ first))
        ring = corners[order[distances[order] > distances.max() / 2]]
        yield from ((body, start, end) for start, end in zip(ring, np.roll(ring, -1, axis=0), strict=True))


def _cut_joint_mesh(loop: Loop, radius: float) -> Mesh:
    """Return a cut joint: a ball if it is spherical, else a short cylinder."""
    place, axis = np.asarray(loop.a.T, dtype=float), np.asarray(loop.axis, dtype=float)
    half = JOINT_HEIGHT / JOINT_RADIUS * radius
    profile = np.array([[0, -half], [radius, -half], [radius, half], [0, half]])
    if loop.joint == "spherical":
        profile = _sphere(radius)
    return _revolve(loop.a.body, place[:3, 3], place[:3, :3] @ axis, profile, CUT)


def _sphere(radius: float) -> np.ndarray:
    turn = np.linspace(-np.pi / 2, np.pi / 2, 7)
    return radius * np.stack([np.cos(turn), np.sin(turn)], axis=1)


def _colour(m: Mechanism, body: int) -> str:
    """Return the colour of a body: that of the curves of its joint."""
    movers = [m.owners[j] for j in coordinates.leading_joints(m)]
    return joint_style(movers.index(body))["color"] if body in movers else LINK


def cut_points(m: Mechanism) -> dict[int, list[np.ndarray]]:
    """Return the points of cut joints by body, each once."""
    points_by_body: dict[int, list[np.ndarray]] = {}
    for frame in (frame for loop in m.loops for frame in (loop.a, loop.b)):
        point, points = np.asarray(frame.T[:3, 3], dtype=float), points_by_body.setdefault(frame.body, [])
        if not any(np.allclose(point, other) for other in points):
            points.append(point)
    return points_by_body


def tips(m: Mechanism) -> list[tuple[int, np.ndarray]]:
    """Return the outermost points of bodies that carry no other body.

    It is the farthest merged link, or the centre of mass.
    """
    tip_points, centres = [], joint_points(m)
    for i in positions.outer_bodies(m):
        points = [np.asarray(frame.T[:3, 3], dtype=float) for frame in m.frames if frame.body == i]
        mass, h, _ = inertia.moments(m.M[i])
        points += [h[:, 0] / mass[0, 0]] if mass[0, 0] else []
        if points:
            tip_points.append((i, max(points, key=lambda point: float(np.linalg.norm(point - centres[i])))))
    return tip_points


def _capsule(body: int, start: np.ndarray, end: np.ndarray, radius: float, colour: str) -> Mesh:
    """Return a cylinder with round ends."""
    turn = np.linspace(0, np.pi / 2, 4)
    cap = radius * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    along = end - start
    profile = np.concatenate([cap[::-1] * [1, -1], cap + np.array([0, np.linalg.norm(along)])])
    return _revolve(body, start, along, profile, colour)


def _revolve(body: int, origin: np.ndarray, axis: np.ndarray, profile: np.ndarray, colour: str) -> Mesh:
    """Return the solid that a profile makes about an axis.

    The profile (P, 2) holds radius and height; the axis goes through an origin.
    """
    # e, u and v are orthonormal; the profile turns from u to v about e.
    e = axis / np.linalg.norm(axis) if axis.any() else np.array([0.0, 0.0, 1.0])
    u, v = np.linalg.svd(e[None])[2][1:]
    v = np.cross(e, u)
    angle = 2 * np.pi * np.arange(CIRCLE_CORNERS) / CIRCLE_CORNERS
    circle = np.cos(angle)[:, None] * u + np.sin(angle)[:, None] * v
    vertices = origin + profile[:, :1, None] * circle + profile[:, 1:, None] * e  # (P, CIRCLE_CORNERS, 3)
    # Two triangles for each cell between neighbours on the circle and on the profile.
    k, a = np.meshgrid(np.arange(len(profile) - 1), np.arange(CIRCLE_CORNERS), indexing="ij")
    corner, following = k * CIRCLE_CORNERS + a, k * CIRCLE_CORNERS + (a + 1) % CIRCLE_CORNERS
    above = corner + CIRCLE_CORNERS
    sides = np.stack([corner, following, above, following, following + CIRCLE_CORNERS, above], axis=-1)
    return Mesh(body, vertices.reshape(-1, 3), sides.reshape(-1, 3), colour)


def to_single_screws(m: Mechanism, q: np.ndarray) -> np.ndarray:
    """Split positions q (..., nq) into those of single screws, (..., n).

    They are equal for joints of one screw.
    """
    if not positions.multiscrew_joints(m):
        return q
    s = positions.single_joint_positions(m, q)
    for joint in positions.multiscrew_joints(m).values():
        s[..., joint.coordinates] = _split_pose(joint, q[..., joint.numbers])
    return s


def from_single_screws(m: Mechanism, s: np.ndarray) -> np.ndarray:
    """Return positions q (nq,) from positions s (n,) by single screws."""
    if not positions.multiscrew_joints(m):
        return s
    q = np.zeros(positions.count(m)) + s @ positions.single_positions(m)
    for joint in positions.multiscrew_joints(m).values():
        H = np.eye(4)
        for X, step in zip(joint.group.X.T.astype(float), s[joint.coordinates], strict=True):
            H = H @ lie.exp(X, step[None, None])
        q[joint.numbers] = joint.group.numbers(H)
    return q


def _split_pose(joint: Position, p: np.ndarray) -> np.ndarray:
    """Split poses of a joint into turns and shifts.

    Turns are about x, y and z. (..., numbers) -> (..., screws)
    """
    # R = R_x(a) R_y(b) R_z(c): a from the last column, then b and c without the turn about x.
    H = np.asarray(joint.group.pose(p))
    R, r = H[..., :3, :3], H[..., :3, 3:]
    a = np.arctan2(-R[..., 1, 2], R[..., 2, 2])
    c, s = np.cos(a)[..., None], np.sin(a)[..., None]
    y, z = c * R[..., 1, :] + s * R[..., 2, :], c * R[..., 2, :] - s * R[..., 1, :]
    turns = [a, np.arctan2(R[..., 0, 2], z[..., 2]), np.arctan2(y[..., 0], y[..., 1])]
    return np.concatenate([np.stack(turns, axis=-1), (R.mT @ r)[..., 0]], axis=-1)[..., list(joint.group.axes)] + 0.0
