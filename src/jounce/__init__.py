"""Higher-order inverse dynamics: a robot and a motion in, the drive forces Q and their exact time derivatives out.

What is given wrongly, by type, shape, name or range, is refused with `JounceError`: one line that says what came, what
was expected and what cures it. Sections `Raises` of docstrings state what else a call refuses.
"""

from jounce.core.version import __version__

TYPE_CHECKING = False  # typing is not imported: until the command begins, Ctrl-C has Python's own traceback
if TYPE_CHECKING:
    from typing import Any

    from jounce._report import Report
    from jounce.actuators.motors import ElasticAlong
    from jounce.core.errors import JounceError, JounceWarning, UncertainError
    from jounce.dynamics.base_parameters import BaseParameters
    from jounce.engine.along import Along
    from jounce.identification import (
        Excitation,
        ForceResidual,
        Identification,
        IdentifiedLog,
        IdentifiedParameter,
        Payload,
        PayloadParameter,
    )
    from jounce.io.models.states import RobotState
    from jounce.limits.explanation import Explanation
    from jounce.limits.retime import Retiming
    from jounce.limits.slowdown import Slowdown
    from jounce.limits.verdicts import Check, CheckedLimit
    from jounce.live.estimator import LiveRates
    from jounce.live.forces import LiveForces, LiveLinks
    from jounce.live.guard import Guard, GuardState
    from jounce.live.innovations import Trust
    from jounce.model.contacts import Contact
    from jounce.model.drive_trains import Drives
    from jounce.model.elasticity import Elasticity, Motor
    from jounce.model.limits import Limits
    from jounce.model.loops import Closure, Loop
    from jounce.model.mechanism import Mechanism
    from jounce.model.spring_deflection import AntagonisticSprings
    from jounce.model.springs import CubicSpring, SpringFunction, SpringTable
    from jounce.motion import Motion
    from jounce.motion.channel import Channel
    from jounce.native.kernel import Kernel
    from jounce.robot import Robot
    from jounce.robot.loading import load
    from jounce.robot.motions import load_motion
    from jounce.robot.saving import save
    from jounce.spatial.inertia import inertia_matrix

__all__ = [
    "Along", "AntagonisticSprings", "BaseParameters", "Channel", "Check", "CheckedLimit", "Closure", "Contact",
    "CubicSpring", "Drives", "ElasticAlong", "Elasticity", "Excitation", "Explanation", "ForceResidual", "Guard",
    "GuardState", "Identification", "IdentifiedLog", "IdentifiedParameter", "JounceError", "JounceWarning",
    "Kernel", "Limits", "LiveForces", "LiveLinks", "LiveRates", "Loop", "Mechanism", "Motion", "Motor", "Payload",
    "PayloadParameter", "Report", "Retiming", "Robot", "RobotState", "Slowdown", "SpringFunction", "SpringTable",
    "Trust", "UncertainError", "__version__", "inertia_matrix", "load", "load_motion", "save",
]  # fmt: skip
_NAMES = {  # of modules, imported when first asked for one of them, so that whatever needs little of it starts at once
    "_report": "Report",
    "actuators.motors": "ElasticAlong",
    "core.errors": "JounceError JounceWarning UncertainError",
    "dynamics.base_parameters": "BaseParameters",
    "engine.along": "Along",
    "identification": (
        "Excitation ForceResidual Identification IdentifiedLog IdentifiedParameter Payload PayloadParameter"
    ),
    "io.models.states": "RobotState",
    "limits.verdicts": "Check CheckedLimit",
    "limits.explanation": "Explanation",
    "limits.retime": "Retiming",
    "limits.slowdown": "Slowdown",
    "live.estimator": "LiveRates",
    "live.forces": "LiveForces LiveLinks",
    "live.guard": "Guard GuardState",
    "live.innovations": "Trust",
    "model.contacts": "Contact",
    "model.drive_trains": "Drives",
    "model.elasticity": "Elasticity Motor",
    "model.limits": "Limits",
    "model.loops": "Closure Loop",
    "model.mechanism": "Mechanism",
    "model.spring_deflection": "AntagonisticSprings",
    "model.springs": "CubicSpring SpringFunction SpringTable",
    "motion": "Motion",
    "motion.channel": "Channel",
    "native.kernel": "Kernel",
    "robot": "Robot",
    "robot.loading": "load",
    "robot.motions": "load_motion",
    "robot.saving": "save",
    "spatial.inertia": "inertia_matrix",
}
_LATER = {name: f"jounce.{module}" for module, names in _NAMES.items() for name in names.split()}


def __getattr__(name: str) -> "Any":
    if name not in _LATER:
        raise AttributeError(f"module 'jounce' has no attribute {name!r}")
    from importlib import import_module

    # Kept in this module, so that the next access does not come here.
    value = getattr(import_module(_LATER[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return [*__all__]
