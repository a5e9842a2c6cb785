"""Standard deviations of limited values along a measured motion, and the windows in which each is known well."""

import numpy as np

from jounce.dynamics.quantities import DEFAULT_QUANTITY, Quantity
from jounce.engine.along import compute_pieces
from jounce.limits.joints import drop_base, scatter_columns
from jounce.limits.limited_motion import LimitedMotion, Span, motion_order, required_quantities
from jounce.model.limit_kinds import LIMIT_KINDS, MOTION_KINDS, MOTOR_KINDS
from jounce.model.positions import multiscrew_joints as joints_of_several
from jounce.motion.motion import Motion
from jounce.motion.reliability import MAX_WINDOW_TIMES, find_window

Deviations = dict[str, np.ndarray]  # by kind, (N, joints); NaN where they are not known


def is_measured(motion: Motion) -> bool:
    """Whether positions, loads or a base along a motion have deviations."""
    curves = (motion.curve, *motion.loads.values(), *([motion.base_curve] if motion.base_curve else []))
    return any(curve.deviations(motion.times[:1], 0) is not None for curve in curves)


def compute_deviations(b: LimitedMotion, t: np.ndarray) -> Deviations:
    """Standard deviations at times (N,), without the kinds that are exact.

    Of joints that follow others in closed loops only the deviations of forces are known.
    """
    m = b.motion
    if not is_measured(m):
        return {}
    closure = b.robot.mechanism.closure
    own = list(closure.independent) if closure else list(range(len(b.joints)))
    rates = m.deviations(t, max([1, *(motion_order(b.robot, kind) for kind in b.kinds)]))
    spread = np.full((len(rates), len(t), len(b.joints)), np.nan) if rates else np.zeros((2, len(t), len(b.joints)))
    if rates:
        spread[:, :, own] = rates
    for joint in joints_of_several(b.robot.mechanism.tree).values() if rates else ():
        spread[0, :, joint.coordinates] = np.nan  # those of swings, ... are not known
    found = dict(zip(MOTION_KINDS, spread, strict=False)) if rates else {}
    found |= _force_deviations(b, t, spread[1]) | _motor_deviations(b, t)
    return {kind: found[kind] for kind in b.kinds if kind in found}


def _force_deviations(b: LimitedMotion, t: np.ndarray, off: np.ndarray) -> Deviations:
    """The deviations of efforts with rates, power and stall efforts, from those of velocities, `off` (N, joints)."""
    kinds = [kind for kind in b.kinds if LIMIT_KINDS[kind].force]
    if not kinds:
        return {}
    along = _sample_deviations(b, t, b.efforts, max(LIMIT_KINDS[kind].rate for kind in kinds))
    spread, Q = (scatter_columns(b.robot.mechanism, x, b.efforts) for x in along)
    if not spread:
        return {}
    found = {kind: spread[LIMIT_KINDS[kind].rate] for kind in kinds}
    if "power" in b.kinds:
        parts = b.rates(t, 1)[1] * spread[0], Q[0] * off, spread[0] * off  # the last where both are off
        found["power"] = np.sqrt(np.sum(np.square(parts), axis=0))
    if "stall_effort" in b.kinds:
        found["stall_effort"] = np.hypot(spread[0], b.limits.effort_slope * off)
    return found


def _motor_deviations(b: LimitedMotion, t: np.ndarray) -> Deviations:
    """The deviations of motors; those of voltages are sums over their parts, an upper bound."""
    found = {}
    for kind in MOTOR_KINDS:
        if kind in b.kinds:
            spread = {
                name: _sample_deviations(b, t, b.row(name), k)[0]
                for name, k in required_quantities(b.robot, kind).items()
            }
            if all(spread.values()):
                of_motor = b.motor_values(kind, spread)[LIMIT_KINDS[kind].rate]
                [found[kind]] = scatter_columns(b.robot.mechanism, [np.abs(of_motor)], DEFAULT_QUANTITY)
    return found


def _sample_deviations(
    b: LimitedMotion, t: np.ndarray, row: Quantity, order: int
) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """The deviations of a quantity with its rates, none where it is exact, and the quantity."""
    parts = list(compute_pieces(b.robot, b.motion, t, order, row=row))
    of_rates = [part.deviations or () for part in parts], [part.forces for part in parts]
    spread, values = (tuple(map(np.concatenate, zip(*rates, strict=True))) for rates in of_rates)
    return drop_base(b.robot.mechanism, spread, row), drop_base(b.robot.mechanism, values, row)


def find_windows(b: LimitedMotion) -> dict[str, Span]:
    """The times between which each kind is known well, of the kinds that are not known well along the whole motion."""
    times = b.motion.times
    t = times[np.unique(np.linspace(0, len(times) - 1, min(len(times), MAX_WINDOW_TIMES)).astype(int))]
    found = {kind: find_window(t, off) for kind, off in compute_deviations(b, t).items()}
    return {kind: span for kind, span in found.items() if span != (t[0], t[-1])}
