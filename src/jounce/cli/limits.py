"""What commands on limits share: options, the motion with the rates needed, pictures of ratios."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from jounce.cli.motion_options import MotionRequest
from jounce.cli.robot_options import PATH, FileOrName, RobotRequest

if TYPE_CHECKING:
    from collections.abc import Iterable

    from jounce.motion import Motion
    from jounce.robot import Robot


def _arms() -> "Iterable[str]":
    from jounce.io.limit_files import table_names

    return table_names()


LIMITS = click.option(
    "--limits",
    type=FileOrName("limits", _arms),
    metavar="FILE|ARM",
    help="YAML or JSON file of limits, also of MoveIt, or the published limits of an arm (panda, ur5e, iiwa14, ...).",
)
PICTURE_OF_RATIOS = click.option(
    "--picture", type=PATH, help="Draw the ratios to all limits over time: .png, .svg or .pdf."
)
DIFFERENCES = click.option(
    "--differences", type=click.IntRange(1, 4), default=3, metavar="N",
    help="Highest difference checked with --rate: 1 velocity, 2 acceleration, 3 jerk (libfranka), 4 snap.",
)  # fmt: skip


def load_with_motion(
    robot: RobotRequest,
    motion: MotionRequest,
    limits: Path | None,
    order: int = 0,
    path_duration: float | None = None,
) -> "tuple[Robot, Motion]":
    """Load a robot with its limits, and a motion.

    The motion has the rates that the limits, and forces up to an order, need. For `path_duration` see
    `MotionRequest.load`.
    """
    from jounce.limits.limited_motion import required_order

    arm = load_robot(robot, limits)
    return arm, motion.load(arm, max(order, required_order(arm)), path_duration)


def load_robot(robot: RobotRequest, limits: Path | None) -> "Robot":
    """Load a robot, with other limits if they are given."""
    arm = robot.load()
    return arm if limits is None else arm.with_limits(limits)


def draw_ratios(robot: "Robot", motion: "Motion", picture: Path) -> None:
    """Draw the ratios of a motion to all limits over time."""
    from jounce.figures import canvas, limit_pictures

    canvas.save(limit_pictures.draw_limit_ratios(robot, motion), picture)
