"""What commands on limits share: the option --limits, the motion with the rates that limits need, limits in words."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from jounce.cli.motions import AskedMotion
from jounce.cli.options import Asked, FileOrName

if TYPE_CHECKING:
    from collections.abc import Iterable

    from jounce.motion import Motion
    from jounce.robot import Robot


def _arms() -> "Iterable[str]":
    from jounce.io.limits.reading import table_names

    return table_names()


LIMITS = click.option(
    "--limits",
    type=FileOrName("limits", _arms),
    metavar="FILE|ARM",
    help="Limits from a YAML or JSON file, MoveIt's too, or published ones of an arm (panda, fr3, ur5e, iiwa14, ...).",
)


def load(robot: Asked, motion: AskedMotion, limits: Path | None, order: int = 0) -> "tuple[Robot, Motion]":
    """The robot with its limits, and the motion with the rates that they and forces up to an order need."""
    from jounce.limits.bounded import order_needed

    arm = load_robot(robot, limits)
    return arm, motion.load(arm, max(order, order_needed(arm)))


def load_robot(robot: Asked, limits: Path | None) -> "Robot":
    """The robot with its limits."""
    arm = robot.load()
    return arm if limits is None else arm.with_limits(limits)


def draw_ratios(robot: "Robot", motion: "Motion", picture: Path) -> None:
    """Draw the ratios of a motion to all limits over time."""
    from jounce.figures import canvas, ratios
    from jounce.limits.along import ratios_along

    canvas.save(ratios.over_time(*ratios_along(robot, motion), robot.joint_names), picture)


def spans_in_words(spans: "list[list[float]]", most: int = 2) -> str:
    """When a limit is broken: the first spans, and how many more."""
    shown = [f"{start:.4f} .. {stop:.4f}" if stop > start else f"{start:.4f}" for start, stop in spans[:most]]
    more = f" and {len(spans) - most} more" if len(spans) > most else ""
    return ", ".join(shown) + more
