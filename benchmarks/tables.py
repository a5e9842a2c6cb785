"""Markdown: tables of figures, and paragraphs."""

from collections.abc import Sequence
from textwrap import fill

WIDTH = 120


def table(head: Sequence[str], rows: Sequence[Sequence[str]], side: str = "---:") -> list[str]:
    """A table; all columns but the first are numbers, to the right, or lie on another side."""
    lines = [head, ["---", *[side] * (len(head) - 1)], *rows]
    return [*(f"| {' | '.join(line)} |" for line in lines), ""]


def paragraph(text: str) -> list[str]:
    """A paragraph in lines of even length."""
    return [fill(" ".join(text.split()), WIDTH, break_on_hyphens=False), ""]


def figure(x: float | None) -> str:
    """Three digits, or all before the point; "-" for what was not measured."""
    return "-" if x is None else f"{x:,.0f}" if x >= 99.95 else f"{x:#.3g}"


def share(error: float | None) -> str:
    """An error as a share, one digit."""
    return "-" if error is None else f"{error:.0e}" if error else "0"


def batch(count: int) -> str:
    """The size of a batch in words."""
    return "one state" if count == 1 else f"{count:,} states"
