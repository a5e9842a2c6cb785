"""``python -m benchmarks.identified LOG``: a real Panda identified from one part of its log, tested on the other part.

LOG is the log that `benchmarks.measured` names, under the GPL-3.0 and no part of jounce; the picture is.
"""

from pathlib import Path

import click
import numpy as np

import jounce
from benchmarks.measured import ROOT, loaded
from jounce.figures import canvas
from jounce.figures.measured_forces import draw_measured_forces


@click.command()
@click.argument("log", type=click.Path(path_type=Path))
@click.option(
    "--span", default=(0.3, 6.0), show_default=True, type=float, nargs=2, help="Times of the part that is used."
)
@click.option("--prior", default=0.3, show_default=True, help="Relative deviation of the model's own parameters.")
@click.option(
    "-o", "--output", default=ROOT / "docs" / "pictures" / "franka-identified.svg", type=click.Path(path_type=Path),
    help="Picture to write.",
)  # fmt: skip
def main(log: Path, span: tuple[float, float], prior: float, output: Path) -> None:
    """Identify the Panda of LOG; print what is left of its torques, in the band of the motion and of all samples."""
    robot = loaded(hand=False)
    motion = jounce.load_motion(log, robot, order=0)
    found = robot.identify(motion, span=span, prior=prior)
    click.echo(str(found))
    for part in ("used", "rest"):
        rows = [row for row in found.residuals if row.part == part]
        band = [row.identified / row.model for row in rows]
        samples = [row.identified_samples / row.model_samples for row in rows]
        ripple = [np.sqrt(row.identified_samples**2 - row.identified**2) / row.identified_samples for row in rows]
        click.echo(f"{part}: of the model's residuals in the band {shares(band)}, of all samples {shares(samples)}")
        click.echo(f"{part}: share of the remaining residuals above the band {shares(ripple)}")
    canvas.save(draw_measured_forces(found), output)


def shares(values: list[float]) -> str:
    """Ratios, by joint."""
    return " ".join(f"{value:.2f}" for value in values)


if __name__ == "__main__":
    main()
