"""`jounce robots`, `info`, `compare` and `convert`: what a robot's data say, without a motion.

`robots` lists the bundled robots and the sources of their data. `info` shows the bodies, joints, limits and masses of a
robot, and an audit of them. `compare` compares its results with other libraries, other methods, and differentiation.
`convert` writes it in jounce's own format, from any file that jounce reads.
"""

from collections import Counter
from pathlib import Path
from textwrap import wrap
from typing import TYPE_CHECKING

import click

from jounce.cli.output import SafeLine, align_columns, check_distinct, print_result
from jounce.cli.robot_options import PATH, ROBOT_NAME, RobotRequest, add_robot_options, add_robot_options_without_drives
from jounce.core.errors import shorten, unknown_name_error

if TYPE_CHECKING:
    from jounce.checks.description import InertiaDescription, RobotDescription, VariableDescription
    from jounce.core.typing import JsonObject


ROBOTS_EPILOG = """\b
Example:
  jounce robots
  jounce robots panda
  jounce info panda
"""


@click.command(epilog=ROBOTS_EPILOG, short_help="List the bundled robots.")
@click.argument("robot", type=ROBOT_NAME, required=False)
@click.option("--json", "as_json", is_flag=True, help="Print everything as JSON.")
def robots(robot: Path | None, as_json: bool) -> None:
    """List the bundled robots by the names that all commands accept, or show the full licence of ROBOT."""
    from jounce.io.bundled import BUNDLED, read_notices

    if robot is None:
        shown, notices = list(BUNDLED.values()), {}
    else:
        name = str(robot)
        if name not in BUNDLED:
            raise unknown_name_error("bundled robot", name, BUNDLED)
        shown, notices = [BUNDLED[name]], read_notices(name)

    def lines() -> list[str]:
        head = ("robot", "joints", "bodies", "mass kg", "what", "licence", "source")
        rows = [(r.name, str(r.n), str(r.nb), f"{r.mass:.5g}", r.kind, r.licence, r.source) for r in shown]
        texts = "\n\n".join(["", *notices.values()]).rstrip().splitlines()
        return [*align_columns([head, *rows]), *map(SafeLine, texts[1:])]

    data = [{key: value for key, value in vars(one).items() if key != "build"} for one in shown]
    print_result(lines, lambda: data if robot is None else data[0] | {"notices": notices}, as_json)


INFO_WIDTH = 100  # characters of a line: names of robots in one line, on usual terminals
COMMON = ("position", "velocity", "effort")  # limits that most robots have
UNITS = (("rad", "N m", "kg m^2"), ("m", "N", "kg"))  # of a position, force and inertia, of joints in rad and in m
INFO_EPILOG = """\b
Example:
  jounce info iiwa14
  jounce info planar2r --strict --json
  jounce info iiwa14 --lock joint3=0 --gravity 0 0 -1.62
"""


@click.command(epilog=INFO_EPILOG, short_help="Show bodies, joints and masses of a robot, and audit its data.")
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
    print_result(lambda: _info_lines(found), found.json, as_json)
    if strict and any(finding.severity != "note" for finding in found.findings):
        raise SystemExit(1)


def _info_lines(found: "RobotDescription") -> list[str]:
    from jounce.model import positions
    from jounce.model.drive_trains import AMOUNTS

    m, numbers_of_q = found.mechanism, positions.names(found.mechanism)
    gravity = " ".join(f"{x:g}" for x in m.gravity)
    numbers = f" ({len(numbers_of_q)} numbers)" if len(numbers_of_q) > m.n else ""
    count = len(m.moving_bodies) + bool(found.base)
    size = f"{m.n} coordinates{numbers}, {count} bodies, {found.mass:.6g} kg moving"
    head = f"{shorten(m.name)}: {size}{', floating' if found.base else ''}, gravity {gravity} m/s^2"
    order = _wrap(f"q: {', '.join(map(shorten, numbers_of_q))}", indent="   ")
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


COMPARE_EPILOG = """\b
Example:
  jounce compare iiwa14

\b
All comparisons are at random states. Forces, gravity forces and the mass
matrix are compared with Pinocchio and MuJoCo if they are installed; each
reads the robot file itself if it can, and otherwise gets jounce's data. Rates
are compared with those of the other methods and with nine-point differences
at the best step. Drive terms are left out. The exit code is 1 if an error
exceeds its tolerance for rounding or differentiation.
"""


@click.command(epilog=COMPARE_EPILOG, short_help="Check a robot against other libraries and methods.")
@add_robot_options_without_drives
@click.option("--order", default=2, type=click.IntRange(0, 6), help="Highest time derivative of Q.")
@click.option("--states", default=20, type=click.IntRange(1, 10_000), help="How many.")
@click.option("--seed", default=0, type=click.IntRange(0), help="Seed of the random states.")
@click.option("--json", "as_json", is_flag=True, help="Print everything as JSON.")
@click.pass_context
def compare(ctx: click.Context, robot: RobotRequest, order: int, states: int, seed: int, as_json: bool) -> None:
    """Compare the results for ROBOT, a file or the name of a bundled robot, with other libraries and methods."""
    from jounce.checks.compare import compare as checks_of

    arm, path = robot.load(), robot.path
    checks = checks_of(arm, path if path.is_file() else None, order=order, states=states, seed=seed)
    failed = [check for check in checks if not check.passed]

    def data() -> "JsonObject":
        rows = [vars(check) | {"passed": check.passed} for check in checks]
        return {"robot": arm.name, "states": states, "order": order, "passed": not failed, "checks": rows}

    def lines() -> list[str]:
        rows: list[tuple[str, ...]] = [("", "against", "worst error", "allowed", "")]
        for check in checks:
            error, allowed, verdict = "-", "-", check.remark
            if check.error is not None:
                error, allowed = f"{check.error:.1e}", f"{check.allowed:.0e}"
                verdict = verdict if check.passed else f"TOO LARGE {verdict}"
            rows.append((check.quantity, check.against, error, allowed, verdict))
        end = f"{len(failed)} of {len(checks)} errors are too large" if failed else "all agree"
        return [f"{shorten(arm.name)} at {states} random states: {end}", "", *align_columns(rows)]

    print_result(lines, data, as_json)
    ctx.exit(1 if failed else 0)


CONVERT_EPILOG = """\b
Example:
  jounce convert iiwa14 -o arm.yaml
  jounce convert g1 --base floating -o humanoid.yaml

\b
OUT contains names, tree, screws, inertias, limits, drives, frames and
gravity in SI units, without loss: reading it gives the same numbers to the
last bit. It does not record which drive terms act: select them with --drives
when you use it.
"""


@click.command(epilog=CONVERT_EPILOG, short_help="Convert a robot to a YAML or JSON file.")
@add_robot_options_without_drives
@click.option("-o", "--output", required=True, type=PATH, help="File to write: .yaml, .yml or .json.")
@click.option("--json", "as_json", is_flag=True, help="Print the summary as JSON.")
def convert(robot: RobotRequest, output: Path, as_json: bool) -> None:
    """Write ROBOT, a file or the name of a bundled robot, as a YAML or JSON file that can be edited."""
    from jounce.model import positions
    from jounce.robot.saving import check_writable, save

    check_writable(output)
    check_distinct(output, robot.path)
    arm = robot.load()
    save(arm, output)
    m = arm.mechanism
    kinds = Counter(x.group.name for x in positions.multiscrew_joints(m.tree).values())  # of joints of several screws

    def data() -> "JsonObject":
        return {
            "robot": arm.name, "source": str(robot.path), "output": str(output), "n": m.n, "nq": arm.nq, "nv": arm.nv,
            "joints": dict(kinds), "nb": len(m.moving_bodies),  # without the base
            "base": m.base_body, "frames": len(m.frames),
        }  # fmt: skip

    def lines() -> list[str]:
        floats = f"floating on {shorten(m.base_body)}, " if m.base_body else ""
        bodies = len(m.moving_bodies) + bool(m.base_body)  # as `jounce info` counts them
        several = "".join(f", {count} {kind} joint{'s' * (count > 1)}" for kind, count in kinds.items())
        numbers = f" ({arm.nq} numbers)" if several else ""
        size = f"{floats}{m.n} coordinates{numbers}, {bodies} bodies{several}, {len(m.frames)} merged links"
        return [f"{shorten(arm.name)}: {size} written to {output}"]

    print_result(lines, data, as_json)
