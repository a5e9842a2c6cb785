"""Compare a robot's results at random states with other libraries at order 0, other methods, and differentiation.

Errors are norm-wise: the largest difference over the largest entry of all the states, or over the magnitude of what
is added up where that is larger, as where forces are zero.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from math import factorial
from pathlib import Path
from typing import Any

import numpy as np

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
    q = rng.uniform(-1, 1, (order + 3, states, robot.n))
    sizes = magnitudes(rigid.mechanism, Computation(FORCES.name, order), [*q])
    return [*_with_peers(rigid, source, q), *_with_paths(rigid, q, sizes), *_with_differences(rigid, q, sizes)]


def _with_peers(robot: Robot, source: Path | None, q: np.ndarray) -> Iterator[Check]:
    m, G = robot.mechanism, robot.mechanism.G
    thetas = [q[0] @ G.T + m.g, q[1] @ G.T, q[2] @ G.T]
    known = {x.symbol: x for x in QUANTITIES.values() if x.symbol in ("Q", "Qgrav", "M")}
    ours = {symbol: compute(robot, x.name, [*q[: x.rates]]) for symbol, x in known.items()}
    sizes = {symbol: magnitudes(m, Computation(x.name, 0), [*q[: x.rates]])[0] for symbol, x in known.items()}
    for peer in peers(m, source):
        if isinstance(peer, Absence):
            yield Check("-", peer.name, None, 0.0, peer.reason)
            continue
        theirs = {
            "Q": [peer.forces(*theta) @ G for theta in zip(*thetas, strict=True)],
            "Qgrav": [peer.forces(theta, 0 * theta, 0 * theta) @ G for theta in thetas[0]],
            "M": [G.T @ peer.mass_matrix(theta) @ G for theta in thetas[0]],
        }
        for name, expected in theirs.items():
            error = _error(ours[name], np.stack(expected), sizes[name])
            yield Check(name, peer.name, error, ALLOWED["exact"], peer.source)


def _with_paths(robot: Robot, q: np.ndarray, sizes: Sequence[np.ndarray]) -> Iterator[Check]:
    """Compare with every other method, and with the recursion in extended precision."""
    own = as_tuple(robot.inverse_dynamics(*q))
    paths: dict[str, Callable[[], Sequence[np.ndarray]]] = {
        "recursion": lambda: as_tuple(robot.inverse_dynamics(*q, method="recursion")),
        "closed form": lambda: as_tuple(robot.inverse_dynamics(*q, method="closed_form")),
        "long doubles": lambda: as_tuple(robot.inverse_dynamics(*q.astype(np.longdouble), method="recursion")),
    }
    for name, results in paths.items():
        for k, (x, y, size) in enumerate(zip(own, results(), sizes, strict=True)):
            yield Check(rate_name("Q", k), name, _error(x, y, size), ALLOWED["exact"])


def _with_differences(robot: Robot, q: np.ndarray, sizes: Sequence[np.ndarray]) -> Iterator[Check]:
    """Compare each rate with nine-point differences of the lower one, along the polynomials that have the rates q."""
    exact = as_tuple(robot.inverse_dynamics(*q))
    for k in range(1, len(exact)):
        errors = []
        for h in STEPS:
            along = [as_tuple(robot.inverse_dynamics(*_shift(q, j * h)[: k + 2]))[-1] for j in range(-4, 5)]
            errors.append(_error(np.tensordot(STENCIL, along, 1) / h, exact[k], sizes[k]))
        yield Check(rate_name("Q", k), f"differences of {rate_name('Q', k - 1)}", min(errors), ALLOWED["differences"])


def _shift(q: np.ndarray, t: float) -> np.ndarray:
    """The rates q a time t later."""
    return np.stack([sum(x * t**j / factorial(j) for j, x in enumerate(q[k:])) for k in range(len(q))])


def _error(found: Any, expected: Any, magnitude: np.ndarray) -> float:
    return float(np.abs(found - expected).max()) / scale(expected, magnitude)
