"""Standard deviations of limited values along a measured motion, and the windows in which each is known well."""

from collections.abc import Sequence
from functools import partial

import numpy as np

from jounce.dynamics import loop_closure
from jounce.dynamics.quantities import DEFAULT_QUANTITY, Quantity
from jounce.engine.along import compute_pieces
from jounce.engine.backends import closing_step
from jounce.engine.closed_path import continue_positions
from jounce.limits.joints import drop_base, joint_rates, scatter_columns
from jounce.limits.limited_motion import LimitedMotion, motion_order, required_quantities
from jounce.model.limit_kinds import LIMIT_KINDS, MOTION_KINDS, MOTOR_KINDS
from jounce.model.positions import multiscrew_joints as joints_of_several
from jounce.motion.base import compute_states, perturb_rates
from jounce.motion.channel import Span
from jounce.motion.motion import Motion
from jounce.motion.reliability import MAX_WINDOW_TIMES, find_window

Deviations = dict[str, np.ndarray]  # by kind, (N, joints); NaN where they are not known


def is_measured(motion: Motion) -> bool:
    """Whether positions, loads or a base along a motion have deviations."""
    curves = (motion.curve, *motion.loads.values(), *([motion.base_curve] if motion.base_curve else []))
    return any(curve.deviations(motion.times[:1], 0) is not None for curve in curves)


def compute_deviations(b: LimitedMotion, t: np.ndarray) -> Deviations:
    """Standard deviations at times (N,), without the kinds that are exact."""
    if not is_measured(b.motion):
        return {}
    rates = _rate_deviations(b, t, max([1, *(motion_order(b.robot, kind) for kind in b.kinds)]))
    off = rates[1] if rates else np.zeros((len(t), len(b.joints)))
    found = dict(zip(MOTION_KINDS, rates, strict=False)) | _force_deviations(b, t, off) | _motor_deviations(b, t)
    return {kind: found[kind] for kind in b.kinds if kind in found}


def _rate_deviations(b: LimitedMotion, t: np.ndarray, order: int) -> Sequence[np.ndarray]:
    """The deviations of what limits of positions, velocities, ... bound, (N, joints) each; none if q is exact.

    Of joints that follow others in closed loops, and of swings, they are what each rate of q makes of its own.
    """
    m, motion = b.robot.mechanism, b.motion
    rates = motion.deviations(t, order)
    if rates is None or (not m.closure and not joints_of_several(m.tree)):
        return rates or ()
    highest = max([1, *(LIMIT_KINDS[kind].rate for kind in b.kinds if LIMIT_KINDS[kind].of == "q")])
    meaning = partial(compute_states, motion.several)
    true, total = b.rates(t, highest), np.zeros((highest + 1, len(t), len(b.joints)))
    near = continue_positions(b.robot, motion, t)
    for moved in perturb_rates(motion.curve, t, highest, meaning):
        close = near if near is None else loop_closure.close_loops(m, moved[0], near, closing_step(b.robot))
        found = joint_rates(b.robot, moved, close, b.follow)
        total += np.square([x - y for x, y in zip(found, true, strict=True)])
    return tuple(np.sqrt(total))


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
