"""Plans of native code: the form (straight line or loop) of a computation, and the size of its scratch memory.

Scratch memory holds a block of states: its inputs, its outputs and, in the loop form, its bodies. Every scalar takes
one vector, with a lane for each state.
"""

from collections.abc import Sequence

import numpy as np

from jounce.dynamics.computation import SECOND_PRODUCTS, Computation, Signature
from jounce.dynamics.recursion.articulated import moves_joints_alone
from jounce.dynamics.recursion.forces import Sweep
from jounce.model.equivalent_mechanisms import minimal_mechanism
from jounce.model.mechanism import Mechanism
from jounce.model.positions import multiscrew_joints
from jounce.native.column_layout import column_layout
from jounce.native.vector_layout import VectorLayout, carriers
from jounce.program.program import reuse_places

MAX_STRAIGHT_SIZE = 400  # bodies times (order + 1)^2, as operations of forces grow: longer code leaves the caches
MAX_STRAIGHT_NUMBERS = 1250  # of a robot, times order + 4/3 as operations of accelerations grow: more compile for 3 s
HIGHEST_NATIVE_ORDER = 12  # at which the step of a joint takes 40 KiB of a thread's stack
MAX_STACK_BYTES = 2**15  # of a call on the stack of its thread, whatever thread it is; what needs more has a `Pool`
SCALARS_PER_PART = {"w": 3, "a": 3, "K": 9}  # of a motion: vectors, and a matrix of 3 by 3
ARTICULATED_PARTS = (("I", 1, 21), ("share", 1, 6), ("inverse_D", 1, 1), ("u", 1, 1), ("F", 1, 6), ("A", 1, 6))
MAX_SCRATCH_BYTES = 2**26  # of a call: where more is needed, the recursion in NumPy computes
HIGHEST_PRODUCT_ORDER = 9  # up to which products take no more than the 64 arrays of NumPy's functions
HIGHEST_PRODUCT_ORDER_WITH_BASE = 7  # the same where the motion of the base belongs to them
HIGHEST_SECOND_ORDER, HIGHEST_SECOND_ORDER_WITH_BASE = 7, 4  # of second derivatives, which take directions too
MAX_COMPILE_SECONDS = 3.0  # for native code that nobody asked for: longer would look like a hang


class LongCompilationError(Exception):
    """Compiling takes longer than a caller waits for it."""


def is_straight(computation: Computation, mechanism: Mechanism) -> bool:
    """Return whether the code is a straight line; a loop over the bodies is half as fast, but compiles at once."""
    quantity, bodies = computation.quantity, len(mechanism.joints)
    balanced = quantity.balanced and mechanism.contacts
    if quantity.sweep is None or computation.product or mechanism.closure or multiscrew_joints(mechanism) or balanced:
        return True
    if not quantity.takes.forces:
        return bodies * (computation.order + 1) ** 2 <= MAX_STRAIGHT_SIZE
    if mechanism.has_load_friction or not moves_joints_alone(mechanism):
        return True
    return _count_numbers(mechanism) * (computation.order + 4 / 3) <= MAX_STRAIGHT_NUMBERS


def _count_numbers(mechanism: Mechanism) -> int:
    """Count the numbers of a robot that its steps multiply by: 0 and 1 cost nothing."""
    chain = minimal_mechanism(mechanism)
    numbers = [chain.B[:, :3], chain.X, chain.M[:, *np.triu_indices(6)]]
    return sum(int(np.count_nonzero(~np.isin(x.astype(float), (-1, 0, 1)))) for x in numbers)


def highest_order(computation: Computation, mechanism: Mechanism) -> int:
    """Return the highest order with native code: motor torques have the arrays of forces two orders higher.

    The dependent coordinates of closed robots are one array more.
    """
    if computation.product in SECOND_PRODUCTS:
        of_product = HIGHEST_SECOND_ORDER_WITH_BASE if computation.base else HIGHEST_SECOND_ORDER
    else:
        with_base = HIGHEST_PRODUCT_ORDER_WITH_BASE - bool(mechanism.closure)
        of_product = with_base if computation.base else HIGHEST_PRODUCT_ORDER
    highest = of_product if computation.product else HIGHEST_NATIVE_ORDER
    return highest + 1 - computation.quantity.takes.wrench_rates


def obstacle(computation: Computation, mechanism: Mechanism) -> str | None:
    """Return why a computation has no native code, as the end of a sentence about native code; None if it has."""
    highest = highest_order(computation, mechanism)
    return None if computation.order <= highest else f"supports orders up to {highest}, not {computation.order}"


def motion_layout(computation: Computation) -> VectorLayout:
    """The layout of the motion of a body, which is needed only until its children have theirs."""
    parts = sweep_of(computation).parts.items()
    return VectorLayout(tuple((name, computation.order + 1 + more, SCALARS_PER_PART[name]) for name, more in parts))


def body_layout(computation: Computation) -> VectorLayout:
    """The layout of the joint variable of a body, the force on the body, and the force of its joint.

    Where accelerations are found, those of the articulated body follow.
    """
    count = computation.order + 1
    joint = (("theta", computation.rates, 1), ("sine", 1, 1), ("cosine", 1, 1))
    acting = (("f", count, 3), ("n", count, 3), ("Q", count, 1))
    loads = (("W", count, 6),) if computation.wrench else ()
    return VectorLayout((*joint, *acting, *loads, *(ARTICULATED_PARTS if computation.quantity.takes.forces else ())))


def base_layout(computation: Computation) -> VectorLayout:
    """The layout of the motion of the base, as the inputs list it."""
    return VectorLayout((("C", 1, 16), ("V", computation.rates - 1, 6)))


def sweep_of(computation: Computation) -> Sweep:
    """The sweep of a quantity that has one."""
    sweep = computation.quantity.sweep
    assert sweep is not None, computation
    return sweep


def motion_slots(parent: Sequence[int]) -> list[int]:
    """Assign slots to motions, the ground's first; a slot is reused after the last child has its motion."""
    last = list(range(-1, len(parent)))  # the last child of each, the ground's first; itself if it has none
    for i, p in enumerate(parent):
        last[p + 1] = i
    return reuse_places(enumerate(last, start=-1))


def loop_sizes(computation: Computation, mechanism: Mechanism) -> tuple[int, int, int]:
    """The vectors that the loop form keeps: of the ground and all bodies, of their motions, of that of the base."""
    parent = carriers(mechanism)
    bodies = (len(parent) + 1) * body_layout(computation).size
    motions = (max(motion_slots(parent)) + 1) * motion_layout(computation).size
    found = mechanism.floats and computation.quantity.takes.forces  # else it is given
    return bodies, motions, base_layout(computation).size if found else 0


def vectors_of_bodies(computation: Computation, mechanism: Mechanism) -> int:
    """The vectors that the loop form keeps in all; none in a straight line."""
    return 0 if is_straight(computation, mechanism) else sum(loop_sizes(computation, mechanism))


def block_size(signature: Signature, of_bodies: int, lanes: int) -> int:
    """The bytes of a block of states."""
    return 8 * lanes * (signature.inputs[-1].end + signature.outputs[-1].end + of_bodies)


def scratch_size(computation: Computation, mechanism: Mechanism, lanes: int) -> int:
    """The bytes of one call of a kernel, without what the pieces of a straight line keep."""
    signature, columns = computation.signature(mechanism), column_layout(computation, mechanism)
    of_bodies = columns.areas.size if columns is not None else vectors_of_bodies(computation, mechanism)
    return block_size(signature, of_bodies, lanes)
