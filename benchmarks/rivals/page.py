"""RIVALS.md and the table of the README, made of RIVALS.json: each figure is a cell of a table.

A library that is faster than the method of jounce, or better, stands in bold, whatever a bound kernel takes. A cell
without a figure says why: a dash where the library has no such function, else what happened.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from benchmarks.rivals import BOUND, JOUNCE, RIVALS, elsewhere, losses
from benchmarks.rivals.calls import ROUNDING, ROUNDS
from benchmarks.rivals.repetition import TOLERANCE
from benchmarks.rivals.robots import TITLES
from benchmarks.rivals.tasks import TASKS
from benchmarks.tables import figure, paragraph, share, table

DASH = "-"
FORMED = """Written by `python -m benchmarks.rivals`, the [benchmark](rivals/__init__.py) beside this page, from
RIVALS.json. Each library runs in a process of its own; all are timed in turn, {rounds} rounds of calls that last some
milliseconds, and the least of the rounds counts. Everything runs on one thread. Results are compared before they are
timed, with those of jounce's recursion in NumPy; where they differ by more than {rounding:.0e} of the largest entry,
the cell has the difference. **Bold** is what is faster or better than the methods of jounce. "{dash}" is what a library
has no function for."""
README_TASKS = ("forces", "force_rates", "mass_matrix", "accelerations", "force_derivatives")
README_RIVALS = (JOUNCE, "Pinocchio", "MuJoCo", "CasADi")  # the libraries that people know
README_BLOCK = re.compile(r"(<!-- made by python -m benchmarks\.rivals: speed -->\n)(.*?)(<!-- end -->)", re.DOTALL)

Found = Mapping[str, Any]
Row = Mapping[str, Any]


def page(found: Found) -> str:
    """RIVALS.md."""
    formed = FORMED.format(rounds=ROUNDS, rounding=ROUNDING, dash=DASH)
    sections = (
        _machine, _repeated, _single, _batches, _first, _accuracy, _retiming, _identification, _does_more, _elsewhere,
        _losses,
    )  # fmt: skip
    lines = ["# Rivals", "", *paragraph(formed)]
    for section in sections:
        lines += section(found)
    return "\n".join(lines).rstrip() + "\n"


def with_table(readme: str, found: Found) -> str:
    """Return the README with its table of speed made anew."""
    text = "\n".join(_readme_table(found))
    if not README_BLOCK.search(readme):
        raise ValueError("README.md has no block 'made by python -m benchmarks.rivals: speed'")
    return README_BLOCK.sub(lambda block: f"{block[1]}{text}\n{block[3]}", readme)


def _machine(found: Found) -> Iterator[str]:
    yield from ["## Machine and versions", ""]
    rows = [*found["machine"], *found["versions"].items(), ("date", found["date"])]
    rows += [("load average before, after", ", ".join(found["load"])), ("minutes", f"{found['minutes']:.0f}")]
    yield from table(("", ""), rows, side="---")
    called = [(name, rival.called) for name, rival in RIVALS.items()]
    yield from paragraph("How each library is called, which is what its own documents name as the fastest way:")
    yield from table(("library", "called by"), called, side="---")


def _repeated(found: Found) -> Iterator[str]:
    if "repeated" not in found:
        return
    yield from ["## A second run", ""]
    yield from paragraph(
        f"""Ratios of each library's times and memory to those of jounce's methods, in this run and in a second one on
        the same machine: how many differ by more than {TOLERANCE:.0%}, and by how much at most. XLA, below adam and
        frax, hands a call to a thread of its own, whose wake-up is quick or slow for seconds on end: these two are
        sampled for some seconds longer."""
    )
    rows = found["repeated"]
    lines = [(row["rival"], f"{row['ratios']}", f"{row['apart']}", f"{row['largest']:.2f} times") for row in rows]
    yield from table(("library", "ratios", "apart", "at most"), lines)


def _single(found: Found) -> Iterator[str]:
    yield from ["## One state from Python", ""]
    yield from paragraph("Microseconds of one call.")
    for robot, title in TITLES.items():
        yield from [f"### {title}, one state", "", *_calls(found["calls"], robot, 1, 1e6, "us")]


def _batches(found: Found) -> Iterator[str]:
    yield from ["## Batches of 1,000 states", ""]
    yield from paragraph("Nanoseconds for each state; libraries without batches are called for each state.")
    for robot, title in TITLES.items():
        yield from [f"### {title}, 1,000 states", "", *_calls(found["calls"], robot, 1000, 1e9, "ns")]


def _calls(rows: Sequence[Row], robot: str, states: int, scale: float, unit: str) -> list[str]:
    """Return the table of a robot: a row for each task, a column for each library."""
    some = [row for row in rows if row["robot"] == robot and row["states"] == states]
    names = [name for name in RIVALS if any(row["rival"] == name for row in some)]
    lines = []
    for task in TASKS.values():
        of_task = {row["rival"]: row for row in some if row["task"] == task.name}
        ours = of_task.get(JOUNCE, {}).get("seconds")
        lines.append((task.title, *(_time(of_task.get(name), ours, scale) for name in names)))
    return table((unit, *names), lines)


def _time(row: Row | None, ours: float | None, scale: float) -> str:
    """Return the cell of a call: its time, bold where it is faster, with its error where that is beyond rounding."""
    if row is None:
        return DASH
    if "seconds" not in row:
        return str(row["note"])
    text = figure(scale * row["seconds"])
    if row["rival"] not in (JOUNCE, BOUND) and ours is not None and row["seconds"] < ours:
        text = f"**{text}**"
    if row["error"] > ROUNDING:
        text += f", off by {share(row['error'])}"
    return text


def _first(found: Found) -> Iterator[str]:
    yield from ["## First result and memory", ""]
    yield from paragraph(
        """Seconds from the start of the interpreter to Q of one state: importing, reading the robot's file, compiling.
        Then the largest memory of that process in MiB. Folders in which libraries keep what they compile are empty,
        except in the row that says so."""
    )
    rows = found["first"]
    robots = list(dict.fromkeys(row["robot"] for row in rows))
    kinds = list(dict.fromkeys((row["rival"], row["kernels"]) for row in rows))
    lines = []
    for name, kernels in kinds:
        cells = []
        for robot in robots:
            of_robot = [row for row in rows if row["robot"] == robot]
            row = next((row for row in of_robot if (row["rival"], row["kernels"]) == (name, kernels)), None)
            ours = next(row for row in of_robot if row["rival"] == JOUNCE)
            cells += [_least(row, ours, "seconds", 1), _least(row, ours, "bytes", 1 / 2**20)]
        lines.append((name if kernels == "none" else f"{name}, kernels on disk", *cells))
    head = [cell for robot in robots for cell in (f"{TITLES[robot]}, s", "MiB")]
    yield from table(("", *head), lines)


def _least(row: Row | None, ours: Row, key: str, scale: float) -> str:
    """Return a cell in which less is better, in bold where it is less than ours."""
    if row is None:
        return DASH
    if key not in row:
        return str(row["note"])
    return _less(row, ours, key, scale)


def _accuracy(found: Found) -> Iterator[str]:
    yield from ["## Accuracy against 50 digits", ""]
    yield from paragraph(
        """Largest difference from [values with 50 digits](../tests/golden/lagrange/iiwa.json) over the largest value:
        the iiwa of the paper, whose inertias MuJoCo refuses and Newton changes. A double has an error of 1e-16. Bold is
        what is nearer than jounce by more than a unit in the last place."""
    )
    rows = found["accuracy"]
    tasks = list(dict.fromkeys(row["task"] for row in rows))
    lines = []
    for name in dict.fromkeys(row["rival"] for row in rows):
        cells = []
        for task in tasks:
            row = next((row for row in rows if (row["rival"], row["task"]) == (name, task)), None)
            cells.append(_error(row, next(row for row in rows if (row["rival"], row["task"]) == (JOUNCE, task))))
        lines.append((name, *cells))
    yield from table(("", *(TASKS[task].title for task in tasks)), lines)


UNIT = 2.0**-52  # in the last place of a double, relative


def _error(row: Row | None, ours: Row) -> str:
    if row is None:
        return DASH
    if "error" not in row:
        return str(row["note"])
    text = share(row["error"])
    return f"**{text}**" if row["error"] < ours["error"] - UNIT else text


def _retiming(found: Found) -> Iterator[str]:
    yield from ["## Retiming", ""]
    yield from paragraph(
        """Durations of the motions, processor time to find them, and the largest share of each limit between the points
        of the libraries, found by one dense evaluation of all motions: more than 1 exceeds a limit. Bold is a shorter
        motion or less time than jounce's for the same problem, where all its limits are kept."""
    )
    kinds = list(dict.fromkeys(kind for row in found["retiming"] for kind in row.get("shares") or {}))
    lines = []
    for row in found["retiming"]:
        label = f"{row['problem']}: {row['rival']}"
        if row.get("note"):
            lines.append((label, row["note"], *[DASH] * (len(kinds) + 1)))
            continue
        ours = [
            other for other in found["retiming"]
            if other["problem"] == row["problem"] and other["rival"].startswith(JOUNCE) and not other.get("note")
        ]  # fmt: skip
        shares = [_share(row["shares"].get(kind, DASH)) for kind in kinds]
        lines.append(
            (label, *(_shorter(row, ours, key, scale) for key, scale in (("duration", 1), ("seconds", 1e3))), *shares)
        )
    yield from table(
        ("problem: library", "duration, s", "computing, ms", *(f"share of {kind}" for kind in kinds)), lines
    )


def _shorter(row: Row, ours: Sequence[Row], key: str, scale: float) -> str:
    text = f"{scale * row[key]:.4f}" if key == "duration" else figure(scale * row[key])
    if row["rival"].startswith(JOUNCE) or not ours or not row["kept"]:
        return text
    return f"**{text}**" if row[key] < min(other[key] for other in ours) else text


def _share(value: float | str | None) -> str:
    if value is None:
        return "jumps"
    return value if isinstance(value, str) else f"{value:.3f}"


def _identification(found: Found) -> Iterator[str]:
    yield from ["## Identification", ""]
    yield from paragraph(
        """Simulated logs whose parameters are known. Errors of forces along another motion, over the deviation of the
        noise; squared errors of parameters over the stated covariance and their number, 1 where the deviations are
        right; the share of parameters off by more than two stated deviations, 0.046 where they are right."""
    )
    lines = []
    for row in found["identification"]:
        label = f"{row['log']}: {row['rival']}"
        if row.get("note"):
            lines.append((label, row["note"], *[DASH] * 3))
            continue
        ours = next(
            (other for other in found["identification"] if (other["log"], other["rival"]) == (row["log"], JOUNCE)), row
        )
        chi2 = "states none" if row["chi2"] is None else figure(row["chi2"])
        beyond = "states none" if row["beyond_two"] is None else figure(row["beyond_two"])
        lines.append((label, _less(row, ours, "force_error"), chi2, beyond, _less(row, ours, "seconds")))
    yield from table(("log: library", "error of forces", "chi2", "beyond two deviations", "s"), lines)


def _less(row: Row, ours: Row, key: str, scale: float = 1) -> str:
    """Return a figure of which less is better, in bold where it is less than ours."""
    text = figure(scale * row[key])
    if row["rival"] == JOUNCE or ours.get("note"):
        return text
    return f"**{text}**" if row[key] < ours[key] else text


def _does_more(found: Found) -> Iterator[str]:
    yield from ["## What a rival does more", ""]
    rows = [(name, text) for name, text in elsewhere.does_more().items()]
    yield from table(("library", "does beyond jounce"), rows, side="---")


def _elsewhere(found: Found) -> Iterator[str]:
    yield from ["## Not measured here", ""]
    yield from table(
        ("library", "figure of its own", "source", "why it is not measured"),
        [(row.library, row.figure, row.source, row.reason) for row in elsewhere.ROWS], side="---",
    )  # fmt: skip


def _losses(found: Found) -> Iterator[str]:
    yield from ["## Where jounce loses, and why", ""]
    head = ("where", "how often", "at most, times", "why", "what it would take")
    rows = [(loss.where, loss.often, loss.most, loss.why, loss.would_take) for loss in losses.losses(found)]
    yield from table(head, rows, side="---")


def _readme_table(found: Found) -> list[str]:
    """Return the table of the README: the arm of seven joints, one state and batches."""
    rows = [row for row in found["calls"] if row["robot"] == "xarm7"]
    lines = []
    for states, scale, unit in ((1, 1e6, "us"), (1000, 1e9, "ns")):
        for name in README_TASKS:
            of_task = {row["rival"]: row for row in rows if (row["task"], row["states"]) == (name, states)}
            ours = of_task.get(JOUNCE, {}).get("seconds")
            label = f"{TASKS[name].title}, {'one state' if states == 1 else 'per state of 1,000'}, {unit}"
            lines.append((label, *(_time(of_task.get(peer), ours, scale) for peer in README_RIVALS)))
    hardware = dict(found["machine"])
    note = f"{hardware['processor']}; {found['date']}; versions and method in benchmarks/RIVALS.md."
    return [*table((TITLES["xarm7"], *README_RIVALS), lines), note]
