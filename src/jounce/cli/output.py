"""Print the output of a command: text or JSON, aligned columns, and a line about the progress of work.

`print_result` is the door of all commands. Within `show_progress` long work has a line on the terminal: what is done,
how far, and how long it still takes. A thread writes it, so that it moves on while work reports nothing. Rates are
those of the last seconds, and begin with the first report of a stage: what it takes to start does not count. The line
goes when the work ends.
"""

import json
import os
import sys
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from math import isfinite
from pathlib import Path
from shutil import get_terminal_size
from threading import Event, RLock, Thread
from time import monotonic
from typing import IO, Any

import click

from jounce.core.errors import JounceError, escape_text, shorten
from jounce.core.progress import Advance, listen


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


PATIENCE = 2.0  # s of work before a line appears: shorter work needs none
_TICK = 0.25  # s between two lines
_WINDOW = 10.0  # s whose rate an estimate takes: short enough to follow a change, long enough to be steady
_FIRST_SPAN = 0.5  # s of reports before there is an estimate


@dataclass(eq=False)
class _Stage:
    """A stage of work, and its last reports: when, how much was done, and how many states."""

    label: str
    start: float
    total: float = 0.0
    reports: deque[tuple[float, float, int | None]] = field(default_factory=deque)

    def report(self, now: float, done: float, total: float, states: int | None) -> None:
        """Keep a report, and those of the window before it."""
        self.total = total
        self.reports.append((now, done, states))
        while len(self.reports) > 2 and self.reports[1][0] < now - _WINDOW:
            self.reports.popleft()

    def describe(self, now: float) -> str:
        """The stage in words: how long it takes so far, or the share that is done and the time that is left."""
        if not self.reports or not self.total:
            return f"{self.label}: {_format_duration(now - self.start)}"
        (first, before, states_before), (last, done, states) = self.reports[0], self.reports[-1]
        said = f"{self.label}: {min(done / self.total, 1):.0%}"
        span = last - first
        if span < _FIRST_SPAN or done <= before:
            return f"{said}, {_format_duration(now - self.start)}"
        if states is not None and states_before is not None:
            said += f", {(states - states_before) / span:.3g} states/s"
        left = (self.total - done) * span / (done - before) - (now - last)
        return f"{said}, {_format_duration(max(left, 0.0))} left"


class ProgressLine:
    """The line on a stream, about the innermost stage that reports, else about the innermost one."""

    def __init__(self, stream: IO[str]) -> None:
        self._stream, self._stages, self._shown = stream, list[_Stage](), ""
        self._lock, self._start, self._done = RLock(), monotonic(), Event()

    @contextmanager
    def stage(self, label: str) -> Iterator[Advance]:
        """Begin and end a stage; yields the function that says how far it is."""
        begun = _Stage(label, monotonic())
        with self._lock:
            if not self._stages:
                self._start = begun.start
            self._stages.append(begun)

        def advance(done: float, total: float, states: int | None = None) -> None:
            with self._lock:
                begun.report(monotonic(), done, total, states)

        try:
            yield advance
        finally:
            with self._lock:
                self._stages.remove(begun)
                if not self._stages:
                    self.clear()

    def draw(self, now: float) -> None:
        """Show how far the work is, if it takes long."""
        with self._lock:
            if not self._stages or now - self._start < PATIENCE:
                return
            reporting = [stage for stage in self._stages if stage.reports]
            text = escape_text((reporting or self._stages)[-1].describe(now))[: get_terminal_size().columns - 1]
            self._write("\r" + text.ljust(len(self._shown)))
            self._shown = text

    def clear(self) -> None:
        """Remove the line, so that others may write."""
        with self._lock:
            if self._shown:
                self._write("\r" + " " * len(self._shown) + "\r")
                self._shown = ""

    def run(self) -> None:
        """Draw again and again until the end."""
        while not self._done.wait(_TICK):
            self.draw(monotonic())

    def stop(self) -> None:
        """End the drawing."""
        self._done.set()
        self.clear()

    def _write(self, text: str) -> None:
        try:
            self._stream.write(text)
            self._stream.flush()
        except (OSError, ValueError):  # nobody sees the terminal any more
            self._done.set()


@contextmanager
def show_progress() -> Iterator[ProgressLine | None]:
    """Within this context, long work has a line on the terminal; yields None where standard error leads elsewhere."""
    if not sys.stderr.isatty():
        yield None
        return
    line = ProgressLine(sys.stderr)
    drawing = Thread(target=line.run, daemon=True)
    drawing.start()
    try:
        with listen(line):
            yield line
    finally:
        line.stop()
        drawing.join()


def _format_duration(seconds: float) -> str:
    if seconds < 100:
        return f"{seconds:.0f} s"
    minutes = seconds / 60
    return f"{minutes:.0f} min" if minutes < 100 else f"{minutes / 60:.1f} h"
