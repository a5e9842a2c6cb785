"""`jounce check`: every limit of a robot along a motion."""

from dataclasses import asdict
from math import isinf
from pathlib import Path
from typing import Any

import click

from jounce.cli.limits import LIMITS, load, spans_in_words
from jounce.cli.motions import AskedMotion, of_motion
from jounce.cli.options import Asked, on_robot
from jounce.cli.output import straight_columns, tell
from jounce.errors import shortened

SHOWN = 20  # limits in words

EPILOG = """\b
Example:
  jounce slowdown iiwa14 paper --limits iiwa14 --step 0.02 -o slower.csv
  jounce check iiwa14 slower.csv --limits iiwa14 -o ratio.svg

\b
Values between samples count. The exit code is 1 where a limit is broken.
"""


@click.command(epilog=EPILOG, short_help="Every limit of a robot along a motion.")
@on_robot
@of_motion
@LIMITS
@click.option(
    "-o", "--picture", type=click.Path(path_type=Path), help="Ratios over time as a picture: .png, .svg or .pdf."
)
@click.option("--json", "as_json", is_flag=True, help="Print every limit as JSON.")
def check(robot: Asked, motion: AskedMotion, limits: Path | None, picture: Path | None, as_json: bool) -> None:
    """Check MOTION of ROBOT against its limits of position, speed, acceleration, torque, torque rate and others."""
    if picture is not None:
        from jounce.figures import canvas
        from jounce.io import files

        canvas.check_format(picture)
        files.check_writable(picture)
        canvas.check_installed()
    arm, path = load(robot, motion, limits)
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
        "limits": [_row(asdict(row)) for row in found.table],
        "notes": [*path.notes, *found.notes],
        "picture": None if picture is None else str(picture),
    }
    tell(summary, _in_words, as_json)
    if not found.ok:
        raise SystemExit(1)


def _row(row: dict[str, Any]) -> dict[str, Any]:
    """A checked limit as plain data; JSON has no infinity."""
    return {key: None if isinstance(x, float) and isinf(x) else x for key, x in row.items()}


def _in_words(summary: dict[str, Any]) -> str:
    from jounce.model.limits import in_words

    rows = sorted(summary["limits"], key=lambda row: -_number(row["ratio"]))
    cells: list[tuple[str, ...]] = [("limit", "joint", "|worst|", "bound", "unit", "at t", "ratio", "broken at t")]
    for row in rows[:SHOWN]:
        value, bound, ratio = (f"{abs(_number(row[key])):.6g}" for key in ("value", "bound", "ratio"))
        deviation = f" +- {row['deviation']:.2g}" if row["deviation"] else ""
        cells.append((
            in_words(row["limit"], row["of"]), row["joint"], value, bound, row["unit"], f"{row['t']:.4f}",
            ratio + deviation, spans_in_words(row["violations"]) or "-",
        ))  # fmt: skip
    broken = sum(_number(row["ratio"]) > 1 + 1e-9 for row in rows)
    first, last = summary["t"]
    verdict = "every limit is kept" if summary["ok"] else f"{broken} of {len(rows)} limits broken"
    lines = [f"{shortened(summary['robot'])} along {summary['motion']}, t = {first:g} .. {last:g} s: {verdict}"]
    more = [f"and {len(rows) - SHOWN} more; --json lists them"] if len(rows) > SHOWN else []
    drawn = [f"ratios drawn to {summary['picture']}"] if summary["picture"] else []
    return "\n".join([*lines, *summary["notes"], "", *straight_columns(cells), *more, *drawn])


def _number(x: float | None) -> float:
    return float("inf") if x is None else x
