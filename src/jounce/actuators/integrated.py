"""Motor positions and torques along a motion where they take more than the state: dampers, and joints with two motors.

The deflection of a spring with a damper is a state: it is integrated from the start of the motion, where it is taken
from the series of the damper. tau then takes one rate of Q less than without a damper.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from jounce.actuators import damping
from jounce.actuators.variable import setting_of, stiffnesses_of
from jounce.arguments.rates import rates_in
from jounce.dynamics import deflections, elastic
from jounce.dynamics.quantities import FORCES
from jounce.dynamics.recursion.joints import rows
from jounce.dynamics.stretch import elasticity_of
from jounce.errors import JounceError
from jounce.model.inversion import UnreachableError
from jounce.model.springs import CubicSpring, DampedSpring
from jounce.motion.motion import Motion
from jounce.robot.along import Along, ForceBreak, forces_along
from jounce.spatial.series import Series, columns

if TYPE_CHECKING:
    from jounce.robot.robot import Robot

STEPS = 200  # of a motion, at least
ROUNDS = 8  # of halving them
AGREEMENT = 1e-12  # of deflections, with steps halved, relative
Rates = tuple[np.ndarray, ...]


def integrated_along(
    robot: "Robot", motion: Motion, t: Any, order: int, stiffness: Any, method: Any, progress: Any
) -> tuple[Along, Rates, Rates]:
    """The forces along a motion with what `elastic.motor_torques` makes of them: positions and torques, (N, m) each."""
    m, e = robot.mechanism, elasticity_of(robot.mechanism)
    shift = 1 if e.springs and all(isinstance(law, DampedSpring) for law in e.springs) else 2
    links = forces_along(robot, motion, t, order + shift, method, progress)
    q, Q = columns(links.rates), columns(links.forces)
    setting = setting_of(m, _stiffness_over_time(robot, stiffness, len(links.t), order + 3))
    try:
        setting = replace(setting, deflections=_integrated(robot, motion, links.t, Q, method))
        theta = elastic.motor_positions(m, q, lambda _: Q, setting)
        tau = elastic.motor_torques(m, q, lambda _: Q, setting)
        found = [[x[..., 0] for x in series.upto(k)] for series, k in ((theta, order + 2), (tau, order))]
    except UnreachableError as error:
        raise JounceError(f"{error}, at t = {links.t[error.state]:g} s") from None
    breaks = tuple(ForceBreak(b.t, max(b.order - shift, -1), None, b.causes) for b in links.breaks)
    return replace(links, breaks=breaks), tuple(found[0]), tuple(found[1])


def _stiffness_over_time(robot: "Robot", given: Any, times: int, count: int) -> list[np.ndarray]:
    """S, Sd, ... (N, k) at the times; one number, row or mapping alone is constant."""
    m = robot.mechanism
    if not elasticity_of(m).pairs:
        return []
    if given is not None and rates_in(given) is None:
        (constant,) = stiffnesses_of(m, given, 1)
        if constant.ndim == 1:
            return [np.tile(constant * (k == 0), (times, 1)) for k in range(count)]
    S = stiffnesses_of(m, given, count)
    for term in S:
        if term.shape[:-1] != (times,):
            raise JounceError(
                f"stiffness has shape {term.shape}; expected ({times}, {term.shape[-1]}), as many as times"
            )
    return S


def _integrated(robot: "Robot", motion: Motion, t: np.ndarray, Q: Series, method: Any) -> dict[int, np.ndarray]:
    """The deflections (N, 1, 1) of springs with dampers at times, by coordinate."""
    laws = {j: law for j, law in enumerate(elasticity_of(robot.mechanism).springs) if isinstance(law, DampedSpring)}
    if not laws:
        return {}
    joints = list(laws)
    sampled = _sampled(robot, motion, joints, method)
    breaks = [b.t for b in motion.breaks_to(FORCES.rates + 1) if motion.start < b.t < t.max()]
    even = np.linspace(motion.start, max(float(t.max()), motion.start), STEPS + 1)
    grid = np.unique(np.concatenate([even, t, breaks]))
    start = _settled(robot, motion, laws, method)
    known = _solve(list(laws.values()), grid, sampled, start)
    before = np.inf
    for _ in range(ROUNDS):
        finer = np.unique(np.concatenate([grid, (grid[1:] + grid[:-1]) / 2]))
        better = _solve(list(laws.values()), finer, sampled, start)
        change = np.abs(better[np.searchsorted(finer, grid)] - known).max(axis=0)
        grid, known = finer, better
        close = change <= AGREEMENT * np.abs(known).max(axis=0)
        if (close | (change > before / 2)).all():  # or rounding is what is left
            break
        before = change
    at = known[np.searchsorted(grid, t)]
    return {j: at[:, i : i + 1, None] for i, j in enumerate(joints)}


def _sampled(robot: "Robot", motion: Motion, joints: Sequence[int], method: Any) -> damping.Sampled:
    """Q, Qd, Q2d (N, k) of some joints just before and just after times of a motion."""

    def both(t: np.ndarray) -> tuple[list[np.ndarray], list[np.ndarray]]:
        sides = []
        for side in ("left", "right"):
            found = robot.inverse_dynamics(*motion(t, 4, side), wrench=motion.wrench(t, 2, side), method=method)
            sides.append([rate[:, joints] for rate in found])
        return sides[0], sides[1]

    return both


def _settled(robot: "Robot", motion: Motion, laws: dict[int, DampedSpring], method: Any) -> np.ndarray:
    """The deflections at the start: those of the series of the damper, which a robot at rest has exactly."""
    t = np.array([motion.start])
    rates = robot.inverse_dynamics(*motion(t, 4), wrench=motion.wrench(t, 2), method=method)
    Q, found = columns(rates), []
    for j, law in laws.items():
        sums = deflections.of_damped_spring(law.spring, law.damping, rows(Q, j, j + 1), len(rates))
        try:
            deflections.check_series(sums, law.time_constant)
        except JounceError:
            sums = sums[:2]  # the spring alone
        found.append(sums[-1][0][0, 0, 0])
    return np.array(found)


def _solve(laws: Sequence[DampedSpring], t: np.ndarray, Q: damping.Sampled, start: np.ndarray) -> np.ndarray:
    """The deflections (N, k) of springs with dampers at times."""
    sides = Q(t)
    parts = []
    for i, law in enumerate(laws):
        before, after = ([rate[:, i : i + 1] for rate in side] for side in sides)
        own = (before, after)
        spring = law.spring
        if isinstance(spring, CubicSpring) and spring.k3 == 0:
            K, D = np.array([spring.k]), np.array([law.damping])
            parts.append(damping.linear(K, D, t, own, start[i : i + 1])[:, 0])
        else:
            parts.append(damping.nonlinear(spring, law.damping, t, own, float(start[i])))
    return np.stack(parts, axis=1)
