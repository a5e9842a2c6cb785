"""``python -m benchmarks.retime``: `Robot.retime` on ten motions of three arms, against IPOPT, toppra and copp.

IPOPT, through CasADi, gets the same splines, limits and margin, with rows at twice as many points as the programs of
`Robot.retime` begin with. toppra and copp (``pip install copp-py``, where it is there) are compared under limits of
velocity and torque alone, with accelerations that jump and without.
"""

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from statistics import median
from time import perf_counter, process_time
from typing import Any

import numpy as np

from benchmarks import machine
from benchmarks.tables import paragraph, table
from jounce import Motion, Robot, load
from jounce.io import files
from jounce.limits.drive_terms import FrictionAlong
from jounce.limits.retime import FIRST_INTERVALS, SPEED_CAPS, START_SPEED_SHARE, Grid, Retiming, retime
from jounce.limits.retime_problem import build_problem

MARGIN = 0.01
EVERY = 4  # IPOPT gets the rows of every fourth point at which retime checks its result
DENSER = 50  # times as many points as those of the program check the result
PANDA_JERK = np.array([7500, 3750, 5000, 6250, 7500, 10000, 10000])
IIWA = {  # KUKA LBR iiwa 14 R820, of its data sheet: rad/s and N m
    "velocity": np.deg2rad([85, 85, 100, 75, 130, 135, 135]),
    "effort": [320, 320, 176, 176, 110, 40, 40],
}
Cases = Mapping[str, tuple[Robot, Motion]]


def arms() -> dict[str, Robot]:
    """The arms with limits of velocity, torque and torque rate."""
    panda = load("panda", lock={"panda_finger_joint1": 0.0})
    ur5, iiwa = load("ur5"), load("iiwa14").with_limits(**IIWA)
    return {
        "Panda": panda.with_limits(effort_rate=1000.0),
        "UR5": ur5.with_limits(effort_rate=10 * ur5.limits.effort),
        "iiwa": iiwa.with_limits(effort_rate=10 * iiwa.limits.effort),
    }


def path(robot: Robot, seed: int) -> np.ndarray:
    """A cubic path (n, 4) over u from 0 to 1, the lowest power first, about the middle of the joints' ranges."""
    middle = np.nan_to_num(robot.limits.bounds("position"), posinf=0, neginf=0).mean(axis=0)
    start, way, bend = np.random.default_rng(seed).uniform(-0.8, 0.8, (3, robot.n))
    start += middle
    return np.stack([start, way + bend, -2.5 * bend, 1.5 * bend], axis=1)


def on_path(c: np.ndarray, duration: float = 2.0) -> Motion:
    """The path from rest to rest, u a polynomial of degree 7 in time."""
    t = np.linspace(0, duration, 121)
    s = t / duration
    u = s**4 * (35 - 84 * s + 70 * s**2 - 20 * s**3)
    return Motion.through(t, np.polynomial.polynomial.polyval(u, c.T).T)


def cases() -> dict[str, tuple[Robot, np.ndarray]]:
    """Ten paths: four of the Panda, three of each other arm."""
    robots, counts = arms(), {"Panda": 4, "UR5": 3, "iiwa": 3}
    return {
        f"{name} {i + 1}": (robots[name], path(robots[name], i)) for name, count in counts.items() for i in range(count)
    }


def densest(robot: Robot, found: Retiming) -> float:
    """The largest share of a limit of velocity, torque or torque rate, on a grid DENSER than that of the program."""
    t = np.linspace(found.motion.start, found.motion.stop, 300 * DENSER + 1)
    along = robot.forces_along(found.motion, t, 1)
    limits = robot.limits
    shares = [along.rates[1] / limits.velocity, along.forces[0] / limits.effort, along.forces[1] / limits.effort_rate]
    return float(np.max(np.abs(shares)))


def last_grid(robot: Robot, motion: Motion, found: Retiming) -> Grid:
    """The grid of the spline of a result."""
    problem = build_problem(robot, motion, 1 - MARGIN)
    return Grid.build(problem, len(np.unique(found.law.x.t)) - 1, SPEED_CAPS[0])


def ipopt(grid: Grid, points: slice | np.ndarray | None = None) -> float:
    """The duration that IPOPT finds with the rows of a grid, at some of its points."""
    import casadi as ca

    basis, some = grid.basis, slice(None, grid.count, EVERY) if points is None else points
    at, rows = grid.at.select(some), grid.rows.select(some)
    scale = (START_SPEED_SHARE * grid.uniform) ** 2
    c = ca.MX.sym("c", basis.count)

    def values(local: Any, k: int) -> Any:
        matrix = np.zeros((len(local.index), basis.count))
        np.put_along_axis(matrix, local.index, local.values[:, k], axis=1)
        return ca.mtimes(ca.sparsify(ca.DM(matrix)), c * scale)

    x, x1, x2, x3 = (values(at, k) for k in range(4))
    s = ca.sqrt(x)
    products = (
        1, s, x, x1 / 2, x * s, s * x1 / 2, s * x2 / 2, x * x, x * x1 / 2, x1 * x1 / 4, x * x2 / 2,
        x1 * x2 / 4 + x * x3 / 2,
    )  # fmt: skip
    if rows.friction:
        products += rubbing(rows.friction, products)
    g = [
        sum(ca.DM(rows.factors[:, r, i]) * products[k] for i, k in enumerate(rows.used)) for r in range(len(rows.kinds))
    ]
    quadrature, weights = basis._quadrature
    duration = ca.dot(ca.DM(weights), values(quadrature, 0) ** -0.5)
    problem = {"x": c, "f": duration, "g": ca.vertcat(*g)}
    options = {"print_time": False, "ipopt.print_level": 0, "ipopt.sb": "yes", "ipopt.max_iter": 500}
    solver = ca.nlpsol("retime", "ipopt", problem, options)
    lower, upper = (np.repeat(bound, len(at.index)) for bound in (rows.lower, rows.upper))
    found = solver(x0=np.ones(basis.count), lbg=lower, ubg=upper, lbx=1e-6 / scale)
    if not solver.stats()["success"]:
        raise RuntimeError(solver.stats()["return_status"])
    return float(found["f"])


def rubbing(along: FrictionAlong, products: tuple[Any, ...]) -> tuple[Any, ...]:
    """Coulomb friction and its rates in the order of its products, which CasADi differentiates by time."""
    import casadi as ca

    v, v1, v2 = ca.SX.sym("v"), ca.SX.sym("v1"), ca.SX.sym("v2")
    w = ca.SX.sym("w")
    F = ca.tanh(w * v)
    Fd = ca.jacobian(F, v) * v1
    F2d = ca.jacobian(Fd, v) * v1 + ca.jacobian(Fd, v1) * v2
    rates = {"effort_rate": Fd, "second_effort_rate": F2d}
    found = []
    for kind in along.kinds:
        rate = ca.Function(kind, [w, v, v1, v2], [rates.get(kind, F)])
        for i, slope in enumerate(along.friction.slope[:, 0]):
            states = [sum(ca.DM(term[i]) * products[k] for k, term in terms.items()) for terms in along.rates]
            states += [0 * states[0]] * (3 - len(states))
            value = rate.map(states[0].shape[0])(slope, *(state.T for state in states)).T
            found.append(value * products[1] if kind == "power" else value)
    return tuple(found)


def toppra(robot: Robot, c: np.ndarray, points: int = 601) -> tuple[float, float]:
    """The duration under limits of velocity and torque that toppra finds, and the seconds that it takes."""
    import toppra as ta
    from toppra import algorithm, constraint

    ta.setup_logging("ERROR")
    u = np.linspace(0, 1, 101)
    geometry = ta.SplineInterpolator(u, np.polynomial.polynomial.polyval(u, c.T).T)
    velocity, effort = ((1 - MARGIN) * x for x in (robot.limits.velocity, robot.limits.effort))
    torque = constraint.JointTorqueConstraint(
        robot.inverse_dynamics, np.stack([-effort, effort], axis=1), np.zeros(robot.n),
        discretization_scheme=constraint.DiscretizationType.Interpolation,
    )  # fmt: skip
    limits = [constraint.JointVelocityConstraint(np.stack([-velocity, velocity], axis=1)), torque]
    start = perf_counter()
    solver = algorithm.TOPPRA(limits, geometry, gridpoints=np.linspace(0, 1, points), solver_wrapper="seidel")
    return float(solver.compute_trajectory(0, 0).duration), perf_counter() - start


def copp(robot: Robot, c: np.ndarray, points: int = 1001) -> tuple[float, float] | None:
    """The same of copp, whose seconds include one call of the inverse dynamics per point; None where it is missing."""
    try:
        import copp_py as peer
    except ImportError:
        return None
    u = np.linspace(0, 1, points)
    derivatives = [np.polynomial.polynomial.polyder(c, k, axis=1) for k in range(3)]
    q, q1, q2 = (np.polynomial.polynomial.polyval(u, d.T).T for d in derivatives)
    velocity, effort = ((1 - MARGIN) * x for x in (robot.limits.velocity, robot.limits.effort))
    start = process_time()
    theirs = peer.robot.Robot(robot.n, capacity=points, inverse_dynamics=robot.inverse_dynamics)
    theirs.append_s(u)
    theirs.set_q(q, q1, q2, 0)
    theirs.add_velocity_limits(velocity, -velocity, start_idx_s=0, length=points)
    theirs.add_torque_limits(effort, -effort, start_idx_s=0, length=points)
    problem = peer.solver.topp2_ra.Problem(theirs.constraints, (0, points - 1), (0.0, 0.0))
    speed = np.sqrt(peer.solver.topp2_ra.solve(problem))
    return float((2 * np.diff(u) / (speed[1:] + speed[:-1])).sum()), process_time() - start


def seconds(call: Callable[[], object], rounds: int = 9) -> float:
    """The median time of a call on its processor, which other programs may share."""
    found = []
    for _ in range(rounds):
        start = process_time()
        call()
        found.append(process_time() - start)
    return median(found)


def compare_jumps(name: str, robot: Robot, c: np.ndarray) -> tuple[str, ...]:
    """Durations and milliseconds under limits of velocity and torque alone."""
    motion = on_path(c)
    shortest, smooth = (robot.retime(motion, MARGIN, smooth=kind) for kind in (False, True))
    peers = [toppra(robot, c, 1001), copp(robot, c)]
    best = min(peer[0] for peer in peers if peer)
    took = [seconds(lambda kind=kind: robot.retime(motion, MARGIN, smooth=kind)) for kind in (False, True)]
    took += [seconds(lambda: toppra(robot, c, 1001)), *([seconds(lambda: copp(robot, c))] if peers[1] else [np.nan])]
    return (
        name,
        f"{shortest.duration:.4f}",
        *(f"{peer[0]:.4f}" if peer else "-" for peer in peers),
        f"{100 * (shortest.duration / best - 1):+.3f} %",
        f"{robot.check(shortest.motion).worst.ratio:.4f}",
        f"{smooth.duration:.4f}",
        f"{100 * (smooth.duration / shortest.duration - 1):+.2f} %",
        *(f"{1e3 * x:.0f}" if x == x else "-" for x in took),
    )


def main() -> None:
    """Compare, and write RETIMING.md."""
    rows, jumping = [], []
    for name, (robot, c) in cases().items():
        motion = on_path(c)
        found = retime(robot, motion, MARGIN)
        grid = last_grid(robot, motion, found)
        best = ipopt(grid)
        jumping.append(compare_jumps(name, robot.with_limits(effort_rate=np.inf), c))
        rows.append((
            name,
            f"{motion.duration / grid.uniform:.4f}",
            f"{found.duration:.4f}",
            f"{best:.4f}",
            f"{100 * (found.duration / best - 1):+.2f} %",
            f"{densest(robot, found):.4f}",
            f"{1e3 * seconds(partial(retime, robot, motion, MARGIN)):.0f}",
        ))  # fmt: skip
        print(*rows[-1], "|", *jumping[-1][1:], sep="  ", flush=True)
    head = ("motion", "uniform, s", "retime, s", "IPOPT, s", "", "largest share", "CPU, ms")
    of_jumps = (
        "motion", "smooth=False, s", "toppra, s", "copp, s", "to the shorter", "largest share", "smooth, s",
        "to the first", "smooth=False, ms", "smooth, ms", "toppra, ms", "copp, ms",
    )  # fmt: skip
    text = [
        "# Retiming", "",
        *paragraph(
            f"""`Robot.retime` with limits of velocity, torque, torque rate and a margin of {MARGIN:.0%}: durations of
            the fastest uniform time law, of the fastest, and of what IPOPT finds from the same start for the same
            spline and limits. The largest share of a limit
            is that on a grid {DENSER} times as dense as the program's; the last column is the processor time that
            `retime` takes, kernels warm. Splines begin with {FIRST_INTERVALS} intervals, refined where that pays."""
        ),
        *table(head, rows), "",
        *paragraph(
            """Under limits of velocity and torque alone, with the same margin: `smooth=False`, whose accelerations
            jump, toppra and copp with 1,001 points each, and the smooth answer against the first. Times are medians on
            one processor, kernels warm; those of copp include a call of the inverse dynamics for each point."""
        ),
        *table(of_jumps, jumping),
        *[f"* {name}: {value}" for name, value in machine.described()],
    ]  # fmt: skip
    with files.write_whole(Path(__file__).parent / "RETIMING.md") as part:
        part.write_text("\n".join(text).rstrip() + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
