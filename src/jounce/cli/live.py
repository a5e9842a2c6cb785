"""`jounce live`: rates, forces and broken limits of samples as they come."""

import csv
import json
import sys
from collections.abc import Iterable
from itertools import chain, islice, pairwise
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING

import click

from jounce.cli.limits import LIMITS, load_robot
from jounce.cli.robot_options import RobotRequest, add_robot_options
from jounce.core.errors import JounceError, join_names, warn

if TYPE_CHECKING:
    import numpy as np

    from jounce.live.estimator import LiveRates
    from jounce.robot import Robot

FIRST_ROWS = 20  # whose median spacing is dt, unless it is given
EXIT_ROWS_LEFT_OUT = 3  # what is written is not all that was asked for, as an undecided check is
COLUMNS = ("q", "qd", "q2d", "q3d", "q4d", "Q", "Qd", "Q2d", "Q_sd", "Qd_sd", "Q2d_sd")

EPILOG = """\b
Example, a motion as it would come from a robot:
  jounce motion iiwa14 paper --step 0.002 -o samples.csv
  jounce live iiwa14 samples.csv --limits iiwa14

\b
SAMPLES has a column t and one per joint, or NAME.q. Each row gives one of t,
NAME.q .. NAME.q4d, NAME.Q, NAME.Qd, NAME.Q2d, their deviations NAME.Q_sd ...,
whether all joints are trusted, and the limits that are broken by more than
two deviations. Without a lag Q2d serves no feedback; a Q2d that is smaller
than its deviation is left empty. Rows that cannot be used are left out with a
warning, and the exit code is 3 then. Three rows in a row whose times are not
after the last one, but increase, start a new clock.
"""


@click.command(epilog=EPILOG, short_help="Rates, forces and broken limits of samples as they come.")
@add_robot_options
@click.argument("samples", type=click.Path(path_type=Path, allow_dash=True), default="-")
@LIMITS
@click.option("--dt", type=float, metavar="S", help="Spacing of samples; default: that of the first rows.")
@click.option("--bandwidth", type=float, metavar="HZ", help="Bandwidth of the motion; default: the likeliest of nine.")
@click.option("--lag", type=float, default=0.02, metavar="S", help="Time by which rates are behind the samples.")
@click.option("--columns", metavar="PATTERN", help="Names of the joints' columns, such as 'q_{joint}'.")
@click.option("--follow", is_flag=True, help="Wait at the end of a file, and go on as it grows.")
@click.option("--json", "as_json", is_flag=True, help="Write a JSON object per row.")
def live(
    robot: RobotRequest,
    samples: Path,
    limits: Path | None,
    dt: float | None,
    bandwidth: float | None,
    lag: float,
    columns: str | None,
    follow: bool,
    as_json: bool,
) -> None:
    """Estimate rates and forces of ROBOT from SAMPLES as they come, CSV or JSON lines of a file or a pipe (-)."""
    from jounce.live.estimator import LiveRates
    from jounce.live.samples import read_lines, read_samples

    arm = load_robot(robot, limits)
    with click.open_file(str(samples), encoding="utf-8-sig") as source:
        rows = read_samples(read_lines(source, follow and str(samples) != "-"), arm.mechanism, columns)
        first = list(islice(rows, FIRST_ROWS if dt is None else 0))
        if dt is None:
            dt = _usual_spacing([t for t, _ in first])
        left_out = _write(arm, LiveRates(arm, dt, bandwidth, lag), chain(first, rows), as_json)
    if left_out:
        warn("1 row is left out" if left_out == 1 else f"{left_out} rows are left out")
        raise SystemExit(EXIT_ROWS_LEFT_OUT)


def _usual_spacing(times: list[float]) -> float:
    """The median spacing of the first rows, without those whose time does not increase, which are left out."""
    spacings = sorted(later - before for before, later in pairwise(times) if later > before)
    if not spacings:
        came = "fewer than two rows of samples"
        if len(times) > 1:
            came = f"the stamps of the first {len(times)} rows do not increase: {times[0]} and {times[1]} s"
        raise JounceError(f"{came}; state the spacing of samples by --dt")
    return spacings[len(spacings) // 2]


def _write(arm: "Robot", live: "LiveRates", rows: "Iterable[tuple[float, np.ndarray]]", as_json: bool) -> int:
    """Write a row per sample; return how many are left out."""
    from jounce.live.forces import find_broken, judged_limits

    judged = judged_limits(arm)
    if left := [kind.replace("_", " ") for kind in judged.limits.kinds if kind not in judged.kinds]:
        warn(f"limits of {join_names(left)} are not judged live; jounce check judges them")
    names = [f"{joint}.{name}" for name in COLUMNS for joint in arm.joint_names]
    table = csv.writer(sys.stdout, lineterminator="\n")
    if not as_json:
        table.writerow(["t", *names, "trusted", "broken"])
    live.forces()  # compiles its code before samples come
    left_out = 0
    for t, q in rows:
        if not isfinite(t):
            left_out += 1
            continue
        try:
            rates = live.update(q, t)
        except JounceError as error:
            warn(str(error))
            left_out += 1
            continue
        if not isfinite(live.t):  # before the first sample
            continue
        forces, deviations = live.forces(), live.deviations
        broken = find_broken(arm, judged, rates, deviations, forces)
        parts = (*rates, *forces[:3], *forces.deviations)
        numbers = [x if isfinite(x) else None for part in parts for x in part.tolist()]
        trusted = bool(live.trust.good.all())
        if as_json:
            values = {"t": live.t, **dict(zip(names, numbers, strict=True)), "trusted": trusted}
            sys.stdout.write(json.dumps(values | {"broken": [found._asdict() for found in broken]}) + "\n")
        else:
            said = "; ".join(f"{found.limit.replace('_', ' ')} of {found.joint}" for found in broken)
            table.writerow([live.t, *numbers, int(trusted), said])
        sys.stdout.flush()
    return left_out
