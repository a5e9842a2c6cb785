"""Compare a robot's results at random states with other libraries at order 0, other methods, and differentiation.

Errors are norm-wise: the largest difference over the largest entry of all the states, or over the magnitude of what
is added up where that is larger, as where forces are zero.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from math import factorial
from pathlib import Path
from typing import Any

import numpy as np

from jounce.arguments.requests import takes_base
from jounce.checks.magnitudes import magnitudes, scale
from jounce.checks.reference import Absence, peers
from jounce.dynamics.computation import Computation
from jounce.dynamics.newton import scales
from jounce.dynamics.quantities import FORCES, QUANTITIES
from jounce.engine.dispatch import compute
from jounce.engine.engine import Engine, like
from jounce.engine.generic import as_tuple
from jounce.model.mechanism import Mechanism
from jounce.model.positions import position_count, positions, single_positions
from jounce.model.screws import from_screws
from jounce.spatial.lie import wedge
from jounce.spatial.series import rate_name

STEPS = 0.2 * 2.0 ** -np.arange(9)  # s, of differences; the best one counts
STENCIL = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0, 4 / 5, -1 / 5, 4 / 105, -1 / 280])  # of nine points
NEAR = 0.1  # rad or sizes of the robot, and per s, per s^2, ...: how states of closed robots vary about the start
TERMS = 60  # of series in time of rotations, by which these are exact over the steps
ALLOWED = {"exact": 1e-9, "differences": 1e-6}  # what an error may be; differences cannot show less

CARRIER = Engine(from_screws([np.eye(4)] * 6, np.roll(np.eye(6), 3, axis=0), np.zeros((6, 6, 6))))


@dataclass(frozen=True)
class Check:
    """The worst error of a quantity against another way to compute it, or the reason that it is not compared."""

    quantity: str
    against: str
    error: float | None
    allowed: float
    remark: str = ""

    @property
    def passed(self) -> bool:
        """Whether the error is one of rounding, or of differentiation where that is what it was compared with."""
        return self.error is None or self.error <= self.allowed


def compare(
    robot: Engine, source: Path | None = None, *, order: int = 2, states: int = 20, seed: int = 0
) -> list[Check]:
    """Run the checks of a robot without drive terms; other libraries read its file `source`, if given."""
    rigid, rng = like(robot, replace(robot.mechanism, acting=())), np.random.default_rng(seed)
    m, q = rigid.mechanism, [*rng.uniform(-1, 1, (order + 3, states, robot.n))]
    if m.closure:
        own = list(m.closure.independent)
        q = [x * NEAR * scales(m).coordinates[own] for x in q]
        q[0] += m.closure.start[own]
    if positions(m):
        q[0] = rng.uniform(-1, 1, (states, position_count(m)))
    x = _Motion(q, rng.uniform(-1, 1, (order + 3, states, 6)) if m.floats else None)
    sizes = x.forces(rigid) if m.closure else _sizes(m, order, x)  # squares outgrow what constraints are solved for
    return [*_with_peers(rigid, source, x), *_with_paths(rigid, x, sizes), *_with_differences(rigid, x, sizes)]


def _sizes(m: Mechanism, order: int, x: "_Motion") -> Sequence[np.ndarray]:
    """The magnitudes of forces and their rates."""
    base = x.base(len(x.q))
    return magnitudes(m, Computation(FORCES.name, order, base=base is not None), [*x.q, *(base or ())])


@dataclass(frozen=True)
class _Motion:
    """Rates of the coordinates, and of six joints that carry the base of a robot that floats."""

    q: Sequence[np.ndarray]
    carrier: np.ndarray | None

    def base(self, count: int) -> tuple[Any, ...] | None:
        """C, V, Vd, ... of the base, as many as there are rates of the coordinates; None if it does not float."""
        if self.carrier is None:
            return None
        C = compute(CARRIER, "poses", [*self.carrier[:1]], body="body6", method="recursion")
        rates = self.carrier[:count]
        return C, *(
            as_tuple(compute(CARRIER, "twists", [*rates], body="body6", method="recursion")) if count > 1 else ()
        )

    def forces(self, robot: Engine, count: int | None = None, **options: Any) -> tuple[Any, ...]:
        """Q and its rates from the first rates of the coordinates, by default from all of them."""
        q = self.q[:count]
        return as_tuple(compute(robot, FORCES.name, [*q], base=self.base(len(q)), **options))

    def exactly(self) -> "_Motion":
        """The motion in extended precision."""
        carrier = None if self.carrier is None else self.carrier.astype(np.longdouble)
        return _Motion([x.astype(np.longdouble) for x in self.q], carrier)

    def later(self, m: Mechanism, t: float) -> "_Motion":
        """The motion a time t later."""
        q = _shift(self.q[1:], t)
        q.insert(0, _moved(m, self.q, t))
        return _Motion(q, None if self.carrier is None else np.stack(_shift([*self.carrier], t)))


def _with_peers(robot: Engine, source: Path | None, x: _Motion) -> Iterator[Check]:
    m, q = robot.mechanism, x.q
    if m.closure:
        yield Check("-", "other libraries", None, 0.0, "loops are closed: these would compute the forces of the tree")
        return
    if positions(m):
        yield Check("-", "other libraries", None, 0.0, "they are compared where every joint has one screw")
        return
    known = {row.symbol: row for row in QUANTITIES.values() if row.symbol in ("Q", "Qgrav", "M")}
    ours, sizes = {}, {}
    for symbol, row in known.items():
        base = x.base(row.rates) if takes_base(row.name, "body") else None
        ours[symbol] = compute(robot, row.name, [*q[: row.rates]], base=base)
        computation = Computation(row.name, 0, base=base is not None)
        sizes[symbol] = magnitudes(m, computation, [*q[: row.rates], *(base or ())])[0]
    first = m.nv - m.n
    G = np.eye(first + len(m.joints), m.nv)
    G[first:, first:] = m.G
    thetas = zip(q[0] @ m.G.T + m.g, q[1] @ m.G.T, q[2] @ m.G.T, strict=True)
    base = x.base(3)
    at = [(theta, base and tuple(term[i] for term in base)) for i, theta in enumerate(thetas)]
    at_rest = [((theta, 0 * theta, 0 * theta), base and (base[0], *np.zeros((2, 6)))) for (theta, *_), base in at]
    for peer in peers(m, source):
        if isinstance(peer, Absence):
            yield Check("-", peer.name, None, 0.0, peer.reason)
            continue
        theirs = {
            "Q": [peer.forces(theta, base) @ G for theta, base in at],
            "Qgrav": [peer.forces(theta, base) @ G for theta, base in at_rest],
            "M": [G.T @ peer.mass_matrix(theta, base and base[:1]) @ G for (theta, *_), base in at],
        }
        for name, expected in theirs.items():
            error = _error(ours[name], np.stack(expected), sizes[name])
            yield Check(name, peer.name, error, ALLOWED["exact"], peer.source)


def _with_paths(robot: Engine, x: _Motion, sizes: Sequence[np.ndarray]) -> Iterator[Check]:
    """Compare with every other method, and with the recursion in extended precision."""
    own = x.forces(robot)
    paths: dict[str, Callable[[], Sequence[np.ndarray]]] = {
        "recursion": lambda: x.forces(robot, method="recursion"),
        "closed form": lambda: x.forces(robot, method="closed_form"),
        "long doubles": lambda: x.exactly().forces(robot, method="recursion"),
    }
    for name, results in paths.items():
        for k, (found, expected, size) in enumerate(zip(own, results(), sizes, strict=True)):
            yield Check(rate_name("Q", k), name, _error(found, expected, size), ALLOWED["exact"])


def _with_differences(robot: Engine, x: _Motion, sizes: Sequence[np.ndarray]) -> Iterator[Check]:
    """Compare each rate with nine-point differences of the lower one, along the polynomials that have the rates q."""
    exact = x.forces(robot)
    for k in range(1, len(exact)):
        errors = []
        for h in STEPS:
            along = [x.later(robot.mechanism, j * h).forces(robot, k + 2)[-1] for j in range(-4, 5)]
            errors.append(_error(np.tensordot(STENCIL, along, 1) / h, exact[k], sizes[k]))
        yield Check(rate_name("Q", k), f"differences of {rate_name('Q', k - 1)}", min(errors), ALLOWED["differences"])


def _shift(q: Sequence[np.ndarray], t: float) -> list[np.ndarray]:
    """The rates q a time t later."""
    return [np.sum([x * t**j / factorial(j) for j, x in enumerate(q[k:])], axis=0) for k in range(len(q))]


def _moved(m: Mechanism, q: Sequence[np.ndarray], t: float) -> np.ndarray:
    """The positions a time t later, those of joints of several screws by the series of H' = H wedge(X nu)."""
    way: Any = sum(x * t**j / factorial(j) for j, x in enumerate(q[1:], 1))
    found = q[0] + way @ single_positions(m)
    for joint in positions(m).values():
        twists = [wedge(x[:, joint.coordinates] @ joint.group.X.T) / factorial(j) for j, x in enumerate(q[1:])]
        H = [joint.group.pose(q[0][:, joint.numbers])]
        for k in range(TERMS):
            H.append(sum(a @ b for a, b in zip(reversed(H), twists, strict=False)) / (k + 1))
        found[:, joint.numbers] = joint.group.numbers(sum(x * t**k for k, x in enumerate(H)))
    return found


def _error(found: Any, expected: Any, magnitude: np.ndarray) -> float:
    return float(np.abs(found - expected).max()) / scale(expected, magnitude)
