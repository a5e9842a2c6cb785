"""Requests for a quantity, of a body and in a frame, checked and converted to a `Computation`."""

from functools import lru_cache

from jounce._scalars import is_numeric
from jounce.arguments.rates import checked_order
from jounce.dynamics.computation import Computation
from jounce.dynamics.mobility import idle_coordinates
from jounce.dynamics.quantities import QUANTITIES
from jounce.errors import JounceError, listed, no_such, one_of, true_or_false
from jounce.model.mechanism import DATA, Mechanism


def computation(
    mechanism: Mechanism, quantity: str, order: int, wrench: bool = False, body: str | None = None, frame: str = "body"
) -> Computation:
    """Return the computation of a quantity by name.

    Raises
    ------
    JounceError : if a name is unknown, or the quantity takes no wrenches, belongs to no body or has no frame.
    """
    row = QUANTITIES[one_of("quantity", quantity, QUANTITIES)]
    if true_or_false("wrench", wrench, "whether wrenches are taken") and not row.wrenches:
        takers = listed(name for name, other in QUANTITIES.items() if other.wrenches)
        raise JounceError(f"{quantity} takes no wrenches; these do: {takers}")
    place(mechanism, quantity, body, frame)
    check_invertible(mechanism, quantity)
    check_elastic(mechanism, quantity)
    return Computation(quantity, checked_order(order), wrench, body, frame)


def parse_computation(mechanism: Mechanism, text: str, order: int, wrench: bool = False) -> Computation:
    """Parse a computation written as NAME[:BODY[:FRAME]]: ``mass_matrix``, ``jacobian:tool0:world``.

    Names of bodies may contain colons: the last part is a frame only if the quantity has this frame and the rest is a
    body. Without a body, the quantity of all bodies is meant.

    Raises
    ------
    JounceError : if a name is unknown, or as `computation`.
    """
    name, asked, rest = text.partition(":") if isinstance(text, str) else (text, "", "")
    row = QUANTITIES[one_of("quantity", name, QUANTITIES)]
    if not asked:
        return computation(mechanism, name, order, wrench)
    bodies = mechanism.frame_names
    body, colon, frame = rest.rpartition(":")
    if colon and frame in row.frames and (body in bodies or rest not in bodies):
        return computation(mechanism, name, order, wrench, body or None, frame)
    if colon and row.of_bodies and body in bodies and rest not in bodies:
        raise no_such("frame", frame, row.frames, name)
    return computation(mechanism, name, order, wrench, rest)


def check_invertible(mechanism: Mechanism, quantity: str) -> None:
    """Raise `JounceError` if a quantity takes the inverse of a mass matrix that is singular everywhere."""
    if not QUANTITIES[quantity].forces or not all(is_numeric(getattr(mechanism, data)) for data in DATA):
        return
    rank, idle = idle_coordinates(mechanism)
    if idle:
        raise JounceError(
            f"{quantity} of {mechanism.name!r}: the mass matrix is singular, of rank {rank} for {mechanism.n}"
            f" coordinates, as {listed(idle)} moves no inertia; state one beyond, or lock the joint by lock="
        )


def check_elastic(mechanism: Mechanism, quantity: str) -> None:
    """Raise `JounceError` if a quantity is one of elastic joints and the robot has none."""
    if QUANTITIES[quantity].elastic and mechanism.elasticity is None:
        raise JounceError(
            f"{quantity} of {mechanism.name!r}: its joints are rigid; robot.elastic(stiffness) makes them elastic"
        )


def place(mechanism: Mechanism, quantity: str, body: str | None, frame: str) -> None:
    """Raise `JounceError` unless the quantity exists for this body (None: all bodies) in this frame."""
    row = QUANTITIES[quantity]
    if body is not None:
        if not row.of_bodies:
            takers = listed(name for name, other in QUANTITIES.items() if other.of_bodies)
            raise JounceError(f"{quantity} takes no body; these do: {takers}")
        mechanism.frame(body)
    one_of("frame", frame, row.frames or ("body",))


@lru_cache(maxsize=1024)
def known(name: str, order: int, wrench: bool, body: str | None = None, frame: str = "body") -> Computation:
    """Return the computation of checked arguments; equal arguments share one."""
    return Computation(name, order, wrench, body, frame)
