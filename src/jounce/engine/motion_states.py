"""What a robot's quantities take at times of a motion: rates, wrenches, the base, and positions that close loops."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, Self

import numpy as np

from jounce.dynamics.quantities import Quantity
from jounce.engine.closed_path import continue_positions, with_tree_positions
from jounce.engine.dispatch import compute
from jounce.engine.engine import Engine
from jounce.engine.generic_methods import as_tuple
from jounce.motion.motion import Motion

_STATES_PER_PIECE = 1000  # computed together: bounds working memory, and each piece reports progress

Side = Literal["right", "left"]
Rates = tuple[np.ndarray, ...]
Wrenches = tuple[Mapping[str, np.ndarray], ...]


@dataclass(frozen=True, eq=False)
class MotionStates:
    """States at N times: q, qd, ... (N, n), W, Wd, ... by body, C, V, ... of a base, and coordinates of the tree.

    `near` are all coordinates (N, tree) of a closed robot, on the branch of the motion; None for trees.
    """

    rates: Rates
    wrench: Wrenches | None
    base: Rates | None
    near: np.ndarray | None

    @classmethod
    def sample(
        cls,
        robot: Engine,
        motion: Motion,
        t: np.ndarray,
        rows: Iterable[tuple[Quantity, int]],
        side: Side = "right",
        rates: int = 0,
    ) -> Self:
        """What quantities take up to an order each, at times (N,) of a motion, and at least some `rates` of q."""
        known = [(order + row.rates - 1, order + row.wrench_rates - 1) for row, order in rows]
        highest, of_wrench = (max((pair[k] for pair in known), default=0) for k in (0, 1))
        W, base = (motion.wrench(t, of_wrench, side), motion.base(t, highest, side)) if known else (None, None)
        return cls(motion(t, max(rates, highest), side), W, base, continue_positions(robot, motion, t, side))

    @classmethod
    def pieces(
        cls, robot: Engine, motion: Motion, t: np.ndarray, rows: Sequence[tuple[Quantity, int]], side: Side = "right"
    ) -> Iterator[tuple[slice, Self]]:
        """The states at times (N,) in pieces, each with its part of the times."""
        for start in range(0, len(t), _STATES_PER_PIECE):
            part = slice(start, start + _STATES_PER_PIECE)
            yield part, cls.sample(robot, motion, t[part], rows, side)

    def upto(self, row: Quantity, order: int) -> Self:
        """What one of the quantities takes up to an order."""
        count, of_wrench = order + row.rates, order + row.wrench_rates
        W, base = self.wrench and self.wrench[:of_wrench], self.base and self.base[:count]
        return replace(self, rates=self.rates[:count], wrench=W, base=base)

    def scaled(self, c: float) -> Self:
        """The states at c times the speed: wrenches over time and the base go with the path."""
        W = self.wrench and tuple({body: w * c**k for body, w in of.items()} for k, of in enumerate(self.wrench))
        rates, base = (tuple(term * c**k for k, term in enumerate(terms)) for terms in (self.rates, self.base or ()))
        return replace(self, rates=rates, wrench=W, base=base or None)

    def compute(self, robot: Engine, name: str, method: str | None = None) -> tuple[Any, ...]:
        """A quantity with its rates."""
        rates = with_tree_positions(self.rates, self.near)
        return as_tuple(compute(robot, name, rates, wrench=self.wrench, base=self.base, method=method))
