"""Print the output of a command: text or JSON, aligned columns, and a line about the progress of work.

All commands print through `print_result`. Within `show_progress` long work has a line on the terminal: the stage of the
work, the share that is done, and the time that is left. A thread writes the line, so that it moves on while the work
reports nothing. Rates are those of the last seconds, and begin with the first report of a stage: the time to start does
not count. The line is removed when the work ends.
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
    """Style a string for terminals, unless NO_COLOR is set.

    Elsewhere than on terminals click removes the style.
    """
    return text if os.environ.get("NO_COLOR") else click.style(text, **style)


def check_distinct(output: Path, *sources: Path | None) -> None:
    """Raise `JounceError` if a command would overwrite a file that it reads."""
    if output.resolve() in [source.resolve() for source in sources if source is not None]:
        raise JounceError(f"{output}: the output file is the input file; choose another path")


class SafeLine(str):
    """A line that is escaped already and may have a style."""


def print_result(lines: Callable[[], Sequence[str]], data: Callable[[], Any], as_json: bool) -> None:
    """Print the result of a command: its lines, or plain data as JSON."""
    if as_json:
        print_json(data())
    else:
        click.echo("\n".join(line if isinstance(line, SafeLine) else escape_text(line) for line in lines()))


def print_json(data: Any) -> None:
    """Print plain data as JSON, with null for infinity and NaN."""
    click.echo(json.dumps(_map_leaves(_null_if_infinite, data), indent=2))


def _map_leaves(change: Callable[[Any], Any], data: Any) -> Any:
    """Change the names, strings and numbers of plain data, whatever their source."""
    if isinstance(data, dict):
        return {change(name): _map_leaves(change, value) for name, value in data.items()}
    return [_map_leaves(change, item) for item in data] if isinstance(data, list | tuple) else change(data)


def _null_if_infinite(x: Any) -> Any:
    """Return None for infinity and NaN, which JSON does not have."""
    return None if isinstance(x, float) and not isfinite(x) else x


def align_columns(rows: list[tuple[str, ...]]) -> list[str]:
    """Format rows of strings as lines with aligned columns.

    The first line is bold on terminals. Long cells are cut, except the last of a row, which shifts no other cell.
    """
    rows = [(*map(shorten, row[:-1]), escape_text(row[-1])) for row in rows]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    head, *body = ["  ".join(map(str.ljust, row, widths)).rstrip() for row in rows]
    return list(map(SafeLine, [style_text(head, bold=True), *body]))


PATIENCE = 2.0  # s of work before a line appears: shorter work needs none
_TICK = 0.25  # s between two updates of the line
_WINDOW = 10.0  # s of reports that an estimate uses: short enough to follow a change, long enough to be steady
_FIRST_SPAN = 0.5  # s of reports before the first estimate


@dataclass(eq=False)
class _Stage:
    """A stage of work, with its last reports: time, amount done, number of states."""

    label: str
    start: float
    total: float = 0.0
    reports: deque[tuple[float, float, int | None]] = field(default_factory=deque)

    def report(self, now: float, done: float, total: float, states: int | None) -> None:
        """Keep a report, and drop the reports before the window.

        One report before the window stays, so that rates cover the whole window.
        """
        self.total = total
        self.reports.append((now, done, states))
        while len(self.reports) > 2 and self.reports[1][0] < now - _WINDOW:
            self.reports.popleft()

    def describe(self, now: float) -> str:
        """Describe the stage: the time so far, or the share done and the time left."""
        if not self.reports or not self.total:
            return f"{self.label}: {_format_duration(now - self.start)}"
        (first_time, first_done, first_states), (last_time, done, states) = self.reports[0], self.reports[-1]
        words = f"{self.label}: {min(done / self.total, 1):.0%}"
        # The rate is the amount done over the span of the reports; too short a span gives no steady rate.
        span = last_time - first_time
        if span < _FIRST_SPAN or done <= first_done:
            return f"{words}, {_format_duration(now - self.start)}"
        if states is not None and first_states is not None:
            words += f", {(states - first_states) / span:.3g} states/s"
        seconds_left = (self.total - done) * span / (done - first_done) - (now - last_time)
        return f"{words}, {_format_duration(max(seconds_left, 0.0))} left"


class ProgressLine:
    """The line on a stream, about the innermost stage that reports.

    If no stage reports, the line is about the innermost stage.
    """

    def __init__(self, stream: IO[str]) -> None:
        self._stream, self._stages, self._shown = stream, list[_Stage](), ""
        self._lock, self._start, self._done = RLock(), monotonic(), Event()

    @contextmanager
    def stage(self, label: str) -> Iterator[Advance]:
        """Begin and end a stage; yield the function that reports its progress."""
        stage = _Stage(label, monotonic())
        with self._lock:
            if not self._stages:
                self._start = stage.start
            self._stages.append(stage)

        def advance(done: float, total: float, states: int | None = None) -> None:
            with self._lock:
                stage.report(monotonic(), done, total, states)

        try:
            yield advance
        finally:
            with self._lock:
                self._stages.remove(stage)
                if not self._stages:
                    self.clear()

    def draw(self, now: float) -> None:
        """Show the progress of work that takes long."""
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
        except (OSError, ValueError):
            # The terminal is closed: nobody sees the line any more.
            self._done.set()


@contextmanager
def show_progress() -> Iterator[ProgressLine | None]:
    """Show the progress of long work on the terminal within this context.

    Yield None if standard error is not a terminal.
    """
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
