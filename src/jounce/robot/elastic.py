"""What release 0.1 had of robots with elastic joints: it warns with the new name, or is refused with both meanings."""

from typing import Any

from jounce.core.deprecated import warn_of_old
from jounce.core.errors import JounceError, one_of
from jounce.dynamics.quantities import QUANTITIES
from jounce.engine.engine import Engine

RENAMED = {
    "along": "motors_along",
    "currents": "motor_currents",
    "energy": "elastic_energy",
    "voltages": "motor_voltages",
}


def renamed(robot: Engine, name: str) -> Any:
    """An attribute of `ElasticRobot` that `Robot` has not, for robots with elastic joints."""
    if name == "robot" and _is_elastic(robot):
        warn_of_old("arm.robot", "arm itself, as robot.elastic(...) returns a Robot")
        return robot
    if name not in RENAMED or not _is_elastic(robot):
        raise AttributeError(f"{type(robot).__name__!r} object has no attribute {name!r}", name=name, obj=robot)
    warn_of_old(f"arm.{name}(...)", f"arm.{RENAMED[name]}(...)")
    return getattr(robot, RENAMED[name])


def check_side(robot: Engine, name: str, side: str | None) -> None:
    """Raise `JounceError` if a quantity of the links is not asked for as such, where joints are elastic."""
    if side is not None:
        one_of("side", side, ["links"], name)
    elif _is_elastic(robot):
        raise JounceError(
            f"{name} of {robot.name!r}, whose joints are elastic: {QUANTITIES[name].of_motors}(...) is what it was in"
            f" release 0.1; {name}(..., side='links') is that of the links, as {name}(...) will be"
        )


def compiled_name(robot: Engine, quantity: str | None) -> str:
    """The quantity that `Robot.compile` compiles: forces where none is named, unless joints are elastic."""
    if quantity is None and _is_elastic(robot):
        raise JounceError(
            f"compile() of {robot.name!r}, whose joints are elastic: compile('motor_torques', order=0) is what it was"
            " in release 0.1; compile('inverse_dynamics') is that of the links, as compile() will be"
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
