"""Links and joints as robot files state them: distinct, valid, and in order from the roots outward."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from jounce.core.errors import JounceError, join_names, quote_value, unknown_name_error
from jounce.model.drives import drive_error
from jounce.model.stated_limits import StatedLimit, limit_error
from jounce.spatial.groups import BALL, FREE, PLANAR, Group

FREE_JOINT_GROUPS: Mapping[str, Group] = {"floating": FREE, "planar": PLANAR, "spherical": BALL}


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
