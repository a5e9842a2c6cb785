"""Make a kinematic tree from links and joints of files and models.

A `Link` and a `Joint` are what a file states, with the place where it does, for messages; a `LinkModel` holds all of
them. Its checks come first: names are distinct, numbers valid (`check_numbers`), and the joints a forest, from the
roots outward (`outward_order`).

Links behind fixed joints merge into the body that carries them: their inertia is added, their names and frames remain
usable. Bodies are named after the link that their joint moves, in the file's order, depth first. A joint with more than
one degree of freedom, free, planar or a ball, has several screws; it can be welded, or excluded by starting at a link
that it carries.

`build_mechanism` chooses what moves (`_choose_base`), merges links into bodies (`_place_links`), and couples joint
variables that follow others (`_coordinates`); `screws.from_screws` checks and stores the result.

Of a floating robot one link is the base: the one that a floating joint carries on the ground, or the only root. Links
behind fixed joints merge into it too.
"""

from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, field, replace
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
    """A joint between two links.

    B is the pose of the child in the frame of the parent at zero, X its screw in the frame of the child.
    """

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
        """The screws (k, 6) of the joint; a fixed one has k = 0."""
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
        """The joint variables that its limits are kept at."""
        if self.free is None:
            return self.variables
        # The limits of a ball bound the angle of the whole turn, which stands in the place of its second velocity.
        return self.variables[1:2] if self.free == "spherical" else []


Item = TypeVar("Item", Link, Joint)


def index_by_name(items: Sequence[Item], kind: str) -> dict[str, Item]:
    """Return the items by name.

    Raises `JounceError` at the second one of a name.
    """
    by_name: dict[str, Item] = {}
    for item in items:
        first = by_name.setdefault(item.name, item)
        if first is not item:
            raise JounceError(f"{item.place}: duplicate {kind} {quote_value(item.name)}; the first is at {first.place}")
    return by_name


def check_numbers(links: Sequence[Link], joints: Sequence[Joint]) -> None:
    """Raise `JounceError` if a pose, axis, inertia or limit is not valid."""
    arrays = [(link.place, f"inertia of link {quote_value(link.name)}", link.M) for link in links]
    for joint in joints:
        law = [] if joint.mimic is None else [joint.mimic.multiplier, joint.mimic.offset]
        for what, numbers in (("pose", joint.B), ("axis", joint.screws), ("mimic", law)):
            arrays.append((joint.place, f"{what} of joint {quote_value(joint.name)}", np.array(numbers)))
        error = limit_error(**joint.limits) or drive_error(**joint.drive)
        if error:
            raise JounceError(f"{joint.place}: joint {quote_value(joint.name)}: {error}")
    for place, what, array in arrays:
        infinite = array[~np.isfinite(array)]
        if infinite.size > 0:
            raise JounceError(f"{place}: {what} holds {infinite[0]}; expected finite numbers")


def outward_order(links: Mapping[str, Link], joints: Sequence[Joint]) -> list[Joint]:
    """Return the joints from the roots outward, depth first.

    They are in the file's order.

    Raises `JounceError` if they are not a forest.
    """
    # Each link is the child of at most one joint, and the parent of any number of them.
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
    # Depth first with a stack, so that chains of thousands of links do not nest calls; the last pushed comes first.
    ordered: list[Joint] = []
    stack = [joint for root in reversed(roots) for joint in reversed(children[root])]
    while stack:
        joint = stack.pop()
        ordered.append(joint)
        stack.extend(reversed(children[joint.child]))
    # With one parent a link, joints that no root reaches lie on a cycle, or behind one.
    if len(ordered) < len(joints):
        reached = {joint.name for joint in ordered}
        cycle = [joint for joint in joints if joint.name not in reached]
        rootless, names = "" if roots else "no root link: ", join_names(joint.name for joint in cycle)
        raise JounceError(f"{cycle[0].place}: {rootless}joints {names} form a cycle; expected a tree")
    return ordered


@dataclass(frozen=True, eq=False)
class LinkModel:
    """The links and joints of a file or model, checked.

    The model may be one of another library. It is checked when it is made.
    """

    links: Sequence[Link]
    joints: Sequence[Joint]
    name: str  # of the robot
    file: str  # what messages call it
    world: str | None = None  # the link, if there is one, that is the ground by the format, and never floats
    links_by_name: dict[str, Link] = field(init=False)  # in their order
    ordered_joints: list[Joint] = field(init=False)  # from the roots outward

    def __post_init__(self) -> None:
        links_by_name = index_by_name(self.links, "link")
        index_by_name(self.joints, "joint")
        check_numbers(self.links, self.joints)
        object.__setattr__(self, "links_by_name", links_by_name)
        object.__setattr__(self, "ordered_joints", outward_order(links_by_name, self.joints))


FIXED_BASE, ROOT = Remedy("base='fixed'", "--base fixed"), Remedy("root=", "--root LINK")


def build_mechanism(model: LinkModel, gravity: object, base: str | None = None, root: str | None = None) -> Mechanism:
    """Build the mechanism of a model.

    Raises `JounceError` if base or root do not fit. ``base="fixed"`` welds free joints at their zero pose and warns of
    it; ``base="floating"`` lets a link float. ``root`` is a link to start at: what it carries remains, it stands on the
    ground or floats itself, and everything else is left out.
    """
    links, joints, floating = _choose_base(model, base, root)
    movable = _movable_joints(joints)
    if len(movable) == 0:
        stated = f"{len(links)} link{'s' * (len(links) != 1)} and {len(joints)} joint{'s' * (len(joints) != 1)}"
        cure = f" or {FLOATING_BASE}, by which the base moves freely" if base is None and links else ""
        raise JounceError(f"{model.file}: no movable joint among {stated}; expected at least one{cure}")
    with locate_errors(model.file):
        screws.check_size(len(movable))

    # A body is a link on a movable joint, with all that is fixed to it: M_i is the sum of their inertias, each seen
    # from the frame of the body. The last of the nb + 1 matrices is that of body -1, the ground or the base.
    frames, carriers = _place_links(links, joints)
    M = np.zeros((len(movable) + 1, 6, 6))
    for link, frame in frames.items():
        M[frame.body] += inertia.shift_inertia(links[link].M, frame.T)
    if floating is not None and not M[-1].any():
        warn(
            f"{model.file}: base {quote_value(floating)} has no inertia, nor has a link fixed to it;"
            f" {ROOT} names another link"
        )

    # Each movable joint has one or more joint variables, which stand in the order of the bodies.
    G, g, coordinates = _coordinates(movable, joints, model.joints)
    variables = [(joint, name, i) for i, joint in enumerate(movable) for name in joint.variables]
    limits = [joint.limits if name in joint.limited else {} for joint, name, _ in variables]
    with locate_errors(model.file):
        options = screws.ScrewOptions(
            names=tuple(joint.child for joint in movable),
            joint_names=coordinates,
            gravity=gravity,
            owners=[i for _, _, i in variables],
            G=G,
            g=g,
            limits=limits_of_joints(limits),
            drives={key: [joint.drive.get(key, none) for joint, _, _ in variables] for key, none in UNDRIVEN.items()},
            base=None if floating is None else M[-1],
            base_name=floating or "",
            name=model.name,
        )
        mechanism = screws.from_screws(
            np.stack([carrier.T @ joint.B for carrier, joint in zip(carriers, movable, strict=True)]),
            np.concatenate([joint.screws for joint in movable]),
            M[:-1],
            [carrier.body for carrier in carriers],
            options,
        )

    # Links that are no bodies keep their names as frames; a base that floats has become body 0, ahead of the others.
    bodies = set(mechanism.bodies)
    merged = [replace(f, body=f.body + mechanism.floats) for link, f in frames.items() if link not in bodies]
    return replace(mechanism, joints=tuple(name for _, name, _ in variables), frames=tuple(merged))


def _choose_base(
    model: LinkModel, base: str | None, root: str | None
) -> tuple[dict[str, Link], list[Joint], str | None]:
    """Return links and joints of the robot, and what floats."""
    links, joints, floating = model.links_by_name, model.ordered_joints, None
    with locate_errors(model.file):
        check_base(base)
        if base == "floating":
            floating = root = _floating_link(links, joints, root, model.world)
    # What does not hang on the root is left out, and with it the joint that carries the root.
    if root is not None:
        links, joints = _start_at(root, links, joints, model.file)
    joints = _weld_free_joints(links, joints, base, model.file)

    # A robot of nothing but its base has no joint variable: the base moves on a free joint of the ground instead.
    if floating is not None and len(_movable_joints(joints)) == 0:
        name = next((joint.name for joint in model.joints if joint.child == floating), floating)
        joints = [Joint(name, "", floating, np.eye(4), None, None, {}, {}, model.file, free="floating"), *joints]
        floating = None
    return links, joints, floating


def _place_links(links: Mapping[str, Link], joints: Sequence[Joint]) -> tuple[dict[str, Frame], list[Frame]]:
    """Return the frames of links, and those that carry bodies.

    Body i is behind the i-th movable joint; links on the ground or base are on body -1.
    """
    frames = {link: Frame(link, -1, np.eye(4)) for link in links}
    carriers: list[Frame] = []
    # Joints come from the roots outward, so that the frame of a parent is known before those of its children.
    for joint in joints:
        carrier = frames.get(joint.parent, Frame("", -1, np.eye(4)))
        if len(joint.screws) == 0:
            frames[joint.child] = Frame(joint.child, carrier.body, carrier.T @ joint.B)
        else:
            frames[joint.child] = Frame(joint.child, len(carriers), np.eye(4))
            carriers.append(carrier)
    return frames, carriers


def _movable_joints(joints: Sequence[Joint]) -> list[Joint]:
    return [joint for joint in joints if len(joint.screws) > 0]


def _start_at(
    root: str, links: Mapping[str, Link], ordered: Sequence[Joint], file: str
) -> tuple[dict[str, Link], list[Joint]]:
    """Return the links and joints from a link outward.

    They are in the file's order.
    """
    if not isinstance(root, str) or root not in links:
        raise JounceError(f"{file}: {unknown_name_error('link', root, links)}")
    # Joints come from the roots outward: whatever hangs on the root comes after the joint that carries it.
    carried_links, carried_joints = {root}, []
    for joint in ordered:
        if joint.parent in carried_links:
            carried_links.add(joint.child)
            carried_joints.append(joint)
    return {name: link for name, link in links.items() if name in carried_links}, carried_joints


def _floating_link(links: Mapping[str, Link], ordered: Sequence[Joint], root: str | None, world: str | None) -> str:
    """Return the link that floats.

    It is that of `root`, of the floating joint on the ground, or the only root link.
    """
    if root is None:
        root = _free_link(links, ordered)
    if root == world:
        ground = f"{quote_value(world)} is the ground, and no free joint stands on it"
        raise JounceError(f"{FLOATING_BASE}: {ground}; expected {ROOT}, the link that floats")
    return root


def _free_link(links: Mapping[str, Link], ordered: Sequence[Joint]) -> str:
    """Return the link on the floating joint, or the root.

    The joint is the only one that floats on the ground, else the root is the only one.
    """
    roots, moving = _roots(links, ordered), _joints_on_ground(links, ordered)
    floating = [joint.child for joint in moving if joint.free == "floating"]
    # Two bodies that move on the ground are two robots: the caller says which of them floats.
    if len(floating) > 0 and len(moving) > 1:
        came = f"{len(moving)} links move on the ground, {join_names(joint.child for joint in moving)}"
        raise JounceError(f"{FLOATING_BASE}: {came}; expected {ROOT}, the one that floats: {' or '.join(floating)}")
    if len(roots) == 0:
        raise JounceError(f"{FLOATING_BASE}: no links; expected at least one")
    if len(floating) > 0:
        return floating[0]
    if len(roots) > 1:
        came = f"{len(roots)} root links, {join_names(roots)}"
        raise JounceError(f"{FLOATING_BASE}: {came}; expected {ROOT}, the one that floats")
    return roots[0]


def _roots(links: Mapping[str, Link], ordered: Sequence[Joint]) -> list[str]:
    above = {joint.child for joint in ordered}
    return [link for link in links if link not in above]


def _joints_on_ground(links: Mapping[str, Link], ordered: Sequence[Joint]) -> list[Joint]:
    """Return the joints that move on the ground.

    The ground is the roots, and what is fixed to them.
    """
    ground, moving = set(_roots(links, ordered)), []
    for joint in ordered:
        is_fixed = len(joint.screws) == 0
        if joint.parent in ground and is_fixed:
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
    """Return the joints, floating ones welded if asked.

    `base` asks for it, of those on the ground. Warns of joints that it welds. Raises `JounceError` if `base` is left
    out and one link that moves freely carries all others.
    """
    moving = _joints_on_ground(links, ordered)
    floating = [joint for joint in moving if joint.free == "floating"]
    if base == "fixed" and len(floating) > 0:
        warn(f"{file}: {FIXED_BASE} welds at zero: {join_names(f'{joint.name} ({joint.free})' for joint in floating)}")
        return [replace(joint, free=None, X=None) if joint in floating else joint for joint in ordered]
    # A mobile robot may be meant to stand or to float: nothing is guessed. A single free body is just that.
    if base is None and len(moving) == len(floating) == 1 < len(_movable_joints(ordered)):
        [joint] = floating
        ways = f"{FLOATING_BASE}, {FIXED_BASE} to weld it at its zero pose, or {ROOT} to start at another link"
        raise JounceError(f"{joint.place}: joint {quote_value(joint.name)} is floating; expected {ways}")
    return list(ordered)


def _coordinates(
    movable: Sequence[Joint], ordered: Sequence[Joint], joints: Sequence[Joint]
) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Return G, g and the names of the coordinates: the joints that follow no other.

    The joint variables are theta = G q + g: G (nc, n) has one entry in each row, at the coordinate that leads.
    """
    by_name, kept = {joint.name: joint for joint in joints}, {joint.name for joint in ordered}
    coordinates = [name for joint in movable if joint.mimic is None for name in joint.variables]
    column = {name: j for j, name in enumerate(coordinates)}
    variables = [(joint, name) for joint in movable for name in joint.variables]
    G, g = np.zeros((len(variables), len(coordinates))), np.zeros(len(variables))
    for i, (joint, name) in enumerate(variables):
        # The variables of a joint of several screws follow no other.
        if joint.free is not None:
            G[i, column[name]] = 1.0
        else:
            leader, factor, offset = _follow_mimics(joint, by_name, kept)
            G[i, column[leader]], g[i] = factor, offset
    return G, g, coordinates


def _follow_mimics(joint: Joint, by_name: Mapping[str, Joint], kept: Container[str]) -> tuple[str, float, float]:
    """Return the leader of a joint, factor and offset.

    It leads through all mimics between them.

    Raises `JounceError` if a mimic names a joint that is unknown, does not move along one screw, is left out, or
    follows the first one itself.
    """
    factor, offset, path = 1.0, 0.0, [joint.name]
    mimic = joint.mimic
    while mimic is not None:
        if mimic.joint not in by_name:
            named = f"mimic of {quote_value(path[-1])}"
            raise JounceError(f"{joint.place}: {named}: {unknown_name_error('joint', mimic.joint, by_name)}")
        if mimic.joint in path:
            circle = " -> ".join(map(shorten, [*path, mimic.joint]))
            raise JounceError(f"{joint.place}: joints mimic each other in a cycle: {circle}")
        leader = by_name[mimic.joint]
        has_one_screw = leader.X is not None and leader.free is None
        if not (has_one_screw and mimic.joint in kept):
            both = f"joint {quote_value(path[-1])} mimics {quote_value(mimic.joint)}"
            state = f"excluded by {ROOT}" if has_one_screw else leader.free or "fixed"
            raise JounceError(f"{joint.place}: {both}, which is {state}")
        # theta = factor (multiplier theta' + offset') + offset, of the theta' that it follows
        factor, offset = factor * mimic.multiplier, offset + factor * mimic.offset
        path.append(mimic.joint)
        mimic = leader.mimic
    return path[-1], factor, offset
