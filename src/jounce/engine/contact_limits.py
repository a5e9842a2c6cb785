"""Compute forces and contact wrenches within the limits of contacts.

Limits are friction, soles, and ground that only pushes.

Problem: min f^T W f subject to G f = Q_0 and C f <= 0, and the rates of its solution.

Algorithm: the least f without C f <= 0, by native code, is the solution wherever it obeys them. Elsewhere g = W^1/2 f =
g_0 + Z y, with g_0 that least f and Z the null space of G W^-1/2, makes it a least-distance problem, min |y| subject to
-C' Z y >= C' g_0, whose dual is a nonnegative least-squares problem [1], ch. 23: its positive multipliers are those of
the active rows. Its active rows are linearly independent, as columns of a passive set are. With C_a f = 0 of these rows
among the equations, f and its rates follow from the series of one solution.

Invariant: rates are those of motions that keep the active rows; where a row begins or ends to be active, f is
continuous and its rate jumps. It fails, with `JounceError`, where no f obeys the limits.

`compute_on_contacts` is the door. The least f is computed for a whole batch at once, the dual problem once for each
state whose least f breaks a limit, and the series of all such states together.

[1] C. L. Lawson, R. J. Hanson, Solving Least Squares Problems, SIAM (1995).
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from jounce.arguments.contacts import balance_maps, describe_direction, find_unbalanced
from jounce.core.errors import JounceError, join_names, quote_value
from jounce.core.scalars import Array, broadcast, is_numeric
from jounce.dynamics.computation import Port
from jounce.dynamics.contacts import limit_rows
from jounce.dynamics.state import Law
from jounce.engine import generic_methods
from jounce.engine.backends import Call, default_method
from jounce.model.mechanism import Mechanism
from jounce.spatial.series import Series

LIMIT_ROUNDING = 1e-9  # of the largest component, weighted as in the sum that is least: rounding, which breaks no limit
MIN_DUAL_RESIDUAL = 1e-6  # of the dual problem, the weight over that of f: smaller where nothing obeys the limits


def is_always_balanced(m: Mechanism) -> bool:
    """Return whether contacts balance any wrench, as a plane does."""
    return any(contact.kind == "plane" and not contact.named_limits for contact in m.contacts)


def are_limited(m: Mechanism) -> bool:
    """Return whether friction, soles or ground that only pushes limit contact wrenches."""
    return any(contact.named_limits for contact in m.contacts)


class Balance(NamedTuple):
    """What balances the N states of a call: components f of contact wrenches, and active rows of the limits.

    `batch` is the shape of the call, `arrays` are its arrays with one batch axis of N.
    """

    batch: tuple[int, ...]
    arrays: list[Array]
    G: np.ndarray  # (N, 6, k)
    scales: np.ndarray  # (N, k): W^-1/2
    least: np.ndarray  # (N, k), where no row is active
    active: np.ndarray  # (N, r): 1, or 0


class UnbalancedError(JounceError):
    """Contacts do not balance one state of a call.

    `state` is its number in the flat batch.
    """

    def __init__(self, reason: str, state: int = 0, batch: tuple[int, ...] = ()) -> None:
        index = f" in state [{', '.join(map(str, np.unravel_index(state, batch)))}]" if batch else ""
        super().__init__(reason + index)
        self.reason, self.state, self.batch = reason, state, batch

    def __reduce__(self) -> tuple[Any, ...]:  # between processes
        return type(self), (self.reason, self.state, self.batch)


@contextmanager
def unbalanced_at(t: np.ndarray) -> Iterator[None]:
    """Name the time in errors of contacts that do not balance.

    `t` are times (N,) of a motion.
    """
    try:
        yield
    except UnbalancedError as error:
        raise JounceError(f"{error.reason}, at t = {t[error.state]:.9g} s") from None


def compute_on_contacts(call: Call, run: Callable[[Call], Any]) -> Any:
    """Run a call on contacts that may not balance the base."""
    m, computation = call.robot.mechanism, call.computation
    # For symbols, contacts count as balanced; limits would need a decision.
    if not all(map(is_numeric, call.arrays)):
        if are_limited(m):
            raise JounceError(
                f"{computation.name} of {m.name!r}: friction and soles are decided on numbers, got symbols or arrays of"
                " JAX; leave friction= and sole= of the contacts out"
            )
        return run(call)
    batch, arrays, _, _, _, active = find_balance(call, run)
    # Contacts that come and leave have no native code: all states go one way.
    if len(call.presence) > 0:
        return solve_active(call, arrays, active)
    limited = np.flatnonzero(active.any(axis=1))
    if limited.size == 0:
        return run(call)
    # The results of the whole batch, (batch, ...) -> (N, ...), in which those of limited states are then replaced.
    results = [
        x.reshape((len(active), *x.shape[len(batch) :])).copy()
        for x in generic_methods.as_tuple(run(call._replace(out=None)))
    ]
    for x, changed in zip(results, solve_active(call, [x[limited] for x in arrays], active[limited]), strict=True):
        x[limited] = changed
    return generic_methods.write_results(tuple(x.reshape((*batch, *x.shape[1:])) for x in results), call.out)


def find_balance(call: Call, run: Callable[[Call], Any]) -> Balance:
    """Find what balances the states of a call on contacts."""
    m, computation = call.robot.mechanism, call.computation
    ports = computation.signature(m).inputs
    # One batch axis: (batch, ...) -> (N, ...).
    arrays = broadcast(call.arrays, [len(port.shape) for port in ports], [port.name for port in ports])
    batch = arrays[0].shape[:-1]
    inputs = {port.name: x.reshape((-1, *port.shape)) for port, x in zip(ports, arrays, strict=True)}
    G, C = balance_maps(m, inputs["q"], inputs["base_pose"]), limit_rows(m.contacts)
    # Weights of the components that contacts hold. A contact that is only partly there costs more: it takes less.
    weights, sizes = np.concatenate([x.weights[x.held] for x in m.contacts]), [len(x.held) for x in m.contacts]
    presence = np.ones_like(G[:, 0])
    if len(call.presence) > 0:
        presence = np.repeat(call.presence[0].clip(0), sizes, axis=1)
    check_condition(m, G * np.sqrt(presence)[:, None], batch)
    scales = np.sqrt(presence / weights)
    f, active = np.zeros((len(G), G.shape[-1])), np.zeros((len(G), len(C)))
    if len(C) > 0:
        # The least components without limits: (N, contacts, 6) -> (N, k), of what contacts hold.
        wrenches = replace(computation, name="contact_wrenches", order=0)
        wrench_arrays = [inputs[port.name] for port in wrenches.signature(m).inputs]
        least = call._replace(computation=wrenches, arrays=wrench_arrays, out=None)
        f = solve_active(least, wrench_arrays, active)[0] if len(call.presence) > 0 else run(least)
        f = f.reshape((len(G), -1))
        f = f[:, [6 * k + i for k, contact in enumerate(m.contacts) for i in contact.held]]
        # The weights make N and N m comparable.
        levers = 1 / np.sqrt(weights)
        rounding = LIMIT_ROUNDING * np.abs(f / levers).max(axis=1, keepdims=True) * (np.abs(C) @ levers)
        # Only states that break a limit by more than rounding need the dual problem.
        for i in (f @ C.T > rounding).any(axis=1).nonzero()[0]:
            try:
                active[i] = _active_rows(m, G[i] * scales[i], f[i], C, scales[i])
            except UnbalancedError as error:
                raise UnbalancedError(error.reason, int(i), batch) from None
    return Balance(batch, list(inputs.values()), G, scales, f, active)


def solve_components(m: Mechanism, balance: Balance, i: int, active: np.ndarray) -> np.ndarray:
    """Return the least components f (k,) where rows are active.

    They balance state i.
    """
    # G f = Q_0 and C_a f = 0, of which the least solution in W^1/2 f is taken.
    rows = np.concatenate([balance.G[i], limit_rows(m.contacts)[active > 0]]) * balance.scales[i]
    F = balance.G[i] @ balance.least[i]
    return np.asarray(np.linalg.lstsq(rows, np.pad(F, (0, len(rows) - 6)))[0] * balance.scales[i])


def check_condition(m: Mechanism, G: np.ndarray, batch: tuple[int, ...]) -> None:
    """Raise `UnbalancedError` where contacts hardly balance one direction.

    Three points on a line do not balance a moment about it.
    """
    # In flight nothing is balanced, which is no fault of the contacts: NaN is not looked at.
    balanced = np.where(G.any(axis=(1, 2), keepdims=True), G, np.nan)
    lost, directions = find_unbalanced(m, balanced)
    if lost.size > 0:
        columns, direction = [x.frame for x in m.contacts for _ in x.held], describe_direction(m, directions[0])
        frames = join_names(dict.fromkeys(x for x, g in zip(columns, G[lost[0]].T, strict=True) if g.any()))
        raise UnbalancedError(f"{m.name!r}: contacts at {frames} do not balance {direction}", int(lost[0]), batch)


def _active_rows(m: Mechanism, G: np.ndarray, f: np.ndarray, C: np.ndarray, scales: np.ndarray) -> np.ndarray:
    """Return 1 for each active row of the limits, else 0.

    `G` is G W^-1/2, and `f` are the least components without limits.
    """
    from scipy.optimize import nnls  # imported here to keep start-up fast

    # Z spans the null space of G W^-1/2: what contacts exert against each other. Contacts that are not there have no
    # scale. Lengths are relative to that of g_0 = W^1/2 f, so that the residual has no unit.
    Z, is_present = np.linalg.svd(G)[2][6:].T, scales > 0
    size, rows = np.linalg.norm(f[is_present] / scales[is_present]), C * scales
    # The dual problem of min |y| subject to -C' Z y >= C' g_0 [1]: min |E u - (0, ..., 0, 1)| over u >= 0. Its residual
    # is 0 where the constraints contradict each other.
    E = np.concatenate([(rows @ Z).T, (C @ f)[None] / size])
    # The sign of Z has no effect on u.
    u, residual = nnls(E, np.append(np.zeros(len(E) - 1), 1.0))
    if residual < MIN_DUAL_RESIDUAL:
        raise _infeasible(m, C @ f)
    return (u > 0) * 1.0


def _infeasible(m: Mechanism, excess: np.ndarray) -> UnbalancedError:
    """Return the error where no wrenches obey the limits.

    `excess`, (r,), is how far the least ones are beyond.
    """
    names = [f"{name} of {quote_value(contact.frame)}" for contact in m.contacts for name, _ in contact.named_limits]
    return UnbalancedError(
        f"{m.name!r}: no contact wrenches within friction and soles balance the motion; slow it down, or state other"
        f" contacts: the least wrenches are farthest beyond {names[int(np.argmax(excess))]}"
    )


def solve_active(
    call: Call, arrays: Sequence[Array], active: np.ndarray, other_law: Law | None = None
) -> tuple[Array, ...]:
    """Return the results of a call where rows are active.

    Rows are (N, r). Another law may take the place of that of the call. `arrays` are those of the call, (N, ...)
    each. The recursion computes them.
    """
    m, computation = call.robot.mechanism, call.computation
    ports = computation.signature(m).inputs
    row, method = computation.quantity, default_method(computation.quantity)
    law_of_state = row.law(method, m) if other_law is None else other_law

    def law(x: Sequence[Array]) -> Series:
        # Behind the arrays of the ports come the active rows, then the presence of contacts with its rates.
        state_arrays, rows, *rates = x[: len(ports)], *x[len(ports) :]
        presence = None if len(rates) == 0 else Series.of(rates)
        return law_of_state(m, replace(computation.state(m, state_arrays), active=rows, presence=presence))

    contact_arrays = [active, *call.presence[: computation.count]]
    contact_ports = [Port("of contacts", x.shape[1:], "state") for x in contact_arrays]
    width = generic_methods.working_scalars(row, method, m.nb)
    return generic_methods.evaluate(law, [*ports, *contact_ports], [*arrays, *contact_arrays], computation.count, width)
