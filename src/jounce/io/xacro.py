"""Expands xacro, URDF written with macros, to plain URDF by the package xacrodoc.

`expand` runs xacro with checks, and with a search for the packages of ROS that the file names. `PackageSearch` finds
these by the names in their manifests: above a file, in the environment, and around the file's package. Workspaces keep
packages next to each other, in ``src``, or one folder deeper, in repositories of several packages. A file of one may
include a file of another before anything is built or installed.
"""

import sys
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from io import StringIO
from itertools import islice
from pathlib import Path
from threading import Lock
from types import SimpleNamespace
from typing import Any

from jounce.core.errors import (
    JounceError,
    join_names,
    one_line,
    optional_import,
    quote_value,
    shorten,
    unknown_name_error,
    warn,
)
from jounce.io import files
from jounce.io.urdf import refuse_declarations

MAX_MACRO_DEPTH = (
    32  # of calls of a macro within itself with the same arguments: recursion that counts down differs in them
)
_EXPANDING = Lock()  # xacro and xacrodoc keep files, macros and packages in variables of their modules


class _Arguments(dict[str, str]):
    """Arguments that record the names that xacro looks up."""

    def __init__(self, given: Mapping[str, object]) -> None:
        super().__init__({name: str(value) for name, value in given.items()})
        self.asked: set[str] = set()

    def __contains__(self, name: object) -> bool:
        self.asked.add(str(name))
        return super().__contains__(name)

    def __getitem__(self, name: str) -> str:
        self.asked.add(name)
        return super().__getitem__(name)


def expand(path: Path, arguments: Mapping[str, object]) -> bytes:
    """Expand a xacro file with arguments for its <xacro:arg>; packages are searched as `PackageSearch` does.

    Unlike all other readers, xacro evaluates expressions in the file, in a subset of Python.
    """
    refuse_declarations(files.read_bytes(path), path)
    if not isinstance(arguments, Mapping):
        raise JounceError(f"xacro_args is of type {type(arguments).__name__}; expected a mapping of names and values")
    with optional_import(f"{path}: xacro files need the package xacrodoc", "xacro"):
        from xacrodoc import packages  # first: it makes xacro look for packages by it
    import xacro

    said, given = StringIO(), _Arguments(arguments)
    prints = SimpleNamespace(**vars(sys) | {"stderr": said})  # of xacro alone: other threads keep their stderr
    try:
        with (
            _EXPANDING,
            _replace_names(packages, _finder=packages._finder),
            _replace_names(xacro.color, sys=prints),
            _replace_names(xacro, sys=prints, **_build_checked_functions(xacro)),
        ):
            packages._finder = PackageSearch(path, _find_installed(packages))
            document = xacro.process_file(str(path), mappings=given)
    except Exception as error:  # of xacro, its parser, or of the expressions in the file
        ours = getattr(error, "exc", error)  # behind xacro's own error, which says less
        if isinstance(ours, JounceError):
            raise JounceError(f"{path}: xacro: {ours}") from None
        raise JounceError(f"{path}: xacro: {one_line(error) or type(error).__name__}") from None
    for name in arguments:
        if name not in given.asked:
            raise JounceError(f"{path}: {unknown_name_error('xacro argument', name, sorted(given.asked))}")
    if said.getvalue().strip():
        warn(f"{path}: xacro: {one_line(said.getvalue())}")
    return document.toprettyxml(indent="  ").encode()  # the lines that `xacro FILE` writes


def _find_installed(packages: Any) -> Callable[[str], str | None]:
    """A function that returns the folder of a package in ROS's environment, or None.

    A finder remembers where each package was: two checkouts may hold one of the same name.
    """
    finder = packages.PackageFinder()

    def find(name: str) -> str | None:
        try:
            return str(finder.get_path(name))
        except packages.PackageNotFoundError:
            return None

    return find


@contextmanager
def _replace_names(module: Any, **others: Any) -> Iterator[None]:
    """Within this context, a module has other values for some of its names."""
    before = {name: getattr(module, name) for name in others}
    vars(module).update(others)
    try:
        yield
    finally:
        vars(module).update(before)


def _build_checked_functions(xacro: Any) -> dict[str, Callable[..., Any]]:
    """The functions of xacro that expand macros and read files, with checks.

    Macros and files that call themselves without end are refused before Python's stack ends, much later; so are
    included files whose document type has declarations, which xacro's parser resolves.
    """
    call, include = xacro.handle_macro_call, xacro.parse
    calls: Counter[str] = Counter()

    def checked_call(node: Any, macros: Any, symbols: Any) -> Any:
        asked = " ".join([node.tagName, *(f"{k}={xacro.eval_text(v, symbols)}" for k, v in node.attributes.items())])
        calls[asked] += 1
        if calls[asked] > MAX_MACRO_DEPTH:
            raise JounceError(f"<{shorten(asked)}> calls itself without end")
        try:
            return call(node, macros, symbols)
        finally:
            calls[asked] -= 1

    def checked_include(given: Any, name: str | None = None) -> Any:
        if given is None and xacro.filestack.count(name) > 1:
            turn = xacro.filestack[xacro.filestack.index(name) : -1]
            files = [shorten(Path(str(file)).name) for file in turn]
            between = f", by {join_names(files[1:])}" if files[1:] else ""
            raise JounceError(f"{files[0]} includes itself{between}")
        if given is None and (path := Path(xacro.root_dir, str(name))).is_file():
            refuse_declarations(path.read_bytes(), path)
        return include(given, name)

    return {"handle_macro_call": checked_call, "parse": checked_include}


# Packages of ROS by their names.
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
