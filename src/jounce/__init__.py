"""Higher-order inverse dynamics: a robot and a motion in, the drive forces Q and their exact time derivatives out."""

from jounce.casadi_functions import casadi_function
from jounce.codegen.generation import codegen
from jounce.errors import JounceError, JounceWarning
from jounce.expressions import symbolic
from jounce.inertia import inertia_matrix
from jounce.io.loading import load
from jounce.io.motions.loading import load_motion
from jounce.io.saving import save
from jounce.robot import Robot

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
