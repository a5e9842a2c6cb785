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
    """Printed C with the patterns that CasADi gives and takes.

    `before` is the beginning of its name. The code takes and gives some of them: those that are used, and not empty.
    """

    before: str
    code: PrintedFunction
    inputs: dict[str, Pattern]
    outputs: dict[str, Pattern]
    given: list[int]  # the numbers of the inputs that the code takes
    found: list[int]  # and of the outputs that it gives


@lru_cache(maxsize=32)  # two templates take them
def external_functions(f: PrintedFunction) -> list[ExternalFunction]:
    """Return a function and its derivatives by all inputs.

    Inputs are the state, then parameters.
    """
    # The names and the order are those that CasADi looks for: adj1_f takes the inputs, the outputs, and a weight
    # adj_y for each output y; it gives adj_x for each input x.
    inputs = sorted(f.signature.inputs, key=lambda x: x.role == "parameter")
    weights = [replace(y, name=f"adj_{y.name}", start=f.program.inputs + y.start) for y in f.outputs]
    seeded = [*inputs, *_unused(f.outputs), *weights]
    slopes = [replace(x, name=f"adj_{x.name}") for x in inputs]
    names = [x.name for x in (*seeded, *slopes, *_unused(slopes), *f.outputs)]
    repeated = next((x.name for x in inputs if names.count(x.name) > 1), None)
    if repeated is not None:
        raise JounceError(f"CasADi takes no parameter with the name {repeated!r} of another array; rename the symbol")
    gradient = differentiate.vjp(f.program)
    jacobian, hessian = _partials(f.program), _partials(gradient)
    # A Hessian is symmetric: the entries below its diagonal are those above, and take no operations.
    lower = np.tril_indices(len(gradient.outputs), -1)
    hessian[lower] = hessian[lower[::-1]]
    return [
        _external(f, "", f.program, inputs, f.outputs),
        _jacobian(f, "jac_", jacobian, inputs, f.outputs),
        _external(f, "adj1_", gradient, seeded, slopes),
        _jacobian(f, "jac_adj1_", hessian, seeded, slopes),
    ]


def _unused(outputs: Sequence[Port]) -> list[Port]:
    """Return the outputs as inputs of derivatives, which compute them again."""
    return [replace(y, name=f"out_{y.name}", role="unused") for y in outputs]


def _partials(program: Program) -> np.ndarray:
    """Return the nodes of all partial derivatives, (outputs, inputs).

    Each row is one reverse accumulation.
    """
    tape = Tape()
    evaluation = differentiate.evaluate(program, tape, [*tape.variables(program.inputs)])
    units = np.eye(len(program.outputs), dtype=int).tolist()
    return np.array([differentiate.adjoints(evaluation, unit) for unit in units], dtype=object)


def _jacobian(
    f: PrintedFunction, before: str, partials: np.ndarray, inputs: Sequence[Port], outputs: Sequence[Port]
) -> ExternalFunction:
    """Return the function of partial derivatives that are not zero.

    Those that are zero at all states are left out.
    """
    # A sparse block for each output and input, as CasADi stores it: column after column, the rows of the entries that
    # are not the node 0, and where each column begins among them.
    tape: Tape = partials[0, 0].tape
    ports, patterns, nodes = list[Port](), dict[str, Pattern](), list[Node]()
    for y in outputs:
        for x in inputs:
            block = partials[np.ix_(_order(y), _order(x))].T
            column, row = np.nonzero(block != tape.zero) if block.size > 0 else (_order(y)[:0],) * 2
            begins = np.searchsorted(column, np.arange(x.size + 1))
            name = f"jac_{y.name}_{x.name}"
            patterns[name] = (y.size, x.size, *begins.tolist(), *row.tolist())
            ports.append(Port(name, (len(row),), "result"))
            nodes += block[column, row].tolist()
    # The code gives the entries of each block as a vector; the patterns say where they stand.
    function = _external(
        f, before, factor(tape.program(nodes)), [*inputs, *_unused(outputs)], computation.number_scalars(ports)
    )
    return replace(function, outputs=patterns)


def _external(
    f: PrintedFunction, before: str, program: Program, inputs: Sequence[Port], outputs: Sequence[Port]
) -> ExternalFunction:
    """Return the function of a program between whole matrices."""
    given, found = (
        [k for k, x in enumerate(ports) if x.role != "unused" and x.size > 0] for ports in (inputs, outputs)
    )
    # In the code, parameters are arguments like the state, under names of their own.
    named = (replace(x, name=f"params_{x.name}", role="state") if x.role == "parameter" else x for x in inputs)
    used_inputs = [x for x in named if x.role != "unused"]
    code = replace(f, signature=Signature(tuple(used_inputs), tuple(outputs[k] for k in found)), program=program)
    input_patterns, output_patterns = ({x.name: _pattern(x) for x in ports} for ports in (inputs, outputs))
    return ExternalFunction(before, code, input_patterns, output_patterns, given, found)


def _pattern(port: Port) -> Pattern:
    """Return the pattern of a full matrix, or an empty one."""
    rows, columns = matrix_shape(port.shape)
    return (rows, columns, *[0] * (columns + 1)) if port.role == "unused" else (rows, columns, 1)


def _order(port: Port) -> np.ndarray:
    """Return the numbers of scalars of a port, by columns.

    They go column after column of its matrix. A port that is not used has none.
    """
    numbers = np.arange(port.start, port.end).reshape(matrix_shape(port.shape)).T.ravel()
    return numbers[:0] if port.role == "unused" else numbers


def matrix_shape(shape: Shape) -> Shape:
    """Return the rows and columns of an array as a matrix.

    A vector is one column; several matrices stand one below the other.
    """
    return (prod(shape[:-1]), shape[-1]) if len(shape) > 2 else (*shape, 1, 1)[:2]


def function_name(computation: Computation) -> str:
    """Return the name of a quantity as CasADi takes names.

    Its body and frame are parts of it. Names have letters and digits, with single underscores between.
    """
    place = [computation.body or "", computation.frame if computation.quantity.gives.frames else ""]
    return "_".join(re.findall("[A-Za-z0-9]+", "_".join([computation.name, *place])))


def element_place(port: Port, i: int) -> str:
    """Return the place of the i-th scalar of an array.

    Scalars are counted row after row. Matrices are stored column after column.
    """
    rows, columns = matrix_shape(port.shape)
    return f"{port.name}[{i % columns * rows + i // columns}]"


def from_columns(port: Port, entries: Array) -> Array:
    """Return the arrays (..., *shape) of entries (..., size).

    Entries are those of the matrix of a port, column after column.
    """
    lead = entries.shape[:-1]
    return entries.reshape(*lead, *matrix_shape(port.shape)[::-1]).mT.reshape(*lead, *port.shape)


def to_columns(port: Port, arrays: Array) -> Array:
    """Return the entries (..., size) of arrays (..., *shape).

    Entries are those of the matrix of a port, column after column.
    """
    lead = arrays.shape[: arrays.ndim - len(port.shape)]
    return arrays.reshape(*lead, *matrix_shape(port.shape)).mT.reshape(*lead, port.size)
