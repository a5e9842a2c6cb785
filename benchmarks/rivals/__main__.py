"""``python -m benchmarks.rivals``: measure all, write RIVALS.json, and make RIVALS.md of it.

``--page`` makes the page alone, from the JSON that is there, and the table of the README. ``--page --repeated OTHER``
adds how far a second run is apart from this one.
"""

import json
import os
from collections.abc import Sequence
from datetime import date
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Any

import click

from benchmarks import machine
from benchmarks.rivals import RIVALS, accuracy, calls, first, identification, page, repetition, retiming, robots
from benchmarks.rivals.robots import FIRST_ROBOTS
from jounce.io import files

OUTPUT = Path(__file__).parents[1]
SECTIONS = ("calls", "first", "accuracy", "retiming", "identification")
README = Path(__file__).parents[2] / "README.md"


@click.command()
@click.option("--page", "page_alone", is_flag=True, help="Make the pages from the JSON that is there.")
@click.option("--only", multiple=True, type=click.Choice(SECTIONS), help="Measure these sections anew, keep others.")
@click.option(
    "--repeated", type=click.Path(exists=True, path_type=Path), help="JSON of a second run, which the page compares."
)
@click.option("-o", "--output", default=OUTPUT, type=click.Path(path_type=Path), help="Folder to write into.")
def main(page_alone: bool, only: tuple[str, ...], repeated: Path | None, output: Path) -> None:
    """Measure jounce beside other libraries, and write RIVALS.json and RIVALS.md."""
    files.make_folder(output)
    found = json.loads((output / "RIVALS.json").read_text(encoding="utf-8")) if page_alone or only else {}
    if not page_alone:
        found |= measure(only or SECTIONS)
    if repeated is not None:
        second = json.loads(repeated.read_text(encoding="utf-8"))
        found["repeated"] = repetition.repeated(found, second)
    with files.write_whole(output / "RIVALS.json") as part:
        part.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    with files.write_whole(output / "RIVALS.md") as part:
        part.write_text(page.page(found), encoding="utf-8")
    if output == OUTPUT:
        text = page.with_table(README.read_text(encoding="utf-8"), found)
        with files.write_whole(README) as part:
            part.write_text(text, encoding="utf-8")


def measure(sections: Sequence[str]) -> dict[str, Any]:
    """Return what a run of some sections finds; the machine, versions and minutes are those of whole runs."""
    begin, before = perf_counter(), machine.load()
    rivals = list(RIVALS.values())

    def report(text: str) -> None:
        click.echo(f"{perf_counter() - begin:6.0f} s  {text}", err=True)

    with TemporaryDirectory() as place:
        # An earlier run does not compile for this one.
        os.environ["JOUNCE_CACHE_DIR"] = str(Path(place) / "kernels")
        arms = list(robots.write_arms(Path(place)))
        few = [arm for arm in arms if arm.name in FIRST_ROBOTS]
        measures = {
            "calls": lambda: calls.measured(arms, rivals, report),
            "first": lambda: first.measured(few, rivals, report),
            "accuracy": lambda: accuracy.measured(Path(place), rivals, report),
            "retiming": lambda: retiming.measured(report),
            "identification": lambda: identification.measured(report),
        }
        found = {name: measures[name]() for name in sections}
    if tuple(sections) != SECTIONS:
        return found
    versions = {rival.package: machine.version_of(rival.package) for rival in RIVALS.values()}
    versions |= {name: machine.version_of(name) for name in ("jax", "toppra", "ruckig", "copp-py")}
    return {
        "date": date.today().isoformat(),
        "machine": machine.hardware(),
        "versions": versions,
        "load": [before, machine.load()],
        "minutes": (perf_counter() - begin) / 60,
        **found,
    }


if __name__ == "__main__":
    main()
