"""``python -m benchmarks``: measure, and write RESULTS.md with its pictures beside this file."""

from pathlib import Path
from tempfile import TemporaryDirectory

import click

from benchmarks import chains, forces, machine, making, matrices, measure, peaks, products, quantities, start, threads
from benchmarks.pictures import pictures
from benchmarks.results import Run, page
from jounce.figures import canvas
from jounce.io import files


@click.command()
@click.option("--rounds", default=15, show_default=True, type=click.IntRange(1), help="Repetitions of every figure.")
@click.option(
    "-o", "--output", default=Path(__file__).parent, type=click.Path(path_type=Path),
    help="Folder to write into; the one of the benchmarks if left out.",
)  # fmt: skip
def main(rounds: int, output: Path) -> None:
    """Measure jounce beside others, and write RESULTS.md and pictures."""
    files.make_folder(output)
    before = machine.load()
    with TemporaryDirectory() as folder:
        click.echo("compiling", err=True)
        found, others = forces.gathered(), quantities.gathered()
        cases = [
            *peaks.cases(),
            *found.cases,
            *others.cases,
            *products.cases(),
            *threads.cases(),
            *chains.cases(),
            *matrices.cases(),
            *start.cases(Path(folder)),
        ]
        with click.progressbar(length=rounds, label=f"{len(cases)} cases") as bar:
            times = measure.medians(cases, rounds, lambda: bar.update(1))
    click.echo("making equations", err=True)
    run = Run(
        times,
        found,
        machine.described(),
        (before, machine.load()),
        rounds,
        tuple(making.made()),
        others.compiled,
        products.operations(),
    )
    with files.write_whole(output / "RESULTS.md") as part:
        part.write_text(page(run), encoding="utf-8")
    for name, figure in pictures(run).items():
        canvas.save(figure, output / f"{name}.svg")


if __name__ == "__main__":
    main()
