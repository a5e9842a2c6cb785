"""What jounce raises and warns of: one base class each, one line each."""

from collections.abc import Iterable
from difflib import get_close_matches


class JounceError(Exception):
    """Base class of everything that jounce raises: says what came, what was expected, what exists."""


class JounceWarning(UserWarning):
    """Base class of everything that jounce warns of."""


def no_such(kind: str, name: object, existing: Iterable[str]) -> JounceError:
    """The error for an unknown name: the nearest valid one first, then all that exist."""
    known = list(existing)
    near = get_close_matches(str(name), known, n=1)
    hint = f"; did you mean {near[0]!r}?" if near else ";"
    return JounceError(f"no {kind} {str(name)!r}{hint} there are: {listed(known) or 'none'}")


def listed(names: Iterable[str]) -> str:
    """Names in a row, on one line whatever they hold."""
    return ", ".join(name if name.isprintable() else repr(name) for name in names)


def one_line(error: object) -> str:
    """What another library's error says, on one line."""
    return " ".join(str(error).split())
