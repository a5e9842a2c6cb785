"""CasADi functions that run native code, with exact first and second derivatives.

CasADi enters Python at each evaluation, whatever the number of points: so one function computes all points of a motion, a
column each. No point depends on another: every Jacobian is a diagonal of blocks, and CasADi learns so before it
differentiates. Of dense ones it would compute all columns, one after the other.

Solvers ask for the Jacobian of the values, for the gradient of a weighted sum of them, and for the Jacobian of that
gradient: the Hessian of the sum, and the transpose of the first Jacobian, as weights may vary too.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence, Set
from dataclasses import dataclass
from typing import Any

import numpy as np

import casadi
from jounce.core.errors import JounceError, one_line, quote_value
from jounce.core.scalars import Array
from jounce.native.arguments import refuse_names_and_masks

Columns = Sequence[Array]  # an array (points, size) per input: the entries of each point's matrix, column after column
Blocks = Mapping[tuple[int, int], Array]  # by output and input (points, columns, rows), as CasADi stores them
Sparsities = Iterable[casadi.Sparsity]
Ports = Iterable[tuple[str, casadi.Sparsity]]


@dataclass(frozen=True, eq=False)
class PointLaw:
    """What a function computes at each point: its outputs, None where they are empty, and blocks of its Jacobian.

    `dependences` are the pairs of an output and an input that have a block. `gradient` computes the gradient of a
    weighted sum of the outputs, from the inputs, the outputs, which it does not use, and the weights.
    """

    compute: Callable[[Columns], Sequence[Array | None]]
    dependences: Set[tuple[int, int]] = frozenset()
    blocks: Callable[[Columns], Blocks] | None = None
    gradient: "PointLaw | None" = None


class PointFunction(casadi.Callback):
    """A function of CasADi whose columns are points that a law computes.

    Graphs of CasADi do not keep what is written in Python: derivatives live as long as the function itself.
    """

    def __init__(self, name: str, points: int, law: PointLaw, inputs: Ports, outputs: Ports) -> None:
        super().__init__()
        self._points, self._law, self._derivatives = points, law, list[casadi.Function]()
        names, sizes = zip(*inputs, strict=True)
        self.get_n_in, self.get_name_in, self.get_sparsity_in = names.__len__, names.__getitem__, sizes.__getitem__
        names, sizes = zip(*outputs, strict=True)
        self.get_n_out, self.get_name_out, self.get_sparsity_out = names.__len__, names.__getitem__, sizes.__getitem__
        self.has_eval_buffer = lambda: True
        self.has_jacobian = lambda: law.blocks is not None
        self.has_jac_sparsity = lambda output, by: law.blocks is not None
        self.has_reverse = lambda count: law.gradient is not None
        self.construct(name, {"enable_forward": False})  # derivatives along directions are products with the Jacobian

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        """Call it as CasADi does, but for arrays that CasADi would repeat, or refuse in many lines."""
        names = self.name_in()
        refuse_names_and_masks(self.name(), [*arguments, *named.values()], [])
        for name, x in [*zip(names, arguments, strict=False), *named.items()]:
            if name in names:
                self._check_array(name, x)
        try:
            return super().__call__(*arguments, **named)
        except RuntimeError as error:
            raise JounceError(f"{self.name()} takes {', '.join(names)}: {one_line(error)}") from None

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

    def get_jacobian(self, name: str, inputs: list[str], outputs: list[str], options: object) -> casadi.Function:
        """The function of all partial derivatives, from the inputs, and the outputs, which it does not use."""
        pairs, blocks = [(o, i) for o in range(self.n_out()) for i in range(self.n_in())], self._law.blocks

        def compute(columns: Columns) -> list[Array | None]:
            assert blocks is not None  # as `has_jacobian` says
            found = blocks(columns)
            return [found.get(pair) for pair in pairs]

        found = [self.get_jac_sparsity(o, i, False) for o, i in pairs]
        return self._derive(name, PointLaw(compute), inputs, [], outputs, found)

    def get_reverse(
        self, count: int, name: str, inputs: list[str], outputs: list[str], options: object
    ) -> casadi.Function:
        """The function of the gradients of `count` weighted sums, from the inputs, the outputs and the weights."""
        if count > 1:
            return self.reverse(1).map(name, "serial", count, list(range(self.n_in() + self.n_out())), [])
        assert self._law.gradient is not None  # as `has_reverse` says
        weights = map(self.sparsity_out, range(self.n_out()))
        given = map(self.sparsity_in, range(self.n_in()))
        return self._derive(name, self._law.gradient, inputs, weights, outputs, given)

    def _derive(
        self, name: str, law: PointLaw, inputs: list[str], more: Sparsities, outputs: list[str], found: Sparsities
    ) -> "PointFunction":
        """A function of the inputs, the outputs, which it does not use, and more."""
        taken = map(self.sparsity_in, range(self.n_in()))
        unused = (casadi.Sparsity(*self.size_out(o)) for o in range(self.n_out()))
        ports = zip(inputs, [*taken, *unused, *more], strict=True)
        self._derivatives.append(PointFunction(name, self._points, law, ports, zip(outputs, found, strict=True)))
        return self._derivatives[-1]

    def _check_array(self, name: str, x: Any) -> None:
        """Raise `JounceError` for what is no matrix of the input's shape, nor repeated on purpose."""
        try:
            found = x.shape if isinstance(x, casadi.SX | casadi.MX) else casadi.DM(x).shape
        except NotImplementedError:
            raise JounceError(
                f"{self.name()}: {name} is {quote_value(x)}; expected real numbers in one or two axes, or a matrix of CasADi"
            ) from None
        rows, columns = self.size_in(name)
        single = (rows, columns // self._points)
        if found not in ((1, 1), single) and (found[0] != rows or found[1] % columns):
            raise JounceError(
                f"{self.name()}: {name} has shape {found}; expected {(rows, columns)} for points={self._points}, or"
                f" {single} where all points share it"
            )
