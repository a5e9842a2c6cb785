"""Higher-order inverse dynamics: a robot and a motion in, the drive forces Q and their exact time derivatives out."""

from jounce.core.version import __version__

TYPE_CHECKING = False  # typing is not imported: until the command begins, Ctrl-C has Python's own traceback
if TYPE_CHECKING:
    from typing import Any

    from jounce._report import Report
    from jounce.actuators.along import ElasticAlong
    from jounce.core.errors import JounceError, JounceWarning, UncertainError
    from jounce.dynamics.base_parameters import BaseParameters
    from jounce.engine.along import Along
    from jounce.identification import Excitation, ForceResidual, Identification, IdentifiedParameter
    from jounce.io.models.states import RobotState
    from jounce.limits.check import Check, CheckedLimit
    from jounce.limits.retime import Retiming
    from jounce.limits.slowdown import Slowdown
    from jounce.model.antagonists import AntagonisticSprings
    from jounce.model.drives import Drives
    from jounce.model.elasticity import Elasticity
    from jounce.model.limits import Limits
    from jounce.model.loops import Closure, Loop
    from jounce.model.mechanism import Mechanism
    from jounce.model.motors import Motor
    from jounce.model.spring_table import SpringTable
    from jounce.model.springs import CubicSpring, SpringFunction
    from jounce.motion import Motion
    from jounce.native.kernel import Kernel
    from jounce.robot import Robot
    from jounce.robot.elastic import ElasticRobot
    from jounce.robot.loading import load
    from jounce.robot.motions import load_motion
    from jounce.robot.old import casadi_function, codegen, excite, identify, report, symbolic  # noqa: F401
    from jounce.robot.saving import save
    from jounce.spatial.inertia import inertia_matrix

__all__ = [
    "Along",
    "AntagonisticSprings",
    "BaseParameters",
    "Check",
    "CheckedLimit",
    "Closure",
    "CubicSpring",
    "Drives",
    "ElasticAlong",
    "ElasticRobot",
    "Elasticity",
    "Excitation",
    "ForceResidual",
    "Identification",
    "IdentifiedParameter",
    "JounceError",
    "JounceWarning",
    "Kernel",
    "Limits",
    "Loop",
    "Mechanism",
    "Motion",
    "Motor",
    "Report",
    "Retiming",
    "Robot",
    "RobotState",
    "Slowdown",
    "SpringFunction",
    "SpringTable",
    "UncertainError",
    "__version__",
    "inertia_matrix",
    "load",
    "load_motion",
    "save",
]
_LATER = {  # what is imported when it is first asked for, so that whatever needs little of it starts at once
    "Along": "jounce.engine.along",
    "AntagonisticSprings": "jounce.model.antagonists",
    "BaseParameters": "jounce.dynamics.base_parameters",
    "Check": "jounce.limits.check",
    "CheckedLimit": "jounce.limits.check",
    "Closure": "jounce.model.loops",
    "CubicSpring": "jounce.model.springs",
    "Drives": "jounce.model.drives",
    "ElasticAlong": "jounce.actuators.along",
    "ElasticRobot": "jounce.robot.elastic",
    "Elasticity": "jounce.model.elasticity",
    "Excitation": "jounce.identification",
    "ForceResidual": "jounce.identification",
    "Identification": "jounce.identification",
    "IdentifiedParameter": "jounce.identification",
    "JounceError": "jounce.core.errors",
    "UncertainError": "jounce.core.errors",
    "JounceWarning": "jounce.core.errors",
    "Kernel": "jounce.native.kernel",
    "Limits": "jounce.model.limits",
    "Loop": "jounce.model.loops",
    "Mechanism": "jounce.model.mechanism",
    "Motion": "jounce.motion",
    "Motor": "jounce.model.motors",
    "Report": "jounce._report",
    "Retiming": "jounce.limits.retime",
    "Robot": "jounce.robot",
    "RobotState": "jounce.io.models.states",
    "Slowdown": "jounce.limits.slowdown",
    "SpringFunction": "jounce.model.springs",
    "SpringTable": "jounce.model.spring_table",
    "inertia_matrix": "jounce.spatial.inertia",
    "load": "jounce.robot.loading",
    "load_motion": "jounce.robot.motions",
    "save": "jounce.robot.saving",
}
_LATER |= dict.fromkeys(("casadi_function", "codegen", "excite", "identify", "report", "symbolic"), "jounce.robot.old")


def __getattr__(name: str) -> "Any":
    if name not in _LATER:
        raise AttributeError(f"module 'jounce' has no attribute {name!r}")
    from importlib import import_module

    globals()[name] = getattr(import_module(_LATER[name]), name)
    return globals()[name]


def __dir__() -> list[str]:
    return [*__all__]
