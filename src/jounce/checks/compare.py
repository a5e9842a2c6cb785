"""Compare a robot's results at random states with other libraries at order 0, other methods, and differentiation.

Errors are norm-wise: the largest difference over the largest entry of all the states, or over the magnitude of what
is added up where that is larger, as where forces are zero.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import factorial
from pathlib import Path
from typing import Any

import numpy as np

from jounce.arguments.requests import takes_base
from jounce.checks.magnitudes import magnitudes, scale
from jounce.checks.reference import Absence, joint_rates, peers
from jounce.dynamics.computation import Computation
from jounce.dynamics.loop_branches import scales
from jounce.dynamics.quantities import DEFAULT_QUANTITY, QUANTITIES
from jounce.engine.engine import Engine, with_mechanism
from jounce.engine.generic_methods import as_tuple
from jounce.engine.plan import compute
from jounce.model.mechanism import Mechanism
from jounce.model.positions import multiscrew_joints, single_positions
from jounce.model.screws import from_screws
from jounce.spatial.series import rate_name

_DIFFERENCE_STEPS = 0.2 * 2.0 ** -np.arange(9)  # s: the best one counts, as truncation falls and rounding rises
# Of the first derivative at nine even points, of order 8 (Fornberg 1988).
_DIFFERENCE_STENCIL = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0, 4 / 5, -1 / 5, 4 / 105, -1 / 280])
_STATE_SPREAD = 0.1  # rad or sizes of the robot, per s, per s^2, ...: states of closed robots stay near the start
MAX_COMPARISON_ERRORS = {"exact": 1e-9, "differences": 1e-6}  # relative; differences cannot show less

_BASE_CARRIER = Engine(from_screws([np.eye(4)] * 6, np.roll(np.eye(6), 3, axis=0), np.zeros((6, 6, 6))))


@dataclass(frozen=True)
class ComparedQuantity:
    """The worst error of a quantity against another way to compute it, or the reason that it is not compared."""

    quantity: str
    against: str
    error: float | None
    allowed: float
    remark: str = ""

    @property
    def passed(self) -> bool:
        """Whether the error is one of rounding, or of differentiation where differences are compared."""
        return self.error is None or self.error <= self.allowed


def compare(
    robot: Engine, source: Path | None = None, *, order: int = 2, states: int = 20, seed: int = 0
) -> list[ComparedQuantity]:
    """Run the checks of a robot without drive terms; other libraries read its file `source`, if given."""
    rigid, rng = with_mechanism(robot, replace(robot.mechanism, acting=())), np.random.default_rng(seed)
    m, q = rigid.mechanism, rng.uniform(-1, 1, (order + 3, states, robot.n))
    if m.closure:
        own = list(m.closure.independent)
        q *= _STATE_SPREAD * scales(m).coordinates[own]
        q[0] += m.closure.start[own]
    x = _Motion(q, rng.uniform(-1, 1, (order + 3, states, 6)) if m.floats else None)
    sizes = x.forces(rigid) if m.closure else _sizes(m, order, x)  # squares outgrow what constraints are solved for
    return [
        *_compare_peers(rigid, source, x),
        *_compare_methods(rigid, x, sizes),
        *_compare_differences(rigid, x, sizes),
    ]


def _sizes(m: Mechanism, order: int, x: "_Motion") -> Sequence[np.ndarray]:
    """The magnitudes of forces and their rates."""
    base = x.base(len(x.q))
    return magnitudes(m, Computation(DEFAULT_QUANTITY.name, order, base=base is not None), [*x.rates(m), *(base or ())])


@dataclass(frozen=True)
class _Motion:
    """Rates of the coordinates, and of six joints that carry the base of a robot that floats.

    A joint of several screws is carried as a base is: by those of six joints whose screws it has.
    """

    q: np.ndarray
    carrier: np.ndarray | None

    def base(self, count: int) -> tuple[Any, ...] | None:
        """C, V, Vd, ... of the base, as many as there are rates of the coordinates; None if it does not float."""
        return None if self.carrier is None else _carry_body(self.carrier[:count])

    def rates(self, m: Mechanism, count: int | None = None) -> list[np.ndarray]:
        """q, qd, ... of a robot, as many as asked for, by default as there are rates of the coordinates."""
        q, *rates = self.q[:count].copy()
        q = q @ single_positions(m)
        for x in multiscrew_joints(m).values():
            six = np.zeros((*self.q[:count].shape[:-1], 6), dtype=self.q.dtype)
            six[..., (np.array(x.group.axes) + 3) % 6] = self.q[:count][..., x.coordinates]
            C, *twists = _carry_body(six)
            q[..., x.numbers] = x.group.numbers(C)
            for rate, V in zip(rates, twists, strict=True):
                rate[..., x.coordinates] = V[..., list(x.group.axes)]
        return [q, *rates]

    def forces(self, robot: Engine, count: int | None = None, **options: Any) -> tuple[Any, ...]:
        """Q and its rates from the first rates of the coordinates, by default from all of them."""
        q = self.rates(robot.mechanism, count)
        return as_tuple(compute(robot, DEFAULT_QUANTITY.name, q, base=self.base(len(q)), **options))

    def map(self, f: Callable[[np.ndarray], np.ndarray]) -> "_Motion":
        """The motion with other rates."""
        return _Motion(f(self.q), None if self.carrier is None else f(self.carrier))


def _carry_body(rates: np.ndarray) -> tuple[np.ndarray, ...]:
    """C, V, Vd, ... of a body on six joints with these rates."""
    C = compute(_BASE_CARRIER, "poses", [*rates[:1]], body="body6", method="recursion")
    more = (
        as_tuple(compute(_BASE_CARRIER, "twists", [*rates], body="body6", method="recursion")) if len(rates) > 1 else ()
    )
    return C, *more


def _compare_peers(robot: Engine, source: Path | None, x: _Motion) -> Iterator[ComparedQuantity]:
    m, q = robot.mechanism, x.rates(robot.mechanism)
    if m.closure:
        yield ComparedQuantity(
            "-", "other libraries", None, 0.0, "loops are closed: these would compute the forces of the tree"
        )
        return
    known = {row.gives.symbol: row for row in QUANTITIES.values() if row.gives.symbol in ("Q", "Qgrav", "M")}
    ours, sizes = {}, {}
    for symbol, row in known.items():
        base = x.base(row.takes.rates) if takes_base(row.name, "body") else None
        ours[symbol] = compute(robot, row.name, [*q[: row.takes.rates]], base=base)
        computation = Computation(row.name, 0, base=base is not None)
        sizes[symbol] = magnitudes(m, computation, [*q[: row.takes.rates], *(base or ())])[0]
    first = m.nv - m.n
    G = np.eye(first + len(m.joints), m.nv)
    G[first:, first:] = m.G
    thetas = zip(*joint_rates(m, q[:3]), strict=True)
    base = x.base(3)
    at = [(theta, base and tuple(term[i] for term in base)) for i, theta in enumerate(thetas)]
    at_rest = [((theta, 0 * rate, 0 * rate), base and (base[0], *np.zeros((2, 6)))) for (theta, rate, _), base in at]
    for peer in peers(m, source):
        if isinstance(peer, Absence):
            yield ComparedQuantity("-", peer.name, None, 0.0, peer.reason)
            continue
        theirs = {
            "Q": [peer.forces(theta, base) @ G for theta, base in at],
            "Qgrav": [peer.forces(theta, base) @ G for theta, base in at_rest],
            "M": [G.T @ peer.mass_matrix(theta, base and base[:1]) @ G for (theta, *_), base in at],
        }
        for name, expected in theirs.items():
            error = _error(ours[name], np.stack(expected), sizes[name])
            yield ComparedQuantity(name, peer.name, error, MAX_COMPARISON_ERRORS["exact"], peer.source)


def _compare_methods(robot: Engine, x: _Motion, sizes: Sequence[np.ndarray]) -> Iterator[ComparedQuantity]:
    """Compare with every other method, and with the recursion in extended precision."""
    own = x.forces(robot)
    paths: dict[str, Callable[[], Sequence[np.ndarray]]] = {
        "recursion": lambda: x.forces(robot, method="recursion"),
        "closed form": lambda: x.forces(robot, method="closed_form"),
        "long doubles": lambda: x.map(lambda q: q.astype(np.longdouble)).forces(robot, method="recursion"),
    }
    for name, results in paths.items():
        for k, (found, expected, size) in enumerate(zip(own, results(), sizes, strict=True)):
            yield ComparedQuantity(
                rate_name("Q", k), name, _error(found, expected, size), MAX_COMPARISON_ERRORS["exact"]
            )


def _compare_differences(robot: Engine, x: _Motion, sizes: Sequence[np.ndarray]) -> Iterator[ComparedQuantity]:
    """Compare each rate with nine-point differences of the lower one, along the polynomials that have the rates q."""
    exact = x.forces(robot)
    for k in range(1, len(exact)):
        errors = []
        for h in _DIFFERENCE_STEPS:
            along = [x.map(partial(_shift, t=j * h)).forces(robot, k + 2)[-1] for j in range(-4, 5)]
            errors.append(_error(np.tensordot(_DIFFERENCE_STENCIL, along, 1) / h, exact[k], sizes[k]))
        yield ComparedQuantity(
            rate_name("Q", k),
            f"differences of {rate_name('Q', k - 1)}",
            min(errors),
            MAX_COMPARISON_ERRORS["differences"],
        )


def _shift(q: np.ndarray, t: float) -> np.ndarray:
    """The rates q a time t later."""
    return np.stack([sum(x * t**j / factorial(j) for j, x in enumerate(q[k:])) for k in range(len(q))])


def _error(found: Any, expected: Any, magnitude: np.ndarray) -> float:
    return float(np.abs(found - expected).max()) / scale(expected, magnitude)
