"""``python -m benchmarks.loops``: closed robots against their trees, and Newton's method for their positions."""

from collections.abc import Callable, Iterator
from pathlib import Path
from time import perf_counter

import click
import numpy as np

import jounce
from benchmarks import machine
from benchmarks.measure import Case, medians
from benchmarks.tables import figure, paragraph, table
from jounce.dynamics.computation import Computation
from jounce.io import files
from jounce.native.code_forms import trace_program

ROBOTS = ("fivebar", "fourbar_leg", "delta", "gough_stewart")
ASKED = (
    ("inverse_dynamics", 0),
    ("inverse_dynamics", 1),
    ("inverse_dynamics", 2),
    ("mass_matrix", 0),
    ("forward_dynamics", 0),
)
COUNT, POSITIONS = 1_000, 100_000
AWAY, SLIDE = 0.3, 0.02  # rad and m, from the start
TEXT = """Kernels of the closed robot and of its tree, in nanoseconds for a state of batches of {count} on one thread,
the median of {rounds} rounds taken in turn, with the dependent coordinates given. Operations are those of the program,
in which a sine counts as one. The tree returns forces of all its joints, the closed robot those of its coordinates."""
CLOSING = """Newton's method by `robot.coordinates`: from the independent coordinates, within {away} rad of the start
(slides within {slide} m), continued from there; from all coordinates with dependent ones off by 0.001; from closed
coordinates, which are only checked. In microseconds for one state, and in milliseconds for {positions}, the fastest of
{rounds} rounds."""


def positions(robot: jounce.Robot, count: int) -> np.ndarray:
    """Independent coordinates about the start, (count, n)."""
    closure = robot.mechanism.closure
    assert closure is not None, robot
    own = list(closure.independent)
    size = np.where(robot.mechanism.tree.X[own, :3].any(axis=1), AWAY, SLIDE)
    return closure.start[own] + size * np.random.default_rng(0).uniform(-1, 1, (count, robot.n))


def operations(robot: jounce.Robot, quantity: str, order: int) -> int:
    """The operations of a program."""
    return trace_program(robot.mechanism, Computation(quantity, order)).operations


def cases() -> Iterator[Case]:
    """Keyed (robot, quantity, order, "closed" or "tree")."""
    for name in ROBOTS:
        closed = jounce.load(name)
        q = closed.coordinates(positions(closed, COUNT))
        closure = closed.mechanism.closure
        assert closure is not None, closed
        places = [list(x) for x in (closure.independent, closure.dependent)]
        own, others = (np.ascontiguousarray(q[:, x]) for x in places)
        ways = ("closed", closed, own, [others]), ("tree", jounce.Robot(closed.mechanism.tree), q, [])
        for quantity, order in ASKED:
            for way, robot, first, last in ways:
                kernel = robot.compile(quantity, order)  # type: ignore[call-overload]
                rng = np.random.default_rng(1)
                rates = [rng.uniform(-1, 1, first.shape) for _ in range(len(kernel.signature.inputs) - 1 - len(last))]
                out = [np.empty((COUNT, *port.shape)) for port in kernel.signature.outputs]
                yield Case((name, quantity, order, way), kernel.bind(first, *rates, *last, out=out), COUNT)


def fastest(call: Callable[[], object], rounds: int) -> float:
    """Seconds of the fastest of some calls."""
    taken = []
    for _ in range(rounds):
        start = perf_counter()
        call()
        taken.append(perf_counter() - start)
    return min(taken)


def closing(name: str, rounds: int) -> list[str]:
    """The times of Newton's method, from three kinds of positions, for one and for many."""
    robot = jounce.load(name)
    u = positions(robot, POSITIONS)
    q = robot.coordinates(u)
    near = q.copy()
    dependent = [j for j, joint in enumerate(robot.mechanism.tree.coordinates) if joint not in robot.joint_names]
    near[:, dependent] += 1e-3 * np.random.default_rng(2).uniform(-1, 1, (POSITIONS, len(dependent)))
    row = []
    for given in (u, near, q):
        one = fastest(lambda x=given[0]: robot.coordinates(x), 30 * rounds)  # type: ignore[misc]
        many = fastest(lambda x=given: robot.coordinates(x), rounds)  # type: ignore[misc]
        row += [figure(one * 1e6), figure(many * 1e3)]
    return row


def page(rounds: int) -> str:
    """The page of results."""
    about = [f"* {name}: {value}" for name, value in machine.described()]
    lines = ["# Closed loops", "", *about, f"* load average: {machine.load()}", ""]
    lines += paragraph(TEXT.format(count=COUNT, rounds=rounds))
    times = medians(list(cases()), rounds, lambda: None)
    rows = []
    for name in ROBOTS:
        closed = jounce.load(name)
        tree = jounce.Robot(closed.mechanism.tree)
        for quantity, order in ASKED:
            counts = [operations(robot, quantity, order) for robot in (closed, tree)]
            took = [times[name, quantity, order, way] * 1e9 for way in ("closed", "tree")]
            compared = [text for x, y in (counts, took) for text in (figure(x), figure(y), f"{x / y:.2f}")]
            rows.append([f"{name}, {quantity}, order {order}", *compared])
    head = ("operations", "of the tree", "ratio", "ns", "of the tree", "ratio")
    lines += table(("", *head), rows)
    lines += ["## Positions", ""]
    lines += paragraph(CLOSING.format(away=AWAY, slide=SLIDE, positions=f"{POSITIONS:,}", rounds=rounds))
    ways = (f"{way}, {count}" for way in ("from q", "nearly closed", "closed") for count in ("us", "ms"))
    lines += table(("robot", *ways), [[name, *closing(name, rounds)] for name in ROBOTS])
    return "\n".join(lines).rstrip() + "\n"


@click.command()
@click.option("--rounds", default=10, show_default=True, type=click.IntRange(1), help="Repetitions of every figure.")
@click.option("-o", "--output", default=Path(__file__).parent / "LOOPS.md", type=click.Path(path_type=Path))
def main(rounds: int, output: Path) -> None:
    """Measure robots with closed loops, and write LOOPS.md."""
    with files.write_whole(output) as part:
        part.write_text(page(rounds), encoding="utf-8")


if __name__ == "__main__":
    main()
