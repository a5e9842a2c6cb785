"""`jounce compare`: a robot checked against other libraries, its own other paths, and differentiation."""

import json
from typing import TYPE_CHECKING

import click

from jounce.cli.asked import Asked, on_robot
from jounce.cli.words import straight_columns

if TYPE_CHECKING:
    from jounce.comparison import Check

EPILOG = """\b
Example:
  jounce compare iiwa14

\b
At random states. Pinocchio and MuJoCo, where they are installed, know forces,
gravity and mass matrix; a file that they can read themselves they read, else
they are given our data. Rates are compared with those of other paths, and
with nine-point differences at the best step. Drives are left out.
The exit code is 1 where an error is larger than rounding, or differences, can
explain.
"""


@click.command(epilog=EPILOG, short_help="Check a robot against other libraries and paths.")
@on_robot
@click.option("--order", default=2, show_default=True, type=click.IntRange(0, 6), help="Highest time derivative of Q.")
@click.option("--states", default=20, show_default=True, type=click.IntRange(1, 10_000), help="How many.")
@click.option("--seed", default=0, show_default=True, type=click.IntRange(0), help="Of the random states.")
@click.option("--json", "as_json", is_flag=True, help="Print everything as JSON.")
@click.pass_context
def compare(ctx: click.Context, robot: Asked, order: int, states: int, seed: int, as_json: bool) -> None:
    """Compare ROBOT, a file or a bundled name, with other ways to the same numbers; print the worst errors."""
    from jounce.comparison import compare as checks_of

    arm, path = robot.load(), robot.path
    checks = checks_of(arm, path if path.is_file() else None, order=order, states=states, seed=seed)
    passed = all(check.passed for check in checks)
    if as_json:
        data = {"robot": arm.name, "states": states, "order": order, "passed": passed}
        rows = [vars(check) | {"passed": check.passed} for check in checks]
        click.echo(json.dumps(data | {"checks": rows}, indent=2))
    else:
        click.echo(_in_words(arm.name, states, checks))
    ctx.exit(0 if passed else 1)


def _in_words(name: str, states: int, checks: "list[Check]") -> str:
    rows: list[tuple[str, ...]] = [("", "against", "worst error", "allowed", "")]
    for check in checks:
        if check.error is None:
            rows.append((check.quantity, check.against, "-", "-", check.remark))
        else:
            verdict = check.remark if check.passed else f"TOO LARGE {check.remark}"
            rows.append((check.quantity, check.against, f"{check.error:.1e}", f"{check.allowed:.0e}", verdict))
    worst = [check for check in checks if not check.passed]
    end = f"{len(worst)} of {len(checks)} errors are too large" if worst else "all agree"
    return "\n".join([f"{name} at {states} random states: {end}", "", *straight_columns(rows)])
