"""Locking: joints are held at a value, and their bodies merge into those that carry them.

One pass over the bodies, carriers first: a locked body moves by the pose of its joint at its constant theta into the
frame of its carrier, and its inertia is added there (the parallel-axis theorem); free bodies keep their frames.
Invariant: each frame of the old robot keeps its pose in the world at every configuration of the free coordinates.
Fails where no coordinate is left, where both ends of a loop come to lie on one body, and on overflow.
"""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from jounce.core.errors import JounceError, as_list, check_choice, join_names, quote_value, warn
from jounce.core.scalars import Array, is_finite, is_numeric
from jounce.model import coordinates, positions, screws
from jounce.model.drive_trains import Drives
from jounce.model.frame import Frame
from jounce.model.mechanism import Mechanism
from jounce.model.positions import Position
from jounce.spatial import inertia, lie

LIMIT_SLACK = 1e-3  # of the range of a joint, by which positions may exceed limits: those in files are rounded


def lock_coordinates(mechanism: Mechanism, values: Mapping[str, Any]) -> Mechanism:
    """Return the mechanism with some coordinates locked at values, rad or m.

    Joints that follow only locked coordinates are locked too. A ball, planar or free joint is locked as a whole, at its
    numbers in q.
    """
    if not isinstance(values, Mapping):
        raise JounceError(f"joints to lock are of type {type(values).__name__}; expected a mapping of names and values")
    if len(values) == 0:
        return mechanism
    _check_values(mechanism, values)

    # Split the coordinates into locked and free ones; those of joints of several screws go together.
    multiscrew = positions.multiscrew_joints(mechanism)
    multiscrew_names = {joint.name for joint in multiscrew.values()}
    locked_names = {*values}
    for joint in multiscrew.values():
        if joint.name in values:
            locked_names.update(mechanism.coordinates[joint.coordinates])
    is_locked = [name in locked_names for name in mechanism.coordinates]
    locked, free = np.flatnonzero(is_locked), np.flatnonzero(np.logical_not(is_locked)).tolist()
    if len(free) == 0:
        raise JounceError(f"all {mechanism.n} joints are locked; expected one that moves")

    # theta = G q + g with q = (free, locked): constant coordinates move from G to g. Joints of several screws are 0
    # there, since a pose takes the place of their theta.
    q_locked = np.zeros(mechanism.n)
    for j, name in enumerate(mechanism.coordinates):
        if name in values and name not in multiscrew_names:
            q_locked[j] = float(values[name])
    with np.errstate(all="ignore"):  # what overflows is refused
        g = mechanism.g + mechanism.G[:, locked] @ q_locked[locked]
        names = tuple(mechanism.coordinates[j] for j in free)
        elasticity = None if mechanism.elasticity is None else mechanism.elasticity.select(free)
        reduced = replace(mechanism, G=mechanism.G[:, free], g=g, coordinates=names, elasticity=elasticity)
        # A joint variable without an entry in G is constant: locked itself, or a follower of locked ones only.
        is_constant = [not row.any() for row in reduced.G]
        poses = {
            i: joint.T @ joint.group.pose(np.array(values[joint.name], float)) @ lie.inverse(joint.T)
            for i, joint in multiscrew.items()
            if joint.name in values
        }
        merged = _merge_locked_bodies(reduced, is_constant, poses)

    if is_numeric(g) and is_numeric(mechanism.X):
        warn_of_limits(mechanism, np.flatnonzero(is_constant), g, "is locked at")
    for array in (*merged.arrays.values(), *(frame.T for frame in merged.frames)):
        if is_numeric(array) and not np.isfinite(array).all():
            raise JounceError(f"locking {join_names(values)} overflows: a pose, inertia or offset is not finite")
    for loop in merged.loops:
        if loop.a.body == loop.b.body:
            raise JounceError(
                f"locking {join_names(values)} leaves both ends of loop {loop.name} on one body; lock fewer"
            )
    return merged


def _check_values(mechanism: Mechanism, values: Mapping[str, Any]) -> None:
    """Raise `JounceError` for names or values that cannot be locked."""
    multiscrew = {joint.name: joint for joint in positions.multiscrew_joints(mechanism).values()}
    joint_of = {name: joint for joint in multiscrew.values() for name in mechanism.coordinates[joint.coordinates]}
    single = [name for name in mechanism.coordinates if name not in joint_of]
    for name, value in values.items():
        # One velocity of a ball is no coordinate of its position.
        if name in joint_of:
            joint = joint_of[name]
            at_zero, numbers = joint.group.resting.tolist(), ", ".join(joint.group.positions)
            cure = f"lock all of it, at {numbers}: {{{joint.name!r}: {at_zero}}}"
            raise JounceError(f"{name!r} is one velocity of the {joint.group.name} joint {joint.name!r}; {cure}")
        if name in multiscrew:
            _check_numbers(multiscrew[name], value)
            continue
        if name in mechanism.joints and name not in mechanism.coordinates:
            leaders = np.flatnonzero(mechanism.G[mechanism.joints.index(name)])
            followed = join_names([mechanism.coordinates[j] for j in leaders])
            raise JounceError(f"joint {name!r} cannot be locked: it follows {followed}; lock that")
        check_choice("joint to lock", name, [*single, *multiscrew])
        if not is_finite(value):
            raise JounceError(f"joint {name!r} is locked at {quote_value(value)}; expected a finite number, rad or m")


def warn_of_limits(mechanism: Mechanism, still: Iterable[int], theta: np.ndarray, state: str) -> None:
    """Warn of joints that are held beyond their limits.

    Where the value would be within limits if it were degrees, the warning says so.
    """
    limits, (lower, upper) = mechanism.limits, coordinates.likely_positions(mechanism)
    slack = np.where(np.isfinite(upper - lower), LIMIT_SLACK * (upper - lower), 0)
    revolute = mechanism.X[:, :3].any(axis=1)

    def is_beyond(x: np.ndarray) -> np.ndarray:
        return (x < lower - slack) | (x > upper + slack)

    radians = np.deg2rad(theta)
    joints_beyond = [i for i in still if is_beyond(theta)[i]]
    if len(joints_beyond) == 0:
        return
    # One line names the first joint; the bounds of a joint without limits are four turns.
    i = joints_beyond[0]
    unit = "rad" if revolute[i] else "m"
    has_limits = np.isfinite([limits.lower[i], limits.upper[i]]).any()
    reach = f"its limits are {limits.lower[i]:.6g} to {limits.upper[i]:.6g} {unit}"
    may_be_degrees = revolute[i] and abs(theta[i]) > coordinates.MIN_DEGREES_ANGLE and not is_beyond(radians)[i]
    cure = f"; {theta[i]:.6g} deg are {radians[i]:.6g} rad" if may_be_degrees else ""
    more = f" (and {len(joints_beyond) - 1} more joints)" if len(joints_beyond) > 1 else ""
    came = f"joint {quote_value(mechanism.joints[i])} {state} {theta[i]:.6g} {unit}"
    warn(f"{came}: {reach if has_limits else 'more than four turns'}{cure}{more}")


def _check_numbers(joint: Position, value: object) -> None:
    """Raise `JounceError` unless a value is a joint position.

    The joint has several screws; its rotation must not be 0.
    """
    names, numbers = joint.group.positions, as_list(value)
    if len(numbers) != len(names) or not all(map(is_finite, numbers)) or not any(numbers[len(joint.group.places) :]):
        named = f"{joint.group.name} joint {joint.name!r}"
        raise JounceError(f"{named} is locked at {quote_value(value)}; expected {', '.join(names)}")


def _merge_locked_bodies(mechanism: Mechanism, is_constant: list[bool], poses: Mapping[int, Array]) -> Mechanism:
    """Return the mechanism without the bodies behind locked joints.

    Each locked joint stays at its constant theta, a joint of several screws at its pose, by body.
    """
    # A body is locked if all variables of its joint are; a floating base has none, and is free.
    is_locked = [len(columns) > 0 and all(is_constant[j] for j in columns) for columns in mechanism.columns]
    kept_variables = [j for j, constant in enumerate(is_constant) if not constant]

    # Carriers come first, so that the place of a body follows from that of its parent. `places` holds for each old body
    # the new one and its pose there; the last of the matrices M, of body -1, is that of the ground.
    places: dict[int, Frame] = {-1: Frame("ground", -1, np.eye(4))}
    B: list[Array] = []
    parent: list[int] = []
    M = np.zeros((mechanism.nb + 1, 6, 6), dtype=mechanism.M.dtype)
    for i, p in enumerate(mechanism.parent):
        carrier, name = places[p], mechanism.bodies[i]
        at_zero = carrier.T @ mechanism.B[i]
        if is_locked[i]:
            # exp(X theta) with theta = g, or the pose of a ball, a planar or a free joint.
            j = mechanism.columns[i][0]
            turn = poses[i] if i in poses else lie.exp(mechanism.X[j], mechanism.g[j, None, None])
            places[i] = Frame(name, carrier.body, at_zero @ turn)
        else:
            places[i] = Frame(name, len(B), np.eye(4, dtype=int))
            B.append(at_zero)
            parent.append(carrier.body)
        # Free bodies keep their frames, where the shift is by the identity; others add to the inertia of their carrier.
        M[places[i].body] += inertia.shift_inertia(mechanism.M[i], places[i].T)
    merged = [places[i] for i, locked in enumerate(is_locked) if locked]

    def place_frame(f: Frame) -> Frame:
        return Frame(f.name, places[f.body].body, places[f.body].T @ f.T)

    return replace(
        mechanism,
        B=np.stack([screws.exact_pose(T, "B") for T in B]),  # no rounding of the products, so that a file can hold it
        X=mechanism.X[kept_variables],
        M=np.stack([screws.exact_inertia(M_i, "M") for M_i in M[: len(B)]]) + 0,
        parent=tuple(parent),
        owners=tuple(places[mechanism.owners[j]].body for j in kept_variables),
        G=mechanism.G[kept_variables],
        g=mechanism.g[kept_variables],
        bodies=tuple(name for name, locked in zip(mechanism.bodies, is_locked, strict=True) if not locked),
        joints=tuple(mechanism.joints[j] for j in kept_variables),
        limits=mechanism.limits.select(kept_variables),
        drives=Drives(**{name: array[kept_variables] for name, array in vars(mechanism.drives).items()}),
        frames=(*merged, *map(place_frame, mechanism.frames)),
        loops=tuple(replace(loop, a=place_frame(loop.a), b=place_frame(loop.b)) for loop in mechanism.loops),
    )
