"""Where other libraries have the coordinates of joints in their vectors, and which of these joints a robot has."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from jounce.core.errors import JounceError, join_names, quote_value, unknown_name_error
from jounce.model.mechanism import Mechanism
from jounce.model.positions import list_multiscrew_joints, whole_position_count
from jounce.spatial.groups import Group


@dataclass(frozen=True)
class JointPlace:
    """The index of a joint's coordinate in q and v; a joint that turns freely has a cosine and a sine in q."""

    q: int
    v: int
    turns: bool = False


@dataclass(frozen=True, eq=False)
class FreeJointPlace:
    """A joint of several screws: where jounce's numbers of it stand in q, and its velocities in v.

    Of one that may carry a base also where it stands on the ground, and the frames that it moves; T is the base's.
    """

    name: str
    group: Group
    q: np.ndarray
    v: np.ndarray
    in_world: bool = False  # linear velocity, acceleration and force are in world axes, otherwise in its own
    ground: np.ndarray = field(default_factory=lambda: np.eye(4))
    moved: Mapping[str, np.ndarray] = field(default_factory=dict)  # poses in its moved frame
    T: np.ndarray | None = None


@dataclass(frozen=True, eq=False)
class ModelLayout:
    """The vectors of a model: sizes, and joints by name."""

    what: str  # for messages
    labels: tuple[str, str, str, str]  # of position, velocity, acceleration and forces
    nq: int
    nv: int
    rest: np.ndarray  # q of joints that a robot does not have
    places: Mapping[str, JointPlace]
    free: Mapping[str, FreeJointPlace]
    carries: Mapping[str, frozenset[str]]  # bodies, frames and joints beyond each joint, of all kinds


@dataclass(frozen=True, eq=False)
class LayoutMatch:
    """The joints of a robot in a model: indices with their places, and those of several screws, that of a base first.

    Their numbers stand in a whole q of nq numbers, their velocities among nv.
    """

    nq: int
    joints: Mapping[int, JointPlace]
    several: Sequence[tuple[FreeJointPlace, slice, slice]]

    @property
    def in_world(self) -> bool:
        """Whether forces take the pose of a joint, as they are in world axes."""
        return any(joint.in_world for joint, *_ in self.several)


def match_joints(mechanism: Mechanism, layout: ModelLayout) -> LayoutMatch:
    """Return the joints of a robot in a model; raise unless all that move its bodies are joints of both."""
    if mechanism.closure:
        raise JounceError(
            f"{quote_value(mechanism.name)} has closed loops, {layout.what} has the joints of its tree; convert states"
            " of jounce.Robot(robot.mechanism.tree), whose q the closed robot takes as it is"
        )
    joints = {i: layout.places[name] for i, name in enumerate(mechanism.joints) if name in layout.places}
    own = list_multiscrew_joints(mechanism)
    of_several = [name for x in own for name in mechanism.coordinates[x.coordinates]]
    for name in mechanism.coordinates:
        if name not in of_several and (name not in mechanism.joints or name not in layout.places):
            raise unknown_name_error("joint", name, layout.places, layout.what)
    for x in own:
        if layout.free.get(x.name) is None or layout.free[x.name].group is not x.group:
            kind = {name: None for name, joint in layout.free.items() if joint.group is x.group}
            raise unknown_name_error(f"{x.group.name} joint", x.name, kind, layout.what)
    base = _carrier_of_base(mechanism, layout) if mechanism.floats else None
    names = {*mechanism.joints, *(x.name for x in own)}
    known = {*mechanism.frame_names, *names}
    for name, carried in layout.carries.items():
        ours = name in names or (base is not None and layout.free.get(name) is base)
        if not ours and (moved := sorted(carried & known)):
            held = f"joint {quote_value(name)} moves {join_names(moved, most=3)}, which this robot holds"
            floats = "; load it with base='floating'" if name in layout.free and not mechanism.floats else ""
            raise JounceError(f"{layout.what}: {held}{floats or '; expected a model of the same joints'}")
    at, first = 7 * mechanism.floats, 6 * mechanism.floats
    carrier = [] if base is None else [(replace(base, T=base.moved[mechanism.bodies[0]]), slice(0, 7), slice(0, 6))]
    several = [(layout.free[x.name], _shift_slice(x.numbers, at), _shift_slice(x.coordinates, first)) for x in own]
    return LayoutMatch(whole_position_count(mechanism), joints, carrier + several)


def _shift_slice(own: slice, count: int) -> slice:
    return slice(own.start + count, own.stop + count)


def _carrier_of_base(mechanism: Mechanism, layout: ModelLayout) -> FreeJointPlace:
    base = mechanism.bodies[0]
    for joint in layout.free.values():
        if base in joint.moved:
            return joint
    some = join_names(name for joint in layout.free.values() for name in joint.moved) or "none"
    came = f"no floating joint moves {quote_value(base)}, the base of {quote_value(mechanism.name)}"
    raise JounceError(f"{layout.what}: {came}; links on floating joints: {some}")
