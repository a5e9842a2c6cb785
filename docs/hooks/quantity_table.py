"""The table of quantities in pages: the line ``@quantities`` becomes a table of all rows of `jounce.dynamics`."""

import inspect
from typing import Any

import jounce
from jounce.dynamics.quantities import QUANTITIES, Quantity

HEAD = ("", "method", "rates", "shape", "unit", "what it is", "options")
SHARED_OPTIONS = {"base", "method", "out", "threads"}  # of all methods


def on_page_markdown(markdown: str, **_: Any) -> str:
    """The page with the table that it asks for."""
    return markdown.replace("@quantities\n", table())


def table() -> str:
    """The table of quantities, a row each."""
    rows = [HEAD, ("---",) * len(HEAD), *map(_row, QUANTITIES.values())]
    return "".join(f"| {' | '.join(row)} |\n" for row in rows)


def _row(quantity: Quantity) -> tuple[str, ...]:
    takes, printed = quantity.takes, quantity.printed
    names = {"rates": f"{takes.rates} + k", "bodies": "nb"}
    axes = [names.get(str(axis), str(axis)) for axis in quantity.gives.shape]
    shape = ", ".join(["...", *axes])
    parameters = inspect.signature(getattr(jounce.Robot, quantity.name)).parameters.values()
    options = [x.name for x in parameters if x.kind is x.KEYWORD_ONLY and x.name not in SHARED_OPTIONS]
    return (
        ", ".join(f"`{name}`" for name in quantity.names(0)),
        f"[`{quantity.name}`][jounce.Robot.{quantity.name}]",
        f"`{', '.join(takes.names(takes.rates))}`",
        f"`({shape})`",
        quantity.gives.unit,
        f"{printed.caption}: ${printed.tex}$",
        ", ".join(f"`{option}`" for option in options),
    )
