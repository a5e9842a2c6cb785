"""xacro: a URDF file written with macros, expanded to plain URDF by the package xacrodoc."""

import sys
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from io import StringIO
from pathlib import Path
from threading import Lock
from types import SimpleNamespace
from typing import Any

from jounce.core.errors import JounceError, no_such, one_line, quoted, shortened, warn
from jounce.io.doctype import refuse_declarations
from jounce.io.files import read_bytes

MAX_MACRO_DEPTH = (
    32  # of calls of a macro within itself with the same arguments: recursion that counts down differs in them
)
_EXPANDING = Lock()  # xacro and xacrodoc keep files, macros and packages in variables of their modules


class _Arguments(dict[str, str]):
    """Arguments that know which names xacro has asked for."""

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
    """Expand a xacro file with arguments for its <xacro:arg>; packages are searched in the folders above the file.

    Unlike all other readers, xacro evaluates expressions in the file, in a subset of Python.
    """
    refuse_declarations(read_bytes(path), path)
    if not isinstance(arguments, Mapping):
        raise JounceError(f"xacro_args is of type {type(arguments).__name__}; expected a mapping of names and values")
    try:
        from xacrodoc import packages  # first: it makes xacro look for packages by it
    except ImportError:
        install = "pip install 'jounce[xacro]'"
        raise JounceError(f"{path}: xacro files need the package xacrodoc; install it by: {install}") from None
    import xacro

    said, given = StringIO(), _Arguments(arguments)
    try:
        with (
            _EXPANDING,
            _packages_above(path, packages),
            _messages_into(said, xacro),
            _declarations_refused(xacro),
            _endless_calls_refused(xacro),
        ):
            document = xacro.process_file(str(path), mappings=given)
    except Exception as error:  # of xacro, its parser, or of the expressions in the file
        absent = getattr(error, "exc", None)
        if isinstance(absent, packages.PackageNotFoundError):
            places = "in the folders above the file or in ROS_PACKAGE_PATH"
            raise JounceError(f"{path}: xacro: no package {quoted(absent.args[0])} {places}") from None
        message = one_line(error) or type(error).__name__
        raise JounceError(f"{path}: xacro: {message}") from None
    for name in arguments:
        if name not in given.asked:
            raise JounceError(f"{path}: {no_such('xacro argument', name, sorted(given.asked))}")
    if said.getvalue().strip():
        warn(f"{path}: xacro: {one_line(said.getvalue())}")
    return document.toprettyxml(indent="  ").encode()  # the lines that `xacro FILE` writes


@contextmanager
def _packages_above(path: Path, packages: Any) -> Iterator[None]:
    """Inside, packages are searched in the folders above a file too.

    A new finder does it, since a finder remembers where each package was: two checkouts may hold one of the same name.
    """
    before = packages._finder
    packages.reset()
    packages.walk_up_from(path)
    try:
        yield
    finally:
        packages._finder = before


@contextmanager
def _messages_into(said: StringIO, xacro: Any) -> Iterator[None]:
    """Inside, xacro prints its messages there; stderr stays as it is for the other threads."""

    modules, own = (xacro, xacro.color), SimpleNamespace(**vars(sys) | {"stderr": said})
    for module in modules:
        module.sys = own
    try:
        yield
    finally:
        for module in modules:
            module.sys = sys


@contextmanager
def _endless_calls_refused(xacro: Any) -> Iterator[None]:
    """Inside, macros and files that call themselves without end are refused before Python's stack ends, much later."""
    call, include = xacro.handle_macro_call, xacro.parse
    calls: Counter[str] = Counter()

    def checked_call(node: Any, macros: Any, symbols: Any) -> Any:
        asked = " ".join([node.tagName, *(f"{k}={xacro.eval_text(v, symbols)}" for k, v in node.attributes.items())])
        calls[asked] += 1
        if calls[asked] > MAX_MACRO_DEPTH:
            raise JounceError(f"<{shortened(asked)}> calls itself without end")
        try:
            return call(node, macros, symbols)
        finally:
            calls[asked] -= 1

    def checked_include(given: Any, name: str | None = None) -> Any:
        if given is None and xacro.filestack.count(name) > 1:
            raise JounceError(f"{shortened(Path(str(name)).name)} includes itself")
        return include(given, name)

    xacro.handle_macro_call, xacro.parse = checked_call, checked_include
    try:
        yield
    finally:
        xacro.handle_macro_call, xacro.parse = call, include


@contextmanager
def _declarations_refused(xacro: Any) -> Iterator[None]:
    """Within this context, xacro includes no file whose document type has declarations: its parser resolves them."""
    parse = xacro.parse

    def checked(given: Any, name: str | None = None) -> Any:
        if given is None and (path := Path(xacro.root_dir, str(name))).is_file():
            refuse_declarations(path.read_bytes(), path)
        return parse(given, name)

    xacro.parse = checked
    try:
        yield
    finally:
        xacro.parse = parse
