"""``python -m benchmarks.trajectory``: minimum torque change by IPOPT, with derivatives by CasADi, native code and C.

The problem is that of examples/14_minimum_torque_change.py: a Panda from rest to rest under limits of velocity, torque
and torque rate, with obstacles as half-spaces. All three have the same exact Hessians. Functions on SX, which CasADi
differentiates itself, are what `Robot.casadi_function` makes by default.
"""

import resource
import subprocess
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from time import process_time
from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import BSpline

import casadi
from benchmarks import machine
from benchmarks.tables import paragraph, table
from jounce import Robot, load
from jounce.io import files

BEGIN = np.array([0.0, -0.8, 0.0, -2.4, 0.0, 1.6, 0.8])
END = np.array([1.6, 0.4, 0.0, -1.2, 0.0, 1.8, 0.8])
SECONDS, MARGIN, ROUNDS = 1.0, 0.98, 3
OBSTACLES = [  # half-spaces normal . x <= distance, for points of the arm
    ("panda_hand_tcp", (0.6, 0.8, 0.0), 0.56),
    ("panda_hand_tcp", (0.0, 0.0, -1.0), -0.45),
    ("panda_link6", (0.0, 0.0, 1.0), 0.7),
]


class Solved(NamedTuple):
    """What IPOPT found, and the processor time of building the problem and solving it."""

    seconds: float
    iterations: int
    cost: float
    status: str


def solve(forces: Any, places: dict[str, Any], robot: Robot, pieces: int, points: int) -> Solved:
    """Minimum torque change by functions of all points: Q and Qd of the rates, poses of q."""
    start = process_time()
    spline = BSpline(np.r_[[0.0] * 5, np.linspace(0, SECONDS, pieces + 1), [SECONDS] * 5], np.eye(pieces + 5), 5)
    t = np.linspace(0, SECONDS, points)
    opti = casadi.Opti()
    c = opti.variable(robot.n, pieces - 1)
    coefficients = casadi.horzcat(np.outer(BEGIN, np.ones(3)), c, np.outer(END, np.ones(3)))
    rates = [coefficients @ casadi.sparsify(casadi.DM(spline(t, k).T)) for k in range(4)]
    Q, Qd = forces(*rates)
    opti.minimize(casadi.sumsqr(Qd) * t[1] / 2e3)
    limits = robot.limits
    for x, most in ((rates[1], limits.velocity), (Q, limits.effort), (Qd, limits.effort_rate)):
        bound = MARGIN * np.tile(most, points)
        opti.subject_to(opti.bounded(-bound, casadi.vec(x), bound))
    for body, normal, distance in OBSTACLES:
        pose = places[body](rates[0])
        opti.subject_to(sum(n * pose[i, 3::4] for i, n in enumerate(normal)) <= distance)
    opti.set_initial(c, BEGIN[:, None] + np.outer(END - BEGIN, np.linspace(0, 1, pieces - 1)))
    opti.solver("ipopt", {"print_time": False}, {"print_level": 0, "sb": "yes"})
    found = opti.solve()
    return Solved(process_time() - start, opti.stats()["iter_count"], found.value(opti.f), opti.return_status())


def by_robot(robot: Robot, native: bool, pieces: int, points: int) -> Solved:
    """With functions on SX, or by native code."""
    start = process_time()
    make = partial(robot.casadi_function, native=native, points=points)
    places = {body: make("poses", 0, body=body) for body, *_ in OBSTACLES}
    found = solve(make(order=1), places, robot, pieces, points)
    return found._replace(seconds=process_time() - start)


def by_external(robot: Robot, folder: Path, pieces: int, points: int) -> Solved:
    """With generated C."""

    def loaded(order: int, name: str) -> Any:
        return casadi.external(f"panda_{name}", str(folder / str(order) / "panda.so")).map(points)

    places = {body: loaded(0, f"poses_{body}") for body, *_ in OBSTACLES}
    return solve(loaded(1, "inverse_dynamics"), places, robot, pieces, points)


def compile_external(robot: Robot, folder: Path) -> float:
    """Generate and compile C for CasADi; the processor time of the compiler."""
    bodies = sorted({body for body, *_ in OBSTACLES})
    for order, outputs in ((1, ["inverse_dynamics"]), (0, [f"poses:{body}" for body in bodies])):
        robot.codegen("casadi", order, folder / str(order), outputs=outputs, prefix="panda")
        subprocess.run(["make", "-C", folder / str(order)], check=True, capture_output=True)
    return resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime


def main() -> None:
    """Compare, and write TRAJECTORY.md."""
    robot, rows = load("panda", lock={"panda_finger_joint1": 0.02}).with_limits(effort_rate=100), []
    with TemporaryDirectory() as name:
        compiling = compile_external(robot, Path(name))
        for pieces, points in ((9, 37), (20, 81)):
            ways = {
                "functions on SX": partial(by_robot, robot, False),
                "native code": partial(by_robot, robot, True),
                "generated C": partial(by_external, robot, Path(name)),
            }
            by_robot(robot, True, pieces, points)  # kernels are compiled, or read from the disk
            best: dict[str, Solved] = {}
            for _ in range(ROUNDS):  # in turns
                for way, solved in ways.items():
                    found = solved(pieces, points)
                    best[way] = min(best.get(way, found), found)
            for way, found in best.items():
                ratio = best["functions on SX"].seconds / found.seconds
                rows.append((
                    f"{points} points, {7 * (pieces - 1)} variables, {way}", found.status, str(found.iterations),
                    f"{1e3 * found.cost:.3f}", f"{found.seconds:.2f}", f"{ratio:.1f}",
                ))  # fmt: skip
                print(*rows[-1], sep="  ", flush=True)
    text = [
        "# Trajectory optimization", "",
        *paragraph(
            f"""Minimum torque change of a Panda with limits of velocity, torque and torque rate and three obstacles,
            examples/14_minimum_torque_change.py, by IPOPT with exact Hessians: processor time to build and solve the
            problem, the least of {ROUNDS} rounds in turns, kernels warm. The compiler of the generated C takes
            {compiling:.0f} s more, once."""
        ),
        *table(("problem, derivatives", "status", "iterations", "cost, N^2 m^2/s", "CPU, s", "times as fast"), rows),
        *[f"* {name}: {value}" for name, value in [*machine.described(), ("load", machine.load())]],
    ]  # fmt: skip
    with files.write_whole(Path(__file__).parent / "TRAJECTORY.md") as part:
        part.write_text("\n".join(text).rstrip() + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
