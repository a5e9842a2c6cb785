"""Old names: each still works for one release, and warns with the new one."""

from collections.abc import Callable
from functools import wraps
from typing import Any, TypeVar

from jounce.core.errors import JounceError, warn

F = TypeVar("F", bound=Callable[..., Any])


def warn_deprecated(old: str, new: str) -> None:
    """Warn of a name that the next release does not know, with what to write in its place."""
    warn(f"{old} is deprecated, and the next release does not know it; write {new}")


def deprecate_function(old: str, new: str, function: F) -> F:
    """A function under its old name: it warns with the call to write."""

    @wraps(function)
    def called(*args: Any, **keywords: Any) -> Any:
        warn_deprecated(old, new)
        return function(*args, **keywords)

    called.__name__ = called.__qualname__ = old.removesuffix("()")
    called.__doc__ = f"Do as ``{new}``, whose old name this is."
    return called  # type: ignore[return-value]  # type checkers know the function alone


def deprecate_keywords(**names: str) -> Callable[[F], F]:
    """Let a function take keywords by their old names too, ``@renamed_keywords(old="new")``, with a warning."""

    def taken(function: F) -> F:
        @wraps(function)
        def called(*args: Any, **keywords: Any) -> Any:
            for old in names.keys() & keywords.keys():
                new, call = names[old], f"{function.__name__}()"
                if new in keywords:
                    raise JounceError(f"{call} takes {old}= or {new}=, two names of one thing; write {new}= alone")
                warn_deprecated(f"{old}= of {call}", f"{new}=")
                keywords[new] = keywords.pop(old)
            return function(*args, **keywords)

        return called  # type: ignore[return-value]  # type checkers know the function alone

    return taken
