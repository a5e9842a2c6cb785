"""Plan native code: which form a computation takes, and where everything is in its scratch memory.

Scratch memory holds a block of states, one vector for each scalar, with a lane for each state: the inputs, the outputs,
and behind them what the form works in. A `VectorLayout` says where parts are. Everything here follows from the robot
and the computation alone, before any code is made: kernels that are read from the cache take their sizes from here.

Four forms: few bodies take a straight line of operations (`is_straight`). More take a loop over the bodies, each with
its layout of joint, forces and motion (`body_layout`, `motion_layout`); a slot of a motion is used again after the last
child has its own motion. Accelerations of many bodies take this loop with articulated bodies (`ARTICULATED_PARTS`).
Partial derivatives of large robots take columns of matrices (`column_layout`).

In the form of columns, rows of matrices have a place for each joint, in the reverse of the order in which a walk along
the tree first comes to the joints. All joints that a joint carries then have neighbouring places, which end with its
own. Rows end with empty places, which whole vectors reach into.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import accumulate

import numpy as np

from jounce.dynamics.computation import SECOND_PRODUCTS, Computation, Signature
from jounce.dynamics.recursion.articulated import moves_joints_alone
from jounce.dynamics.recursion.forces import Sweep
from jounce.model import positions
from jounce.model.equivalent_mechanisms import minimal_mechanism
from jounce.model.mechanism import Mechanism
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


@dataclass(frozen=True)
class VectorLayout:
    """Vectors one behind the other, in parts: each has a name, a number of rates, and of scalars per rate.

    The `unknown` highest rates of each part have their places, but no values yet.
    """

    parts: tuple[tuple[str, int, int], ...]
    unknown: int = 0

    def places(self, name: str) -> list[range]:
        """Return the positions of the known rates of a part."""
        # Rates of a part follow each other: the scalars of the value, those of its first rate, ...
        starts = accumulate((rates * scalars for _, rates, scalars in self.parts), initial=0)
        for (part, rates, scalars), start in zip(self.parts, starts, strict=False):
            if part == name:
                # The value itself is always known: it is the position, or is not a rate at all.
                known = range(max(1, rates - self.unknown))
                return [range(start + k * scalars, start + (k + 1) * scalars) for k in known]
        raise KeyError(name)

    def start(self, name: str) -> int:
        """Return the position of a part."""
        return self.places(name)[0].start

    @property
    def size(self) -> int:
        """The number of vectors."""
        return sum(rates * scalars for _, rates, scalars in self.parts)


def carriers(mechanism: Mechanism) -> list[int]:
    """Return the joint that carries each joint.

    -1 is the ground, or a moving base.
    """
    return [
        mechanism.parent[i] - mechanism.moving_bodies.start if mechanism.parent[i] >= 0 else -1
        for i in mechanism.owners
    ]


class LongCompilationError(Exception):
    """Compiling takes longer than the caller waits for it."""


def is_straight(computation: Computation, mechanism: Mechanism) -> bool:
    """Return whether the code is a straight line.

    A loop over the bodies is half as fast, but compiles at once.
    """
    quantity, bodies = computation.quantity, len(mechanism.joints)
    balanced = quantity.balanced and mechanism.contacts
    # The steps of one joint do not cover derivatives, closed loops, joints of several screws and contacts.
    if (
        quantity.sweep is None
        or computation.product
        or mechanism.closure
        or positions.multiscrew_joints(mechanism)
        or balanced
    ):
        return True
    # Operations of forces grow with the number of bodies and the square of the number of rates.
    if not quantity.takes.forces:
        return bodies * (computation.order + 1) ** 2 <= MAX_STRAIGHT_SIZE
    # Articulated bodies need drives that do not depend on Q, and coordinates that move one joint each.
    if mechanism.has_load_friction or not moves_joints_alone(mechanism):
        return True
    return _count_numbers(mechanism) * (computation.order + 4 / 3) <= MAX_STRAIGHT_NUMBERS


def _count_numbers(mechanism: Mechanism) -> int:
    """Count the numbers of a robot that its steps multiply by: 0 and 1 cost nothing."""
    chain = minimal_mechanism(mechanism)
    numbers = [chain.B[:, :3], chain.X, chain.M[:, *np.triu_indices(6)]]
    return sum(int(np.count_nonzero(~np.isin(x.astype(float), (-1, 0, 1)))) for x in numbers)


def highest_order(computation: Computation, mechanism: Mechanism) -> int:
    """Return the highest order with native code."""
    # Products take arrays for all rates, and their weights or directions: NumPy's functions have a limit of arrays. The
    # dependent coordinates of closed robots are one array more.
    if computation.product in SECOND_PRODUCTS:
        of_product = HIGHEST_SECOND_ORDER_WITH_BASE if computation.base else HIGHEST_SECOND_ORDER
    else:
        with_base = HIGHEST_PRODUCT_ORDER_WITH_BASE - bool(mechanism.closure)
        of_product = with_base if computation.base else HIGHEST_PRODUCT_ORDER
    # Motor torques have the arrays of forces two orders higher.
    highest = HIGHEST_NATIVE_ORDER if computation.product is None else of_product
    return highest + 1 - computation.quantity.takes.wrench_rates


def obstacle(computation: Computation, mechanism: Mechanism) -> str | None:
    """Return why a computation has no native code, or None.

    The reason is the end of a sentence that begins with "native code".
    """
    highest = highest_order(computation, mechanism)
    return None if computation.order <= highest else f"supports orders up to {highest}, not {computation.order}"


def motion_layout(computation: Computation) -> VectorLayout:
    """Return the layout of the motion of a body.

    It is needed only until the children have their own motions.
    """
    parts = sweep_of(computation).parts.items()
    return VectorLayout(tuple((name, computation.order + 1 + more, SCALARS_PER_PART[name]) for name, more in parts))


def body_layout(computation: Computation) -> VectorLayout:
    """Return the layout of a body: its joint variable, its force, and the force of its joint.

    Where accelerations are found, the parts of the articulated body follow.
    """
    count = computation.order + 1
    joint = (("theta", computation.rates, 1), ("sine", 1, 1), ("cosine", 1, 1))
    acting = (("f", count, 3), ("n", count, 3), ("Q", count, 1))
    loads = (("W", count, 6),) if computation.wrench else ()
    return VectorLayout((*joint, *acting, *loads, *(ARTICULATED_PARTS if computation.quantity.takes.forces else ())))


def base_layout(computation: Computation) -> VectorLayout:
    """Return the layout of the base's motion, as inputs list it."""
    return VectorLayout((("C", 1, 16), ("V", computation.rates - 1, 6)))


def sweep_of(computation: Computation) -> Sweep:
    """Return the sweep of a quantity that has one."""
    sweep = computation.quantity.sweep
    assert sweep is not None, computation
    return sweep


def motion_slots(parent: Sequence[int]) -> list[int]:
    """Assign slots to motions, the ground's first.

    A slot is used again after the last child has its motion.
    """
    # The last child of each body, of the ground first; the body itself if it has none.
    last = list(range(-1, len(parent)))
    for i, p in enumerate(parent):
        last[p + 1] = i
    return reuse_places(enumerate(last, start=-1))


def loop_sizes(computation: Computation, mechanism: Mechanism) -> tuple[int, int, int]:
    """Return how many vectors the loop form keeps.

    They are counted for bodies, for motions, and for the base.
    """
    parent = carriers(mechanism)
    bodies = (len(parent) + 1) * body_layout(computation).size
    motions = (max(motion_slots(parent)) + 1) * motion_layout(computation).size
    # Rates of the motion of a floating base are found along with accelerations; otherwise this motion is an input.
    finds_base_motion = mechanism.floats and computation.quantity.takes.forces
    return bodies, motions, base_layout(computation).size if finds_base_motion else 0


def vectors_of_bodies(computation: Computation, mechanism: Mechanism) -> int:
    """Return how many vectors the loop form keeps in all.

    A straight line keeps none.
    """
    return 0 if is_straight(computation, mechanism) else sum(loop_sizes(computation, mechanism))


def block_size(signature: Signature, of_bodies: int, lanes: int) -> int:
    """Return the bytes of a block of states."""
    return 8 * lanes * (signature.inputs[-1].end + signature.outputs[-1].end + of_bodies)


def scratch_size(computation: Computation, mechanism: Mechanism, lanes: int) -> int:
    """Return the bytes of one call of a kernel.

    What pieces of a straight line keep is not counted.
    """
    signature, columns = computation.signature(mechanism), column_layout(computation, mechanism)
    of_bodies = columns.areas.size if columns is not None else vectors_of_bodies(computation, mechanism)
    return block_size(signature, of_bodies, lanes)


COLUMN_QUANTITIES = ("inverse_dynamics_partials", "forward_dynamics_partials")
MIN_VELOCITIES_IN_COLUMNS = 32  # a straight line of more takes seconds to compile, and longer for one state
MOST_LANES = 8  # doubles of the widest vectors
WRENCH_NUMBERS = 24  # of a screw's momentum, its rate, its reaction and its change
PRODUCTS = ("M", "K", "D", "by_place", "by_rate")  # matrices of a joint's screws with what it carries
BASE_BLOCKS = ("K", "D", "M")  # of the base's screws with themselves
ZERO, MINUS_ONE = 0, 1  # the places of these numbers among the results
BODY = VectorLayout(
    (
        ("sine", 1, 1), ("cosine", 1, 1), ("V", 2, 6), ("field", 1, 3), ("Pi", 2, 10), ("p", 2, 6), ("S_rate", 1, 6),
        ("A", 1, 6),
    )
)  # fmt: skip


@dataclass(frozen=True)
class ColumnLayout:
    """The scratch memory of the columns form, and places of results.

    Velocities are numbered in their order: i, j < nv, the six of a floating base first, then those of the joints.
    Velocity i "carries" velocity j if it moves the body of j.
    """

    carriers: tuple[int, ...]  # by joint, the one that carries it; -1: the ground or the base
    floats: bool
    forward: bool  # of accelerations, not of forces

    @property
    def joints(self) -> int:
        """The number of joints."""
        return len(self.carriers)

    @property
    def nv(self) -> int:
        """The number of velocities."""
        return self.joints + 6 * self.floats

    @property
    def width(self) -> int:
        """The length of a row with a place for each joint."""
        return self.joints + MOST_LANES

    @property
    def solved_width(self) -> int:
        """The length of a row of right sides and solutions: by q, by qd, by Q, and the accelerations themselves."""
        return 3 * self.nv + 1 + MOST_LANES

    @cached_property
    def walk(self) -> list[int]:
        """The joints in the order of a walk along the tree."""
        order, waiting = list[int](), [-1]
        # Depth first: the joints that a joint carries, and only those, come directly after it.
        while len(waiting) > 0:
            j = waiting.pop()
            if j >= 0:
                order.append(j)
            waiting += [i for i in reversed(range(self.joints)) if self.carriers[i] == j]
        return order

    @cached_property
    def entries(self) -> list[tuple[int, int]]:
        """The nonzero entries (i, j) of M with j <= i."""
        return [(i, j) for i in range(self.nv) for j in range(i + 1) if self.carry[j, i]]

    @cached_property
    def carry(self) -> np.ndarray:
        """Whether velocity i moves the body of velocity j, (nv, nv)."""
        base = 6 * self.floats
        moves = np.zeros((self.nv, self.nv), dtype=bool)
        # A floating base moves all bodies; a joint its own one, which all that moves its carrier moves too.
        moves[:base] = True
        for j, carrier in enumerate(self.carriers):
            moves[base + j, base + j] = True
            if carrier >= 0:
                moves[base:, base + j] |= moves[base:, base + carrier]
        return moves

    @property
    def factor_operations(self) -> int:
        """About the number of operations of the factors of M.

        They are a straight line.
        """
        # Eliminating velocity j changes the entries of all pairs of velocities that move its body.
        depths = self.carry.sum(axis=0)
        return int((depths * (depths + 1)).sum())

    @cached_property
    def areas(self) -> VectorLayout:
        """The layout of scratch memory behind inputs and outputs.

        `columns` are 24 rows, one for each number of a column's wrenches. For accelerations follow the accelerations
        that are found, the factors of M, and right sides and solutions in rows of `solved_width`.
        """
        sizes = [
            ("mask", 1),
            ("bodies", (self.joints + 1) * BODY.size),
            ("columns", WRENCH_NUMBERS * self.width),
            ("results", self.results.size),
        ]
        if self.forward:
            solved = self.nv * self.solved_width
            sizes += [("found", self.nv), ("factors", len(self.entries)), ("sides", solved), ("solved", solved)]
        return VectorLayout(tuple((name, 1, size) for name, size in sizes))

    @cached_property
    def results(self) -> VectorLayout:
        """The layout of the area `results`: two constants, blocks of the base, products."""
        of_base = [(f"base {name}", 1, 36) for name in BASE_BLOCKS]
        products = [(f"all {name}", self.nv, self.width) for name in PRODUCTS]
        return VectorLayout((("constants", 1, 2), *of_base, *products))

    def place(self, matrix: str, i: int, j: int) -> int:
        """Return the place of entry i, j of K, D or M.

        It is counted among the results.
        """
        base = 6 * self.floats
        if i < base and j < base:
            return self.results.start(f"base {matrix}") + 6 * i + j
        # All products of a pair are in the row of the one that carries the other.
        if self.carry[i, j]:
            return self._product(matrix, i, j)
        if self.carry[j, i]:
            return self._product({"K": "by_place", "D": "by_rate", "M": "M"}[matrix], j, i)
        return ZERO

    def _product(self, name: str, i: int, j: int) -> int:
        """Return the place of a product of two velocities.

        Velocity i has the row, joint velocity j the column.
        """
        return self.results.start(f"all {name}") + i * self.width + self.column(j - 6 * self.floats)

    def column(self, joint: int) -> int:
        """Return the place of a joint in rows."""
        return self.joints - 1 - self.walk.index(joint)

    def carried(self, joint: int) -> int:
        """Return the number of joints that a joint carries, itself included."""
        return int(self.carry[6 * self.floats + joint].sum())


@lru_cache(maxsize=64)
def column_layout(computation: Computation, mechanism: Mechanism) -> ColumnLayout | None:
    """Return the layout of a computation in the columns form.

    None is for computations that take another form.
    """
    # The form covers partial derivatives without rates and wrenches, and with a moving base only if the robot floats.
    m, covered = mechanism, Computation(computation.name, 0, base=mechanism.floats)
    if computation != covered or computation.name not in COLUMN_QUANTITIES or m.nv < MIN_VELOCITIES_IN_COLUMNS:
        return None
    # Of the robot, it covers trees of joints of one screw without drives, in which each coordinate is a joint's own.
    if m.closure or positions.multiscrew_joints(m) or m.acting or not np.array_equal(m.G, np.eye(len(m.joints))):
        return None
    return ColumnLayout(tuple(carriers(m)), m.floats, computation.quantity.takes.forces)
