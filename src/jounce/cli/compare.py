"""`jounce compare`: a robot's results compared with other libraries, other methods, and differentiation."""

from typing import TYPE_CHECKING

import click

from jounce.cli.output import align_columns, print_result
from jounce.cli.robot_options import RobotRequest, add_robot_options_without_drives
from jounce.core.errors import shorten

if TYPE_CHECKING:
    from jounce.core.typing import JsonObject

EPILOG = """\b
Example:
  jounce compare iiwa14

\b
All comparisons are at random states. Forces, gravity forces and the mass
matrix are compared with Pinocchio and MuJoCo if they are installed; each
reads the robot file itself if it can, and otherwise gets jounce's data. Rates
are compared with those of the other methods and with nine-point differences
at the best step. Drive terms are left out. The exit code is 1 if an error
exceeds its tolerance for rounding or differentiation.
"""


@click.command(epilog=EPILOG, short_help="Check a robot against other libraries and methods.")
@add_robot_options_without_drives
@click.option("--order", default=2, type=click.IntRange(0, 6), help="Highest time derivative of Q.")
@click.option("--states", default=20, type=click.IntRange(1, 10_000), help="How many.")
@click.option("--seed", default=0, type=click.IntRange(0), help="Seed of the random states.")
@click.option("--json", "as_json", is_flag=True, help="Print everything as JSON.")
@click.pass_context
def compare(ctx: click.Context, robot: RobotRequest, order: int, states: int, seed: int, as_json: bool) -> None:
    """Compare the results for ROBOT, a file or the name of a bundled robot, with other libraries and methods."""
    from jounce.checks.compare import compare as checks_of

    arm, path = robot.load(), robot.path
    checks = checks_of(arm, path if path.is_file() else None, order=order, states=states, seed=seed)
    failed = [check for check in checks if not check.passed]

    def data() -> "JsonObject":
        rows = [vars(check) | {"passed": check.passed} for check in checks]
        return {"robot": arm.name, "states": states, "order": order, "passed": not failed, "checks": rows}

    def lines() -> list[str]:
        rows: list[tuple[str, ...]] = [("", "against", "worst error", "allowed", "")]
        for check in checks:
            error, allowed, verdict = "-", "-", check.remark
            if check.error is not None:
                error, allowed = f"{check.error:.1e}", f"{check.allowed:.0e}"
                verdict = verdict if check.passed else f"TOO LARGE {verdict}"
            rows.append((check.quantity, check.against, error, allowed, verdict))
        end = f"{len(failed)} of {len(checks)} errors are too large" if failed else "all agree"
        return [f"{shorten(arm.name)} at {states} random states: {end}", "", *align_columns(rows)]

    print_result(lines, data, as_json)
    ctx.exit(1 if failed else 0)
