"""What jounce raises and warns of: one base class each, one line each."""

import sys
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from difflib import get_close_matches
from pathlib import Path


class JounceError(Exception):
    """Base class of everything that jounce raises: says what came, what was expected, what exists."""


class JounceWarning(UserWarning):
    """Base class of everything that jounce warns of."""


def warn(text: str) -> None:
    """Warn of something, at the line outside of jounce that called into it."""
    frame, depth = sys._getframe(1), 2
    while frame.f_back and Path(frame.f_code.co_filename).is_relative_to(Path(__file__).parent):
        frame, depth = frame.f_back, depth + 1
    warnings.warn(text, JounceWarning, stacklevel=depth)


@contextmanager
def at(place: object) -> Iterator[None]:
    """Inside, refusals begin with the place, a file or a line of one, that they come from."""
    try:
        yield
    except JounceError as error:
        raise JounceError(f"{place}: {error}") from None


def no_such(kind: str, name: object, existing: Iterable[str]) -> JounceError:
    """The error for an unknown name: the nearest valid one first, then all that exist."""
    known, said = list(existing), str(name)
    near = get_close_matches(said, known, n=1)
    hint = f"; did you mean {near[0]!r}?" if near else ";"
    return JounceError(f"no {kind} {shortened(said)!r}{hint} there are: {listed(known) or 'none'}")


def listed(names: Iterable[str], most: int = 24) -> str:
    """Names in a row, on one line whatever they hold, the first of them where they are many."""
    shown = [name if name.isprintable() else repr(name) for name in names]
    rest = f", ... ({len(shown)} in all)" if len(shown) > most else ""
    return ", ".join(shown[:most]) + rest


def shortened(text: str, most: int = 80) -> str:
    """A text cut to a length that a message bears."""
    return text if len(text) <= most else f"{text[:most]}..."


def one_line(error: object) -> str:
    """What another library's error says, on one line."""
    return " ".join(str(error).split())
