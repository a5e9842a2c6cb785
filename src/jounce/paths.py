"""Which path computes what: one table, the default of each row first. All paths of a row agree."""

from collections.abc import Callable

from jounce import recursion
from jounce.closed_form import closed_form
from jounce.errors import no_such
from jounce.mechanism import Mechanism
from jounce.paper import Paper
from jounce.series import Series

Path = Callable[[Mechanism, Series, Series | None], Series]


def _row(column: Series) -> Series:
    return column.map(lambda Q: Q[..., 0])


PATHS: dict[str, dict[str, Path]] = {
    "inverse_dynamics": {
        "recursion": lambda mechanism, q, W: _row(recursion.inverse_dynamics(mechanism, q, W)),
        "closed_form": lambda mechanism, q, W: _row(closed_form(mechanism, q, W).Q),
        "paper": lambda mechanism, q, W: _row(Paper(mechanism, q, W).Q),
    },
    "mass_matrix": {
        "recursion": lambda mechanism, q, W: recursion.mass_matrix(mechanism, q),
        "closed_form": lambda mechanism, q, W: closed_form(mechanism, q).gM,
        "paper": lambda mechanism, q, W: Paper(mechanism, q).gM,
    },
    "gravity_forces": {
        "recursion": lambda mechanism, q, W: _row(recursion.gravity_forces(mechanism, q)),
        "closed_form": lambda mechanism, q, W: _row(closed_form(mechanism, q).Qgrav),
        "paper": lambda mechanism, q, W: _row(Paper(mechanism, q).Qgrav),
    },
    "coriolis_matrix, paper": {
        "closed_form": lambda mechanism, q, W: closed_form(mechanism, q).gC,
        "paper": lambda mechanism, q, W: Paper(mechanism, q).gC,
    },
    "coriolis_matrix, skew": {"closed_form": lambda mechanism, q, W: closed_form(mechanism, q).gCbar},
}


FORMS = ("paper", "skew")  # of the Coriolis matrix


def path(quantity: str, method: str | None) -> tuple[str, Path]:
    """The name and the function of the path that `method` names, or of the default one."""
    row = PATHS[quantity]
    if method is None:
        return next(iter(row.items()))
    if method not in row:
        raise no_such(f"method for {quantity}", method, row)
    return method, row[method]
