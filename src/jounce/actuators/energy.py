"""Energies of links, rotors and springs, and what the series of dampers leave out at one instant."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

from jounce.arguments import rates
from jounce.arguments.rates import convert_rates
from jounce.core.errors import JounceError
from jounce.core.scalars import Array, broadcast
from jounce.dynamics import coupling, joint_springs
from jounce.dynamics.joint_springs import elasticity_of
from jounce.dynamics.quantities import QUANTITIES
from jounce.engine.engine import Engine, with_mechanism
from jounce.engine.plan import compute
from jounce.model.scalar_casting import cast_model
from jounce.model.springs import DampedSpring
from jounce.spatial.series import column_series

_PLANT = QUANTITIES["elastic_forward_dynamics"]
STATE = replace(_PLANT, takes=replace(_PLANT.takes, rates=4))  # q, qd, theta, thetad, no forces


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


def energy(robot: Engine, given: Sequence[Any]) -> Energy:
    """The energies in a state q, qd, theta, thetad."""
    _check_elastic(robot, "elastic_energy")
    given, whole = rates.split_rates(robot.mechanism, given)
    names = STATE.takes.motors[:4]
    q, qd, theta, thetad = arrays = broadcast(convert_rates(robot.mechanism, given, STATE), [1] * 4, names)
    m, at = cast_model(robot.mechanism, arrays), q if whole is None else whole
    e, joints = elasticity_of(m), elasticity_of(m).joints_of_motors
    rigid = elasticity_of(robot.mechanism).of_motors.is_rigid * 1
    v, delta = thetad + rigid * (qd[..., joints] - thetad), (theta - q[..., joints])[..., None]
    rotors = (e.of_motors.rotor * v * v).sum(-1) * 0.5
    if e.level is not None:
        rotors = rotors + coupling.spin_energy(m, column_series([q, qd]), column_series([theta, thetad]))[0][..., 0, 0]
    return Energy(
        compute(robot, "kinetic_energy", (at, qd)),
        rotors,
        compute(robot, "potential_energy", (at,)),
        joint_springs.spring_energy(m, delta)[..., 0, 0],
    )


def damping_error(robot: Engine, given: Sequence[Any], wrench: Any) -> Array:
    """The last term of the series of dampers, by which motor positions with one term less differ."""
    _check_elastic(robot, "damping_error")
    e = elasticity_of(robot.mechanism)
    if not e.dampers:
        raise JounceError(f"{robot.name}: no joint has a damper; robot.elastic(..., damping=...) states one")
    laws = [replace(law, terms=law.terms - 1) if isinstance(law, DampedSpring) else law for law in e.springs]
    fewer = with_mechanism(robot, replace(robot.mechanism, elasticity=replace(e, springs=tuple(laws))))
    both = [compute(x, "motor_positions", given, wrench=wrench) for x in (robot, fewer)]
    theta, other = (x[0] if isinstance(x, tuple) else x for x in both)
    return abs(theta - other)


def _check_elastic(robot: Engine, what: str) -> None:
    """Raise `JounceError` if joints are rigid or the base moves."""
    if reason := STATE.obstacle(robot.mechanism):
        raise JounceError(f"{what} of {robot.name!r}{reason}")
    if robot.mechanism.floats:
        raise JounceError(f"{what}: the base of {robot.name!r} moves; expected one at rest")
