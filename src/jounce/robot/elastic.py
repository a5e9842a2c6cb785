"""What release 0.1 had of robots with elastic joints: it warns with the new name, or is refused with both meanings."""

from typing import Any

from jounce.core.deprecated import warn_of_old
from jounce.core.errors import JounceError, one_of
from jounce.dynamics.quantities import QUANTITIES
from jounce.engine.engine import Engine

OLD_NAMES = {  # of attributes of `ElasticRobot`
    "along": "motors_along",
    "currents": "motor_currents",
    "energy": "elastic_energy",
    "robot": "",
    "voltages": "motor_voltages",
}


def renamed_attribute(robot: Engine, old: str) -> Any:
    """An attribute of `ElasticRobot` that `Robot` has not, for robots with elastic joints."""
    if not _is_elastic(robot):
        raise AttributeError(f"{type(robot).__name__!r} object has no attribute {old!r}", name=old, obj=robot)
    if not (new := OLD_NAMES[old]):
        warn_of_old("arm.robot", "arm itself; forces of its links are arm.inverse_dynamics(..., side='links')")
        return robot
    warn_of_old(f"arm.{old}(...)", f"arm.{new}(...)")
    return getattr(robot, new)


def check_side(robot: Engine, name: str, side: str | None) -> None:
    """Raise `JounceError` if a quantity of the links is not asked for as such, where joints are elastic."""
    if side is not None:
        one_of("side", side, ["links"], name)
    elif _is_elastic(robot):
        raise JounceError(
            f"{name} of {robot.name!r}, whose joints are elastic: {name}(..., side='links') is that of the links, as it"
            f" was of loaded robots and of arm.robot; {QUANTITIES[name].of_motors}(...) is what it was of"
            " robot.elastic(...) in release 0.1"
        )


def compiled_name(robot: Engine, quantity: str | None) -> str:
    """The quantity that `Robot.compile` compiles: forces where none is named, unless joints are elastic."""
    if quantity is None and _is_elastic(robot):
        raise JounceError(
            f"compile() of {robot.name!r}, whose joints are elastic: compile('inverse_dynamics') is that of the links,"
            " as it was of loaded robots and of arm.robot; compile('motor_torques', order), with an order of 0 by"
            " default, is what it was of robot.elastic(...) in release 0.1"
        )
    return "inverse_dynamics" if quantity is None else quantity


def _is_elastic(x: object) -> bool:
    return isinstance(x, Engine) and x.mechanism.elasticity is not None


class _OfElasticRobots(type):
    def __instancecheck__(cls, x: object) -> bool:
        warn_of_old("isinstance(arm, jounce.ElasticRobot)", "arm.elasticity is not None")
        return _is_elastic(x)


class ElasticRobot(metaclass=_OfElasticRobots):
    """Robots with elastic joints, which are of the type `Robot` now."""

    def __new__(cls, robot: Any) -> Any:
        """Return the robot itself."""
        if not isinstance(robot, Engine):
            raise JounceError(f"ElasticRobot() expects a Robot, got {type(robot).__name__}; try robot.elastic")
        if not _is_elastic(robot):
            raise JounceError(f"{robot.name}: its joints are rigid; robot.elastic(stiffness) makes them elastic")
        warn_of_old("ElasticRobot(robot)", "robot itself, as robot.elastic(...) returns a Robot")
        return robot
