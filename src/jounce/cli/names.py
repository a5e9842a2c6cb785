"""What a verb is asked about: a file or a bundled name, both offered by the shell's completion."""

from collections.abc import Callable, Iterable
from pathlib import Path

import click
from click.shell_completion import CompletionItem


class FileOrName(click.ParamType):  # type: ignore[type-arg] # generic for mypy alone
    """A path, or one of the names that come with jounce; which of them exists is found out where it is read."""

    def __init__(self, kind: str, names: Callable[[], Iterable[str]]) -> None:
        self.name, self.names = kind, names

    def convert(self, value: str | Path, param: click.Parameter | None, ctx: click.Context | None) -> Path:
        """The path; a bundled name is one too."""
        return Path(value)

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        """The names that begin so, and the shell's own completion of files."""
        names = [CompletionItem(name) for name in self.names() if name.startswith(incomplete)]
        return [*names, CompletionItem(incomplete, type="file")]


def _robots() -> Iterable[str]:
    from jounce.io.bundled import BUNDLED

    return BUNDLED


def _motions() -> Iterable[str]:
    from jounce.io.motions import BUNDLED

    return BUNDLED


ROBOT = FileOrName("robot", _robots)
MOTION = FileOrName("motion", _motions)
