"""Convert the arguments of a call to the arrays of its computation.

What depends on the robot and on the form of a call alone is decided and checked once, in `Conversion.of`. What depends
on the numbers is checked in every call, in `Conversion.arrays`.

What depends on the robot and on the form of a call alone is decided and checked once, in `Conversion.of`. What depends
on the numbers is checked in every call, in `Conversion.arrays`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Self

from jounce.arguments import loads, requests
from jounce.arguments.base import convert_base_motion
from jounce.arguments.joint_data import convert_stiffness
from jounce.arguments.rates import convert_rates, dependent_arrays, separate_base, split_rates, trim_rates
from jounce.core.errors import check_choice
from jounce.core.scalars import Array
from jounce.dynamics.computation import Computation
from jounce.dynamics.loop_assembly import NewtonStep
from jounce.dynamics.quantities import find_row
from jounce.model.mechanism import Mechanism
from jounce.spatial import groups

NATIVE = "kernel"  # the method that is native code


class QuantityRequest(NamedTuple):
    """The quantity that a caller requests, of a body, in a frame.

    `method` is the algorithm that computes it, None for the fastest.
    """

    name: str
    body: str | None = None
    frame: str = "body"
    method: str | None = None


class Given(NamedTuple):
    """The arguments of a call: q, qd, ... and, by keyword, others.

    The others are wrenches, the motion of the base, and the stiffness of joints.
    """

    rates: Sequence[Any]
    wrench: Any = None
    base: Any = None
    stiffness: Any = None


@dataclass(frozen=True)
class Conversion:
    """The conversion of a caller's arguments, for one form of call.

    `step` is the Newton step that closes loops; `pose` makes the pose of a base from the numbers that q begins with.
    """

    mechanism: Mechanism
    asked: Computation
    step: NewtonStep | None = None
    pose: Callable[[Array], Array] = groups.FREE.pose

    @classmethod
    def of(
        cls,
        mechanism: Mechanism,
        request: QuantityRequest,
        given: Given,
        step: NewtonStep | None = None,
        pose: Callable[[Array], Array] = groups.FREE.pose,
    ) -> Self:
        """Return the conversion for all calls of the form of one.

        Raises `JounceError` if the robot does not have the quantity, or not of this order, body, frame or method.
        """
        name, body, frame, method = request
        # The robot has the quantity, and the rates of the call fit it: their number is the order.
        moves = requests.base_moves(mechanism, given.base is not None)
        requests.check_existence(mechanism, name, moves)
        more = requests.count_more_rates(mechanism, name)
        row = find_row(name, more)
        order = len(trim_rates(mechanism, given.rates, row, more)) - row.takes.rates
        requests.check_rates(name, order)
        # Method, body and frame exist for this quantity.
        if method is not None:
            check_choice("method", method, [*row.laws, NATIVE], name)
        if body is not None or frame != "body":
            requests.check_place(mechanism, name, body, frame)
        if row.inverts:
            requests.check_invertible(mechanism, name)
        enters = moves and requests.takes_base(name, frame)
        with_wrenches = given.wrench is not None
        checked = requests.ComputationRequest(name, order, with_wrenches, body, frame, moving_base=enters)
        return cls(mechanism, requests.cached_computation(checked, more), step, pose)

    def arrays(self, given: Given) -> list[Array]:
        """Return the arrays of the ports in their order.

        q, qd, ... come first, then W, C, the stiffness and the dependent coordinates, each with its rates.
        """
        m, asked = self.mechanism, self.asked
        row = asked.quantity
        # A whole floating robot's q begins with its base; a closed robot's may hold all coordinates of the tree.
        rates, base = separate_base(m, given.rates, given.base, row, self.pose)
        rates, whole = split_rates(m, rates)
        q = convert_rates(m, rates, row, asked.more_rates)
        W = loads.convert_wrenches(m, given.wrench, asked.order, q, row.takes.wrench_rates)
        d = dependent_arrays(m, q[0], whole, self.step)
        if row.takes_stiffness:
            d = [*convert_stiffness(m, given.stiffness, asked.loads), *d]
        if base is None and not asked.base:
            return [*q, *W, *d]
        # A motion of the base that does not enter is checked too: wrong ones never pass.
        C = convert_base_motion(m, base, asked.base_terms(m), f"{row.name} of order {asked.order}")
        return [*q, *W, *C, *d] if asked.base else [*q, *W, *d]


def convert_arguments(mechanism: Mechanism, request: QuantityRequest, given: Given) -> tuple[Computation, list[Array]]:
    """Return the computation of one call, and the arrays of its ports."""
    conversion = Conversion.of(mechanism, request, given)
    return conversion.asked, conversion.arrays(given)
