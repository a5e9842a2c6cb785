"""Higher-order inverse dynamics: a robot and a motion in, the drive forces Q and their exact time derivatives out."""

from jounce.codegen.generation import codegen
from jounce.errors import JounceError, JounceWarning
from jounce.inertia import inertia_matrix
from jounce.io.loading import load
from jounce.io.saving import save
from jounce.robot import Robot

__version__ = "0.1.0"

__all__ = ["JounceError", "JounceWarning", "Robot", "__version__", "codegen", "inertia_matrix", "load", "save"]
