"""The springs and motors of a robot from what a caller states and from the drive trains of its file, checked."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from jounce._scalars import asarray, is_numeric
from jounce.errors import JounceError, listed, one_of, quoted, warn
from jounce.model.coordinates import coordinate_units
from jounce.model.drives import EPS
from jounce.model.elasticity import Elasticity
from jounce.model.mechanism import Mechanism

ON_MOTORS = ("armature", "damping", "friction")  # terms of the drives that act on the motors of elastic joints


def with_elasticity(mechanism: Mechanism, stiffness: object, rotor: object) -> Mechanism:
    """Return the mechanism with springs between motors and links: terms of the drives that act on motors leave Q."""
    e = mechanism.elasticity or _of_drives(mechanism)
    e = replace(
        e,
        stiffness=_stiffness(mechanism, stiffness),
        rotor=e.rotor if rotor is None else _per_coordinate(mechanism, "rotor", rotor, e.rotor),
    )
    _check(mechanism, e, rotor)
    moved = [term for term in mechanism.acting if term in ON_MOTORS]
    if moved:
        warn(f"{mechanism.name}: {listed(moved)} no longer acts in Q, but on the motors of the elastic joints")
    return replace(mechanism, elasticity=e, acting=tuple(term for term in mechanism.acting if term not in ON_MOTORS))


def _stiffness(mechanism: Mechanism, given: object) -> np.ndarray:
    """The stiffnesses (n,) that a caller gives, or those of the robot's file."""
    if given is not None:
        return _per_coordinate(mechanism, "stiffness", given, np.full(mechanism.n, np.inf))
    if mechanism.elasticity is None:
        raise JounceError(
            f"{mechanism.name!r} states no stiffness of its joints; robot.elastic(stiffness) does (--stiffness)"
        )
    return mechanism.elasticity.stiffness


def _per_coordinate(mechanism: Mechanism, what: str, given: object, others: np.ndarray) -> np.ndarray:
    """One number for all coordinates, (n,), or {joint: number} with `others` for those left out: (n,)."""
    joints = mechanism.coordinates
    if isinstance(given, Mapping):
        numbers = others.copy()
        for name, value in given.items():
            place = joints.index(one_of("joint", name, joints))
            number = np.asarray(asarray(value, f"{what} of joint {quoted(name)}"))
            if not is_numeric(number) or number.shape != ():
                raise JounceError(f"{what} of joint {quoted(name)} is {quoted(value)}; expected a number")
            numbers[place] = number
        return numbers
    array = np.asarray(asarray(given, what))
    if not is_numeric(array) or array.shape not in [(), (len(joints),)]:
        raise JounceError(
            f"{what} has shape {array.shape}; expected one number, ({len(joints)},) one per coordinate,"
            " or a mapping {joint: number}"
        )
    return np.array(np.broadcast_to(array, (len(joints),)), dtype=float)


def _check(mechanism: Mechanism, e: Elasticity, rotor: object) -> None:
    """Raise `JounceError` unless stiffnesses and rotors are positive; a rigid joint may go without a rotor."""
    for name, unit, K, B in zip(mechanism.coordinates, coordinate_units(mechanism), e.stiffness, e.rotor, strict=True):
        joint, rad = f"joint {quoted(name)}", unit == "rad"
        if not K > 0:
            expected = f"a positive number, {'N m/rad' if rad else 'N/m'}, or infinity for a rigid joint"
            raise JounceError(f"stiffness of {joint} is {K:g}; expected {expected}")
        if B == 0 and np.isinf(K):
            continue
        if B == 0 and rotor is None:
            raise JounceError(
                f"{joint} has no armature to take as the inertia of its rotor; robot.elastic(stiffness, rotor=...)"
                f" states it, in {'kg m^2' if rad else 'kg'} as seen from the link"
            )
        if not 0 < B < np.inf:
            expected = f"a positive number, {'kg m^2' if rad else 'kg'} as seen from the link"
            raise JounceError(f"rotor of {joint} is {B:g}; expected {expected}")


def _of_drives(mechanism: Mechanism) -> Elasticity:
    """Rigid joints with the armature of the drive trains as rotors, and the damping and friction that act."""
    n, drives = mechanism.n, mechanism.drives
    return Elasticity(
        stiffness=np.full(n, np.inf),
        rotor=_on_coordinates(mechanism, "armature", mechanism.G**2),
        viscous=_on_coordinates(mechanism, "damping", mechanism.G**2 * ("damping" in mechanism.acting)),
        friction=_on_coordinates(mechanism, "friction", np.abs(mechanism.G) * ("friction" in mechanism.acting)),
        eps=_eps(mechanism) if "friction" in mechanism.acting and drives.friction.any() else np.full(n, EPS),
    )


def _on_coordinates(mechanism: Mechanism, term: str, weights: np.ndarray) -> np.ndarray:
    """The sums (n,) of a parameter of the joint variables; those that follow several coordinates have none."""
    amounts = getattr(mechanism.drives, term)
    for i, row in enumerate(weights):
        if amounts[i] and np.count_nonzero(row) > 1:
            leaders = listed(mechanism.coordinates[j] for j in np.flatnonzero(row))
            raise JounceError(
                f"joint {quoted(mechanism.joints[i])} has {term} and follows {leaders}; expected one motor per"
                f" coordinate, with no {term} on a joint that follows several"
            )
    return np.asarray(weights.T @ amounts)


def _eps(mechanism: Mechanism) -> np.ndarray:
    """The smoothing velocities (n,) of the friction of the coordinates: one for all joints that follow the same."""
    found = np.full(mechanism.n, EPS)
    for j, name in enumerate(mechanism.coordinates):
        rubbing = np.flatnonzero(mechanism.G[:, j] * mechanism.drives.friction)
        speeds = mechanism.drives.eps[rubbing] / np.abs(mechanism.G[rubbing, j])
        if speeds.size and np.ptp(speeds) > 1e-12 * speeds.max():
            joints = listed(mechanism.joints[i] for i in rubbing)
            raise JounceError(
                f"the friction of {joints} turns over at different speeds of coordinate {quoted(name)}, from"
                f" {speeds.min():g} to {speeds.max():g}; expected one, as a motor has"
            )
        found[j] = speeds.mean() if speeds.size else EPS
    return found
