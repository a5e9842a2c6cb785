"""Check the loops and motors that a caller states; close robots.

`with_loops` is the door of `Robot.closed`. It reads the loops, pairs of frames by name with the joint that is cut
between them, and adds them to the tree. It takes coordinates and motors only if these determine the motion at the
start. Where the ground holds one end of a loop, this end is where the other end is at the start. `with_locked` holds
coordinates of a closed robot at values, and closes its loops there.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
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
from jounce.model.equivalent_mechanisms import to_single_screws
from jounce.model.frame import UNIT_ROUNDING, Frame
from jounce.model.locking import lock_coordinates, warn_of_limits
from jounce.model.loops import DEFAULT_LOOP_AXIS, HELD_DIRECTIONS, Closure, Loop
from jounce.model.mechanism import Mechanism, with_closure
from jounce.model.polynomials import PolynomialLaw, polynomial_laws, with_polynomials
from jounce.model.transmissions import drive_joints, with_followers, with_named_leaders
from jounce.spatial.lie import rotation
from jounce.spatial.series import column_series

BY_COORDINATES = Remedy("by coordinates=", "as coordinates in its file")
MIN_RATIO_INVERSE_CONDITION = 1e-8  # of ratios that are solved for motors: Q of these keeps half of its digits


@dataclass(frozen=True, kw_only=True)
class ClosureParameters:
    """The arguments of `Robot.closed`, unchecked."""

    loops: object = None
    actuated: object = None
    coordinates: object = None
    start: object = None
    weights: object = None
    passive: object = None
    finds_passive: bool = False  # whether coordinates that motors leave loose become passive, as files do not name them


def with_loops(mechanism: Mechanism, parameters: ClosureParameters) -> Mechanism:
    """Return the closed robot of a tree.

    Raises `JounceError` unless its coordinates and motors determine the motion.
    """
    actuated, coordinates, passive = parameters.actuated, parameters.coordinates, parameters.passive
    if mechanism.elasticity is not None:
        first = Remedy("robot.closed(loops, actuated) and then elastic(stiffness)", "a robot with closed loops")
        raise JounceError(f"{mechanism.name!r} has elastic joints; close its loops first: {first}")
    refuse_contacts(mechanism, "loops are closed without")
    if not mechanism.has_constant_ratios:
        followers = join_names(polynomial_laws(mechanism))
        raise JounceError(
            f"{mechanism.name!r}: {followers} follow by polynomials, without any loops, and without other"
            f" motors than those at {join_names(mechanism.coordinates)}"
        )
    # A robot without loops whose joints follow others by constant ratios needs no constraints, only its motors' places.
    flat = with_followers(mechanism)
    is_driven = actuated is not None and (len(flat.joints) > flat.n or coordinates is not None)
    if parameters.loops is None and len(mechanism.loops) == 0 and (mechanism.closure is not None or is_driven):
        if passive is not None:
            raise JounceError(f"{mechanism.name!r} has no loops; passive= is of robots with loops: leave it out")
        return _drive_followers(flat, mechanism.closure, parameters)
    # The tree gets its loops. Constraints are rows by joint screw: joints of several screws become chains, and a base
    # that a loop holds to the ground becomes a joint.
    stated_loops = read_loops(flat, parameters.loops)
    tree = replace(flat, loops=tuple(x for x in stated_loops if isinstance(x, Loop)))
    tree = to_single_screws(tree, any(meets_ground(tree, x) for x in stated_loops))
    q = _start_configuration(mechanism, tree, parameters.start)
    tree = with_stated_loops(tree, stated_loops, q)
    _check_numbers(tree)
    # A robot that is closed already keeps its motors and passive coordinates unless others are stated.
    if actuated is None and mechanism.closure is not None and len(mechanism.loops) > 0:
        c = mechanism.closure
        actuated = [c.coordinates[j] for j in c.actuated]
        if passive is None and len(c.passive) > 0:
            passive = [mechanism.coordinates[k] for k in c.passive]
    motors, independent, free = _stated_places(tree, actuated, coordinates, passive)
    if parameters.finds_passive:
        free = _loose_places(tree, motors, q)
        independent += tuple(j for j in free if j not in independent)
    # The loops are closed near the start, and the motion is checked there.
    closed = _assemble_loops(tree, motors, independent, q)
    closure = replace(
        closure_of(closed),
        weights=_motor_weights(tree, motors, parameters.weights),
        passive=tuple(independent.index(j) for j in free),
    )
    closed = replace(closed, closure=closure)
    _check_mobility(closed)
    # Joints that follow by constant ratios, as in parallelograms, leave the constraints.
    closed = loop_closure.with_ratios(closed)
    if parameters.start is not None:
        theta = np.asarray(tree.G @ closure_of(closed).start + tree.g, dtype=float)
        warn_of_limits(tree, range(len(tree.joints)), theta, "starts, where loops are closed, at")
    idle = [name for name, mover in movers(closed).items() if mover == "nothing"]
    if len(idle) > 0:
        warn(
            f"{closed.name!r}: nothing but inertia moves {join_names(idle)}, passive without a spring; state one in the"
            f" robot's file{Remedy(', or a motor by actuated=, or hold them by robot.locked', ', or --lock them')}"
        )
    return closed


def _assemble_loops(tree: Mechanism, motors: Sequence[int], independent: Sequence[int], start: np.ndarray) -> Mechanism:
    """Return the closed robot of a tree, from a start (N,)."""
    closure = Closure(
        coordinates=tree.coordinates,
        G=tree.G,
        g=tree.g,
        independent=tuple(independent),
        start=start,
        actuated=tuple(motors),
        weights=np.ones(len(motors)),
    )
    closed = with_closure(tree, closure)
    return replace(closed, closure=replace(closure, start=loop_assembly.assemble(closed, start)))


def _loose_places(tree: Mechanism, motors: Sequence[int], start: np.ndarray) -> tuple[int, ...]:
    """Return the places of coordinates that can move while all motors rest.

    They determine, with the motors, the motion at the start; those with springs come before others.
    """
    closed = _assemble_loops(tree, motors, motors, start)
    A = loop_assembly.scaled_constraints(closed, closure_of(closed).start[None])[0]
    has_spring = (tree.drives.stiffness[:, None] * tree.G != 0).any(axis=0)
    return loop_assembly.loose_basis(A, motors, np.flatnonzero(has_spring).tolist())


def _stated_places(
    tree: Mechanism, actuated: object, coordinates: object, passive: object
) -> tuple[tuple[int, ...], tuple[int, ...], tuple[int, ...]]:
    """Return the places of motors, independent and passive coordinates.

    Passive coordinates are among the independent ones.
    """
    motors = coordinate_places(tree, "actuated", actuated)
    free = () if passive is None else coordinate_places(tree, "passive", passive)
    named_twice = [tree.coordinates[j] for j in free if j in motors]
    if len(named_twice) > 0:
        raise JounceError(
            f"passive names {join_names(named_twice)}, which actuated names too; expected it in one of them"
        )
    independent = motors if coordinates is None else coordinate_places(tree, "coordinates", coordinates)
    independent += tuple(j for j in free if j not in independent)
    if len(independent) == tree.n:
        raise JounceError(
            f"{tree.name!r}: all {tree.n} coordinates are named, so that none can follow where loops are closed; name"
            f" fewer {Remedy('by coordinates=', 'coordinates in its file')}, or leave out loops that hold nothing"
        )
    return motors, independent, free


def _drive_followers(m: Mechanism, c: Closure | None, parameters: ClosureParameters) -> Mechanism:
    """Return a robot without loops, with motors at joints that follow others.

    These joints follow by constant ratios; `c` is the closure that the robot has already.
    """
    actuated: Any = parameters.actuated
    coordinates: Any = parameters.coordinates
    positions.check_single_screws(m, "motors at joints that follow others")
    _check_numbers(m)
    stated_names = [*as_list(actuated), *as_list(coordinates)]
    if any(isinstance(name, str) and name in m.coordinates and name not in m.joints for name in stated_names):
        m = with_named_leaders(m)
    # Motors and coordinates may be at any joint, so that all joints are coordinates while places are looked up.
    whole = replace(m, coordinates=m.joints)
    keeps_motors = c is not None and actuated is None
    motors = c.actuated if c is not None and keeps_motors else coordinate_places(whole, "actuated", actuated)
    independent = motors if coordinates is None else coordinate_places(whole, "coordinates", coordinates)
    for label, places in (("motors", motors), ("coordinates", independent)):
        _check_determine_motion(m, label, places)
    weights = c.weights if c is not None and keeps_motors and parameters.weights is None else parameters.weights
    return drive_joints(m, motors, independent, _motor_weights(whole, motors, weights))


def _check_determine_motion(m: Mechanism, label: str, places: Sequence[int]) -> None:
    """Raise `JounceError` unless joints at some places determine the motion."""
    # Their ratios R (k, n) to the coordinates have rank n; columns are scaled, since units differ.
    R, names_of_joints = m.G[list(places)].astype(float), join_names(m.joints[j] for j in places)
    sizes = np.where(R.any(axis=0), np.abs(R).max(axis=0), 1)
    _, values, ways = np.linalg.svd(R / sizes)
    if len(R) < m.n or values[-1] <= MIN_RATIO_INVERSE_CONDITION * values[0]:
        # The last right singular vector is the motion that remains while these joints rest.
        way = ways[-1] / sizes / (ways[-1] / sizes)[np.abs(ways[-1] / sizes).argmax()]
        free = [f"{x:.4g} {name}" for x, name in zip(way, m.coordinates, strict=True) if abs(x) > 1e-6]
        raise JounceError(
            f"{m.name!r}: {label} {names_of_joints} at rest leave joints free to move by {join_names(free)}; expected"
            f" {label} that determine the motion, of {m.n} ways"
        )
    if label == "coordinates" and len(places) > m.n:
        raise JounceError(f"{m.name!r} moves in {m.n} ways; name as many of {names_of_joints} {BY_COORDINATES}")


def with_locked(mechanism: Mechanism, values: Mapping[str, Any]) -> Mechanism:
    """Return the mechanism with some coordinates locked at values, rad or m.

    Its loops stay closed.
    """
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
    if len(places) == 0:
        raise JounceError(f"all {mechanism.n} joints are locked; expected one that moves")
    if not mechanism.has_constant_ratios:
        return _lock_leaders(mechanism, values)
    tree = lock_coordinates(with_followers(mechanism), values)
    has_loops = len(mechanism.loops) > 0
    # The start of the locked robot is where the loops close with these coordinates at their values.
    u = c.start[list(c.independent)]
    u = np.array([values.get(name, x) for name, x in zip(mechanism.coordinates, u, strict=True)], dtype=float)
    q = dict(zip(c.coordinates, loop_closure.close_loops(mechanism, u[None])[0], strict=True))
    start = {name: q[name] for name in tree.coordinates} if has_loops else None
    # Motors at joints that are locked go with their weights.
    movable = tree.coordinates if has_loops else tree.joints
    weights = dict(zip((c.coordinates[j] for j in c.actuated), c.weights, strict=True))
    weights = {name: weight for name, weight in weights.items() if name in movable}
    passive = [mechanism.coordinates[k] for k in c.passive if mechanism.coordinates[k] not in values]
    parameters = ClosureParameters(
        actuated=list(weights),
        coordinates=[mechanism.coordinates[j] for j in places],
        start=start,
        weights=weights,
        passive=passive if len(passive) > 0 else None,
    )
    closed = with_loops(tree, parameters)
    e = mechanism.elasticity
    return closed if e is None else replace(closed, elasticity=e.select(places))


def _lock_leaders(mechanism: Mechanism, values: Mapping[str, Any]) -> Mechanism:
    """Return a robot whose leaders of polynomials are locked in part.

    Followers of a locked coordinate are locked where their laws place them.
    """
    places: dict[str, float] = {}
    others: dict[str, PolynomialLaw] = {}
    for name, law in polynomial_laws(mechanism).items():
        if law.leader in values:
            places[name] = float(np.polyval(law.coefficients[::-1], values[law.leader]))
        else:
            others[name] = law
    locked = lock_coordinates(mechanism.tree, {**values, **places})
    return with_polynomials(locked, others) if len(others) > 0 else locked


def _check_numbers(tree: Mechanism) -> None:
    """Raise `JounceError` if positions at which loops are closed depend on symbols."""
    placing_arrays = [tree.B, tree.X, tree.G, tree.g, *(frame.T for loop in tree.loops for frame in (loop.a, loop.b))]
    if not all(is_numeric(asarray(array)) for array in placing_arrays):
        raise JounceError(
            f"{tree.name!r} has symbols in its joints or frames; expected numbers there, on which loops are closed;"
            " masses, inertias and gravity may be symbols"
        )


def _check_mobility(m: Mechanism) -> None:
    """Raise `JounceError` unless coordinates and motors determine the motion.

    The independent coordinates, and the motors too, have to determine it at the start.
    """
    c = closure_of(m)
    # A q' = 0 leaves as many ways to move as A (c, N) lacks in rank.
    A = loop_assembly.scaled_constraints(m, c.start[None])[0]
    free = A.shape[1] - np.linalg.matrix_rank(A, rtol=loop_assembly.CONSTRAINT_RANK_TOLERANCE)
    if m.n > free:
        raise JounceError(
            f"{m.name!r} with its loops closed moves in {free} ways, yet {m.n} coordinates are named:"
            f" {join_names(m.coordinates)}; name {free} of them {BY_COORDINATES}, those of more motors"
            f" {Remedy('by actuated=', 'as actuated')}"
        )
    # With the independent coordinates at rest no other coordinate moves.
    loose = loop_assembly.loose_coordinates(A, c.dependent)
    if loose.any():
        loose_names = join_names(c.coordinates[j] for j, moves in zip(c.dependent, loose, strict=True) if moves)
        raise JounceError(
            f"{m.name!r}: {join_names(m.coordinates)} do not determine the motion, of {free} ways at the start: with"
            f" these held {loose_names} can move; name {free} joints"
            f" {Remedy('by actuated= or coordinates=, or another start=', 'as actuated or coordinates in its file')}"
        )
    # The motors move all coordinates that are not passive: their rows of F (N, n) have full rank.
    F = loop_assembly.tangent_map(A, c.independent, c.dependent)
    motor_rows = F[np.ix_(c.actuated, c.driven)]
    if np.linalg.matrix_rank(motor_rows, rtol=loop_assembly.CONSTRAINT_RANK_TOLERANCE) < len(c.driven):
        raise JounceError(
            f"{m.name!r}: motors at {join_names(c.coordinates[j] for j in c.actuated)} cannot move all of"
            f" {join_names(m.coordinates[k] for k in c.driven)}; expected {len(c.driven)} or more that determine the"
            f" motion, or {Remedy('passive=[...]', 'passive')} with coordinates that springs or nothing moves"
        )


def coordinate_places(tree: Mechanism, label: str, joints: object) -> tuple[int, ...]:
    """Return the places of coordinates that a caller names, in this order."""
    if isinstance(joints, str) or not isinstance(joints, Sequence) or len(joints) == 0:
        raise JounceError(
            f"{label} is {quote_value(joints)}; expected a list of joints: {join_names(tree.coordinates)}"
        )
    places = [tree.coordinates.index(check_choice("joint", name, tree.coordinates, label)) for name in joints]
    if len(set(places)) < len(places):
        raise JounceError(f"{label} names a joint twice: {join_names(map(str, joints))}")
    return tuple(places)


def _start_configuration(mechanism: Mechanism, tree: Mechanism, start: object) -> np.ndarray:
    """Return the configuration (N,) of a caller's start.

    The start is by joint name, 0 where a joint is left out, or an array of all coordinates. None is the start of a
    robot whose loops are closed already, or zeros.
    """
    if start is None:
        c = mechanism.closure if len(mechanism.loops) > 0 else None
        start = np.zeros(tree.n) if c is None else dict(zip(c.coordinates, c.start, strict=True))
    q = values_per_joint(start, tree.coordinates, 0.0, "joint", "start")
    if q.shape != (tree.n,):
        raise JounceError(f"start has shape {q.shape}; expected ({tree.n},): {join_names(tree.coordinates)}")
    if not is_numeric(q) or not np.isfinite(q).all():
        raise JounceError("start is not finite; expected joint positions, rad or m")
    return q


def _motor_weights(tree: Mechanism, motors: Sequence[int], stated_weights: object) -> np.ndarray:
    """Return the weights of the forces of actuated joints, positive."""
    if stated_weights is None:
        return np.ones(len(motors))
    joints = [tree.coordinates[j] for j in motors]
    weights = values_per_joint(stated_weights, joints, 1.0, "actuated joint", "weights")
    if weights.shape != (len(motors),) or not is_numeric(weights) or not ((weights > 0) & (weights < np.inf)).all():
        expected = f"positive finite numbers, one for each of {join_names(joints)}"
        raise JounceError(f"weights is {quote_value(stated_weights)}; expected {expected}")
    return weights


def values_per_joint(values: object, joints: Sequence[str], default: float, kind: str, label: str) -> np.ndarray:
    """Return an array with an entry per joint.

    A caller gives the array itself, or values by name, `default` for the others.
    """
    values = names.values_by_name(values)
    if isinstance(values, Mapping):
        for name in values:
            check_choice(kind, name, joints, label)
        values = [values.get(name, default) for name in joints]
    return np.asarray(asarray(values, label))


AXIAL_FREE = ("spherical", "fixed")  # joints without an axis
GROUND = "ground"  # in place of a frame: the other one is held where it is at the start


def read_loops(tree: Mechanism, loops: object) -> Sequence[Any]:
    """Return the loops that a caller gives.

    They are pairs of frames, with or without the joint between them and its axis.
    """
    if loops is None:
        if len(tree.loops) == 0:
            raise JounceError(f"{tree.name!r} states no loops; expected loops=[(frame_a, frame_b), ...]")
        return tree.loops
    if not isinstance(loops, Sequence) or isinstance(loops, str) or len(loops) == 0:
        raise JounceError(f"loops is {quote_value(loops)}; expected [(frame_a, frame_b), ...]")
    for k, x in enumerate(loops):
        is_tuple = isinstance(x, Sequence) and not isinstance(x, str) and 2 <= len(x) <= 4
        if not isinstance(x, Loop) and not is_tuple:
            expected = "(frame_a, frame_b), with a joint and its axis or without"
            raise JounceError(f"loops[{k}] is {quote_value(x)}; expected {expected}")
    return loops


def meets_ground(tree: Mechanism, loop: Any) -> bool:
    """Return whether a loop has an end on the ground.

    It is a loop, or a tuple that a caller states.
    """
    if isinstance(loop, Loop):
        return -1 in (loop.a.body, loop.b.body)
    return any(name == GROUND or (name in tree.frame_names and tree.frame(name).body < 0) for name in loop[:2])


def with_stated_loops(tree: Mechanism, stated_loops: Sequence[Any], start: np.ndarray) -> Mechanism:
    """Return the tree with its loops.

    Loops that the tree has already are taken in their order; others are built between frames by name.
    """
    loops_of_tree, loops = iter(tree.loops), list[Loop]()
    for k, x in enumerate(stated_loops):
        with locate_errors(f"loops[{k}]"):
            loop = next(loops_of_tree) if isinstance(x, Loop) else _build_held(tree, x, start)
        loops.append(loop)
    # Both ends of a loop become frames of the tree; a name stands for one place.
    ends = [frame for loop in loops for frame in (loop.a, loop.b) if frame.name not in tree.bodies]
    frames = {frame.name: frame for frame in (*tree.frames, *ends)}
    at_two_places = [frame.name for frame in ends if not np.array_equal(frame.T, frames[frame.name].T)]
    if len(at_two_places) > 0:
        raise JounceError(f"loops state {quote_value(at_two_places[0])} at two places; leave one of them out")
    return replace(tree, frames=tuple(frames.values()), loops=tuple(loops))


def _build_held(tree: Mechanism, stated_loop: Sequence[Any], start: np.ndarray) -> Loop:
    """Return the loop between frames by name.

    The axis is in the axes of the first frame, or in inertial axes where this frame is the ground.
    """
    a, b = _find_ends(tree, stated_loop[:2], start)
    loop = build_loop(tree, a, b, *stated_loop[2:])
    # The frame on the ground has the axes of the other end at the start: R^T turns inertial axes into these.
    if stated_loop[0] == GROUND and a.name != GROUND and loop.joint not in AXIAL_FREE:
        return replace(loop, axis=rotation(a.T).T @ loop.axis)
    return loop


def _find_ends(tree: Mechanism, names: Sequence[Any], start: np.ndarray) -> list[Frame]:
    """Return the frames of both ends of a loop.

    Where one is the ground, its frame is where the other end is at the start.
    """
    ends = [None if name == GROUND and name not in tree.frame_names else tree.frame(name) for name in names]
    moving_end = next((frame for frame in ends if frame is not None), None)
    if moving_end is None:
        raise JounceError(f"both ends are the ground; available: {', '.join(tree.frame_names)}")
    pose_world_from_body = bodies.poses(tree, column_series([start]), BASE_AT_REST, moving_end.body)[0]
    ground_end = Frame(f"{GROUND}:{moving_end.name}", -1, pose_world_from_body @ moving_end.T)
    return [ground_end if frame is None else frame for frame in ends]


def build_loop(tree: Mechanism, a: Any, b: Any, joint: Any = "spherical", axis: Any = DEFAULT_LOOP_AXIS) -> Loop:
    """Return the loop that is cut at a joint between two frames.

    The frames of the tree are given by name.
    """
    frames = [frame if isinstance(frame, Frame) else tree.frame(frame) for frame in (a, b)]
    if frames[0].body == frames[1].body:
        both_names = " and ".join(quote_value(frame.name) for frame in frames)
        raise JounceError(f"frames {both_names} are on one body; expected frames on two bodies")
    check_choice("joint", joint, HELD_DIRECTIONS)
    direction = np.array(asarray(axis, "axis"), dtype=float)
    if direction.shape != (3,) or not np.isfinite(direction).all() or not direction.any():
        raise JounceError(
            f"axis is {quote_value(axis)}; expected a direction (3,) in the axes of frame {quote_value(frames[0].name)}"
        )
    if joint in AXIAL_FREE:
        direction = np.array(DEFAULT_LOOP_AXIS, dtype=float)
    # A direction that a file states has the length 1 but for rounding: it stays as it was written.
    length = np.linalg.norm(direction)
    unit_axis = direction if abs(length - 1) < UNIT_ROUNDING else direction / length
    return Loop(frames[0], frames[1], joint, unit_axis)
