"""Rotors carried by links: their gyroscopic and inertia moments on the links, and the links' effect on them.

The rotor of motor j spins about the axis a_j of its carrier, a body p, at the speed r theta' against it; theta is the
position seen from the link, r the gear ratio, J the inertia about the axis. Mass and moments of the rotor at rest
belong to the carrier. The spin adds the moment

    n_j = d/dt (J r theta' a_j) = J r (theta'' a_j + theta' w_p x a_j)

to what moves the carrier, and the carrier's angular acceleration adds r J a_j . w_p' to the motor's torque.
"""

from dataclasses import dataclass
from functools import reduce
from operator import add

import numpy as np

from jounce.core.scalars import Array, reciprocal
from jounce.dynamics.joint_springs import elasticity_of
from jounce.dynamics.recursion import bodies
from jounce.dynamics.recursion.joints import take_rows
from jounce.dynamics.state import BASE_AT_REST
from jounce.model.mechanism import Mechanism
from jounce.spatial.lie import hat, rotation
from jounce.spatial.linear import Factors
from jounce.spatial.series import Series

GROUND_CARRIER = "world"  # as a carrier


@dataclass(frozen=True)
class Rotor:
    """A rotor on its carrier."""

    coordinate: int
    body: int  # of the carrier
    momentum: Array  # (3, 1), J r a in the axes of the carrier's body: of the spin, per theta'


def rotors(m: Mechanism) -> list[Rotor]:
    """The rotors of a mechanism that bodies carry; those on the ground have no effect on links."""
    found, e = [], m.elasticity
    for j, motor in enumerate(e.motors if e else ()):
        if e and motor is not None and motor.body is not None and motor.body != GROUND_CARRIER:
            frame = m.frame(motor.body)
            axis = rotation(frame.T) @ np.array(motor.axis)[:, None]
            found.append(Rotor(j, frame.body, axis * (e.rotor[j] / motor.gear)))
    return [rotor for rotor in found if rotor.body >= 0]


def _angular_velocities(m: Mechanism, V: Series) -> list[tuple[Rotor, Series]]:
    """The rotors with the angular velocities (..., 3, 1) of their carriers, of the twists of all bodies."""

    def of_body(body: int) -> Series:
        return V.map(lambda V: V[..., body, :3, :])

    return [(rotor, of_body(rotor.body)) for rotor in rotors(m)]


def reaction_wrenches(m: Mechanism, q: Series, theta: Series) -> Series:
    """The moments of spinning rotors on their carriers, as wrenches that the bodies exert, (..., 6nb, 1)."""
    V = bodies.twists(m, q, BASE_AT_REST, None)
    moments = []
    for rotor, w in _angular_velocities(m, V):
        spin, H = take_rows(theta, rotor.coordinate, rotor.coordinate + 1).dot, rotor.momentum
        place = np.zeros((6 * m.nb, 3), dtype=int)
        place[6 * rotor.body : 6 * rotor.body + 3] = np.eye(3, dtype=int)
        moments.append(place @ (H * spin.dot - hat(H[:, 0]) @ w * spin))
    return reduce(add, moments, 0 * V.map(lambda V: V.reshape((*V.shape[:-3], 6 * m.nb, 1))))


def motor_reactions(m: Mechanism, q: Series) -> Series:
    """r J a . w_p', the torque that a motor takes because its carrier turns faster and faster: (..., n, 1)."""
    total = 0 * q
    for rotor, w in _angular_velocities(m, bodies.twists(m, q, BASE_AT_REST, None)):
        unit = np.eye(m.n, dtype=int)[:, rotor.coordinate : rotor.coordinate + 1]
        total = total + unit @ (rotor.momentum.mT @ w.dot)
    return total


def accelerations(m: Mechanism, q: Series, M: Array, force: Array, free: Array) -> tuple[Array, Array]:
    """q2d and theta2d (..., n, 1), coupled by the inertia of the whole, at q, qd and q2d = 0.

    [ M    S ] [ q2d     ]   [ force               ]
    [ S^T  B ] [ theta2d ] = [ free - r J a . w_p' ]

    Column j of S is the force by which the spin of rotor j, per theta2d, acts on the links. The force on them is that
    of springs less that of q2d = theta2d = 0, gyroscopic moments included; `free` is what motors have left for rotors.
    """
    S, inverse_B = _spin_forces(m, q), reciprocal(elasticity_of(m).rotor)[:, None]
    left = inverse_B * (free - motor_reactions(m, q)[0])
    q2d = Factors.of(M - S * inverse_B.mT @ S.mT).solve(force - S @ left)
    return q2d, left - inverse_B * (S.mT @ q2d)


def _spin_forces(m: Mechanism, q: Series) -> Array:
    """S (..., n, n): the generalized forces of the momenta of rotors."""
    J, unit = bodies.jacobians(m, q, BASE_AT_REST, None)[0], np.eye(m.n, dtype=int)
    parts = [J[..., x.body, :3, :].mT @ x.momentum @ unit[x.coordinate : x.coordinate + 1] for x in rotors(m)]
    return reduce(add, parts, 0 * J[..., 0, :1, :] * unit)


def spin_energy(m: Mechanism, q: Series, theta: Series) -> Series:
    """The kinetic energy that couples rotors and carriers, J r theta' a . w_p: (..., 1, 1)."""
    total = 0 * take_rows(q, 0, 1)
    for rotor, w in _angular_velocities(m, bodies.twists(m, q, BASE_AT_REST, None)):
        total = total + rotor.momentum.mT @ w * take_rows(theta, rotor.coordinate, rotor.coordinate + 1).dot
    return total
