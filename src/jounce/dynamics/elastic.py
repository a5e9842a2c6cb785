"""Elastic joints over series, by Spong's model: motors from the motion of the links, and both from motor torques.

All are columns (..., n, 1). Q is the force of the links' inverse dynamics, theta the position of a motor seen from its
link. A rigid joint has an infinite stiffness, hence no deflection: its motor moves as the link does, its rotor counts
in the mass matrix of the links, and the motor torque, less the friction of the motor, acts on the link. theta and
thetad that are given of such a joint are not read: q and qd are.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache

import numpy as np

from jounce.core.cures import SPONG_COUPLING, Remedy
from jounce.core.errors import JounceError, join_names, quote_value
from jounce.core.scalars import Array, is_zero, reciprocal
from jounce.dynamics import coupling
from jounce.dynamics.joint_springs import (
    NO_INPUTS,
    SpringInputs,
    deflect_springs,
    elasticity_of,
    select_motors,
    spring_force,
    sum_on_joints,
)
from jounce.model import drives
from jounce.model.mechanism import Mechanism
from jounce.model.springs import CubicSpring
from jounce.spatial.series import Series

Forces = Callable[[Series | None], Series]  # Q of the links' motion, with further wrenches that the bodies exert


def motor_torques(m: Mechanism, q: Series, theta: Series, phi: Series) -> Series:
    """tau = phi + B theta2d + F_m(thetad), and what rotors feel of the links that carry them."""
    e = elasticity_of(m)
    tau = phi + _column(e.of_motors.rotor) * theta.dot.dot + motor_friction(m, theta)
    return tau if e.level is None else tau + coupling.motor_reactions(m, q)


def motor_positions(m: Mechanism, q: Series, forces: Forces, inputs: SpringInputs = NO_INPUTS) -> tuple[Series, Series]:
    """The motor positions theta = q + delta, and the forces phi = Q of the springs on the links, one row per motor.

    With rotors that links carry, Q holds their moments: at level 0 those of rotors that turn as their joints do, at
    each further level those of the motor positions of the level below.
    """
    level = elasticity_of(m).level
    if level is None:
        delta, phi = deflect_springs(m, forces(None), inputs)
        return select_motors(m, q) + delta, phi
    theta = q
    for _ in range(level + 1):
        delta, phi = deflect_springs(m, forces(coupling.reaction_wrenches(m, q, theta)), inputs)
        theta = q + delta
    return theta, phi


@lru_cache(maxsize=64)
def with_rigid_rotors(m: Mechanism) -> Mechanism:
    """The mechanism whose mass matrix holds the rotors of rigid joints: as armature that acts, there is no other."""
    e = elasticity_of(m)
    armature = np.zeros(len(m.joints), dtype=np.result_type(e.rotor, m.G))
    for j in [j for j in np.flatnonzero(e.is_rigid) if not is_zero(e.rotor[j])]:
        alone = np.flatnonzero((m.G[:, j] != 0) & (np.count_nonzero(m.G, axis=1) == 1))
        if not alone.size:
            raise JounceError(
                f"rigid joint {quote_value(m.coordinates[j])} moves no joint alone, which its rotor takes;"
                " state a finite stiffness"
            )
        armature[alone[0]] = e.rotor[j] / m.G[alone[0], j] ** 2
    acting = (*m.acting, *["armature"] * bool(armature.any()))
    return replace(m, drives=replace(m.drives, armature=armature), acting=acting)


def spring_forces(m: Mechanism, q: Series, theta: Series) -> Series:
    """phi(theta - q) of the motors, and its rate, where there is no damper."""
    return spring_force(m, theta - select_motors(m, q))


def plant_forces(m: Mechanism, q: Series, theta: Series, tau: Array) -> tuple[Array, Array, Array]:
    """The forces on the links, those of the springs, and what motors have to move their rotors and their springs."""
    rigid, joints, phi = _rigid_factors(m), select_motors(m, q), spring_forces(m, q, theta)[0]
    turning = Series.of([theta[0], theta[1] + rigid * (joints[1] - theta[1])])
    drive = tau - motor_friction(m, turning)[0]
    return sum_on_joints(m, phi + rigid * drive), phi, drive


def rotor_accelerations(m: Mechanism, q2d: Array, free: Array) -> Array:
    """theta2d, from the torques that are left to turn rotors; of a rigid joint, which may have no rotor, its q2d."""
    rigid = _rigid_factors(m)
    own = reciprocal(_column(elasticity_of(m).of_motors.rotor) + rigid) * (1 - rigid)
    return own * free + rigid * select_motors(m, Series.of([q2d]))[0]


def _rigid_factors(m: Mechanism) -> Array:
    return _column(elasticity_of(m).of_motors.is_rigid) * 1


def linearization_obstacle(m: Mechanism) -> str | None:
    """Why tau does not decide q4d alone, by static feedback, as the end of a sentence, or None."""
    e = elasticity_of(m)
    if e.level is not None or e.dampers or e.pairs:
        reason = "dampers, or joints with two motors" if e.level is None else f"coupling={e.level}"
        return f" is not available with {reason}; use {SPONG_COUPLING} and springs without dampers"
    if not e.is_rigid.any():
        return None
    joints = join_names(name for name, held in zip(m.coordinates, e.is_rigid, strict=True) if held)
    are = "are" if e.is_rigid.sum() > 1 else "is"
    cure = Remedy("; robot.elastic(stiffness) states finite stiffnesses")
    return f" needs elastic joints, but {joints} {are} rigid{cure}"


def native_obstacle(m: Mechanism) -> str | None:
    """Why native code has no motor positions and torques, as the end of a sentence about native code, or None."""
    for name, law in zip(m.coordinates, elasticity_of(m).springs, strict=False):
        if law is not None and not (isinstance(law, CubicSpring) and law.has_fixed_steps):
            return (
                "supports springs that are linear, or stiffen cubically from a stiffness k above 0; that of joint"
                f" {quote_value(name)} is another"
            )
    return None


def motor_friction(m: Mechanism, theta: Series) -> Series:
    """F_m(thetad) = d_m thetad + f tanh(thetad / eps), by the laws of drives."""
    e = elasticity_of(m).of_motors
    coefficients = {"damping": e.viscous, "friction": e.friction, "slope": reciprocal(e.eps)}
    present = [term for term in ("damping", "friction") if np.any(coefficients[term] != 0)]
    return drives.forces({name: _column(array) for name, array in coefficients.items()}, present, theta)


def _column(array: Array) -> Array:
    return array[:, None]
