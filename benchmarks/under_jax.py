"""``python -m benchmarks.under_jax``: quantities on arrays of JAX, on the CPU, against NumPy, the traced law and frax.

frax, which recommends jax 0.4.30, runs in an environment of its own: ``--frax PYTHON`` is the interpreter there.
"""

import json
import os
import subprocess
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from importlib import metadata
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter, process_time
from typing import Any

import click
import numpy as np

from benchmarks import machine
from benchmarks.measure import Case, seconds
from benchmarks.robots import states
from benchmarks.tables import batch, figure, paragraph, share, table
from jounce import Robot, load
from jounce.io import files

COUNT = 1_000
ORDERS = 0, 2
URDF = "import frax, pathlib; print(pathlib.Path(frax.__file__).parent / 'assets/franka_panda/panda.urdf')"
VERSIONS = "from importlib.metadata import version; print(*(f'{x} {version(x)}' for x in ('frax', 'jax')), sep=', ')"
PEER = """
import json, sys, time
import frax, jax, numpy as np
robot = frax.Robot(sys.argv[1])
q, qd = np.random.default_rng(0).uniform(-1, 1, (2, 1000, robot.nv))
laws = {"mass_matrix": robot.mass_matrix, "coriolis_and_gravity": robot.nonlinear_bias}
found = {}
for name, law in laws.items():
    given = [q] if name == "mass_matrix" else [q, qd]
    for count, arrays, law in ((1, [x[0] for x in given], law), (1000, given, jax.vmap(law))):
        arrays, compiled, start = [jax.numpy.asarray(x) for x in arrays], jax.jit(law), time.perf_counter()
        jax.block_until_ready(compiled(*arrays))
        first, times = time.perf_counter() - start, []
        for _ in range(300 if count == 1000 else 3000):
            start = time.perf_counter()
            jax.block_until_ready(compiled(*arrays))
            times.append(time.perf_counter() - start)
        found[f"{name} {count}"] = first, min(times) / count
print(json.dumps(found))
"""
QUIET = {"XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false", "OPENBLAS_NUM_THREADS": "1", "JAX_ENABLE_X64": "1"}
TEXT = """Forces on arrays of JAX with 64 bits under `jax.jit`, against the kernel on arrays of NumPy; both return new
arrays. Eager: the method of the robot, without `jax.jit`. Traced: `method="recursion"`, which XLA compiles. Gradient:
of the sum of squares of the highest rate, by all inputs. Each figure is the fastest of {rounds} calls, taken in turn,
since other programs share the machine."""
COMPILING = """Seconds of the clock, and in parentheses of the processor, until the first result, with an empty cache.
The gradient finds the code of the forces there."""
FRAX = """The Panda, from the URDF that frax brings, in the same run: its mass matrix and its bias forces (ours:
`inverse_dynamics` with zero accelerations), with jit and vmap, and the settings that the README of frax recommends.
{versions}."""


def ready(function: Callable[..., Any], *arrays: Any) -> Any:
    """Call a function of JAX, and wait for what it returns."""
    import jax

    return jax.block_until_ready(function(*arrays))


def fastest(cases: Sequence[Case], rounds: int) -> dict[tuple[object, ...], float]:
    """Seconds per state of every case, of its fastest call; a round calls each case twice, and counts the second."""
    times = dict.fromkeys((case.key for case in cases), float("inf"))
    for _ in range(rounds):
        for case in cases:
            case.call()
            times[case.key] = min(times[case.key], seconds(case.call) / case.states)
    return times


def laws(robot: Robot, order: int) -> dict[str, Callable[..., Any]]:
    """Forces by native code and by the traced law, and the gradient of a cost of the highest rate."""
    import jax

    def cost(*q: Any) -> Any:
        return jax.numpy.sum(jax.tree.leaves(robot.inverse_dynamics(*q))[-1] ** 2)

    traced = jax.jit(partial(robot.inverse_dynamics, method="recursion"))
    gradient = jax.jit(jax.grad(cost, argnums=tuple(range(3 + order))))
    compiled = jax.jit(lambda *q: robot.inverse_dynamics(*q))
    return {"jit": compiled, "eager": robot.inverse_dynamics, "traced": traced, "gradient": gradient}


def robots() -> dict[str, Robot]:
    """An arm and two humanoids."""
    paths = {Path(file).name: file.locate() for file in metadata.files("example-robot-data") or []}
    return {"iiwa14": load("iiwa14"), "g1": load("g1"), "talos": load(str(paths["talos_reduced.urdf"]))}


def compile_times(names: dict[str, Robot]) -> Iterator[tuple[str, ...]]:
    """Rows of a table: each compiled into an empty cache."""
    for name, robot in names.items():
        for order in ORDERS:
            row = [f"{name}, order {order}"]
            for kind, law in laws(robot, order).items():
                if kind == "eager":
                    continue
                if kind == "traced" and robot.n > 10:  # minutes
                    row.append("-")
                    continue
                wall, own = perf_counter(), process_time()
                ready(law, *map(np.array, states(robot.n, COUNT, order)))
                row.append(f"{perf_counter() - wall:.2f} ({process_time() - own:.2f})")
            yield tuple(row)


def cases(names: dict[str, Robot]) -> Iterator[Case]:
    """Keyed (robot, order, way, count)."""
    import jax

    for name, robot in names.items():
        for order in ORDERS:
            for count in (1, COUNT):
                q = [x[0] if count == 1 else x for x in states(robot.n, count, order)]
                arrays, kernel = [jax.numpy.asarray(x) for x in q], robot.compile(order=order)
                yield Case((name, order, "numpy", count), partial(kernel, *q), count)
                ways = {kind: (law, arrays) for kind, law in laws(robot, order).items()}
                ways["float32"] = ways["jit"][0], [x.astype("float32") for x in arrays]
                for kind, (law, given) in ways.items():
                    if kind != "traced" or robot.n < 10:
                        ready(law, *given)
                        yield Case((name, order, kind, count), partial(ready, law, *given), count)


def beside_frax(python: str, rounds: int) -> Iterator[tuple[str, ...]]:
    """Rows of a table: the quantities of frax and ours of the same robot."""
    import jax

    run = partial(subprocess.run, capture_output=True, text=True, check=True, env=os.environ | QUIET)
    path = run([python, "-W", "ignore", "-c", URDF]).stdout.strip()
    theirs = json.loads(run([python, "-W", "ignore", "-c", PEER, path]).stdout)
    robot = load(path)
    given = np.random.default_rng(0).uniform(-1, 1, (2, COUNT, robot.n))
    zero = np.zeros(robot.n)
    of_name = {
        "mass_matrix": (given[:1], lambda q: robot.mass_matrix(q)),
        "coriolis_and_gravity": (given, lambda q, qd: robot.inverse_dynamics(q, qd, zero)),
    }
    for name, (q, law) in of_name.items():
        for count in (1, COUNT):
            arrays, compiled = [jax.numpy.asarray(x[0] if count == 1 else x) for x in q], jax.jit(law)
            start = perf_counter()
            ready(compiled, *arrays)
            first = perf_counter() - start
            own = fastest([Case((), partial(ready, compiled, *arrays), count)], rounds)[()]
            compiling, time = theirs[f"{name} {count}"]
            yield (
                f"{name.replace('_', ' ')}, {count:,}", figure(1e9 * own), figure(1e9 * time), f"{time / own:.1f}",
                f"{first:.2f}", f"{compiling:.2f}",
            )  # fmt: skip


def gradient_error(robot: Robot) -> float:
    """The difference of the gradient of |Q2d|^2 to that of CasADi, over the largest value."""
    import casadi

    q = [x[0] for x in states(robot.n, 1, 2)]
    symbols = [casadi.SX.sym("q", robot.n) for _ in q]
    Q2d = robot.casadi_function(order=2)(*symbols)[2]
    gradient = casadi.gradient(casadi.dot(Q2d, Q2d), casadi.vertcat(*symbols))
    expected = casadi.Function("gradient", symbols, [gradient])(*q).full().ravel()
    found = np.concatenate(ready(laws(robot, 2)["gradient"], *q))
    return float(np.max(np.abs(found - expected)) / np.max(np.abs(expected)))


@click.command()
@click.option("--frax", help="The Python of an environment with frax and jax 0.4.30.")
@click.option("--rounds", default=200, show_default=True, type=click.IntRange(1), help="Repetitions of every figure.")
def main(frax: str | None, rounds: int) -> None:
    """Measure, and write JAX.md."""
    import jax

    jax.config.update("jax_enable_x64", True)
    before, names = machine.load(), robots()
    with TemporaryDirectory() as folder:
        os.environ["JOUNCE_CACHE_DIR"] = folder
        compiled = list(compile_times(names))
        click.echo("\n".join(map(str, compiled)), err=True)
        times = fastest(list(cases(names)), rounds)
        peers = list(beside_frax(frax, rounds)) if frax else []
    kinds = ("numpy", "jit", "float32", "eager", "traced", "gradient")
    rows = []
    for name, order, count in product(names, ORDERS, (COUNT, 1)):
        ns = [times.get((name, order, kind, count)) for kind in kinds]
        share_of = f"{times[name, order, 'jit', count] / times[name, order, 'numpy', count]:.2f}"
        rows.append((f"{name}, order {order}, {batch(count)}", *(figure(t and 1e9 * t) for t in ns), share_of))
    error = share(gradient_error(names["iiwa14"]))
    text = [
        "# JAX", "", *paragraph(TEXT.format(rounds=rounds)),
        *table(("ns per state", "NumPy", "JAX", "float32", "eager", "traced", "gradient", "JAX / NumPy"), rows),
        *paragraph(f"The gradient of the sum of squares of Q2d of the iiwa differs from CasADi's by {error}."),
        *paragraph(COMPILING),
        *table(("s", "JAX", "traced", "gradient"), compiled),
    ]  # fmt: skip
    if peers:
        head = ("ns per state", "jounce", "frax", "frax / jounce", "compiling jounce, s", "frax, s")
        versions = subprocess.run([str(frax), "-c", VERSIONS], capture_output=True, text=True, check=True).stdout
        text += [*paragraph(FRAX.format(versions=versions.strip())), *table(head, peers)]
    text += [f"* {name}: {value}" for name, value in machine.described()]
    text.append(f"* load average before, after: {before}, {machine.load()}")
    with files.write_whole(Path(__file__).parent / "JAX.md") as part:
        part.write_text("\n".join(text).rstrip() + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
