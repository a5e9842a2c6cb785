"""What a robot's data leave open of its limits, along every motion: inertias that are missing or wrong, limits of 0.

Files of robots state no inertia where nobody measured one, and a limit of 0 where nobody knows it. Then a force of 0
or a ratio of 0 proves nothing: such rows are undecided. An inertia that no body can have is off by at least its
distance to one that a body can have: where that decides, the row is undecided as well. What is `Mechanism.meant` is no
doubt.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from jounce.core.cures import Remedy
from jounce.core.errors import join_names
from jounce.core.scalars import is_numeric
from jounce.dynamics.mobility import find_idle_coordinates
from jounce.engine.engine import Engine, with_mechanism
from jounce.limits.limited_motion import LimitedMotion
from jounce.model.limit_kinds import LIMIT_KINDS
from jounce.model.mechanism import INERTIAS, MASSLESS_TIPS
from jounce.spatial.inertia import nearest_consistent

MASSLESS_CAUSE = (
    "moves no inertia at all, so that its forces are 0 for lack of it; state the inertias of its bodies, or load the"
    " robot with {} if that is meant"
)
ZERO_LIMIT_CAUSE = (
    "the limit is 0 on both sides, as files state where it is not known; state the limit, or omit it, as by {}"
)


def find_doubts(b: LimitedMotion) -> Mapping[tuple[str, int], str]:
    """By kind and joint why a limit is undecided, whatever the motion: it is 0, or its joint moves no mass."""
    mechanism, found = b.robot.mechanism, {}
    massless = find_idle_coordinates(mechanism) & (MASSLESS_TIPS not in mechanism.meant)
    for kind in b.kinds:
        bounds = b.limits.bounds(kind)
        limited = np.isfinite(bounds).any(axis=0)
        for j in np.flatnonzero((bounds == 0).all(axis=0)).tolist():
            found[kind, j] = ZERO_LIMIT_CAUSE.format(Remedy("with_limits", "--limits"))
        for j in np.flatnonzero(massless & limited).tolist() if LIMIT_KINDS[kind].of != "q" else ():
            found[kind, j] = f"{b.joints[j]} {MASSLESS_CAUSE.format(Remedy('massless_tips=True', '--massless-tips'))}"
    return found


def without_doubts(b: LimitedMotion) -> LimitedMotion:
    """The motion with the limits alone that can be decided: at no speed is there a verdict on the others."""
    doubts = find_doubts(b)
    if not doubts:
        return b
    table, kinds = b.limits.table.copy(), list(LIMIT_KINDS)
    for kind, j in doubts:
        table[kinds.index(kind), :, j] = -np.inf, np.inf
    decided = replace(b.limits, table=table)
    return replace(b, limits=decided, kinds=tuple(kind for kind in b.kinds if kind in decided.kinds))


def with_consistent_inertias(robot: Engine) -> tuple[Engine, tuple[str, ...]]:
    """The robot with the nearest inertias that bodies can have, and the bodies that have others, unless meant."""
    m = robot.mechanism
    if INERTIAS in m.meant or not is_numeric(m.M):
        return robot, ()
    nearest = [nearest_consistent(M) for M in m.M]
    changed = [i for i, M in enumerate(m.M) if not np.array_equal(nearest[i], M)]
    if not changed:
        return robot, ()
    return with_mechanism(robot, replace(m, M=np.array(nearest))), tuple(m.bodies[i] for i in changed)


def describe_wrong_inertias(bodies: tuple[str, ...], verdict: str) -> str:
    """The cause of a verdict that is another one with inertias that bodies can have."""
    return f"no body can have the inertias of {join_names(bodies)}, and with the nearest possible ones it is {verdict}"
