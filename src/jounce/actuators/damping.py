"""Deflections of springs with a damper in parallel along a motion: phi(delta) + D delta' = Q, integrated over time.

Between samples Q is the quintic Hermite polynomial of Q, Qd, Q2d. A linear spring then has the exact solution
``delta(t + h) = e^-z delta(t) + h/D sum_j c_j I_j(z)`` with z = K h / D, the coefficients c_j of Q in u from 0 to 1,
and ``I_j = integral of e^(-z (1 - u)) u^j``. Other springs take the Radau IIA method of order 9 on the same
polynomials.
"""

from collections.abc import Callable, Sequence
from functools import cache

import numpy as np

from jounce.model.springs import Spring
from jounce.motion.hermite import between, coefficients

TERMS = 60  # of the recursion for the integrals, from the last one down
STAGES = 5  # of the Runge-Kutta method, which has the order 9
NEWTON, ROUNDING = 20, 1e-15  # its iterations, and the change that ends them, relative
Sides = tuple[Sequence[np.ndarray], Sequence[np.ndarray]]  # Q, Qd, Q2d (N, n) just before and just after times
Sampled = Callable[[np.ndarray], Sides]


def integrals(z: np.ndarray, count: int) -> np.ndarray:
    """I_j(z) = integral of e^(-z (1 - u)) u^j over 0 .. 1, for j < count: (count, ...).

    The recursion ``z I_j + j I_(j - 1) = 1`` is stable downward where j > z, and upward where j < z.
    """
    down, few = np.zeros_like(z), np.minimum(z, count)
    low: list[np.ndarray] = []
    for j in reversed(range(TERMS)):
        down = (1 - few * down) / (j + 1)  # I_j from I_(j + 1)
        low.insert(0, down)
    with np.errstate(divide="ignore", invalid="ignore"):
        up = -np.expm1(-z) / z
        high = [up]
        for j in range(1, count):
            up = (1 - j * up) / z
            high.append(up)
    return np.where(z < count, np.stack(low[:count]), np.stack(high))


def linear(K: np.ndarray, D: np.ndarray, t: np.ndarray, Q: Sides, start: np.ndarray) -> np.ndarray:
    """Deflections (N, n) of linear springs K (n,) with dampers D (n,) at times t (N,), from those at the first."""
    before, after = Q
    h = np.diff(t)[:, None]
    c = coefficients([rate[:-1] for rate in after], [rate[1:] for rate in before], h)[::-1]
    z = K * h / D
    driven = h / D * np.einsum("jik,jik->ik", c, integrals(z, len(c)))
    found, decay = [start], np.exp(-z)
    for factor, forced in zip(decay, driven, strict=True):
        found.append(factor * found[-1] + forced)
    return np.stack(found)


def nonlinear(spring: Spring, D: float, t: np.ndarray, Q: Sides, start: float) -> np.ndarray:
    """Deflections (N,) of one spring with a damper at times t (N,); Q is that of its joint, (N, 1)."""
    nodes, A = _radau()
    before, after = Q
    h = np.diff(t)[:, None]
    ends = [rate[:-1] for rate in after], [rate[1:] for rate in before]
    forces = np.hstack([between(*ends, h, np.full_like(h, u), 0)[0] for u in nodes])
    found = [start]
    for step, force in zip(h[:, 0] / D, forces, strict=True):
        stages = np.full(len(nodes), found[-1])
        for _ in range(NEWTON):
            phi = spring._derivatives(stages)
            residual = stages - found[-1] - step * A @ (force - phi[0])
            change = np.linalg.solve(np.eye(len(nodes)) + step * A * phi[1], residual)
            stages = stages - change
            if np.abs(change).max() <= ROUNDING * np.abs(stages).max():
                break
        found.append(float(stages[-1]))
    return np.array(found)


@cache
def _radau() -> tuple[np.ndarray, np.ndarray]:
    """The nodes and the matrix of a Radau IIA method, whose last stage is the end of the step."""
    polynomial = np.zeros(STAGES + 1)
    polynomial[-2:] = -1, 1
    nodes = (np.polynomial.legendre.legroots(polynomial) + 1) / 2
    nodes[-1] = 1
    powers = np.arange(STAGES)
    return nodes, nodes[:, None] ** (powers + 1) / (powers + 1) @ np.linalg.inv(nodes[:, None] ** powers)
