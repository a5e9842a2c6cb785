"""Elastic joints over series: motor positions and motor torques from the motion of the links, by Spong's model.

All are columns (..., n, 1). Q is the force of the links' inverse dynamics, theta the position of a motor seen from its
link. A rigid joint has an infinite stiffness, hence no deflection: its motor moves as the link does.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import reduce
from operator import add

import numpy as np

from jounce._scalars import Array, is_numeric, reciprocal
from jounce.dynamics import coupling, deflections
from jounce.dynamics.recursion.joints import rows
from jounce.errors import JounceError, quoted
from jounce.model import drives
from jounce.model.elasticity import Elasticity, Law
from jounce.model.inversion import UnreachableError
from jounce.model.mechanism import Mechanism
from jounce.model.springs import CubicSpring, DampedSpring, Spring, force_along
from jounce.spatial.series import Series, joined

Forces = Callable[[Series | None], Series]  # Q of the links' motion, with further wrenches that the bodies exert


def motor_positions(m: Mechanism, q: Series, forces: Forces) -> Series:
    """theta = q + delta, where the springs exert Q."""
    return _motion(m, q, forces)[0]


def motor_torques(m: Mechanism, q: Series, forces: Forces) -> Series:
    """tau = Q + B theta2d + F_m(thetad), and what rotors feel of the links that carry them."""
    e, (theta, Q) = _elasticity(m), _motion(m, q, forces)
    tau = Q + _column(e.rotor) * theta.dot.dot + motor_friction(m, theta)
    return tau if e.level is None else tau + coupling.motor_reactions(m, q)


def _motion(m: Mechanism, q: Series, forces: Forces) -> tuple[Series, Series]:
    """The motor positions, and the forces Q that the springs exert on the links.

    With rotors that links carry, Q holds their moments: at level 0 those of rotors that turn as their joints do, at
    each further level those of the motor positions of the level below.
    """
    level = _elasticity(m).level
    if level is None:
        Q = forces(None)
        return q + deflection(m, Q), Q
    theta = q
    for _ in range(level + 1):
        Q = forces(coupling.reaction_wrenches(m, q, theta))
        theta = q + deflection(m, Q)
    return theta, Q


def deflection(m: Mechanism, Q: Series) -> Series:
    """delta = theta - q with phi(delta) = Q, and phi(delta) + D delta' = Q with a damper: of linear springs Q / K."""
    e = _elasticity(m)
    linear = _column(reciprocal(e.stiffness)) * Q
    if not e.springs:
        return linear
    parts = [
        rows(linear, j, j + 1) if law is None else _deflection(m, j, law, rows(Q, j, j + 1))
        for j, law in enumerate(e.springs)
    ]
    return joined(parts, axis=-2)


def _deflection(m: Mechanism, j: int, law: Law, Q: Series) -> Series:
    with of_joint(m, j):
        if isinstance(law, Spring):
            return deflections.of_spring(law, Q)
        assert isinstance(law, DampedSpring), law  # requests for these quantities are refused with two motors
        if not is_numeric(Q[0]):
            raise JounceError("a spring with a damper needs NumPy arrays of floats, on which its series is checked")
        sums = deflections.of_damped_spring(law.spring, law.damping, Q, law.terms)
        deflections.last_term(sums, law.time_constant)
        return sums[-1]


@contextmanager
def of_joint(m: Mechanism, j: int) -> Iterator[None]:
    """Within this context, errors begin with the name of a joint; those of one state keep its number."""
    joint = f"joint {quoted(m.coordinates[j])}"
    try:
        yield
    except UnreachableError as error:
        raise UnreachableError(f"{joint}: {error}", error.state) from None
    except JounceError as error:
        raise JounceError(f"{joint}: {error}") from None


def spring_force(m: Mechanism, delta: Series) -> Series:
    """phi(delta) + D delta' of springs and dampers, by which the motors act on the links.

    It is zero at rigid joints, whose force is unknown.
    """
    e = _elasticity(m)
    linear = _column(np.where(e.is_rigid, 0, e.stiffness)) * delta
    if not e.springs:
        return linear
    parts = [
        rows(linear, j, j + 1) if law is None else _force(law, rows(delta, j, j + 1)) for j, law in enumerate(e.springs)
    ]
    return joined(parts, axis=-2)


def _force(law: Law, delta: Series) -> Series:
    if isinstance(law, DampedSpring):
        return force_along(law.spring, delta) + delta.dot * law.damping
    assert isinstance(law, Spring), law
    return force_along(law, delta)


def spring_energy(m: Mechanism, delta: Array) -> Array:
    """The energy of the springs, (..., 1, 1)."""
    e = _elasticity(m)
    linear = _column(np.where(e.is_rigid, 0, e.stiffness)) * delta * delta * 0.5
    energies = [linear[..., j : j + 1, :] for j in range(m.n)]
    for j, law in enumerate(e.springs):
        spring = law.spring if isinstance(law, DampedSpring) else law
        if isinstance(spring, Spring):
            energies[j] = spring._energy(delta[..., j : j + 1, :])
    return reduce(add, energies)


def native_obstacle(m: Mechanism) -> str | None:
    """Why native code has no motor positions and torques, as the end of a sentence about native code, or None."""
    for name, law in zip(m.coordinates, _elasticity(m).springs, strict=False):
        if law is not None and not (isinstance(law, CubicSpring) and law.k3 >= 0):
            return f"supports springs that are linear or stiffen cubically; that of joint {quoted(name)} is another"
    return None


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
