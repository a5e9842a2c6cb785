"""Old names of what a robot does: each works for one release, and warns with the new one."""

from collections.abc import Callable
from functools import wraps
from typing import Any, TypeVar

from jounce.core.deprecated import deprecate_function, warn_deprecated
from jounce.core.errors import JounceError
from jounce.robot.applications import Applications
from jounce.robot.deprecated_elastic import old_attribute

F = TypeVar("F", bound=Callable[..., Any])


def _deprecate_method(method: F) -> F:
    """The function of `jounce` that a method was: its first argument is the robot."""
    name = method.__name__

    @wraps(method)
    def called(robot: Applications, *args: Any, **keywords: Any) -> Any:
        warn_deprecated(f"jounce.{name}(robot, ...)", f"robot.{name}(...)")
        if not isinstance(robot, Applications):
            raise JounceError(f"{name}() expects a jounce.Robot, got {type(robot).__name__}; try jounce.load")
        return method(robot, *args, **keywords)

    return called  # type: ignore[return-value]  # type checkers know the method alone


casadi_function = _deprecate_method(Applications.casadi_function)
codegen = _deprecate_method(Applications.codegen)
excite = _deprecate_method(Applications.excite)
identify = _deprecate_method(Applications.identify)
report = _deprecate_method(Applications.report)
symbolic = _deprecate_method(Applications.symbolic)


def _forces_from(robot: Any, library: str, model: Any, forces: Any, q: Any = None) -> Any:
    from jounce.io.models import states

    return states.forces_from(robot.mechanism, states.read_model_layout(library, model), forces, q)


def _state_to(self: Any, library: str, *rates: Any, base: Any, model: Any) -> tuple[Any, ...]:
    vectors = self.state_to(library, *rates, base=base, model=model)
    return vectors if isinstance(vectors, tuple) else (vectors,)


class OldMethods:
    """The old names of methods of a robot."""

    state_from_pinocchio = deprecate_function(
        "state_from_pinocchio()", 'state_from("pinocchio", q, v, a, model=...)',
        lambda self, q, v=None, a=None, *, model: self.state_from("pinocchio", q, v, a, model=model),
    )  # fmt: skip
    state_from_mujoco = deprecate_function(
        "state_from_mujoco()", 'state_from("mujoco", qpos, qvel, qacc, model=...)',
        lambda self, qpos, qvel=None, qacc=None, *, model: self.state_from("mujoco", qpos, qvel, qacc, model=model),
    )  # fmt: skip
    state_to_pinocchio, state_to_mujoco = (
        deprecate_function(
            f"state_to_{library}()", f'state_to("{library}", q, qd, q2d, model=...)',
            lambda self, q, qd=None, q2d=None, *, model, base=None, to=library: _state_to(
                self, to, q, qd, q2d, base=base, model=model
            ),
        )
        for library in ("pinocchio", "mujoco")
    )  # fmt: skip
    forces_from_pinocchio = deprecate_function(
        "forces_from_pinocchio()", 'state_from("pinocchio", q, forces=tau, model=...).Q',
        lambda self, tau, *, model: _forces_from(self, "pinocchio", model, tau),
    )  # fmt: skip
    forces_from_mujoco = deprecate_function(
        "forces_from_mujoco()", 'state_from("mujoco", qpos, forces=qfrc, model=...).Q',
        lambda self, qfrc, qpos=None, *, model: _forces_from(self, "mujoco", model, qfrc, qpos),
    )  # fmt: skip
    forces_to_pinocchio, forces_to_mujoco = (
        deprecate_function(
            f"forces_to_{library}()", f'state_to("{library}", Q=Q, base=C, model=...)',
            lambda self, Q, *, model, base=None, to=library: self.state_to(to, Q=Q, base=base, model=model),
        )
        for library in ("pinocchio", "mujoco")
    )  # fmt: skip
    along = old_attribute("along", "motors_along")
    currents = old_attribute("currents", "motor_currents")
    energy = old_attribute("energy", "elastic_energy")
    robot = old_attribute("robot")
    voltages = old_attribute("voltages", "motor_voltages")
