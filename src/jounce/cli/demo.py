"""`jounce demo`: the iiwa example of the paper, end to end, with its pictures."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING

import click

from jounce.cli.output import align_columns, print_result
from jounce.cli.robot_options import PATH
from jounce.core.progress import stage
from jounce.figures.canvas import PICTURE_FORMATS

if TYPE_CHECKING:
    from jounce._report.paper_example import Deviation, Example, StepErrors

EPILOG = """\b
Example:
  jounce demo -o paper --states 1000 --format png
"""


@click.command(epilog=EPILOG, short_help="Run the example of the paper, with pictures.")
@click.option(
    "-o", "--output", default=Path("jounce-demo"), type=PATH, help="Output folder; created if it does not exist."
)
@click.option("--states", default=10_000, type=click.IntRange(100, 1_000_000), help="Number of states over the 5 s.")
@click.option(
    "--format",
    "formats",
    multiple=True,
    default=PICTURE_FORMATS,
    type=click.Choice(PICTURE_FORMATS),
    help="Format of the pictures; may be repeated.",
)
@click.option("--json", "as_json", is_flag=True, help="Print the summary as JSON.")
def demo(output: Path, states: int, formats: Sequence[str], as_json: bool) -> None:
    """Run the paper's example: the KUKA iiwa along a motion of cosines, with and without a wrench at its end.

    Writes the forces and their rates as tables, and pictures: q, Q, Qd and Q2d with numerical differentiation laid
    over, the error of differentiation over its step, and the paper's figure of Q: its points, the authors' code, which
    meets them, and the formulas with and without the wrench.
    """
    from jounce._report import paper_example
    from jounce._report.paper_example import deviations, gallery
    from jounce.figures import canvas
    from jounce.io import files, tables
    from jounce.io.motions.writing import column_channel

    formats = list(dict.fromkeys(formats))
    canvas.check_installed()
    files.make_folder(output)
    steps, total = count(1), 3 + len(paper_example.methods()) + 5 * len(formats)
    with stage("the paper's example") as show:

        def advance() -> None:
            show(next(steps), total)

        examples = {}
        for name, motion in (("forces", "paper"), ("forces-wrench", "paper-wrench")):
            found = examples[name] = paper_example.example(motion, states)
            names = [f"{joint}.Q" for joint in found.robot.joint_names]
            forces = column_channel(names, found.t, found.forces)
            tables.write(output / f"{name}.csv", {"t": found.t} | forces.to_columns())
            advance()
        alone, loaded = examples.values()
        errors, causes = paper_example.step_errors(alone.robot), deviations(alone, loaded)
        advance()
        times = {}
        for method, *pair in paper_example.time_methods(alone):
            times[method] = pair
            advance()
        pictures = gallery(alone, loaded, errors)
        for name, paint in pictures.items():
            figure = paint()
            for kind in formats:
                canvas.save(figure, output / f"{name}.{kind}")
                advance()
    summary = DemoSummary(
        states=states,
        peaks={"without W": _peaks(alone), "with W": _peaks(loaded)},
        differences=_differences(alone, errors),
        figure=causes,
        milliseconds={method: [1e3 * x for x in pair] for method, pair in times.items()},
        milliseconds_of_the_paper=paper_example.PAPER_MS,
        folder=str(output),
        tables=[f"{name}.csv" for name in examples],
        pictures=list(pictures),
        formats=formats,
    )
    print_result(lambda: _lines(summary), lambda: asdict(summary), as_json)


@dataclass(frozen=True)
class DemoSummary:
    """What the demo has computed, by name: peaks of Q, Qd, Q2d, differences, times in ms, and what it wrote."""

    states: int
    peaks: Mapping[str, list[float]]
    differences: Mapping[str, list[float | None]]
    figure: "Mapping[str, Deviation]"
    milliseconds: Mapping[str, list[float]]
    milliseconds_of_the_paper: float
    folder: str
    tables: list[str]
    pictures: list[str]
    formats: list[str]


def _peaks(found: "Example") -> list[float]:
    return [float(abs(Q).max()) for Q in found.forces]


def _differences(alone: "Example", errors: "Sequence[StepErrors]") -> dict[str, list[float | None]]:
    """Map each differentiation scheme to its largest error of Qd and Q2d, relative to the largest value."""
    found: dict[str, list[float | None]] = {
        f"central over the samples, h = {alone.t[1]:.2g} s": list(alone.differences())
    }
    for name in errors[1].of_scheme:
        found[f"{name}, at its best step"] = [
            float(of.of_scheme[name].min()) if name in of.of_scheme else None for of in errors
        ]
    return found | {"two exact paths compared": [of.exact for of in errors]}


def _lines(summary: DemoSummary) -> list[str]:
    peaks = [(name, *(f"{peak:.6g}" for peak in row)) for name, row in summary.peaks.items()]
    differences = [
        (name, *("-" if share is None else f"{share:.1e}" for share in row))
        for name, row in summary.differences.items()
    ]
    times = [(name, *(f"{ms:.3g} ms" for ms in row)) for name, row in summary.milliseconds.items()]
    causes = [
        (name, *(f"{x:.3g} ({share:.1%})" for x, share in zip(row.largest, row.shares, strict=True)),
         f"{row.from_figure:.2g}")
        for name, row in summary.figure.items()
    ]  # fmt: skip
    return [
        f"The iiwa of Müller & Kumar, Section 6.2: {summary.states} states over 5 s; W: its end exerts 10 sin(pi t)",
        "",
        *align_columns([("largest", "|Q| N m", "|Qd| N m/s", "|Q2d| N m/s^2"), *peaks]),
        "",
        "Rates by numerical differentiation: largest error, as a share of the largest value",
        *align_columns([("", "Qd", "Q2d"), *differences]),
        "",
        "Time of one evaluation of Q, Qd and Q2d",
        *align_columns([("", "in a batch", "alone"), *times]),
        f"The paper reports {summary.milliseconds_of_the_paper} ms, on an Intel Core i9-7960X.",
        "",
        "The paper's figure of Q has the wrench W, which the text does not mention, and inertias without",
        "Steiner's theorem: largest difference from the formulas without W, and of Q from the figure",
        *align_columns([("", "Q N m", "Qd N m/s", "Q2d N m/s^2", "figure N m"), *causes]),
        "",
        f"In {summary.folder}: {', '.join(summary.tables)}",
        f"and as {', '.join(summary.formats)}: {', '.join(summary.pictures)}",
    ]
