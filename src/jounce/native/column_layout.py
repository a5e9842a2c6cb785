"""Plans of the columns form of native code: which computations take it, and where in scratch memory everything is.

Rows of matrices have a place for each joint, in the reverse of the order in which a walk along the tree first comes to
the joints: all that a joint carries then is in a row of places, the last of which is its own. Rows of matrices end with
places that nothing is in, which whole vectors reach into.
"""

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from jounce.dynamics.computation import Computation
from jounce.model.mechanism import Mechanism
from jounce.model.positions import multiscrew_joints
from jounce.native.vector_layout import VectorLayout, carriers

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
    """The scratch memory of a robot, and the places of its results."""

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
        """The joints in the order in which a walk along the tree first comes to them."""
        found, open_ = list[int](), [-1]
        while open_:
            j = open_.pop()
            found += [j] * (j >= 0)
            open_ += [i for i in reversed(range(self.joints)) if self.carriers[i] == j]
        return found

    @cached_property
    def entries(self) -> list[tuple[int, int]]:
        """The rows and columns of the entries of M on and below the diagonal that are not zero."""
        return [(i, j) for i in range(self.nv) for j in range(i + 1) if self.carry[j, i]]

    @cached_property
    def carry(self) -> np.ndarray:
        """Whether velocity i moves the body of velocity j, of all i and j."""
        base = 6 * self.floats
        moves = np.zeros((self.nv, self.nv), dtype=bool)
        moves[:base] = True
        for j, carrier in enumerate(self.carriers):
            moves[base + j, base + j] = True
            if carrier >= 0:
                moves[base:, base + j] |= moves[base:, base + carrier]
        return moves

    @property
    def factor_operations(self) -> int:
        """About the number of products and sums of the factors of M, which are a straight line."""
        above = self.carry.sum(axis=0)
        return int((above * (above + 1)).sum())

    @cached_property
    def areas(self) -> VectorLayout:
        """Everything, in vectors."""
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
        """The results: two constants, the blocks of the base, products."""
        of_base = [(f"base {name}", 1, 36) for name in BASE_BLOCKS]
        products = [(f"all {name}", self.nv, self.width) for name in PRODUCTS]
        return VectorLayout((("constants", 1, 2), *of_base, *products))

    def place(self, matrix: str, i: int, j: int) -> int:
        """Where among the results the entry i, j of K, D or M is."""
        base = 6 * self.floats
        if i < base and j < base:
            return self.results.start(f"base {matrix}") + 6 * i + j
        if self.carry[i, j]:
            return self._product(matrix, i, j)
        if self.carry[j, i]:
            return self._product({"K": "by_place", "D": "by_rate", "M": "M"}[matrix], j, i)
        return ZERO

    def _product(self, name: str, i: int, j: int) -> int:
        return self.results.start(f"all {name}") + i * self.width + self.column(j - 6 * self.floats)

    def column(self, joint: int) -> int:
        """The place of a joint in rows."""
        return self.joints - 1 - self.walk.index(joint)

    def carried(self, joint: int) -> int:
        """The number of joints that a joint carries, itself included."""
        return int(self.carry[6 * self.floats + joint].sum())


@lru_cache(maxsize=64)
def column_layout(computation: Computation, mechanism: Mechanism) -> ColumnLayout | None:
    """The layout of a computation that takes the columns form, or None."""
    m, asked = mechanism, Computation(computation.name, 0, base=mechanism.floats)
    if computation != asked or computation.name not in COLUMN_QUANTITIES or m.nv < MIN_VELOCITIES_IN_COLUMNS:
        return None
    if m.closure or multiscrew_joints(m) or m.acting or not np.array_equal(m.G, np.eye(len(m.joints))):
        return None
    return ColumnLayout(tuple(carriers(m)), m.floats, computation.quantity.takes.forces)
