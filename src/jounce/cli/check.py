"""`jounce check`: every limit of a robot along a motion."""

from dataclasses import asdict
from math import isinf
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from jounce.cli.limits import LIMITS, load_robot, spans_in_words
from jounce.cli.motions import AskedMotion, of_motion
from jounce.cli.options import Asked, on_robot
from jounce.cli.output import straight_columns, tell
from jounce.cli.streaming import AskedStream, head_in_words, is_asked, on_stream_without_reduce, run_stream
from jounce.core.errors import JounceError, shortened

if TYPE_CHECKING:
    from jounce.limits.check import CheckedLimit
    from jounce.stream.job import Job

SHOWN = 20  # limits in words
EXIT_CODES = {"kept": 0, "broken": 1, "undecided": 3}  # 2 is that of errors

EPILOG = """\b
Example:
  jounce slowdown iiwa14 paper --limits iiwa14 --step 0.02 -o slower.csv
  jounce check iiwa14 slower.csv --limits iiwa14 -o ratio.svg

\b
Values between samples count. The exit code is 1 where a limit is broken, and
3 where measured samples leave it undecided.
MOTION may be a folder of tables, or a table of many motions.
"""


@click.command(epilog=EPILOG, short_help="Every limit of a robot along a motion.")
@on_robot
@of_motion
@LIMITS
@click.option(
    "-o", "--picture", type=click.Path(path_type=Path), help="Ratios over time as a picture: .png, .svg or .pdf."
)
@click.option(
    "--table",
    type=click.Path(path_type=Path),
    help="Write the limits of every motion as a table: .csv, .npz or .parquet.",
)
@on_stream_without_reduce
@click.option("--json", "as_json", is_flag=True, help="Print every limit as JSON.")
def check(
    robot: Asked,
    motion: AskedMotion,
    limits: Path | None,
    picture: Path | None,
    table: Path | None,
    stream: AskedStream,
    as_json: bool,
) -> None:
    """Check MOTION of ROBOT against its limits of position, speed, acceleration, torque, torque rate and others."""
    from jounce.limits.bounded import order_needed
    from jounce.stream.job import Job
    from jounce.stream.plan import is_by_parts

    if picture is not None:
        from jounce.figures import canvas

        canvas.check_writable(picture)
    arm = load_robot(robot, limits)
    job = Job("limits", arm, order_needed(arm), stream.reading(motion), None)
    if table is not None or is_asked(stream, motion, table) or is_by_parts(job, motion.path):
        if picture is not None:
            raise JounceError("-o draws one motion that is read as a whole; --table writes the limits of many")
        _tell_worst(job, motion, table, stream, as_json)
        return
    path = motion.load(arm, job.order)
    found = arm.check(path)
    if picture is not None:
        from jounce.figures.ratios import over_time
        from jounce.limits.along import ratios_along

        canvas.save(over_time(*ratios_along(arm, path), arm.joint_names), picture)
    summary = {
        "robot": arm.name,
        "motion": str(motion.path),
        "t": [path.start, path.stop],
        "ok": found.ok,
        "verdict": found.verdict,
        "judged": found.judged,
        "limits": [_row(row) for row in found.table],
        "notes": [*path.notes, *found.notes],
        "picture": None if picture is None else str(picture),
    }
    tell(summary, _in_words, as_json)
    raise SystemExit(EXIT_CODES[found.verdict])


def _tell_worst(job: "Job", motion: AskedMotion, table: Path | None, stream: AskedStream, as_json: bool) -> None:
    """Check tables by parts, and print the worst motion for each limit; the exit code is that of the verdict."""
    from jounce.limits.verdicts import overall

    found, summary = run_stream(job, motion, table, stream, "limits")
    worst: dict[tuple[str, str], dict[str, Any]] = {}
    for name, of in found.aggregates.items():
        for row in of["limits"]:
            key = row["joint"], row["limit"]
            if key not in worst or _number(row["ratio"]) > _number(worst[key]["ratio"]):
                worst[key] = row | {"motion": name}
    notes = dict.fromkeys(note for of in found.aggregates.values() for note in of["notes"])
    verdicts = {name: overall([row["verdict"] for row in of["limits"]]) for name, of in found.aggregates.items()}
    for verdict in ("broken", "undecided"):
        summary[verdict] = [name for name, of in verdicts.items() if of == verdict]
    verdict = overall(verdicts.values())
    summary |= {"notes": [*summary["notes"], *notes], "ok": verdict == "kept", "verdict": verdict}
    summary["judged"] = {}
    for of in found.aggregates.values():
        for kind, share in of["judged"].items():
            summary["judged"][kind] = min(share, summary["judged"].get(kind, 1.0))
    summary["worst"] = [*worst.values()]
    tell(summary, _worst_in_words, as_json)
    raise SystemExit(EXIT_CODES[verdict])


def _worst_in_words(summary: dict[str, Any]) -> str:
    from jounce.limits.verdicts import judged_in_words
    from jounce.model.limits import in_words

    rows = sorted(summary["worst"], key=lambda row: -_number(row["ratio"]))
    cells: list[tuple[str, ...]] = [("limit", "joint", "|worst|", "bound", "unit", "ratio", "at t", "motion")]
    for row in rows[:SHOWN]:
        value, bound, ratio = (f"{abs(_number(row[key])):.6g}" for key in ("value", "bound", "ratio"))
        limit = in_words(row["limit"], row["of"])
        cells.append((limit, row["joint"], value, bound, row["unit"], ratio, f"{row['t']:.4f}", row["motion"] or "-"))
    counts = [f"{name} in {len(summary[name])}" for name in ("broken", "undecided") if summary[name]]
    verdict = f"limits are {' and '.join(counts)} of {summary['motions']} motions" if counts else "every limit is kept"
    verdict = "; ".join([verdict, *judged_in_words(summary["judged"], "judged of each motion, at least")])
    more = [f"and {len(rows) - SHOWN} more; --json lists them"] if len(rows) > SHOWN else []
    written = [f"limits written to {summary['output']}"] if summary["output"] else []
    return "\n".join([*head_in_words(summary), verdict, *written, "", *straight_columns(cells), *more])


def _row(row: "CheckedLimit") -> dict[str, Any]:
    """A checked limit as plain data; JSON has no infinity."""
    plain = {key: None if isinstance(x, float) and isinf(x) else x for key, x in asdict(row).items()}
    return plain | {"verdict": row.verdict}


def _in_words(summary: dict[str, Any]) -> str:
    from jounce.limits.verdicts import verdict_in_words
    from jounce.model.limits import in_words

    rows = sorted(summary["limits"], key=lambda row: -_number(row["ratio"]))
    cells: list[tuple[str, ...]] = [
        ("limit", "joint", "|worst|", "bound", "unit", "at t", "ratio", "broken at t", "undecided at t")
    ]
    for row in rows[:SHOWN]:
        value, bound, ratio = (f"{abs(_number(row[key])):.6g}" for key in ("value", "bound", "ratio"))
        deviation = f" +- {row['deviation']:.2g}" if row["deviation"] else ""
        cells.append((
            in_words(row["limit"], row["of"]), row["joint"], value, bound, row["unit"], f"{row['t']:.4f}",
            ratio + deviation, spans_in_words(row["violations"]) or "-", spans_in_words(row["undecided"]) or "-",
        ))  # fmt: skip
    first, last = summary["t"]
    verdict = verdict_in_words([row["verdict"] for row in rows], summary["judged"])
    lines = [f"{shortened(summary['robot'])} along {summary['motion']}, t = {first:g} .. {last:g} s: {verdict}"]
    if not any(row["undecided"] for row in rows):
        cells = [row[:-1] for row in cells]
    more = [f"and {len(rows) - SHOWN} more; --json lists them"] if len(rows) > SHOWN else []
    drawn = [f"ratios drawn to {summary['picture']}"] if summary["picture"] else []
    return "\n".join([*lines, *summary["notes"], "", *straight_columns(cells), *more, *drawn])


def _number(x: float | None) -> float:
    return float("inf") if x is None else x
