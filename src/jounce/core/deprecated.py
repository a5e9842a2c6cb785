"""Old names: each still works for one release, and warns with the new one."""

from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar

from jounce.core.errors import JounceError, warn

P = ParamSpec("P")
R = TypeVar("R")


def warn_of_old(old: str, new: str) -> None:
    """Warn of a name that the next release does not know, with what to write in its place."""
    warn(f"{old} is deprecated, and the next release does not know it; write {new}")


def renamed(old: str, new: str, function: Callable[P, R]) -> Callable[P, R]:
    """A function under its old name: it warns with the call to write."""

    @wraps(function)
    def called(*args: P.args, **keywords: P.kwargs) -> R:
        warn_of_old(old, new)
        return function(*args, **keywords)

    return called


def renamed_keywords(**names: str) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Let a function take keywords by their old names too, ``@renamed_keywords(old="new")``; each of them warns."""

    def taken(function: Callable[P, R]) -> Callable[P, R]:
        @wraps(function)
        def called(*args: P.args, **keywords: P.kwargs) -> R:
            for old in names.keys() & keywords.keys():
                new, call = names[old], f"{function.__name__}()"
                if new in keywords:
                    raise JounceError(f"{call} takes {old}= or {new}=, two names of one thing; write {new}= alone")
                warn_of_old(f"{old}= of {call}", f"{new}=")
                keywords[new] = keywords.pop(old)
            return function(*args, **keywords)

        return called

    return taken
