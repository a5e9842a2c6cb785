"""``python -m benchmarks.calls``: calls with one state, kind by kind, beside Pinocchio and dynibo, as a page.

Each version of jounce runs in a process of its own, all kinds in turn, process after process in each round. Another
checkout to compare with is named by ``--before``; peers that are not installed are left out.
"""

import json
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from importlib import metadata
from pathlib import Path
from statistics import median
from time import perf_counter
from typing import Any

import click
import numpy as np

from benchmarks import machine
from benchmarks.tables import figure, paragraph, table
from jounce import load

ROUNDS, CALLS = 60, 400
FILE, HAND = "xarm7.urdf", "link7"  # of example-robot-data; all libraries read it
NEW, OLD = "now", "before"
HEAD = ("one state, us: least, median", OLD, NEW, "Pinocchio", "dynibo")
TEXT = """The xarm7 of example-robot-data, and where named the bundled solo12 and delta. Microseconds of one call from
Python on contiguous arrays of float64, after some calls of the same kind: the least of {rounds} rounds of {calls},
then their median; lists where a row says so. "before" is {before}. Pinocchio computes forces, M, all joints' Jacobians,
accelerations; dynibo the Jacobian of one link. Neither has rates: beside Q, Qd, Q2d stands Q alone."""


def arm() -> str:
    """The path of the file."""
    files = metadata.files("example-robot-data") or []
    return str(next(file.locate() for file in files if file.name == FILE))


def kinds() -> Iterator[tuple[str, Callable[[], Any]]]:
    """Calls of jounce; each looks its method up, as a user's does."""
    robot, dog, delta = load(arm()), load("solo12", base="floating"), load("delta")
    x, fixed = np.random.default_rng(0).uniform(-1, 1, (5, robot.n)), load("solo12")
    state, lists, out = [y.copy() for y in x], x.tolist(), [np.empty(robot.n) for _ in range(3)]
    W = np.ones((len(robot.body_names), 6))
    yield "Q", lambda: robot.inverse_dynamics(*state[:3])
    yield "Q, Qd, Q2d", lambda: robot.inverse_dynamics(*state)
    yield "M", lambda: robot.mass_matrix(state[0])
    yield "J of all bodies", lambda: robot.jacobian(state[0])
    yield "J of a body", lambda: robot.jacobian(state[0], body=HAND, frame="world")
    yield "forward dynamics", lambda: robot.forward_dynamics(*state[:3])
    yield "Q, lists", lambda: robot.inverse_dynamics(*lists[:3])
    yield "Q, Qd, Q2d, lists", lambda: robot.inverse_dynamics(*lists)
    yield "M, list", lambda: robot.mass_matrix(lists[0])
    yield "Q, out=", lambda: robot.inverse_dynamics(*state[:3], out=out[0])
    yield "Q, Qd, Q2d, out=", lambda: robot.inverse_dynamics(*state, out=out)
    yield "Q, wrench=", lambda: robot.inverse_dynamics(*state[:3], wrench=W)
    held, many = robot.inverse_dynamics, [*np.random.default_rng(1).uniform(-1, 1, (5, 100, robot.n))]
    yield "Q, method held", lambda: held(*state[:3])
    yield "Q, Qd, Q2d of 100 states", lambda: robot.inverse_dynamics(*many)
    kernel, first = robot.compile(order=2), robot.compile(order=0)
    yield "Q, kernel's ufunc", lambda: first.ufunc(*state[:3])
    yield "Q, kernel's ufunc, out=", lambda: first.ufunc(*state[:3], out=out[0])
    yield "Q, Qd, Q2d, kernel's ufunc", lambda: kernel.ufunc(*state)
    yield "Q, Qd, Q2d, kernel's ufunc, out=", lambda: kernel.ufunc(*state, out=tuple(out))
    yield "Q, bound kernel", first.bind(*state[:3], out=out[0])
    yield "Q, Qd, Q2d, kernel(...)", lambda: kernel(*state)
    yield "Q, Qd, Q2d, bound kernel", kernel.bind(*state, out=out)
    legs, base = [*np.zeros((5, dog.n))], (np.eye(4), *np.zeros((4, 6)))
    yield "solo12 fixed, Q", lambda: fixed.inverse_dynamics(*legs[:3])
    moved, posed = base[:3], base[:1]
    yield "solo12 floating, Q", lambda: dog.inverse_dynamics(*legs[:3], base=moved)
    yield "solo12 floating, M", lambda: dog.mass_matrix(legs[0], base=posed)
    stand, still = np.append([0, 0, 0.3, 0, 0, 0, 1], legs[0]), np.zeros(6 + dog.n)
    yield "solo12 floating, base in q, Q", lambda: dog.inverse_dynamics(stand, still, still)
    bound = dog.compile(order=0).bind(*legs[:3], *base[:3], out=np.empty(6 + dog.n))
    yield "solo12 floating, Q, bound kernel", bound
    yield "solo12 fixed, Q, bound kernel", fixed.compile(order=0).bind(*legs[:3], out=np.empty(fixed.n))
    whole, rest = delta.coordinates([0.6, 0.7, 0.8]), [*np.zeros((3, 3))]
    yield "delta, closed, Q", lambda: delta.inverse_dynamics(whole, *rest[:2])
    yield "delta, closed, Q, Qd", lambda: delta.inverse_dynamics(whole, *rest)


def peers() -> Iterator[tuple[str, str, Callable[[], Any]]]:
    """Calls of other libraries, by the kind that they stand beside."""
    with suppress(ImportError):
        import pinocchio as pin

        model = pin.buildModelFromUrdf(arm())
        data, (a, b, c) = model.createData(), np.random.default_rng(0).uniform(-1, 1, (3, model.nv))
        yield "Q", "Pinocchio", lambda: pin.rnea(model, data, a, b, c)
        yield "Q, Qd, Q2d", "Pinocchio", lambda: pin.rnea(model, data, a, b, c)
        yield "M", "Pinocchio", lambda: pin.crba(model, data, a)
        yield "J of all bodies", "Pinocchio", lambda: pin.computeJointJacobians(model, data, a)
        frame = model.getFrameId(HAND)
        yield "J of a body", "Pinocchio", lambda: pin.computeFrameJacobian(model, data, a, frame, pin.WORLD)
        yield "forward dynamics", "Pinocchio", lambda: pin.aba(model, data, a, b, c)
    with suppress(ImportError):
        import dynibo

        other = dynibo.Robot.from_urdf(arm())
        n = other.joint_count
        a, b, c = np.random.default_rng(0).uniform(-1, 1, (3, n() if callable(n) else n))
        hand = other.link_id(HAND)
        yield "Q", "dynibo", lambda: other.inverse_dynamics(a, b, c)
        yield "M", "dynibo", lambda: other.mass_matrix(a)
        yield "J of a body", "dynibo", lambda: other.jacobian(a, hand)
        yield "forward dynamics", "dynibo", lambda: other.forward_dynamics(a, b, c)


def measure(call: Callable[[], Any]) -> float:
    """Seconds of one call, the mean over some."""
    start = perf_counter()
    for _ in range(CALLS):
        call()
    return (perf_counter() - start) / CALLS


def serve(with_peers: bool) -> None:
    """A round for each line of standard input: a line of seconds by kind and library."""
    calls = [(kind, NEW, call) for kind, call in kinds()] + (list(peers()) if with_peers else [])
    for _, _, call in calls:
        for _ in range(3):
            call()
    for _ in sys.stdin:
        print(json.dumps([(kind, library, measure(call)) for kind, library, call in calls]), flush=True)


class Worker:
    """A process that measures one checkout."""

    def __init__(self, root: Path | None) -> None:
        own = Path(__file__).parents[1]
        setup = f"import sys; sys.path[:0] = [{str((root or own) / 'src')!r}, {str(own)!r}]"
        text = f"{setup}; from benchmarks.calls import serve; serve({root is None})"
        self._process = subprocess.Popen(
            [sys.executable, "-c", text], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )

    def round(self) -> list[tuple[str, str, float]]:
        """Seconds by kind and library."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write("\n")
        self._process.stdin.flush()
        return [tuple(row) for row in json.loads(self._process.stdout.readline())]


@click.command()
@click.option("--before", type=click.Path(exists=True, path_type=Path), help="Another checkout to compare with.")
@click.option("--name", default="another version", show_default=True, help="What the page calls it.")
@click.option("-o", "--output", default=Path(__file__).parent / "CALLS.md", type=click.Path(path_type=Path))
def main(before: Path | None, name: str, output: Path) -> None:
    """Write the page."""
    workers = {NEW: Worker(None)} | ({OLD: Worker(before)} if before else {})
    found: dict[tuple[str, str], list[float]] = {}
    for _ in range(ROUNDS):
        for label, worker in workers.items():
            for kind, library, seconds in worker.round():
                found.setdefault((kind, label if library == NEW else library), []).append(1e6 * seconds)

    def cell(kind: str, library: str) -> str:
        samples = found.get((kind, library))
        return f"{figure(min(samples))}, {figure(median(samples))}" if samples else "-"

    names = list(dict.fromkeys(kind for kind, _ in found))
    rows = [(kind, *(cell(kind, library) for library in HEAD[1:])) for kind in names]
    text = TEXT.format(rounds=ROUNDS, calls=CALLS, before=name)
    lines = ["# Calls with one state", "", *paragraph(text), *table(HEAD, rows)]
    lines += [f"* {what}: {value}" for what, value in machine.described()]
    output.write_text("\n".join([*lines, ""]), encoding="utf-8")


if __name__ == "__main__":
    main()
