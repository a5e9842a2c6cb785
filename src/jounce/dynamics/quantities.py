"""Which path computes what: one table, the default of each row first. All paths of a row agree."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from jounce.dynamics import recursion
from jounce.dynamics.closed_form import closed_form
from jounce.dynamics.paper import Paper
from jounce.dynamics.recursion.joints import joint_variables
from jounce.errors import one_of
from jounce.model import drives
from jounce.model.mechanism import Mechanism
from jounce.spatial.series import Series

Law = Callable[[Mechanism, Series, Any], Series]  # from coordinates and wrenches (or None), columns, to a quantity


@dataclass(frozen=True)
class Path:
    """A law, and how many scalars its working arrays hold for one state of nb bodies."""

    law: Law
    width: Callable[[int], int] = lambda nb: (6 * nb) ** 2  # a dense system matrix


def column(nb: int) -> int:
    """The width of a path that works on one column of vectors."""
    return 4 * nb


def columns(nb: int) -> int:
    """The width of a path that works on columns of screws, one a joint."""
    return 6 * nb


def row(column: Series) -> Series:
    """Columns (..., n, 1) as (..., n)."""
    return column.map(lambda Q: Q[..., 0])


def _driven(m: Mechanism, q: Series, Q: Series) -> Series:
    return Q + drive_forces(m, q, m.acting) if m.acting else Q


def _with_rotors(m: Mechanism, M: Series) -> Series:
    return M + m.G.T @ (m.drives.armature[:, None] * m.G) if "armature" in m.acting else M


def drive_forces(m: Mechanism, q: Series, terms: Sequence[str]) -> Series:
    """What terms of the drives add to the forces, (..., n, 1)."""
    return m.G.T @ drives.forces(drives.coefficients(m.drives), terms, joint_variables(m, q))


PATHS: dict[str, dict[str, Path]] = {
    "inverse_dynamics": {
        "recursion": Path(lambda m, q, W: row(_driven(m, q, recursion.inverse_dynamics(m, q, W))), column),
        "closed_form": Path(lambda m, q, W: row(_driven(m, q, closed_form(m, q, W).Q))),
        "paper": Path(lambda m, q, W: row(_driven(m, q, Paper(m, q, W).Q))),
    },
    "mass_matrix": {
        "recursion": Path(lambda m, q, _: _with_rotors(m, recursion.mass_matrix(m, q)), columns),
        "closed_form": Path(lambda m, q, _: _with_rotors(m, closed_form(m, q).gM)),
        "paper": Path(lambda m, q, _: _with_rotors(m, Paper(m, q).gM)),
    },
    "gravity_forces": {
        "recursion": Path(lambda m, q, _: row(recursion.gravity_forces(m, q)), column),
        "closed_form": Path(lambda m, q, _: row(closed_form(m, q).Qgrav)),
        "paper": Path(lambda m, q, _: row(Paper(m, q).Qgrav)),
    },
    "coriolis_matrix of form 'paper'": {
        "recursion": Path(lambda m, q, _: recursion.coriolis_matrix(m, q), columns),
        "closed_form": Path(lambda m, q, _: closed_form(m, q).gC),
        "paper": Path(lambda m, q, _: Paper(m, q).gC),
    },
    "coriolis_matrix of form 'skew'": {
        "recursion": Path(lambda m, q, _: recursion.skew_coriolis_matrix(m, q), columns),
        "closed_form": Path(lambda m, q, _: closed_form(m, q).gCbar),
    },
    "momentum": {
        "recursion": Path(lambda m, q, _: row(recursion.momentum(m, q)), column),
        "closed_form": Path(lambda m, q, _: row(closed_form(m, q).h)),
    },
    "base_wrench": {
        "recursion": Path(lambda m, q, W: row(recursion.base_wrench(m, q, W)), column),
        "closed_form": Path(lambda m, q, W: row(closed_form(m, q, W).F)),
    },
}
COMPILED = {  # to native code, and how many of q, qd, ... each takes
    "inverse_dynamics": 3,
    "gravity_forces": 1,
    "mass_matrix": 1,
    "coriolis_matrix of form 'paper'": 2,
    "coriolis_matrix of form 'skew'": 2,
}
SYMBOLS = {  # the paper's, by which results are named
    "inverse_dynamics": "Q",
    "mass_matrix": "M",
    "coriolis_matrix of form 'paper'": "C",
    "coriolis_matrix of form 'skew'": "Cbar",
    "gravity_forces": "Qgrav",
}
FORMS = ("paper", "skew")  # of the Coriolis matrix


def path(quantity: str, method: str | None) -> Path:
    """The path that `method` names, or the default one."""
    row = PATHS[quantity]
    if method is None:
        return next(iter(row.values()))
    known = [*row, *["kernel"] * (quantity in COMPILED)]
    return row[one_of(f"method for {quantity}", method, known)]
