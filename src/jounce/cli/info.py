"""`jounce info`: the bodies, joints and masses of a robot."""

import json
from pathlib import Path
from textwrap import wrap
from typing import Any

import click

from jounce.cli.names import ROBOT
from jounce.cli.words import straight_columns

EPILOG = """\b
Example:
  jounce info iiwa14
"""


@click.command(epilog=EPILOG, short_help="Bodies, joints and masses of a robot.")
@click.argument("robot", type=ROBOT)
@click.option("--json", "as_json", is_flag=True, help="Print everything as JSON.")
def info(robot: Path, as_json: bool) -> None:
    """Show the bodies, joints and masses of ROBOT: a URDF file or a bundled name (iiwa14, planar2r)."""
    from jounce.description import describe
    from jounce.io.loading import load

    data = describe(load(robot).mechanism)
    click.echo(json.dumps(data, indent=2) if as_json else _in_words(data))


def _in_words(data: dict[str, Any]) -> str:
    gravity = " ".join(f"{x:g}" for x in data["gravity"])
    size = f"{data['n']} coordinates, {data['nb']} bodies, {data['mass']:.6g} kg moving"
    head = f"{data['name']}: {size}, gravity {gravity} m/s^2"
    rows: list[tuple[str, ...]] = [("joint", "type", "axis", "body", "on", "mass kg", "COM m")]
    for body in data["bodies"]:
        kind = body["type"] if body["pitch"] is None else f"{body['type']} {body['pitch']:g} m/rad"
        rows.append((
            body["joint"], kind, _vector(body["axis"], ".4g"), body["name"], body["parent"],
            f"{body['mass']:.5g}", "-" if body["com"] is None else _vector(body["com"], ".4f"),
        ))  # fmt: skip
    lines = [head, "", *straight_columns(rows)]
    follows = [f"{body['joint']} = {body['follows']}" for body in data["bodies"] if body["follows"]]
    if follows:
        lines += ["", *follows]
    merged = [f"{link} ({body})" for link, body in data["merged_links"].items()]
    if merged:
        lines += ["", *wrap(f"merged links: {', '.join(merged)}", width=110, subsequent_indent="  ")]
    findings = [f"finding: {body['name']}: {body['finding']}" for body in data["bodies"] if body["finding"]]
    return "\n".join([*lines, *([""] if findings else []), *findings])


def _vector(x: list[float], form: str) -> str:
    return " ".join(f"{v:{form}}".replace("-0.0000", "0.0000") for v in x)
