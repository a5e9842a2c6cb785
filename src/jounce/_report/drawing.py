"""A robot as triangles: links as meshes or as capsules between joints, joints as short cylinders along their axes.

Each part is given in the frame of its body, so that the page moves it by the pose of the body.
"""

from itertools import product
from typing import Any, NamedTuple

import numpy as np

from jounce._report.curves import joint_style
from jounce._report.packing import packed
from jounce._report.subject import Subject
from jounce.figures.drawing import skeleton
from jounce.model.coordinates import leading_joints
from jounce.model.mechanism import Mechanism
from jounce.spatial.inertia import moments

AROUND = 12  # corners of a circle
LINK = "#b9bdc4"
LINK_RADIUS, JOINT_RADIUS, JOINT_HEIGHT = 0.032, 0.05, 0.06  # of the robot's size
LEAST_SIZE = 1e-3  # m
MARGIN = 0.03  # of the robot's size, around what it sweeps
GROUND = -1
DIRECTIONS = np.array(list(product((-1, 0, 1), repeat=3))).T


class Part(NamedTuple):
    """A solid that moves with a body, `GROUND` for none."""

    body: int
    vertices: np.ndarray  # (V, 3)
    triangles: np.ndarray  # (T, 3)
    colour: str


def drawing(s: Subject) -> dict[str, Any]:
    """What the page draws a robot by: its triangles, the data of its poses, and the space that it sweeps."""
    m = s.robot.mechanism
    poses = s.robot.poses(s.along.rates[0][s.frames])
    size = robot_size(m, poses[0])
    shown = {mesh.body for mesh in s.meshes.shapes}
    parts = [part for part in parts_of(m, size) if part.body not in shown]
    parts += [Part(*mesh, _colour(m, mesh.body)) for mesh in s.meshes.shapes]
    colours = dict.fromkeys(part.colour for part in parts)
    swept = [
        outermost(part.vertices) if part.body == GROUND else
        (outermost(part.vertices) @ poses[:, part.body, :3, :3].mT + poses[:, part.body, None, :3, 3]).reshape(-1, 3)
        for part in parts
    ]  # fmt: skip
    lowest, highest = (f([f(points, axis=0) for points in swept] + [np.zeros(3)], axis=0) for f in (np.min, np.max))
    return {
        "n": m.n,
        "parent": list(m.parent),
        "B": packed(m.B[:, :3]),
        "X": packed(m.X),
        "G": packed(m.G),
        "g": packed(m.g),
        "solids": [_solid([part for part in parts if part.colour == colour]) for colour in colours],
        "ends": [packed(poses[:, body, :3, 3] + poses[:, body, :3, :3] @ point, "f4") for body, point in tips(m)],
        "space": np.stack([lowest - MARGIN * size, highest + MARGIN * size], axis=1).tolist(),
    }


def _solid(parts: list[Part]) -> dict[str, Any]:
    """Parts of one colour as one surface of the page."""
    first = np.cumsum([0, *(len(part.vertices) for part in parts)])
    return {
        "colour": parts[0].colour,
        "vertices": packed(np.concatenate([part.vertices for part in parts]), "f4"),
        "bodies": packed(np.repeat([part.body for part in parts], np.diff(first)), "i4"),
        "triangles": packed(np.concatenate([p.triangles + k for p, k in zip(parts, first, strict=False)]).T, "i4"),
    }


def outermost(points: np.ndarray) -> np.ndarray:
    """The points that are farthest in each of some directions: they span nearly the space that all do."""
    return points[np.unique((points @ DIRECTIONS).argmax(axis=0))]


def robot_size(m: Mechanism, poses: np.ndarray) -> float:
    """The size of a robot at some poses of its bodies, m; never 0, so that lengths can be shares of it."""
    return max(skeleton(m, poses).size, LEAST_SIZE)


def parts_of(m: Mechanism, size: float) -> list[Part]:
    """The parts of a robot of a size, m."""
    centres = np.cross(m.X[:, :3], m.X[:, 3:])  # of the joints, in the frames of their bodies
    radius = LINK_RADIUS * size
    parts = []
    for i, p in enumerate(m.parent):
        start = centres[p] if p != GROUND else np.zeros(3)
        end = m.B[i, :3, :3] @ centres[i] + m.B[i, :3, 3]
        parts.append(_capsule(p, start, end, radius, LINK))
    parts += [_capsule(body, centres[body], end, radius, LINK) for body, end in tips(m)]
    turns = m.X[:, :3].any(axis=1)
    axes = np.where(turns[:, None], m.X[:, :3], m.X[:, 3:])
    for i, (centre, axis) in enumerate(zip(centres, axes, strict=True)):
        thick, high = (1.0, 1.0) if turns[i] else (0.7, 2.0)
        half, r = high * JOINT_HEIGHT * size, thick * JOINT_RADIUS * size
        profile = np.array([[0, -half], [r, -half], [r, half], [0, half]])
        parts.append(_revolved(i, centre, axis, profile, _colour(m, i)))
    return parts


def _colour(m: Mechanism, body: int) -> str:
    """That of the curves of the joint that moves a body."""
    leaders = leading_joints(m)
    return joint_style(leaders.index(body))["color"] if body in leaders else LINK


def tips(m: Mechanism) -> list[tuple[int, np.ndarray]]:
    """The outermost points of bodies that carry no other: their farthest merged link, or the centre of mass."""
    found = []
    for i in sorted(set(range(m.nb)) - set(m.parent)):
        points = [np.asarray(frame.T[:3, 3], dtype=float) for frame in m.frames if frame.body == i]
        mass, h, _ = moments(m.M[i])
        points += [h[:, 0] / mass[0, 0]] if mass[0, 0] else []
        centre = np.cross(m.X[i, :3], m.X[i, 3:])
        if points:
            found.append((i, max(points, key=lambda point: float(np.linalg.norm(point - centre)))))
    return found


def _capsule(body: int, start: np.ndarray, end: np.ndarray, radius: float, colour: str) -> Part:
    turn = np.linspace(0, np.pi / 2, 4)
    cap = radius * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    along = end - start
    profile = np.concatenate([cap[::-1] * [1, -1], cap + np.array([0, np.linalg.norm(along)])])
    return _revolved(body, start, along, profile, colour)


def _revolved(body: int, origin: np.ndarray, axis: np.ndarray, profile: np.ndarray, colour: str) -> Part:
    """The solid that a profile (P, 2) of (radius, height) makes about an axis through an origin."""
    e = axis / np.linalg.norm(axis) if axis.any() else np.array([0.0, 0.0, 1.0])
    u, v = np.linalg.svd(e[None])[2][1:]
    v = np.cross(e, u)
    angle = 2 * np.pi * np.arange(AROUND) / AROUND
    circle = np.cos(angle)[:, None] * u + np.sin(angle)[:, None] * v
    vertices = origin + profile[:, :1, None] * circle + profile[:, 1:, None] * e  # (P, AROUND, 3)
    k, a = np.meshgrid(np.arange(len(profile) - 1), np.arange(AROUND), indexing="ij")
    corner, beside = k * AROUND + a, k * AROUND + (a + 1) % AROUND
    sides = np.stack([corner, beside, corner + AROUND, beside, beside + AROUND, corner + AROUND], axis=-1)
    return Part(body, vertices.reshape(-1, 3), sides.reshape(-1, 3), colour)
