"""Elastic joints over series: motor positions and motor torques from the motion of the links, by Spong's model.

All are columns (..., n, 1). Q is the force of the links' inverse dynamics, theta the position of a motor seen from its
link. A rigid joint has an infinite stiffness, hence no deflection: its motor moves as the link does.
"""

import numpy as np

from jounce._scalars import Array, reciprocal
from jounce.model import drives
from jounce.model.elasticity import Elasticity
from jounce.model.mechanism import Mechanism
from jounce.spatial.series import Series


def motor_positions(m: Mechanism, q: Series, Q: Series) -> Series:
    """theta = q + delta, where the spring exerts Q."""
    return q + deflection(m, Q)


def motor_torques(m: Mechanism, q: Series, Q: Series) -> Series:
    """tau = Q + B theta2d + F_m(thetad)."""
    theta = motor_positions(m, q, Q)
    return Q + _column(_elasticity(m).rotor) * theta.dot.dot + motor_friction(m, theta)


def deflection(m: Mechanism, Q: Series) -> Series:
    """delta = theta - q with phi(delta) = Q: of linear springs Q / K."""
    return _column(reciprocal(_elasticity(m).stiffness)) * Q


def spring_force(m: Mechanism, delta: Series) -> Series:
    """phi(delta) of the springs, by which the motors act on the links; zero at rigid joints, whose force is unknown."""
    e = _elasticity(m)
    return _column(np.where(e.is_rigid, 0, e.stiffness)) * delta


def spring_energy(m: Mechanism, delta: Array) -> Array:
    """The energy of the springs, (..., 1, 1)."""
    return delta.mT @ spring_force(m, Series.of([delta]))[0] * 0.5


def motor_friction(m: Mechanism, theta: Series) -> Series:
    """F_m(thetad) = d_m thetad + f tanh(thetad / eps), by the laws of drives."""
    e = _elasticity(m)
    coefficients = {"damping": e.viscous, "friction": e.friction, "slope": reciprocal(e.eps)}
    present = [term for term in ("damping", "friction") if np.any(coefficients[term] != 0)]
    return drives.forces({name: _column(array) for name, array in coefficients.items()}, present, theta)


def _elasticity(m: Mechanism) -> Elasticity:
    assert m.elasticity is not None, m.name  # requests for these quantities are refused without
    return m.elasticity


def _column(array: Array) -> Array:
    return array[:, None]
