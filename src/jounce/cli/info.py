"""`jounce info`: the bodies, joints, limits and masses of a robot."""

import json
from textwrap import wrap
from typing import Any

import click

from jounce.cli.robots import Asked, on_robot
from jounce.cli.words import straight_columns

WIDTH = 100  # columns of a terminal
DRIVE = ("armature", "damping", "friction", "stiffness")
EPILOG = """\b
Example:
  jounce info iiwa14
  jounce info iiwa14 --lock joint3=0 --gravity 0 0 -1.62
"""


@click.command(epilog=EPILOG, short_help="Bodies, joints and masses of a robot.")
@on_robot
@click.option("--json", "as_json", is_flag=True, help="Print everything as JSON.")
def info(robot: Asked, as_json: bool) -> None:
    """Show the bodies, joints, limits and masses of ROBOT: a file (.urdf, .xacro, .yaml, .json) or iiwa14, planar2r."""
    from jounce.description import describe

    data = describe(robot.load().mechanism)
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
    order = wrap(f"q: {', '.join(c['name'] for c in data['coordinates'])}", width=WIDTH, subsequent_indent="   ")
    lines = [head, *order, "", *straight_columns(rows)]
    limited = [_limits(body) for body in data["bodies"] if any(x is not None for x in body["limits"].values())]
    if limited:
        lines += ["", *straight_columns([("limits", "position", "velocity", "effort"), *limited])]
    driven = [_drive(body) for body in data["bodies"] if any(body["drive"][key] for key in DRIVE)]
    if driven:
        acting = f"in Q: {', '.join(data['acting']) or 'none of these'}"
        lines += ["", *straight_columns([("drives", *DRIVE), *driven]), acting]
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


def _drive(body: dict[str, Any]) -> tuple[str, ...]:
    """What the drive train of a joint takes as cells of a table, SI units; "-" for what it does not."""
    return (body["joint"], *(f"{body['drive'][key]:.5g}" if body["drive"][key] else "-" for key in DRIVE))


def _limits(body: dict[str, Any]) -> tuple[str, ...]:
    """The limits of a joint as cells of a table; "-" for those not stated."""
    unit, drive = ("m", "N") if body["type"] == "prismatic" else ("rad", "N m")
    lower, upper, velocity, effort = (None if x is None else f"{x:.5g}" for x in body["limits"].values())
    reach = f"{lower or '-inf'} .. {upper or 'inf'} {unit}" if lower or upper else "-"
    return (body["joint"], reach, f"{velocity} {unit}/s" if velocity else "-", f"{effort} {drive}" if effort else "-")
