"""Where jounce loses: found in the figures, with the reason that was found by profiling and what it would take.

A group is a kind of comparison; a loss is one of its cells in which another library is better. The page names every
group that has one, so that a loss without a reason stands there as such.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from benchmarks.rivals import BOUND, JOUNCE

Row = Mapping[str, Any]
PLAIN = ("forces", "mass_matrix", "jacobian", "jacobian_rate", "accelerations")  # without derivatives by states


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
        "one plain call from Python",
        "calls",
        lambda row: row["states"] == 1 and row["task"] in PLAIN,
        "seconds",
        "more than half is NumPy's call of a generalized ufunc with its new arrays, a quarter finds the plan"
        " by the types of the arguments; the kernel takes the least. J of one body of a chain of 40 joints takes long"
        " in the kernel itself: J_i = Ad(C_ip) J_p + X_i G_i moves all columns so far from body to body, 780"
        " transforms of a column where 40 would do",
        "a method that is itself compiled, with a wheel for each system; `bind` has none of it today. For J of one"
        " body: the pose of each body in the last one, from the tip inward, which transforms each column once",
    ),
    Group(
        "derivatives and rates, one state from Python",
        "calls",
        lambda row: row["states"] == 1 and row["task"] not in PLAIN,
        "seconds",
        "of few joints as above; code of deep trees is a loop over columns, which carries all columns of a path and"
        " reads them from memory;"
        " code without loops would take minutes to compile",
        "joints that share a path as one block of columns, whose code is compiled once",
    ),
    Group(
        "batches",
        "calls",
        lambda row: row["states"] > 1,
        "seconds",
        "as for one state; the new arrays of large results are fresh memory in each call, which `out=` avoids",
        "the same; results by rows",
    ),
    Group(
        "first result",
        "first",
        lambda row: row["kernels"] == "none",
        "seconds",
        "SciPy and llvmlite are imported, and the robot is traced and compiled",
        "machine code on disk that loads without llvmlite; readers of robots without SciPy",
    ),
    Group(
        "memory of the first result",
        "first",
        lambda row: row["kernels"] == "none",
        "bytes",
        "llvmlite holds LLVM in memory, and SciPy is loaded",
        "the same",
    ),
    Group(
        "retiming: durations",
        "retiming",
        lambda row: row["kept"],
        "duration",
        "intervals are halved everywhere, until that gains less than half a percent",
        "knots where the jerk switches, in place of halving all",
    ),
    Group(
        "retiming: time to find them",
        "retiming",
        lambda row: row["kept"],
        "seconds",
        "under velocity and torque alone, two passes are loops of Python over grid points; under rates, a hundred and"
        " more steps of Newton's method are dozens of small calls of NumPy each",
        "the passes and one step of Newton's method as native code",
    ),
    Group(
        "identification: errors of forces",
        "identification",
        lambda row: True,
        "force_error",
        "one draw of the noise: with other seeds either is ahead; near rest, smooth friction is off where true friction"
        " turns over at once",
        "friction that turns over at once where the velocity is known well",
    ),
    Group(
        "identification: time",
        "identification",
        lambda row: True,
        "seconds",
        "the motion is fitted with its deviations; then a mass matrix is rebuilt from regressors in each of some fifty"
        " weightings of its errors",
        "the mass matrix is linear in the parameters: its parts once, in place of fifty times",
    ),
)


def losses(found: Mapping[str, Any]) -> list[Loss]:
    """Return the groups in which another library is better somewhere."""
    groups = [_loss(group, found[group.section]) for group in GROUPS]
    return [loss for loss in groups if loss is not None]


def _loss(group: Group, rows: Sequence[Row]) -> Loss | None:
    """Count the cells of a group in which another library is better."""
    compared = list(_factors([row for row in rows if not row.get("note") and group.has(row)], group.key))
    lost = [(factor, row["rival"]) for row, factor in compared if factor > 1]
    if not lost:
        return None
    factor, name = max(lost)
    often = f"{len(lost)} of {len(compared)} cells"
    return Loss(group.where, often, f"{factor:.4g} ({name})", group.why, group.would_take)


def _factors(rows: Sequence[Row], key: str) -> Iterator[tuple[Row, float]]:
    """Yield each row of another library that has a figure, with the least of ours over it."""
    ours: dict[tuple[Any, ...], float] = {}
    for row in rows:
        if _is_ours(row) and key in row:
            about = _about(row)
            ours[about] = min(row[key], ours.get(about, row[key]))
    for row in rows:
        if not _is_ours(row) and row["rival"] != BOUND and key in row and _about(row) in ours:
            yield row, ours[_about(row)] / row[key]


def _is_ours(row: Row) -> bool:
    """Return whether a row is of a method of jounce, whatever its options."""
    return row["rival"].startswith(JOUNCE) and row["rival"] != BOUND


def _about(row: Row) -> tuple[Any, ...]:
    """Return what a row is about, besides the library."""
    return tuple(row.get(name) for name in ("robot", "task", "states", "kernels", "problem", "log"))
