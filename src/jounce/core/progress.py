"""Progress of long work: it says what it does and how far it is, to a listener, if there is one.

Work states its stages wherever they are, however deep; nothing is passed through the calls between. A command on a
terminal listens, and shows a line.
"""

from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager
from contextvars import ContextVar
from typing import Protocol, TypeVar

T = TypeVar("T")

Advance = Callable[..., None]  # of how much is done and of how much in all; of the states computed too, for their rate


class Listener(Protocol):
    """What shows the progress of work."""

    def stage(self, label: str) -> AbstractContextManager[Advance]:
        """Begin and end a stage; it may lie within another one."""


_listener: ContextVar[Listener | None] = ContextVar("_listener", default=None)


@contextmanager
def listen(listener: Listener) -> Iterator[None]:
    """Report all stages to a listener within this context."""
    token = _listener.set(listener)
    try:
        yield
    finally:
        _listener.reset(token)


@contextmanager
def stage(label: str) -> Iterator[Advance]:
    """Begin and end a stage, and yield its progress function.

    The function reports how far the stage is.
    """
    listener = _listener.get()
    if listener is None:
        yield _ignore
        return
    with listener.stage(label) as advance:
        yield advance


def count_through(label: str, items: Iterable[T], total: int) -> Iterator[T]:
    """Yield the items of a stage, and report their number."""
    with stage(label) as advance:
        for count, item in enumerate(items):
            advance(count, total)
            yield item


def _ignore(done: float, total: float, states: int | None = None) -> None:
    """Report nothing: nobody listens."""
