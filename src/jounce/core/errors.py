"""Errors and warnings of jounce: one class each, with messages of one line."""

import sys
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from copy import copy
from functools import wraps
from pathlib import Path
from reprlib import Repr
from types import FrameType, FunctionType
from typing import Any, Self, TypeVar

F = TypeVar("F", bound=Callable[..., Any])

PACKAGE = Path(__file__).parents[1]
# libraries through which jounce calls itself, in decorators and callbacks:
CALLING_LIBRARIES = ("contextlib", "numpy", "scipy")
MAX_QUOTED_LENGTH = 80  # characters of one cell, name or value in a message: the rest of the line says what is wrong
OPERATORS = ("__call__", "__add__")  # public methods whose names have underscores
MAX_MESSAGE_LENGTH = 3000  # characters: a path has up to 4096, and a message may quote it twice


class JounceError(Exception):
    """Base class of all errors of jounce.

    The message says what was given, what was expected, and what exists.
    """

    def __init__(self, text: object = "") -> None:
        super().__init__(_safe_message(str(text)))

    def __copy__(self) -> Self:  # subclasses take other arguments than they keep
        error = type(self).__new__(type(self), *self.args)
        vars(error).update(vars(self))
        return error


class UncertainError(JounceError):
    """Results have errors above 1e-6 of their size.

    Those of a closed robot near a singular position, and accelerations and their rates where damping, friction or
    springs are steep for the inertia that they move.

    Attributes
    ----------
    results : tuple of arrays
        The results, NaN where they are uncertain.
    names : tuple of str
        Their names.
    uncertain : tuple of arrays of bool
        Where they are uncertain, over the batch.
    """

    def __init__(self, text: str, results: tuple[Any, ...], names: Iterable[str], uncertain: Iterable[Any]) -> None:
        super().__init__(text)
        self.results, self.names, self.uncertain = results, tuple(names), tuple(uncertain)

    def __reduce__(self) -> tuple[Any, ...]:  # between processes
        return type(self), (str(self), self.results, self.names, self.uncertain)


class JounceWarning(UserWarning):
    """Base class of all warnings of jounce."""

    def __init__(self, text: object = "") -> None:
        super().__init__(_safe_message(str(text)))


for _public in (JounceError, UncertainError, JounceWarning):  # as tracebacks name them
    _public.__module__ = "jounce"


def door(target: F) -> F:
    """Return a function or a class whose errors leave in one frame.

    Of a class, these are the public methods. Users see their own line and the message, rather than the steps between
    them. The error that leaves is a copy, of the same kind and with the same data. The first one, with all its frames,
    is its `__context__`.
    """
    if isinstance(target, type):
        for name, method in list(vars(target).items()):
            if name.startswith("_") and name not in OPERATORS:
                continue
            if isinstance(method, classmethod | staticmethod):
                setattr(target, name, type(method)(_with_door(method.__func__)))
            elif isinstance(method, FunctionType):
                setattr(target, name, _with_door(method))
        return target
    return _with_door(target)


def _with_door(function: F) -> F:
    @wraps(function)
    def call(*given: Any, **options: Any) -> Any:
        try:
            return function(*given, **options)
        except JounceError as error:
            raise copy(error) from None

    return call  # type: ignore[return-value]


_collected: ContextVar[list[str] | None] = ContextVar("_collected", default=None)


@contextmanager
def collect_warnings() -> Iterator[list[str]]:
    """Collect the warnings of this thread in a list within this context.

    The contexts of `warnings` act on all threads.
    """
    texts: list[str] = []
    token = _collected.set(texts)
    try:
        yield texts
    finally:
        _collected.reset(token)


def warn(text: str) -> None:
    """Warn at the line outside of jounce that called into it.

    Libraries through which jounce calls itself count as inside.
    """
    collected = _collected.get()
    if collected is not None:
        collected.append(str(JounceWarning(text)))
        return
    frame, depth = sys._getframe(1), 2
    while frame.f_back and _is_inside(frame):
        frame, depth = frame.f_back, depth + 1
    warnings.warn(text, JounceWarning, stacklevel=depth)


def _is_inside(frame: FrameType) -> bool:
    library = str(frame.f_globals.get("__name__")).partition(".")[0]
    return library in CALLING_LIBRARIES or Path(frame.f_code.co_filename).is_relative_to(PACKAGE)


@contextmanager
def optional_import(need: str, extra: str) -> Iterator[None]:
    """Raise `JounceError` with the cure if an import fails within this context.

    `need` says what needs which library; the cure installs an extra of jounce.
    """
    try:
        yield
    except ImportError:
        raise JounceError(f"{need}; install it by: pip install 'jounce[{extra}]'") from None


@contextmanager
def locate_errors(place: object) -> Iterator[None]:
    """Put a place ahead of the errors within this context: a file, or a line of a file.

    An empty place adds nothing.
    """
    try:
        yield
    except JounceError as error:
        raise JounceError(f"{place}: {error}" if place != "" else error) from None


def unknown_name_error(kind: str, name: object, existing: Iterable[str], owner: str = "") -> JounceError:
    """Return the error for an unknown name: the nearest valid one, then all of `owner`."""
    from difflib import get_close_matches  # imported here to keep start-up fast

    names = list(existing)
    nearest = get_close_matches(_cut_text(name, MAX_QUOTED_LENGTH), names, n=1) if isinstance(name, str) else []
    hint = f"; did you mean {quote_value(nearest[0])}?" if len(nearest) > 0 else ";"
    unknown = f"{owner} has no {kind}" if owner else f"unknown {kind}"
    return JounceError(f"{unknown} {quote_value(name)}{hint} available: {join_names(names) or 'none'}")


def check_choice(kind: str, name: object, existing: Iterable[str], owner: str = "") -> str:
    """Return a caller's name if it exists.

    A value of any other type is refused like an unknown name.
    """
    names = list(existing)
    if not isinstance(name, str) or name not in names:  # arrays do not compare to a string
        raise unknown_name_error(kind, name, names, owner)
    return name


def as_list(value: object) -> list[Any]:
    """Return a list of a caller's value: the items of an iterable, or the single item."""
    if isinstance(value, str) or not isinstance(value, Iterable):
        return [value]
    try:
        return list(value)
    except Exception:  # arrays without axes, and errors of any foreign type
        return [value]


def check_bool(label: str, value: object, meaning: str) -> bool:
    """Return a caller's bool; raise for other types, truthy ones too."""
    if not isinstance(value, bool):
        raise JounceError(f"{label} is {quote_value(value)}; expected True or False: {meaning}")
    return value


def join_names(names: Iterable[str], most: int = 24) -> str:
    """Join names with commas; of many, only the first.

    Each is as `shorten` shows it.
    """
    shown = [shorten(name) for name in names]
    ending = f", ... ({len(shown)} in all)" if len(shown) > most else ""
    return ", ".join(shown[:most]) + ending


def quote_value(value: object) -> str:
    """Return the repr of a value, cut for a message."""
    if isinstance(value, str):
        return repr(_cut_text(str(value), MAX_QUOTED_LENGTH))
    return one_line(_BRIEF.repr(value), MAX_QUOTED_LENGTH)


def one_line(error: object, most: int = 300) -> str:
    """Return the message of another library's error on one line."""
    return shorten(" ".join(str(error).split()), most)


def _safe_message(text: str) -> str:
    """Return a message without control characters.

    Of one that is too long it has the ends, with the value and the cure.
    """
    text = escape_text(text)
    half = (MAX_MESSAGE_LENGTH - 3) // 2
    return text if len(text) <= MAX_MESSAGE_LENGTH else f"{text[:half]}...{text[-half:]}"


def shorten(text: str, most: int = MAX_QUOTED_LENGTH) -> str:
    """Return a string that is safe in a message: cut, and without control characters."""
    return escape_text(_cut_text(text, most))


def escape_text(text: str) -> str:
    """Escape characters that are not printable, as Python does."""
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def _cut_text(text: str, most: int) -> str:
    return text if len(text) <= most else f"{text[:most]}..."


class _ShortRepr(Repr):
    """Short reprs of values in messages: a few lines of YAML with aliases can make trees of any size."""

    def repr1(self, x: Any, level: int) -> str:
        """Return the repr of a value.

        Numbers of NumPy have no type in it.
        """
        is_scalar = getattr(x, "shape", None) == () and not hasattr(x, "__array_function__")  # which arrays have
        if type(x).__module__ != "numpy" or not is_scalar:
            return super().repr1(x, level)
        return repr(x[:]) if isinstance(x, str | bytes) else str(x)  # slices of texts are Python's own

    def repr_int(self, x: int, level: int) -> str:
        try:
            return super().repr_int(x, level)
        except ValueError:  # Python writes no integer of more than 4,300 digits
            return f"an integer of {x.bit_length()} bits"


_BRIEF = _ShortRepr()
_BRIEF.maxlevel, _BRIEF.maxlist, _BRIEF.maxstring, _BRIEF.maxother = 2, 4, 60, 60
