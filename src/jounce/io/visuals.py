"""The shapes by which a URDF shows its links: boxes, cylinders, spheres and meshes."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from lxml import etree

from jounce.core.errors import one_line, quote_value
from jounce.io.files import read_bytes
from jounce.io.mesh_files import find_mesh
from jounce.io.urdf import origin_pose, parse_xml, read_numbers

if TYPE_CHECKING:
    from jounce.model.mechanism import Mechanism

SHAPES = {"box": ("size", 3), "cylinder": ("radius length", 1), "sphere": ("radius", 1)}  # attributes, numbers of each
URDF_SUFFIX = ".urdf"
SHAPE_COLOR = (185, 189, 196)  # red, green, blue of 255: a light grey, as shapes state no colour here


@dataclass(frozen=True, eq=False)
class Visual:
    """A shape that is fixed on a link, `T` its pose in the frame of the link.

    `size` holds the sides of a box, the radius and length of a cylinder, the radius of a sphere, m, or the scale of a
    mesh; a cylinder lies along z.
    """

    link: str
    T: np.ndarray
    kind: str
    size: np.ndarray
    mesh: str = ""


def read_visuals(path: Path) -> list[Visual]:
    """The visuals of a URDF; robot files of other types give an empty list."""
    if path.suffix.lower() != URDF_SUFFIX:
        return []
    robot = parse_xml(read_bytes(path), str(path))
    links = [link for link in robot.iterchildren("link") if link.get("name")]
    return [
        found for link in links for visual in link.iterchildren("visual") for found in _read_visual(visual, link, path)
    ]


def robot_visuals(m: "Mechanism", path: Path) -> list[Visual]:
    """The visuals of links that the robot has: `--root` may have left some out."""
    names = set(m.frame_names)
    return [visual for visual in read_visuals(path) if visual.link in names]


def _read_visual(visual: etree._Element, link: etree._Element, path: Path) -> Iterator[Visual]:
    T, name, file = origin_pose(visual, str(path)), str(link.get("name")), str(path)
    for shape in visual.iterfind("geometry/*"):
        if shape.tag == "mesh":
            scale = read_numbers(shape, "scale", 3, file, default="1 1 1")
            yield Visual(name, T, "mesh", scale, shape.get("filename", ""))
        elif shape.tag in SHAPES:
            attributes, count = SHAPES[shape.tag]
            size = [read_numbers(shape, attribute, count, file) for attribute in attributes.split()]
            yield Visual(name, T, shape.tag, np.concatenate(size))


def read_mesh(visual: Visual, path: Path, folders: Sequence[Path] = ()) -> Any:
    """The triangles of a visual, a `trimesh.Trimesh`, or in words why it cannot be drawn."""
    import trimesh

    mesh: Any
    match visual.kind:
        case "box":
            mesh = trimesh.creation.box(visual.size)
        case "cylinder":
            mesh = trimesh.creation.cylinder(*visual.size)
        case "sphere":
            mesh = trimesh.creation.icosphere(3, *visual.size)
        case _:
            name = quote_value(visual.mesh.rpartition("/")[2])  # lists of whole addresses leave no space for reasons
            found = find_mesh(visual.mesh, path, folders)
            if isinstance(found, str):
                return f"{name} ({found})"
            try:
                mesh = trimesh.load(found, force="mesh", resolver=_folder_resolver(found))
            except Exception as error:  # readers of meshes raise anything
                return f"{name} ({one_line(str(error))})"
            if not len(mesh.faces):
                return f"{name} (no triangles)"
            mesh.apply_transform(np.diag([*visual.size, 1]))
            return mesh
    mesh.visual.face_colors = SHAPE_COLOR
    return mesh


def _folder_resolver(mesh: Path) -> Any:
    """What finds the materials and textures that a mesh names: in its own folder only."""
    from trimesh.resolvers import FilePathResolver

    class OwnFolder(FilePathResolver):
        def get(self, name: str) -> bytes:
            folder = mesh.resolve().parent
            if not (folder / name.strip()).resolve().is_relative_to(folder):
                raise ValueError(f"{quote_value(name)} is outside of the folder of the mesh")
            found: bytes = super().get(name)
            return found

    return OwnFolder(str(mesh))
