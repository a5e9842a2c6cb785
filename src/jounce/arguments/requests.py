"""Requests for a quantity, of a body and in a frame, checked and converted to a `Computation`."""

from functools import lru_cache

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


def build_computation(
    mechanism: Mechanism,
    quantity: str,
    order: int,
    wrench: bool = False,
    body: str | None = None,
    frame: str = "body",
    product: str | None = None,
    moving_base: bool = False,
) -> Computation:
    """Return the computation of a quantity by name, or of a product of its derivatives.

    The motion of the base belongs to the inputs if `moving_base` is true, and wherever it enters if the robot floats.
    """
    row = QUANTITIES[check_choice("quantity", quantity, QUANTITIES)]
    if check_bool("wrench", wrench, "whether wrenches are taken") and not row.takes.wrenches:
        takers = join_names(name for name, other in QUANTITIES.items() if other.takes.wrenches)
        raise JounceError(f"{quantity} takes no wrenches; these do: {takers}")
    check_place(mechanism, quantity, body, frame)
    check_bool("moving_base", moving_base, "whether the motion of the base is taken")
    moves = base_moves(mechanism, moving_base)
    check_existence(mechanism, quantity, moves)
    check_invertible(mechanism, quantity)
    if row.takes_stiffness and mechanism.elasticity and mechanism.elasticity.pairs:
        raise JounceError(
            f"{quantity} of {mechanism.name!r}: joints with two motors take a stiffness, as native and generated code"
            f" do not{Remedy(f'; robot.{quantity}(..., stiffness=...) does')}"
        )
    limited = [contact.frame for contact in mechanism.contacts if len(contact.limits)]
    if row.on_contacts and limited:
        raise JounceError(
            f"{quantity} of {mechanism.name!r}: friction and soles are decided on numbers, not in native and generated"
            f" code; leave friction and sole of contact {join_names(limited)} out"
        )
    order = check_order(order)
    check_rates(quantity, order)
    if product is not None:
        check_choice("product", product, DERIVATIVE_PRODUCTS)
    moving = moves and takes_base(quantity, frame)
    return Computation(quantity, order, wrench, body, frame, product, count_more_rates(mechanism, quantity), moving)


def parse_computation(mechanism: Mechanism, text: str, order: int, wrench: bool = False) -> Computation:
    """Parse a computation written as NAME[.PRODUCT][:BODY[:FRAME]]: ``mass_matrix.vjp``, ``jacobian:tool0:world``.

    Names of bodies may contain colons: the last part is a frame only if the quantity has this frame and the rest is a
    body. Without a body, the quantity of all bodies is meant. The order is that of all outputs of a call: a quantity
    without rates has order 0.
    """
    full, asked, rest = text.partition(":") if isinstance(text, str) else (text, "", "")
    name, dot, end = full.partition(".") if isinstance(text, str) else (text, "", "")
    product = end if dot else None
    row = QUANTITIES[check_choice("quantity", name, QUANTITIES)]
    if not asked:
        return build_computation(mechanism, name, row.highest(order), wrench, product=product)
    bodies = mechanism.frame_names
    body, colon, frame = rest.rpartition(":")
    if colon and frame in row.gives.frames and (body in bodies or rest not in bodies):
        return build_computation(mechanism, name, order, wrench, body or None, frame, product)
    if colon and row.of_bodies and body in bodies and rest not in bodies:
        raise unknown_name_error("frame", frame, row.gives.frames, name)
    return build_computation(mechanism, name, order, wrench, rest, product=product)


def coriolis_name(form: str) -> str:
    """Return the name of the Coriolis matrix of a form."""
    return CORIOLIS_FORMS[check_choice("form", form, CORIOLIS_FORMS, "coriolis_matrix")]


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
    """Raise `JounceError` if a quantity takes the inverse of a mass matrix that is singular everywhere."""
    if not QUANTITIES[quantity].inverts or not mechanism.is_numeric:
        return
    rank, idle = mobility.idle_coordinates(inverted_mechanism(mechanism, quantity))
    if idle:
        size = f"{mechanism.nv} velocities" if mechanism.floats else f"{mechanism.n} coordinates"
        raise JounceError(
            f"{quantity} of {mechanism.name!r}: the mass matrix is singular, of rank {rank} for {size}:"
            f" {join_names(idle)} can move without moving inertia; give their bodies inertia, or hold them by"
            f" {Remedy('lock= of jounce.load, or Robot.locked', '--lock JOINT=VALUE')}"
        )


def inverted_mechanism(mechanism: Mechanism, quantity: str) -> Mechanism:
    """The mechanism whose mass matrix a quantity inverts: with the rotors of rigid joints where motors move it."""
    return with_rigid_rotors(mechanism) if QUANTITIES[quantity].takes.motors else mechanism


def check_existence(mechanism: Mechanism, quantity: str, moving: bool, call: str | None = None) -> None:
    """Raise `JounceError` if a robot does not have a quantity: loops are open, joints rigid, or the row says why.

    Rotors that links carry take a base at rest, as do quantities that take the state of motors. Messages name the call
    for which the quantity is computed, by default that of the quantity.
    """
    row, call, e = QUANTITIES[quantity], call or quantity, mechanism.elasticity
    if reason := row.obstacle(mechanism):
        raise JounceError(f"{call} of {mechanism.name!r}{reason}")
    if not (moving and ELASTIC in row.needs and e):
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


def base_moves(mechanism: Mechanism, given: bool) -> bool:
    """Whether the base of a robot moves: it floats, or its motion is given."""
    return given or mechanism.floats


def takes_base(quantity: str, frame: str) -> bool:
    """Whether the pose or the twist of the base enters a quantity."""
    return frame not in QUANTITIES[quantity].takes.without_base


def count_more_rates(mechanism: Mechanism, quantity: str) -> int:
    """How many rates of the motion a quantity takes in addition to those of its row."""
    row, e = QUANTITIES[quantity], mechanism.elasticity
    return e.more_rates + (row.takes.inductive and e.is_inductive) if e and row.takes_stiffness else 0


def check_place(mechanism: Mechanism, quantity: str, body: str | None, frame: str) -> None:
    """Raise `JounceError` unless the quantity exists for this body (None: all bodies) in this frame."""
    row = QUANTITIES[quantity]
    if body is not None:
        if not row.of_bodies:
            takers = join_names(name for name, other in QUANTITIES.items() if other.of_bodies)
            raise JounceError(f"{quantity} takes no body; these do: {takers}")
        mechanism.frame(body)
    check_choice("frame", frame, row.gives.frames or ("body",))


@lru_cache(maxsize=1024)
def cached_computation(
    name: str, order: int, wrench: bool, body: str | None = None, frame: str = "body", more: int = 0, base: bool = False
) -> Computation:
    """Return the computation of checked arguments; equal arguments share one."""
    return Computation(name, order, wrench, body, frame, more_rates=more, base=base)
