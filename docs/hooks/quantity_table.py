"""The table of quantities in pages: the line ``@quantities`` becomes a table of all rows of `jounce.dynamics`."""

from typing import Any

from jounce.dynamics.quantities import QUANTITIES, Quantity
from jounce.robot.robot import FORMS, Robot

HEAD = ("", "method", "rates", "shape", "unit", "what it is", "options")


def on_page_markdown(markdown: str, **_: Any) -> str:
    """The page with the table that it asks for."""
    return markdown.replace("@quantities\n", table())


def table() -> str:
    """The table of quantities, a row each."""
    rows = [HEAD, ("---",) * len(HEAD), *map(_row, QUANTITIES.values())]
    return "".join(f"| {' | '.join(row)} |\n" for row in rows)


def method(quantity: Quantity) -> tuple[type, str, str]:
    """The class and the method that compute a quantity, and how it is called for it, without the rates."""
    if hasattr(Robot, quantity.name):
        return Robot, quantity.name, quantity.name
    [form] = [form for form, name in FORMS.items() if name == quantity.name]
    return Robot, FORMS["paper"], f'{FORMS["paper"]}(form="{form}")'


def _row(quantity: Quantity) -> tuple[str, ...]:
    owner, name, call = method(quantity)
    rates = ", ".join(quantity.input_names(quantity.rates))
    axes = [f"{quantity.rates} + k" if axis == "rates" else str(axis) for axis in quantity.shape]
    shape = ", ".join(["...", *axes])
    options = ["wrench"] * quantity.wrenches + ["body"] * quantity.of_bodies + ["frame"] * bool(quantity.frames)
    return (
        ", ".join(f"`{name}`" for name in quantity.names(0)),
        f"[`{call}`][jounce.{owner.__name__}.{name}]",
        f"`{rates}`",
        f"`({shape})`",
        quantity.unit,
        f"{quantity.caption}: ${quantity.tex}$",
        ", ".join(f"`{option}`" for option in options),
    )
