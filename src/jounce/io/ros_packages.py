"""Packages of ROS by the names in their manifests: above a file, in the environment, and around the file's package.

Workspaces keep packages next to each other, in ``src``, or one folder deeper, in repositories of several packages. A
file of one may include a file of another before anything is built or installed.
"""

from collections.abc import Callable, Iterator
from contextlib import suppress
from itertools import islice
from pathlib import Path

from jounce.core.errors import JounceError, join_names, quote_value

MANIFESTS = ("package.xml", "manifest.xml")  # one of them makes a folder a package of ROS
IGNORE_MARKS = ("COLCON_IGNORE", "AMENT_IGNORE", "CATKIN_IGNORE")  # files by which ROS passes a folder over
MAX_LEVELS_ABOVE_PACKAGE = 2  # its repository and src; above the workspace are the folders of a user, with anything
MAX_SEARCHED_FOLDERS = 4000  # around a package, about 0.1 s: workspaces have hundreds
PATH_CURE = "name its folder in the environment variable ROS_PACKAGE_PATH"
MAX_MANIFEST_BYTES = 1_000_000  # manifests have a few kB; anything may lie around a file


class PackageSearch:
    """The search for packages that a robot file names.

    Parameters
    ----------
    file : Path
        The robot file.
    installed : callable
        The folder of a package in ROS's own environment, or None.
    """

    def __init__(self, file: Path, installed: Callable[[str], str | None]) -> None:
        self.file, self.installed = file.resolve(), installed
        self.found: dict[str, Path] = {}

    def get_path(self, name: str) -> str:
        """The folder of a package; the nearest of the folders above the file, then ROS's, then of those around."""
        if name not in self.found:
            self.found[name] = self._find(name)
        return self.found[name].as_posix()

    def _find(self, name: str) -> Path:
        above = next((folder for folder in self.file.parents if read_package_name(folder) == name), None)
        if above is not None:
            return above
        installed = self.installed(name)
        if installed is not None:
            return Path(installed)
        return find_around(name, self.file)


def find_around(name: str, file: Path) -> Path:
    """The folder of a package in the folders around the package of a file, nearest first; one line where none is."""
    own = next((folder for folder in file.parents if _has_manifest(folder)), file.parent)
    # a package's neighbours; a file without a package has its own folder in their place
    levels = list(own.parents if _has_manifest(own) else [own, *own.parents])[:MAX_LEVELS_ABOVE_PACKAGE]
    searched: set[Path] = set()
    for level in levels:
        listed = dict.fromkeys(islice(_list_candidates(level), MAX_SEARCHED_FOLDERS + 1))
        candidates = [folder for folder in listed if folder not in searched]
        searched.update(candidates)
        if len(searched) > MAX_SEARCHED_FOLDERS:
            came = f"more than {MAX_SEARCHED_FOLDERS} folders to search for package {quote_value(name)} around {own}"
            raise JounceError(f"{came}; {PATH_CURE}")
        named = [folder for folder in candidates if read_package_name(folder) == name]
        if len(named) > 1:
            came = f"{len(named)} packages are named {quote_value(name)}: {join_names(map(str, named))}"
            raise JounceError(f"{came}; {PATH_CURE}")
        if named:
            return named[0]
    below = f"up to two folders below {join_names(map(str, levels))}"
    places = f"in the folders above the file, in ROS_PACKAGE_PATH, or {below}"
    raise JounceError(f"no package {quote_value(name)} {places}; {PATH_CURE}")


def read_package_name(folder: Path) -> str | None:
    """The name in the manifest of a folder; that of the folder for a manifest of rosbuild, None without any."""
    manifest, old = (folder / name for name in MANIFESTS)
    with suppress(OSError):
        if manifest.is_file() and manifest.stat().st_size <= MAX_MANIFEST_BYTES:
            return _parse_name(manifest.read_bytes())
        if old.is_file():
            return folder.name
    return None


def _parse_name(content: bytes) -> str | None:
    """The text of <name> in <package>; None in what is no manifest."""
    from lxml import etree

    parser = etree.XMLParser(resolve_entities=False, no_network=True)
    with suppress(etree.XMLSyntaxError, ValueError):
        found = etree.fromstring(content, parser).findtext("name")
        return None if found is None else str(found).strip()
    return None


def _has_manifest(folder: Path) -> bool:
    return any((folder / name).is_file() for name in MANIFESTS)


def _list_candidates(level: Path) -> Iterator[Path]:
    """The folders in a folder, and in those of them that are no packages, which hold no others."""
    for child in _list_folders(level):
        yield child
        if not _has_manifest(child):
            yield from _list_folders(child)


def _list_folders(folder: Path) -> list[Path]:
    """The folders in a folder, sorted, links resolved; none of those that ROS passes over or that cannot be read."""
    with suppress(OSError):
        inner = sorted({path.resolve() for path in folder.iterdir() if not path.name.startswith(".") and path.is_dir()})
        return [path for path in inner if not any((path / mark).exists() for mark in IGNORE_MARKS)]
    return []
