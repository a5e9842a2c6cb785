"""Native code as a CasADi function, with exact first and second derivatives."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cache

import numpy as np

import casadi
from jounce._codegen.casadi.matrices import from_columns, function_name, matrix_shape, to_columns
from jounce._codegen.casadi.point_function import Blocks, Columns, PointFunction, PointLaw
from jounce.core.errors import JounceError, join_names
from jounce.core.scalars import Array
from jounce.core.typing import Product
from jounce.dynamics.computation import Computation, Port
from jounce.engine.backends import compile_ahead
from jounce.engine.engine import Engine
from jounce.engine.generic_methods import as_tuple
from jounce.model.mechanism import Mechanism


@cache  # for good: graphs of CasADi do not keep what is written in Python
def native_function(mechanism: Mechanism, computation: Computation, points: int) -> casadi.Function:
    """A computation by native code, of a number of points at each call; code is compiled when CasADi asks for it."""
    robot, signature = Engine(mechanism), computation.signature(mechanism)
    inputs, outputs = signature.inputs, signature.outputs
    if other := [x.name for x in inputs if x.displacement != x.shape or not x.is_free]:
        raise JounceError(
            f"native=True takes vectors and wrenches, but {computation.name} of {mechanism.name!r} takes"
            f" {join_names(other)}; native=False serves it"
        )
    compile_ahead(robot, computation)  # now, since errors within CasADi are those of CasADi
    first_weight = len(inputs) + len(outputs)
    pairs = [(o, i) for o in range(len(outputs)) for i in range(len(inputs))]
    dependences = {(o, i) for o, i in pairs if inputs[i].first_order <= outputs[o].rate}
    entries = [to_columns(x, np.arange(x.start, x.end).reshape(x.shape)) for x in inputs]

    def run(product: Product | None, columns: Columns, weights: Columns = ()) -> Sequence[Array]:
        kernel = compile_ahead(robot, replace(computation, product=product))
        return as_tuple(kernel(*map(from_columns, inputs, columns), *map(from_columns, outputs, weights)))

    def values(columns: Columns) -> Iterator[Array]:
        return map(to_columns, outputs, run(None, columns))

    def gradients(columns: Columns) -> Iterator[Array]:
        return map(to_columns, inputs, run("vjp", columns, columns[first_weight:]))

    def jacobian(columns: Columns) -> Blocks:  # gradients of single entries
        units = np.eye(outputs[-1].end)[:, None]
        found = run("vjp", columns, [units[..., y.start : y.end] for y in outputs])
        rows = list(map(to_columns, inputs, found))  # (entries of the outputs, points, size of the input)
        return {(o, i): np.moveaxis(rows[i][outputs[o].start : outputs[o].end], 0, -1) for o, i in dependences}

    def hessian(columns: Columns) -> Blocks:
        (H,) = run("hessian", columns, columns[first_weight:])
        own = {(a, b): H[:, y[:, None], x] for a, x in enumerate(entries) for b, y in enumerate(entries)}
        return own | {(i, first_weight + o): block.mT for (o, i), block in jacobian(columns).items()}

    every = {(a, b) for a in range(len(inputs)) for b in range(len(inputs))}
    gradient = PointLaw(gradients, every | {(i, first_weight + o) for o, i in dependences}, hessian)
    law = PointLaw(values, dependences, jacobian, gradient)
    sparsities = ({x.name: dense_columns(x, points) for x in ports} for ports in (inputs, outputs))
    return PointFunction(function_name(computation), points, law, *sparsities)


def dense_columns(port: Port, points: int) -> casadi.Sparsity:
    """The matrices of all points, next to each other."""
    rows, columns = matrix_shape(port.shape)
    return casadi.Sparsity.dense(rows, columns * points)
