"""`build_mechanism` makes a kinematic tree from links and joints, of robot files and of other libraries' models.

A `Link` and a `Joint` are what a file states, with the place where it does, for messages. Checks come first: names are
distinct, numbers valid (`check_numbers`), and the joints a forest, from the roots outward (`outward_order`).

Links behind fixed joints merge into the body that carries them: their inertia is added, their names and frames remain
usable. Bodies are named after the link that their joint moves, in the file's order, depth first. A joint with more than
one degree of freedom, free, planar or a ball, has several screws; it can be welded, or excluded by starting at a link
that it carries.

Of a floating robot one link is the base: the one that a floating joint carries on the ground, or the only root. Links
behind fixed joints merge into it too.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from jounce.core.cures import FLOATING_BASE, Remedy
from jounce.core.errors import JounceError, join_names, locate_errors, quote_value, shorten, unknown_name_error, warn
from jounce.model import screws
from jounce.model.drive_trains import UNDRIVEN, drive_error
from jounce.model.frame import Frame
from jounce.model.limits import StatedLimit, limit_error, limits_of_joints
from jounce.model.mechanism import Mechanism
from jounce.spatial import groups, inertia
from jounce.spatial.groups import Group

FREE_JOINT_GROUPS: Mapping[str, Group] = {"floating": groups.FREE, "planar": groups.PLANAR, "spherical": groups.BALL}


@dataclass(frozen=True)
class Link:
    """A rigid link and its inertia matrix in its own frame."""

    name: str
    M: np.ndarray
    place: str  # where it is stated, for messages: FILE:LINE


@dataclass(frozen=True)
class Mimic:
    """The law of a joint variable that follows another: multiplier times it, plus offset."""

    joint: str
    multiplier: float
    offset: float


@dataclass(frozen=True)
class Joint:
    """A joint between two links; B is the child's pose in the parent's frame at zero, X its screw in the child's."""

    name: str
    parent: str
    child: str
    B: np.ndarray
    X: np.ndarray | None  # (6,); None where it is fixed, and where its screws are those of its kind of free joint
    mimic: Mimic | None
    limits: Mapping[str, StatedLimit]  # those that the file states of lower, upper, velocity, effort, ...
    drive: Mapping[str, float]  # and of armature, damping, friction, stiffness, rest
    place: str
    free: str | None = None  # "floating", "planar", "spherical": what makes of it more than one screw does

    @property
    def screws(self) -> np.ndarray:
        """(k, 6): none of a fixed joint."""
        if self.free is not None and self.X is None:
            return FREE_JOINT_GROUPS[self.free].X.T
        return np.zeros((0, 6)) if self.X is None else self.X.reshape(-1, 6)

    @property
    def variables(self) -> list[str]:
        """The names of its joint variables: its own, or several that begin with it."""
        if self.free is None:
            return [self.name] * len(self.screws)
        return [f"{self.name}.{velocity}" for velocity in FREE_JOINT_GROUPS[self.free].velocities]

    @property
    def limited(self) -> list[str]:
        """Those of its joint variables that its limits are kept at: of a ball, those of the angle of the whole turn."""
        return self.variables if self.free is None else self.variables[1:2] if self.free == "spherical" else []


Item = TypeVar("Item", Link, Joint)


def index_by_name(items: Sequence[Item], kind: str) -> dict[str, Item]:
    """The items by name; raise `JounceError` at the second one of a name."""
    found: dict[str, Item] = {}
    for item in items:
        if (first := found.setdefault(item.name, item)) is not item:
            raise JounceError(f"{item.place}: duplicate {kind} {quote_value(item.name)}; the first is at {first.place}")
    return found


def check_numbers(links: Sequence[Link], joints: Sequence[Joint]) -> None:
    """Raise `JounceError` if a pose, axis, inertia or limit is not finite or not valid, with its name and place."""
    held = [(link.place, f"inertia of link {quote_value(link.name)}", link.M) for link in links]
    for joint in joints:
        law = [] if joint.mimic is None else [joint.mimic.multiplier, joint.mimic.offset]
        for what, numbers in (("pose", joint.B), ("axis", joint.screws), ("mimic", law)):
            held.append((joint.place, f"{what} of joint {quote_value(joint.name)}", np.array(numbers)))
        if error := limit_error(**joint.limits) or drive_error(**joint.drive):
            raise JounceError(f"{joint.place}: joint {quote_value(joint.name)}: {error}")
    for place, what, array in held:
        for x in array[~np.isfinite(array)][:1]:
            raise JounceError(f"{place}: {what} holds {x}; expected finite numbers")


def outward_order(links: Mapping[str, Link], joints: Sequence[Joint]) -> list[Joint]:
    """Return the joints from the roots outward, depth first, in the file's order; raise if they are not a forest."""
    above: dict[str, Joint] = {}
    children: dict[str, list[Joint]] = {link: [] for link in links}
    for joint in joints:
        for role, link in (("parent", joint.parent), ("child", joint.child)):
            if link not in links:
                named = f"{role} of joint {quote_value(joint.name)}"
                raise JounceError(f"{joint.place}: {named}: {unknown_name_error('link', link, links)}")
        if joint.child in above:
            both = f"two joints, {quote_value(above[joint.child].name)} and {quote_value(joint.name)}"
            raise JounceError(f"{joint.place}: link {quote_value(joint.child)} is the child of {both}; expected one")
        above[joint.child] = joint
        children[joint.parent].append(joint)
    roots = [link for link in links if link not in above]
    ordered: list[Joint] = []
    stack = [joint for root in reversed(roots) for joint in reversed(children[root])]
    while stack:
        joint = stack.pop()
        ordered.append(joint)
        stack.extend(reversed(children[joint.child]))
    if len(ordered) < len(joints):
        reached = {joint.name for joint in ordered}
        cycle = [joint for joint in joints if joint.name not in reached]
        rootless, names = "" if roots else "no root link: ", join_names(joint.name for joint in cycle)
        raise JounceError(f"{cycle[0].place}: {rootless}joints {names} form a cycle; expected a tree")
    return ordered


FIXED_BASE, ROOT = Remedy("base='fixed'", "--base fixed"), Remedy("root=", "--root LINK")


def build_mechanism(
    links: Sequence[Link],
    joints: Sequence[Joint],
    gravity: object,
    name: str,
    file: str,
    *,
    base: str | None = None,
    root: str | None = None,
    world: str | None = None,
) -> Mechanism:
    """Build the mechanism of links and joints; raise `JounceError` if they are inconsistent.

    ``base="fixed"`` welds free joints at their zero pose and warns of it; ``base="floating"`` lets a link float.
    ``root`` is a link to start at: what it carries remains, it stands on the ground or floats itself, and everything
    else is left out. ``world`` is the link, if there is one, that is the ground by the format, and never floats.
    """
    by_name = index_by_name(links, "link")
    index_by_name(joints, "joint")
    check_numbers(links, joints)
    ordered = outward_order(by_name, joints)
    floating = None
    with locate_errors(file):
        check_base(base)
        if base == "floating":
            root = floating = _floating_link(by_name, ordered, root, world)
    if root is not None:
        by_name, ordered = _start_at(root, by_name, ordered, file)
    ordered = _weld_free_joints(by_name, ordered, base, file)
    if floating is not None and not _movable_joints(ordered):  # nothing but the base: it is a free joint of the ground
        called = next((joint.name for joint in joints if joint.child == floating), floating)
        ordered = [Joint(called, "", floating, np.eye(4), None, None, {}, {}, file, free="floating"), *ordered]
        floating = None
    movable = _movable_joints(ordered)
    if not movable:
        stated = f"{len(by_name)} link{'s' * (len(by_name) != 1)} and {len(ordered)} joint{'s' * (len(ordered) != 1)}"
        cure = f" or {FLOATING_BASE}, by which the base moves freely" if base is None and by_name else ""
        raise JounceError(f"{file}: no movable joint among {stated}; expected at least one{cure}")

    with locate_errors(file):
        screws.check_size(len(movable))
    frames = {link: Frame(link, -1, np.eye(4)) for link in by_name}  # the roots stand on the ground, or are the base
    parent: list[Frame] = []
    for joint in ordered:
        carrier = frames.get(joint.parent, Frame("", -1, np.eye(4)))
        if not len(joint.screws):
            frames[joint.child] = Frame(joint.child, carrier.body, carrier.T @ joint.B)
        else:
            frames[joint.child] = Frame(joint.child, len(parent), np.eye(4))
            parent.append(carrier)
    M = np.zeros((len(movable) + 1, 6, 6))  # the last is of -1, the ground or base
    for link, frame in frames.items():
        M[frame.body] += inertia.shift_inertia(by_name[link].M, frame.T)
    if floating is not None and not M[-1].any():
        warn(
            f"{file}: base {quote_value(floating)} has no inertia, nor has a link fixed to it;"
            f" {ROOT} names another link"
        )

    G, g, coordinates = _coordinates(movable, ordered, joints)
    variables = [(joint, name, i) for i, joint in enumerate(movable) for name in joint.variables]
    bodies = tuple(joint.child for joint in movable)
    with locate_errors(file):
        built = screws.from_screws(
            np.stack([carrier.T @ joint.B for carrier, joint in zip(parent, movable, strict=True)]),
            np.concatenate([joint.screws for joint in movable]),
            M[:-1],
            [carrier.body for carrier in parent],
            names=bodies,
            joint_names=coordinates,
            gravity=gravity,
            owners=[i for _, _, i in variables],
            G=G,
            g=g,
            limits=limits_of_joints([joint.limits if name in joint.limited else {} for joint, name, _ in variables]),
            drives={key: [joint.drive.get(key, none) for joint, _, _ in variables] for key, none in UNDRIVEN.items()},
            base=None if floating is None else M[-1],
            base_name=floating or "",
            name=name,
        )
    own = set(built.bodies)
    merged = tuple(replace(f, body=f.body + built.floats) for link, f in frames.items() if link not in own)
    return replace(built, joints=tuple(name for _, name, _ in variables), frames=merged)


def _movable_joints(joints: Sequence[Joint]) -> list[Joint]:
    return [joint for joint in joints if len(joint.screws)]


def _start_at(
    root: str, links: Mapping[str, Link], ordered: Sequence[Joint], file: str
) -> tuple[dict[str, Link], list[Joint]]:
    """Return the links and joints from a link outward, in the file's order."""
    if not isinstance(root, str) or root not in links:
        raise JounceError(f"{file}: {unknown_name_error('link', root, links)}")
    carried, kept = {root}, []
    for joint in ordered:
        if joint.parent in carried:
            carried.add(joint.child)
            kept.append(joint)
    return {name: link for name, link in links.items() if name in carried}, kept


def _floating_link(links: Mapping[str, Link], ordered: Sequence[Joint], root: str | None, world: str | None) -> str:
    """Return the link that floats: that of `root`, of the floating joint on the ground, or the only root link."""
    if root is None:
        root = _free_link(links, ordered)
    if root == world:
        ground = f"{quote_value(world)} is the ground, and no free joint stands on it"
        raise JounceError(f"{FLOATING_BASE}: {ground}; expected {ROOT}, the link that floats")
    return root


def _free_link(links: Mapping[str, Link], ordered: Sequence[Joint]) -> str:
    """Return the link on the only floating joint on the ground, or, if there is no such joint, the only root link."""
    roots, moving = _roots(links, ordered), _joints_on_ground(links, ordered)
    floating = [joint.child for joint in moving if joint.free == "floating"]
    if floating and len(moving) > 1:
        came = f"{len(moving)} links move on the ground, {join_names(joint.child for joint in moving)}"
        raise JounceError(f"{FLOATING_BASE}: {came}; expected {ROOT}, the one that floats: {' or '.join(floating)}")
    if not roots:
        raise JounceError(f"{FLOATING_BASE}: no links; expected at least one")
    if not floating and len(roots) > 1:
        came = f"{len(roots)} root links, {join_names(roots)}"
        raise JounceError(f"{FLOATING_BASE}: {came}; expected {ROOT}, the one that floats")
    return (floating or roots)[0]


def _roots(links: Mapping[str, Link], ordered: Sequence[Joint]) -> list[str]:
    above = {joint.child for joint in ordered}
    return [link for link in links if link not in above]


def _joints_on_ground(links: Mapping[str, Link], ordered: Sequence[Joint]) -> list[Joint]:
    """The joints that move on the roots, and on what is fixed to them."""
    ground, moving = set(_roots(links, ordered)), []
    for joint in ordered:
        if joint.parent in ground and not len(joint.screws):
            ground.add(joint.child)
        elif joint.parent in ground:
            moving.append(joint)
    return moving


def check_base(base: object) -> None:
    """Raise `JounceError` unless a base is left out, fixed or floating."""
    if base is not None and not (isinstance(base, str) and base in ("fixed", "floating")):
        known = "'floating', whose base link moves freely, or 'fixed', which welds free joints"
        raise JounceError(f"base is {quote_value(base)}; expected {known}")


def _weld_free_joints(links: Mapping[str, Link], ordered: Sequence[Joint], base: str | None, file: str) -> list[Joint]:
    """The joints with the floating ones on the ground welded, with a warning, if `base` asks for it.

    Raises `JounceError` if `base` is left out and one link that moves freely carries all others.
    """
    moving = _joints_on_ground(links, ordered)
    floating = [joint for joint in moving if joint.free == "floating"]
    if base == "fixed" and floating:
        warn(f"{file}: {FIXED_BASE} welds at zero: {join_names(f'{joint.name} ({joint.free})' for joint in floating)}")
        return [replace(joint, free=None, X=None) if joint in floating else joint for joint in ordered]
    if base is None and len(moving) == len(floating) == 1 < len(_movable_joints(ordered)):
        [joint] = floating
        ways = f"{FLOATING_BASE}, {FIXED_BASE} to weld it at its zero pose, or {ROOT} to start at another link"
        raise JounceError(f"{joint.place}: joint {quote_value(joint.name)} is floating; expected {ways}")
    return list(ordered)


def _coordinates(
    movable: Sequence[Joint], ordered: Sequence[Joint], joints: Sequence[Joint]
) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """G, g and the names of the coordinates: the joints that follow no other."""
    known, kept = {joint.name: joint for joint in joints}, {joint.name for joint in ordered}
    free = [name for joint in movable if joint.mimic is None for name in joint.variables]
    column = {name: j for j, name in enumerate(free)}
    variables = [(joint, name) for joint in movable for name in joint.variables]
    G, g = np.zeros((len(variables), len(free))), np.zeros(len(variables))
    for i, (joint, name) in enumerate(variables):
        if joint.free is not None:
            G[i, column[name]] = 1.0
            continue
        factor, offset, followed = 1.0, 0.0, [joint.name]
        while (mimic := known[followed[-1]].mimic) is not None:
            if mimic.joint not in known:
                named = f"mimic of {quote_value(followed[-1])}"
                raise JounceError(f"{joint.place}: {named}: {unknown_name_error('joint', mimic.joint, known)}")
            if mimic.joint in followed:
                circle = " -> ".join(map(shorten, [*followed, mimic.joint]))
                raise JounceError(f"{joint.place}: joints mimic each other in a cycle: {circle}")
            leader = known[mimic.joint]
            single = leader.X is not None and not leader.free
            if not (single and mimic.joint in kept):
                both = f"joint {quote_value(followed[-1])} mimics {quote_value(mimic.joint)}"
                state = f"excluded by {ROOT}" if single else leader.free or "fixed"
                raise JounceError(f"{joint.place}: {both}, which is {state}")
            factor, offset = factor * mimic.multiplier, offset + factor * mimic.offset
            followed.append(mimic.joint)
        G[i, column[followed[-1]]], g[i] = factor, offset
    return G, g, free
