"""Makes a robot of triangles, which the page moves by the poses of the bodies.

`drawing` is the door. Links are meshes or capsules between joints, joints short cylinders along their axes. Joints at
which loops are cut join links as others do; a body with many of them is drawn by its edges. Each part is given in the
frame of its body.

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
    """Parts of one colour as one surface of the page, each vertex with the body that moves it."""

    colour: str
    vertices: Packed
    bodies: Packed
    triangles: Packed


@dataclass(frozen=True)
class ContactForces:
    """The lines of soles and forces of the contacts at the frames, see `contact_lines`; the length of the longest."""

    lines: Packed
    names: list[str]
    longest: float


@dataclass(frozen=True)
class Drawing:
    """What the page draws a robot by: its triangles, the data of its poses, and the space that it sweeps."""

    parent: list[int]
    owners: list[int]
    B: Packed
    X: Packed
    G: Packed
    g: Packed
    q: Packed | None  # of joints of several screws, which page.js does not find by G and g
    floats: bool
    base: Packed | None
    solids: list[Solid]
    contacts: ContactForces
    zmp: Packed | None
    ends: list[Packed]
    space: list[list[float]]


def drawing(s: ReportData) -> Drawing:
    """The robot at the frames."""
    m = s.robot.mechanism.tree
    base = None if s.along.base is None else s.along.base[0][s.frames]
    poses, steps = compute(Engine(m), "poses", [s.positions], base=base), to_single_screws(m, s.positions)
    size = robot_size(m, poses[0])
    shown = {mesh.body for mesh in s.meshes.shapes}
    parts = [part for part in parts_of(m, size, steps) if part.body not in shown]
    parts += [mesh._replace(colour=_colour(m, mesh.body)) for mesh in s.meshes.shapes]
    colours = dict.fromkeys(part.colour for part in parts)
    ground = np.eye(4)[None] if base is None or m.floats else base
    moved = [(part, ground if part.body == GROUND_BODY else poses[:, part.body]) for part in parts]
    swept = [(extreme_points(part.vertices) @ C[:, :3, :3].mT + C[:, None, :3, 3]).reshape(-1, 3) for part, C in moved]
    contacts, longest = balance_points.contact_lines_along(s.robot, s.motion, s.t[s.frames]), FORCE_LENGTH * size
    swept += [
        np.nan_to_num(ends) - (0, 0, longest)
        for ends in contacts[..., balance_points.FORCE_ENDS.start, :].swapaxes(0, 1)
    ]
    lowest, highest = (f([f(points, axis=0) for points in swept] + [np.zeros(3)], axis=0) for f in (np.min, np.max))
    return Drawing(
        parent=list(m.parent), owners=list(m.owners),
        B=pack_array(m.B[:, :3]), X=pack_array(m.X), G=pack_array(m.G), g=pack_array(m.g),
        q=pack_array(steps) if positions.multiscrew_joints(m) else None, floats=m.floats,
        base=None if base is None else pack_array(base[:, :3]),
        solids=[_solid([part for part in parts if part.colour == colour]) for colour in colours],
        contacts=ContactForces(pack_array(contacts, "f4"), [x.frame for x in m.contacts], longest),
        zmp=pack_array(balance_points.zmp_along(s.robot, s.motion, s.t[s.frames]), "f4") if m.contacts else None,
        ends=[pack_array(poses[:, body, :3, 3] + poses[:, body, :3, :3] @ point, "f4") for body, point in tips(m)],
        space=np.stack(_space(lowest - SWEEP_MARGIN * size, highest + SWEEP_MARGIN * size), axis=1).tolist(),
    )  # fmt: skip


def _solid(parts: list[Mesh]) -> Solid:
    first = np.cumsum([0, *(len(part.vertices) for part in parts)])
    return Solid(
        parts[0].colour,
        vertices=pack_array(np.concatenate([part.vertices for part in parts]), "f4"),
        bodies=pack_array(np.repeat([part.body for part in parts], np.diff(first)), "i4"),
        triangles=pack_array(np.concatenate([p.triangles + k for p, k in zip(parts, first, strict=False)]).T, "i4"),
    )


def _space(lowest: np.ndarray, highest: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A space that is nowhere flat: of a flat one, the camera would see a part only."""
    span = highest - lowest
    room = (MIN_EXTENT_SHARE * span.max() - span).clip(min=0) / 2
    return lowest - room, highest + room


def extreme_points(points: np.ndarray) -> np.ndarray:
    """The points that are farthest in each of some directions: they span nearly the space that all do."""
    return points[np.unique((points @ BOX_DIRECTIONS).argmax(axis=0))]


def robot_size(m: Mechanism, poses: np.ndarray) -> float:
    """The size of a robot at some poses of its bodies, m; never 0, so that lengths can be shares of it."""
    return max(skeleton(m, poses).size, MIN_DRAWN_SIZE)


def parts_of(m: Mechanism, size: float, q: np.ndarray | None = None) -> list[Mesh]:
    """The parts of a robot of a size, m; slides are as long as its limits and coordinates (K, n) need."""
    centres = joint_points(m)
    radius = LINK_RADIUS * size
    parts, drawn = [], [j for j in range(len(m.joints)) if not _is_virtual(m, j)]
    several, loose = positions.multiscrew_joints(m), positions.loose_bodies(m)
    for i in dict.fromkeys(m.owners[j] for j in drawn if m.owners[j] not in loose):
        p = m.parent[i]
        start = centres[p] if p != GROUND_BODY else np.zeros(3)
        end = m.B[i, :3, :3] @ centres[i] + m.B[i, :3, 3]
        parts.append(_capsule(p, start, end, radius, LINK))
    parts += [_capsule(*placed, radius, LINK) for placed in (*_ends(m, centres), *_plates(m, centres))]
    drawn = [j for j in drawn if m.owners[j] not in several]
    parts += _slides(m, drawn, centres, size, q)
    parts += [_cut_joint_mesh(loop, JOINT_RADIUS * size) for loop in m.loops]
    balls = [i for i in several if i not in loose]
    parts += [_revolve(i, centres[i], np.zeros(3), _sphere(JOINT_RADIUS * size), _colour(m, i)) for i in balls]
    turns = m.X[:, :3].any(axis=1)
    axes = np.where(turns[:, None], m.X[:, :3], m.X[:, 3:])
    for i, j in ((m.owners[j], j) for j in drawn):
        thick, high = (1.0, 1.0) if turns[j] else (0.7, 2.0)
        half, r = high * JOINT_HEIGHT * size, thick * JOINT_RADIUS * size
        profile = np.array([[0, -half], [r, -half], [r, half], [0, half]])
        parts.append(_revolve(i, centres[i], axes[j], profile, _colour(m, i)))
    return parts


def _is_virtual(m: Mechanism, j: int) -> bool:
    """Whether a joint is a slide next to a massless body of a robot with loops: it counts motions, nothing slides."""
    i = m.owners[j]
    massless = [not m.M[body, 3, 3] for body in (i, m.parent[i]) if _hangs_by_joint(m, body)]
    return bool(m.loops) and not m.X[j, :3].any() and any(massless)


def _hangs_by_joint(m: Mechanism, body: int) -> bool:
    """Whether a body hangs by a joint: the ground and a floating base do not."""
    return body in m.owners


def _slides(m: Mechanism, drawn: list[int], centres: np.ndarray, size: float, q: np.ndarray | None) -> Iterator[Mesh]:
    """Rails on the bodies that carry slides, and rods on those that slide: they reach each other everywhere."""
    theta = m.g + (np.zeros((1, m.n)) if q is None else q) @ m.G.T
    bounds = np.stack([m.limits.lower, m.limits.upper])
    reached = np.concatenate([theta, np.where(np.abs(bounds) <= 2 * size, bounds, theta[0])])
    for i, j in ((m.owners[j], j) for j in drawn):
        if not m.X[j, :3].any():
            low, high = reached[:, j].min(), reached[:, j].max()
            at, axis = m.B[i, :3, :3] @ centres[i] + m.B[i, :3, 3], m.X[j, 3:]
            within = low <= 0 <= high  # else a rod reaches what the rail does not
            first, last = (low, high) if within else (min(0.0, high), max(0.0, low))
            start, end = (at + x * (m.B[i, :3, :3] @ axis) for x in (first, last))
            yield _capsule(m.parent[i], start, end, SLIDE_RADIUS * size, LINK)
            if not within:
                back = (low - high if low > 0 else high - low) * axis
                yield _capsule(i, centres[i] + back, centres[i], SLIDE_RADIUS * size, LINK)


def _ends(m: Mechanism, centres: np.ndarray) -> Iterator[tuple[int, np.ndarray, np.ndarray]]:
    """Links from the joint of a body to its outermost point, and to cut joints where these are few."""
    cut = cut_points(m)
    few = {body: points for body, points in cut.items() if len(points) < MIN_PLATE_CUTS or not _hangs_by_joint(m, body)}
    ends = {body: [*points] for body, points in few.items()}
    for body, end in tips(m):
        if len(cut.get(body, ())) < MIN_PLATE_CUTS and not any(np.allclose(end, point) for point in ends.get(body, ())):
            ends.setdefault(body, []).append(end)
    yield from (
        (body, np.zeros(3) if body == GROUND_BODY else centres[body], end) for body in ends for end in ends[body]
    )


def _plates(m: Mechanism, centres: np.ndarray) -> Iterator[tuple[int, np.ndarray, np.ndarray]]:
    """The edges of bodies with many cut joints: these and the body's own joint are corners, unless it lies inside."""
    for body, points in cut_points(m).items():
        if len(points) < MIN_PLATE_CUTS or not _hangs_by_joint(m, body):
            continue
        corners = np.array([*points, centres[body]])
        away = corners - corners.mean(axis=0)
        far = np.linalg.norm(away, axis=1)
        first, second = np.linalg.svd(away)[2][:2]
        around = np.argsort(np.arctan2(away @ second, away @ first))
        ring = corners[around[far[around] > far.max() / 2]]
        yield from ((body, start, end) for start, end in zip(ring, np.roll(ring, -1, axis=0), strict=True))


def _cut_joint_mesh(loop: Loop, radius: float) -> Mesh:
    """A cut joint: a ball where it turns in every direction, else a short cylinder along its axis."""
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
    """That of the curves of the joint that moves a body."""
    movers = [m.owners[j] for j in coordinates.leading_joints(m)]
    return joint_style(movers.index(body))["color"] if body in movers else LINK


def cut_points(m: Mechanism) -> dict[int, list[np.ndarray]]:
    """The points of bodies at which cut joints hold them, each once."""
    found: dict[int, list[np.ndarray]] = {}
    for frame in (frame for loop in m.loops for frame in (loop.a, loop.b)):
        point, points = np.asarray(frame.T[:3, 3], dtype=float), found.setdefault(frame.body, [])
        if not any(np.allclose(point, other) for other in points):
            points.append(point)
    return found


def tips(m: Mechanism) -> list[tuple[int, np.ndarray]]:
    """The outermost points of bodies that carry no other: their farthest merged link, or the centre of mass."""
    found, centres = [], joint_points(m)
    for i in positions.outer_bodies(m):
        points = [np.asarray(frame.T[:3, 3], dtype=float) for frame in m.frames if frame.body == i]
        mass, h, _ = inertia.moments(m.M[i])
        points += [h[:, 0] / mass[0, 0]] if mass[0, 0] else []
        if points:
            found.append((i, max(points, key=lambda point: float(np.linalg.norm(point - centres[i])))))
    return found


def _capsule(body: int, start: np.ndarray, end: np.ndarray, radius: float, colour: str) -> Mesh:
    turn = np.linspace(0, np.pi / 2, 4)
    cap = radius * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    along = end - start
    profile = np.concatenate([cap[::-1] * [1, -1], cap + np.array([0, np.linalg.norm(along)])])
    return _revolve(body, start, along, profile, colour)


def _revolve(body: int, origin: np.ndarray, axis: np.ndarray, profile: np.ndarray, colour: str) -> Mesh:
    """The solid that a profile (P, 2) of (radius, height) makes about an axis through an origin."""
    e = axis / np.linalg.norm(axis) if axis.any() else np.array([0.0, 0.0, 1.0])
    u, v = np.linalg.svd(e[None])[2][1:]
    v = np.cross(e, u)
    angle = 2 * np.pi * np.arange(CIRCLE_CORNERS) / CIRCLE_CORNERS
    circle = np.cos(angle)[:, None] * u + np.sin(angle)[:, None] * v
    vertices = origin + profile[:, :1, None] * circle + profile[:, 1:, None] * e  # (P, CIRCLE_CORNERS, 3)
    k, a = np.meshgrid(np.arange(len(profile) - 1), np.arange(CIRCLE_CORNERS), indexing="ij")
    corner, following = k * CIRCLE_CORNERS + a, k * CIRCLE_CORNERS + (a + 1) % CIRCLE_CORNERS
    above = corner + CIRCLE_CORNERS
    sides = np.stack([corner, following, above, following, following + CIRCLE_CORNERS, above], axis=-1)
    return Mesh(body, vertices.reshape(-1, 3), sides.reshape(-1, 3), colour)


def to_single_screws(m: Mechanism, q: np.ndarray) -> np.ndarray:
    """s (..., n) of positions q (..., nq): these themselves for joints of one screw."""
    if not positions.multiscrew_joints(m):
        return q
    s = positions.single_joint_positions(m, q)
    for joint in positions.multiscrew_joints(m).values():
        s[..., joint.coordinates] = _split_pose(joint, q[..., joint.numbers])
    return s


def from_single_screws(m: Mechanism, s: np.ndarray) -> np.ndarray:
    """Positions q (nq,) of s (n,)."""
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
    H = np.asarray(joint.group.pose(p))
    R, r = H[..., :3, :3], H[..., :3, 3:]
    a = np.arctan2(-R[..., 1, 2], R[..., 2, 2])
    c, s = np.cos(a)[..., None], np.sin(a)[..., None]
    y, z = c * R[..., 1, :] + s * R[..., 2, :], c * R[..., 2, :] - s * R[..., 1, :]  # without the turn about x
    turns = [a, np.arctan2(R[..., 0, 2], z[..., 2]), np.arctan2(y[..., 0], y[..., 1])]
    return np.concatenate([np.stack(turns, axis=-1), (R.mT @ r)[..., 0]], axis=-1)[..., list(joint.group.axes)] + 0.0
