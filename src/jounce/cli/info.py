"""`jounce info`: the bodies, joints, limits and masses of a robot, and an audit of them."""

from textwrap import wrap
from typing import Any

import click

from jounce.cli.output import align_columns, print_summary
from jounce.cli.robot_options import RobotRequest, add_robot_options
from jounce.core.errors import shorten

INFO_WIDTH = 100  # characters of a line: names of robots in one line, on usual terminals
COMMON = ("position", "velocity", "effort")  # limits that most robots have
EPILOG = """\b
Example:
  jounce info iiwa14
  jounce info planar2r --strict --json
  jounce info iiwa14 --lock joint3=0 --gravity 0 0 -1.62
"""


@click.command(epilog=EPILOG, short_help="Show bodies, joints and masses of a robot, and audit its data.")
@add_robot_options
@click.option("--strict", is_flag=True, help="Exit with code 1 if the audit finds errors or warnings.")
@click.option("--json", "as_json", is_flag=True, help="Print everything as JSON.")
def info(robot: RobotRequest, strict: bool, as_json: bool) -> None:
    """Show the bodies, joints, limits and masses of ROBOT: a file or the name of a bundled robot.

    Ends with a data audit: errors (physically impossible data, or a singular mass matrix), warnings (possible, but
    probably a mistake) and notes.
    """
    from jounce.checks.description import describe

    data = describe(robot.load().mechanism)
    print_summary(data, _format_summary, as_json)
    if strict and any(finding["severity"] != "note" for finding in data["findings"]):
        raise SystemExit(1)


def _format_summary(data: dict[str, Any]) -> str:
    from jounce.model.drives import AMOUNTS

    gravity = " ".join(f"{x:g}" for x in data["gravity"])
    base = [data["base"]] if data["base"] else []
    numbers = f" ({len(data['positions'])} numbers)" if len(data["positions"]) > data["n"] else ""
    size = f"{data['n']} coordinates{numbers}, {len(base) + data['nb']} bodies, {data['mass']:.6g} kg moving"
    head = f"{shorten(data['name'])}: {size}{', floating' if base else ''}, gravity {gravity} m/s^2"
    rows: list[tuple[str, ...]] = [("joint", "type", "axis", "body", "on", "mass kg", "COM m")]
    rows += [("-", "floating", "-", body["name"], "-", *_mass(body)) for body in base]
    for body in data["bodies"]:
        kind = body["type"] if body["pitch"] is None else f"{body['type']} {body['pitch']:g} m/rad"
        axis = _vector(body["axis"], ".4g") if body["axis"] else f"{body['nq']} in q, {body['nv']} velocities"
        rows.append((body["joint"], kind, axis, body["name"], body["parent"], *_mass(body)))
    order = wrap(f"q: {', '.join(map(shorten, data['positions']))}", width=INFO_WIDTH, subsequent_indent="   ")
    lines = [head, *order, "", *align_columns(rows)]
    variables = [x for body in data["bodies"] for x in body["velocities"] or [body]]
    lines += _limits(variables)
    driven = [_drive(x) for x in variables if any(x["drive"][key] for key in AMOUNTS.values())]
    if driven:
        acting = f"in Q: {', '.join(data['acting']) or 'none of these'}"
        lines += ["", *align_columns([("drive", *AMOUNTS), *driven]), acting]
    lines += _elastic(data)
    follows = [f"{shorten(body['joint'])} = {body['follows']}" for body in data["bodies"] if body["follows"]]
    if follows:
        lines += ["", *follows]
    lines += _loops(data)
    if standing := [f"{shorten(contact['frame'])} ({contact['kind']})" for contact in data["contacts"]]:
        lines += ["", *wrap(f"contacts: {', '.join(standing)}", width=INFO_WIDTH, subsequent_indent="  ")]
    merged = [f"{shorten(link)} ({shorten(body)})" for link, body in data["merged_links"].items()]
    if merged:
        lines += ["", *wrap(f"merged links: {', '.join(merged)}", width=INFO_WIDTH, subsequent_indent="  ")]
    return "\n".join([*lines, *_moments(base + data["bodies"]), *_findings(data["findings"])])


def _loops(data: dict[str, Any]) -> list[str]:
    """The cut joints of loops, and the joints that follow where they are closed."""
    cuts = [f"{' - '.join(map(shorten, loop['frames']))} ({loop['joint']})" for loop in data["loops"]]
    following = [f"following joints: {', '.join(map(shorten, data['following']))}"] if data["following"] else []
    loops = [f"loops, {'closed' if following else 'open'}: {', '.join(cuts)}"] if cuts else []
    by = {mover: [shorten(x) for x, own in data["moved_by"].items() if own == mover] for mover in ("spring", "nothing")}
    passive = [f"passive, moved by {mover}: {', '.join(names)}" for mover, names in by.items() if names]
    wrapped = [wrap(line, width=INFO_WIDTH, subsequent_indent="  ") for line in loops + following + passive]
    return ["", *(line for lines in wrapped for line in lines)] if wrapped else []


def _mass(body: dict[str, Any]) -> tuple[str, str]:
    """The mass and COM of a body as cells of a table."""
    return "-" if body["mass"] is None else f"{body['mass']:.5g}", "-" if body["com"] is None else _vector(
        body["com"], "z.3f"
    )


def _moments(bodies: list[dict[str, Any]]) -> list[str]:
    """A table of principal moments and of what is left until they break the triangle inequality."""
    rows = [
        (body["name"], *(f"{x:.4g}" for x in body["principal_moments"]), f"{body['triangle_slack']:.3g}")
        for body in bodies
        if body["principal_moments"] is not None
    ]
    return ["", *align_columns([("body", "principal moments", "about COM", "kg m^2", "triangle slack"), *rows])]


def _findings(findings: list[dict[str, Any]]) -> list[str]:
    from jounce.checks.audit import Finding

    lines = [""]
    for finding in (Finding(**data) for data in findings):
        for text, indent in ((f"{finding.severity}: {finding}", ""), (finding.advice, "  ")):
            lines += wrap(text, INFO_WIDTH, initial_indent=indent, subsequent_indent="  ", break_long_words=False)
    return lines if findings else ["", "no findings"]


def _vector(x: list[float], form: str) -> str:
    return " ".join(f"{v:{form}}" for v in x)


def _drive(body: dict[str, Any]) -> tuple[str, ...]:
    """The drive train of a joint as cells of a table; "-" for terms that it lacks."""
    unit, force, inertia = ("m", "N", "kg") if body["unit"] == "m" else ("rad", "N m", "kg m^2")
    d = body["drive"]
    cells = (
        (d["armature"], f"{d['armature']:.5g} {inertia}"),
        (d["damping"], f"{d['damping']:.5g} {force} s/{unit}"),
        (d["friction"], f"{d['friction']:.5g} {force} over {d['eps']:.5g} {unit}/s"),
        (d["stribeck"], f"{d['stribeck']:.5g} {force} to {d['stribeck_velocity']:.5g} {unit}/s"),
        (d["stiffness"], f"{d['stiffness']:.5g} {force}/{unit} from {d['rest']:.5g} {unit}"),
        (d["offset"], f"{d['offset']:.5g} {force}"),
        (d["load_friction"], f"{d['load_friction']:.5g} over {d['load_eps']:.5g} {force}"),
    )
    return (body["joint"], *(text if stated else "-" for stated, text in cells))


def _elastic(data: dict[str, Any]) -> list[str]:
    """A table of the springs and motors of elastic joints."""
    if data["elastic"] is None:
        return []
    rows: list[tuple[str, ...]] = [("elastic", "stiffness", "rotor", "viscous", "friction")]
    for coordinate in data["coordinates"]:
        e = data["elastic"][coordinate["name"]]
        unit, force, inertia = ("m", "N", "kg") if coordinate["unit"] == "m" else ("rad", "N m", "kg m^2")
        rows.append((
            coordinate["name"],
            "rigid" if e["stiffness"] is None else f"{e['stiffness']:.5g} {force}/{unit}",
            f"{e['rotor']:.5g} {inertia}",
            f"{e['viscous']:.5g} {force} s/{unit}" if e["viscous"] else "-",
            f"{e['friction']:.5g} {force} over {e['eps']:.5g} {unit}/s" if e["friction"] else "-",
        ))  # fmt: skip
    return ["", *align_columns(rows)]


def _limits(bodies: list[dict[str, Any]]) -> list[str]:
    """A table of the limits that are stated of any joint; "-" for those that are not stated of one."""
    from jounce.checks.description import limit_in_words
    from jounce.model.limit_kinds import LIMIT_KINDS

    rows = {body["joint"]: {kind: limit_in_words(body, kind) for kind in LIMIT_KINDS} for body in bodies}
    shown = [kind for kind in LIMIT_KINDS if kind in COMMON or any(row[kind] != "-" for row in rows.values())]
    limited = [(joint, *(row[kind] for kind in shown)) for joint, row in rows.items() if set(row.values()) != {"-"}]
    heads = ("limits", *(kind.replace("_", " ") for kind in shown))
    return ["", *align_columns([heads, *limited])] if limited else []
