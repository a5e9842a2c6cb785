"""`jounce view`: a robot in the browser, with sliders, along a motion."""

import signal
from pathlib import Path
from threading import Event

import click

from jounce.cli.motions import AskedMotion, MotionCommand, of_optional_motion
from jounce.cli.options import MESHES, Asked, on_robot
from jounce.core.errors import escaped

EPILOG = """\b
Examples:
  jounce view panda
  jounce view iiwa14 paper-wrench --port 9000

\b
Ctrl-C ends it. Only browsers on this machine see it.
"""


@click.command(cls=MotionCommand, epilog=EPILOG, short_help="Show a robot in the browser, with sliders.")
@on_robot
@of_optional_motion
@click.option("--port", type=click.IntRange(0, 65535), help="Port of the server; default: a free one from 8080 on.")
@MESHES
def view(robot: Asked, motion: AskedMotion | None, port: int | None, meshes: tuple[Path, ...]) -> None:
    """Show ROBOT in the browser, at rest at the positions of its sliders, or along MOTION.

    A URDF is shown by its meshes and shapes, other robots by their joints. Q, its curves along the motion, frames and
    wrenches are shown too.
    """
    from jounce._report.view import scene, viewer
    from jounce._report.view.track import track

    scene.check_installed()
    arm = robot.load()
    along = None if motion is None else track(arm, motion.load(arm, 0))
    stopped = Event()
    before = signal.signal(signal.SIGINT, lambda *_: stopped.set())
    try:
        with viewer.serving(arm, robot.path, along, port, meshes) as served:
            for note in served.scene.notes:
                click.echo(escaped(note))
            click.echo(f"{escaped(arm.name)} is shown at {served.address}; Ctrl-C ends it")
            viewer.run(served, stopped.wait)
    finally:
        signal.signal(signal.SIGINT, before)
    click.echo("ended")
