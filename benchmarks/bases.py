"""``python -m benchmarks.bases``: forces of robots that float, and of ones on moving ground, against the fixed base."""

from collections.abc import Iterator
from pathlib import Path
from time import process_time

import click
import numpy as np
from scipy.spatial.transform import Rotation

import jounce
from benchmarks import machine
from benchmarks.measure import Case
from benchmarks.robots import states
from benchmarks.tables import batch, figure, paragraph, table
from jounce.io import files

ORDERS, COUNTS = (0, 2), (1, 1_000)
ROBOTS = ("iiwa14", "solo12", "anymal", "g1")
BASES = ("fixed", "moving ground", "floating")
TEXT = """Bound calls of forces and their rates, in microseconds of the processor for one state, the fastest of {rounds}
rounds taken in turn, and in parentheses how many times as long they take as with a fixed base. A floating robot has six
forces more. The base of the iiwa is a body of 3 kg in the place of the ground."""
CHECKED = """The method `inverse_dynamics(..., base=...)` on such robots, which checks the pose, in microseconds for a
call, beside its kernel, which does not."""


def robots() -> Iterator[tuple[str, str, jounce.Robot]]:
    """Each robot on each of the bases."""
    for name in ROBOTS:
        fixed = jounce.load(name)
        if name == "iiwa14":
            floating = _on(fixed.mechanism)
        else:
            fixed, floating = (jounce.load(name, base=base) for base in ("fixed", "floating"))
        yield from zip([name] * 3, BASES, (fixed, fixed, floating), strict=True)


def _on(m: jounce.Mechanism) -> jounce.Robot:
    """A robot on a floating body of 3 kg."""
    M = jounce.inertia_matrix(3.0, [0.1, 0.0, -0.2], np.diag([0.2, 0.3, 0.4]))
    return jounce.Robot.from_screws(m.B, m.X, m.M, m.parent, gravity=m.gravity, base=M)


def moving(count: int, order: int) -> tuple[np.ndarray, ...]:
    """C, V, Vd, ... of as many states."""
    rng = np.random.default_rng(count)
    C = np.tile(np.eye(4), (count, 1, 1))
    C[:, :3, :3] = Rotation.from_rotvec(rng.uniform(-2, 2, (count, 3))).as_matrix()
    return (C, *rng.uniform(-1, 1, (order + 2, count, 6)))


def cases() -> Iterator[Case]:
    """Keyed (robot, base, order, states, way): bound calls, kernels, and methods, which check poses."""
    for name, base, robot in robots():
        for order in ORDERS:
            kernel = robot.compile(order=order, base=base != "fixed")
            for count in COUNTS:
                q = states(robot.n, count, order)
                given = (q, moving(count, order) if base != "fixed" else ())
                rates, motion = (tuple(x[0] if count == 1 else x for x in arrays) for arrays in given)
                out = [np.empty((*rates[0].shape[:-1], port.size)) for port in kernel.signature.outputs]
                key = (name, base, order, count)
                yield Case((*key, "bound"), kernel.bind(*rates, *motion, out=out), count)
                yield Case((*key, "kernel"), lambda k=kernel, x=(*rates, *motion): k(*x), count)
                yield Case((*key, "method"), lambda r=robot, x=rates, b=motion: r.inverse_dynamics(*x, base=b or None))


def seconds(found: list[Case], rounds: int) -> dict[tuple[object, ...], float]:
    """Seconds of the processor for a call, the fastest of the rounds: other programs share the machine."""
    fastest = dict.fromkeys((case.key for case in found), np.inf)
    for _ in range(rounds):
        for case in found:
            repeats = 20 if case.key[3] == COUNTS[1] else 1_000
            start = process_time()
            for _ in range(repeats):
                case.call()
            fastest[case.key] = min(fastest[case.key], (process_time() - start) / repeats)
    return fastest


def page(times: dict[tuple[object, ...], float], rounds: int) -> str:
    """The page of results."""
    about = [f"* {name}: {value}" for name, value in machine.described()]
    lines = ["# Bases that move", "", *about, f"* load average: {machine.load()}", ""]
    lines += paragraph(TEXT.format(rounds=rounds))
    for order in ORDERS:
        for count in COUNTS:
            lines += [f"## Order {order}, {batch(count)}", ""]
            rows = []
            for name in ROBOTS:
                took = [times[name, base, order, count, "bound"] for base in BASES]
                others = [f"{figure(x * 1e6 / count)} ({x / took[0]:.2f})" for x in took[1:]]
                rows.append([name, figure(took[0] * 1e6 / count), *others])
            lines += table(("robot", *BASES), rows)
    lines += ["## The check of the pose", "", *paragraph(CHECKED)]
    rows = []
    for name in ROBOTS:
        for order in ORDERS:
            ways = [times[name, "floating", order, count, way] for count in COUNTS for way in ("kernel", "method")]
            rows.append([f"{name}, order {order}", *(figure(x * 1e6) for x in ways)])
    lines += table(("robot", *(f"{way}, {batch(count)}" for count in COUNTS for way in ("kernel", "method"))), rows)
    return "\n".join(lines).rstrip() + "\n"


@click.command()
@click.option("--rounds", default=30, show_default=True, type=click.IntRange(1), help="Repetitions of every figure.")
@click.option("-o", "--output", default=Path(__file__).parent / "BASES.md", type=click.Path(path_type=Path))
def main(rounds: int, output: Path) -> None:
    """Measure forces of robots whose base moves, and write BASES.md."""
    with files.write_whole(output) as part:
        part.write_text(page(seconds(list(cases()), rounds), rounds), encoding="utf-8")


if __name__ == "__main__":
    main()
