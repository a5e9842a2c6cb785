"""Reads the shapes by which a URDF shows its links, and finds their meshes.

`read_visuals` gives boxes, cylinders, spheres and meshes, `read_mesh` the triangles of one. `find_mesh` looks for a
mesh in the folder of the robot file, in its packages, and in folders that the user names. A robot file may come from
anybody, and pages with its meshes are passed on: that a robot file names a file is no reason to read it.
"""

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from lxml import etree

from jounce.core.cures import Remedy
from jounce.core.errors import one_line, quote_value
from jounce.io import files
from jounce.io.urdf import origin_pose, parse_xml, read_numbers
from jounce.io.xacro import MANIFESTS

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
    robot = parse_xml(files.read_bytes(path), str(path))
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


PACKAGES = ("ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH", "COLCON_PREFIX_PATH")  # environment variables
NO_FILE = "no such file"
OUTSIDE = Remedy(
    "not in the folders of the robot; mesh_folders=[...] allows it",
    "not in the folders of the robot; --meshes FOLDER allows it",
)


def find_mesh(uri: str, robot_file: Path, folders: Sequence[Path] = ()) -> Path | str:
    """The file that a mesh of a robot file names, or why it is not read.

    A path is relative to the robot file. A package is searched among the folders above the robot file, where it has a
    manifest, among those that ROS names in the environment, and among those that the user names, or is one of them.
    """
    scheme, _, rest = uri.partition("://")
    if rest and scheme != "file":
        found = [(path, allowed) for path, allowed in _package_candidates(rest, robot_file, folders) if path.is_file()]
        return next((path for path, allowed in found if allowed), str(OUTSIDE) if found else NO_FILE)
    path = Path(rest) if rest else robot_file.parent / uri
    if not path.is_file():
        return NO_FILE
    above = robot_file.resolve().parents
    package = [folder for folder in above if _is_package(folder)][:1]
    return path if _is_within(path, [above[0], *package, *folders]) else str(OUTSIDE)


def _package_candidates(uri: str, robot_file: Path, folders: Sequence[Path]) -> Iterator[tuple[Path, bool]]:
    """Where a file of a package, ``PACKAGE/PATH``, may be, and whether it is read from there."""
    package, _, inside = uri.partition("/")
    if package in ("", ".", "..") or Path(package).name != package:
        return
    above = list(robot_file.resolve().parents)
    for folder in [*(root / package for root in above), *(root for root in above if root.name == package)]:
        yield folder / inside, _is_package(folder) and _is_within(folder / inside, [folder])
    for folder in [*(root / package for root in folders), *(root for root in folders if root.name == package)]:
        yield folder / inside, _is_within(folder / inside, folders)
    stated = [Path(p) for name in PACKAGES for p in os.environ.get(name, "").split(os.pathsep) if p]
    for folder in [root / package for root in (*stated, *(root / "share" for root in stated))]:
        path = Path(os.path.normpath(folder / inside))
        yield path, path.is_relative_to(os.path.normpath(folder))  # links lead to sources, as colcon has it


def _is_package(folder: Path) -> bool:
    return any((folder / name).is_file() for name in MANIFESTS)


def _is_within(path: Path, folders: Sequence[Path]) -> bool:
    """Whether a file is in one of some folders, links followed."""
    return any(path.resolve().is_relative_to(folder.resolve()) for folder in folders)
