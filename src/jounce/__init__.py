"""Higher-order inverse dynamics: a robot and a motion in, the drive forces Q and their exact time derivatives out."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from jounce.errors import JounceError, JounceWarning
from jounce.inertia import inertia_matrix
from jounce.io.loading import load
from jounce.robot import Robot

if TYPE_CHECKING:
    from jounce.casadi_functions import casadi_function
    from jounce.expressions import symbolic
    from jounce.io.motions.loading import load_motion
    from jounce.io.saving import save
    from jounce.printing import codegen

__version__ = "0.1.0"

__all__ = [
    "JounceError",
    "JounceWarning",
    "Robot",
    "__version__",
    "casadi_function",
    "codegen",
    "inertia_matrix",
    "load",
    "load_motion",
    "save",
    "symbolic",
]
_LATER = {  # what not every program needs is imported when it is first asked for
    "casadi_function": "jounce.casadi_functions",
    "codegen": "jounce.printing",
    "load_motion": "jounce.io.motions.loading",
    "save": "jounce.io.saving",
    "symbolic": "jounce.expressions",
}


def __getattr__(name: str) -> Any:
    if name not in _LATER:
        raise AttributeError(f"module 'jounce' has no attribute {name!r}")
    globals()[name] = getattr(import_module(_LATER[name]), name)
    return globals()[name]


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
