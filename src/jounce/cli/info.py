"""`jounce info`: the bodies, joints, limits and masses of a robot, and an audit of them."""

from textwrap import wrap
from typing import TYPE_CHECKING

import click

from jounce.cli.output import align_columns, print_result
from jounce.cli.robot_options import RobotRequest, add_robot_options
from jounce.core.errors import shorten

if TYPE_CHECKING:
    from jounce.checks.description import InertiaDescription, RobotDescription, VariableDescription

INFO_WIDTH = 100  # characters of a line: names of robots in one line, on usual terminals
COMMON = ("position", "velocity", "effort")  # limits that most robots have
UNITS = (("rad", "N m", "kg m^2"), ("m", "N", "kg"))  # of a position, force and inertia, of joints in rad and in m
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

    found = describe(robot.load().mechanism)
    print_result(lambda: _lines(found), found.json, as_json)
    if strict and any(finding.severity != "note" for finding in found.findings):
        raise SystemExit(1)


def _lines(found: "RobotDescription") -> list[str]:
    from jounce.model.drives import AMOUNTS
    from jounce.model.positions import position_names

    m, positions = found.mechanism, position_names(found.mechanism)
    gravity = " ".join(f"{x:g}" for x in m.gravity)
    numbers = f" ({len(positions)} numbers)" if len(positions) > m.n else ""
    count = len(m.moving_bodies) + bool(found.base)
    size = f"{m.n} coordinates{numbers}, {count} bodies, {found.mass:.6g} kg moving"
    head = f"{shorten(m.name)}: {size}{', floating' if found.base else ''}, gravity {gravity} m/s^2"
    order = _wrap(f"q: {', '.join(map(shorten, positions))}", indent="   ")
    lines = [head, *order, "", *align_columns(_body_rows(found)), *_limits(found)]
    driven = [x for body in found.bodies for x in body.variables if x.drive and any(map(x.drive.get, AMOUNTS.values()))]
    if driven:
        acting = f"in Q: {', '.join(m.acting) or 'none of these'}"
        lines += ["", *align_columns([("drive", *AMOUNTS), *map(_drive, driven)]), acting]
    lines += _elastic(found)
    follows = [f"{shorten(body.joint.joint)} = {body.joint.follows}" for body in found.bodies if body.joint.follows]
    if follows:
        lines += ["", *follows]
    lines += _loops(found)
    if standing := [f"{shorten(contact.frame)} ({contact.kind})" for contact in m.contacts]:
        lines += ["", *_wrap(f"contacts: {', '.join(standing)}")]
    if merged := [f"{shorten(link)} ({shorten(body)})" for link, body in found.merged_links.items()]:
        lines += ["", *_wrap(f"merged links: {', '.join(merged)}")]
    return [*lines, *_moments(found), *_findings(found)]


def _body_rows(found: "RobotDescription") -> list[tuple[str, ...]]:
    """The bodies with the joints that move them, as rows of a table."""
    rows: list[tuple[str, ...]] = [("joint", "type", "axis", "body", "on", "mass kg", "COM m")]
    if found.base:
        rows.append(("-", "floating", "-", str(found.mechanism.base_body), "-", *_mass(found.base)))
    for body in found.bodies:
        joint = body.joint
        kind = joint.type if joint.pitch is None else f"{joint.type} {joint.pitch:g} m/rad"
        axis = _vector(joint.axis, ".4g") if joint.axis else f"{body.nq} in q, {body.nv} velocities"
        rows.append((joint.joint, kind, axis, body.name, body.parent, *_mass(body.inertia)))
    return rows


def _wrap(text: str, indent: str = "  ") -> list[str]:
    return wrap(text, width=INFO_WIDTH, subsequent_indent=indent)


def _loops(found: "RobotDescription") -> list[str]:
    """The cut joints of loops, and the joints that follow where they are closed."""
    cuts = [f"{shorten(loop.a.name)} - {shorten(loop.b.name)} ({loop.joint})" for loop in found.mechanism.loops]
    following = [f"following joints: {', '.join(map(shorten, found.following))}"] if found.following else []
    loops = [f"loops, {'closed' if following else 'open'}: {', '.join(cuts)}"] if cuts else []
    by = {mover: [shorten(x) for x, own in found.moved_by.items() if own == mover] for mover in ("spring", "nothing")}
    passive = [f"passive, moved by {mover}: {', '.join(names)}" for mover, names in by.items() if names]
    wrapped = [line for text in loops + following + passive for line in _wrap(text)]
    return ["", *wrapped] if wrapped else []


def _mass(body: "InertiaDescription") -> tuple[str, str]:
    """The mass and COM of a body as cells of a table."""
    return f"{body.mass:.5g}", "-" if body.com is None else _vector(body.com, "z.3f")


def _moments(found: "RobotDescription") -> list[str]:
    """A table of principal moments and of what is left until they break the triangle inequality."""
    bodies = [(str(found.mechanism.base_body), found.base)] if found.base else []
    bodies += [(body.name, body.inertia) for body in found.bodies]
    rows = [
        (name, *(f"{x:.4g}" for x in of.principal_moments), f"{of.triangle_slack:.3g}")
        for name, of in bodies
        if of.principal_moments is not None
    ]
    return ["", *align_columns([("body", "principal moments", "about COM", "kg m^2", "triangle slack"), *rows])]


def _findings(found: "RobotDescription") -> list[str]:
    lines = [""]
    for finding in found.findings:
        for text, indent in ((f"{finding.severity}: {finding}", ""), (finding.advice, "  ")):
            lines += wrap(text, INFO_WIDTH, initial_indent=indent, subsequent_indent="  ", break_long_words=False)
    return lines if found.findings else ["", "no findings"]


def _vector(x: list[float], form: str) -> str:
    return " ".join(f"{v:{form}}" for v in x)


def _drive(variable: "VariableDescription") -> tuple[str, ...]:
    """The drive train of a joint as cells of a table; "-" for terms that it lacks."""
    unit, force, inertia = UNITS[variable.unit == "m"]
    d = variable.drive or {}
    cells = (
        (d["armature"], f"{d['armature']:.5g} {inertia}"),
        (d["damping"], f"{d['damping']:.5g} {force} s/{unit}"),
        (d["friction"], f"{d['friction']:.5g} {force} over {d['eps']:.5g} {unit}/s"),
        (d["stribeck"], f"{d['stribeck']:.5g} {force} to {d['stribeck_velocity']:.5g} {unit}/s"),
        (d["stiffness"], f"{d['stiffness']:.5g} {force}/{unit} from {d['rest']:.5g} {unit}"),
        (d["offset"], f"{d['offset']:.5g} {force}"),
        (d["load_friction"], f"{d['load_friction']:.5g} over {d['load_eps']:.5g} {force}"),
    )
    return (variable.joint, *(text if stated else "-" for stated, text in cells))


def _elastic(found: "RobotDescription") -> list[str]:
    """A table of the springs and motors of elastic joints."""
    if found.elastic is None:
        return []
    rows: list[tuple[str, ...]] = [("elastic", "stiffness", "rotor", "viscous", "friction")]
    for name, of in found.coordinate_units.items():
        e = found.elastic[name]
        unit, force, inertia = UNITS[of == "m"]
        rows.append((
            name,
            "rigid" if e["stiffness"] is None else f"{e['stiffness']:.5g} {force}/{unit}",
            f"{e['rotor']:.5g} {inertia}",
            f"{e['viscous']:.5g} {force} s/{unit}" if e["viscous"] else "-",
            f"{e['friction']:.5g} {force} over {e['eps']:.5g} {unit}/s" if e["friction"] else "-",
        ))  # fmt: skip
    return ["", *align_columns(rows)]


def _limits(found: "RobotDescription") -> list[str]:
    """A table of the limits that are stated of any joint; "-" for those that are not stated of one."""
    from jounce.checks.description import limit_in_words
    from jounce.model.limits import LIMIT_KINDS

    variables = [x for body in found.bodies for x in body.variables]
    rows = {x.joint: {kind: limit_in_words(x, kind) for kind in LIMIT_KINDS} for x in variables}
    shown = [kind for kind in LIMIT_KINDS if kind in COMMON or any(row[kind] != "-" for row in rows.values())]
    limited = [(joint, *(row[kind] for kind in shown)) for joint, row in rows.items() if set(row.values()) != {"-"}]
    heads = ("limits", *(kind.replace("_", " ") for kind in shown))
    return ["", *align_columns([heads, *limited])] if limited else []
