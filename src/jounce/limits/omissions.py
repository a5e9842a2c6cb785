"""What a verdict on limits leaves out: breaks, limits of what a robot does not have, values that vary fast."""

import numpy as np

from jounce.core.cures import Remedy
from jounce.core.errors import join_names, quote_value
from jounce.dynamics.quantities import QUANTITIES
from jounce.engine.along import ForceBreak
from jounce.engine.motion_states import MotionStates
from jounce.limits.limited_motion import LimitedMotion
from jounce.limits.worst_values import Worst
from jounce.model.coordinates import following_efforts
from jounce.model.limit_kinds import LIMIT_KINDS
from jounce.motion.motion import Motion
from jounce.spatial.series import rate_name

LACK_TOLERANCE = 1e-5  # of the largest force: what integrated motions of springs lack by their steps is less


def describe_omissions(b: LimitedMotion, breaks: tuple[ForceBreak, ...]) -> tuple[str, ...]:
    """What the motion cannot meet because it is not smooth, and which limits nothing is checked against."""
    notes = []
    missed = [found for found in breaks if found.order < max(b.force_rates.values(), default=0)]
    if missed:
        first = missed[0]
        joints = b.robot.joint_names
        causes = [joints[j] if isinstance(j := cause.joint, int) else j for cause in first.causes]
        names = join_names(causes or ["a limit of a contact"])
        more = f" (and at {len(missed) - 1} more times)" if len(missed) > 1 else ""
        jumps = rate_name("Q", max(first.order, 0)) if first.order >= 0 else "qd"
        limits = " and ".join(kind.replace("_", " ") for kind, k in b.force_rates.items() if k > max(first.order, 0))
        came = f"break at t = {first.t:.9g} s{more}: {jumps} jumps because of {names}"
        cure = f"; {Remedy('motion.blended', '--blend')} replaces breaks" if causes else ""
        notes.append(f"{came}; no limit of {limits} can be met there{cure}")
    if idle := [kind.replace("_", " ") for kind in b.limits.kinds if kind not in b.kinds]:
        rigid, broken = (
            f"the joints are rigid{Remedy('; see robot.elastic(stiffness)')}",
            "limits of contacts are broken",
        )
        reason = rigid if all(LIMIT_KINDS[kind].takes for kind in b.limits.kinds if kind not in b.kinds) else broken
        notes.append(f"limits of {join_names(idle)} are not checked: {reason}")
    for joint in following_efforts(b.robot.mechanism):
        notes.append(
            f"effort limits of {quote_value(joint)} are not checked: it follows another, shares motors or has none"
        )
    return tuple(notes)


def describe_unresolved(worst: Worst) -> tuple[str, ...]:
    """Which values change too fast between samples for a verdict, and where that begins."""
    return tuple(
        f"the {kind.replace('_', ' ')} of joint {quote_value(worst.b.name(kind, j))} may be beyond its limit between"
        f" samples from t = {min(spans)[0]:.9g} s on: it changes too fast there to be followed"
        for (kind, j), spans in worst.unresolved.items()
    )


def describe_lacks(b: LimitedMotion, motion: Motion) -> tuple[str, ...]:
    """What a motion lacks at passive coordinates, which no motor supplies: the robot moves otherwise."""
    m = b.robot.mechanism
    if m.closure is None or not m.closure.passive:
        return ()
    names, found = [m.coordinates[k] for k in m.closure.passive], list[np.ndarray]()
    for _, states in MotionStates.pieces(b.robot, motion, motion.times, [(QUANTITIES["actuator_forces"], 0)]):
        found.append(states.compute(b.robot, "actuator_forces")[0])
    forces = np.abs(np.concatenate(found))
    lacks = forces[:, -len(names) :]
    if not lacks.max() > LACK_TOLERANCE * forces.max():
        return ()
    i, j = np.unravel_index(lacks.argmax(), lacks.shape)
    return (
        f"the motion lacks {lacks[i, j]:.3g} at passive {quote_value(names[j])}, at t = {motion.times[i]:.6g} s, which"
        f" no motor supplies: the robot moves otherwise{Remedy(', see robot.passive_accelerations')}",
    )
