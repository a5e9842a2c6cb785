"""Motion of motors and links from motor torques, and the torques that linearise it; the forces of springs couple both.

A rigid joint is one with its motor: its rotor counts in the mass matrix of the links, and the motor torque, less the
friction of the motor, acts on the link. theta and thetad of such a joint are not read: q and qd are.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from jounce.actuators.rotors import coupled_accelerations
from jounce.arguments import positions
from jounce.arguments.rates import rates_of
from jounce.arguments.wrenches import wrenches_of
from jounce.core.errors import JounceError, listed, quoted
from jounce.core.scalars import Array, broadcast, reciprocal
from jounce.dynamics import coupling, elastic, stretch
from jounce.dynamics.stretch import elasticity_of
from jounce.engine.dispatch import compute
from jounce.engine.engine import Engine
from jounce.model.casting import cast_model
from jounce.model.elasticity import motor_names
from jounce.model.mechanism import Mechanism
from jounce.model.springs import DampedSpring
from jounce.spatial.series import columns

STATE = ("q", "qd", "theta", "thetad")


class Accelerations(NamedTuple):
    """Accelerations of the links and of the motors, (..., n) each."""

    q2d: Array
    theta2d: Array


class Energy(NamedTuple):
    """The energies of a robot with elastic joints, (...) each, in J."""

    kinetic: Array  # of the links
    rotors: Array
    potential: Array  # of gravity, and of springs that are parallel to the joints
    springs: Array  # between motors and links

    @property
    def total(self) -> Array:
        """Their sum."""
        return self.kinetic + self.rotors + self.potential + self.springs


def with_rigid_rotors(mechanism: Mechanism) -> Mechanism:
    """The mechanism whose mass matrix holds the rotors of rigid joints: as armature that acts, there is no other."""
    e = elasticity_of(mechanism)
    armature = np.zeros(mechanism.nb)
    for j in np.flatnonzero(e.is_rigid & (e.rotor > 0)):
        alone = np.flatnonzero((mechanism.G[:, j] != 0) & (np.count_nonzero(mechanism.G, axis=1) == 1))
        if not alone.size:
            raise JounceError(
                f"rigid joint {quoted(mechanism.coordinates[j])} moves no joint alone, which its rotor takes;"
                " state a finite stiffness"
            )
        armature[alone[0]] = e.rotor[j] / mechanism.G[alone[0], j] ** 2
    acting = (*mechanism.acting, *["armature"] * bool(armature.any()))
    return replace(mechanism, drives=replace(mechanism.drives, armature=armature), acting=acting)


def accelerations(plant: Engine, given: Sequence[Any], wrench: Any, method: str | None) -> Accelerations:
    """q2d and theta2d from q, qd, theta, thetad, tau; the mass matrix of `plant` holds the rotors of rigid joints."""
    m, at, (q, qd, theta, thetad, tau) = _checked(plant.mechanism, given, "tau")
    e, joints = elasticity_of(m).of_motors, elasticity_of(m).joints_of_motors
    rigid = elasticity_of(plant.mechanism).of_motors.is_rigid * 1
    force = _spring_force(m, q, theta, qd, thetad)[0]
    drive = tau - _friction(m, theta, thetad + rigid * (qd[..., joints] - thetad))
    Q = stretch.on_joints(m, (force + rigid * drive)[..., None])[..., 0]
    if e.level is not None and e.motors:
        W = wrenches_of(m, wrench, 0, [q])
        return Accelerations(*coupled_accelerations(m, [q, qd, theta, thetad], force, drive - force, W))
    q2d = compute(plant, "forward_dynamics", (at, qd, Q), wrench=wrench, method=method)
    free = reciprocal(e.rotor + rigid) * (1 - rigid)  # a rigid joint may have no rotor
    theta2d = free * (drive - force) + rigid * q2d[..., joints]
    return Accelerations(q2d, theta2d)


def linearizing_torques(robot: Engine, given: Sequence[Any], wrench: Any, method: str | None) -> Array:
    """The motor torques that make q4d what is given, in the state q, qd, theta, thetad."""
    _check_linearizable(robot.mechanism)
    m, at, (q, qd, theta, thetad, v) = _checked(robot.mechanism, given, "q4d")
    rigid = elasticity_of(robot.mechanism).is_rigid
    if rigid.any():
        joints = listed(name for name, held in zip(m.coordinates, rigid, strict=True) if held)
        raise JounceError(
            f"feedback_linearization() needs elastic joints, but {joints} {'are' if rigid.sum() > 1 else 'is'} rigid;"
            " robot.elastic(stiffness) states finite stiffnesses"
        )
    W = tuple(wrenches_of(m, wrench, 0, [q], 3)) or None
    Q = _spring_force(m, q, theta, qd, thetad)
    q2d, q3d = compute(robot, "forward_dynamics", (at, qd, Q[0], Q[1]), wrench=W and W[:2], method=method)
    return compute(robot, "motor_torques", (at, qd, q2d, q3d, v), wrench=W, method=method)


def damping_error(robot: Engine, given: Sequence[Any], wrench: Any) -> Array:
    """The last term of the series of dampers, by which motor positions with one term less differ."""
    e = elasticity_of(robot.mechanism)
    if not e.dampers:
        raise JounceError(f"{robot.name}: no joint has a damper; robot.elastic(..., damping=...) states one")
    laws = [replace(law, terms=law.terms - 1) if isinstance(law, DampedSpring) else law for law in e.springs]
    fewer = type(robot)(replace(robot.mechanism, elasticity=replace(e, springs=tuple(laws))))
    both = [compute(x, "motor_positions", given, wrench=wrench) for x in (robot, fewer)]
    theta, other = (x[0] if isinstance(x, tuple) else x for x in both)
    return abs(theta - other)


def _check_linearizable(mechanism: Mechanism) -> None:
    """Raise `JounceError` if tau does not decide q4d alone, by static feedback."""
    e = elasticity_of(mechanism)
    if e.level is not None or e.dampers or e.pairs:
        reason = "dampers, or joints with two motors" if e.level is None else f"coupling={e.level}"
        raise JounceError(
            f"feedback_linearization() is not available with {reason}; use coupling='spong' and springs without dampers"
        )


def energy(robot: Engine, given: Sequence[Any]) -> Energy:
    """The energies in a state q, qd, theta, thetad."""
    m, at, (q, qd, theta, thetad) = _checked(robot.mechanism, given)
    e, joints = elasticity_of(m), elasticity_of(m).joints_of_motors
    rigid = elasticity_of(robot.mechanism).of_motors.is_rigid * 1
    v, delta = thetad + rigid * (qd[..., joints] - thetad), (theta - q[..., joints])[..., None]
    rotors = (e.of_motors.rotor * v * v).sum(-1) * 0.5
    if e.level is not None:
        rotors = rotors + coupling.spin_energy(m, columns([q, qd]), columns([theta, thetad]))[0][..., 0, 0]
    return Energy(
        compute(robot, "kinetic_energy", (at, qd)),
        rotors,
        compute(robot, "potential_energy", (at,)),
        stretch.spring_energy(m, delta)[..., 0, 0],
    )


def _checked(mechanism: Mechanism, given: Sequence[Any], *last: str) -> tuple[Mechanism, Any, list[Array]]:
    """The mechanism and a state in the scalar type of the state, one array each, with the same batch axes.

    Before these stand the coordinates of the links as methods of the robot take them: all of the tree, if they came.
    """
    e, labels = elasticity_of(mechanism), (*STATE, *last)
    given, whole = positions.split_rates(mechanism, given)
    motors = replace(mechanism, coordinates=motor_names(e, mechanism.coordinates)) if e.pairs else mechanism
    links = rates_of(given[:2], 2, mechanism, lambda count: labels[:count])
    arrays = [*links, *rates_of(given[2:], len(labels) - 2, motors, lambda count: labels[2 : 2 + count])]
    arrays = broadcast(arrays, [1] * len(arrays), labels)
    return cast_model(mechanism, arrays), arrays[0] if whole is None else whole, arrays


def _spring_force(m: Mechanism, q: Array, theta: Array, qd: Array, thetad: Array) -> list[Array]:
    """phi(theta - q), and its rate, where there is no damper."""
    joints = elasticity_of(m).joints_of_motors
    delta = columns([theta - q[..., joints], thetad - qd[..., joints]])
    force = stretch.spring_force(m, delta)
    return [x[..., 0] for x in force.upto(0 if elasticity_of(m).dampers else 1)]


def _friction(m: Mechanism, theta: Array, thetad: Array) -> Array:
    return elastic.motor_friction(m, columns([theta, thetad]))[0][..., 0]
