"""Write the functions that `casadi.external` looks for, with matrices as CasADi stores them.

`external_functions` is the door: a quantity, its Jacobian, its gradients, and their Jacobian.

Matrices are stored column after column: `matrix_shape` says how an array of jounce lies in one, `to_columns` and
`from_columns` move its entries. A pattern is one as CasADi reads it: rows, columns, then 1 if all entries are stored,
else where each column begins among the stored entries, and the row of each.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from math import prod

import numpy as np

from jounce._codegen.printer import PrintedFunction
from jounce.core.errors import JounceError
from jounce.core.scalars import Array
from jounce.dynamics import computation
from jounce.dynamics.computation import Computation, Port, Shape, Signature
from jounce.program import differentiate
from jounce.program.passes import factor
from jounce.program.program import Node, Program, Tape

Pattern = tuple[int, ...]


@dataclass(frozen=True, eq=False)
class ExternalFunction:
    """Printed C, what its name begins with, and the patterns of all that CasADi gives and takes.

    The code takes and gives some of them: those that are used, and not empty.
    """

    before: str
    code: PrintedFunction
    inputs: dict[str, Pattern]
    outputs: dict[str, Pattern]
    given: list[int]
    found: list[int]


@lru_cache(maxsize=32)  # two templates take them
def external_functions(f: PrintedFunction) -> list[ExternalFunction]:
    """A function and its derivatives by all inputs: the state, then parameters."""
    inputs = sorted(f.signature.inputs, key=lambda x: x.role == "parameter")
    weights = [replace(y, name=f"adj_{y.name}", start=f.program.inputs + y.start) for y in f.outputs]
    seeded = [*inputs, *_unused(f.outputs), *weights]
    slopes = [replace(x, name=f"adj_{x.name}") for x in inputs]
    names = [x.name for x in (*seeded, *slopes, *_unused(slopes), *f.outputs)]
    if twice := next((x.name for x in inputs if names.count(x.name) > 1), None):
        raise JounceError(f"CasADi takes no parameter with the name {twice!r} of another array; rename the symbol")
    gradient = differentiate.vjp(f.program)
    of_values, of_gradient = _partials(f.program), _partials(gradient)
    lower = np.tril_indices(len(gradient.outputs), -1)
    of_gradient[lower] = of_gradient[lower[::-1]]  # a Hessian is symmetric
    return [
        _external(f, "", f.program, inputs, f.outputs),
        _jacobian(f, "jac_", of_values, inputs, f.outputs),
        _external(f, "adj1_", gradient, seeded, slopes),
        _jacobian(f, "jac_adj1_", of_gradient, seeded, slopes),
    ]


def _unused(outputs: Sequence[Port]) -> list[Port]:
    """The outputs as inputs of derivatives, which compute them again."""
    return [replace(y, name=f"out_{y.name}", role="unused") for y in outputs]


def _partials(program: Program) -> np.ndarray:
    """The nodes of the derivatives of all outputs by all inputs, row by row by reverse accumulation."""
    tape = Tape()
    evaluation = differentiate.evaluate(program, tape, [*tape.variables(program.inputs)])
    units = np.eye(len(program.outputs), dtype=int).tolist()
    return np.array([differentiate.adjoints(evaluation, unit) for unit in units], dtype=object)


def _jacobian(
    f: PrintedFunction, before: str, partials: np.ndarray, inputs: Sequence[Port], outputs: Sequence[Port]
) -> ExternalFunction:
    """The function of partial derivatives, without those that are zero at all states."""
    tape: Tape = partials[0, 0].tape
    ports, patterns, nodes = list[Port](), dict[str, Pattern](), list[Node]()
    for y in outputs:
        for x in inputs:
            block = partials[np.ix_(_order(y), _order(x))].T  # column after column
            column, row = np.nonzero(block != tape.zero) if block.size else (_order(y)[:0],) * 2
            begins = np.searchsorted(column, np.arange(x.size + 1))
            name = f"jac_{y.name}_{x.name}"
            patterns[name] = (y.size, x.size, *begins.tolist(), *row.tolist())
            ports.append(Port(name, (len(row),), "result"))
            nodes += block[column, row].tolist()
    made = _external(
        f, before, factor(tape.program(nodes)), [*inputs, *_unused(outputs)], computation.number_scalars(ports)
    )
    return replace(made, outputs=patterns)


def _external(
    f: PrintedFunction, before: str, program: Program, inputs: Sequence[Port], outputs: Sequence[Port]
) -> ExternalFunction:
    given, found = ([k for k, x in enumerate(ports) if x.role != "unused" and x.size] for ports in (inputs, outputs))
    named = (replace(x, name=f"params_{x.name}", role="state") if x.role == "parameter" else x for x in inputs)
    taken = [x for x in named if x.role != "unused"]
    code = replace(f, signature=Signature(tuple(taken), tuple(outputs[k] for k in found)), program=program)
    taken_patterns, made_patterns = ({x.name: _pattern(x) for x in ports} for ports in (inputs, outputs))
    return ExternalFunction(before, code, taken_patterns, made_patterns, given, found)


def _pattern(port: Port) -> Pattern:
    """The pattern of a matrix of which all entries are stored, or none."""
    rows, columns = matrix_shape(port.shape)
    return (rows, columns, *[0] * (columns + 1)) if port.role == "unused" else (rows, columns, 1)


def _order(port: Port) -> np.ndarray:
    """The numbers of the scalars of a port, column after column of its matrix; none of those that are not used."""
    numbers = np.arange(port.start, port.end).reshape(matrix_shape(port.shape)).T.ravel()
    return numbers[:0] if port.role == "unused" else numbers


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
