"""Where other libraries have the coordinates of joints in their vectors, and which of these joints a robot has."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from jounce.core.errors import JounceError, listed, no_such, quoted
from jounce.model.mechanism import Mechanism


@dataclass(frozen=True)
class Place:
    """Where the coordinate of a joint stands in q and v; a joint that turns freely has a cosine and a sine in q."""

    q: int
    v: int
    turns: bool = False


@dataclass(frozen=True, eq=False)
class FreeJoint:
    """A floating joint: its 7 numbers in q and 6 in v, where it stands on the ground, and the frames that it moves."""

    q: int
    v: int
    ground: np.ndarray
    moved: Mapping[str, np.ndarray]  # poses of the frames that it moves rigidly, in its moved frame


@dataclass(frozen=True, eq=False)
class Layout:
    """The vectors of a model: sizes, joints by name, and how a floating joint is stated."""

    what: str  # for messages
    labels: tuple[str, str, str, str]  # of position, velocity, acceleration and forces
    nq: int
    nv: int
    rest: np.ndarray  # q of joints that a robot does not have
    places: Mapping[str, Place]
    free: Mapping[str, FreeJoint]
    carries: Mapping[str, frozenset[str]]  # bodies, frames and joints beyond each joint, of all kinds
    quaternion: tuple[int, int, int, int]  # where w, x, y, z stand in it
    linear_in_world: bool  # the linear velocity, acceleration and force of a floating joint, otherwise in its own axes


@dataclass(frozen=True, eq=False)
class Match:
    """The joints of a robot in a model: indices with their places, and the joint that moves the base."""

    joints: Mapping[int, Place]
    base: FreeJoint | None


def match(mechanism: Mechanism, layout: Layout) -> Match:
    """Return the joints of a robot in a model; raise unless all that move its bodies are joints of both."""
    if mechanism.closure:
        raise JounceError(
            f"{quoted(mechanism.name)} has closed loops, {layout.what} has the joints of its tree; convert states of"
            " jounce.Robot(robot.mechanism.tree), whose q the closed robot takes as it is"
        )
    joints = {i: layout.places[name] for i, name in enumerate(mechanism.joints) if name in layout.places}
    for name in mechanism.coordinates:
        if name not in mechanism.joints or name not in layout.places:
            raise no_such("joint", name, layout.places, layout.what)
    base = _carrier_of_base(mechanism, layout) if mechanism.floats else None
    known = {*mechanism.frame_names, *mechanism.joints}
    for name, carried in layout.carries.items():
        ours = name in mechanism.joints or (base is not None and layout.free.get(name) is base)
        if not ours and (moved := sorted(carried & known)):
            held = f"joint {quoted(name)} moves {listed(moved, most=3)}, which this robot holds"
            floats = "; load it with base='floating'" if name in layout.free and not mechanism.floats else ""
            raise JounceError(f"{layout.what}: {held}{floats or '; expected a model of the same joints'}")
    return Match(joints, base)


def _carrier_of_base(mechanism: Mechanism, layout: Layout) -> FreeJoint:
    base = mechanism.bodies[0]
    for joint in layout.free.values():
        if base in joint.moved:
            return joint
    some = listed(name for joint in layout.free.values() for name in joint.moved) or "none"
    came = f"no floating joint moves {quoted(base)}, the base of {quoted(mechanism.name)}"
    raise JounceError(f"{layout.what}: {came}; links on floating joints: {some}")
