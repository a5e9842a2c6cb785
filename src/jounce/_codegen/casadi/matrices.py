"""Arrays of jounce as matrices of CasADi, whose entries are stored column after column."""

import re
from math import prod

from jounce.core.scalars import Array
from jounce.dynamics.computation import Computation, Port, Shape


def matrix_shape(shape: Shape) -> Shape:
    """The rows and columns of an array: one column of a vector, several matrices one below the other."""
    return (prod(shape[:-1]), shape[-1]) if shape[2:] else (*shape, 1, 1)[:2]


def function_name(computation: Computation) -> str:
    """The quantity with its body and frame as CasADi takes a name: letters and digits, single underscores between."""
    place = [computation.body or "", computation.frame if computation.quantity.gives.frames else ""]
    return "_".join(re.findall("[A-Za-z0-9]+", "_".join([computation.name, *place])))


def element_place(port: Port, i: int) -> str:
    """The place of the i-th scalar of an array, row after row, where matrices are stored column after column."""
    rows, columns = matrix_shape(port.shape)
    return f"{port.name}[{i % columns * rows + i // columns}]"


def from_columns(port: Port, entries: Array) -> Array:
    """The arrays (..., *shape) of a port, of the entries (..., size) of their matrices, column after column."""
    lead = entries.shape[:-1]
    return entries.reshape(*lead, *matrix_shape(port.shape)[::-1]).mT.reshape(*lead, *port.shape)


def to_columns(port: Port, arrays: Array) -> Array:
    """The entries (..., size) of matrices, column after column, of the arrays (..., *shape) of a port."""
    lead = arrays.shape[: arrays.ndim - len(port.shape)]
    return arrays.reshape(*lead, *matrix_shape(port.shape)).mT.reshape(*lead, port.size)
