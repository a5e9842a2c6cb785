"""Standard deviations of forces along a measured motion, and quantities without certain digits."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from jounce.core.errors import UncertainError
from jounce.dynamics import loop_closure
from jounce.dynamics.computation import Computation
from jounce.dynamics.quantities import Quantity
from jounce.engine.backends import closing_step
from jounce.engine.engine import Engine
from jounce.engine.motion_states import MotionStates, Rates
from jounce.engine.plan import compute
from jounce.model.positions import multiscrew_joints
from jounce.motion.base import compute_base_motion, compute_states, perturb_rates
from jounce.motion.motion import Motion
from jounce.motion.sample_curves import SmoothedCurve
from jounce.motion.vibrations import describe_force_rates

_MAX_PERTURBED_STATES = 200_000  # computed for deviations of forces, which change slowly: linear between fewer times


def compute_certain(robot: Engine, states: MotionStates, method: str | None, row: Quantity) -> Rates:
    """A quantity with its rates, NaN where no digits are certain."""
    try:
        return states.compute(robot, row.name, method)
    except UncertainError as error:
        return error.results


def entry_count(robot: Engine, row: Quantity) -> int:
    """The number of entries of a quantity for one state: n, or nv of the forces on a robot that floats."""
    [size] = Computation(row.name, 0).shape(robot.mechanism)
    return size


def interpolate_deviations(
    robot: Engine, motion: Motion, times: np.ndarray, order: int, method: str | None, row: Quantity
) -> Callable[[np.ndarray], Rates] | None:
    """The standard deviations of the forces over time: computed with each entry of q, W and the base off by its own.

    The rates are assumed independent, which overestimates slightly: the highest rates dominate.
    """
    highest = order + row.takes.rates - 1
    smoothed = [body for body, load in motion.loads.items() if load.deviations(times[:1], 0) is not None]
    on_base = motion.base_curve is not None and motion.base_curve.deviations(times[:1], 0) is not None
    if motion.deviations(times[:1], 0) is None and not smoothed and not on_base:
        return None
    every = np.unique(times)
    entries = motion.curve.columns + 7 * on_base + 6 * len(smoothed)
    count = max(2, _MAX_PERTURBED_STATES // (entries * (highest + 1)))
    t = every[np.unique(np.linspace(0, len(every) - 1, min(count, len(every))).astype(int))]
    total = np.zeros((order + 1, len(t), entry_count(robot, row)))
    for part, states in MotionStates.pieces(robot, motion, t, [(row, order)]):
        true = np.array(compute_certain(robot, states, method, row))
        for moved in _perturb_states(motion, t[part], states):
            if moved.near is not None:
                near = loop_closure.close_loops(robot.mechanism, moved.rates[0], moved.near, closing_step(robot))
                moved = replace(moved, near=near)
            found = np.array(compute_certain(robot, moved, method, row))
            total[:, part] += (found - true) ** 2
    certain = np.isfinite(total).all(axis=(0, 2))
    t, known = (t[certain], np.sqrt(total[:, certain])) if certain.any() else (t, np.sqrt(total))

    def interpolate(times: np.ndarray) -> Rates:
        return tuple(np.stack([np.interp(times, t, column) for column in rate.T], axis=1) for rate in known)

    return interpolate


def with_vibration_notes(motion: Motion, robot: Engine) -> Motion:
    """The motion, with notes of what vibrations of its samples mean in Q2d, for robots of joints alone."""
    mechanism, curve = robot.mechanism, motion.curve
    if not isinstance(curve, SmoothedCurve) or mechanism.floats or mechanism.loops or multiscrew_joints(mechanism):
        return motion

    def mass_matrices(t: np.ndarray) -> np.ndarray:
        return np.asarray(compute(robot, "mass_matrix", curve.rates(t, 0)))

    notes = [
        describe_force_rates(vibration, mass_matrices, mechanism.coordinates) for vibration in curve.fit.vibrations
    ]
    return replace(motion, notes=(*motion.notes, *notes))


def _perturb_states(motion: Motion, t: np.ndarray, states: MotionStates) -> Iterator[MotionStates]:
    """States at times with each entry of q, W and the base off by its standard deviation, one by one."""
    highest, W = len(states.rates) - 1, states.wrench or ()
    for q in perturb_rates(motion.curve, t, highest, partial(compute_states, motion.several)):
        yield replace(states, rates=q)
    for k, by_body in enumerate(motion.wrench_deviations(t, len(W) - 1) if W else ()):
        for body, off in by_body.items():
            for j in np.flatnonzero(off.any(axis=0)).tolist():
                moved = {**W[k], body: W[k][body] + off * (np.arange(6) == j)}
                yield replace(states, wrench=(*W[:k], moved, *W[k + 1 :]))
    for base in perturb_rates(motion.base_curve, t, highest, compute_base_motion) if motion.base_curve else ():
        yield replace(states, base=base)
