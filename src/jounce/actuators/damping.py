"""Deflections of springs with a damper in parallel along a motion: phi(delta) + D delta' = Q, integrated over time.

Between samples Q is the quintic Hermite polynomial of Q, Qd, Q2d. A linear spring then has the exact solution
``delta(t + h) = e^-z delta(t) + h/D sum_j c_j I_j(z)`` with z = K h / D, the coefficients c_j of Q in u from 0 to 1,
and ``I_j = integral of e^(-z (1 - u)) u^j``. Other springs take the Radau IIA method of order 9 [1] on the same
polynomials, which is L-stable: time constants D / K may be far below the step. Deflections start from the series of the
damper, which a robot at rest has exactly.

All steps are halved until deflections no longer change; breaks of the motion are ends of steps, as no polynomial passes
them. It fails, with `JounceError`, where a deflection leaves the range of its spring, and where the last halving still
changes it.

[1] E. Hairer, G. Wanner, Solving Ordinary Differential Equations II, 2nd edition, 1996, section IV.8.
"""

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import numpy as np

from jounce.core.errors import JounceError, quote_value
from jounce.dynamics import deflections
from jounce.dynamics.joint_springs import elasticity_of
from jounce.dynamics.quantities import DEFAULT_QUANTITY
from jounce.dynamics.recursion.joints import take_rows
from jounce.engine.along import SIDES
from jounce.engine.engine import Engine
from jounce.engine.motion_states import MotionStates, Side
from jounce.model.springs import CubicSpring, DampedSpring, Spring
from jounce.motion.hermite import hermite_coefficients, interpolate_hermite
from jounce.motion.motion import Motion
from jounce.spatial.series import column_series

_DOWNWARD_TERMS = 60  # of the recursion downward, where z < 6: it then neglects less than 6^60 / 60! = 1e-35
_RADAU_STAGES = 5  # of the Runge-Kutta method, which has order 9: above that of the quintics of Q
_MAX_STAGE_STEPS = 20  # of Newton's method for the stages, which converges quadratically
_STAGE_TOLERANCE = 1e-15  # relative change of the stages that ends Newton's method: rounding
_FIRST_DAMPER_STEPS = 200  # of a motion, which resolve most motions
_MAX_DAMPER_HALVINGS = 8  # of the steps: the error, which goes with their sixth power, is then 3e14 times smaller
_DEFLECTION_TOLERANCE = 1e-12  # relative change by halved steps: the error that is left is a small part of it
_MAX_DEFLECTION_CHANGE = 1e-8  # relative, by the last halving: resolved motions leave less than a tenth of it as error
Sides = tuple[Sequence[np.ndarray], Sequence[np.ndarray]]  # Q, Qd, Q2d (N, n) just before and just after times
Sampled = Callable[[np.ndarray], Sides]


def integrate_deflections(robot: Engine, motion: Motion, t: np.ndarray, method: Any) -> dict[int, np.ndarray]:
    """The deflections (N, 1, 1) of springs with dampers at times, by coordinate."""
    laws = {j: law for j, law in enumerate(elasticity_of(robot.mechanism).springs) if isinstance(law, DampedSpring)}
    if not laws:
        return {}
    joints = list(laws)
    sampled = _sample_forces(robot, motion, joints, method)
    breaks = [b.t for b in motion.breaks_to(DEFAULT_QUANTITY.takes.rates + 1) if motion.start < b.t < t.max()]
    even = np.linspace(motion.start, max(float(t.max()), motion.start), _FIRST_DAMPER_STEPS + 1)
    grid = np.unique(np.concatenate([even, t, breaks]))
    start = _initial_deflections(robot, motion, laws, method)
    known = _solve(list(laws.values()), grid, sampled, start)
    before = np.inf
    for _ in range(_MAX_DAMPER_HALVINGS):
        # Solve again with a time halfway between neighbours, and compare at the old times.
        finer = np.unique(np.concatenate([grid, (grid[1:] + grid[:-1]) / 2]))
        better = _solve(list(laws.values()), finer, sampled, start)
        change = np.abs(better[np.searchsorted(finer, grid)] - known).max(axis=0)
        grid, known = finer, better
        _check_ends(robot, laws, grid, known)
        size = np.abs(known).max(axis=0)
        resolved = change <= _MAX_DEFLECTION_CHANGE * size
        # Done where nothing changes, or where changes are small and no longer fall: rounding is what is left.
        close = change <= _DEFLECTION_TOLERANCE * size
        if (close | (resolved & (change > before / 2))).all():
            break
        before = change
    if not resolved.all():
        i = int(np.argmin(resolved))
        raise JounceError(
            f"joint {quote_value(robot.joint_names[joints[i]])}: the deflection of the spring with a damper is not"
            f" resolved by {len(grid) - 1} steps; the last halving changed it by {change[i] / size[i]:.1g} of its size;"
            " give more times t, which become steps"
        )
    at = known[np.searchsorted(grid, t)]
    return {j: at[:, i : i + 1, None] for i, j in enumerate(joints)}


def _check_ends(robot: Engine, laws: dict[int, DampedSpring], t: np.ndarray, known: np.ndarray) -> None:
    """Raise `JounceError` where a deflection (N, k) has left its spring; it is NaN after that."""
    for i, (j, law) in enumerate(laws.items()):
        if (gone := np.flatnonzero(np.isnan(known[:, i]))).size:
            low, high = law.spring.range
            raise JounceError(
                f"joint {quote_value(robot.joint_names[j])}: the spring with a damper is deflected beyond its ends,"
                f" {low:g} to {high:g}, at t = {t[gone[0]]:g} s"
            )


def _sample_forces(robot: Engine, motion: Motion, joints: Sequence[int], method: Any) -> Sampled:
    """Q, Qd, Q2d (N, k) of some joints just before and just after times of a motion."""

    def both(t: np.ndarray) -> tuple[list[np.ndarray], list[np.ndarray]]:
        before, after = ([rate[:, joints] for rate in _joint_forces(robot, motion, t, side, method)] for side in SIDES)
        return before, after

    return both


def _joint_forces(robot: Engine, motion: Motion, t: np.ndarray, side: Side, method: Any) -> list[np.ndarray]:
    """Q, Qd, Q2d (N, n) of the joints."""
    states = MotionStates.sample(robot, motion, t, [(DEFAULT_QUANTITY, 2)], side)
    return [rate[:, -robot.n :] for rate in states.compute(robot, DEFAULT_QUANTITY.name, method)]


def _initial_deflections(robot: Engine, motion: Motion, laws: dict[int, DampedSpring], method: Any) -> np.ndarray:
    """The deflections at the start: those of the series of the damper, which a robot at rest has exactly."""
    t = np.array([motion.start])
    rates = _joint_forces(robot, motion, t, "right", method)
    Q, found = column_series(rates), []
    for j, law in laws.items():
        sums = deflections.expand_damped_deflection(law.spring, law.damping, take_rows(Q, j, j + 1), len(rates))
        try:
            deflections.check_series(sums, law.time_constant)
        except JounceError:
            sums = sums[:2]  # the spring alone
        found.append(sums[-1][0][0, 0, 0])
    return np.array(found)


def _solve(laws: Sequence[DampedSpring], t: np.ndarray, Q: Sampled, start: np.ndarray) -> np.ndarray:
    """The deflections (N, k) of springs with dampers at times."""
    sides = Q(t)
    parts = []
    for i, law in enumerate(laws):
        before, after = ([rate[:, i : i + 1] for rate in side] for side in sides)
        own = (before, after)
        spring = law.spring
        if isinstance(spring, CubicSpring) and spring.k3 == 0:
            K, D = np.array([spring.k]), np.array([law.damping])
            parts.append(integrate_linear(K, D, t, own, start[i : i + 1])[:, 0])
        else:
            parts.append(integrate_nonlinear(spring, law.damping, t, own, float(start[i])))
    return np.stack(parts, axis=1)


def exponential_integrals(z: np.ndarray, count: int) -> np.ndarray:
    """I_j(z) = integral of e^(-z (1 - u)) u^j over 0 .. 1, for j < count: (count, ...).

    The recursion ``z I_j + j I_(j - 1) = 1`` is stable downward where j > z, and upward where j < z.
    """
    down, few = np.zeros_like(z), np.minimum(z, count)
    low: list[np.ndarray] = []
    for j in reversed(range(_DOWNWARD_TERMS)):
        down = (1 - few * down) / (j + 1)  # I_j from I_(j + 1)
        low.insert(0, down)
    with np.errstate(divide="ignore", invalid="ignore"):
        up = -np.expm1(-z) / z
        high = [up]
        for j in range(1, count):
            up = (1 - j * up) / z
            high.append(up)
    return np.where(z < count, np.stack(low[:count]), np.stack(high))


def integrate_linear(K: np.ndarray, D: np.ndarray, t: np.ndarray, Q: Sides, start: np.ndarray) -> np.ndarray:
    """Deflections (N, n) of linear springs K (n,) with dampers D (n,) at times t (N,), from those at the first."""
    before, after = Q
    h = np.diff(t)[:, None]
    c = hermite_coefficients([rate[:-1] for rate in after], [rate[1:] for rate in before], h)[::-1]
    z = K * h / D
    driven = h / D * np.einsum("jik,jik->ik", c, exponential_integrals(z, len(c)))
    found, decay = [start], np.exp(-z)
    for factor, forced in zip(decay, driven, strict=True):
        found.append(factor * found[-1] + forced)
    return np.stack(found)


def integrate_nonlinear(spring: Spring, D: float, t: np.ndarray, Q: Sides, start: float) -> np.ndarray:
    """Deflections (N,) of one spring with a damper at times t (N,); Q is that of its joint, (N, 1).

    They are NaN once they have left the range of the spring.
    """
    nodes, A = _radau()
    before, after = Q
    h = np.diff(t)[:, None]
    ends = [rate[:-1] for rate in after], [rate[1:] for rate in before]
    forces = np.hstack([interpolate_hermite(*ends, h, np.full_like(h, u), 0)[0] for u in nodes])
    found, (low, high) = [start], spring.range
    for step, force in zip(h[:, 0] / D, forces, strict=True):
        if not low <= found[-1] <= high:
            break
        # Newton's method for the deflections at the stages, from that at the start of the step.
        stages = np.full(len(nodes), found[-1])
        for _ in range(_MAX_STAGE_STEPS):
            phi = spring._derivatives(stages)
            residual = stages - found[-1] - step * A @ (force - phi[0])
            change = np.linalg.solve(np.eye(len(nodes)) + step * A * phi[1], residual)
            stages = stages - change
            if np.abs(change).max() <= _STAGE_TOLERANCE * np.abs(stages).max():
                break
        found.append(float(stages[-1]))
    deflection = np.full(len(t), np.nan)
    deflection[: len(found)] = found
    return np.where((low <= deflection) & (deflection <= high), deflection, np.nan)


@cache
def _radau() -> tuple[np.ndarray, np.ndarray]:
    """The nodes and the matrix of a Radau IIA method, whose last stage is the end of the step."""
    polynomial = np.zeros(_RADAU_STAGES + 1)
    polynomial[-2:] = -1, 1
    nodes = (np.polynomial.legendre.legroots(polynomial) + 1) / 2
    nodes[-1] = 1
    powers = np.arange(_RADAU_STAGES)
    return nodes, nodes[:, None] ** (powers + 1) / (powers + 1) @ np.linalg.inv(nodes[:, None] ** powers)
