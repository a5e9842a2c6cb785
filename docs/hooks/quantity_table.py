"""The table of quantities in docs/quantities.md, which `make stubs` makes of all rows of `jounce.dynamics`.

The page in the repository has the table itself, to be read there too. On the site the names of methods lead to their
descriptions.
"""

import inspect
import re
from pathlib import Path
from typing import Any

import jounce
from jounce.dynamics.quantities import QUANTITIES, Quantity

HEAD = ("", "method", "rates", "shape", "unit", "what it is", "options")
SHARED_OPTIONS = {"base", "method", "out", "threads"}  # of all methods


PAGE = Path(__file__).parents[1] / "quantities.md"
BLOCK = re.compile(r"(<!-- made by make stubs -->\n)(.*?)(<!-- end -->)", re.DOTALL)
METHOD = re.compile(r"^(\| [^|]* \| )`(\w+)`", re.MULTILINE)


def on_page_markdown(markdown: str, **_: Any) -> str:
    """The page, with links from the methods in its table to their descriptions."""
    return BLOCK.sub(lambda block: METHOD.sub(r"\1[`\2`][jounce.Robot.\2]", block[2]), markdown)


def with_table(page: str) -> str:
    """The page with the table made anew."""
    return BLOCK.sub(lambda block: f"{block[1]}\n{table()}\n{block[3]}", page)


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
        f"`{quantity.name}`",
        f"`{', '.join(takes.names(takes.rates))}`",
        f"`({shape})`",
        quantity.gives.unit,
        f"{printed.caption}: ${printed.tex}$",
        ", ".join(f"`{option}`" for option in options),
    )
