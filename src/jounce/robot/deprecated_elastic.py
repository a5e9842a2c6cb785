"""What release 0.1 had of robots with elastic joints: it warns with the new name, or is refused with both meanings."""

from typing import Any

from jounce.core.deprecated import warn_deprecated
from jounce.core.errors import JounceError, check_choice
from jounce.dynamics.quantities import QUANTITIES
from jounce.engine.engine import Engine


def old_attribute(old: str, new: str | None = None) -> property:
    """An attribute of `ElasticRobot` that `Robot` lacks, for elastic joints: under its new name, or the robot itself.

    A `__getattr__` in its place would slow every call of every robot's methods by 0.1 us.
    """
    itself = ("arm.robot", "arm itself; forces of its links are arm.inverse_dynamics(..., side='links')")
    names = (f"arm.{old}(...)", f"arm.{new}(...)") if new else itself

    def found(robot: Engine) -> Any:
        if not _is_elastic(robot):
            raise AttributeError(f"{type(robot).__name__!r} object has no attribute {old!r}", name=old, obj=robot)
        warn_deprecated(*names)
        return getattr(robot, new) if new else robot

    return property(found)


def check_side(robot: Engine, name: str, side: str | None) -> None:
    """Raise `JounceError` if a quantity of the links is not asked for as such, where joints are elastic."""
    if side is not None:
        check_choice("side", side, ["links"], name)
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


class _ElasticRobotType(type):
    def __instancecheck__(cls, x: object) -> bool:
        warn_deprecated("isinstance(arm, jounce.ElasticRobot)", "arm.elasticity is not None")
        return _is_elastic(x)


class ElasticRobot(metaclass=_ElasticRobotType):
    """Robots with elastic joints, which are of the type `Robot` now."""

    def __new__(cls, robot: Any) -> Any:
        """Return the robot itself."""
        if not isinstance(robot, Engine):
            raise JounceError(f"ElasticRobot() expects a Robot, got {type(robot).__name__}; try robot.elastic")
        if not _is_elastic(robot):
            raise JounceError(f"{robot.name}: its joints are rigid; robot.elastic(stiffness) makes them elastic")
        warn_deprecated("ElasticRobot(robot)", "robot itself, as robot.elastic(...) returns a Robot")
        return robot
