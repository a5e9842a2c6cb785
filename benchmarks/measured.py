"""``python -m benchmarks.measured LOG``: torques that a real Panda measured, and those that its model predicts.

LOG is the log of Gaz, Cognetti, Oliva, Robuffo Giordano and De Luca, "Dynamic Identification of the Franka Emika Panda
Robot With Retrieval of Feasible Parameters Using Penalty-Based Optimization", IEEE RA-L 2019, in the repository
marcocognetti/FrankaEmikaPandaDynModel, as a table of time, panda_joint1 .. 7 and tau_panda_joint1 .. 7. It is under the
GPL-3.0 and no part of jounce; the picture is.
"""

import re
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import click
import numpy as np

import jounce
from jounce.figures import canvas

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ROOT = Path(__file__).parents[1]
EVERY = 50  # rows: as many as a page shows
HAND = r'<link name="panda_(?:hand|leftfinger|rightfinger)">.*?</link>'
MOVES = 0.02  # rad/s, below which the sign of a velocity says nothing of friction


@click.command()
@click.argument("log", type=click.Path(path_type=Path))
@click.option(
    "-o", "--output", default=ROOT / "docs" / "pictures" / "franka-log.svg", type=click.Path(path_type=Path),
    help="Picture to write.",
)  # fmt: skip
def main(log: Path, output: Path) -> None:
    """Draw measured and predicted torques of LOG, and print what remains of their differences without friction."""
    arms = {"with hand": loaded(hand=True), "without hand": loaded(hand=False)}
    joints = arms["with hand"].joint_names
    motion = jounce.load_motion(log, arms["with hand"], order=0)
    if motion.torques is None:
        raise click.ClickException(f"{log} has no columns tau_panda_joint1, ...")
    t, measured = motion.torques
    along = {name: robot.forces_along(motion, t, order=0) for name, robot in arms.items()}
    for name, found in along.items():
        for j, joint in enumerate(joints):
            off = measured[:, j] - found.forces[0][:, j]
            rest, (coulomb, viscous, _) = without_friction(off, found.rates[1][:, j])
            friction = f"{coulomb:.2f} N m + {viscous:.2f} N m s/rad and an offset"
            click.echo(f"{name}: {joint}: {rms(off):.2f} N m rms, {rms(rest):.2f} without friction of {friction}")
    curves = {"measured": measured} | {f"Q {name}": found.forces[0] for name, found in along.items()}
    canvas.save(picture(t, curves), output)


def loaded(hand: bool) -> jounce.Robot:
    """The arm, with the masses of its hand or without them; the fingers are locked."""
    text = (ROOT / "examples" / "panda.urdf").read_text()
    if not hand:
        text = re.sub(HAND, lambda link: re.sub(r"<inertial>.*?</inertial>", "", link[0], flags=re.DOTALL), text,
                      flags=re.DOTALL)  # fmt: skip
    with TemporaryDirectory() as folder:
        path = Path(folder) / "panda.urdf"
        path.write_text(text)
        return jounce.load(path, lock={"panda_finger_joint1": 0.0})


def picture(t: np.ndarray, curves: dict[str, np.ndarray]) -> "Figure":
    """One panel per joint, one above the other: they can be read on a phone too."""
    styles = [
        canvas.line_style(1) | {"linestyle": "solid"},
        canvas.line_style(0) | {"linestyle": (0, (3, 1.2))},
        {"color": canvas.INK},
    ]
    entries = dict(zip(curves, styles, strict=True))

    def paint(figure: "Figure") -> None:
        joints = next(iter(curves.values())).shape[1]
        grid = figure.subplots(joints, 1, sharex=True)
        for j, axes in enumerate(grid):
            for name, values in curves.items():
                axes.plot(t[::EVERY], values[::EVERY, j], **entries[name])
            axes.set_title(f"joint {j + 1} [N m]", loc="left")
            axes.margins(x=0.01)
        grid[-1].set_xlabel("t [s]")
        canvas.legend_above(figure, entries)

    return canvas.painted(paint, 5.5, 9.5)


def without_friction(off: np.ndarray, velocity: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Differences (N,) without Coulomb's and viscous friction and an offset, fitted by least squares; and these."""
    terms = np.stack([np.tanh(velocity / MOVES), velocity, np.ones(len(velocity))], axis=1)
    found = np.linalg.lstsq(terms, off)[0]
    return off - terms @ found, found


def rms(values: np.ndarray) -> float:
    """The root mean square."""
    return float(np.sqrt(np.mean(values**2)))


if __name__ == "__main__":
    main()
