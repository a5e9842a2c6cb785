"""CasADi: functions of a robot's quantities, and C that CasADi loads."""

import re
from math import prod

from jounce.dynamics.computation import Computation, Shape


def matrix_shape(shape: Shape) -> Shape:
    """The rows and columns of an array: one column of a vector, several matrices one below the other."""
    return (prod(shape[:-1]), shape[-1]) if shape[2:] else (*shape, 1, 1)[:2]


def function_name(computation: Computation) -> str:
    """The quantity with its body and frame as CasADi takes a name: letters and digits, single underscores between."""
    place = [computation.body or "", computation.frame if computation.quantity.frames else ""]
    return "_".join(re.findall("[A-Za-z0-9]+", "_".join([computation.name, *place])))
