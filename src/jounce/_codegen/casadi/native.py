"""Make native code a CasADi function of many points at each call, with exact first and second derivatives.

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
    """A computation by native code, of a number of points at each call; code is compiled when CasADi asks for it."""
    robot, signature = Engine(mechanism), computation.signature(mechanism)
    inputs, outputs = signature.inputs, signature.outputs
    if other := [x.name for x in inputs if x.displacement != x.shape or not x.is_free]:
        raise JounceError(
            f"native=True takes vectors and wrenches, but {computation.name} of {mechanism.name!r} takes"
            f" {join_names(other)}; native=False serves it"
        )
    backends.compile_ahead(robot, computation)  # now, since errors within CasADi are those of CasADi
    first_weight = len(inputs) + len(outputs)
    pairs = [(o, i) for o in range(len(outputs)) for i in range(len(inputs))]
    dependences = {(o, i) for o, i in pairs if inputs[i].first_order <= outputs[o].rate}
    entries = [to_columns(x, np.arange(x.start, x.end).reshape(x.shape)) for x in inputs]

    def run(product: Product | None, columns: Columns, weights: Columns = ()) -> Sequence[Array]:
        kernel = backends.compile_ahead(robot, replace(computation, product=product))
        return generic_methods.as_tuple(
            kernel(*map(from_columns, inputs, columns), *map(from_columns, outputs, weights))
        )

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


@dataclass(frozen=True, eq=False)
class PointLaw:
    """What a function computes: its outputs, None where they are empty, and the blocks of its Jacobian.

    `dependences` are the pairs of an output and an input that have a block. `gradient` computes the gradient of a
    weighted sum of the outputs, from the inputs, the outputs, which it does not use, and the weights.
    """

    compute: Callable[[Columns], Iterable[Array | None]]
    dependences: Set[tuple[int, int]] = frozenset()
    blocks: Callable[[Columns], Blocks] | None = None
    gradient: "PointLaw | None" = None


class PointFunction(casadi.Callback):
    """A function of CasADi whose columns a law computes; its derivatives live as long as itself."""

    def __init__(
        self, name: str, points: int, law: PointLaw, inputs: Mapping[str, Any], outputs: Mapping[str, Any]
    ) -> None:
        super().__init__()
        self._points, self._law, self._derivatives = points, law, list[PointFunction]()
        answers: dict[str, Callable[..., Any]] = {  # to what CasADi asks of a function
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
        """Call it as CasADi does, but for arrays that CasADi would repeat, or refuse in many lines."""
        names, name = self.name_in(), self.name()
        if arguments and (named or len(arguments) != len(names)):
            raise JounceError(f"{name} takes {len(names)} arrays in order, or some by name: {', '.join(names)}")
        refuse_names_and_masks(name, [*arguments, *named.values()], [])
        for port, x in (named or dict(zip(names, arguments, strict=True))).items():
            if port not in names:
                raise errors.unknown_name_error("input", port, names, name)
            self._check_array(port, x)
        return super().__call__(*arguments, **named)

    def eval_buffer(self, arguments: Sequence[Any], results: Sequence[Any]) -> int:
        """Compute the outputs, in the memory of CasADi; what it knows to be zero has none."""
        given = [np.zeros(self.nnz_in(k)) if x is None else np.frombuffer(x) for k, x in enumerate(arguments)]
        found = self._law.compute([x.reshape(self._points, -1) for x in given])
        for place, y in zip(results, found, strict=True):
            if place is not None and y is not None:
                np.frombuffer(place).reshape(y.shape)[...] = y
        return 0

    def get_jac_sparsity(self, output: int, by: int, symmetric: bool) -> casadi.Sparsity:
        """A diagonal of full blocks, one per point."""
        rows, columns = self.numel_out(output), self.numel_in(by)
        if (output, by) not in self._law.dependences:
            return casadi.Sparsity(rows, columns)
        block = casadi.DM.ones(rows // self._points, columns // self._points)
        return casadi.kron(casadi.DM.eye(self._points), block).sparsity()

    def get_jacobian(
        self, name: str, inputs: Sequence[str], outputs: Sequence[str], options: object
    ) -> casadi.Function:
        """The function of all partial derivatives."""
        blocks, pairs = self._law.blocks, [(o, i) for o in range(self.n_out()) for i in range(self.n_in())]
        assert blocks is not None  # as `has_jacobian` says
        law = PointLaw(lambda columns: map(blocks(columns).get, pairs))
        return self._derive(name, law, inputs, [], outputs, [self.get_jac_sparsity(o, i, False) for o, i in pairs])

    def get_reverse(
        self, count: int, name: str, inputs: Sequence[str], outputs: Sequence[str], options: object
    ) -> casadi.Function:
        """The function of the gradients of `count` weighted sums."""
        if count > 1:
            return self.reverse(1).map(name, "serial", count, list(range(self.n_in() + self.n_out())), [])
        assert self._law.gradient is not None  # as `has_reverse` says
        weights, found = map(self.sparsity_out, range(self.n_out())), map(self.sparsity_in, range(self.n_in()))
        return self._derive(name, self._law.gradient, inputs, weights, outputs, found)

    def _derive(
        self,
        name: str,
        law: PointLaw,
        inputs: Sequence[str],
        more: Sparsities,
        outputs: Sequence[str],
        found: Sparsities,
    ) -> "PointFunction":
        """A function of the inputs, the outputs, which it does not use, and more."""
        own = map(self.sparsity_in, range(self.n_in()))
        unused = (casadi.Sparsity(*self.size_out(o)) for o in range(self.n_out()))
        taken = dict(zip(inputs, [*own, *unused, *more], strict=True))
        made = PointFunction(name, self._points, law, taken, dict(zip(outputs, found, strict=True)))
        self._derivatives.append(made)
        return made

    def _check_array(self, port: str, x: Any) -> None:
        """Raise `JounceError` for what is no matrix of an input's shape, nor a column that all points share."""
        try:
            found = x.shape if isinstance(x, casadi.SX | casadi.MX) else casadi.DM(x).shape
        except NotImplementedError:
            raise JounceError(
                f"{self.name()}: {port} is {quote_value(x)}; expected real numbers, or a matrix of CasADi"
            ) from None
        rows, columns = self.size_in(port)
        shared = (rows, columns // self._points)
        if found not in ((1, 1), shared) and (found[0] != rows or not found[1] or found[1] % columns):
            raise JounceError(
                f"{self.name()}: {port} has shape {found}; expected {(rows, columns)} for points={self._points}, or"
                f" {shared} where all points share it"
            )
