"""Joints that move no inertia: massless bodies, and coordinates in which the mass matrix is singular."""

from collections.abc import Iterator

import numpy as np

from jounce.checks.audit.finding import Finding
from jounce.dynamics.mobility import idle_coordinates
from jounce.model.mechanism import Mechanism


def check_massless(mechanism: Mechanism) -> Iterator[Finding]:
    """Find massless bodies: those that carry mass, which have no effect, and those that carry none.

    Bodies that a closed loop joins carry the mass of each other.
    """
    empty = ~mechanism.M.any(axis=(1, 2))
    empty[: int(mechanism.floats)] = False  # a base has no joint that could move nothing
    loaded = ~empty
    if mechanism.closure:
        empty[[mechanism.owners[j] for j in mechanism.closure.actuated if not mechanism.loops]] = False  # rotors
        loaded[[frame.body for loop in mechanism.loops for frame in (loop.a, loop.b) if frame.body >= 0]] = True
    carries = loaded.copy()
    for i, p in reversed(list(enumerate(mechanism.parent))):
        if p >= 0:
            carries[p] |= carries[i]
    between, tips = np.flatnonzero(empty & carries), np.flatnonzero(empty & ~carries)
    if between.size:
        yield Finding(
            severity="note",
            kind="massless",
            bodies=tuple(mechanism.bodies[i] for i in between),
            number=0.0,
            unit="kg",
            text="massless, but carries bodies with mass: no effect on forces or mass matrix",
            advice="correct for an intermediate frame of a joint with several axes; otherwise state the inertia",
        )
    if tips.size:
        yield Finding(
            severity="warning",
            kind="massless tip",
            bodies=tuple(mechanism.bodies[i] for i in tips),
            number=0.0,
            unit="kg",
            text="massless, as is everything it carries: its joint needs no force",
            advice="state the inertia, or make the joint fixed",
        )


def check_singular(mechanism: Mechanism) -> Iterator[Finding]:
    """Coordinates that move without kinetic energy in every configuration: no forward dynamics, no ``M^-1``."""
    rank, idle = idle_coordinates(mechanism)
    if not idle:
        return
    unit = "velocities" if mechanism.floats else "coordinates"
    yield Finding(
        severity="error",
        kind="singular mass matrix",
        joints=idle,
        number=float(mechanism.nv - rank),
        unit=unit,
        text=f"moves no inertia{' together' if len(idle) > mechanism.nv - rank else ''}: "
        f"the mass matrix is singular, of rank {rank} for {mechanism.nv} {unit}",
        advice="inverse dynamics is not affected; for forward dynamics state the inertia, or fix the joint",
    )
