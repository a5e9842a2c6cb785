"""Reads the shapes by which a URDF shows its links.

`read_visuals` gives boxes, cylinders, spheres and meshes, `read_mesh` the triangles of one. `find_mesh` searches a mesh
in the folder of the robot file, in its packages, and in folders that the user names. A robot file may come from
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
    """A shape that is fixed on a link.

    `T` is its pose in the frame of the link. `size` holds the sides of a box, the radius and length of a cylinder, the
    radius of a sphere, m, or the scale of a mesh; a cylinder lies along z.
    """

    link: str
    T: np.ndarray
    kind: str
    size: np.ndarray
    mesh: str = ""


def read_visuals(path: Path) -> list[Visual]:
    """Return the visuals of a URDF.

    Robot files of other types have none.
    """
    if path.suffix.lower() != URDF_SUFFIX:
        return []
    robot = parse_xml(files.read_bytes(path), str(path))
    visuals: list[Visual] = []
    for link in robot.iterchildren("link"):
        if link.get("name"):
            for element in link.iterchildren("visual"):
                visuals += _read_visual(element, link, path)
    return visuals


def robot_visuals(m: "Mechanism", path: Path) -> list[Visual]:
    """Return the visuals of links that the robot has.

    `--root` may have left some out.
    """
    names = set(m.frame_names)
    return [visual for visual in read_visuals(path) if visual.link in names]


def _read_visual(visual: etree._Element, link: etree._Element, path: Path) -> Iterator[Visual]:
    """Yield the shapes of a <visual> that can be drawn."""
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
    """Return the triangles of a visual, or why it cannot be drawn.

    The triangles are a `trimesh.Trimesh`; the reason is a text.
    """
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
            # Lists of whole addresses would leave no space for reasons.
            name = quote_value(visual.mesh.rpartition("/")[2])
            mesh_file = find_mesh(visual.mesh, path, folders)
            if isinstance(mesh_file, str):
                return f"{name} ({mesh_file})"
            try:
                mesh = trimesh.load(mesh_file, force="mesh", resolver=_folder_resolver(mesh_file))
            except Exception as error:  # readers of meshes raise anything
                return f"{name} ({one_line(str(error))})"
            if len(mesh.faces) == 0:
                return f"{name} (no triangles)"
            mesh.apply_transform(np.diag([*visual.size, 1]))
            return mesh
    mesh.visual.face_colors = SHAPE_COLOR
    return mesh


def _folder_resolver(mesh: Path) -> Any:
    """Return the resolver of materials and textures that a mesh names.

    It searches in the folder of the mesh only.
    """
    from trimesh.resolvers import FilePathResolver

    class OwnFolder(FilePathResolver):
        def get(self, name: str) -> bytes:
            folder = mesh.resolve().parent
            if not (folder / name.strip()).resolve().is_relative_to(folder):
                raise ValueError(f"{quote_value(name)} is outside of the folder of the mesh")
            content: bytes = super().get(name)
            return content

    return OwnFolder(str(mesh))


PACKAGES = ("ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH", "COLCON_PREFIX_PATH")  # environment variables
NO_FILE = "no such file"
OUTSIDE = Remedy(
    "not in the folders of the robot; mesh_folders=[...] allows it",
    "not in the folders of the robot; --meshes FOLDER allows it",
)


def find_mesh(uri: str, robot_file: Path, folders: Sequence[Path] = ()) -> Path | str:
    """Return the file that a mesh names, or why none is read.

    A path is relative to the robot file. A package is searched among the folders above the robot file, where it has a
    manifest, among those that ROS names in the environment, and among those that the user names, or is one of them.
    """
    scheme, _, address = uri.partition("://")
    # package://PACKAGE/PATH: the first candidate that is a file, and in a folder from which files are read.
    if address != "" and scheme != "file":
        is_outside = False
        for candidate, is_allowed in _package_candidates(address, robot_file, folders):
            if candidate.is_file() and is_allowed:
                return candidate
            is_outside = is_outside or candidate.is_file()
        return str(OUTSIDE) if is_outside else NO_FILE
    # A path is read from the folder of the robot file, or from its package or a folder of the user.
    path = Path(address) if address != "" else robot_file.parent / uri
    if not path.is_file():
        return NO_FILE
    above = robot_file.resolve().parents
    package = [folder for folder in above if _is_package(folder)][:1]
    return path if _is_within(path, [above[0], *package, *folders]) else str(OUTSIDE)


def _package_candidates(uri: str, robot_file: Path, folders: Sequence[Path]) -> Iterator[tuple[Path, bool]]:
    """Yield paths where a package's file may be, with a flag.

    The uri is ``PACKAGE/PATH``; the flag is whether the file is read from there.
    """
    package, _, inside = uri.partition("/")
    if package in ("", ".", "..") or Path(package).name != package:
        return
    # The package is a folder next to, or above, the robot file; a manifest shows that it is one.
    above = list(robot_file.resolve().parents)
    for folder in [*(root / package for root in above), *(root for root in above if root.name == package)]:
        yield folder / inside, _is_package(folder) and _is_within(folder / inside, [folder])
    for folder in [*(root / package for root in folders), *(root for root in folders if root.name == package)]:
        yield folder / inside, _is_within(folder / inside, folders)
    # ROS names folders of packages in the environment. Links are not followed there: with colcon they lead to sources.
    ros_folders = [Path(p) for name in PACKAGES for p in os.environ.get(name, "").split(os.pathsep) if p != ""]
    for folder in [root / package for root in (*ros_folders, *(root / "share" for root in ros_folders))]:
        path = Path(os.path.normpath(folder / inside))
        yield path, path.is_relative_to(os.path.normpath(folder))


def _is_package(folder: Path) -> bool:
    return any((folder / name).is_file() for name in MANIFESTS)


def _is_within(path: Path, folders: Sequence[Path]) -> bool:
    """Return whether a file is in one of some folders, links followed."""
    return any(path.resolve().is_relative_to(folder.resolve()) for folder in folders)
