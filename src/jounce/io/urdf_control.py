"""What a URDF states for its controllers: transmissions, and limits of ros2_control.

A transmission says how the positions phi of motors follow those of joints, by reductions a of its actuators, j and
offsets d of its joints. As transmission_interface of ROS 1 and ROS 2 defines them (classes `DifferentialTransmission`
and `FourBarLinkageTransmission`), with the roles actuator1, actuator2, joint1 and joint2,

    phi = A (q - d)    differential  A = [[a1 j1, a1 j2], [a2 j1, -a2 j2]]
                       four-bar      A = [[a1 j1, 0], [a2, a2 j2]]

`couple_drives` collects the rows of all of them, for one coupled drive of the robot. Torques follow from A by virtual
work. That of the four-bar in ROS, ``Q2 = j2 (a2 tau2 - a1 j1 tau1)``, is another one: it has not the power of the
motors, and is not used here.

A motor that moves one joint alone sits at it, by whatever reduction: a simple transmission is no part of the equations.
Thousands of files hold transmissions of types that only their authors know: these are never refused. Where they may
matter, one warning names them.

`tighten_limits` joins the limits that command interfaces of ros2_control state to those of <limit>, as ros2_control
does: of two bounds the tighter one counts.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from lxml import etree

from jounce.core.cures import WITHOUT_TRANSMISSIONS, Remedy
from jounce.core.errors import JounceError, join_names, locate_errors, quote_value, shorten, unknown_name_error, warn
from jounce.core.foreign import parse_finite
from jounce.model import tree
from jounce.model.limits import LIMIT_KINDS, POSITION_ENDS, StatedLimit
from jounce.model.mechanism import Mechanism

INTERFACE = "transmission_interface"  # the package whose types are known
SIMPLE = f"{INTERFACE}/SimpleTransmission"
COUPLED = {
    f"{INTERFACE}/DifferentialTransmission": "differential",
    f"{INTERFACE}/FourBarLinkageTransmission": "four-bar",
}
REDUCTION_TAGS = ("mechanicalReduction", "mechanical_reduction")  # of ROS 1 and of ROS 2
LIMITED_INTERFACES = ("position", "velocity", "acceleration", "effort", "jerk")  # whose bounds ros2_control reads
BOUND_NAMES = ("min", "max")
INFINITE = {"min": ("-inf", "-infinity"), "max": ("inf", "+inf", "infinity", "+infinity")}  # no bound, in words
TRUTH = {"true": True, "1": True, "false": False, "0": False}


@dataclass(frozen=True)
class End:
    """A joint or an actuator of a transmission."""

    name: str
    reduction: float
    offset: float
    place: str


@dataclass(frozen=True, eq=False)
class Coupling:
    """A transmission that moves two joints together: ``phi = A (q - d)``."""

    name: str
    place: str
    motors: tuple[str, ...]
    joints: tuple[str, ...]
    A: np.ndarray  # (2, 2)
    d: np.ndarray  # (2,)

    def repeats(self, other: "Coupling") -> bool:
        """Return whether another one states the same."""
        has_same_names = self.motors == other.motors and self.joints == other.joints
        return has_same_names and np.array_equal(self.A, other.A) and np.array_equal(self.d, other.d)


def couple_drives(m: Mechanism, joints: Sequence[tree.Joint], robot: etree._Element, file: str) -> Mechanism:
    """Return the robot of a URDF with the motors of its transmissions.

    `joints` are all joints of the file, some of which the robot may lack. Warns once of transmissions that are left
    out. Raises `JounceError` at the line of a transmission whose motors would be guessed.
    """
    joints_by_name = {joint.name: joint for joint in joints}
    couplings, left_out = list[Coupling](), list[str]()
    types_left_out: Counter[str] = Counter()
    others = list[etree._Element]()
    for element in (*robot.iterchildren("transmission"), *robot.iterfind("ros2_control/transmission")):
        kind = _transmission_type(element)
        if kind not in COUPLED:
            others.append(element)
            continue
        coupling = _read_coupling(element, COUPLED[kind], joints_by_name, file)
        reasons = list(filter(None, (_why_unserved(joints_by_name[name], m) for name in coupling.joints)))
        if len(reasons) == 0:
            couplings.append(coupling)
        # Of what root= leaves out nothing is said.
        elif any(name in m.joints for name in coupling.joints):
            left_out.append(f"{quote_value(coupling.name)}, {reasons[0]}")
    couplings = _drop_repeated(couplings)
    # What moves one joint alone has no effect; anything else may have one.
    for element in others:
        reason = _why_odd(element, joints_by_name, couplings)
        if reason is not None:
            left_out.append(f"{quote_value(element.get('name', ''))}, {reason}")
        elif not _is_of_one_joint(element) and _may_move(element, joints_by_name, m):
            types_left_out[_transmission_type(element).rpartition("/")[2] or "unknown"] += 1
    # Coupled drives are those of a tree of joints of one screw.
    if len(couplings) > 0 and (m.closure is not None or len(set(m.owners)) < len(m.owners)):
        why = "joints of several screws" if m.closure is None else "closed loops"
        left_out += [f"{quote_value(x.name)}, as the robot has {why}" for x in couplings]
        couplings = []
    counts = [f"{count} of type {shorten(kind)}" for kind, count in types_left_out.items()]
    if len(counts) + len(left_out) > 0:
        words = "; ".join([*_first_few(counts), *_first_few(left_out)])
        cure = Remedy(f"; robot.with_transmission() states others, after load(..., {WITHOUT_TRANSMISSIONS})")
        warn(f"{file}: transmissions are left out, as if each joint had its own motor: {words}{cure}")
    return m if len(couplings) == 0 else _with_couplings(m, couplings, joints_by_name, file)


def _with_couplings(
    m: Mechanism, couplings: Sequence[Coupling], joints_by_name: Mapping[str, tree.Joint], file: str
) -> Mechanism:
    """Return the robot with the motors of all couplings.

    They are rows of one block matrix.
    """
    from jounce.arguments.transmissions import with_transmission  # imported here to keep start-up fast

    # Actuators are often named after the joints that they move first; motors need names of their own.
    motors = [f"{name}_motor" if name in joints_by_name else name for x in couplings for name in x.motors]
    moved_joints = [name for x in couplings for name in x.joints]
    A, offset = np.zeros((len(motors), len(moved_joints))), np.zeros(len(motors))
    for k, x in enumerate(couplings):
        rows = slice(2 * k, 2 * k + 2)
        A[rows, rows], offset[rows] = x.A, -x.A @ x.d
    places = join_names((x.place.removeprefix(f"{file}:") for x in couplings), most=4)
    with locate_errors(f"{file}: transmissions at line {places}"):
        return with_transmission(m, A, motors, moved_joints, offset + 0.0)


def _transmission_type(element: etree._Element) -> str:
    """Return the type of a transmission, of ROS 1, ROS 2 or the PR2."""
    text = element.findtext("type") or element.findtext("plugin") or element.get("type") or ""
    return str(text).strip()


def _read_coupling(element: etree._Element, kind: str, joints_by_name: Mapping[str, tree.Joint], file: str) -> Coupling:
    """Return a transmission of two motors and two joints."""
    name = element.get("name", "")
    # ROS 1 takes the reduction of an actuator from the file alone, ROS 2 takes 1 where the file states none.
    is_of_ros1 = element.find("type") is not None
    actuators = _read_ends(element, "actuator", None if is_of_ros1 else 1.0, file)
    joints = _read_ends(element, "joint", 1.0, file)
    for joint in joints:
        if joint.name not in joints_by_name:
            error = unknown_name_error("joint", joint.name, joints_by_name)
            raise JounceError(f"{joint.place}: transmission {quote_value(name)}: {error}")
    for actuator in actuators:
        if actuator.offset != 0:
            raise JounceError(
                f"{actuator.place}: actuator {quote_value(actuator.name)} of transmission {quote_value(name)} states an"
                f" offset, which no definition of it has; state it of the joints, in their positions"
            )
    a1, a2 = (end.reduction for end in actuators)
    j1, j2 = (end.reduction for end in joints)
    matrices = {
        "differential": [[a1 * j1, a1 * j2], [a2 * j1, -a2 * j2]],
        "four-bar": [[a1 * j1, 0.0], [a2, a2 * j2]],
    }
    return Coupling(
        name=name,
        place=_line(element, file),
        motors=tuple(end.name for end in actuators),
        joints=tuple(end.name for end in joints),
        A=np.array(matrices[kind]),
        d=np.array([end.offset for end in joints]),
    )


def _read_ends(element: etree._Element, tag: str, default: float | None, file: str) -> list[End]:
    """Return the joints or actuators of a coupling, by their roles.

    The order of the file has no meaning. `default` is the reduction where the file states none; None refuses it.
    """
    transmission, parts = f"transmission {quote_value(element.get('name', ''))}", element.findall(tag)
    roles, ends = [f"{tag}1", f"{tag}2"], dict[str, End]()
    expected_roles = f"expected the roles {roles[0]} and {roles[1]}, each once"
    if len(parts) != len(roles):
        raise JounceError(f"{_line(element, file)}: {transmission} has {len(parts)} <{tag}>; {expected_roles}")
    for part in parts:
        place, name = _line(part, file), part.get("name")
        if not name:
            raise JounceError(f"{place}: a <{tag}> of {transmission} has no name=; expected a text")
        # It is an attribute or a child; two that differ are no role.
        stated_roles = [part.get("role") or "", *(child.text or "" for child in part.iterfind("role"))]
        role = " and ".join(dict.fromkeys(filter(None, map(str.strip, stated_roles))))
        what = f"{tag} {quote_value(name)} of {transmission}"
        if role not in roles:
            came = f"the role {quote_value(role)}" if role else "no role"
            raise JounceError(f"{place}: {what} has {came}; {expected_roles}")
        if role in ends:
            raise JounceError(
                f"{place}: {what} has the role {role}, as {quote_value(ends[role].name)}; {expected_roles}"
            )
        if name in (end.name for end in ends.values()):
            raise JounceError(f"{place}: {transmission} names {tag} {quote_value(name)} twice; expected two {tag}s")
        reduction = _read_child(part, REDUCTION_TAGS, default, what, file)
        if reduction == 0:
            raise JounceError(f"{place}: the reduction of {what} is 0; expected any other number")
        ends[role] = End(name, reduction, _read_child(part, ("offset",), 0.0, what, file), place)
    return [ends[role] for role in roles]


def _read_child(part: etree._Element, tags: Sequence[str], default: float | None, what: str, file: str) -> float:
    """Return the number that a child of one of the tags holds."""
    children = [child for child in part.iterchildren() if child.tag in tags]
    if len(children) > 1:
        raise JounceError(f"{_line(children[1], file)}: {what} states <{children[1].tag}> twice; expected one number")
    if len(children) == 0:
        if default is None:
            raise JounceError(f"{_line(part, file)}: {what} has no <{tags[0]}>; expected a number other than 0")
        return default
    return _read_number(children[0], f"<{children[0].tag}> of {what}", file)


def _read_number(element: etree._Element, what: str, file: str) -> float:
    """Return the finite number that an element holds."""
    text = (element.text or "").strip()
    number = parse_finite(text)
    if number is None:
        raise JounceError(f"{_line(element, file)}: {what} is {quote_value(text)}; expected a finite number")
    return number


def _why_unserved(joint: tree.Joint, m: Mechanism) -> str | None:
    """Return why no coupled drive moves a joint, or None."""
    name = quote_value(joint.name)
    if joint.mimic is not None:
        return f"whose joint {name} mimics another one"
    if joint.X is None or joint.free is not None:
        return f"whose joint {name} is {joint.free or 'fixed'}"
    return None if joint.name in m.coordinates else f"whose joint {name} is excluded by {tree.ROOT}"


def _drop_repeated(couplings: Sequence[Coupling]) -> list[Coupling]:
    """Return the couplings; one that is stated in both forms stands once.

    Raises `JounceError` if two move one joint, or have motors of one name.
    """
    kept = list[Coupling]()
    for coupling in couplings:
        if any(coupling.repeats(other) for other in kept):
            continue
        for other in kept:
            for kind, names, other_names in (
                ("move joint", coupling.joints, other.joints),
                ("have an actuator", coupling.motors, other.motors),
            ):
                common_names = [name for name in names if name in other_names]
                if len(common_names) > 0:
                    both = f"transmissions {quote_value(coupling.name)} and {quote_value(other.name)}"
                    raise JounceError(
                        f"{coupling.place}: {both} both {kind} {quote_value(common_names[0])}; the other one is at"
                        f" {other.place}; expected one of them, or other names"
                    )
        kept.append(coupling)
    return kept


def _why_odd(
    element: etree._Element, joints_by_name: Mapping[str, tree.Joint], couplings: Iterable[Coupling]
) -> str | None:
    """Return what is wrong with a simple transmission, or None."""
    if _transmission_type(element) != SIMPLE or not _is_of_one_joint(element):
        return None
    # One of a joint that the file does not have is left of a larger robot.
    name = element.findall("joint")[0].get("name")
    if name not in joints_by_name:
        return None
    reductions = [child.text or "" for child in element.iter(*REDUCTION_TAGS)]
    if any(parse_finite(text.strip()) in (None, 0.0) for text in reductions):
        return f"whose reductions are {join_names(text.strip() for text in reductions)}"
    coupled = [x.name for x in couplings if name in x.joints]
    return None if len(coupled) == 0 else f"whose joint {quote_value(name)} is one of {quote_value(coupled[0])}"


def _is_of_one_joint(element: etree._Element) -> bool:
    """Return whether a transmission has one joint, and no two motors."""
    return len(element.findall("joint")) == 1 and len(element.findall("actuator")) <= 1


def _may_move(element: etree._Element, joints_by_name: Mapping[str, tree.Joint], m: Mechanism) -> bool:
    """Return whether a transmission of unknown form may move the robot.

    It does not if none of the joints that it names moves.
    """
    named_joints = [part.get("name") for part in element.iter(etree.Element) if part.get("name") in joints_by_name]
    return len(named_joints) == 0 or any(name in m.joints for name in named_joints)


def tighten_limits(joints: Sequence[tree.Joint], robot: etree._Element, file: str) -> list[tree.Joint]:
    """Return the joints with the limits that command interfaces of ros2_control state.

    Warns once where a bound differs from that of <limit>: the tighter one counts.
    """
    joints_by_name = {joint.name: joint for joint in joints}
    limits: dict[str, Mapping[str, StatedLimit]] = {joint.name: joint.limits for joint in joints}
    differing: dict[str, list[str]] = {}
    for name, kind, bounds, place in _stated_bounds(robot, file):
        if name not in joints_by_name:
            raise JounceError(f"{place}: limits in <ros2_control>: {unknown_name_error('joint', name, joints_by_name)}")
        joint = joints_by_name[name]
        # Fixed joints have nothing to bound, and joints of several screws have no limits here.
        if joint.X is None or joint.free is not None:
            continue
        stated = _two_sided(limits[name], kind)
        joined = (max(stated[0], bounds[0]), min(stated[1], bounds[1]))
        if joined[0] > joined[1]:
            raise JounceError(
                f"{place}: joint {quote_value(name)}: {kind} is bounded by {bounds[0]:g} and {bounds[1]:g} here, and by"
                f" {stated[0]:g} and {stated[1]:g} elsewhere in the file; expected bounds that leave something between"
            )
        if np.isfinite(stated).any() and stated != bounds:
            differing.setdefault(kind, []).append(name)
        change: dict[str, StatedLimit] = {kind: joined}
        if kind == "position":
            change = {key: bound for key, bound in zip(POSITION_ENDS, joined, strict=True) if np.isfinite(bound)}
        limits[name] = {**limits[name], **change}
    if len(differing) > 0:
        kinds = "; ".join(f"{kind} of {join_names(dict.fromkeys(names), most=4)}" for kind, names in differing.items())
        warn(f"{file}: <limit> and <ros2_control> state different bounds, of which the tighter ones count: {kinds}")
    return [replace(joint, limits=limits[joint.name]) for joint in joints]


def _stated_bounds(robot: etree._Element, file: str) -> Iterator[tuple[str, str, tuple[float, float], str]]:
    """Yield joint, kind, bounds and place of each limit of ros2_control."""
    for joint in robot.iterfind("ros2_control/joint"):
        for interface in joint.iterfind("command_interface"):
            kind = interface.get("name", "")
            is_enabled = _is_enabled(joint, file) and _is_enabled(interface, file)
            if kind in LIMITED_INTERFACES and is_enabled:
                bounds = _read_bounds(interface, kind, joint.get("name", ""), file)
                if np.isfinite(bounds).any():
                    yield joint.get("name", ""), kind, bounds, _line(interface, file)


def _is_enabled(element: etree._Element, file: str) -> bool:
    """Return whether the limits of a joint or interface count."""
    limits = element.find("limits")
    if limits is None:
        return True
    text = limits.get("enable", "")
    if text.lower() not in TRUTH:
        raise JounceError(f"{_line(limits, file)}: <limits enable={quote_value(text)}>; expected true or false")
    return TRUTH[text.lower()]


def _read_bounds(interface: etree._Element, kind: str, joint: str, file: str) -> tuple[float, float]:
    """Return the lower and upper bound of a command interface.

    They are infinite where none is stated. One bound of a rate or effort is for both directions, as ros2_control has
    it.
    """
    place, what = _line(interface, file), f"{kind} of joint {quote_value(joint)}"
    stated: dict[str, float] = {}
    for parameter in interface.iterfind("param"):
        end = parameter.get("name", "")
        if end not in BOUND_NAMES:
            continue
        if end in stated:
            raise JounceError(f"{_line(parameter, file)}: {what} states {end} twice; expected it once")
        is_infinite = (parameter.text or "").strip().lower() in INFINITE[end]
        sign = -1 if end == "min" else 1
        stated[end] = sign * np.inf if is_infinite else _read_number(parameter, f"{end} of {what}", file)
    lower, upper = stated.get("min", -np.inf), stated.get("max", np.inf)
    if kind != "position" and len(stated) == 1:
        size = min(-lower, upper)
        lower, upper = -size, size
    limit = LIMIT_KINDS[kind]
    is_valid = lower <= upper if kind == "position" or limit.any_sign else lower <= 0 <= upper
    if not is_valid:
        came = " and ".join(f"{end} {stated[end]:g}" for end in BOUND_NAMES if end in stated)
        expected = "min <= max" if kind == "position" or limit.any_sign else "min <= 0 <= max"
        raise JounceError(f"{place}: {what} has {came}; expected {expected}")
    return lower, upper


def _two_sided(limits: Mapping[str, StatedLimit], kind: str) -> tuple[float, float]:
    """Return both bounds of a kind that a joint states.

    They are infinite where it states none.
    """
    if kind == "position":
        lower, upper = (limits.get(key, sign * np.inf) for key, sign in zip(POSITION_ENDS, (-1, 1), strict=True))
        return float(lower), float(upper)  # type: ignore[arg-type]
    value = limits.get(kind, np.inf)
    lower, upper = value if isinstance(value, Sequence) else (-value, value)
    return float(lower), float(upper)


def _first_few(texts: Sequence[str], most: int = 4) -> list[str]:
    """Return some of many texts, and how many others there are."""
    return [*texts[:most], *([f"{len(texts) - most} more"] if len(texts) > most else [])]


def _line(element: etree._Element, file: str) -> str:
    return f"{file}:{element.sourceline}"
