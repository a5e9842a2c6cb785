"""The meshes of a robot file, simplified for the page.

Vertex clustering simplifies them (J. Rossignac, P. Borrel, Multi-resolution 3D approximations for rendering complex
scenes, 1993): vertices in one cell of a grid merge in their mean, and triangles that lose a corner go. It takes any
triangles, closed or not, and no vertex moves by more than a cell's diagonal; parts thinner than a cell collapse.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from jounce.core.errors import join_names
from jounce.io.visuals import Visual, read_mesh, robot_visuals
from jounce.model.mechanism import Mechanism

MAX_TRIANGLES = 20_000  # of all meshes together: half a megabyte of the page
MIN_MESH_GRID = 1e-4  # of the extent of the meshes: vertices that are nearer to each other are one
MIN_GRID_GROWTH = 1.1  # from one grid to the next: near the limit the estimate alone would creep


class Mesh(NamedTuple):
    """Triangles in the frame of their body; body -1 is the ground."""

    body: int
    vertices: np.ndarray  # (V, 3)
    triangles: np.ndarray  # (T, 3)
    colour: str = ""


@dataclass(frozen=True, eq=False)
class Meshes:
    """The meshes of a robot file, with notes on others."""

    shapes: tuple[Mesh, ...] = ()
    notes: tuple[str, ...] = ()


def meshes_of(m: Mechanism, path: Path, folders: Sequence[Path] = ()) -> Meshes:
    """Read the visuals of a robot file as triangles, `MAX_TRIANGLES` at most.

    Without trimesh the result is empty.
    """
    visuals = robot_visuals(m, path)
    if not visuals:
        return Meshes(notes=(f"{path.name} has no visuals of the links; capsules stand for them.",))
    try:
        import trimesh  # noqa: F401
    except ModuleNotFoundError:
        cure = "trimesh is not installed; install it by: pip install 'jounce[report]'"
        return Meshes(notes=(f"Capsules stand for the visuals of {path.name}: {cure}.",))
    placed, unreadable = place_visuals(m, visuals, path, folders)
    # Vertices in the frames of the bodies: x -> R x + p.
    shapes = [Mesh(body, x.vertices @ C[:3, :3].T + C[:3, 3], np.asarray(x.faces)) for body, C, x in placed]
    notes = []
    if len(unreadable) > 0:
        reasons = join_names(dict.fromkeys(unreadable))
        notes.append(f"Meshes that cannot be read: {reasons}; capsules stand for links that nothing else shows.")
    simplified, step = _simplify(shapes)
    before = sum(len(mesh.triangles) for mesh in shapes)
    after = sum(len(mesh.triangles) for mesh in simplified)
    if before > MAX_TRIANGLES:
        notes.append(f"Meshes of {before:,} triangles are simplified to {after:,}, on a grid of {1000 * step:.2g} mm.")
    return Meshes(tuple(mesh for mesh in simplified if len(mesh.triangles)), tuple(notes))


def place_visuals(
    m: Mechanism, visuals: Sequence[Visual], path: Path, folders: Sequence[Path]
) -> tuple[list[tuple[int, np.ndarray, Any]], list[str]]:
    """Return body, pose in its frame and mesh of each visual.

    Meshes are those of trimesh. The reasons why others cannot be read follow.
    """
    frames, meshes = [m.frame(visual.link) for visual in visuals], [read_mesh(x, path, folders) for x in visuals]
    poses = [np.asarray(frame.T, dtype=float) @ visual.T for frame, visual in zip(frames, visuals, strict=True)]
    placed = [(f.body, C, x) for f, C, x in zip(frames, poses, meshes, strict=True) if not isinstance(x, str)]
    return placed, [x for x in meshes if isinstance(x, str)]


def _simplify(meshes: list[Mesh]) -> tuple[list[Mesh], float]:
    """Simplify meshes to `MAX_TRIANGLES`; also return the step of the grid, m."""
    extent = max((float(np.ptp(mesh.vertices, axis=0).max()) for mesh in meshes), default=0.0)
    step = MIN_MESH_GRID * extent or 1.0
    while True:  # ends: in the coarsest grid every mesh is one vertex
        simplified = [_cluster_vertices(mesh, step) for mesh in meshes]
        count = sum(len(mesh.triangles) for mesh in simplified)
        if count <= MAX_TRIANGLES:
            return simplified, step
        # The number of triangles of a surface goes as 1 / step^2.
        step *= max(MIN_GRID_GROWTH, (count / MAX_TRIANGLES) ** 0.5)


def _cluster_vertices(mesh: Mesh, step: float) -> Mesh:
    """Merge the vertices in each cell of a grid.

    Triangles that lose a corner, or cover another triangle, are left out.
    """
    cells = np.round((mesh.vertices - mesh.vertices.min(axis=0)) / step).astype(np.int64)
    keys = cells @ (1 << 21 * np.arange(3))  # at most 1 / MIN_MESH_GRID cells along each axis
    _, new_index, count = np.unique(keys, return_inverse=True, return_counts=True)
    vertices = np.stack([np.bincount(new_index, weights=x) for x in mesh.vertices.T], axis=1) / count[:, None]
    # Triangles with three different corners, each set of corners once, in the order of the input.
    corners = new_index[mesh.triangles]
    ordered = np.sort(corners, axis=1)
    has_area = (np.diff(ordered, axis=1) > 0).all(axis=1)
    _, first_rows = np.unique(ordered[has_area] @ len(count) ** np.arange(3), return_index=True)
    used_vertices, triangles = np.unique(corners[has_area][np.sort(first_rows)], return_inverse=True)
    return Mesh(mesh.body, vertices[used_vertices], triangles.reshape(-1, 3))
