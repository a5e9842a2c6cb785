"""What release 0.1 had of robots with elastic joints: it warns with the new name, or is refused with both meanings."""

from jounce.core.errors import JounceError, check_choice
from jounce.dynamics.quantities import QUANTITIES
from jounce.engine.engine import Engine


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
