"""Options of commands that read a motion: the curve of its samples, its columns and units, blends and rows."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from jounce.cli.options import MOTION, Decorator, renamed_flag
from jounce.core.errors import JounceError

if TYPE_CHECKING:
    from jounce.motion import Motion
    from jounce.robot import Robot

OPTIONS: tuple[Decorator, ...] = (
    click.option(
        "--bandwidth", type=float, metavar="HZ",
        help="Bandwidth of the smoothing of samples in HZ; default: as far as the motion exceeds the noise.",
    ),
    click.option("--allow-noise", is_flag=True, help="Accept samples even if noise dominates the highest rate."),
    renamed_flag("--force", "--allow-noise"),
    click.option("--degree", type=int, metavar="K", help="Interpolate samples by a spline of degree 5 or 7 instead."),
    click.option("--intervals", type=int, metavar="N", help="Least-squares fit of such a spline with N intervals."),
    click.option("--time", metavar="COLUMN", help="Name of the time column; default: t, time or timestamp."),
    click.option(
        "--columns", metavar="PATTERN",
        help="Pattern of the joints' column names, such as 'q_{joint}' or 'q{number}'."
    ),
    click.option(
        "--torques", metavar="PATTERN",
        help="Names of the columns of measured torques, such as 'tau{number}'; default: tau_JOINT, JOINT.tau, ..."
    ),
    click.option("--angles", type=click.Choice(["rad", "deg"]), help="Unit of angles and their rates in the table."),
    click.option("--time-unit", type=click.Choice(["s", "ms", "us", "ns"]), help="Unit of times in the table."),
    click.option("--topic", metavar="NAME", help="Topic to read from a ROS bag that has several."),
    click.option(
        "--blend", type=float, metavar="S", help="Replace breaks of planned motions by C^4 blends of S seconds."
    ),
    click.option(
        "--step", type=float, metavar="S", help="Time between rows in s; default: the motion's own rows, or 1 ms."
    ),
)  # fmt: skip
NAMES = (  # of the options of `jounce.load_motion`
    "degree", "intervals", "bandwidth", "allow_noise", "time", "columns", "torques", "angles", "time_unit", "topic",
)  # fmt: skip


@dataclass(frozen=True)
class AskedMotion:
    """A motion by its path or name, with the options of `jounce.load_motion`; a command loads it for its robot."""

    path: Path
    options: dict[str, Any]
    blend: float | None
    step: float | None

    def load(self, robot: "Robot", order: int) -> "Motion":
        """Load the motion, with the rates that forces up to an order need."""
        from jounce.robot.motions import load_motion

        found = load_motion(self.path, robot, order, **self.options)
        found = found if self.blend is None else found.blended(self.blend, max(4, order + 2))
        return found if self.step is None else found.with_step(self.step)


def of_motion(verb: Callable[..., None]) -> Callable[..., None]:
    """Add the argument MOTION and its options to a command, which gets them as one `motion`, an `AskedMotion`."""
    return click.argument("motion", type=MOTION)(_with_options(verb))


def of_optional_motion(verb: Callable[..., None]) -> Callable[..., None]:
    """`of_motion` of a command that does without a motion too: it gets None then."""
    return click.argument("motion", type=MOTION, required=False)(_with_options(verb))


def _with_options(verb: Callable[..., None]) -> Callable[..., None]:
    @wraps(verb)
    def asked(motion: Path | None, blend: float | None, step: float | None, **others: Any) -> None:
        options = {name: others.pop(name) for name in NAMES}
        if motion is None:
            if given := [name for name, value in {**options, "blend": blend, "step": step}.items() if value]:
                raise JounceError(f"--{given[0].replace('_', '-')} needs a MOTION")
            verb(motion=None, **others)
        else:
            verb(motion=AskedMotion(motion, options, blend, step), **others)

    command: Callable[..., None] = asked
    for option in reversed(OPTIONS):
        command = option(command)
    return command
