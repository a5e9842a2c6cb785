"""The one way from a robot and a caller's state to a result."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, TypedDict

import numpy as np

from jounce._scalars import Array
from jounce.arguments import rates, wrenches
from jounce.dynamics.quantities import Path, path
from jounce.errors import JounceError, quoted
from jounce.model.mechanism import suited
from jounce.robot.data import Data
from jounce.robot.dispatch import serving
from jounce.robot.evaluation import by_kernel, delivered, evaluate

Loads = Callable[[int, Sequence[Array]], list[Array]]  # wrenches and their rates up to an order, at given states


class Options(TypedDict, total=False):
    """Keywords that the quantities share: the path that computes them, arrays to write into, threads for a batch."""

    method: str | None
    out: Any
    threads: int


class Quantities(Data):
    """How the methods of a robot are computed: checked, served by native code or by a path, delivered."""

    def _given(self, wrench: Any) -> Loads:
        return partial(wrenches.checked, self.mechanism, wrench)

    def _quantity(
        self,
        name: str,
        least: int,
        q: Sequence[Any],
        loads: Loads = lambda order, q: [],
        *,
        method: str | None = None,
        out: Any = None,
        threads: int = 1,
    ) -> Any:
        """A quantity of `paths`, or of native code, along q; see `_along`."""
        given = rates.checked(q, least, self.mechanism)
        order = len(given) - least
        W = loads(order, given)
        kernel = serving(self.mechanism, name, method, order, given, W)
        if kernel is not None:
            return by_kernel(kernel, given, W, out, threads)
        if not isinstance(threads, int | np.integer) or isinstance(threads, bool) or threads != 1:
            raise JounceError(f"threads = {quoted(threads)} is for native code only, which does not serve this call")
        return self._by(path(name, method), order, given, W, out)

    def _along(
        self,
        path: Path,
        least: int,
        q: Sequence[Any],
        out: Any,
        loads: Loads = lambda order, q: [],
    ) -> Any:
        """The quantity of a path along q: it takes `least` of the rates, each further one gives one more derivative."""
        given = rates.checked(q, least, self.mechanism)
        order = len(given) - least
        return self._by(path, order, given, loads(order, given), out)

    def _by(self, path: Path, order: int, q: Sequence[Array], W: Sequence[Array], out: Any) -> Any:
        """The quantity of a path and its rates up to an order, of checked arrays."""
        model = suited(self.mechanism, [*q, *W])
        terms = evaluate(lambda q, W: path.law(model, q, W), q, W, order, path.width(model.nb))
        return delivered(terms, out)
