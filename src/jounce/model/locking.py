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
    """Return the mechanism with some coordinates locked at values, rad or m; joints that follow only these too.

    A ball, planar or free joint is locked as a whole, at its numbers in q.
    """
    if not isinstance(values, Mapping):
        raise JounceError(f"joints to lock are of type {type(values).__name__}; expected a mapping of names and values")
    if not values:
        return mechanism
    wholes = {x.name: (i, x) for i, x in positions.multiscrew_joints(mechanism).items()}
    of = {name: x for _, x in wholes.values() for name in mechanism.coordinates[x.coordinates]}
    single = [name for name in mechanism.coordinates if name not in of]
    for name, value in values.items():
        if name in of:
            x = of[name]
            at_zero, said = x.group.resting.tolist(), ", ".join(x.group.positions)
            cure = f"lock all of it, at {said}: {{{x.name!r}: {at_zero}}}"
            raise JounceError(f"{name!r} is one velocity of the {x.group.name} joint {x.name!r}; {cure}")
        if name in wholes:
            _check_numbers(wholes[name][1], value)
            continue
        if name in mechanism.joints and name not in mechanism.coordinates:
            leaders = np.flatnonzero(mechanism.G[mechanism.joints.index(name)])
            said = join_names([mechanism.coordinates[j] for j in leaders])
            raise JounceError(f"joint {name!r} cannot be locked: it follows {said}; lock that")
        check_choice("joint to lock", name, [*single, *wholes])
        if not is_finite(value):
            raise JounceError(f"joint {name!r} is locked at {quote_value(value)}; expected a finite number, rad or m")
    at = np.zeros(mechanism.n)
    for name in set(values) - set(wholes):
        at[mechanism.coordinates.index(name)] = float(values[name])
    welds = {i: x for name, (i, x) in wholes.items() if name in values}
    held = [name in values or (name in of and of[name].name in values) for name in mechanism.coordinates]
    places, free = np.flatnonzero(held), np.flatnonzero(np.logical_not(held)).tolist()
    if not free:
        raise JounceError(f"all {mechanism.n} joints are locked; expected one that moves")
    with np.errstate(all="ignore"):  # what overflows is refused
        g = mechanism.g + mechanism.G[:, places] @ at[places]
        names = tuple(mechanism.coordinates[j] for j in free)
        elasticity = mechanism.elasticity and mechanism.elasticity.select(free)
        slower = replace(mechanism, G=mechanism.G[:, free], g=g, coordinates=names, elasticity=elasticity)
        still = [not row.any() for row in slower.G]
        poses = {i: x.T @ x.group.pose(np.array(values[x.name], float)) @ lie.inverse(x.T) for i, x in welds.items()}
        welded = _merge_locked_bodies(slower, still, poses)
    if is_numeric(g) and is_numeric(mechanism.X):
        warn_of_limits(mechanism, np.flatnonzero(still), g, "is locked at")
    for array in (*welded.arrays.values(), *(frame.T for frame in welded.frames)):
        if is_numeric(array) and not np.isfinite(array).all():
            raise JounceError(f"locking {join_names(values)} overflows: a pose, inertia or offset is not finite")
    for loop in welded.loops:
        if loop.a.body == loop.b.body:
            raise JounceError(
                f"locking {join_names(values)} leaves both ends of loop {loop.name} on one body; lock fewer"
            )
    return welded


def warn_of_limits(mechanism: Mechanism, still: Iterable[int], theta: np.ndarray, state: str) -> None:
    """Warn of joints that are held beyond their limits, and name the angle that degrees would mean if it is within."""
    limits, (lower, upper) = mechanism.limits, coordinates.likely_positions(mechanism)
    slack = np.where(np.isfinite(upper - lower), LIMIT_SLACK * (upper - lower), 0)
    revolute = mechanism.X[:, :3].any(axis=1)

    def is_beyond(x: np.ndarray) -> np.ndarray:
        return (x < lower - slack) | (x > upper + slack)

    radians = np.deg2rad(theta)
    if found := [i for i in still if is_beyond(theta)[i]]:
        i, unit = found[0], "rad" if revolute[found[0]] else "m"
        stated = np.isfinite([limits.lower[i], limits.upper[i]]).any()
        reach = f"its limits are {limits.lower[i]:.6g} to {limits.upper[i]:.6g} {unit}"
        turns = revolute[i] and abs(theta[i]) > coordinates.MIN_DEGREES_ANGLE and not is_beyond(radians)[i]
        cure = f"; {theta[i]:.6g} deg are {radians[i]:.6g} rad" if turns else ""
        more = f" (and {len(found) - 1} more joints)" if found[1:] else ""
        came = f"joint {quote_value(mechanism.joints[i])} {state} {theta[i]:.6g} {unit}"
        warn(f"{came}: {reach if stated else 'more than four turns'}{cure}{more}")


def _check_numbers(joint: Position, value: object) -> None:
    names, numbers = joint.group.positions, as_list(value)
    if len(numbers) != len(names) or not all(map(is_finite, numbers)) or not any(numbers[len(joint.group.places) :]):
        named = f"{joint.group.name} joint {joint.name!r}"
        raise JounceError(f"{named} is locked at {quote_value(value)}; expected {', '.join(names)}")


def _merge_locked_bodies(mechanism: Mechanism, still: list[bool], poses: Mapping[int, Array]) -> Mechanism:
    """Return the mechanism without its locked joints, each at its constant theta; those of several screws at a pose."""
    held = [bool(columns) and all(still[j] for j in columns) for columns in mechanism.columns]
    kept = [j for j, welded in enumerate(still) if not welded]
    places: dict[int, Frame] = {-1: Frame("ground", -1, np.eye(4))}  # where each old body sits
    B: list[Array] = []
    parent: list[int] = []
    M = np.zeros((mechanism.nb + 1, 6, 6), dtype=mechanism.M.dtype)  # the last is of the ground
    for i, p in enumerate(mechanism.parent):
        carrier, name = places[p], mechanism.bodies[i]
        at_zero = carrier.T @ mechanism.B[i]
        if held[i]:
            j = mechanism.columns[i][0]
            turn = poses[i] if i in poses else lie.exp(mechanism.X[j], mechanism.g[j, None, None])
            places[i] = Frame(name, carrier.body, at_zero @ turn)
        else:
            places[i] = Frame(name, len(B), np.eye(4, dtype=int))
            B.append(at_zero)
            parent.append(carrier.body)
        M[places[i].body] += inertia.shift_inertia(mechanism.M[i], places[i].T)
    merged = [places[i] for i, welded in enumerate(held) if welded]

    def moved(f: Frame) -> Frame:
        return Frame(f.name, places[f.body].body, places[f.body].T @ f.T)

    return replace(
        mechanism,
        B=np.stack([screws.exact_pose(T, "B") for T in B]),  # no rounding of the products, so that a file can hold it
        X=mechanism.X[kept],
        M=np.stack([screws.exact_inertia(M_i, "M") for M_i in M[: len(B)]]) + 0,
        parent=tuple(parent),
        owners=tuple(places[mechanism.owners[j]].body for j in kept),
        G=mechanism.G[kept],
        g=mechanism.g[kept],
        bodies=tuple(name for name, welded in zip(mechanism.bodies, held, strict=True) if not welded),
        joints=tuple(mechanism.joints[j] for j in kept),
        limits=mechanism.limits.select(kept),
        drives=Drives(**{name: array[kept] for name, array in vars(mechanism.drives).items()}),
        frames=(*merged, *map(moved, mechanism.frames)),
        loops=tuple(replace(loop, a=moved(loop.a), b=moved(loop.b)) for loop in mechanism.loops),
    )
