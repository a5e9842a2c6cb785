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
    """Whether the contacts balance the base, whatever the wrench on it and the position: one plane does."""
    return any(contact.kind == "plane" and not contact.named_limits for contact in m.contacts)


def are_limited(m: Mechanism) -> bool:
    """Whether friction, soles or ground that only pushes limit the wrenches of contacts."""
    return any(contact.named_limits for contact in m.contacts)


class Balance(NamedTuple):
    """The states (N, ...) of a call, the map G and the least components f, and which rows of the limits are active."""

    batch: tuple[int, ...]
    arrays: list[Array]
    G: np.ndarray  # (N, 6, k)
    scales: np.ndarray  # (N, k): W^-1/2
    least: np.ndarray  # (N, k), where no row is active
    active: np.ndarray  # (N, r): 1, or 0


class UnbalancedError(JounceError):
    """Contacts do not balance one of the states of a call, `state` in its flat batch."""

    def __init__(self, reason: str, state: int = 0, batch: tuple[int, ...] = ()) -> None:
        index = f" in state [{', '.join(map(str, np.unravel_index(state, batch)))}]" if batch else ""
        super().__init__(reason + index)
        self.reason, self.state, self.batch = reason, state, batch

    def __reduce__(self) -> tuple[Any, ...]:  # between processes
        return type(self), (self.reason, self.state, self.batch)


@contextmanager
def unbalanced_at(t: np.ndarray) -> Iterator[None]:
    """Say at which of the times (N,) of a motion contacts do not balance it."""
    try:
        yield
    except UnbalancedError as error:
        raise JounceError(f"{error.reason}, at t = {t[error.state]:.9g} s") from None


def compute_on_contacts(call: Call, run: Callable[[Call], Any]) -> Any:
    """Run a call for forces or wrenches on contacts that may not balance the base."""
    m, asked = call.robot.mechanism, call.computation
    if not all(map(is_numeric, call.arrays)):
        if are_limited(m):
            raise JounceError(
                f"{asked.name} of {m.name!r}: friction and soles are decided on numbers, got symbols or arrays of JAX;"
                " leave friction= and sole= of the contacts out"
            )
        return run(call)
    batch, arrays, _, _, _, active = find_balance(call, run)
    if call.presence:
        return solve_active(call, arrays, active)
    beyond = np.flatnonzero(active.any(axis=1))
    if not beyond.size:
        return run(call)
    results = [
        x.reshape((len(active), *x.shape[len(batch) :])).copy()
        for x in generic_methods.as_tuple(run(call._replace(out=None)))
    ]
    for x, changed in zip(results, solve_active(call, [x[beyond] for x in arrays], active[beyond]), strict=True):
        x[beyond] = changed
    return generic_methods.write_results(tuple(x.reshape((*batch, *x.shape[1:])) for x in results), call.out)


def find_balance(call: Call, run: Callable[[Call], Any]) -> Balance:
    """What balances the states of a call on contacts."""
    m, asked = call.robot.mechanism, call.computation
    ports = asked.signature(m).inputs
    arrays = broadcast(call.arrays, [len(port.shape) for port in ports], [port.name for port in ports])
    batch = arrays[0].shape[:-1]
    given = {port.name: x.reshape((-1, *port.shape)) for port, x in zip(ports, arrays, strict=True)}
    G, C = balance_maps(m, given["q"], given["base_pose"]), limit_rows(m.contacts)
    weights, sizes = np.concatenate([x.weights[x.held] for x in m.contacts]), [len(x.held) for x in m.contacts]
    presence = np.repeat(call.presence[0].clip(0), sizes, axis=1) if call.presence else np.ones_like(G[:, 0])
    check_condition(m, G * np.sqrt(presence)[:, None], batch)
    scales = np.sqrt(presence / weights)
    f, active = np.zeros((len(G), G.shape[-1])), np.zeros((len(G), len(C)))
    if len(C):
        first = replace(asked, name="contact_wrenches", order=0)
        taken = [given[port.name] for port in first.signature(m).inputs]
        least = call._replace(computation=first, arrays=taken, out=None)
        f = (solve_active(least, taken, active)[0] if call.presence else run(least)).reshape((len(G), -1))
        f = f[:, [6 * k + i for k, contact in enumerate(m.contacts) for i in contact.held]]
        # the weights make N and N m comparable
        levers = 1 / np.sqrt(weights)
        rounding = LIMIT_ROUNDING * np.abs(f / levers).max(axis=1, keepdims=True) * (np.abs(C) @ levers)
        for i in (f @ C.T > rounding).any(axis=1).nonzero()[0]:
            try:
                active[i] = _active_rows(m, G[i] * scales[i], f[i], C, scales[i])
            except UnbalancedError as error:
                raise UnbalancedError(error.reason, int(i), batch) from None
    return Balance(batch, list(given.values()), G, scales, f, active)


def solve_components(m: Mechanism, at: Balance, i: int, active: np.ndarray) -> np.ndarray:
    """The least components f (k,) that balance state i where rows are active."""
    rows = np.concatenate([at.G[i], limit_rows(m.contacts)[active > 0]]) * at.scales[i]
    F = at.G[i] @ at.least[i]
    return np.asarray(np.linalg.lstsq(rows, np.pad(F, (0, len(rows) - 6)))[0] * at.scales[i])


def check_condition(m: Mechanism, G: np.ndarray, batch: tuple[int, ...]) -> None:
    """Raise `UnbalancedError` where contacts hardly balance one direction, as three points on a line do."""
    balanced = np.where(G.any(axis=(1, 2), keepdims=True), G, np.nan)  # in flight nothing is
    lost, directions = find_unbalanced(m, balanced)
    if lost.size:
        columns, what = [x.frame for x in m.contacts for _ in x.held], describe_direction(m, directions[0])
        frames = join_names(dict.fromkeys(x for x, g in zip(columns, G[lost[0]].T, strict=True) if g.any()))
        raise UnbalancedError(f"{m.name!r}: contacts at {frames} do not balance {what}", int(lost[0]), batch)


def _active_rows(m: Mechanism, G: np.ndarray, f: np.ndarray, C: np.ndarray, scales: np.ndarray) -> np.ndarray:
    """(r,): 1 for the rows that are active in the solution, from G W^-1/2 and the least components f without limits."""
    from scipy.optimize import nnls  # imported here to keep start-up fast

    Z, there = np.linalg.svd(G)[2][6:].T, scales > 0
    size, rows = np.linalg.norm(f[there] / scales[there]), C * scales
    E = np.concatenate([(rows @ Z).T, (C @ f)[None] / size])
    # the sign of Z has no effect on u
    u, residual = nnls(E, np.append(np.zeros(len(E) - 1), 1.0))
    if residual < MIN_DUAL_RESIDUAL:
        raise _infeasible(m, C @ f)
    return (u > 0) * 1.0


def _infeasible(m: Mechanism, beyond: np.ndarray) -> UnbalancedError:
    names = [f"{name} of {quote_value(contact.frame)}" for contact in m.contacts for name, _ in contact.named_limits]
    return UnbalancedError(
        f"{m.name!r}: no contact wrenches within friction and soles balance the motion; slow it down, or state other"
        f" contacts: the least wrenches are farthest beyond {names[int(np.argmax(beyond))]}"
    )


def solve_active(call: Call, arrays: Sequence[Array], active: np.ndarray, of: Law | None = None) -> tuple[Array, ...]:
    """The results of a call, or of another law, for arrays (N, ...) where rows (N, r) are active, by the recursion."""
    m, asked = call.robot.mechanism, call.computation
    ports = asked.signature(m).inputs
    row, method = asked.quantity, default_method(asked.quantity)

    def law(x: Sequence[Array]) -> Series:
        given, rows, *rates = x[: len(ports)], *x[len(ports) :]
        presence = Series.of(rates) if rates else None
        return (of or row.law(method, m))(m, replace(asked.state(m, given), active=rows, presence=presence))

    more = [active, *call.presence[: asked.count]]
    of_contacts = [Port("of contacts", x.shape[1:], "state") for x in more]
    width = generic_methods.working_scalars(row, method, m.nb)
    return generic_methods.evaluate(law, [*ports, *of_contacts], [*arrays, *more], asked.count, width)
