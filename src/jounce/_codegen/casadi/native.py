"""Make native code a CasADi function with exact first and second derivatives.

CasADi enters Python at each evaluation, whatever the number of points: so one function computes all of them, columns
that do not depend on each other. Every Jacobian is a diagonal of blocks, and CasADi learns so before it differentiates:
of dense ones it would compute all columns, one after the other. Solvers ask for the Jacobian of the values, for the
gradient of a weighted sum of them, and for the Jacobian of that gradient.

`native_function` is the door: it makes the `PointLaw` of a computation, values and derivatives by kernels, each
compiled when CasADi first asks for it. A `PointFunction` is a callback that computes a law, and answers what CasADi
asks.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np

import casadi
from jounce._codegen.casadi.external import from_columns, function_name, matrix_shape, to_columns
from jounce.core import errors
from jounce.core.errors import JounceError, join_names, quote_value
from jounce.core.scalars import Array
from jounce.core.typing import Product
from jounce.dynamics.computation import Computation, Port
from jounce.engine import backends, generic_methods
from jounce.engine.engine import Engine
from jounce.model.mechanism import Mechanism
from jounce.native.kernel import refuse_names_and_masks

Columns = Sequence[Array]  # an array (points, size) per input: the entries of each point's matrix, column after column
Blocks = Mapping[tuple[int, int], Array]  # by output and input (points, columns, rows), as CasADi stores them
Sparsities = Iterable[casadi.Sparsity]


@cache  # for good: graphs of CasADi do not keep what is written in Python
def native_function(mechanism: Mechanism, computation: Computation, points: int) -> casadi.Function:
    """Return a computation of points by native code.

    It computes a number of points at each call. Code of derivatives is compiled when CasADi asks for it.
    """
    robot, signature = Engine(mechanism), computation.signature(mechanism)
    inputs, outputs = signature.inputs, signature.outputs
    other = [x.name for x in inputs if x.displacement != x.shape or not x.is_free]
    if len(other) > 0:
        raise JounceError(
            f"native=True takes vectors and wrenches, but {computation.name} of {mechanism.name!r} takes"
            f" {join_names(other)}; native=False serves it"
        )
    backends.compile_ahead(robot, computation)  # now, since errors within CasADi are those of CasADi
    # A gradient takes the inputs, the outputs, and a weight for each output. An output depends on the inputs that are
    # rates up to its own needs; all other blocks of the Jacobian are zero.
    first_weight = len(inputs) + len(outputs)
    pairs = [(o, i) for o in range(len(outputs)) for i in range(len(inputs))]
    dependences = {(o, i) for o, i in pairs if inputs[i].first_order <= outputs[o].rate}
    entries = [to_columns(x, np.arange(x.start, x.end).reshape(x.shape)) for x in inputs]

    # Between arrays (points, *shape) and columns (points, size), each point's matrix column after column.
    def run(product: Product | None, columns: Columns, weights: Columns = ()) -> Sequence[Array]:
        kernel = backends.compile_ahead(robot, replace(computation, product=product))
        return generic_methods.as_tuple(
            kernel(*map(from_columns, inputs, columns), *map(from_columns, outputs, weights))
        )

    def values(columns: Columns) -> Iterator[Array]:
        return map(to_columns, outputs, run(None, columns))

    def gradients(columns: Columns) -> Iterator[Array]:
        return map(to_columns, inputs, run("vjp", columns, columns[first_weight:]))

    def jacobian(columns: Columns) -> Blocks:
        # Gradients of single entries: unit weights (entries, 1, entries) give rows (entries, points, size of the
        # input).
        units = np.eye(outputs[-1].end)[:, None]
        gradients_of_entries = run("vjp", columns, [units[..., y.start : y.end] for y in outputs])
        rows = list(map(to_columns, inputs, gradients_of_entries))
        return {(o, i): np.moveaxis(rows[i][outputs[o].start : outputs[o].end], 0, -1) for o, i in dependences}

    def hessian(columns: Columns) -> Blocks:
        # Blocks of the gradient by inputs are those of the Hessian, by weights those of the Jacobian, transposed.
        (H,) = run("hessian", columns, columns[first_weight:])
        by_inputs = {(a, b): H[:, y[:, None], x] for a, x in enumerate(entries) for b, y in enumerate(entries)}
        return by_inputs | {(i, first_weight + o): block.mT for (o, i), block in jacobian(columns).items()}

    every = {(a, b) for a in range(len(inputs)) for b in range(len(inputs))}
    gradient = PointLaw(gradients, every | {(i, first_weight + o) for o, i in dependences}, hessian)
    law = PointLaw(values, dependences, jacobian, gradient)
    sparsities = ({x.name: dense_columns(x, points) for x in ports} for ports in (inputs, outputs))
    return PointFunction(function_name(computation), points, law, *sparsities)


def dense_columns(port: Port, points: int) -> casadi.Sparsity:
    """Return the pattern of full matrices, side by side.

    There is one for each point.
    """
    rows, columns = matrix_shape(port.shape)
    return casadi.Sparsity.dense(rows, columns * points)


@dataclass(frozen=True, eq=False)
class PointLaw:
    """A law of a function: its outputs, None where they are empty, and blocks of its Jacobian.

    `dependences` are the pairs of an output and an input that have a block. `gradient` computes the gradient of a
    weighted sum of the outputs, from the inputs, the outputs, which it does not use, and the weights.
    """

    compute: Callable[[Columns], Iterable[Array | None]]
    dependences: Set[tuple[int, int]] = frozenset()
    blocks: Callable[[Columns], Blocks] | None = None
    gradient: "PointLaw | None" = None


class PointFunction(casadi.Callback):
    """A function of CasADi whose columns a law computes.

    Its derivatives live as long as itself.
    """

    def __init__(
        self, name: str, points: int, law: PointLaw, inputs: Mapping[str, Any], outputs: Mapping[str, Any]
    ) -> None:
        super().__init__()
        self._points, self._law, self._derivatives = points, law, list[PointFunction]()
        # CasADi asks a callback by methods; they are attributes of the instance, since they depend on the law.
        answers: dict[str, Callable[..., Any]] = {
            "has_eval_buffer": lambda: True,
            "has_jacobian": lambda: law.blocks is not None,
            "has_jac_sparsity": lambda output, by: law.blocks is not None,
            "has_reverse": lambda count: law.gradient is not None,
        }
        for side, ports in (("in", inputs), ("out", outputs)):
            answers[f"get_n_{side}"] = ports.__len__
            answers[f"get_name_{side}"] = list(ports).__getitem__
            answers[f"get_sparsity_{side}"] = list(ports.values()).__getitem__
        for question, answer in answers.items():
            setattr(self, question, answer)
        self.construct(name, {"enable_forward": False})  # derivatives along directions are products with the Jacobian

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        """Call it as CasADi does, after a check of the arrays.

        CasADi would repeat arrays of other shapes, or refuse them in many lines.
        """
        names, name = self.name_in(), self.name()
        if len(arguments) > 0 and (len(named) > 0 or len(arguments) != len(names)):
            raise JounceError(f"{name} takes {len(names)} arrays in order, or some by name: {', '.join(names)}")
        refuse_names_and_masks(name, [*arguments, *named.values()], [])
        for port, x in (named or dict(zip(names, arguments, strict=True))).items():
            if port not in names:
                raise errors.unknown_name_error("input", port, names, name)
            self._check_array(port, x)
        return super().__call__(*arguments, **named)

    def eval_buffer(self, arguments: Sequence[Any], results: Sequence[Any]) -> int:
        """Compute the outputs, in the memory of CasADi.

        What CasADi knows to be zero has none.
        """
        columns = [np.zeros(self.nnz_in(k)) if x is None else np.frombuffer(x) for k, x in enumerate(arguments)]
        outputs = self._law.compute([x.reshape(self._points, -1) for x in columns])
        for place, y in zip(results, outputs, strict=True):
            if place is not None and y is not None:
                np.frombuffer(place).reshape(y.shape)[...] = y
        return 0

    def get_jac_sparsity(self, output: int, by: int, symmetric: bool) -> casadi.Sparsity:
        """Return a diagonal of full blocks, one per point."""
        rows, columns = self.numel_out(output), self.numel_in(by)
        if (output, by) not in self._law.dependences:
            return casadi.Sparsity(rows, columns)
        block = casadi.DM.ones(rows // self._points, columns // self._points)
        return casadi.kron(casadi.DM.eye(self._points), block).sparsity()

    def get_jacobian(
        self, name: str, inputs: Sequence[str], outputs: Sequence[str], options: object
    ) -> casadi.Function:
        """Return the function of all partial derivatives."""
        blocks, pairs = self._law.blocks, [(o, i) for o in range(self.n_out()) for i in range(self.n_in())]
        assert blocks is not None  # as `has_jacobian` says
        law = PointLaw(lambda columns: map(blocks(columns).get, pairs))
        return self._derive(name, law, inputs, [], outputs, [self.get_jac_sparsity(o, i, False) for o, i in pairs])

    def get_reverse(
        self, count: int, name: str, inputs: Sequence[str], outputs: Sequence[str], options: object
    ) -> casadi.Function:
        """Return the function of the gradients of `count` weighted sums."""
        if count > 1:
            return self.reverse(1).map(name, "serial", count, list(range(self.n_in() + self.n_out())), [])
        assert self._law.gradient is not None  # as `has_reverse` says
        weights, gradients = map(self.sparsity_out, range(self.n_out())), map(self.sparsity_in, range(self.n_in()))
        return self._derive(name, self._law.gradient, inputs, weights, outputs, gradients)

    def _derive(
        self,
        name: str,
        law: PointLaw,
        inputs: Sequence[str],
        more: Sparsities,
        outputs: Sequence[str],
        results: Sparsities,
    ) -> "PointFunction":
        """Return a function of inputs, unused outputs, and more."""
        own_inputs = map(self.sparsity_in, range(self.n_in()))
        unused = (casadi.Sparsity(*self.size_out(o)) for o in range(self.n_out()))
        all_inputs = dict(zip(inputs, [*own_inputs, *unused, *more], strict=True))
        derivative = PointFunction(name, self._points, law, all_inputs, dict(zip(outputs, results, strict=True)))
        # CasADi does not keep a callback alive.
        self._derivatives.append(derivative)
        return derivative

    def _check_array(self, port: str, x: Any) -> None:
        """Raise `JounceError` unless an array fits an input.

        It is a matrix, or a column for all points.
        """
        try:
            shape = x.shape if isinstance(x, casadi.SX | casadi.MX) else casadi.DM(x).shape
        except NotImplementedError:
            raise JounceError(
                f"{self.name()}: {port} is {quote_value(x)}; expected real numbers, or a matrix of CasADi"
            ) from None
        rows, columns = self.size_in(port)
        shared = (rows, columns // self._points)
        # CasADi broadcasts scalars and columns, and maps over matrices of several times as many points.
        if shape not in ((1, 1), shared) and (shape[0] != rows or shape[1] == 0 or shape[1] % columns != 0):
            raise JounceError(
                f"{self.name()}: {port} has shape {shape}; expected {(rows, columns)} for points={self._points}, or"
                f" {shared} where all points share it"
            )
