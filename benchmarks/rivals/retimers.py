"""Retimers: how jounce, toppra, copp and ruckig are called, each answer as the motion that a controller is sent.

A retimer takes a `Problem` and returns an `Answer`, whose rates of q are evaluated exactly: the polynomials of the path
with the time law between grid points as the library's documents say. With s the path's parameter, x = s'(t)^2:

* toppra (`ParametrizeConstAccel`, which its tutorial names as keeping constraints) and copp of second order: x is
  linear between grid points.
* copp of third order: s'' is linear in s between grid points; s is cubic in time next to a rest ("stationary").
* ruckig: pieces of constant jerk. jounce: its `Motion`.

Grids are those of the documents: toppra chooses its own (`propose_gridpoints`), examples of copp have 1,001 points.
copp gets rows of torques in one batch (`add_constraint_2nd`), which takes a sixth of the time of its calls of Python
for each point, and rows of torque rates (`add_constraint_3rd`), which it does not make itself: both by the inverse
dynamics of jounce. Its third order is solved by linear programs (`topp3_lp`), whose durations here are those of its
cones, in up to a third of the time.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from jounce import Motion, Robot
from jounce.limits.retime import GRID_POINTS_PER_INTERVAL

INSET = 1e-9  # of an interval: times this close to its ends are within it
JUMPING_POINTS = 2  # of each interval at which jounce keeps limits where accelerations jump, its end left out
RUCKIG_POINTS = 50  # of each piece of constant jerk, which has no grid
MIN_GAIN = 1e-3  # of the duration: another program of copp that gains less is the last
MAX_PROGRAMS = 6
Rates = tuple[np.ndarray, ...]


@dataclass(frozen=True, eq=False)
class Problem:
    """A path, as polynomials of u from 0 to 1, and limits.

    `robot` has the limits of the problem, `judge` those that shares are taken of; `motion` passes the path, from rest
    to rest, and is what jounce is given.
    """

    title: str
    robot: Robot
    judge: Robot
    path: np.ndarray  # (n, degree + 1), the lowest power first
    motion: Motion

    def derivatives(self, u: np.ndarray, order: int = 3) -> list[np.ndarray]:
        """Return the path and its derivatives by u, each of the shape of u and (n,)."""
        powers = [np.polynomial.polynomial.polyder(self.path, k, axis=1).T for k in range(order + 1)]
        return [np.moveaxis(np.polynomial.polynomial.polyval(u, p), 0, -1) for p in powers]

    def limit(self, kind: str) -> np.ndarray:
        """Return the upper limit of a kind, (n,)."""
        return np.asarray(getattr(self.robot.limits, kind), float)

    def limits(self, kind: str) -> bool:
        """Return whether a kind is limited."""
        return bool(np.isfinite(self.limit(kind)).any())


@dataclass(frozen=True, eq=False)
class Answer:
    """A motion: how long it lasts, s, and its rates.

    `rates` gives q to q3d, (intervals, p, n) each, at fractions (p,) of every interval of its grid, ends from within.
    """

    duration: float
    rates: Callable[[np.ndarray], Rates]


@dataclass(frozen=True)
class Retimer:
    """A library with its settings: the name of its row, and a function that solves a problem."""

    name: str
    solve: Callable[[Problem], Answer]


def jounce(smooth: bool = True) -> Callable[[Problem], Answer]:
    """Return a call of `Robot.retime` without a margin, since the others leave none."""

    def solve(problem: Problem) -> Answer:
        found = problem.robot.retime(problem.motion, 0.0, smooth=smooth)
        per_interval = GRID_POINTS_PER_INTERVAL if smooth else JUMPING_POINTS

        def rates(fractions: np.ndarray) -> Rates:
            # The grid on which retime checks its result: points between the knots of its time law.
            knots = np.unique(found.law.x.t.clip(found.law.first, found.law.last))
            steps = np.arange(per_interval * (len(knots) - 1) + 1) / per_interval
            grid = found.law.times(np.interp(steps, np.arange(len(knots)), knots))
            inner = fractions.clip(INSET, 1 - INSET)
            return found.motion(grid[:-1, None] + np.diff(grid)[:, None] * inner, 3)

        return Answer(found.duration, rates)

    return solve


def toppra(points: int | None = None) -> Callable[[Problem], Answer]:
    """Return a call of toppra on so many points, or on those that it proposes; limits of higher order are left out."""

    def solve(problem: Problem) -> Answer:
        import toppra as peer

        peer.setup_logging("ERROR")
        robot, constraint = problem.robot, peer.constraint
        u = np.linspace(0, 1, problem.path.shape[1] + 1)  # a spline through these is the path
        path = peer.SplineInterpolator(u, problem.derivatives(u, 0)[0])
        between = {"discretization_scheme": constraint.DiscretizationType.Interpolation}
        limits = [constraint.JointVelocityConstraint(_two_sided(problem.limit("velocity")))]
        if problem.limits("acceleration"):
            limits.append(constraint.JointAccelerationConstraint(_two_sided(problem.limit("acceleration")), **between))
        if problem.limits("effort"):
            bounds = _two_sided(problem.limit("effort"))
            limits.append(
                constraint.JointTorqueConstraint(robot.inverse_dynamics, bounds, np.zeros(robot.n), **between)
            )
        grid = None if points is None else np.linspace(0, 1, points)
        solver = peer.algorithm.TOPPRA(
            limits, path, gridpoints=grid, solver_wrapper="seidel", parametrizer="ParametrizeConstAccel"
        )
        motion = solver.compute_trajectory(0, 0)
        if motion is None:
            raise RuntimeError(solver.problem_data.return_code)
        data = solver.problem_data
        return Answer(float(motion.duration), _linear_law(problem, data.gridpoints, data.sd_vec**2))

    return solve


def copp(points: int, rates: bool = True, close: bool = False) -> Callable[[Problem], Answer]:
    """Return a call of copp on so many points, which are closer to each other at the ends where `close`.

    It is of third order where jerk is limited, or torque rates are and `rates` says that they count.
    """

    def solve(problem: Problem) -> Answer:
        import copp_py as peer

        u = np.linspace(0, 1, points)
        if close:
            u = u**3 * (10 - 15 * u + 6 * u**2)
        constraints, third = _copp_rows(peer, problem, u, rates)
        ends = (0, points - 1), (0.0, 0.0)
        x = peer.solver.topp2_ra.solve(peer.solver.topp2_ra.Problem(constraints, *ends))
        if not third:
            return Answer(float(peer.interpolation.s_to_t_topp2(u, x)[0]), _linear_law(problem, u, x))
        # Rows of third order are linearized at the last answer, until another program gains little.
        constraints.amax_substitute(x, 0)
        program = peer.solver.topp3_lp
        profile = program.solve(program.Problem(constraints, x))
        duration = peer.interpolation.s_to_t_topp3(u, profile)[0]
        for _ in range(MAX_PROGRAMS - 1):
            profile = program.solve(program.Problem(constraints, profile.a, b_linearization=profile.b))
            last, duration = duration, peer.interpolation.s_to_t_topp3(u, profile)[0]
            if duration > (1 - MIN_GAIN) * last:
                break
        return Answer(float(duration), _quadratic_law(problem, u, profile))

    return solve


def ruckig(problem: Problem) -> Answer:
    """Solve a straight line with ruckig, in phase, which keeps the line."""
    import ruckig as peer

    n = problem.robot.n
    given = peer.InputParameter(n)
    given.current_position, given.target_position = problem.derivatives(np.array([0.0, 1.0]), 0)[0]
    given.max_velocity, given.max_acceleration = problem.limit("velocity"), problem.limit("acceleration")
    given.max_jerk = problem.limit("jerk")
    given.synchronization = peer.Synchronization.Phase
    trajectory = peer.Trajectory(n)
    result = peer.Ruckig(n).calculate(given, trajectory)
    if result not in (peer.Result.Working, peer.Result.Finished):
        raise RuntimeError(result)

    def rates(fractions: np.ndarray) -> Rates:
        # Each joint has seven pieces of constant jerk from a time t of its own.
        profiles = trajectory.profiles[0]
        starts = [np.concatenate([[0.0], np.cumsum(profile.t)]) for profile in profiles]
        ends = np.unique(np.concatenate([*starts, [trajectory.duration]]).round(15))
        grid = np.interp(np.arange((len(ends) - 1) * RUCKIG_POINTS + 1) / RUCKIG_POINTS, np.arange(len(ends)), ends)
        t = grid[:-1, None] + np.diff(grid)[:, None] * fractions
        return _pieces(profiles, starts, t, (grid[1:] + grid[:-1]) / 2)

    return Answer(trajectory.duration, rates)


def _two_sided(limit: np.ndarray) -> np.ndarray:
    return np.stack([-limit, limit], axis=1)


def _copp_rows(peer: Any, problem: Problem, u: np.ndarray, rates: bool) -> tuple[Any, bool]:
    """Return the constraints of copp on a grid, and whether one is of third order."""
    robot = peer.Robot(problem.robot.n, capacity=len(u))
    q, q1, q2, q3 = (np.ascontiguousarray(d) for d in problem.derivatives(u))
    robot.append_s(u)
    robot.set_q(q, q1, q2, 0, dddq=q3)
    rows = robot.constraints
    everywhere = {"start_idx_s": 0, "length": len(u)}
    add = {
        "velocity": robot.add_velocity_limits,
        "acceleration": robot.add_acceleration_limits,
        "jerk": robot.add_jerk_limits,
    }
    for kind, method in add.items():
        if problem.limits(kind):
            method(problem.limit(kind), -problem.limit(kind), **everywhere)
    if not problem.limits("effort"):
        return rows, problem.limits("jerk")

    # Q = A s'' + B s'^2 + g along the path.
    forces = problem.robot.inverse_dynamics
    zero = np.zeros_like(q)
    g = forces(q, zero, zero)
    A, B = forces(q, zero, q1) - g, forces(q, q1, q2) - g
    for sign in (1, -1):
        rows.add_constraint_2nd(sign * B, sign * A, problem.limit("effort") - sign * g, 0)
    if not (rates and problem.limits("effort_rate")):
        return rows, False

    # Qd = s' (A c + E s'' + D s'^2 + g') with c = s''' / s': from three motions along the path at each point.
    def rate(speed: float, acceleration: float) -> np.ndarray:
        q3d = speed**3 * q3 + 3 * speed * acceleration * q2
        return forces(q, speed * q1, speed**2 * q2 + acceleration * q1, q3d)[1]

    slow, fast, accelerated = rate(1, 0), rate(2, 0), rate(1, 1)
    D = (fast / 2 - slow) / 3
    bound = np.broadcast_to(problem.limit("effort_rate"), q.shape)
    for sign in (1, -1):
        rows.add_constraint_3rd(sign * D, sign * (accelerated - slow), sign * A, sign * (slow - D), bound, 0)
    return rows, True


def _linear_law(problem: Problem, u: np.ndarray, x: np.ndarray) -> Callable[[np.ndarray], Rates]:
    """Return the rates along the path where x is linear between grid points."""

    def rates(fractions: np.ndarray) -> Rates:
        left, slope = x[:-1, None], (np.diff(x) / np.diff(u))[:, None]
        step = np.diff(u)[:, None] * fractions
        speed = np.sqrt(left + slope * step)
        return _along(problem, u[:-1, None] + step, speed, slope / 2 + 0 * speed, 0 * speed)

    return rates


def _quadratic_law(problem: Problem, u: np.ndarray, profile: Any) -> Callable[[np.ndarray], Rates]:
    """Return the rates along the path where s'' is linear in s, and s cubic in time next to the rests."""

    def rates(fractions: np.ndarray) -> Rates:
        a, b = profile.a, profile.b
        bend = (np.diff(b) / np.diff(u))[:, None]
        step = np.diff(u)[:, None] * fractions
        s = u[:-1, None] + step
        law = np.stack(
            [a[:-1, None] + (2 * b[:-1, None] + bend * step) * step, b[:-1, None] + bend * step, bend + 0 * s]
        )
        speed = np.sqrt(law[0])
        law = np.stack([speed, law[1], law[2] * speed])
        head, tail = profile.num_stationary
        if head > 0:
            law[:, :head] = _from_rest(s[:head] - u[0], u[head] - u[0], a[head])
        if tail > 0:
            # The same backwards in time, in which s'' keeps its sign and s' and s''' change theirs twice.
            law[:, -tail:] = _from_rest(u[-1] - s[-tail:], u[-1] - u[-1 - tail], a[-1 - tail])
            law[1, -tail:] *= -1
        return _along(problem, s, *law)

    return rates


def _from_rest(way: np.ndarray, whole: float, x: float) -> np.ndarray:
    """Return s', s'', s''' of s = k t^3 at ways from the rest, where x is that after the whole way."""
    k = x**1.5 / (27 * whole**2)
    t = np.cbrt(way.clip(0) / k)
    return np.stack([3 * k * t**2, 6 * k * t, np.full_like(t, 6 * k)])


def _along(problem: Problem, s: np.ndarray, s1: np.ndarray, s2: np.ndarray, s3: np.ndarray) -> Rates:
    """Return q to q3d from the path and the rates of its parameter, by the chain rule."""
    q, q1, q2, q3 = problem.derivatives(s)
    s1, s2, s3 = s1[..., None], s2[..., None], s3[..., None]
    return q, q1 * s1, q2 * s1**2 + q1 * s2, q3 * s1**3 + 3 * q2 * s1 * s2 + q1 * s3


def _pieces(profiles: Any, starts: list[np.ndarray], t: np.ndarray, middles: np.ndarray) -> Rates:
    """Return the rates of ruckig's profiles at times t, rows of which lie in the piece that a middle is in."""
    columns = []
    for profile, start in zip(profiles, starts, strict=True):
        if profile.brake.duration > 0:
            raise RuntimeError("it brakes before it starts")
        i = (np.searchsorted(start, middles, side="right") - 1).clip(0, len(profile.t) - 1)
        p, v, a, j = (np.array(values)[i][:, None] for values in (profile.p, profile.v, profile.a, profile.j))
        dt = t - start[i][:, None]
        columns.append((p + dt * (v + dt * (a / 2 + dt * j / 6)), v + dt * (a + dt * j / 2), a + dt * j, j + 0 * dt))
    return tuple(np.stack(rates, axis=-1) for rates in zip(*columns, strict=True))
