"""What a robot's quantities take at times of a motion: rates, wrenches, the base, and positions that close loops."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, Self

import numpy as np

from jounce.arguments.convert import Given, QuantityRequest, convert_arguments
from jounce.core.errors import check_choice
from jounce.dynamics.quantities import QUANTITIES, Quantity
from jounce.engine import closed_path, contact_limits, generic_methods
from jounce.engine.backends import Call, run_by_backend
from jounce.engine.engine import Engine
from jounce.engine.plan import compute
from jounce.model.mechanism import Mechanism
from jounce.motion.curves import ArrangedCurve
from jounce.motion.motion import Motion

_STATES_PER_PIECE = 1000  # computed together: bounds working memory, and each piece reports progress

Side = Literal["right", "left"]
Rates = tuple[np.ndarray, ...]
Wrenches = tuple[Mapping[str, np.ndarray], ...]


@dataclass(frozen=True, eq=False)
class MotionStates:
    """States at N times: q, qd, ... (N, n), W, Wd, ... by body, C, V, ... of a base, and coordinates of the tree.

    `near` are all coordinates (N, tree) of a closed robot, on the branch of the motion; None for trees. `presence` has
    that of the robot's contacts, (N, contacts) with rates; it is empty for motions without stances.
    """

    rates: Rates
    wrench: Wrenches | None
    base: Rates | None
    near: np.ndarray | None
    presence: Rates = ()

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
        known = [(order + row.takes.rates - 1, order + row.takes.wrench_rates - 1) for row, order in rows]
        highest, of_wrench = (max((pair[k] for pair in known), default=0) for k in (0, 1))
        W, base = (motion.wrench(t, of_wrench, side), motion.base(t, highest, side)) if known else (None, None)
        presence = sample_presence(robot.mechanism, motion, t, highest, side)
        return cls(
            motion(t, max(rates, highest), side),
            W,
            base,
            closed_path.continue_positions(robot, motion, t, side),
            presence,
        )

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
        count, of_wrench = order + row.takes.rates, order + row.takes.wrench_rates
        W, base = self.wrench and self.wrench[:of_wrench], self.base and self.base[:count]
        return replace(self, rates=self.rates[:count], wrench=W, base=base)

    def scaled(self, c: float) -> Self:
        """The states at c times the speed: wrenches over time and the base go with the path."""
        W = self.wrench and tuple({body: w * c**k for body, w in of.items()} for k, of in enumerate(self.wrench))
        rates, base, presence = (
            tuple(term * c**k for k, term in enumerate(terms)) for terms in (self.rates, self.base or (), self.presence)
        )
        return replace(self, rates=rates, wrench=W, base=base or None, presence=presence)

    def compute(self, robot: Engine, name: str, method: str | None = None) -> tuple[Any, ...]:
        """A quantity with its rates."""
        row = QUANTITIES[name]
        if self.presence and (self.presence[0] < 1).any() and row.on_contacts:
            return generic_methods.as_tuple(contact_limits.compute_on_contacts(self.call(robot, name), run_by_backend))
        rates = closed_path.with_tree_positions(self.rates, self.near)
        return generic_methods.as_tuple(compute(robot, name, rates, wrench=self.wrench, base=self.base, method=method))

    def call(self, robot: Engine, name: str) -> Call:
        """The call for a quantity of a robot on contacts."""
        given = Given(self.rates, self.wrench, self.base)
        asked, arrays = convert_arguments(robot.mechanism, QuantityRequest(name), given)
        return Call(robot, asked, arrays, presence=self.presence)


def sample_presence(m: Mechanism, motion: Motion, t: np.ndarray, order: int, side: Side = "right") -> Rates:
    """The presence (N, contacts) of the robot's contacts at times of a motion, with rates; empty without stances."""
    if motion.presence is None or not m.contacts:
        return ()
    frames, named = [contact.frame for contact in m.contacts], motion.stance_frames
    for frame in named:
        check_choice("contact of a stance", frame, frames)
    places = np.array([named.index(frame) if frame in named else -1 for frame in frames])
    return tuple(ArrangedCurve(motion.presence, places).rates(t, order, side == "left"))


def are_present(m: Mechanism, motion: Motion, t: np.ndarray) -> np.ndarray:
    """Which of the robot's contacts are there at times of a motion, (N, contacts): all, without stances."""
    presence = sample_presence(m, motion, t, 0)
    return presence[0] > 0 if presence else np.ones((len(t), len(m.contacts)), dtype=bool)
