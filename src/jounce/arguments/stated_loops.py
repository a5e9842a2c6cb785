"""The loops that a caller states, as pairs of frames by name, or of a frame and the ground that holds it."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from jounce.core.errors import JounceError, check_choice, locate_errors, quote_value
from jounce.core.scalars import asarray
from jounce.dynamics.recursion import bodies
from jounce.dynamics.state import BASE_AT_REST
from jounce.model.frame import UNIT_ROUNDING, Frame
from jounce.model.loops import DEFAULT_LOOP_AXIS, HELD_DIRECTIONS, Loop
from jounce.model.mechanism import Mechanism
from jounce.spatial.lie import rotation
from jounce.spatial.series import column_series

AXIAL_FREE = ("spherical", "fixed")  # joints without an axis
GROUND = "ground"  # in place of a frame: the other one is held where it is at the start


def read_loops(tree: Mechanism, given: object) -> Sequence[Any]:
    """The loops that a caller gives: pairs of frames, with the joint between them and its axis or without."""
    if given is None:
        if not tree.loops:
            raise JounceError(f"{tree.name!r} states no loops; expected loops=[(frame_a, frame_b), ...]")
        return tree.loops
    if not isinstance(given, Sequence) or isinstance(given, str) or not given:
        raise JounceError(f"loops is {quote_value(given)}; expected [(frame_a, frame_b), ...]")
    for k, x in enumerate(given):
        if not isinstance(x, Loop) and (not isinstance(x, Sequence) or isinstance(x, str) or not 2 <= len(x) <= 4):
            expected = "(frame_a, frame_b), with a joint and its axis or without"
            raise JounceError(f"loops[{k}] is {quote_value(x)}; expected {expected}")
    return given


def meets_ground(tree: Mechanism, loop: Any) -> bool:
    """Whether a loop, or one that a caller states, has an end on the ground."""
    if isinstance(loop, Loop):
        return -1 in (loop.a.body, loop.b.body)
    return any(name == GROUND or (name in tree.frame_names and tree.frame(name).body < 0) for name in loop[:2])


def with_stated_loops(tree: Mechanism, stated: Sequence[Any], start: np.ndarray) -> Mechanism:
    """The tree with its loops: those of frames in the tree in their order, others between frames by name."""
    ready, loops = iter(tree.loops), list[Loop]()
    for k, x in enumerate(stated):
        with locate_errors(f"loops[{k}]"):
            found = next(ready) if isinstance(x, Loop) else _build_held(tree, x, start)
        loops.append(found)
    ends = [frame for loop in loops for frame in (loop.a, loop.b) if frame.name not in tree.bodies]
    frames = {frame.name: frame for frame in (*tree.frames, *ends)}
    if moved := [frame.name for frame in ends if not np.array_equal(frame.T, frames[frame.name].T)]:
        raise JounceError(f"loops state {quote_value(moved[0])} at two places; leave one of them out")
    return replace(tree, frames=tuple(frames.values()), loops=tuple(loops))


def _build_held(tree: Mechanism, stated: Sequence[Any], start: np.ndarray) -> Loop:
    """The loop between frames by name; the axis is in the first one, in inertial axes where that is the ground."""
    a, b = _find_ends(tree, stated[:2], start)
    loop = build_loop(tree, a, b, *stated[2:])
    of_ground = stated[0] == GROUND and a.name != GROUND and loop.joint not in AXIAL_FREE
    return replace(loop, axis=rotation(a.T).T @ loop.axis) if of_ground else loop


def _find_ends(tree: Mechanism, names: Sequence[Any], start: np.ndarray) -> list[Frame]:
    """The frames of both ends of a loop; where one is the ground, it is where the other end is at the start."""
    ends = [None if name == GROUND and name not in tree.frame_names else tree.frame(name) for name in names]
    for held in filter(None, ends):
        C = bodies.poses(tree, column_series([start]), BASE_AT_REST, held.body)[0]
        return [frame or Frame(f"{GROUND}:{held.name}", -1, C @ held.T) for frame in ends]
    raise JounceError(f"both ends are the ground; available: {', '.join(tree.frame_names)}")


def build_loop(tree: Mechanism, a: Any, b: Any, joint: Any = "spherical", axis: Any = DEFAULT_LOOP_AXIS) -> Loop:
    """The loop that is cut at a joint between two frames of a tree, given by name."""
    frames = [frame if isinstance(frame, Frame) else tree.frame(frame) for frame in (a, b)]
    if frames[0].body == frames[1].body:
        names = " and ".join(quote_value(frame.name) for frame in frames)
        raise JounceError(f"frames {names} are on one body; expected frames on two")
    check_choice("joint", joint, HELD_DIRECTIONS)
    along = np.array(asarray(axis, "axis"), dtype=float)
    if along.shape != (3,) or not np.isfinite(along).all() or not along.any():
        raise JounceError(
            f"axis is {quote_value(axis)}; expected a direction (3,) in the axes of frame {quote_value(frames[0].name)}"
        )
    if joint in AXIAL_FREE:
        along = np.array(DEFAULT_LOOP_AXIS, dtype=float)
    length = np.linalg.norm(along)  # of what a file states, 1 but for rounding: it is read as it was written
    return Loop(frames[0], frames[1], joint, along if abs(length - 1) < UNIT_ROUNDING else along / length)
