"""Elastic joints over series: motor positions and motor torques from the motion of the links, by Spong's model.

All are columns (..., n, 1). Q is the force of the links' inverse dynamics, theta the position of a motor seen from its
link. A rigid joint has an infinite stiffness, hence no deflection: its motor moves as the link does.
"""

from collections.abc import Callable

import numpy as np

from jounce.core.errors import quoted
from jounce.core.scalars import Array, reciprocal
from jounce.dynamics import coupling
from jounce.dynamics.stretch import NO_INPUTS, SpringInputs, at_motors, elasticity_of, stretch
from jounce.model import drives
from jounce.model.mechanism import Mechanism
from jounce.model.springs import CubicSpring
from jounce.spatial.series import Series

Forces = Callable[[Series | None], Series]  # Q of the links' motion, with further wrenches that the bodies exert


def motor_positions(m: Mechanism, q: Series, forces: Forces, inputs: SpringInputs = NO_INPUTS) -> Series:
    """theta = q + delta, where the springs exert Q."""
    return _motion(m, q, forces, inputs)[0]


def motor_torques(m: Mechanism, q: Series, forces: Forces, inputs: SpringInputs = NO_INPUTS) -> Series:
    """tau = phi + B theta2d + F_m(thetad), phi = Q, and what rotors feel of the links that carry them."""
    e, (theta, phi) = elasticity_of(m), _motion(m, q, forces, inputs)
    tau = phi + _column(e.of_motors.rotor) * theta.dot.dot + motor_friction(m, theta)
    return tau if e.level is None else tau + coupling.motor_reactions(m, q)


def _motion(m: Mechanism, q: Series, forces: Forces, inputs: SpringInputs) -> tuple[Series, Series]:
    """The motor positions, and the forces of the springs on the links, one row per motor.

    With rotors that links carry, Q holds their moments: at level 0 those of rotors that turn as their joints do, at
    each further level those of the motor positions of the level below.
    """
    level = elasticity_of(m).level
    if level is None:
        delta, phi = stretch(m, forces(None), inputs)
        return at_motors(m, q) + delta, phi
    theta = q
    for _ in range(level + 1):
        delta, phi = stretch(m, forces(coupling.reaction_wrenches(m, q, theta)), inputs)
        theta = q + delta
    return theta, phi


def native_obstacle(m: Mechanism) -> str | None:
    """Why native code has no motor positions and torques, as the end of a sentence about native code, or None."""
    for name, law in zip(m.coordinates, elasticity_of(m).springs, strict=False):
        if law is not None and not (isinstance(law, CubicSpring) and law.has_fixed_steps):
            return (
                "supports springs that are linear, or stiffen cubically from a stiffness k above 0; that of joint"
                f" {quoted(name)} is another"
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
