"""Which path computes what: one table, the default of each row first. All paths of a row agree."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from jounce import recursion
from jounce.closed_form import closed_form
from jounce.errors import no_such
from jounce.mechanism import Mechanism
from jounce.paper import Paper
from jounce.series import Series

Law = Callable[[Mechanism, Series, Any], Series]  # from coordinates and wrenches (or None), columns, to a quantity


@dataclass(frozen=True)
class Path:
    """A law, and whether it works on dense system matrices of 6nb rows."""

    law: Law
    dense: bool = True

    def width(self, nb: int) -> int:
        """How many scalars a working array holds for one state."""
        return (6 * nb) ** 2 if self.dense else 4 * nb


def _row(column: Series) -> Series:
    return column.map(lambda Q: Q[..., 0])


PATHS: dict[str, dict[str, Path]] = {
    "inverse_dynamics": {
        "recursion": Path(lambda m, q, W: _row(recursion.inverse_dynamics(m, q, W)), dense=False),
        "closed_form": Path(lambda m, q, W: _row(closed_form(m, q, W).Q)),
        "paper": Path(lambda m, q, W: _row(Paper(m, q, W).Q)),
    },
    "mass_matrix": {
        "recursion": Path(lambda m, q, _: recursion.mass_matrix(m, q), dense=False),
        "closed_form": Path(lambda m, q, _: closed_form(m, q).gM),
        "paper": Path(lambda m, q, _: Paper(m, q).gM),
    },
    "gravity_forces": {
        "recursion": Path(lambda m, q, _: _row(recursion.gravity_forces(m, q)), dense=False),
        "closed_form": Path(lambda m, q, _: _row(closed_form(m, q).Qgrav)),
        "paper": Path(lambda m, q, _: _row(Paper(m, q).Qgrav)),
    },
    "coriolis_matrix of form 'paper'": {
        "closed_form": Path(lambda m, q, _: closed_form(m, q).gC),
        "paper": Path(lambda m, q, _: Paper(m, q).gC),
    },
    "coriolis_matrix of form 'skew'": {"closed_form": Path(lambda m, q, _: closed_form(m, q).gCbar)},
    "momentum": {"closed_form": Path(lambda m, q, _: _row(closed_form(m, q).h))},
    "base_wrench": {"closed_form": Path(lambda m, q, W: _row(closed_form(m, q, W).F))},
}
COMPILED = {"inverse_dynamics": 3, "gravity_forces": 1, "mass_matrix": 1}  # to native code; the rates each takes
FORMS = ("paper", "skew")  # of the Coriolis matrix


def path(quantity: str, method: str | None) -> Path:
    """The path that `method` names, or the default one."""
    row = PATHS[quantity]
    if method is None:
        return next(iter(row.values()))
    if method not in row:
        raise no_such(f"method for {quantity}", method, [*row, *["kernel"] * (quantity in COMPILED)])
    return row[method]
