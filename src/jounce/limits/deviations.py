"""Standard deviations of what limits bound along a measured motion, and between which times each is known well."""

import numpy as np

from jounce.limits.bounded import DERIVATIVE, Bounded, Span, motion_order
from jounce.limits.joints import in_columns, of_joints
from jounce.model.limits import EFFORT_KINDS, MOTION_KINDS
from jounce.robot.along import pieces_along

MAX_OVER_MEDIAN = 10.0  # of deviations in a window: towards the ends of a fit they rise by powers of ten
COMPARED_TIMES = 2000  # of a motion, at which deviations are compared with their median

Deviations = dict[str, np.ndarray]  # by kind, (N, joints); NaN where they are not known


def deviations_of(b: Bounded, t: np.ndarray) -> Deviations:
    """Standard deviations at times (N,), without the kinds that are exact.

    Those of motors, and of joints that follow others in closed loops, are not known.
    """
    m = b.motion
    curves = (m.curve, *m.loads.values(), *([m.base_curve] if m.base_curve else []))
    if all(curve.deviations(t[:1], 0) is None for curve in curves):
        return {}
    closure = b.robot.mechanism.closure
    own = list(closure.independent) if closure else list(range(len(b.joints)))
    rates = m.deviations(t, max(motion_order(b.robot, kind) for kind in b.kinds))
    found: Deviations = {}
    for kind in b.kinds if rates else ():
        found[kind] = np.full((len(t), len(b.joints)), np.nan)
        if rates and kind in MOTION_KINDS:
            found[kind][:, own] = rates[MOTION_KINDS.index(kind)]
    off = np.zeros((len(t), len(b.joints)))
    if rates:
        off = np.full_like(off, np.nan)
        off[:, own] = (m.deviations(t, 1) or ())[1]
    return found | _of_forces(b, t, off)


def _of_forces(b: Bounded, t: np.ndarray, off: np.ndarray) -> Deviations:
    """Those of efforts with their rates, and of the power, where velocities deviate by `off` (N, joints)."""
    m, efforts = b.robot.mechanism, [kind for kind in b.kinds if kind in EFFORT_KINDS]
    if not efforts and "power" not in b.kinds:
        return {}
    order = max((DERIVATIVE[kind] for kind in efforts), default=0)
    parts = list(pieces_along(b.robot, b.motion, t, order, row=b.efforts))
    if parts[0].deviations is None:
        return {}
    spread, Q = (
        in_columns(m, of_joints(m, tuple(map(np.concatenate, zip(*rates, strict=True))), b.efforts), b.efforts)
        for rates in ([part.deviations or () for part in parts], [part.forces for part in parts])
    )
    found = {kind: spread[DERIVATIVE[kind]] for kind in efforts}
    if "power" in b.kinds:
        found["power"] = np.hypot(b.rates(t, 1)[1] * spread[0], Q[0] * off)
    return found


def windows_of(b: Bounded) -> dict[str, Span]:
    """The times between which each kind is known well, of the kinds that are not known well along the whole motion."""
    times = b.motion.times
    t = times[np.unique(np.linspace(0, len(times) - 1, min(len(times), COMPARED_TIMES)).astype(int))]
    found = {}
    for kind, deviations in deviations_of(b, t).items():
        known = ~np.isnan(deviations).any(axis=0)
        rate = b.motion.deviations(t, motion_order(b.robot, kind)) or (np.empty((len(t), 0)),)
        off = deviations[:, known] if known.any() else rate[-1]  # of motors, whose own are not known
        well = np.flatnonzero((off <= MAX_OVER_MEDIAN * np.median(off, axis=0)).all(axis=1))
        ends = (well[0], well[-1]) if well.size else (0, 0)
        if ends != (0, len(t) - 1):
            found[kind] = (float(t[ends[0]]), float(t[ends[1]]))
    return found
