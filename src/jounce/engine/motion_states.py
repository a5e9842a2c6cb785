"""Sample what a robot's quantities take at times of a motion.

They take rates, wrenches, the base, and positions that close loops.
"""

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
    """The states of a motion at N times.

    They are q, qd, ... (N, n), W, Wd, ... by body, C, V, ... of a base, and coordinates of the tree. `near` are all
    coordinates (N, tree) of a closed robot, on the branch of the motion; None for trees. `presence` has that of the
    robot's contacts, (N, contacts) with rates; it is empty for motions without stances.
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
        """Return what quantities take at times (N,) of a motion.

        Each quantity has an order, up to which it takes it. At least `rates` rates of q are there.
        """
        # The highest rates of q and of W that any of the quantities takes.
        orders = [(order + row.takes.rates - 1, order + row.takes.wrench_rates - 1) for row, order in rows]
        highest, highest_of_wrench = (max((pair[k] for pair in orders), default=0) for k in (0, 1))
        W, base = None, None
        if len(orders) > 0:
            W, base = motion.wrench(t, highest_of_wrench, side), motion.base(t, highest, side)
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
        """Yield the states at times (N,) in pieces.

        Each comes with its part of the times.
        """
        for start in range(0, len(t), _STATES_PER_PIECE):
            part = slice(start, start + _STATES_PER_PIECE)
            yield part, cls.sample(robot, motion, t[part], rows, side)

    def upto(self, row: Quantity, order: int) -> Self:
        """Return what one of the quantities takes up to an order."""
        count, wrench_count = order + row.takes.rates, order + row.takes.wrench_rates
        W = None if self.wrench is None else self.wrench[:wrench_count]
        base = None if self.base is None else self.base[:count]
        return replace(self, rates=self.rates[:count], wrench=W, base=base)

    def scaled(self, c: float) -> Self:
        """Return the states at c times the speed.

        Wrenches over time and the base go with the path: k-th rates are c^k times as large.
        """

        def scale(terms: Rates) -> Rates:
            return tuple(term * c**k for k, term in enumerate(terms))

        W, base = self.wrench, self.base
        if W is not None:
            W = tuple({body: w * c**k for body, w in by_body.items()} for k, by_body in enumerate(W))
        if base is not None:
            base = scale(base)
        return replace(self, rates=scale(self.rates), wrench=W, base=base, presence=scale(self.presence))

    def compute(self, robot: Engine, name: str, method: str | None = None) -> tuple[Any, ...]:
        """Compute a quantity with its rates."""
        row = QUANTITIES[name]
        # Only where a contact is not fully there, presence matters; then no plan of the robot serves the call.
        if len(self.presence) > 0 and (self.presence[0] < 1).any() and row.on_contacts:
            return generic_methods.as_tuple(contact_limits.compute_on_contacts(self.call(robot, name), run_by_backend))
        rates = closed_path.with_tree_positions(self.rates, self.near)
        return generic_methods.as_tuple(compute(robot, name, rates, wrench=self.wrench, base=self.base, method=method))

    def call(self, robot: Engine, name: str) -> Call:
        """Return the call for a quantity of a robot on contacts."""
        given_states = Given(self.rates, self.wrench, self.base)
        computation, arrays = convert_arguments(robot.mechanism, QuantityRequest(name), given_states)
        return Call(robot, computation, arrays, presence=self.presence)


def sample_presence(m: Mechanism, motion: Motion, t: np.ndarray, order: int, side: Side = "right") -> Rates:
    """Return the presence (N, contacts) of contacts, with rates.

    It is empty for motions without stances.
    """
    if motion.presence is None or len(m.contacts) == 0:
        return ()
    frames, stance_frames = [contact.frame for contact in m.contacts], motion.stance_frames
    for frame in stance_frames:
        check_choice("contact of a stance", frame, frames)
    # Contacts that no stance names have the column -1, which is 0 at all times.
    places = np.array([stance_frames.index(frame) if frame in stance_frames else -1 for frame in frames])
    return tuple(ArrangedCurve(motion.presence, places).rates(t, order, side == "left"))


def are_present(m: Mechanism, motion: Motion, t: np.ndarray) -> np.ndarray:
    """Return which contacts are there at times of a motion.

    They are (N, contacts); without stances, all are there.
    """
    presence = sample_presence(m, motion, t, 0)
    return presence[0] > 0 if len(presence) > 0 else np.ones((len(t), len(m.contacts)), dtype=bool)
