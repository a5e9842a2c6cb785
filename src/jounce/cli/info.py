"""`jounce info`: the bodies, joints, limits and masses of a robot."""

import json
from pathlib import Path
from textwrap import wrap
from typing import Any

import click

from jounce.cli.names import ROBOT
from jounce.cli.words import straight_columns

WIDTH = 100  # columns of a terminal
EPILOG = """\b
Example:
  jounce info iiwa14
"""


@click.command(epilog=EPILOG, short_help="Bodies, joints and masses of a robot.")
@click.argument("robot", type=ROBOT)
@click.option("--json", "as_json", is_flag=True, help="Print everything as JSON.")
def info(robot: Path, as_json: bool) -> None:
    """Show the bodies, joints, limits and masses of ROBOT: a file (.urdf, .yaml, .json) or a bundled one's name."""
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
            f"{body['mass']:.5g}", "-" if body["com"] is None else _vector(body["com"], "z.3f"),
        ))  # fmt: skip
    lines = [head, "", *straight_columns(rows)]
    limited = [_limits(body) for body in data["bodies"] if any(x is not None for x in body["limits"].values())]
    if limited:
        lines += ["", *straight_columns([("limits", "position", "velocity", "effort"), *limited])]
    follows = [f"{body['joint']} = {body['follows']}" for body in data["bodies"] if body["follows"]]
    if follows:
        lines += ["", *follows]
    merged = [f"{link} ({body})" for link, body in data["merged_links"].items()]
    if merged:
        lines += ["", *wrap(f"merged links: {', '.join(merged)}", width=WIDTH, subsequent_indent="  ")]
    findings = [f"finding: {body['name']}: {body['finding']}" for body in data["bodies"] if body["finding"]]
    return "\n".join([*lines, *([""] if findings else []), *findings])


def _vector(x: list[float], form: str) -> str:
    return " ".join(f"{v:{form}}" for v in x)


def _limits(body: dict[str, Any]) -> tuple[str, ...]:
    """The limits of a joint as cells of a table; "-" for those not stated."""
    unit, drive = ("m", "N") if body["type"] == "prismatic" else ("rad", "N m")
    lower, upper, velocity, effort = (None if x is None else f"{x:.5g}" for x in body["limits"].values())
    reach = f"{lower or '-inf'} .. {upper or 'inf'} {unit}" if lower or upper else "-"
    return (body["joint"], reach, f"{velocity} {unit}/s" if velocity else "-", f"{effort} {drive}" if effort else "-")
