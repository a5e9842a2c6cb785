"""Rotors and friction of motors behind elastic joints, from the drive trains of a robot's file."""

from dataclasses import replace

import numpy as np

from jounce.core.errors import JounceError, join_names, quote_value, warn
from jounce.model.drives import AMOUNTS, DEFAULT_SMOOTHING_VELOCITY, OMIT_LOAD_FRICTION
from jounce.model.elasticity import Elasticity
from jounce.model.mechanism import Mechanism

ON_MOTORS = ("armature", "damping", "friction")  # terms of the drives that act on the motors of elastic joints


def elasticity_from_drives(mechanism: Mechanism) -> Elasticity:
    """Rigid joints with the armature of the drive trains as rotors, and the damping and friction that act."""
    n, drives = mechanism.n, mechanism.drives
    return Elasticity(
        stiffness=np.full(n, np.inf),
        rotor=_sum_by_coordinate(mechanism, "armature", mechanism.G**2),
        viscous=_sum_by_coordinate(mechanism, "damping", mechanism.G**2 * ("damping" in mechanism.acting)),
        friction=_sum_by_coordinate(mechanism, "friction", np.abs(mechanism.G) * ("friction" in mechanism.acting)),
        eps=_friction_eps(mechanism)
        if "friction" in mechanism.acting and drives.friction.any()
        else np.full(n, DEFAULT_SMOOTHING_VELOCITY),
    )


def _sum_by_coordinate(mechanism: Mechanism, term: str, weights: np.ndarray) -> np.ndarray:
    """The sums (n,) of a parameter of the joint variables; those that follow several coordinates have none."""
    amounts = getattr(mechanism.drives, term)
    for i, row in enumerate(weights):
        if amounts[i] and np.count_nonzero(row) > 1:
            leaders = join_names(mechanism.coordinates[j] for j in np.flatnonzero(row))
            came = f"joint {quote_value(mechanism.joints[i])} has {term} and follows {leaders}"
            expected = f"one motor per coordinate, with no {term} on a joint that follows several"
            raise JounceError(f"{came}; expected {expected}")
    return np.asarray(weights.T @ amounts)


def _friction_eps(mechanism: Mechanism) -> np.ndarray:
    """The smoothing velocities (n,) of the friction of the coordinates: one for all joints that follow the same."""
    found = np.full(mechanism.n, DEFAULT_SMOOTHING_VELOCITY)
    for j, name in enumerate(mechanism.coordinates):
        rubbing = np.flatnonzero(mechanism.G[:, j] * mechanism.drives.friction)
        speeds = mechanism.drives.eps[rubbing] / np.abs(mechanism.G[rubbing, j])
        if speeds.size and np.ptp(speeds) > 1e-12 * speeds.max():
            joints = join_names(mechanism.joints[i] for i in rubbing)
            came = f"different speeds of coordinate {quote_value(name)}, from {speeds.min():g} to {speeds.max():g}"
            raise JounceError(f"the friction of {joints} turns over at {came}; expected one, as a motor has")
        found[j] = speeds.mean() if speeds.size else DEFAULT_SMOOTHING_VELOCITY
    return found


def with_moved_terms(mechanism: Mechanism) -> Mechanism:
    """The mechanism without those terms of drives in Q that act on motors: of joints that coordinates move."""
    own, left, moved = np.any(mechanism.G != 0, axis=1), {}, []
    if mechanism.has_load_friction or ("stribeck" in mechanism.acting and mechanism.drives.stribeck.any()):
        cure = OMIT_LOAD_FRICTION
        raise JounceError(f"{mechanism.name}: motors of elastic joints have no stribeck or load_friction; {cure}")
    for term in [term for term in mechanism.acting if term in ON_MOTORS]:
        amounts = getattr(mechanism.drives, term)
        if amounts[~own].any():  # of joints that follow others in closed loops
            left[term] = np.where(own, 0.0, amounts)
        if term not in left or amounts[own].any():
            moved.append(term)
    if moved:
        warn(f"{mechanism.name}: {join_names(moved)} no longer acts in Q, but on the motors of the elastic joints")
    there = {term for term in mechanism.acting if getattr(mechanism.drives, AMOUNTS[term]).any()}
    acting = tuple(term for term in mechanism.acting if term in (left if term in ON_MOTORS else there))
    return replace(mechanism, drives=replace(mechanism.drives, **left), acting=acting)
