"""Motors behind elastic joints follow from the motion of the links.

Motor torques move both. Spong's model over series: all are columns (..., n, 1), or have a row per motor. Q is the force
of the links' inverse dynamics, theta the position of a motor seen from its link. A rigid joint has an infinite
stiffness, hence no deflection: its motor moves as the link does, its rotor counts in the mass matrix of the links, and
the motor torque, less the friction of the motor, acts on the link. theta and thetad that are given of such a joint are
not read: q and qd are. `motor_positions` and `motor_torques` go from links to motors, `plant_forces` and
`rotor_accelerations` from torques to motion.

Rotors that links carry couple with them beyond that model. The rotor of motor j spins about the axis a_j of its
carrier, a body p, at the speed r theta' against it, with the gear ratio r and the inertia J about the axis. Mass and
moments of the rotor at rest belong to the carrier. The spin adds the moment

    n_j = d/dt (J r theta' a_j) = J r (theta'' a_j + theta' w_p x a_j)

to what moves the carrier (`reaction_wrenches`), and the carrier's angular acceleration adds r J a_j . w_p' to the
motor's torque (`motor_reactions`). `coupled_accelerations` solves for both.

How often what runs: each function once per evaluation of a law, `motor_positions` with `level + 1` inverse dynamics of
the links where rotors couple with their carriers; `rotors` and `with_rigid_rotors` go over the motors of the robot.

The electrical side, `currents` and `voltages`, follows from torques and positions: i = tau / (r k), u = R i + L di/dt +
k r thetad.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, reduce
from operator import add

import numpy as np

from jounce.core.cures import SPONG_COUPLING, Remedy
from jounce.core.errors import JounceError, join_names, quote_value
from jounce.core.scalars import Array, is_zero, reciprocal
from jounce.dynamics import joint_springs
from jounce.dynamics.recursion import bodies
from jounce.dynamics.recursion.joints import take_rows
from jounce.dynamics.state import BASE_AT_REST
from jounce.model import drive_trains
from jounce.model.elasticity import Elasticity
from jounce.model.mechanism import Mechanism
from jounce.model.springs import CubicSpring
from jounce.spatial.lie import hat, rotation
from jounce.spatial.linear import Factors
from jounce.spatial.series import Series

Forces = Callable[[Series | None], Series]  # Q of the links' motion, with further wrenches that the bodies exert
GROUND_CARRIER = "world"  # as a carrier


def motor_torques(m: Mechanism, q: Series, theta: Series, phi: Series) -> Series:
    """Return tau = phi + B theta2d + F_m(thetad).

    Reactions of links that carry rotors are added.
    """
    e = joint_springs.elasticity_of(m)
    tau = phi + _column(e.of_motors.rotor) * theta.dot.dot + motor_friction(m, theta)
    return tau if e.level is None else tau + motor_reactions(m, q)


def motor_positions(
    m: Mechanism, q: Series, forces: Forces, inputs: joint_springs.SpringInputs = joint_springs.NO_INPUTS
) -> tuple[Series, Series]:
    """Return the motor positions theta and the spring forces phi.

    theta = q + delta, one row per motor. The springs carry phi = Q. With rotors that links carry, Q holds their
    moments: at level 0 those of rotors that turn as their joints do, at each further level those of the motor positions
    of the level below.
    """
    level = joint_springs.elasticity_of(m).level
    if level is None:
        delta, phi = joint_springs.deflect_springs(m, forces(None), inputs)
        return joint_springs.select_motors(m, q) + delta, phi
    # Q depends on theta by the moments of rotors, and theta on Q: each level puts the positions of the one before in.
    theta = q
    for _ in range(level + 1):
        delta, phi = joint_springs.deflect_springs(m, forces(reaction_wrenches(m, q, theta)), inputs)
        theta = q + delta
    return theta, phi


@lru_cache(maxsize=64)
def with_rigid_rotors(m: Mechanism) -> Mechanism:
    """Return the mechanism with rotors of rigid joints as armature.

    So its mass matrix holds them. Elastic robots have no other armature.
    """
    e = joint_springs.elasticity_of(m)
    armature = np.zeros(len(m.joints), dtype=np.result_type(e.rotor, m.G))
    for j in [j for j in np.flatnonzero(e.is_rigid) if not is_zero(e.rotor[j])]:
        # Armature belongs to joints, rotors to coordinates: a joint that follows this coordinate alone takes the rotor,
        # divided by the square of its ratio.
        lone_joints = np.flatnonzero((m.G[:, j] != 0) & (np.count_nonzero(m.G, axis=1) == 1))
        if lone_joints.size == 0:
            raise JounceError(
                f"the rotor of rigid joint {quote_value(m.coordinates[j])} needs a joint that follows this coordinate"
                " alone, but no joint does; give a finite stiffness"
            )
        armature[lone_joints[0]] = e.rotor[j] / m.G[lone_joints[0], j] ** 2
    acting = m.acting
    if armature.any():
        acting = (*acting, "armature")
    return replace(m, drives=replace(m.drives, armature=armature), acting=acting)


def spring_forces(m: Mechanism, q: Series, theta: Series) -> Series:
    """Return phi(theta - q) of the motors.

    Its rate is there too where there is no damper.
    """
    return joint_springs.spring_force(m, theta - joint_springs.select_motors(m, q))


def plant_forces(m: Mechanism, q: Series, theta: Series, tau: Array) -> tuple[Array, Array, Array]:
    """Return the forces on the links and springs, and motor torques.

    The torques are those of the motors less friction.
    """
    rigid, joints, phi = _rigid_factors(m), joint_springs.select_motors(m, q), spring_forces(m, q, theta)[0]
    # Motors of rigid joints turn with qd, whatever thetad is stated.
    motor_motion = Series.of([theta[0], theta[1] + rigid * (joints[1] - theta[1])])
    drive = tau - motor_friction(m, motor_motion)[0]
    # A spring transmits phi, which is 0 at a rigid joint; there the motor acts on the link itself.
    return joint_springs.sum_on_joints(m, phi + rigid * drive), phi, drive


def rotor_accelerations(m: Mechanism, q2d: Array, free: Array) -> Array:
    """Return theta2d from the torques `free` that turn rotors.

    Of a rigid joint it is q2d.
    """
    rigid = _rigid_factors(m)
    # 1 / B of elastic joints, 0 of rigid ones, which may have no rotor: nothing is divided by zero.
    inverse_rotor = reciprocal(_column(joint_springs.elasticity_of(m).of_motors.rotor) + rigid) * (1 - rigid)
    return inverse_rotor * free + rigid * joint_springs.select_motors(m, Series.of([q2d]))[0]


def _rigid_factors(m: Mechanism) -> Array:
    """Return 1 for motors of rigid joints, 0 for the others.

    The shape is (m, 1).
    """
    return _column(joint_springs.elasticity_of(m).of_motors.is_rigid) * 1


def linearization_obstacle(m: Mechanism) -> str | None:
    """Return why tau alone does not decide q4d, or None.

    The reason is the end of a sentence. Static feedback linearizes the robot only where it does.
    """
    e = joint_springs.elasticity_of(m)
    if e.level is not None or e.dampers or e.pairs:
        reason = "dampers, or joints with two motors" if e.level is None else f"coupling={e.level}"
        return f" is not available with {reason}; use {SPONG_COUPLING} and springs without dampers"
    if not e.is_rigid.any():
        return None
    joints = join_names(name for name, is_rigid in zip(m.coordinates, e.is_rigid, strict=True) if is_rigid)
    are = "are" if e.is_rigid.sum() > 1 else "is"
    cure = Remedy("; robot.elastic(stiffness) states finite stiffnesses")
    return f" needs elastic joints, but {joints} {are} rigid{cure}"


def native_obstacle(m: Mechanism) -> str | None:
    """Return why native code has no motor quantities, or None.

    The reason is the end of a sentence.
    """
    for name, law in zip(m.coordinates, joint_springs.elasticity_of(m).springs, strict=False):
        if law is not None and not (isinstance(law, CubicSpring) and law.has_fixed_steps):
            return (
                "supports springs that are linear, or stiffen cubically from a stiffness k above 0; that of joint"
                f" {quote_value(name)} is another"
            )
    return None


def motor_friction(m: Mechanism, theta: Series) -> Series:
    """Return F_m, the damping and friction of the motors.

    F_m(thetad) = d_m thetad + f tanh(thetad / eps), by the laws of drives.
    """
    e = joint_springs.elasticity_of(m).of_motors
    coefficients = {"damping": e.viscous, "friction": e.friction, "slope": reciprocal(e.eps)}
    present = [term for term in ("damping", "friction") if np.any(coefficients[term] != 0)]
    return drive_trains.forces({name: _column(array) for name, array in coefficients.items()}, present, theta)


def _column(array: Array) -> Array:
    return array[:, None]


# Rotors that links carry.
@dataclass(frozen=True)
class Rotor:
    """A rotor on its carrier."""

    coordinate: int
    body: int  # of the carrier
    momentum: Array  # (3, 1), J r a in the axes of the carrier's body: of the spin, per theta'


def rotors(m: Mechanism) -> list[Rotor]:
    """Return the rotors that bodies carry.

    Rotors on the ground have no effect on links.
    """
    e = m.elasticity
    if e is None:
        return []
    carried_rotors = []
    for j, motor in enumerate(e.motors):
        if motor is not None and motor.body is not None and motor.body != GROUND_CARRIER:
            # J r a: the inertia seen from the link is J r^2. Links fixed to the ground have the body -1.
            frame = m.frame(motor.body)
            axis = rotation(frame.T) @ np.array(motor.axis)[:, None]
            if frame.body >= 0:
                carried_rotors.append(Rotor(j, frame.body, axis * (e.rotor[j] / motor.gear)))
    return carried_rotors


def _angular_velocities(m: Mechanism, V: Series) -> list[tuple[Rotor, Series]]:
    """Return the rotors with the angular velocities of their carriers.

    These are (..., 3, 1). V are the twists of all bodies, (..., nb, 6, 1).
    """

    def angular_velocity(body: int) -> Series:
        return V.map(lambda V: V[..., body, :3, :])

    return [(rotor, angular_velocity(rotor.body)) for rotor in rotors(m)]


def reaction_wrenches(m: Mechanism, q: Series, theta: Series) -> Series:
    """Return the moments of spinning rotors as wrenches that the bodies exert.

    The shape is (..., 6nb, 1).
    """
    V = bodies.twists(m, q, BASE_AT_REST, None)
    moments = []
    for rotor, w in _angular_velocities(m, V):
        # n_j = J r (theta'' a + theta' w x a), with H = J r a, in the rows of the moment on the carrier.
        spin, H = take_rows(theta, rotor.coordinate, rotor.coordinate + 1).dot, rotor.momentum
        place = np.zeros((6 * m.nb, 3), dtype=int)
        place[6 * rotor.body : 6 * rotor.body + 3] = np.eye(3, dtype=int)
        moments.append(place @ (H * spin.dot - hat(H[:, 0]) @ w * spin))
    return reduce(add, moments, 0 * V.map(lambda V: V.reshape((*V.shape[:-3], 6 * m.nb, 1))))


def motor_reactions(m: Mechanism, q: Series) -> Series:
    """Return r J a . w_p', torques by angular accelerations of carriers.

    The shape is (..., n, 1).
    """
    total = 0 * q
    for rotor, w in _angular_velocities(m, bodies.twists(m, q, BASE_AT_REST, None)):
        unit = np.eye(m.n, dtype=int)[:, rotor.coordinate : rotor.coordinate + 1]
        total = total + unit @ (rotor.momentum.mT @ w.dot)
    return total


def coupled_accelerations(m: Mechanism, q: Series, M: Array, force: Array, free: Array) -> tuple[Array, Array]:
    """Return q2d and theta2d, coupled by the inertia of the whole.

    They are (..., n, 1). q is the motion with q2d = 0.

    [ M    S ] [ q2d     ]   [ force               ]
    [ S^T  B ] [ theta2d ] = [ free - r J a . w_p' ]

    Column j of S is the force by which the spin of rotor j, per theta2d, acts on the links. The force on them is that
    of springs less that of q2d = theta2d = 0, gyroscopic moments included; `free` is what motors have left for rotors.
    """
    S, inverse_B = _spin_forces(m, q), reciprocal(joint_springs.elasticity_of(m).rotor)[:, None]
    # theta2d where q2d = 0, by the second row; put into the first row, it leaves the Schur complement M - S B^-1 S^T.
    theta2d_at_rest = inverse_B * (free - motor_reactions(m, q)[0])
    q2d = Factors.of(M - S * inverse_B.mT @ S.mT).solve(force - S @ theta2d_at_rest)
    return q2d, theta2d_at_rest - inverse_B * (S.mT @ q2d)


def _spin_forces(m: Mechanism, q: Series) -> Array:
    """Return S, the generalized forces of the momenta of rotors.

    S is (..., n, n).
    """
    J, unit = bodies.jacobians(m, q, BASE_AT_REST, None)[0], np.eye(m.n, dtype=int)
    parts = [J[..., x.body, :3, :].mT @ x.momentum @ unit[x.coordinate : x.coordinate + 1] for x in rotors(m)]
    return reduce(add, parts, 0 * J[..., 0, :1, :] * unit)


def spin_energy(m: Mechanism, q: Series, theta: Series) -> Series:
    """Return the kinetic energy that couples rotors and carriers.

    It is J r theta' a . w_p, (..., 1, 1).
    """
    total = 0 * take_rows(q, 0, 1)
    for rotor, w in _angular_velocities(m, bodies.twists(m, q, BASE_AT_REST, None)):
        total = total + rotor.momentum.mT @ w * take_rows(theta, rotor.coordinate, rotor.coordinate + 1).dot
    return total


# The electrical side of motors.
def currents(e: Elasticity, tau: Series) -> Series:
    """Return i = tau / (r k)."""
    return _scale_terms(1 / (_motor_data(e, "gear") * _motor_data(e, "constant")), tau)


def voltages(e: Elasticity, theta: Series, tau: Series) -> Series:
    """Return u = R i + L di/dt + k r thetad.

    A rate of u takes one more rate of the torques, unless there is no inductance.
    """
    i, back = currents(e, tau), _motor_data(e, "constant") * _motor_data(e, "gear")
    u = _scale_terms(_motor_data(e, "resistance"), i) + _scale_terms(back, theta.dot)
    return u + _scale_terms(_motor_data(e, "inductance"), i.dot) if e.is_inductive else u


def electrical_outputs(
    e: Elasticity, theta: Sequence[Array], tau: Sequence[Array]
) -> tuple[tuple[Array, ...] | None, tuple[Array, ...] | None]:
    """Return currents and voltages, None where data or rates are missing."""
    lacks_constant, lacks_resistance = (np.isnan(_motor_data(e, name)).all() for name in ("constant", "resistance"))
    i, u = currents(e, Series.of(tau)), voltages(e, Series.of(theta), Series.of(tau))
    # u takes thetad, and with an inductance the rate of tau.
    voltage_terms = min(len(tau) - e.is_inductive, len(theta) - 1)
    has_voltages = not lacks_constant and not lacks_resistance and voltage_terms >= 1
    return None if lacks_constant else i.upto(len(tau) - 1), u.upto(voltage_terms - 1) if has_voltages else None


def current_obstacle(m: Mechanism) -> str | None:
    """Return why motors have no currents, or None.

    The reason is the end of a sentence.
    """
    if np.isnan(_motor_data(joint_springs.elasticity_of(m), "constant")).all():
        motor = Remedy(": motors=jounce.Motor(constant=..., gear=...)", " in its file")
        return f" needs the torque constant of a motor{motor}"
    return None


def voltage_obstacle(m: Mechanism) -> str | None:
    """Return why motors have no voltages, or None.

    The reason is the end of a sentence.
    """
    if np.isnan(_motor_data(joint_springs.elasticity_of(m), "resistance")).all():
        motor = Remedy(": motors=jounce.Motor(resistance=..., constant=...)", " in its file")
        return f" needs the resistance of a motor{motor}"
    return current_obstacle(m)


def _scale_terms(factors: Array, x: Series) -> Series:
    """Multiply by factors per motor without warnings of missing ones.

    Data that are not stated are NaN.
    """

    def product(x: Array) -> Array:
        with np.errstate(invalid="ignore"):
            return factors * x

    return x.map(product)


def _motor_data(e: Elasticity, name: str) -> np.ndarray:
    """Return one number per motor, NaN where it is not stated."""
    motors = [e.motors[j] if e.motors else None for j in e.joints_of_motors]
    values = [None if motor is None else getattr(motor, name) for motor in motors]
    return np.array([np.nan if x is None else x for x in values], dtype=float)
