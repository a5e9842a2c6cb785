"""Where jounce loses: found in the figures, with the reason that was found by profiling and what it would take.

A group is a kind of comparison; a loss is one of its cells in which another library is better. The page names every
group that has one, so that a loss without a reason stands there as such.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from benchmarks.rivals import BOUND, JOUNCE

Row = Mapping[str, Any]
PLAIN = ("forces", "mass_matrix", "jacobian", "jacobian_rate", "accelerations")  # tasks without derivatives by states
LARGE = ("g1", "chain")


@dataclass(frozen=True)
class Loss:
    """A group of comparisons that jounce loses."""

    where: str
    often: str  # so many cells of those compared
    most: str  # the largest factor, and of which library
    why: str
    would_take: str


@dataclass(frozen=True)
class Group:
    """A kind of comparison, and why jounce loses it."""

    where: str
    section: str
    has: Callable[[Row], bool]
    key: str  # of a row: what is compared, less is better
    why: str
    would_take: str


GROUPS = (
    Group(
        "one plain call from Python", "calls",
        lambda row: row["states"] == 1 and row["task"] in PLAIN, "seconds",
        "the method finds its plan by the kinds of its arguments, checks shapes, makes the results;"
        " the kernel takes a tenth of the call",
        "a method that is itself compiled: a C extension with a wheel for each system; until then `bind`, which"
        " has none of it",
    ),
    Group(
        "derivatives from Python, one state", "calls",
        lambda row: row["states"] == 1 and row["task"] not in PLAIN, "seconds",
        "of deep trees the code is a loop over columns, whose arrays leave the registers between steps; code in a"
        " straight line would take minutes to compile",
        "blocks of columns that share a path, compiled once and called for each",
    ),
    Group(
        "batches", "calls", lambda row: row["states"] > 1, "seconds",
        "derivatives of large robots: results are written with the state as the last index and turned afterwards",
        "kernels that write whole rows of results",
    ),
    Group(
        "first result", "first", lambda row: row["kernels"] == "none", "seconds",
        "importing SciPy and llvmlite, and compiling the robot",
        "kernels in the cache, as in the row below; a smaller set of imports",
    ),
    Group(
        "memory", "first", lambda row: row["kernels"] == "none", "bytes",
        "llvmlite and SciPy are loaded", "a cache of machine code that loads without llvmlite",
    ),
)  # fmt: skip


def losses(found: Mapping[str, Any]) -> list[Loss]:
    """Return the groups in which another library is better somewhere."""
    groups = [_loss(group, found[group.section]) for group in GROUPS]
    return [loss for loss in groups if loss is not None]


def _loss(group: Group, rows: Sequence[Row]) -> Loss | None:
    """Count the cells of a group in which another library is better."""
    compared = [(row, factor) for row, factor in _factors(rows, group.key) if group.has(row)]
    lost = [(factor, row["rival"]) for row, factor in compared if factor > 1]
    if not lost:
        return None
    factor, name = max(lost)
    often = f"{len(lost)} of {len(compared)} cells"
    return Loss(group.where, often, f"{factor:.3g} ({name})", group.why, group.would_take)


def _factors(rows: Sequence[Row], key: str) -> Iterator[tuple[Row, float]]:
    """Yield each row of another library that has a figure, with ours over it."""
    names = ("robot", "task", "states", "kernels")
    ours = {tuple(row.get(name) for name in names): row for row in rows if row["rival"] == JOUNCE}
    for row in rows:
        same = ours.get(tuple(row.get(name) for name in names), {})
        if row["rival"] not in (JOUNCE, BOUND) and key in row and key in same:
            yield row, same[key] / row[key]
