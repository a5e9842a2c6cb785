"""Forces and contact wrenches within the limits of contacts: friction, soles, and ground that only pushes.

Problem: min f^T W f subject to G f = Q_0 and C f <= 0, and the rates of its solution.

Algorithm: the least f without C f <= 0, by native code, is the solution wherever it obeys them. Elsewhere g = W^1/2 f =
g_0 + Z y, with g_0 that least f and Z the null space of G W^-1/2, makes it a least-distance problem, min |y| subject to
-C' Z y >= C' g_0, whose dual is a nonnegative least-squares problem [1], ch. 23: its positive multipliers are those of
the active rows. Its active rows are linearly independent, as columns of a passive set are. With C_a f = 0 of these rows
among the equations, f and its rates follow from the series of one solution.

Invariant: rates are those of motions that keep the active rows; where a row begins or ends to be active, f is
continuous and its rate jumps. It fails, with `JounceError`, where no f obeys the limits.

[1] C. L. Lawson, R. J. Hanson, Solving Least Squares Problems, SIAM (1995).
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from jounce.arguments.contacts import balance_maps, describe_directions
from jounce.core.errors import JounceError, join_names
from jounce.core.scalars import Array, broadcast, is_numeric
from jounce.dynamics.computation import Port
from jounce.dynamics.contacts import limit_rows
from jounce.engine.backends import Call, default_method
from jounce.engine.generic_methods import as_tuple, evaluate, write_results
from jounce.model.mechanism import Mechanism
from jounce.spatial.series import Series

LIMIT_ROUNDING = 1e-9  # of the largest component: rounding, which breaks no limit
MIN_DUAL_RESIDUAL = 1e-6  # of the dual problem, the weight over that of f: smaller where nothing obeys the limits
MAX_BALANCE_CONDITION = 1e4  # of G: it enters squared, so that half of the digits are left


def is_always_balanced(m: Mechanism) -> bool:
    """Whether the contacts balance the base, whatever the wrench on it and the position: one plane does."""
    return any(contact.kind == "plane" and not len(contact.rows) for contact in m.contacts)


def compute_on_contacts(call: Call, run: Callable[[Call], Any]) -> Any:
    """Run a call for forces or wrenches on contacts that may not balance the base."""
    m, asked = call.robot.mechanism, call.computation
    limited = any(len(contact.rows) for contact in m.contacts)
    if not all(map(is_numeric, call.arrays)):
        if limited:
            raise JounceError(
                f"{asked.name} of {m.name!r}: friction and soles are decided on numbers, got symbols or arrays of JAX;"
                " leave friction= and sole= of the contacts out"
            )
        return run(call)
    ports = asked.signature(m).inputs
    arrays = broadcast(call.arrays, [len(port.shape) for port in ports], [port.name for port in ports])
    batch = arrays[0].shape[: arrays[0].ndim - 1]
    given = {port.name: x.reshape((-1, *port.shape)) for port, x in zip(ports, arrays, strict=True)}
    G = balance_maps(m, given["q"], given["base_pose"])
    _check_condition(m, G, batch)
    if not limited:
        return run(call)
    first = replace(asked, name="contact_wrenches", order=0)
    f = run(call._replace(computation=first, arrays=[given[port.name] for port in first.signature(m).inputs], out=None))
    held = [6 * k + i for k, contact in enumerate(m.contacts) for i in contact.held]
    f, C = f.reshape((len(f), -1))[:, held], limit_rows(m.contacts)
    beyond = ((f @ C.T).max(axis=1) > LIMIT_ROUNDING * np.abs(f).max(axis=1)).nonzero()[0]
    if not beyond.size:
        return run(call)
    active = np.stack([_active_rows(m, G[i], f[i], C, np.unravel_index(i, batch)) for i in beyond])
    results = [x.reshape((len(f), *x.shape[len(batch) :])).copy() for x in as_tuple(run(call._replace(out=None)))]
    for x, changed in zip(results, _solve_active(call, [x[beyond] for x in given.values()], ports, active), strict=True):
        x[beyond] = changed
    return write_results(tuple(x.reshape((*batch, *x.shape[1:])) for x in results), call.out)


def _check_condition(m: Mechanism, G: np.ndarray, batch: Sequence[int]) -> None:
    """Raise `JounceError` where contacts hardly balance one direction, as three points on a line do."""
    U, sizes, _ = np.linalg.svd(G, full_matrices=False)
    lost = np.flatnonzero(sizes[:, -1] * MAX_BALANCE_CONDITION < sizes[:, 0])
    if lost.size:
        i = lost[0]
        index = f"; state [{', '.join(map(str, np.unravel_index(i, batch)))}]" if batch else ""
        raise JounceError(
            f"{m.name!r}: contacts at {join_names(contact.frame for contact in m.contacts)} do not balance"
            f" {describe_directions(U[i, :, -1:].T)}: 1/cond is {sizes[i, -1] / sizes[i, 0]:.1e}{index}"
        )


def _active_rows(m: Mechanism, G: np.ndarray, f: np.ndarray, C: np.ndarray, index: Sequence[int]) -> np.ndarray:
    """(r,): 1 for the rows that are active in the solution, of the least components f without limits."""
    from scipy.optimize import nnls  # imported here to keep start-up fast

    roots = np.sqrt(np.concatenate([contact.weights[list(contact.held)] for contact in m.contacts]))
    Z = np.linalg.svd(G / roots)[2][6:].T
    size, rows = np.linalg.norm(roots * f), C / roots
    E = np.concatenate([-(rows @ Z).T, (C @ f)[None] / size])
    u, residual = nnls(E, np.append(np.zeros(len(E) - 1), 1.0))
    if residual < MIN_DUAL_RESIDUAL:
        raise _infeasible(m, C @ f, index)
    return (u > 0) * 1.0


def _infeasible(m: Mechanism, beyond: np.ndarray, index: Sequence[int]) -> JounceError:
    names = [f"{contact.row_name(k)} of {contact.frame!r}" for contact in m.contacts for k in range(len(contact.rows))]
    state = f" in state [{', '.join(map(str, index))}]" if len(index) else ""
    return JounceError(
        f"{m.name!r}: no contact wrenches within friction and soles balance the motion{state}; the least ones are"
        f" farthest beyond {names[int(np.argmax(beyond))]}. Slow the motion down, or state other contacts"
    )


def _solve_active(call: Call, arrays: list[Array], ports: Sequence[Port], active: np.ndarray) -> tuple[Array, ...]:
    """The results where rows are active, by the recursion."""
    m, asked = call.robot.mechanism, call.computation
    row, method = asked.quantity, default_method(asked.quantity)

    def law(x: Sequence[Array]) -> Series:
        return row.law(method, m)(m, replace(asked.state(m, x[:-1]), active=x[-1]))

    of_rows = Port("active", (active.shape[1],), "state")
    width = row.methods[method].width(m.nb)
    return evaluate(law, [*ports, of_rows], [*arrays, active], asked.count, width)
