"""xacro: a URDF file written with macros, expanded to plain URDF by the package xacrodoc."""

import sys
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from io import StringIO
from pathlib import Path
from threading import Lock
from types import SimpleNamespace
from typing import Any

from jounce.core.errors import JounceError, join_names, one_line, optional_import, shorten, unknown_name_error, warn
from jounce.io.doctype import refuse_declarations
from jounce.io.files import read_bytes
from jounce.io.ros_packages import PackageSearch

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
    refuse_declarations(read_bytes(path), path)
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
