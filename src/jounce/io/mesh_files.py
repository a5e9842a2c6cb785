"""Where the meshes of a robot file are: in its folder, in its packages, and in folders that the user names.

A robot file may come from anybody, and pages with its meshes are passed on: that a robot file names a file is no reason
to read it.
"""

import os
from collections.abc import Iterator, Sequence
from pathlib import Path

from jounce.core.cures import Remedy
from jounce.io.ros_packages import MANIFESTS

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
