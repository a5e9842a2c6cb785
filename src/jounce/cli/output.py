"""The output of a command: text or JSON, and aligned columns."""

import json
import os
from collections.abc import Callable, Sequence
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from jounce.core.errors import JounceError, escape_text, shorten

if TYPE_CHECKING:
    pass


def style_text(text: str, **style: Any) -> str:
    """Style a string for terminals (click strips it elsewhere), unless NO_COLOR is set."""
    return text if os.environ.get("NO_COLOR") else click.style(text, **style)


def check_distinct(output: Path, *sources: Path | None) -> None:
    """Raise `JounceError` if a command would write over a file that it reads."""
    if output.resolve() in [source.resolve() for source in sources if source is not None]:
        raise JounceError(f"{output}: the output file is the input file; choose another path")


class SafeLine(str):
    """A line whose names are escaped already, and that may have a style of its own."""


def print_result(lines: Callable[[], Sequence[str]], data: Callable[[], Any], as_json: bool) -> None:
    """Print the result of a command: its lines, or plain data as JSON."""
    if as_json:
        print_json(data())
    else:
        click.echo("\n".join(line if isinstance(line, SafeLine) else escape_text(line) for line in lines()))


def print_json(data: Any) -> None:
    """Print plain data as JSON, with null for numbers that JSON does not have."""
    click.echo(json.dumps(_map_leaves(_null_if_infinite, data), indent=2))


def _map_leaves(change: Callable[[Any], Any], data: Any) -> Any:
    """Change the names, strings and numbers of plain data, whatever their source."""
    if isinstance(data, dict):
        return {change(name): _map_leaves(change, value) for name, value in data.items()}
    return [_map_leaves(change, item) for item in data] if isinstance(data, list | tuple) else change(data)


def _null_if_infinite(x: Any) -> Any:
    """None for a number that JSON does not have: infinity, or none at all."""
    return None if isinstance(x, float) and not isfinite(x) else x


def align_columns(rows: list[tuple[str, ...]]) -> list[str]:
    """Format rows of strings as lines with aligned columns, the first in bold on terminals.

    Cells are cut, except the last of a row, which shifts no other.
    """
    rows = [(*map(shorten, row[:-1]), escape_text(row[-1])) for row in rows]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    head, *body = ["  ".join(map(str.ljust, row, widths)).rstrip() for row in rows]
    return list(map(SafeLine, [style_text(head, bold=True), *body]))
