"""Cures in messages: an option of the running command at the shell, an argument or a call in Python.

A message is for whoever reads it. One at the shell names no call of Python, and only options that the command has.
"""

import re
import shlex
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass

from jounce.core.errors import quote_value, shorten

OPTION = re.compile(r"(?<![\w-])--[a-z][a-z-]*")
OTHER_COMMAND = re.compile(r"\bjounce [a-z]+[^;,`']*")  # with options of its own

_options: ContextVar[frozenset[str] | None] = ContextVar("_options", default=None)  # None: no command runs
_typed_words: ContextVar[tuple[str, ...]] = ContextVar("_typed_words", default=())  # the command line, if it is known


@contextmanager
def running_command(options: Iterable[str], typed_words: Iterable[str] = ()) -> Iterator[None]:
    """Word messages for a command with these options, within this context.

    Cures repeat the words of the command line, if they are given.
    """
    token = _typed_words.set(tuple(typed_words))
    try:
        with reader_of(frozenset(options)):
            yield
    finally:
        _typed_words.reset(token)


def repeat_command(keyword: str, values: Sequence[str], repeatable: bool = False) -> str:
    """Return the typed command line with an option for a keyword.

    The option stands once for each value. Without a known command line, or where it has this option already and this is
    not `repeatable`, these are the options alone.
    """
    typed, option = _typed_words.get(), f"--{keyword}"
    options = [word for value in values for word in (option, value)]
    is_full = option in typed and not repeatable
    return shlex.join(options if is_full else [*typed, *options])


@contextmanager
def reader_of(options: frozenset[str] | None) -> Iterator[None]:
    """Word messages for the reader of another process within this context.

    `get_reader` gave these options there.
    """
    token = _options.set(options)
    try:
        yield
    finally:
        _options.reset(token)


def get_reader() -> frozenset[str] | None:
    """Return the options of the running command, or None.

    It is None for a reader in Python.
    """
    return _options.get()


@dataclass(frozen=True)
class Remedy:
    """A cure in the words of Python and of the shell.

    The words are chosen when the message is made. At the shell it is "" where there are no such words, or where they
    name an option that the running command has not.
    """

    python: str
    shell: str = ""

    def __str__(self) -> str:
        options = get_reader()
        if options is None:
            return self.python
        return self.shell if find_options(self.shell) <= options else ""


def find_options(text: str) -> set[str]:
    """Return the options in a text.

    Those of other commands are left out, ``jounce run --rates``.
    """
    return set(OPTION.findall(OTHER_COMMAND.sub("", text)))


def option_name(keyword: str) -> str:
    """Return the keyword of a call, or the option it names.

    The option is one of the running command.
    """
    return str(Remedy(keyword, f"--{keyword.rstrip('_').replace('_', '-')}"))


def option_value(keyword: str, value: object) -> str:
    """Return the keyword or the option with its value.

    ``drives='friction'`` or ``--drives friction``.
    """
    if get_reader() is None:
        return f"{keyword}={quote_value(value)}"
    option = option_name(keyword)
    return f"{option} {shorten(str(value))}" if option else ""


def join_cures(cures: Iterable[Remedy | str]) -> str:
    """Return the cures that a reader has, "a, b, or c".

    Without any it is "".
    """
    texts = [text for text in map(str, cures) if text != ""]
    if len(texts) < 2:
        return "".join(texts)
    return f"{', '.join(texts[:-1])}, or {texts[-1]}"


FLOATING_BASE = Remedy("base='floating'", "--base floating")
WITHOUT_TRANSMISSIONS = Remedy("transmissions=False", "--no-transmissions")
SPONG_COUPLING = Remedy("coupling='spong'", "coupling: spong in its file")
