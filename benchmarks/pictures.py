"""The figures of a run as pictures."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from benchmarks import chains, forces
from benchmarks.bound import floor, programs
from benchmarks.peers.ours import DEFAULT
from benchmarks.results import BEST, Run
from benchmarks.robots import GENERAL, load
from jounce.figures import canvas

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# What is jounce's own and what is not, told apart in colour and without: by hatches, dashes and hollow marks.
BARS: Mapping[bool, Any] = {
    True: {"facecolor": canvas.COLOURS[0], "edgecolor": canvas.COLOURS[0], "label": "jounce"},
    False: {"facecolor": "#fbe3d2", "edgecolor": canvas.COLOURS[1], "hatch": "////", "label": "others"},
}
LINES: Mapping[bool, Any] = {
    True: {"linestyle": "solid"},
    False: {"linestyle": (0, (4, 2)), "markerfacecolor": "white"},
}
MARKS = "osD^vP*X"


def pictures(run: Run) -> dict[str, "Figure"]:
    """All of them by the names of their files."""
    return {"paths": _paths(run), "orders": _orders(run), "chains": _chains(run)}


def is_ours(name: object) -> bool:
    """Whether a path is jounce's own, generated code included."""
    return str(name).startswith("jounce")


def _paths(run: Run) -> "Figure":
    """Bars: Q, Qd, Q2d of the iiwa, and of a general arm, in a batch of 1,000, by path, the fastest on top."""
    found = {key[1]: 1e9 * s for key, s in run.times.items() if key[0] == "iiwa14" and key[2:] == (2, 1_000)}
    if general := run.ns(GENERAL, DEFAULT.name, 2, 1_000):
        found[f"{DEFAULT.name}, {GENERAL}"] = general
    least = 1e9 * floor(programs(load("iiwa14"), 2)[1], run.peaks)
    rows = sorted(found.items(), key=lambda row: -row[1])

    def paint(figure: "Figure") -> None:
        axes = figure.subplots()
        for ours, style in BARS.items():
            times = [time if is_ours(name) == ours else 0 for name, time in rows]
            axes.barh(range(len(rows)), times, height=0.65, linewidth=0.8, **style)
        axes.set_yticks(range(len(rows)), [str(name) for name, _ in rows])
        for i, (_, time) in enumerate(rows):
            axes.annotate(f"{time:,.0f}", (time, i), xytext=(3, 0), textcoords="offset points", va="center")
        axes.axvline(least, color=canvas.INK, linestyle=(0, (3, 1.2)))
        axes.annotate(
            "bound", (least, 1), xycoords=("data", "axes fraction"), xytext=(3, 2), textcoords="offset points"
        )
        axes.set_xscale("log")
        axes.set_xlim(min(least, *found.values()) / 2, 3 * max(found.values()))
        axes.grid(visible=False, axis="y")
        axes.set_xlabel("Q, Qd, Q2d of the iiwa, ns per state in batches of 1,000, one thread")
        axes.legend(loc="upper right")

    return canvas.painted(paint, 9, 0.9 + 0.28 * len(rows))


def _orders(run: Run) -> "Figure":
    """Lines: time over the order, in batches of 1,000, and the bound."""
    curves = {name: [(k, run.ns("iiwa14", name, k, 1_000)) for k in forces.ORDERS] for name in run.paths("iiwa14")}
    curves[f"{BEST}, {GENERAL}"] = [(k, run.ns(GENERAL, BEST, k, 1_000)) for k in forces.ORDERS]
    kept = {name: found for name, found in curves.items() if sum(t is not None for _, t in found) > 2}
    kept = {
        name: found for name, found in kept.items() if name.startswith(BEST) or not name.startswith("jounce: kernel")
    }
    least = [1e9 * floor(programs(load("iiwa14"), k)[1], run.peaks) for k in forces.ORDERS]
    entries = {
        name: {
            "marker": MARKS[i % len(MARKS)],
            "ms": 4.5,
            "color": canvas.COLOURS[i % len(canvas.COLOURS)],
            **LINES[is_ours(name)],
        }
        for i, name in enumerate(kept)
    }
    below = {"color": canvas.INK, "linewidth": 2}

    def paint(figure: "Figure") -> None:
        axes = figure.subplots()
        for name, found in kept.items():
            axes.semilogy(*zip(*[(k, t) for k, t in found if t is not None], strict=True), **entries[name])
        axes.semilogy(forces.ORDERS, least, **below)
        axes.set_xticks(forces.ORDERS)
        axes.set_xlabel("order: the highest rate of Q")
        axes.set_ylabel("ns per state")
        canvas.legend_above(
            figure, entries | {"bound": below}, columns=2, title="solid: jounce; dashed, hollow: others"
        )

    return canvas.painted(paint, 9, 4.2)


def _chains(run: Run) -> "Figure":
    """A panel an order: time over the number of joints."""
    entries = {name: {"marker": "osD"[i], "ms": 3.5, **canvas.line_style(i)} for i, name in enumerate(chains.METHODS)}

    def paint(figure: "Figure") -> None:
        for axes, order in zip(figure.subplots(1, len(chains.ORDERS), sharey=True), chains.ORDERS, strict=True):
            for name, style in entries.items():
                found = [(n, run.ns("chain", name, order, n)) for n in chains.SIZES]
                axes.loglog(*zip(*[(n, t) for n, t in found if t is not None], strict=True), **style)
            axes.set_xticks([2, 5, 10, 20, 50, 100], labels=["2", "5", "10", "20", "50", "100"])
            axes.set_xlabel("joints n")
            axes.set_title(f"order {order}")
        figure.axes[0].set_ylabel("ns per state")
        canvas.legend_above(figure, entries)

    return canvas.painted(paint, 9, 3.8)
