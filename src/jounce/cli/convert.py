"""`jounce convert`: a robot from any file that jounce reads, written in jounce's own format."""

from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING

import click

from jounce.cli.output import check_distinct, print_result
from jounce.cli.robot_options import PATH, RobotRequest, add_robot_options_without_drives
from jounce.core.errors import shorten

if TYPE_CHECKING:
    from jounce.core.typing import JsonObject

EPILOG = """\b
Example:
  jounce convert iiwa14 -o arm.yaml
  jounce convert g1 --base floating -o humanoid.yaml

\b
OUT contains names, tree, screws, inertias, limits, drives, frames and
gravity in SI units, without loss: reading it gives the same numbers to the
last bit. It does not record which drive terms act: select them with --drives
when you use it.
"""


@click.command(epilog=EPILOG, short_help="Convert a robot to a YAML or JSON file.")
@add_robot_options_without_drives
@click.option("-o", "--output", required=True, type=PATH, help="File to write: .yaml, .yml or .json.")
@click.option("--json", "as_json", is_flag=True, help="Print the summary as JSON.")
def convert(robot: RobotRequest, output: Path, as_json: bool) -> None:
    """Write ROBOT, a file or the name of a bundled robot, as a YAML or JSON file that can be edited."""
    from jounce.model.positions import multiscrew_joints
    from jounce.robot.saving import check_writable, save

    check_writable(output)
    check_distinct(output, robot.path)
    arm = robot.load()
    save(arm, output)
    m = arm.mechanism
    kinds = Counter(x.group.name for x in multiscrew_joints(m.tree).values())  # of joints of several screws

    def data() -> "JsonObject":
        return {
            "robot": arm.name, "source": str(robot.path), "output": str(output), "n": m.n, "nq": arm.nq, "nv": arm.nv,
            "joints": dict(kinds), "nb": len(m.moving_bodies),  # without the base
            "base": m.base_body, "frames": len(m.frames),
        }  # fmt: skip

    def lines() -> list[str]:
        floats = f"floating on {shorten(m.base_body)}, " if m.base_body else ""
        bodies = len(m.moving_bodies) + bool(m.base_body)  # as `jounce info` counts them
        several = "".join(f", {count} {kind} joint{'s' * (count > 1)}" for kind, count in kinds.items())
        numbers = f" ({arm.nq} numbers)" if several else ""
        size = f"{floats}{m.n} coordinates{numbers}, {bodies} bodies{several}, {len(m.frames)} merged links"
        return [f"{shorten(arm.name)}: {size} written to {output}"]

    print_result(lines, data, as_json)
