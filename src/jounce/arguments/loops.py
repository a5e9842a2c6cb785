"""Check loops, and motors that move several joints, which a caller states; close the robot with them.

`with_loops` is the door of `Robot.closed`: it reads the loops, pairs of frames by name with the joint that is cut
between them, adds them to the tree, and takes coordinates and motors only if these determine the motion at the start.
The place where one end of a loop is held by the ground is where its other end is at the start. `with_transmission` is
the door of motors that move several joints together in the robot's own coordinates. `with_locked` holds coordinates of
a closed robot at values, and closes its loops there.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from jounce.arguments import names
from jounce.arguments.contacts import refuse_contacts
from jounce.core.cures import Remedy
from jounce.core.errors import JounceError, as_list, check_choice, join_names, locate_errors, quote_value, warn
from jounce.core.scalars import asarray, is_numeric
from jounce.dynamics import loop_assembly, loop_closure
from jounce.dynamics.loops import closure_of, movers
from jounce.dynamics.recursion import bodies
from jounce.dynamics.state import BASE_AT_REST
from jounce.model import positions
from jounce.model.elasticity import Motor
from jounce.model.equivalent_mechanisms import to_single_screws
from jounce.model.frame import UNIT_ROUNDING, Frame
from jounce.model.locking import lock_coordinates, warn_of_limits
from jounce.model.loops import DEFAULT_LOOP_AXIS, HELD_DIRECTIONS, Closure, Loop
from jounce.model.mechanism import Mechanism
from jounce.model.transmissions import drive_joints, with_followers, with_named_leaders, with_rotors
from jounce.spatial.lie import rotation
from jounce.spatial.series import column_series

BY_COORDINATES = Remedy("by coordinates=", "as coordinates in its file")
MIN_RATIO_INVERSE_CONDITION = 1e-8  # of ratios that are solved for motors: Q of these keeps half of its digits


def with_loops(
    mechanism: Mechanism,
    loops: object = None,
    actuated: object = None,
    coordinates: object = None,
    start: object = None,
    weights: object = None,
    passive: object = None,
) -> Mechanism:
    """The closed robot of a tree; raise `JounceError` unless its coordinates and motors determine the motion."""
    if mechanism.elasticity is not None:
        first = Remedy("robot.closed(loops, actuated) and then elastic(stiffness)", "a robot with closed loops")
        raise JounceError(f"{mechanism.name!r} has elastic joints; close its loops first: {first}")
    refuse_contacts(mechanism, "loops are closed without")
    flat = with_followers(mechanism)
    driven = actuated is not None and (len(flat.joints) > flat.n or coordinates is not None)
    if loops is None and not mechanism.loops and (mechanism.closure or driven):
        if passive is not None:
            raise JounceError(f"{mechanism.name!r} has no loops; passive= is of robots with loops: leave it out")
        return _drive_followers(flat, mechanism.closure, actuated, coordinates, weights)
    stated = read_loops(flat, loops)
    tree = replace(flat, loops=tuple(x for x in stated if isinstance(x, Loop)))
    tree = to_single_screws(tree, any(meets_ground(tree, x) for x in stated))
    q = _start_configuration(mechanism, tree, start)
    tree = with_stated_loops(tree, stated, q)
    _check_numbers(tree)
    if actuated is None and mechanism.closure and mechanism.loops:
        c = mechanism.closure
        actuated = [c.coordinates[j] for j in c.actuated]
        passive = passive if passive is not None else [mechanism.coordinates[k] for k in c.passive] or None
    motors, own, free = _stated_places(tree, actuated, coordinates, passive)
    closure = Closure(
        coordinates=tree.coordinates,
        G=tree.G,
        g=tree.g,
        independent=own,
        start=q,
        actuated=motors,
        weights=_motor_weights(tree, motors, weights),
        passive=tuple(own.index(j) for j in free),
    )
    closed = replace(tree, G=tree.G[:, own], coordinates=tuple(tree.coordinates[j] for j in own), closure=closure)
    closed = replace(closed, closure=replace(closure, start=loop_assembly.assemble(closed, closure.start)))
    _check_mobility(closed)
    closed = loop_closure.with_ratios(closed)
    if start is not None:
        theta = np.asarray(tree.G @ closure_of(closed).start + tree.g, dtype=float)
        warn_of_limits(tree, range(len(tree.joints)), theta, "starts, where loops are closed, at")
    if idle := [name for name, mover in movers(closed).items() if mover == "nothing"]:
        warn(
            f"{closed.name!r}: nothing but inertia moves {join_names(idle)}, passive without a spring; state one in the"
            f" robot's file{Remedy(', or a motor by actuated=')}"
        )
    return closed


def _stated_places(
    tree: Mechanism, actuated: object, coordinates: object, passive: object
) -> tuple[tuple[int, ...], tuple[int, ...], tuple[int, ...]]:
    """The places of motors, of independent coordinates, passive ones among them, and of these."""
    motors = coordinate_places(tree, "actuated", actuated)
    free = () if passive is None else coordinate_places(tree, "passive", passive)
    if both := [tree.coordinates[j] for j in free if j in motors]:
        raise JounceError(f"passive names {join_names(both)}, which actuated names too; expected it in one of them")
    own = motors if coordinates is None else coordinate_places(tree, "coordinates", coordinates)
    own += tuple(j for j in free if j not in own)
    if len(own) == tree.n:
        raise JounceError(
            f"{tree.name!r}: all {tree.n} coordinates are named, so that none can follow where loops are closed; name"
            f" fewer {Remedy('by coordinates=', 'coordinates in its file')}, or leave out loops that hold nothing"
        )
    return motors, own, free


def _drive_followers(m: Mechanism, c: Closure | None, actuated: Any, coordinates: Any, weights: Any) -> Mechanism:
    """A robot without loops, moved by motors at joints that follow others by constant ratios."""
    positions.check_single_screws(m, "motors at joints that follow others")
    _check_numbers(m)
    named = [name for given in (actuated, coordinates) for name in as_list(given) if isinstance(name, str)]
    if any(name in m.coordinates and name not in m.joints for name in named):
        m = with_named_leaders(m)
    every = replace(m, coordinates=m.joints)
    motors = c.actuated if c and actuated is None else coordinate_places(every, "actuated", actuated)
    own = motors if coordinates is None else coordinate_places(every, "coordinates", coordinates)
    for label, places in (("motors", motors), ("coordinates", own)):
        R, names = m.G[list(places)].astype(float), join_names(m.joints[j] for j in places)
        sizes = np.where(R.any(axis=0), np.abs(R).max(axis=0), 1)
        _, values, ways = np.linalg.svd(R / sizes)
        if len(R) < m.n or values[-1] <= MIN_RATIO_INVERSE_CONDITION * values[0]:
            way = ways[-1] / sizes / (ways[-1] / sizes)[np.abs(ways[-1] / sizes).argmax()]
            free = [f"{x:.4g} {name}" for x, name in zip(way, m.coordinates, strict=True) if abs(x) > 1e-6]
            raise JounceError(
                f"{m.name!r}: {label} {names} at rest leave joints free to move by {join_names(free)}; expected"
                f" {label} that determine the motion, of {m.n} ways"
            )
        if label == "coordinates" and len(own) > m.n:
            raise JounceError(f"{m.name!r} moves in {m.n} ways; name as many of {names} {BY_COORDINATES}")
    given = c.weights if c and actuated is None and weights is None else weights
    return drive_joints(m, motors, own, _motor_weights(every, motors, given))


def with_locked(mechanism: Mechanism, values: Mapping[str, Any]) -> Mechanism:
    """The mechanism with some coordinates locked at values, rad or m, its loops still closed."""
    c = mechanism.closure
    if c is None or not isinstance(values, Mapping):
        return lock_coordinates(mechanism, values)
    for name in values:
        if name in mechanism.joints and name not in mechanism.coordinates:
            raise JounceError(
                f"joint {name!r} cannot be locked: it follows others in closed loops; lock one of"
                f" {join_names(mechanism.coordinates)}{Remedy(', or name it by robot.closed(coordinates=[...]) first')}"
            )
        check_choice("joint to lock", name, mechanism.coordinates)
    places = [j for j, name in enumerate(mechanism.coordinates) if name not in values]
    if not places:
        raise JounceError(f"all {mechanism.n} joints are locked; expected one that moves")
    tree = lock_coordinates(with_followers(mechanism), values)
    u = c.start[list(c.independent)]
    u = np.array([values.get(name, x) for name, x in zip(mechanism.coordinates, u, strict=True)], dtype=float)
    q = dict(zip(c.coordinates, loop_closure.close_loops(mechanism, u[None])[0], strict=True))
    start = {name: q[name] for name in tree.coordinates} if mechanism.loops else None
    weights = dict(zip((c.coordinates[j] for j in c.actuated), c.weights, strict=True))
    left = tree.coordinates if mechanism.loops else tree.joints
    weights = {name: w for name, w in weights.items() if name in left}
    free = [mechanism.coordinates[j] for j in places]
    passive = [name for name in (mechanism.coordinates[k] for k in c.passive) if name not in values]
    closed = with_loops(tree, None, list(weights), free, start, weights, passive or None)
    return replace(closed, elasticity=mechanism.elasticity and mechanism.elasticity.select(places))


def _check_numbers(tree: Mechanism) -> None:
    """Raise `JounceError` if positions at which loops are closed depend on symbols."""
    placed = [tree.B, tree.X, tree.G, tree.g, *(frame.T for loop in tree.loops for frame in (loop.a, loop.b))]
    if not all(is_numeric(asarray(array)) for array in placed):
        raise JounceError(
            f"{tree.name!r} has symbols in its joints or frames; expected numbers there, on which loops are closed;"
            " masses, inertias and gravity may be symbols"
        )


def _check_mobility(m: Mechanism) -> None:
    """Raise `JounceError` unless the independent coordinates, and the motors, determine the motion at the start."""
    c = closure_of(m)
    A = loop_assembly.scaled_constraints(m, c.start[None])[0]
    free = A.shape[1] - np.linalg.matrix_rank(A, rtol=loop_assembly.CONSTRAINT_RANK_TOLERANCE)
    if m.n > free:
        raise JounceError(
            f"{m.name!r} with its loops closed moves in {free} ways, yet {m.n} coordinates are named:"
            f" {join_names(m.coordinates)}; name {free} of them {BY_COORDINATES}, those of more motors"
            f" {Remedy('by actuated=', 'as actuated')}"
        )
    loose = loop_assembly.loose_coordinates(A, c.dependent)
    if loose.any():
        names_of = join_names(c.coordinates[j] for j, moves in zip(c.dependent, loose, strict=True) if moves)
        raise JounceError(
            f"{m.name!r}: {join_names(m.coordinates)} do not determine the motion, of {free} ways at the start: with"
            f" these held {names_of} can move; name {free} joints"
            f" {Remedy('by actuated= or coordinates=, or another start=', 'as actuated or coordinates in its file')}"
        )
    F = loop_assembly.tangent_map(A, c.independent, c.dependent)
    moved = F[np.ix_(c.actuated, c.driven)]
    if np.linalg.matrix_rank(moved, rtol=loop_assembly.CONSTRAINT_RANK_TOLERANCE) < len(c.driven):
        raise JounceError(
            f"{m.name!r}: motors at {join_names(c.coordinates[j] for j in c.actuated)} cannot move all of"
            f" {join_names(m.coordinates[k] for k in c.driven)}; expected {len(c.driven)} or more that determine the"
            f" motion, or {Remedy('passive=[...]', 'passive')} with coordinates that springs or nothing moves"
        )


def coordinate_places(tree: Mechanism, label: str, given: object) -> tuple[int, ...]:
    """The places of coordinates that a caller names, in this order."""
    if isinstance(given, str) or not isinstance(given, Sequence) or not given:
        raise JounceError(f"{label} is {quote_value(given)}; expected a list of joints: {join_names(tree.coordinates)}")
    found = [tree.coordinates.index(check_choice("joint", name, tree.coordinates, label)) for name in given]
    if len(set(found)) < len(found):
        raise JounceError(f"{label} names a joint twice: {join_names(map(str, given))}")
    return tuple(found)


def _start_configuration(mechanism: Mechanism, tree: Mechanism, given: object) -> np.ndarray:
    """The configuration (N,) of a caller's start: by joint name, 0 where a joint is left out, or all coordinates."""
    if given is None:
        c = mechanism.closure if mechanism.loops else None
        given = dict(zip(c.coordinates, c.start, strict=True)) if c else np.zeros(tree.n)
    q = values_per_joint(given, tree.coordinates, 0.0, "joint", "start")
    if q.shape != (tree.n,):
        raise JounceError(f"start has shape {q.shape}; expected ({tree.n},): {join_names(tree.coordinates)}")
    if not is_numeric(q) or not np.isfinite(q).all():
        raise JounceError("start is not finite; expected joint positions, rad or m")
    return q


def _motor_weights(tree: Mechanism, motors: Sequence[int], given: object) -> np.ndarray:
    """The weights of the forces of actuated joints, positive."""
    if given is None:
        return np.ones(len(motors))
    joints = [tree.coordinates[j] for j in motors]
    weights = values_per_joint(given, joints, 1.0, "actuated joint", "weights")
    if weights.shape != (len(motors),) or not is_numeric(weights) or not ((weights > 0) & (weights < np.inf)).all():
        expected = f"positive finite numbers, one for each of {join_names(joints)}"
        raise JounceError(f"weights is {quote_value(given)}; expected {expected}")
    return weights


def values_per_joint(given: object, joints: Sequence[str], default: float, kind: str, label: str) -> np.ndarray:
    """An array with an entry per joint: one as it is given, or of what is given by name, the others `default`."""
    given = names.values_by_name(given)
    if isinstance(given, Mapping):
        for name in given:
            check_choice(kind, name, joints, label)
        given = [given.get(name, default) for name in joints]
    return np.asarray(asarray(given, label))


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


ELECTRIC = ("body", "resistance", "inductance", "constant")  # what a motor states that no drive term is


def with_transmission(m: Mechanism, matrix: object, motors: object, joints: object, offset: object) -> Mechanism:
    """The robot with motors that move some of its joints together, in its own coordinates."""
    if m.elasticity or m.closure or m.loops:
        came = f"{m.name!r} has loops, a transmission or elastic joints"
        raise JounceError(f"{came}; expected a tree of rigid joints, and one matrix for all motors")
    refuse_contacts(m, "drives are coupled without")
    m = with_named_leaders(m)
    stated = _read_motors(m, motors)
    places = range(m.n) if joints is None else coordinate_places(m, "joints", joints)
    moved = [m.coordinates[j] for j in places]
    A, phi0 = asarray(matrix, "matrix"), values_per_joint(offset, [*stated], 0.0, "motor", "offset")
    for label, x, shape in (("matrix", A, (len(stated), len(moved))), ("offset", phi0, (len(stated),))):
        if x.shape not in (shape, () if label == "offset" else shape) or not is_numeric(x) or not np.isfinite(x).all():
            of = f"a row for each of {join_names(stated)}, a column for each of {join_names(moved)}"
            raise JounceError(f"{label} is {quote_value(x.tolist())}; expected finite numbers {shape}: {of}")
    G = np.zeros((len(stated), m.n))
    G[:, list(places)] = A
    # motors take the places of joints; those beyond their number come last
    instead = dict(zip(moved, stated, strict=False))
    actuated = [instead.get(name, name) for name in m.coordinates if name in instead or name not in moved]
    whole = with_rotors(m, stated, G, np.zeros(len(stated)) + phi0)
    return with_loops(whole, actuated=[*actuated, *[*stated][len(moved) :]], coordinates=m.coordinates)


def _read_motors(m: Mechanism, given: object) -> dict[str, Motor | None]:
    """The motors by name, which are not those of joints, and their data."""
    names = as_list(given)
    if not names or not all(isinstance(x, str) for x in names) or len({*names}) < len(names):
        raise JounceError(f"motors is {quote_value(given)}; expected different names, or {{name: jounce.Motor}}")
    found: dict[str, Motor | None] = dict(given) if isinstance(given, Mapping) else dict.fromkeys(names)
    for name, motor in found.items():
        if name in (*m.joints, *m.coordinates) or f"{name}_rotor" in m.frame_names:
            raise JounceError(f"motor {quote_value(name)} or its rotor has the name of a joint or body; rename it")
        if not isinstance(motor, Motor | None):
            raise JounceError(f"motor {quote_value(name)} is {quote_value(motor)}; expected a jounce.Motor, or None")
        if motor and (stated := [x for x in ELECTRIC if getattr(motor, x)]):
            came = f"motor {quote_value(name)} states {join_names(stated)}, of motors on elastic joints"
            raise JounceError(
                f"{came}; expected gear, inertia, damping, friction: robot.closed().elastic() takes the others"
            )
    return found
