"""`jounce check`: every limit of a robot along a motion."""

from itertools import compress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from jounce.cli.limits import DIFFERENCES, EXIT_CODES, LIMITS, RATE, draw_ratios, load_robot, spans_in_words
from jounce.cli.motion_options import MotionCommand, MotionRequest, add_motion_options
from jounce.cli.output import align_columns, print_summary
from jounce.cli.robot_options import PATH, RobotRequest, add_robot_options
from jounce.cli.summaries import (
    UNCERTAIN_MARK,
    StreamRequest,
    add_stream_options_without_reduce,
    compute,
    hidden_in_words,
    is_by_parts,
    notes_in_words,
)
from jounce.core.errors import JounceError, shorten

if TYPE_CHECKING:
    from collections.abc import Mapping

    from jounce.motion import Motion
    from jounce.stream.aggregates import Aggregate

MAX_LIMITS_SHOWN = 20  # those nearest to their bounds: a table that fits a terminal; --json has all

EPILOG = """\b
Example:
  jounce slowdown iiwa14 paper --limits iiwa14 --step 0.02 -o slower.csv
  jounce check iiwa14 slower.csv --limits iiwa14 -o ratio.svg

\b
Values between samples count. The exit code is 1 if a limit is broken, and 3
if none is but one is undecided: a limit within two standard deviations of
measured samples, joints that move no mass (--massless-tips states that they
are meant), limits of 0, or inertias that no body can have.
MOTION may be a folder of tables, or a table of many motions.
"""


@click.command(cls=MotionCommand, epilog=EPILOG, short_help="Every limit of a robot along a motion.")
@add_robot_options
@add_motion_options
@LIMITS
@click.option("-o", "--picture", type=PATH, help="Ratios over time as a picture: .png, .svg or .pdf.")
@click.option("--table", type=PATH, help="Write the limits of every motion as a table: .csv, .npz or .parquet.")
@RATE
@DIFFERENCES
@add_stream_options_without_reduce
@click.option("--json", "as_json", is_flag=True, help="Print every limit as JSON.")
def check(
    robot: RobotRequest,
    motion: MotionRequest,
    limits: Path | None,
    picture: Path | None,
    table: Path | None,
    rate: float | None,
    differences: int,
    stream: StreamRequest,
    as_json: bool,
) -> None:
    """Check MOTION of ROBOT against its limits of position, speed, acceleration, torque, torque rate and others."""
    from jounce.limits.limited_motion import required_order
    from jounce.stream.job import Job

    if picture is not None:
        from jounce.figures import canvas

        canvas.check_writable(picture)
    arm = load_robot(robot, limits)
    job = Job("limits", arm, required_order(arm), stream.reading(motion), None)
    if picture is not None and is_by_parts(job, motion, table, stream):
        raise JounceError("-o draws one motion that is read as a whole; --table writes the limits of many")
    if rate is not None and (picture is not None or is_by_parts(job, motion, table, stream)):
        raise JounceError("--rate judges one motion that is read as a whole, without -o; --as commands judges many")
    loaded: list[Motion] = []

    def load() -> "Motion":
        found = motion.load(arm, job.order)
        loaded.append(found if rate is None else found.sampled(rate, differences))
        return loaded[0]

    found, summary = compute(job, motion, table, stream, "limits", load)
    if picture is not None:
        draw_ratios(arm, loaded[0], picture)
    summary |= {"picture": None if picture is None else str(picture), **_verdicts(found.aggregates)}
    print_summary(summary, _format_summary, as_json)
    raise SystemExit(EXIT_CODES[summary["verdict"]])


def _verdicts(found: "Mapping[str, Aggregate]") -> dict[str, Any]:
    """The verdict on all motions, the worst motion for each limit, and the least share of time that is judged."""
    from jounce.limits.verdicts import combine_verdicts
    from jounce.stream.limit_checks import infinite_if_none

    worst: dict[tuple[str, str], dict[str, Any]] = {}
    judged: dict[str, float] = {}
    for name, of in found.items():
        for row in of["limits"]:
            key = row["joint"], row["limit"]
            if key not in worst or infinite_if_none(row["ratio"]) > infinite_if_none(worst[key]["ratio"]):
                worst[key] = row | {"motion": name}
        for kind, share in of["judged"].items():
            judged[kind] = min(share, judged.get(kind, 1.0))
    verdicts = {name: combine_verdicts([row["verdict"] for row in of["limits"]]) for name, of in found.items()}
    verdict = combine_verdicts(verdicts.values())
    motions = {bad: [name for name, of in verdicts.items() if of == bad] for bad in ("broken", "undecided")}
    return {"ok": verdict == "kept", "verdict": verdict, "judged": judged, **motions, "limits": [*worst.values()]}


def _format_summary(summary: dict[str, Any]) -> str:
    from jounce.model.limit_kinds import describe_kind
    from jounce.stream.limit_checks import infinite_if_none

    rows = sorted(summary["limits"], key=lambda row: -infinite_if_none(row["ratio"]))
    cells: list[tuple[str, ...]] = [
        ("limit", "joint", "|worst|", "bound", "unit", "at t", "|certain|", "at t", "ratio", "broken at t",
         "undecided at t", "motion")
    ]  # fmt: skip
    for row in rows[:MAX_LIMITS_SHOWN]:
        value, bound, ratio = (f"{abs(infinite_if_none(row[key])):.6g}" for key in ("value", "bound", "ratio"))
        mark = " *" if row["certain"] else ""
        certain = (f"{abs(row['certain'][0]):.6g}", f"{row['certain'][1]:.4f}") if mark else ("", "")
        deviation = f" +- {row['deviation']:.2g}" if row["deviation"] else ""
        cells.append((
            describe_kind(row["limit"], row["of"]), row["joint"], value + mark, bound, row["unit"], f"{row['t']:.4f}",
            *certain, ratio + deviation, spans_in_words(row["violations"]) or "-",
            spans_in_words(row["undecided"]) or "-", row["motion"] or "-",
        ))  # fmt: skip
    marked = any(row["certain"] for row in rows[:MAX_LIMITS_SHOWN])
    shown = [True] * 6 + [marked] * 2 + [True] * 2 + [any(row["undecided"] for row in rows), summary["motions"] > 1]
    cells = [tuple(compress(row, shown)) for row in cells]
    robot, (first, last) = shorten(summary["robot"]), summary["t"]
    more = [f"and {len(rows) - MAX_LIMITS_SHOWN} more; --json lists them"] if len(rows) > MAX_LIMITS_SHOWN else []
    return "\n".join([
        f"{robot} along {summary['motion']}, t = {first:g} .. {last:g} s: {_verdict_in_words(summary)}",
        *notes_in_words(summary),
        *([f"limits written to {summary['output']}"] if summary["output"] else []),
        "",
        *align_columns(cells),
        *more,
        *([UNCERTAIN_MARK] if marked else []),
        *hidden_in_words(summary),
        *([f"ratios drawn to {summary['picture']}"] if summary["picture"] else []),
    ])  # fmt: skip


def _verdict_in_words(summary: dict[str, Any]) -> str:
    from jounce.limits.verdicts import describe_judged, describe_verdict

    if summary["motions"] == 1:
        return describe_verdict([row["verdict"] for row in summary["limits"]], summary["judged"])
    counts = [f"{name} in {len(summary[name])}" for name in ("broken", "undecided") if summary[name]]
    some, every = "limits are " + " and ".join(counts), "every limit is kept in"
    verdict = f"{some} of {summary['motions']} motions" if counts else f"{every} all {summary['motions']} motions"
    return "; ".join([verdict, *describe_judged(summary["judged"], "judged of each motion, at least")])
