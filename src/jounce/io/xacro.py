"""Expands xacro, URDF with macros, to plain URDF by xacrodoc.

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

# Of calls of a macro within itself with the same arguments: recursion that counts down has other arguments each time.
MAX_MACRO_DEPTH = 32
_EXPANDING = Lock()  # xacro and xacrodoc keep files, macros and packages in variables of their modules


class _Arguments(dict[str, str]):
    """Arguments that record the names that xacro looks up."""

    def __init__(self, arguments: Mapping[str, object]) -> None:
        super().__init__({name: str(value) for name, value in arguments.items()})
        self.names_in_file: set[str] = set()

    def __contains__(self, name: object) -> bool:
        self.names_in_file.add(str(name))
        return super().__contains__(name)

    def __getitem__(self, name: str) -> str:
        self.names_in_file.add(name)
        return super().__getitem__(name)


def expand(path: Path, arguments: Mapping[str, object]) -> bytes:
    """Expand a xacro file with arguments for its <xacro:arg>.

    Packages are searched as `PackageSearch` does. Unlike all other readers, xacro evaluates expressions in the file, in
    a subset of Python.
    """
    refuse_declarations(files.read_bytes(path), path)
    if not isinstance(arguments, Mapping):
        raise JounceError(f"xacro_args is of type {type(arguments).__name__}; expected a mapping of names and values")
    with optional_import(f"{path}: xacro files need the package xacrodoc", "xacro"):
        from xacrodoc import packages  # first: it makes xacro look for packages by it
    import xacro

    # What xacro prints is collected: of xacro alone, so that other threads keep their stderr.
    printed, recorded_arguments = StringIO(), _Arguments(arguments)
    system = SimpleNamespace(**vars(sys) | {"stderr": printed})
    try:
        with (
            _EXPANDING,
            _replace_names(packages, _finder=packages._finder),
            _replace_names(xacro.color, sys=system),
            _replace_names(xacro, sys=system, **_build_checked_functions(xacro)),
        ):
            packages._finder = PackageSearch(path, _find_installed(packages))
            document = xacro.process_file(str(path), mappings=recorded_arguments)
            # Lines are those that `xacro FILE` writes, so that numbers of lines in messages fit them.
            text = document.toprettyxml(indent="  ")
    except Exception as error:  # of xacro, its parser, or of the expressions in the file
        # An error of jounce stands behind xacro's own, which says less.
        cause = getattr(error, "exc", error)
        if isinstance(cause, JounceError):
            raise JounceError(f"{path}: xacro: {cause}") from None
        raise JounceError(f"{path}: xacro: {one_line(error) or type(error).__name__}") from None
    # An argument that the file never looks up has a typing error.
    names_in_file = recorded_arguments.names_in_file
    for name in arguments:
        if name not in names_in_file:
            raise JounceError(f"{path}: {unknown_name_error('xacro argument', name, sorted(names_in_file))}")
    if printed.getvalue().strip() != "":
        warn(f"{path}: xacro: {one_line(printed.getvalue())}")
    return text.encode()


def _find_installed(packages: Any) -> Callable[[str], str | None]:
    """Return the function that finds a package in ROS's environment.

    It returns the folder of the package, or None. A finder remembers where each package was: two checkouts may hold one
    of the same name.
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
    """Replace the values of some names of a module within this context."""
    former_values = {name: getattr(module, name) for name in others}
    vars(module).update(others)
    try:
        yield
    finally:
        vars(module).update(former_values)


def _build_checked_functions(xacro: Any) -> dict[str, Callable[..., Any]]:
    """Return xacro's functions that expand and read files, with checks.

    Macros and files that call themselves without end are refused before Python's stack ends, much later; so are
    included files whose document type has declarations, which xacro's parser resolves.
    """
    call, include = xacro.handle_macro_call, xacro.parse
    calls: Counter[str] = Counter()

    def checked_call(node: Any, macros: Any, symbols: Any) -> Any:
        # A call is the macro with the values of its arguments, where it is under way.
        attributes = [f"{k}={xacro.eval_text(v, symbols)}" for k, v in node.attributes.items()]
        words = " ".join([node.tagName, *attributes])
        calls[words] += 1
        if calls[words] > MAX_MACRO_DEPTH:
            raise JounceError(f"<{shorten(words)}> calls itself without end")
        try:
            return call(node, macros, symbols)
        finally:
            calls[words] -= 1

    def checked_include(document: Any, name: str | None = None) -> Any:
        # Without a document xacro reads the file of the name, which is on its stack already.
        if document is None and xacro.filestack.count(name) > 1:
            circle = xacro.filestack[xacro.filestack.index(name) : -1]
            file_names = [shorten(Path(str(file)).name) for file in circle]
            between = f", by {join_names(file_names[1:])}" if len(file_names) > 1 else ""
            raise JounceError(f"{file_names[0]} includes itself{between}")
        if document is None:
            path = Path(xacro.root_dir, str(name))
            if path.is_file():
                refuse_declarations(path.read_bytes(), path)
        return include(document, name)

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
        """Return the folder of a package.

        It is the nearest of the folders above the file, then ROS's, then one around the file.
        """
        if name not in self.found:
            self.found[name] = self._find(name)
        return self.found[name].as_posix()

    def _find(self, name: str) -> Path:
        """Return the folder of a package that is not found yet."""
        above = next((folder for folder in self.file.parents if read_package_name(folder) == name), None)
        if above is not None:
            return above
        installed = self.installed(name)
        if installed is not None:
            return Path(installed)
        return find_around(name, self.file)


def find_around(name: str, file: Path) -> Path:
    """Return the folder of a package around the package of a file.

    The nearest folder counts; a `JounceError` lists the folders that were searched without success.
    """
    own_package = next((folder for folder in file.parents if _has_manifest(folder)), file.parent)
    # Neighbours of the package are searched; a file without a package has its own folder in their place.
    above = own_package.parents if _has_manifest(own_package) else [own_package, *own_package.parents]
    levels = list(above)[:MAX_LEVELS_ABOVE_PACKAGE]
    searched: set[Path] = set()
    for level in levels:
        listed = dict.fromkeys(islice(_list_candidates(level), MAX_SEARCHED_FOLDERS + 1))
        candidates = [folder for folder in listed if folder not in searched]
        searched.update(candidates)
        if len(searched) > MAX_SEARCHED_FOLDERS:
            count_words = f"more than {MAX_SEARCHED_FOLDERS} folders to search"
            came = f"{count_words} for package {quote_value(name)} around {own_package}"
            raise JounceError(f"{came}; {PATH_CURE}")
        packages = [folder for folder in candidates if read_package_name(folder) == name]
        if len(packages) > 1:
            came = f"{len(packages)} packages are named {quote_value(name)}: {join_names(map(str, packages))}"
            raise JounceError(f"{came}; {PATH_CURE}")
        if len(packages) == 1:
            return packages[0]
    below = f"up to two folders below {join_names(map(str, levels))}"
    places = f"in the folders above the file, in ROS_PACKAGE_PATH, or {below}"
    raise JounceError(f"no package {quote_value(name)} {places}; {PATH_CURE}")


def read_package_name(folder: Path) -> str | None:
    """Return the name in the manifest of a folder, None without any.

    A manifest of rosbuild has no name: the package is called as its folder.
    """
    manifest, rosbuild_manifest = (folder / name for name in MANIFESTS)
    with suppress(OSError):
        if manifest.is_file() and manifest.stat().st_size <= MAX_MANIFEST_BYTES:
            return _parse_name(manifest.read_bytes())
        if rosbuild_manifest.is_file():
            return folder.name
    return None


def _parse_name(content: bytes) -> str | None:
    """Return the text of <name> in <package>, None in other files."""
    from lxml import etree

    parser = etree.XMLParser(resolve_entities=False, no_network=True)
    with suppress(etree.XMLSyntaxError, ValueError):
        name = etree.fromstring(content, parser).findtext("name")
        return None if name is None else str(name).strip()
    return None


def _has_manifest(folder: Path) -> bool:
    return any((folder / name).is_file() for name in MANIFESTS)


def _list_candidates(level: Path) -> Iterator[Path]:
    """Yield the folders in a folder, one level deeper outside packages.

    Packages hold no others.
    """
    for child in _list_folders(level):
        yield child
        if not _has_manifest(child):
            yield from _list_folders(child)


def _list_folders(folder: Path) -> list[Path]:
    """Return the folders in a folder, sorted, links resolved.

    Folders that ROS passes over, or that cannot be read, are left out.
    """
    with suppress(OSError):
        folders = sorted(
            {path.resolve() for path in folder.iterdir() if not path.name.startswith(".") and path.is_dir()}
        )
        return [path for path in folders if not any((path / mark).exists() for mark in IGNORE_MARKS)]
    return []
