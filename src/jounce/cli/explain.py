"""`jounce explain`: why a controller stops a motion."""

import shlex
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import click

from jounce.cli.limits import DIFFERENCES, EXIT_CODES, LIMITS, RATE, load_with_motion
from jounce.cli.motion_options import TYPED_WORDS, MotionCommand, MotionRequest, add_motion_options
from jounce.cli.output import align_columns, print_result
from jounce.cli.robot_options import RobotRequest, add_robot_options
from jounce.core.errors import JounceError, shorten

if TYPE_CHECKING:
    from jounce.core.typing import JsonObject
    from jounce.limits.explanation import Explanation
    from jounce.robot import Robot

MAX_TRIPS_SHOWN = 12  # the first stops the robot; --json has all

EPILOG = """\b
Example:
  jounce excite ur5 --starts 1 -o excite.csv
  jounce explain ur5 excite.csv --rate 500

\b
Give --controller franka for a Panda or FR3, and --as commands for tables of
commands. The exit code is that of check: 0 kept, 1 broken, 3 undecided.
"""


@click.command(cls=MotionCommand, epilog=EPILOG, short_help="Why a controller stops a motion, and what cures it.")
@add_robot_options
@add_motion_options
@LIMITS
@click.option("--controller", metavar="NAME", help="Controller whose public rules and limits are used: franka.")
@RATE
@DIFFERENCES
@click.option("--start", metavar="Q1,Q2,...", help="Measured position, rad or m, at which the robot rests before.")
@click.option("--json", "as_json", is_flag=True, help="Print the explanation as JSON.")
def explain(
    robot: RobotRequest, motion: MotionRequest, limits: Path | None, controller: str | None, rate: float | None,
    differences: int, start: str | None, as_json: bool,
) -> None:  # fmt: skip
    """Explain which limits of ROBOT the commands of MOTION break, when and for which cause, and what cures it."""
    if controller is not None and limits is not None:
        raise JounceError("--controller has limits of its own; leave out --limits, or give --rate in its place")
    arm, path = load_with_motion(robot, motion, limits, 1)
    try:
        begin = None if start is None else [float(x) for x in start.split(",")]
    except ValueError:
        raise JounceError(f"--start is {start!r}; expected numbers with commas between them") from None
    found = arm.explain(path, controller, rate=rate, differences=differences, start=begin)
    # The call of Python becomes the command line.
    commands = [_repeat_command(cure.method, arm, motion.path) for cure in found.cures]

    def data() -> "JsonObject":
        cures = [
            {key: value for key, value in asdict(cure).items() if key != "call"} | {"command": command}
            for cure, command in zip(found.cures, commands, strict=True)
        ]
        about = {"robot": arm.name, "motion": str(motion.path), "controller": controller, "ok": found.verdict == "kept"}
        return about | asdict(found) | {"cures": cures}

    def lines() -> list[str]:
        return _lines(f"{shorten(arm.name)} along {motion.path}", found, commands)

    print_result(lines, data, as_json)
    raise SystemExit(EXIT_CODES[found.verdict])


def _repeat_command(verb: str, arm: "Robot", motion: Path) -> str:
    """The command line of another verb on the same robot, motion and limits, at the same rate."""
    from jounce.limits.explanation import select_controller

    context = click.get_current_context()
    typed = context.command.make_parser(context).parse_args(list(context.meta[TYPED_WORDS]))[0]
    words, left_out = ["jounce", verb], {"controller", "start", "as_json"}
    if name := typed.get("controller"):
        known, limits = select_controller(name, arm.joint_names)
        left_out |= {"differences"}
        typed |= {"limits": limits, "rate": f"{known.rate:g}"}
    for parameter in context.command.params:
        value, key = typed.get(str(parameter.name)), parameter.opts[0]
        if value is None or parameter.name in left_out:
            continue
        if isinstance(parameter, click.Argument):
            words.append(value)
        elif parameter.is_flag:  # type: ignore[attr-defined] # an option
            words.append(key)
        else:
            for given in value if parameter.multiple else [value]:
                words += [key, *([given] if isinstance(given, str) else given)]
    return shlex.join([*words, "-o", f"{motion.stem}-{verb}.csv"])


def _lines(head: str, found: "Explanation", commands: Sequence[str]) -> list[str]:
    trips, words = found.trips, found.words
    first: list[str] = []
    if trips:
        one = trips[0]
        words = f"the {one.limit} of {one.joint} is broken at {1e3 * one.t:.6g} ms: {one.words}"
        rows: list[tuple[str, ...]] = [
            ("at t", "until", "joint", "limit", "value", "bound", "unit", "worst ratio", "cause")
        ]
        for of in trips[:MAX_TRIPS_SHOWN]:
            start, stop, value, bound, ratio = (f"{x:.6g}" for x in (of.t, of.stop, of.value, of.bound, of.ratio))
            cause = f"{of.cause}: {of.words}"
            rows.append((start, stop, of.joint, of.limit, value, bound, of.unit, ratio, cause))
        more = len(trips) - MAX_TRIPS_SHOWN
        first = ["", *align_columns(rows), *([f"and {more} more moments; --json lists them"] if more > 0 else []), ""]
    effects = {True: "cures it", False: "does not cure it"}
    cures = []
    for cure, command in zip(found.cures, commands, strict=True):
        cures.append(f"{cure.method} {effects[cure.works]}: {cure.words}")
        if cure.works:
            cures.append(f"  {command}")
    unpredicted = (f"not predicted: {what}" for what in found.unpredicted)
    return [f"{head}: {words}", *found.notes, *first, *cures, *unpredicted]
