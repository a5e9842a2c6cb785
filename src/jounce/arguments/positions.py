"""The positions of closed robots that callers give: independent coordinates, or all of the tree near a branch."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from jounce.arguments.rates import convert_coordinates
from jounce.core import named_entries
from jounce.core.errors import JounceError, join_names
from jounce.core.scalars import Array, asarray, is_numeric
from jounce.dynamics import loop_closure, loop_newton
from jounce.dynamics.loop_newton import NewtonStep
from jounce.dynamics.loops import closure_of
from jounce.model.loops import all_coordinates
from jounce.model.mechanism import Mechanism
from jounce.model.scalar_casting import cast_model


def split_positions(mechanism: Mechanism, q: Any) -> tuple[Any, Any]:
    """The independent coordinates and those (..., N) of the tree that a caller's q contains, or None.

    A q of N entries, or one that names all coordinates of the tree, has the dependent ones too.
    """
    closure, named = closure_of(mechanism), named_entries.entry_names(q)
    if named is None:
        whole = asarray(q, "q")
        if whole.shape[-1:] != (len(closure.coordinates),) or not closure.dependent:
            return q, None
    elif set(closure.coordinates) <= set(named):
        whole = convert_coordinates(mechanism.tree, q, "q", len(closure.coordinates))
    else:
        return q, None
    return whole[..., list(closure.independent)], whole


def split_rates(mechanism: Mechanism, given: Sequence[Any]) -> tuple[Sequence[Any], Any]:
    """The rates of the coordinates, and all coordinates of the tree of a closed robot where q states these."""
    if not mechanism.closure or not given:
        return given, None
    first, whole = split_positions(mechanism, given[0])
    return [first, *given[1:]], whole


def dependent_coordinates(mechanism: Mechanism, u: Array, whole: Array | None, step: NewtonStep | None = None) -> Array:
    """The dependent coordinates (..., N - n), with loops closed: from those given, if any, else from the start.

    Symbols are taken as they are. `step` is one of `loop_closure.close_loops`.
    """
    closure = closure_of(mechanism)
    others = list(closure.dependent)
    if whole is not None and not is_numeric(whole):
        return whole[..., others]
    if whole is None and not closure.solved:
        return closure.ratios.positions(u)
    if whole is None and not is_numeric(u):
        raise JounceError(
            f"q holds {mechanism.n} symbols, or an array of JAX; expected all {len(closure.coordinates)} coordinates of"
            f" the tree, as loops are closed on numbers of NumPy: {join_names(closure.coordinates)}"
        )
    flat = np.asarray(u, dtype=float).reshape(-1, mechanism.n)
    start = None if whole is None else np.asarray(whole, dtype=float).reshape(-1, len(closure.coordinates))
    found = loop_closure.close_loops(mechanism, flat, start, step)[:, others].reshape(*u.shape[:-1], len(others))
    if u.dtype == np.longdouble:  # closed to the precision of q
        model = cast_model(mechanism, [u])
        for _ in range(2):
            found = loop_newton.newton_step(model, all_coordinates(closure, u, found), 0 * u)[0]
    return found


def dependent_arrays(mechanism: Mechanism, q: Array, whole: Any, step: NewtonStep | None = None) -> list[Array]:
    """The last array of all computations of closed robots: the dependent coordinates."""
    found = [dependent_coordinates(mechanism, q, whole, step)] if mechanism.closure else []  # checks those given
    return found if mechanism.takes_dependent else []
