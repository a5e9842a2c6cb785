"""Compare a robot's results at random states with other libraries at order 0, other methods, and differentiation.

Errors are norm-wise: the largest difference over the largest entry of all the states, or over the magnitude of what
is added up where that is larger, as where forces are zero.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import factorial
from pathlib import Path
from typing import Any

import numpy as np

from jounce.arguments.requests import takes_base
from jounce.checks.magnitudes import magnitudes, scale
from jounce.checks.reference import Absence, peers
from jounce.dynamics.computation import Computation
from jounce.dynamics.quantities import FORCES, QUANTITIES
from jounce.robot import Robot
from jounce.robot.dispatch import compute
from jounce.robot.generic import as_tuple
from jounce.spatial.series import rate_name

STEPS = 0.2 * 2.0 ** -np.arange(9)  # s, of differences; the best one counts
STENCIL = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0, 4 / 5, -1 / 5, 4 / 105, -1 / 280])  # of nine points
ALLOWED = {"exact": 1e-9, "differences": 1e-6}  # what an error may be; differences cannot show less


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
    robot: Robot, source: Path | None = None, *, order: int = 2, states: int = 20, seed: int = 0
) -> list[Check]:
    """Run the checks of a robot without drive terms; other libraries read its file `source`, if given."""
    rigid, rng = robot.with_drives(False), np.random.default_rng(seed)
    moving = _Moving(rigid, *(rng.uniform(-1, 1, (order + 3, states, n)) for n in (robot.n, 6)))
    asked = Computation(FORCES.name, order, base=bool(moving.base))
    sizes = magnitudes(rigid.mechanism, asked, [*moving.q, *moving.base])
    return [*_with_peers(moving, source), *_with_paths(moving, sizes), *_with_differences(moving, sizes)]


@dataclass(frozen=True, eq=False)
class _Moving:
    """A robot in motion, by q, qd, ... of its states; if it floats, a carrier of six joints x moves its base."""

    robot: Robot
    q: np.ndarray
    x: np.ndarray

    @cached_property
    def base(self) -> tuple[np.ndarray, ...]:
        """C, V, Vd, ... of the base if the robot floats."""
        if not self.robot.mechanism.base:
            return ()
        parent = [-1, 0, 1, 2, 3, 4]
        carrier = Robot.from_screws([np.eye(4)] * 6, np.eye(6)[[3, 4, 5, 0, 1, 2]], [np.eye(6)] * 6, parent)
        last = carrier.body_names[-1]
        return (carrier.poses(self.x[0], body=last), *as_tuple(carrier.twists(*self.x, body=last)))

    def of(self, name: str, count: int, method: str | None = None) -> Any:
        """A quantity, from as many rates."""
        moved = self.base[:count] if takes_base(name, "body") else ()
        return compute(self.robot, name, [*self.q[:count]], base=moved or None, method=method)

    def magnitude(self, name: str, count: int) -> np.ndarray:
        """The magnitudes of a quantity, from as many rates."""
        moved = self.base[:count] if takes_base(name, "body") else ()
        asked = Computation(name, 0, base=bool(moved))
        return magnitudes(self.robot.mechanism, asked, [*self.q[:count], *moved])[0]

    def forces(self, method: str | None = None) -> tuple[Any, ...]:
        """Q, Qd, ..."""
        return as_tuple(self.of(FORCES.name, len(self.q), method))

    def shifted(self, t: float, count: int) -> "_Moving":
        """The state a time t later, along polynomials that have these rates, with so many of them."""
        return _Moving(self.robot, _shift(self.q, t)[:count], _shift(self.x, t)[:count])

    def in_long_doubles(self) -> "_Moving":
        """The same state."""
        return _Moving(self.robot, self.q.astype(np.longdouble), self.x.astype(np.longdouble))


def _with_peers(moving: _Moving, source: Path | None) -> Iterator[Check]:
    m, q = moving.robot.mechanism, moving.q
    first = m.nv - m.n
    G = np.block([[np.eye(first), np.zeros((first, m.n))], [np.zeros((m.nb, first)), m.G]])
    thetas = [q[0] @ m.G.T + m.g, q[1] @ m.G.T, q[2] @ m.G.T, *moving.base[:3]]
    known = {x.symbol: x for x in QUANTITIES.values() if x.symbol in ("Q", "Qgrav", "M")}
    ours = {symbol: moving.of(x.name, x.rates) for symbol, x in known.items()}
    sizes = {symbol: moving.magnitude(x.name, x.rates) for symbol, x in known.items()}
    for peer in peers(m, source):
        if isinstance(peer, Absence):
            yield Check("-", peer.name, None, 0.0, peer.reason)
            continue
        at_rest = [theta if k in (0, 3) else 0 * theta for k, theta in enumerate(thetas)]
        theirs = {
            "Q": [peer.forces(*theta) @ G for theta in zip(*thetas, strict=True)],
            "Qgrav": [peer.forces(*theta) @ G for theta in zip(*at_rest, strict=True)],
            "M": [G.T @ peer.mass_matrix(theta) @ G for theta in thetas[0]],
        }
        for name, expected in theirs.items():
            error = _error(ours[name], np.stack(expected), sizes[name])
            yield Check(name, peer.name, error, ALLOWED["exact"], peer.source)


def _with_paths(moving: _Moving, sizes: Sequence[np.ndarray]) -> Iterator[Check]:
    """Compare with every other method, and with the recursion in extended precision."""
    own = moving.forces()
    paths: dict[str, Callable[[], Sequence[np.ndarray]]] = {
        "recursion": lambda: moving.forces("recursion"),
        "closed form": lambda: moving.forces("closed_form"),
        "long doubles": lambda: moving.in_long_doubles().forces("recursion"),
    }
    for name, results in paths.items():
        for k, (x, y, size) in enumerate(zip(own, results(), sizes, strict=True)):
            yield Check(rate_name("Q", k), name, _error(x, y, size), ALLOWED["exact"])


def _with_differences(moving: _Moving, sizes: Sequence[np.ndarray]) -> Iterator[Check]:
    """Compare each rate with nine-point differences of the lower one, along the polynomials that have the rates q."""
    exact = moving.forces()
    for k in range(1, len(exact)):
        errors = []
        for h in STEPS:
            along = [moving.shifted(j * h, k + 2).forces()[-1] for j in range(-4, 5)]
            errors.append(_error(np.tensordot(STENCIL, along, 1) / h, exact[k], sizes[k]))
        yield Check(rate_name("Q", k), f"differences of {rate_name('Q', k - 1)}", min(errors), ALLOWED["differences"])


def _shift(q: np.ndarray, t: float) -> np.ndarray:
    """The rates q a time t later."""
    return np.stack([sum(x * t**j / factorial(j) for j, x in enumerate(q[k:])) for k in range(len(q))])


def _error(found: Any, expected: Any, magnitude: np.ndarray) -> float:
    return float(np.abs(found - expected).max()) / scale(expected, magnitude)
