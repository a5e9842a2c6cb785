"""``python -m benchmarks.second``: second derivatives in native code, Pinocchio's tensors, and Hessians under JAX."""

import ctypes
import os
from collections.abc import Callable, Iterator
from functools import cached_property, partial
from math import ceil
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter, process_time
from unittest.mock import patch

import click
import numpy as np
from scipy.spatial.transform import Rotation

import jounce
from benchmarks import c, machine
from benchmarks.measure import SAMPLE, Case, seconds
from benchmarks.peers import MissingError
from benchmarks.tables import figure, paragraph, table
from jounce.dynamics.computation import Computation
from jounce.io import files
from jounce.native import code_forms
from jounce.spatial.lie import Ad, hat

STATES = 16  # of a batch: of more, the tensors of g1 leave the cache
TEXT = """Microseconds of the processor for a state, on one thread, the fastest of {rounds} rounds taken in turn, each
of a batch of {states} into arrays that are there; operations are those of the programs, of which a product and a sum in
one are one. The tensors of g1 are 780 kB for a state: in batches of 64 they leave the cache, and take half as long
again. Errors are those of the tensors against Pinocchio's, relative to the largest entry. The panda is without its
fingers."""
JAX_TEXT = """`jax.jit(jax.hessian(cost))` of the sum of the squares of Qd, of the panda, by all of q, qd, q2d and q3d:
28 x 28. The first call compiles everything; then microseconds for a call, and for each of 1,000 states by
`jax.vmap`."""
FLAGS = (
    "-std=c++17", "-DNDEBUG", "-DBOOST_MPL_LIMIT_LIST_SIZE=30", "-DBOOST_MPL_CFG_NO_PREPROCESSED_HEADERS",
    "-DBOOST_FUSION_INVOKE_MAX_ARITY=10", "-DFUSION_MAX_VECTOR_SIZE=10",
)  # fmt: skip


def robots() -> Iterator[tuple[str, jounce.Robot]]:
    """The panda without its fingers, and the g1 fixed at its pelvis."""
    fingers = jounce.load("panda").joint_names[7:]
    yield "panda", jounce.load("panda", lock=dict.fromkeys(fingers, 0.0))
    yield "g1", jounce.load("g1")


def compiled() -> ctypes.CDLL:
    """Pinocchio's algorithm, compiled from its headers: minutes."""
    import pinocchio

    import casadi

    places = (Path(pinocchio.__file__).parents[4] / "include", Path(casadi.__file__).parent / "include/eigen3")
    if not all(place.is_dir() for place in places):
        raise MissingError("there are no headers of Pinocchio and Eigen")
    source = Path(__file__).parent / "peers/second_derivatives.cpp"
    return c.library([source], *FLAGS, *(f"-I{place}" for place in places), "-lstdc++")


class Pinocchio:
    """A robot there, and its tensors."""

    def __init__(self, library: ctypes.CDLL, robot: jounce.Robot) -> None:
        m = robot.mechanism
        B, M = _about_z(m)
        masses = M[:, 3, 3]
        centers = np.stack([M[:, 2, 4], M[:, 0, 5], M[:, 1, 3]], axis=-1) / masses[:, None]
        inertias = M[:, :3, :3] + masses[:, None, None] * hat(centers) @ hat(centers)
        data = [masses, centers, inertias, np.array(robot.gravity, float)]
        self.library, self.n = library, robot.n
        library.make.restype = ctypes.c_void_p
        arrays = [np.ascontiguousarray(x) for x in (np.array(m.parent, np.int32), B, *data)]
        self.robot = ctypes.c_void_p(library.make(m.nb, *(_address(x) for x in arrays)))

    def call(self, x: list[np.ndarray]) -> Callable[[], None]:
        """The tensors of one state after the other."""
        return partial(self.library.second_derivatives, self.robot, len(x[0]), *map(_address, x))

    def tensors(self) -> list[np.ndarray]:
        """Those of the last state, in our order of the indices."""
        out = np.empty((4, self.n, self.n, self.n))
        self.library.last(self.robot, _address(out))
        qq, vv, qv, aq = (x.T for x in out)  # column-major
        return [qq, qv, vv, aq.swapaxes(1, 2)]


def _about_z(m: jounce.Mechanism) -> tuple[np.ndarray, np.ndarray]:
    """Poses and inertias of bodies whose frames are turned until their joints are about z."""
    axes, E = m.X.astype(float), np.tile(np.eye(4), (m.nb, 1, 1))
    assert not axes[:, 3:].any()
    for turned, axis in zip(E, axes[:, :3], strict=True):
        turned[:3, :3] = Rotation.align_vectors(axis[None], [[0, 0, 1]])[0].as_matrix()
    on = [np.eye(4) if p < 0 else E[p] for p in m.parent]
    return np.linalg.inv(on) @ m.B.astype(float) @ E, Ad(E).mT @ m.M.astype(float) @ Ad(E)


def _address(x: np.ndarray) -> ctypes.c_void_p:
    return x.ctypes.data_as(ctypes.c_void_p)


class Measured:
    """One robot: its kernels, and their calls."""

    ASKED = (
        ("hvp, order 0", "inverse_dynamics", 0, "hvp"), ("hvp, order 1", "inverse_dynamics", 1, "hvp"),
        ("hvp, order 2", "inverse_dynamics", 2, "hvp"), ("Hessian of w . Q, order 0", "inverse_dynamics", 0, "hessian"),
        ("four tensors of Q", "inverse_dynamics_second_partials", 0, None),
    )  # fmt: skip

    def __init__(self, name: str, robot: jounce.Robot, library: ctypes.CDLL | None) -> None:
        self.name, self.robot = name, robot
        self.state = list(np.random.default_rng(0).uniform(-1, 1, (3, STATES, robot.n)))
        self.peer = Pinocchio(library, robot) if library else None

    @cached_property
    def rows(self) -> list[tuple[str, Computation]]:
        """The labels of the rows, and what is computed."""
        return [(label, Computation(name, order, product=product)) for label, name, order, product in self.ASKED]

    def cases(self) -> Iterator[Case]:
        """Keyed (robot, row), and (robot, "") of Pinocchio."""
        rng = np.random.default_rng(1)
        for label, asked in self.rows:
            kernel = self.robot.compile(asked.name, asked.order, product=asked.product)
            given, out = ([rng.uniform(-1, 1, (STATES, *shape)) for shape in shapes] for shapes in kernel.shapes)
            given[:3] = self.state
            yield Case((self.name, label), partial(kernel, *given, out=tuple(out)), STATES)
        if self.peer:
            yield Case((self.name, ""), self.peer.call(self.state), STATES)

    def error(self) -> float | None:
        """The largest difference from Pinocchio's tensors of the last state."""
        if self.peer is None:
            return None
        self.peer.call(self.state)()
        ours = self.robot.inverse_dynamics_second_partials(*(x[-1] for x in self.state), method="kernel")
        both = zip(ours, self.peer.tensors(), strict=True)
        return max(float(np.abs(a - b).max() / np.abs(b).max()) for a, b in both)

    def operations(self, asked: Computation) -> int:
        """The operations, fused."""
        return code_forms.fuse(code_forms.trace_program(self.robot.mechanism, asked)).operations


def fastest(cases: list[Case], rounds: int) -> dict[tuple[object, ...], float]:
    """Seconds of the processor for a state, the fastest of the rounds: other programs share the machine."""
    found = dict.fromkeys((case.key for case in cases), np.inf)
    for _ in range(rounds):
        for case in cases:
            count = ceil(SAMPLE / seconds(case.call))  # in turn, but with warm caches
            start = process_time()
            for _ in range(count):
                case.call()
            found[case.key] = min(found[case.key], (process_time() - start) / count / case.states)
    return found


def under_jax(robot: jounce.Robot, rounds: int) -> list[float]:
    """Seconds: of the first call, of the fastest call, and for each state of a batch."""
    import jax

    with jax.enable_x64(True):
        hessian = jax.jit(jax.hessian(lambda x: (robot.inverse_dynamics(*x)[1] ** 2).sum()))
        batch = jax.jit(jax.vmap(hessian))
        x = jax.numpy.asarray(np.random.default_rng(2).uniform(-1, 1, (1_000, 4, robot.n)))
        start = perf_counter()
        hessian(x[0]).block_until_ready()
        first, one = perf_counter() - start, x[0]
        batch(x).block_until_ready()
        cases = [
            Case(("one",), lambda: [hessian(one).block_until_ready() for _ in range(20)], 20),
            Case(("batch",), lambda: batch(x).block_until_ready(), 1_000),
        ]
        return [first, *fastest(cases, rounds).values()]


def page(found: list[Measured], times: dict[tuple[object, ...], float], jax_times: list[float], rounds: int) -> str:
    """The page of results."""
    about = [f"* {name}: {value}" for name, value in machine.described()]
    lines = ["# Second derivatives", "", *about, f"* load average: {machine.load()}", ""]
    lines += paragraph(TEXT.format(rounds=rounds, states=STATES))
    rows = []
    for x in found:
        peer = times.get((x.name, ""))
        for label, asked in x.rows:
            took = times[x.name, label]
            compared = peer if "order 0" in label or "tensors" in label else None
            ratio = f"{compared / took:.1f}" if compared else "-"
            own = f"{x.operations(asked):,}"
            rows.append([f"{x.name}, {label}", own, figure(took * 1e6), figure(peer and peer * 1e6), ratio])
    lines += table(("", "operations", "us", "Pinocchio's tensors, us", "times as fast"), rows)
    lines += [f"* {x.name}: the tensors differ by {error:.1e}" for x in found if (error := x.error()) is not None]
    lines += ["", "## Under JAX", "", *paragraph(JAX_TEXT)]
    lines += table(
        ("first call, s", "a call, us", "in a batch, us"),
        [[figure(jax_times[0]), *(figure(t * 1e6) for t in jax_times[1:])]],
    )
    return "\n".join(lines).rstrip() + "\n"


@click.command()
@click.option("--rounds", default=100, show_default=True, type=click.IntRange(1), help="Repetitions of every figure.")
@click.option(
    "--library", type=click.Path(exists=True), help="The C++ of peers/second_derivatives.cpp, compiled before."
)
@click.option("-o", "--output", default=Path(__file__).parent / "SECOND.md", type=click.Path(path_type=Path))
def main(rounds: int, library: str | None, output: Path) -> None:
    """Measure second derivatives, and write SECOND.md."""
    try:
        peer: ctypes.CDLL | None = ctypes.CDLL(library) if library else compiled()
    except (MissingError, ImportError) as error:
        click.echo(f"without Pinocchio: {error}")
        peer = None
    found = [Measured(name, robot, peer) for name, robot in robots()]
    with TemporaryDirectory() as folder, patch.dict(os.environ, JOUNCE_CACHE_DIR=folder):  # nothing is on the disk
        jax_times = under_jax(found[0].robot, rounds)
    times = fastest([case for x in found for case in x.cases()], rounds)
    with files.write_whole(output) as part:
        part.write_text(page(found, times, jax_times, rounds), encoding="utf-8")


if __name__ == "__main__":
    main()
