"""Check requests for a quantity and convert them to a `Computation`.

A request may be of a body, in a frame, or for a product of the derivatives.
"""

from functools import lru_cache
from typing import NamedTuple

from jounce.arguments.rates import check_order
from jounce.core.cures import SPONG_COUPLING, Remedy
from jounce.core.errors import JounceError, check_bool, check_choice, join_names, unknown_name_error
from jounce.dynamics import mobility
from jounce.dynamics.computation import DERIVATIVE_PRODUCTS, Computation
from jounce.dynamics.elastic import with_rigid_rotors
from jounce.dynamics.quantities import QUANTITIES
from jounce.dynamics.quantities.row import ELASTIC
from jounce.model.mechanism import Mechanism

CORIOLIS_FORMS = {"paper": "coriolis_matrix", "skew": "skew_coriolis_matrix"}  # the quantity of each form


class ComputationRequest(NamedTuple):
    """The request for a quantity with its rates up to an order.

    `body` None means all bodies. With `moving_base` the motion of the base belongs to the inputs.
    """

    quantity: str
    order: int
    wrench: bool = False
    body: str | None = None
    frame: str = "body"
    product: str | None = None  # of the derivatives by all inputs, in place of the quantity
    moving_base: bool = False


def build_computation(mechanism: Mechanism, request: ComputationRequest) -> Computation:
    """Return the computation of a request, checked for a robot.

    The motion of the base belongs to the inputs if `moving_base` is true, and wherever it enters if the robot floats.
    """
    quantity, _, wrench, body, frame, product, moving_base = request
    # The quantity, its wrenches, body and frame exist.
    row = QUANTITIES[check_choice("quantity", quantity, QUANTITIES)]
    if check_bool("wrench", wrench, "whether wrenches are taken") and not row.takes.wrenches:
        takers = join_names(name for name, other in QUANTITIES.items() if other.takes.wrenches)
        raise JounceError(f"{quantity} takes no wrenches; these do: {takers}")
    check_place(mechanism, quantity, body, frame)
    # The robot has the quantity, also while its base moves.
    check_bool("moving_base", moving_base, "whether the motion of the base is taken")
    moves = base_moves(mechanism, moving_base)
    check_existence(mechanism, quantity, moves)
    check_invertible(mechanism, quantity)
    # Two things are computed on numbers only, since what they do depends on the values of a call.
    if row.takes_stiffness and mechanism.elasticity and mechanism.elasticity.pairs:
        raise JounceError(
            f"{quantity} of {mechanism.name!r}: joints with two motors take a stiffness, as native and generated code"
            f" do not{Remedy(f'; robot.{quantity}(..., stiffness=...) does')}"
        )
    limited = [contact.frame for contact in mechanism.contacts if len(contact.limits) > 0]
    if row.on_contacts and len(limited) > 0:
        raise JounceError(
            f"{quantity} of {mechanism.name!r}: friction and soles are decided on numbers, not in native and generated"
            f" code; leave friction and sole of contact {join_names(limited)} out"
        )
    order = check_order(request.order)
    check_rates(quantity, order)
    if product is not None:
        check_choice("product", product, DERIVATIVE_PRODUCTS)
    # A base that moves does not enter all quantities: Jacobians in the frame of the body are the same without it.
    enters = moves and takes_base(quantity, frame)
    return Computation(quantity, order, wrench, body, frame, product, count_more_rates(mechanism, quantity), enters)


def parse_computation(mechanism: Mechanism, text: str, order: int, wrench: bool = False) -> Computation:
    """Parse a computation written as NAME[.PRODUCT][:BODY[:FRAME]].

    Examples are ``mass_matrix.vjp`` and ``jacobian:tool0:world``. Names of bodies may contain colons: the last part is
    a frame only if the quantity has this frame and the rest is a body. Without a body, the quantity of all bodies is
    meant. The order is that of all outputs of a call: a quantity without rates has order 0.
    """
    # What is no string is refused as an unknown quantity.
    full, separator, place = text.partition(":") if isinstance(text, str) else (text, "", "")
    name, dot, end = full.partition(".") if isinstance(text, str) else (text, "", "")
    product = end if dot == "." else None
    row = QUANTITIES[check_choice("quantity", name, QUANTITIES)]
    if separator == "":
        request = ComputationRequest(name, row.highest(order), wrench, product=product)
        return build_computation(mechanism, request)
    bodies = mechanism.frame_names
    body, colon, frame = place.rpartition(":")
    has_colon, is_body = colon == ":", place in bodies
    # BODY:FRAME, unless BODY:FRAME as a whole is the name of a body and BODY is not.
    if has_colon and frame in row.gives.frames and (body in bodies or not is_body):
        request = ComputationRequest(name, order, wrench, body if body != "" else None, frame, product)
        return build_computation(mechanism, request)
    # A body is known, and what follows it is no frame: the error names the frames.
    if has_colon and row.of_bodies and body in bodies and not is_body:
        raise unknown_name_error("frame", frame, row.gives.frames, name)
    return build_computation(mechanism, ComputationRequest(name, order, wrench, place, product=product))


def coriolis_name(form: str) -> str:
    """Return the name of the Coriolis matrix of a form."""
    # As `check_choice`, in one frame.
    if not isinstance(form, str) or form not in CORIOLIS_FORMS:
        raise unknown_name_error("form", form, CORIOLIS_FORMS, "coriolis_matrix")
    return CORIOLIS_FORMS[form]


def check_rates(quantity: str, order: int) -> None:
    """Raise `JounceError` if rates are requested of a quantity that has none."""
    row = QUANTITIES[quantity]
    if order > row.highest(order):
        inputs = ", ".join(row.takes.names(row.takes.rates))
        raise JounceError(
            f"{quantity} has no rates, but order {order} is requested; expected {inputs} alone,"
            f" {Remedy('order=0', '--order 0')}"
        )


def check_invertible(mechanism: Mechanism, quantity: str) -> None:
    """Raise `JounceError` if a quantity inverts a singular mass matrix.

    Matrices that are singular everywhere are refused.
    """
    if not QUANTITIES[quantity].inverts or not mechanism.is_numeric:
        return
    rank, idle = mobility.idle_coordinates(inverted_mechanism(mechanism, quantity))
    if len(idle) > 0:
        size = f"{mechanism.nv} velocities" if mechanism.floats else f"{mechanism.n} coordinates"
        raise JounceError(
            f"{quantity} of {mechanism.name!r}: the mass matrix is singular, of rank {rank} for {size}:"
            f" {join_names(idle)} can move without moving inertia; give their bodies inertia, or hold them by"
            f" {Remedy('lock= of jounce.load, or Robot.locked', '--lock JOINT=VALUE')}"
        )


def inverted_mechanism(mechanism: Mechanism, quantity: str) -> Mechanism:
    """Return the mechanism whose mass matrix a quantity inverts.

    It has the rotors of rigid joints where motors move it.
    """
    return with_rigid_rotors(mechanism) if QUANTITIES[quantity].takes.motors else mechanism


def check_existence(mechanism: Mechanism, quantity: str, moving: bool, call: str | None = None) -> None:
    """Raise `JounceError` if a robot does not have a quantity.

    Its loops may be open, its joints rigid, or the row of the quantity has another reason. Rotors that links carry take
    a base at rest, as do quantities that take the state of motors. Messages name the call for which the quantity is
    computed, by default that of the quantity.
    """
    row, e = QUANTITIES[quantity], mechanism.elasticity
    call = quantity if call is None else call
    reason = row.obstacle(mechanism)
    if reason is not None:
        raise JounceError(f"{call} of {mechanism.name!r}{reason}")
    # A moving base matters to elastic joints alone.
    if not moving or ELASTIC not in row.needs or e is None:
        return
    if row.takes.motors:
        raise JounceError(
            f"{call}: the base of {mechanism.name!r} moves; expected one at rest"
            f"{Remedy('. motor_positions and motor_torques take base=')}"
        )
    if e.level is not None:
        raise JounceError(
            f"{call} of {mechanism.name!r}: its base moves, and coupling={e.level} of rotors and"
            f" links takes a base at rest; {SPONG_COUPLING} neglects what rotors feel of their carriers"
        )


def base_moves(mechanism: Mechanism, is_given: bool) -> bool:
    """Return whether the base of a robot moves: it floats, or its motion is given."""
    return is_given or mechanism.floats


def takes_base(quantity: str, frame: str) -> bool:
    """Return whether the motion of the base enters a quantity."""
    return frame not in QUANTITIES[quantity].takes.without_base


def count_more_rates(mechanism: Mechanism, quantity: str) -> int:
    """Return how many rates a quantity takes in addition to its row's.

    Dampers, and rotors that links carry, take more rates; a motor with an inductance takes one more.
    """
    row, e = QUANTITIES[quantity], mechanism.elasticity
    if e is None or not row.takes_stiffness:
        return 0
    return e.more_rates + (row.takes.inductive and e.is_inductive)


def check_place(mechanism: Mechanism, quantity: str, body: str | None, frame: str) -> None:
    """Raise `JounceError` unless a quantity exists for a body in a frame.

    `body` None means all bodies.
    """
    row = QUANTITIES[quantity]
    if body is not None:
        if not row.of_bodies:
            takers = join_names(name for name, other in QUANTITIES.items() if other.of_bodies)
            raise JounceError(f"{quantity} takes no body; these do: {takers}")
        mechanism.frame(body)
    check_choice("frame", frame, row.gives.frames or ("body",))


@lru_cache(maxsize=1024)
def cached_computation(request: ComputationRequest, more_rates: int = 0) -> Computation:
    """Return the computation of a checked request; equal requests share one.

    Here `moving_base` is true only where the motion of the base enters the quantity.
    """
    quantity, order, wrench, body, frame, product, base = request
    return Computation(quantity, order, wrench, body, frame, product, more_rates, base)
