"""`jounce robots`, `info`, `compare` and `convert`: the data of robots, without a motion.

`robots` lists the bundled robots and the sources of their data. `info` shows the bodies, joints, limits and masses of a
robot, and an audit of them. `compare` compares its results with other libraries, other methods, and differentiation.
`convert` writes a robot in jounce's own format, from any file that jounce reads.
"""

from collections import Counter
from pathlib import Path
from textwrap import wrap
from typing import TYPE_CHECKING

import click

from jounce.cli.commands import Command
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


@click.command(cls=Command, epilog=ROBOTS_EPILOG, short_help="List the bundled robots.")
@click.argument("robot", type=ROBOT_NAME, required=False)
@click.option("--json", "as_json", is_flag=True, help="Print everything as JSON.")
def robots(robot: Path | None, as_json: bool) -> None:
    """List the bundled robots by the names that all commands accept.

    With ROBOT, show one robot with its full licence.
    """
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
        rows = [
            (row.name, str(row.n), str(row.nb), f"{row.mass:.5g}", row.kind, row.licence, row.source) for row in shown
        ]
        texts = "\n\n".join(["", *notices.values()]).rstrip().splitlines()
        return [*align_columns([head, *rows]), *map(SafeLine, texts[1:])]

    data = [{key: value for key, value in vars(robot_data).items() if key != "build"} for robot_data in shown]
    print_result(lines, lambda: data if robot is None else data[0] | {"notices": notices}, as_json)


INFO_WIDTH = 100  # characters of a line
COMMON = ("position", "velocity", "effort")  # limits that most robots have
UNITS = (("rad", "N m", "kg m^2"), ("m", "N", "kg"))  # of a position, force and inertia, of joints in rad and in m
INFO_EPILOG = """\b
Example:
  jounce info iiwa14
  jounce info planar2r --strict --json
  jounce info iiwa14 --lock joint3=0 --gravity 0 0 -1.62
"""


@click.command(
    cls=Command, epilog=INFO_EPILOG, short_help="Show bodies, joints and masses of a robot, and audit its data."
)
@add_robot_options
@click.option("--strict", is_flag=True, help="Exit with code 1 if the audit finds errors or warnings.")
@click.option("--json", "as_json", is_flag=True, help="Print everything as JSON.")
def info(robot: RobotRequest, strict: bool, as_json: bool) -> None:
    """Show the bodies, joints, limits and masses of ROBOT.

    ROBOT is a file or the name of a bundled robot. A data audit follows: errors (physically impossible data, or a
    singular mass matrix), warnings (possible, but probably a mistake) and notes.
    """
    from jounce.checks.description import describe

    description = describe(robot.load().mechanism)
    print_result(lambda: _info_lines(description), description.json, as_json)
    if strict and any(finding.severity != "note" for finding in description.findings):
        raise SystemExit(1)


def _info_lines(description: "RobotDescription") -> list[str]:
    """Return the lines of `jounce info`: a head, tables of the data, and the findings of the audit."""
    from jounce.model import positions
    from jounce.model.drive_trains import AMOUNTS

    mechanism, numbers_of_q = description.mechanism, positions.names(description.mechanism)
    # One line on the whole robot, and one with the names of all numbers of q.
    gravity = " ".join(f"{x:g}" for x in mechanism.gravity)
    numbers = f" ({len(numbers_of_q)} numbers)" if len(numbers_of_q) > mechanism.n else ""
    count = len(mechanism.moving_bodies) + bool(description.base)
    size = f"{mechanism.n} coordinates{numbers}, {count} bodies, {description.mass:.6g} kg moving"
    floating = ", floating" if description.base is not None else ""
    head = f"{shorten(mechanism.name)}: {size}{floating}, gravity {gravity} m/s^2"
    order = _wrap(f"q: {', '.join(map(shorten, numbers_of_q))}", indent="   ")
    lines = [head, *order, "", *align_columns(_body_rows(description)), *_limits(description)]
    # Each further part stands only where the robot has such data: drives, springs, followers, loops, contacts, links.
    variables = [variable for body in description.bodies for variable in body.variables]
    driven = [x for x in variables if x.drive is not None and any(map(x.drive.get, AMOUNTS.values()))]
    if len(driven) > 0:
        acting = f"in Q: {', '.join(mechanism.acting) or 'none of these'}"
        lines += ["", *align_columns([("drive", *AMOUNTS), *map(_drive, driven)]), acting]
    lines += _elastic(description)
    joints = [body.joint for body in description.bodies]
    follows = [f"{shorten(joint.joint)} = {joint.follows}" for joint in joints if joint.follows is not None]
    if len(follows) > 0:
        lines += ["", *follows]
    lines += _loops(description)
    standing = [f"{shorten(contact.frame)} ({contact.kind})" for contact in mechanism.contacts]
    if len(standing) > 0:
        lines += ["", *_wrap(f"contacts: {', '.join(standing)}")]
    merged = [f"{shorten(link)} ({shorten(body)})" for link, body in description.merged_links.items()]
    if len(merged) > 0:
        lines += ["", *_wrap(f"merged links: {', '.join(merged)}")]
    return [*lines, *_moments(description), *_findings(description)]


def _body_rows(description: "RobotDescription") -> list[tuple[str, ...]]:
    """Return the rows of the table of bodies and joints."""
    rows: list[tuple[str, ...]] = [("joint", "type", "axis", "body", "on", "mass kg", "COM m")]
    if description.base:
        rows.append(("-", "floating", "-", str(description.mechanism.base_body), "-", *_mass(description.base)))
    for body in description.bodies:
        joint = body.joint
        kind = joint.type if joint.pitch is None else f"{joint.type} {joint.pitch:g} m/rad"
        # A joint of several screws has no single axis.
        axis = _vector(joint.axis, ".4g") if joint.axis is not None else f"{body.nq} in q, {body.nv} velocities"
        rows.append((joint.joint, kind, axis, body.name, body.parent, *_mass(body.inertia)))
    return rows


def _wrap(text: str, indent: str = "  ") -> list[str]:
    return wrap(text, width=INFO_WIDTH, subsequent_indent=indent)


def _loops(description: "RobotDescription") -> list[str]:
    """Describe the cut joints of loops, and what moves the other joints."""
    cuts = [f"{shorten(loop.a.name)} - {shorten(loop.b.name)} ({loop.joint})" for loop in description.mechanism.loops]
    # Those that follow by ratios or polynomials are stated with these.
    stated = {body.joint.joint for body in description.bodies if body.joint.follows is not None}
    following = [shorten(joint) for joint in description.following if joint not in stated]
    sentences = []
    if len(cuts) > 0:
        # Joints follow others only once the loops are closed.
        state = "closed" if len(following) > 0 else "open"
        sentences.append(f"loops, {state}: {', '.join(cuts)}")
    if len(following) > 0:
        sentences.append(f"following joints: {', '.join(following)}")
    for mover in ("spring", "nothing"):
        names = [shorten(joint) for joint, joint_mover in description.moved_by.items() if joint_mover == mover]
        if len(names) > 0:
            sentences.append(f"passive, moved by {mover}: {', '.join(names)}")
    lines = [line for sentence in sentences for line in _wrap(sentence)]
    return ["", *lines] if len(lines) > 0 else []


def _mass(body: "InertiaDescription") -> tuple[str, str]:
    """Return the mass and COM of a body as cells."""
    return f"{body.mass:.5g}", "-" if body.com is None else _vector(body.com, "z.3f")


def _moments(description: "RobotDescription") -> list[str]:
    """Return a table of principal moments of bodies.

    Its last column is by how much a body keeps the triangle inequality.
    """
    bodies = [(str(description.mechanism.base_body), description.base)] if description.base else []
    bodies += [(body.name, body.inertia) for body in description.bodies]
    rows = [
        (name, *(f"{x:.4g}" for x in body_inertia.principal_moments), f"{body_inertia.triangle_slack:.3g}")
        for name, body_inertia in bodies
        if body_inertia.principal_moments is not None
    ]
    title = "Principal moments of inertia about the centre of mass, kg m^2; a real body has I1 + I2 >= I3:"
    return ["", title, *align_columns([("body", "I1", "I2", "I3", "I1 + I2 - I3"), *rows])]


def _findings(description: "RobotDescription") -> list[str]:
    lines = [""]
    for finding in description.findings:
        for text, indent in ((f"{finding.severity}: {finding}", ""), (finding.advice, "  ")):
            lines += wrap(text, INFO_WIDTH, initial_indent=indent, subsequent_indent="  ", break_long_words=False)
    return lines if description.findings else ["", "no findings"]


def _vector(x: list[float], form: str) -> str:
    return " ".join(f"{v:{form}}" for v in x)


def _drive(variable: "VariableDescription") -> tuple[str, ...]:
    """Return the drive train of a joint as cells; "-" for missing terms."""
    # Each cell stands with the number that decides whether the term is there: 0 means absent.
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
    return (variable.joint, *(text if value else "-" for value, text in cells))


def _elastic(description: "RobotDescription") -> list[str]:
    """Return a table of the springs and motors of elastic joints."""
    if description.elastic is None:
        return []
    rows: list[tuple[str, ...]] = [("elastic", "stiffness", "rotor", "viscous", "friction")]
    for name, unit_of_q in description.coordinate_units.items():
        data = description.elastic[name]
        unit, force, inertia = UNITS[unit_of_q == "m"]
        rows.append((
            name,
            "rigid" if data["stiffness"] is None else f"{data['stiffness']:.5g} {force}/{unit}",
            f"{data['rotor']:.5g} {inertia}",
            f"{data['viscous']:.5g} {force} s/{unit}" if data["viscous"] else "-",
            f"{data['friction']:.5g} {force} over {data['eps']:.5g} {unit}/s" if data["friction"] else "-",
        ))  # fmt: skip
    return ["", *align_columns(rows)]


def _limits(description: "RobotDescription") -> list[str]:
    """Return a table of the limits of joints.

    It has the kinds that any joint has, and "-" where a joint has none of a kind. Those of the whole robot follow it.
    """
    from jounce.checks.description import limit_in_words, totals_in_words
    from jounce.model.limits import LIMIT_KINDS

    variables = [x for body in description.bodies for x in body.variables]
    kinds = LIMIT_KINDS.of_joints
    rows = {x.joint: {kind: limit_in_words(x, kind) for kind in kinds} for x in variables}
    shown = [kind for kind in kinds if kind in COMMON or any(row[kind] != "-" for row in rows.values())]
    limited = [(joint, *(row[kind] for kind in shown)) for joint, row in rows.items() if set(row.values()) != {"-"}]
    heads = ("limits", *(kind.replace("_", " ") for kind in shown))
    of_joints = ["", *align_columns([heads, *limited])] if limited else []
    totals = totals_in_words(description.mechanism.limits)
    return [*of_joints, "", *totals] if totals else of_joints


COMPARE_EPILOG = """\b
Example:
  jounce compare iiwa14

\b
All comparisons are at random states. Forces, gravity forces and the mass
matrix are compared with Pinocchio and MuJoCo if they are installed. Each
library reads the robot file itself if it can, and otherwise gets jounce's
data. Rates are compared with the other methods and with nine-point
differences at the best step. Drive terms are left out. The exit code is 1 if
an error exceeds its tolerance for rounding or differentiation.
"""


@click.command(cls=Command, epilog=COMPARE_EPILOG, short_help="Check a robot against other libraries and methods.")
@add_robot_options_without_drives
@click.option("--order", default=2, type=click.IntRange(0, 6), help="Highest time derivative of Q.")
@click.option("--states", default=20, type=click.IntRange(1, 10_000), help="Number of random states.")
@click.option("--seed", default=0, type=click.IntRange(0), help="Seed of the random states.")
@click.option("--json", "as_json", is_flag=True, help="Print everything as JSON.")
@click.pass_context
def compare(ctx: click.Context, robot: RobotRequest, order: int, states: int, seed: int, as_json: bool) -> None:
    """Compare the results for ROBOT with other libraries and methods.

    ROBOT is a file or the name of a bundled robot.
    """
    from jounce.checks.compare import compare as checks_of

    arm, path = robot.load(), robot.path
    checks = checks_of(arm, path if path.is_file() else None, order=order, states=states, seed=seed)
    # Comparisons that are not possible pass, with a remark.
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
last bit. The drive terms in Q are not saved: select them with --drives when
you use the file.
"""


@click.command(cls=Command, epilog=CONVERT_EPILOG, short_help="Convert a robot to a YAML or JSON file.")
@add_robot_options_without_drives
@click.option("-o", "--output", required=True, type=PATH, help="File to write: .yaml, .yml or .json.")
@click.option("--json", "as_json", is_flag=True, help="Print the summary as JSON.")
def convert(robot: RobotRequest, output: Path, as_json: bool) -> None:
    """Write ROBOT as a YAML or JSON file that can be edited.

    ROBOT is a file or the name of a bundled robot.
    """
    from jounce.model import positions
    from jounce.robot.saving import check_writable, save

    check_writable(output)
    check_distinct(output, robot.path)
    arm = robot.load()
    save(arm, output)
    m = arm.mechanism
    # Joints of several screws are counted by their kinds.
    kinds = Counter(joint.group.name for joint in positions.multiscrew_joints(m.tree).values())

    def data() -> "JsonObject":
        return {
            "robot": arm.name, "source": str(robot.path), "output": str(output), "n": m.n, "nq": arm.nq, "nv": arm.nv,
            "joints": dict(kinds), "nb": len(m.moving_bodies),  # without the base
            "base": m.base_body, "frames": len(m.frames),
        }  # fmt: skip

    def lines() -> list[str]:
        base_words = f"floating on {shorten(m.base_body)}, " if m.base_body else ""
        # A floating base counts as a body, as in `jounce info`.
        bodies = len(m.moving_bodies) + bool(m.base_body)
        nouns = {kind: f"{kind} joint" if count == 1 else f"{kind} joints" for kind, count in kinds.items()}
        kind_counts = "".join(f", {count} {nouns[kind]}" for kind, count in kinds.items())
        numbers = f" ({arm.nq} numbers)" if len(kinds) > 0 else ""
        size = f"{base_words}{m.n} coordinates{numbers}, {bodies} bodies{kind_counts}, {len(m.frames)} merged links"
        return [f"{shorten(arm.name)}: {size} written to {output}"]

    print_result(lines, data, as_json)
