"""The figures of a run as a page: the machine, tables, and how the figures were formed."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from benchmarks import bound, chains, forces, machine, making, matrices, measure, quantities, start, threads
from benchmarks.forces import Gathered
from benchmarks.robots import ARMS, load
from benchmarks.tables import batch, figure, paragraph, share, table
from jounce.native.jit import host

BEST = "jounce: kernel bound to its arrays"  # the row that is held against the bound: no Python, no new arrays
FORMED = """Figures are medians of {rounds} measurements. They are taken in turn: each round measures every case once,
as the mean over calls in a row that last {sample:g} ms or more, after one that is not counted where calls are short.
Times are nanoseconds per state unless a table says otherwise; "-" is what a path does not serve, or takes more than
{longest:g} s a call for. States are uniform in -1 .. 1. Every path's results were compared with those of the closed
form before it was measured. One thread, except where a row names more."""
BOUND = """A vector holds {lanes} states. Instructions are those of the program and, behind the plus, of its sines and
cosines. The bound is the largest of: products over {fma}, sums over {add}, all of them over {both} (10^9 a second, from
the loops above); divided by {lanes}. It leaves out integer instructions, loads, stores, and the check for what is not
finite. Kernel: bound to its arrays, 1,000 states. Memory: the bytes of a state's arrays over the bandwidth of a copy,
which batches beyond the caches need at least."""
BOUND_HEAD = (
    "operations traced", "factored", "products, fused or not", "lone sums", "bound ns", "kernel ns", "bound / kernel",
    "memory ns",
)  # fmt: skip
QUANTITIES = """Through the methods of Robot, batches into `out=`; in Pinocchio, called from Python, one state of the
same quantity, or of the one that takes the same: its Coriolis matrix stands beside both of ours, the rate of its
centroidal momentum beside the base wrench. Kernels are compiled once into an empty cache, and once read from it."""
DERIVATIVES = """As above: forward dynamics next to Pinocchio's articulated bodies, partial derivatives next to those of
its recursions. It computes no rates of them: rows with rates stand next to its call without rates."""
PRODUCTS = """Products of the derivatives of Q, Qd, Q2d by all inputs, of a batch of 1,000 states, next to the values of
Q, Qd, Q2d themselves."""
THREADS = """Q, Qd, Q2d into `out=`, the batch split among threads of one process that are kept between calls; cores:
{cores}. The share is of the time of one thread: 1 over the number of threads would be perfect scaling. The first rows
are what the cores can do: where multiply-adds in registers do not scale, cores are threads of one. Small batches are
bound by the time in which a thread wakes up."""
MADE = """Seconds from the robot's numbers to the equations, once, each in a process that is stopped after {limit:g} s,
and the operations on scalars that they take, shared subexpressions found by SymPy's cse, or by jounce's own trace."""


@dataclass(frozen=True)
class Run:
    """All that a run found."""

    times: Mapping[tuple[object, ...], float]  # s per state
    gathered: Gathered
    machine: Sequence[tuple[str, str]]
    load: tuple[str, str]
    rounds: int
    made: Sequence[tuple[str, ...]] = ()  # rows of `making`
    compiled: Mapping[tuple[str, str], quantities.Compiled] = field(default_factory=dict)
    products: Mapping[tuple[str, str], int] = field(default_factory=dict)  # operations, by robot and product

    @property
    def peaks(self) -> dict[str, float]:
        """Seconds per vector instruction, and per byte copied."""
        return {str(key[1]): seconds for key, seconds in self.times.items() if key[0] == "peak"}

    def paths(self, arm: str) -> list[str]:
        """The peers that were measured on an arm."""
        return list(dict.fromkeys(str(key[1]) for key in self.times if key[0] == arm))

    def ns(self, *key: object) -> float | None:
        """Nanoseconds per state of a case, where it was measured."""
        return 1e9 * self.times[key] if key in self.times else None


def page(run: Run) -> str:
    """RESULTS.md."""
    return "\n".join([
        "# Results",
        "",
        "Written by `make bench`, the [benchmarks](__init__.py) beside this page.",
        "",
        *paragraph(FORMED.format(rounds=run.rounds, sample=1e3 * measure.SAMPLE, longest=measure.LONGEST)),
        *table(("machine", ""), [*run.machine, ("load average before, after", ", ".join(run.load))], side="---"),
        *_peaks(run),
        *_forces(run),
        *_bound(run),
        *_chains(run),
        *_matrices(run),
        *_quantities(run),
        *_derivatives(run),
        *_threads(run),
        *_start(run),
        *_small(run),
        *_made(run),
        "## Left out",
        "",
        *(f"- {line}" for line in dict.fromkeys(run.gathered.left_out) or ["nothing"]),
        "",
    ])  # fmt: skip


def _peaks(run: Run) -> Iterator[str]:
    lanes, rate = host().lanes, {name: 1e-9 / seconds for name, seconds in run.peaks.items()}
    yield from ["## What one core can do", ""]
    loops = [("fused multiply-adds", "fma", 2), ("additions", "add", 1), ("both by turns", "both", 1.5)]
    rows = [(name, figure(rate[kind]), figure(flops * lanes * rate[kind])) for name, kind, flops in loops]
    yield from table(("loop", "10^9 vector instructions/s", "GFLOP/s"), rows)
    apart = "have pipes of their own" if rate["both"] > 1.3 * rate["fma"] else "share the pipes of products"
    faster = rate["both"] / rate["fma"]
    yield from paragraph(
        f"Additions {apart}: by turns both go {faster:.2f} times as fast as fused multiply-adds alone."
        f" Copying: {figure(rate['copy'])} GB/s, read and written."
    )


def _forces(run: Run) -> Iterator[str]:
    for count in forces.BATCHES:
        yield from [f"## The iiwa, {batch(count)}{' from Python' if count == 1 else ''}", ""]
        found = _by_path(run, lambda *key, count=count: run.ns(*key, count))
        rows = [(label, *map(figure, row)) for label, row in found if any(x is not None for x in row)]
        yield from table(("ns per state, order", *map(str, forces.ORDERS)), rows)
    yield from paragraph("Largest difference of the highest rate to the closed form, over the largest value:")
    errors = _by_path(run, lambda *key: run.gathered.errors.get(key))
    yield from table(("order", *map(str, forces.ORDERS)), [(label, *map(share, row)) for label, row in errors])
    yield from ["![Time of Q, Qd, Q2d by path](paths.svg)", ""]


def _by_path(run: Run, cell: Callable[[str, str, int], float | None]) -> Iterator[tuple[str, list[float | None]]]:
    """Of each path on the iiwa, then of each on a general arm, what it is called and a cell for each order."""
    for arm in ARMS:
        for name in run.paths(arm):
            yield name if arm == "iiwa14" else f"{name}, {arm}", [cell(arm, name, k) for k in forces.ORDERS]


def _bound(run: Run) -> Iterator[str]:
    yield from ["## Operations of the iiwa and of a general arm, and the bound", ""]
    for arm in ARMS:
        yield from table((f"{arm}, order", *BOUND_HEAD), list(_bounds(run, arm)))
    rates = {name: figure(1e-9 / run.peaks[name]) for name in ("fma", "add", "both")}
    yield from paragraph(BOUND.format(lanes=host().lanes, **rates))
    yield from ["![Time over the order, and the bound](orders.svg)", ""]


def _bounds(run: Run, arm: str) -> Iterator[tuple[str, ...]]:
    for order in forces.ORDERS:
        traced, program = bound.programs(load(arm), order)
        own, circles = bound.of_program(program), bound.of_circles(program)
        least, found = 1e9 * bound.floor(program, run.peaks), run.ns(arm, BEST, order, 1_000)
        moved = 8 * (program.inputs + len(program.outputs))
        yield (
            str(order), f"{traced.operations:,}", f"{program.operations:,}",
            f"{own.products:,} + {circles.products}", f"{own.sums:,} + {circles.sums}", figure(least), figure(found),
            "-" if found is None else f"{100 * least / found:.0f} %", figure(1e9 * moved * run.peaks["copy"]),
        )  # fmt: skip


def _chains(run: Run) -> Iterator[str]:
    yield from ["## Chains of n joints at no special angles", ""]
    yield from paragraph("In batches of 1,000 states; the closed form from n = 7 on of 100, from n = 20 on of 10.")
    for order in chains.ORDERS:
        rows = [(str(n), *(figure(run.ns("chain", name, order, n)) for name in chains.METHODS)) for n in chains.SIZES]
        yield from table((f"ns per state, order {order}, n", *chains.METHODS), rows)
    yield from ["![Time over the number of joints](chains.svg)", ""]


def _matrices(run: Run) -> Iterator[str]:
    yield from ["## Matrices of the iiwa and of a general arm, default methods", ""]
    names = [*(name for names in matrices.NAMES.values() for name in names), matrices.ALL]
    columns = [(arm, count) for arm in ARMS for count in matrices.BATCHES]
    rows = [(name, *(figure(run.ns("matrix", arm, name, count)) for arm, count in columns)) for name in names]
    yield from table(("ns per state", *(f"{arm}, {batch(count)}" for arm, count in columns)), rows)


def _quantities(run: Run) -> Iterator[str]:
    yield from ["## Every quantity of an arm and two humanoids", ""]
    yield from paragraph(QUANTITIES)
    for robot in quantities.FILES:
        yield from _beside_pinocchio(run, robot, quantities.ROWS)


def _derivatives(run: Run) -> Iterator[str]:
    yield from ["## Forward dynamics and derivatives", ""]
    yield from paragraph(DERIVATIVES)
    for robot in quantities.DERIVED:
        yield from _beside_pinocchio(run, robot, quantities.DERIVATIVES)
    yield from paragraph(PRODUCTS)
    rows = []
    for (robot, product), operations in run.products.items():
        values = run.products[robot, ""]
        each, of_values = run.ns("product", robot, product), run.ns("product", robot, "")
        if product and each is not None and of_values is not None:
            rows.append((
                f"{robot}, {product}", f"{values:,}", f"{operations:,}", f"{operations / values:.2f}",
                figure(of_values), figure(each), f"{each / of_values:.2f}",
            ))  # fmt: skip
    head = ("", "operations of the values", "of the product", "share", "values, ns each", "product, ns each", "share")
    yield from table(head, rows)


def _beside_pinocchio(run: Run, robot: str, rows: Sequence[quantities.Row]) -> Iterator[str]:
    head = ("", "operations", "1,000 states, ns each", "Pinocchio's call, ns", "share", "one call, ns", "compiled, s",
            "from the cache, s")  # fmt: skip
    cells = []
    for row in rows:
        each, call, peer = (run.ns("quantity", robot, row.label, kind) for kind in ("batch", "call", "peer"))
        if each is None or peer is None:
            continue
        made = run.compiled[robot, row.label]
        cells.append((
            row.label, f"{made.operations:,}", figure(each), figure(peer), f"{each / peer:.3f}", figure(call),
            figure(made.cold), figure(made.from_cache),
        ))  # fmt: skip
    yield from table((robot, *head[1:]), cells)


def _threads(run: Run) -> Iterator[str]:
    yield from ["## Threads", ""]
    yield from paragraph(THREADS.format(cores=machine.cores()))
    keys = {name: (name,) for name in (threads.REGISTERS, threads.MEMORY)} | {
        f"{name}, {batch(count)}": (name, count) for name, batches in threads.ROBOTS.items() for count in batches
    }
    rows = []
    for label, key in keys.items():
        found = [run.ns("threads", *key, each) for each in threads.counts()]
        shares = [None if x is None or found[0] is None else x / found[0] for x in found]
        rows.append((label, *map(figure, found), *map(figure, shares[1:])))
    several = threads.counts()[1:]
    head = ("ns per state, threads", *map(str, threads.counts()), *(f"share, {each}" for each in several))
    yield from table(head, rows)


def _start(run: Run) -> Iterator[str]:
    yield from ["## From the start of the interpreter", ""]
    yield from table(("", "ms"), [(name, figure(1e3 * run.times["start", name])) for name in start.RUNS])


def _small(run: Run) -> Iterator[str]:
    yield from ["## The first joints of the iiwa, order 2, 1,000 states", ""]
    found = {
        peer.name: [run.ns(f"first {n}", peer.name, 2, 1_000) for n in forces.SMALL] for peer in forces.SMALL_PEERS
    }
    rows = [(name, *map(figure, row)) for name, row in found.items() if any(x is not None for x in row)]
    yield from table(("ns per state", *(f"{n} joints" for n in forces.SMALL)), rows)


def _made(run: Run) -> Iterator[str]:
    yield from ["## From the first joints of the iiwa to equations of order 2", ""]
    yield from paragraph(MADE.format(limit=making.LIMIT))
    head = ("", *(cell for n in making.SIZES for cell in (f"{n} joints", "operations")))
    yield from table(head, run.made)
