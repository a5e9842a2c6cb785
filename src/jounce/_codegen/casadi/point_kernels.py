"""What native code computes at the points of a CasADi function: values, gradients of weighted sums, Hessians."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np

import casadi
from jounce._codegen.casadi.function import function_name, matrix_shape
from jounce._codegen.casadi.native import Blocks, Columns, PointFunction, PointLaw
from jounce.core.errors import JounceError, join_names
from jounce.core.scalars import Array
from jounce.core.typing import Product
from jounce.dynamics.computation import Computation, Port, Signature
from jounce.engine.backends import compile_ahead
from jounce.engine.engine import Engine
from jounce.model.mechanism import Mechanism


@cache  # for good: graphs of CasADi do not keep the function
def native_function(mechanism: Mechanism, computation: Computation, points: int) -> casadi.Function:
    """A computation by native code, for a number of points at each call."""
    kernels = PointKernels(Engine(mechanism), computation)
    signature = kernels.signature
    if other := [x.name for x in signature.inputs if x.displacement != x.shape or not x.is_free]:
        raise JounceError(
            f"native=True differentiates by vectors and wrenches, and {computation.describe(mechanism.name)} takes"
            f" {join_names(other)}; native=False serves it"
        )
    gradient = PointLaw(kernels.gradients, kernels.dependences_of_gradient, kernels.jacobian_of_gradient)
    law = PointLaw(kernels.values, kernels.dependences, kernels.jacobian, gradient)
    ports = ([(x.name, dense_columns(x, points)) for x in side] for side in (signature.inputs, signature.outputs))
    return PointFunction(function_name(computation), points, law, *ports)


def dense_columns(port: Port, points: int) -> casadi.Sparsity:
    """The matrices of all points, one beside the other."""
    rows, columns = matrix_shape(port.shape)
    return casadi.Sparsity.dense(rows, columns * points)


def from_columns(port: Port, entries: Array) -> Array:
    """The arrays (..., *shape) of a port, of the entries (..., size) of their matrices, column after column."""
    lead = entries.shape[:-1]
    return entries.reshape(*lead, *matrix_shape(port.shape)[::-1]).mT.reshape(*lead, *port.shape)


def to_columns(port: Port, arrays: Array) -> Array:
    """The entries (..., size) of matrices, column after column, of the arrays (..., *shape) of a port."""
    lead = arrays.shape[: arrays.ndim - len(port.shape)]
    return arrays.reshape(*lead, *matrix_shape(port.shape)).mT.reshape(*lead, port.size)


@dataclass(frozen=True, eq=False)
class PointKernels:
    """The kernels of a computation and of its derivatives, compiled when CasADi first asks for them."""

    robot: Engine
    computation: Computation

    @cached_property
    def signature(self) -> Signature:
        """The arrays that the values take and return."""
        return self.computation.signature(self.robot.mechanism)

    @cached_property
    def dependences(self) -> frozenset[tuple[int, int]]:
        """The pairs of an output and an input that it depends on."""
        both = self.signature.outputs, self.signature.inputs
        pairs = ((o, y, i, x) for o, y in enumerate(both[0]) for i, x in enumerate(both[1]))
        return frozenset((o, i) for o, y, i, x in pairs if x.first_order <= y.rate)

    @cached_property
    def dependences_of_gradient(self) -> frozenset[tuple[int, int]]:
        """The pairs of a gradient and what it depends on: all inputs, and the weights, which follow the outputs."""
        inputs = range(len(self.signature.inputs))
        return frozenset((a, b) for a in inputs for b in inputs) | {(i, self._weight(o)) for o, i in self.dependences}

    def values(self, columns: Columns) -> list[Array]:
        """The results."""
        return list(map(to_columns, self.signature.outputs, self._run(None, columns, ())))

    def gradients(self, columns: Columns) -> list[Array]:
        """The gradients of a weighted sum of the results."""
        return list(map(to_columns, self.signature.inputs, self._run("vjp", columns, self._weights(columns))))

    def jacobian(self, columns: Columns) -> Blocks:
        """The partial derivatives of the results: the gradients of single entries."""
        outputs, units = self.signature.outputs, np.eye(self.signature.outputs[-1].end)[:, None]
        found = self._run("vjp", columns, [units[..., y.start : y.end] for y in outputs])
        rows = list(
            map(to_columns, self.signature.inputs, found)
        )  # (entries of all outputs, points, size of the input)
        return {(o, i): np.moveaxis(rows[i][outputs[o].start : outputs[o].end], 0, -1) for o, i in self.dependences}

    def jacobian_of_gradient(self, columns: Columns) -> Blocks:
        """The Hessian of the weighted sum of the results, and the derivatives of its gradient by the weights."""
        inputs = self.signature.inputs
        (H,) = self._run("hessian", columns, self._weights(columns))
        entries = [to_columns(x, np.arange(x.start, x.end).reshape(x.shape)) for x in inputs]
        pairs = ((a, b) for a in range(len(inputs)) for b in range(len(inputs)))
        found = {(a, b): H[:, entries[b][:, None], entries[a]] for a, b in pairs}
        return found | {(i, self._weight(o)): block.mT for (o, i), block in self.jacobian(columns).items()}

    def _weight(self, output: int) -> int:
        """The place of a weight, after inputs and outputs."""
        return len(self.signature.inputs) + len(self.signature.outputs) + output

    def _weights(self, columns: Columns) -> Columns:
        return columns[self._weight(0) :]

    def _run(self, product: Product | None, columns: Columns, weights: Columns) -> Sequence[Array]:
        kernel = compile_ahead(self.robot, replace(self.computation, product=product))
        arrays = map(from_columns, self.signature.inputs, columns)
        found = kernel(*arrays, *map(from_columns, self.signature.outputs, weights))
        return found if isinstance(found, tuple) else (found,)
