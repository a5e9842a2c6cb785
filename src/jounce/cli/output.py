"""What a command says: in words or as JSON, in straight columns, with a bar for work that takes more than a second."""

import json
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import monotonic
from typing import Any

import click

from jounce.errors import escaped, shortened

PATIENCE = 1.0  # s without a sign of life


def styled(text: str, **style: Any) -> str:
    """A text in a style, for terminals only (click strips it elsewhere), and not where NO_COLOR is set."""
    return text if os.environ.get("NO_COLOR") else click.style(text, **style)


def tell(data: Any, in_words: Callable[[Any], str], as_json: bool) -> None:
    """Print plain data, as JSON or in words."""
    click.echo(json.dumps(data, indent=2) if as_json else in_words(_readable(data)))


def _readable(data: Any) -> Any:
    """Data whose texts a terminal takes for nothing but texts, wherever they come from."""
    if isinstance(data, dict):
        return {_readable(name): _readable(value) for name, value in data.items()}
    if isinstance(data, list | tuple):
        return [_readable(item) for item in data]
    return escaped(data) if isinstance(data, str) else data


def straight_columns(rows: list[tuple[str, ...]]) -> list[str]:
    """Rows of texts as lines, one each, with straight columns, the first of them in bold where the terminal can.

    Cells are cut, but for the last of a row, which moves no other.
    """
    rows = [(*map(shortened, row[:-1]), escaped(row[-1])) for row in rows]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    head, *body = ["  ".join(map(str.ljust, row, widths)).rstrip() for row in rows]
    return [styled(head, bold=True), *body]


@contextmanager
def progress(label: str) -> Iterator[Callable[[int, int], None]]:
    """A bar on the terminal, after the first second of work; it shows what the yielded function is told: done, total.

    Nothing is shown when nobody watches: piped, or with the error stream in a file.
    """
    bar = click.progressbar(length=0, label=label, file=sys.stderr)
    seen, start = sys.stderr.isatty(), monotonic()

    def show(done: int, total: int) -> None:
        if seen and monotonic() - start > PATIENCE:
            bar.length = total
            bar.update(done - bar.pos)

    try:
        yield show
    finally:
        if bar.pos:
            bar.render_finish()
