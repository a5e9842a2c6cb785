"""`jounce view`: a robot in the browser, with sliders, along a motion."""

import signal
from pathlib import Path
from threading import Event

import click

from jounce.cli.motion_options import MotionCommand, MotionRequest, add_optional_motion_options
from jounce.cli.robot_options import MESHES, RobotRequest, add_robot_options
from jounce.core.errors import escape_text

EPILOG = """\b
Examples:
  jounce view panda
  jounce view iiwa14 paper-wrench --port 9000

\b
Ctrl-C ends it. Only browsers on this machine see it.
"""


@click.command(cls=MotionCommand, epilog=EPILOG, short_help="Show a robot in the browser, with sliders.")
@add_robot_options
@add_optional_motion_options
@click.option("--port", type=click.IntRange(0, 65535), help="Port of the server; default: a free one from 8080 on.")
@MESHES
def view(robot: RobotRequest, motion: MotionRequest | None, port: int | None, meshes: tuple[Path, ...]) -> None:
    """Show ROBOT in the browser, at rest at the positions of its sliders, or along MOTION.

    A URDF is shown by its meshes and shapes, other robots by their joints. Q, its curves along the motion, frames and
    wrenches are shown too.
    """
    from jounce._report import scene, viewer
    from jounce._report.scene import record_track

    scene.check_installed()
    arm = robot.load()
    moves = None if motion is None else motion.load(arm, 0)
    along = None if moves is None else record_track(arm, moves)
    stopped = Event()
    before = signal.signal(signal.SIGINT, lambda *_: stopped.set())
    try:
        with viewer.serve_robot(arm, robot.path, along, port, meshes) as served:
            for note in (*served.scene.notes, *(moves.notes if moves else ())):
                click.echo(escape_text(note))
            click.echo(f"{escape_text(arm.name)} is shown at {served.address}; Ctrl-C ends it")
            viewer.run(served, stopped.wait)
    finally:
        signal.signal(signal.SIGINT, before)
    click.echo("ended")
