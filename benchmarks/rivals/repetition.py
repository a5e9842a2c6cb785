"""``python -m benchmarks.rivals.repetition ONE.json OTHER.json``: how far the ratios of two runs are apart.

A ratio is the time of another library over that of jounce's method in the same run, for a call, a first result, a
retiming or an identification; memory and errors are compared as ratios too. Two runs on one machine should agree within
15 %, whatever the speed of the machine was.
"""

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import click

from benchmarks.rivals import JOUNCE

TOLERANCE = 0.15
KEYS = ("robot", "task", "states", "kernels", "problem", "log")  # what a row is about, besides the library
MEASURED = ("seconds", "bytes")
SECTIONS = ("calls", "first", "retiming", "identification")

Ratios = dict[tuple[Any, ...], float]


@click.command()
@click.argument("one", type=click.Path(exists=True, path_type=Path))
@click.argument("other", type=click.Path(exists=True, path_type=Path))
def main(one: Path, other: Path) -> None:
    """Print the ratios of two runs that differ by more than 15 %, and how many there are."""
    first, second = (ratios(json.loads(path.read_text(encoding="utf-8"))) for path in (one, other))
    for key in sorted(set(first) ^ set(second), key=str):
        click.echo(f"in one run alone: {key}")
    factors = {key: second[key] / first[key] for key in first if key in second}
    for key, factor in factors.items():
        if is_apart(factor):
            click.echo(f"{key}: {first[key]:.3g}, then {second[key]:.3g}, {factor:.2f} times")
    count = sum(map(is_apart, factors.values()))
    click.echo(f"{len(factors) - count} of {len(factors)} ratios are within {TOLERANCE:.0%}")


def repeated(one: Mapping[str, Any], other: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return for each library how many of its ratios two runs share, how many are apart, and the largest factor."""
    first, second = ratios(one), ratios(other)
    factors: dict[str, list[float]] = {}
    for key in first:
        if key in second:
            factor = second[key] / first[key]
            factors.setdefault(key[-2], []).append(max(factor, 1 / factor))
    return [
        {"rival": name, "ratios": len(of_rival), "apart": sum(map(is_apart, of_rival)), "largest": max(of_rival)}
        for name, of_rival in factors.items()
    ]


def is_apart(factor: float) -> bool:
    """Return whether two ratios differ by more than the tolerance, one over the other."""
    return max(factor, 1 / factor) > 1 + TOLERANCE


def ratios(found: Mapping[str, Any]) -> Ratios:
    """Return all ratios of a run, by section, what is compared, library and what is measured."""
    return {key: ratio for section in SECTIONS for key, ratio in _of_section(section, found[section])}


def _of_section(section: str, rows: list[dict[str, Any]]) -> Iterator[tuple[tuple[Any, ...], float]]:
    ours = {_about(row): row for row in rows if row["rival"] == JOUNCE}
    for row in rows:
        if row["rival"] == JOUNCE:
            continue
        same = ours.get(_about(row), {})
        for name in MEASURED:
            if row.get(name) is not None and same.get(name) is not None:
                yield (section, *_about(row), row["rival"], name), row[name] / same[name]


def _about(row: Mapping[str, Any]) -> tuple[Any, ...]:
    return tuple(row[key] for key in KEYS if key in row)


if __name__ == "__main__":
    main()
