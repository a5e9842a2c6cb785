"""The branches of loops: what the frames that cut joints join see of each other, by sweeps over the joints between.

Problem: the constraints A q' = 0 of the loops, their rates, and the forces A^T y that cut joints exert.

Algorithm: a loop consists of two branches, from the body that carries both to the frames a and b. Twists are summed up
outward along the branches, forces inward; joints that branches share from the same body are done once. E = Ad(C_ab)
takes twists from b to a.

Invariant: where the loop is closed the relative twist V obeys R V = 0, with the constant rows R of the cut joint, so
that only what the joint allows is left of it and ``E' = ad(V) E``: rates of E never appear.

Failure: none is noticed. E takes the loops as closed: where they are open, A is approximate and its rates mean nothing.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, partial
from operator import matmul

import numpy as np

from jounce.core.errors import JounceError
from jounce.core.scalars import Array
from jounce.dynamics.recursion.joints import MovingJoint, joints, take_rows, transport_inward
from jounce.model.equivalent_mechanisms import align_to_axes, frame_shifts
from jounce.model.frame import Frame
from jounce.model.loops import NO_RATIOS, convert_loops
from jounce.model.mechanism import Mechanism, path_to, robot_size
from jounce.spatial.lie import Ad, ad, inverse, pose, position, rotation
from jounce.spatial.series import Series, column_series, from_rate, from_rates, join_series

CONSTRAINT_ENTRY_ROUNDING = 1e-13  # relative to the largest entry: what sums along branches leave of zeros
_ORIGIN = np.zeros((3, 1), dtype=int)
_NO_TWIST = Series.constant(np.zeros((6, 1), dtype=int))


@dataclass(frozen=True)
class Branch:
    """The joints from a body to a frame."""

    root: int
    joints: tuple[int, ...]
    columns: Array  # (k, N) the velocities of the joints from those of the coordinates
    T: Array  # (4, 4) pose of the frame on the last body

    @cached_property
    def Ad(self) -> Array:
        """The matrix that takes twists from the last body to the frame, (6, 6)."""
        return Ad(inverse(self.T))

    @property
    def key(self) -> tuple[int, int]:
        """The first body, and the last one."""
        return self.root, self.joints[-1] if self.joints else self.root


@lru_cache(maxsize=64)
def loop_chain(tree: Mechanism) -> Mechanism:
    """The tree in the frames in which forces are computed, if its joints have directions of numbers."""
    try:
        return align_to_axes(tree)
    except JounceError:
        return tree


@lru_cache(maxsize=64)
def branches(m: Mechanism) -> list[tuple[Branch, Branch]]:
    """The branches of each loop."""
    tree = m.tree
    shifts = [inverse(T) for T in frame_shifts(tree, loop_chain(tree))]

    def branch(frame: Frame, shared: Sequence[int]) -> Branch:
        own = [i for i in path_to(tree, frame.body) if i not in shared]
        T = shifts[frame.body] @ frame.T if frame.body >= 0 else frame.T
        columns = tree.G[[j for i in own for j in tree.columns[i]]]
        return Branch(shared[-1] if shared else -1, tuple(own), columns, T)

    both = []
    for loop in m.loops:
        shared = [i for i in path_to(tree, loop.a.body) if i in path_to(tree, loop.b.body)]
        both.append((branch(loop.a, shared), branch(loop.b, shared)))
    return both


class LoopEnds:
    """The motion of the ends of loops, at coordinates (..., N, 1) of the tree."""

    def __init__(self, m: Mechanism, q: Series) -> None:
        self.m, self.q, self.branches = m, q, branches(m)
        bodies = sorted({i for both in self.branches for branch in both for i in branch.joints})
        self.joints: Mapping[int, MovingJoint] = dict(
            zip(bodies, joints(loop_chain(m.tree), q, None, bodies), strict=True)
        )

    @cached_property
    def _views(self) -> dict[tuple[int, int], tuple[Array, Series]]:
        """What the last body of a branch sees: the pose of the first body, and the screws of the joints."""
        distinct = {branch.key: branch for both in self.branches for branch in both}
        return {key: self._view(branch) for key, branch in distinct.items()}

    def _view(self, branch: Branch) -> tuple[Array, Series]:
        E, r, V, S = np.eye(6, dtype=int), _ORIGIN, _NO_TWIST, [_NO_TWIST @ np.zeros((1, 0), dtype=int)]
        for joint in (self.joints[i] for i in reversed(branch.joints)):
            S.insert(0, from_rate(E @ joint.X, partial(_turn, V)))
            V, E = V - S[0] @ joint.rate, E @ joint.A
            r = r - rotation(E) @ (position(joint.T) + rotation(joint.B).mT @ position(joint.B))
            E = E @ joint.Ad_turn @ joint.Ad_offset
        return pose(rotation(E), r), join_series(S, axis=-1)

    def screws(self, branch: Branch) -> Series:
        """The screws of the joints of a branch as its last body sees them, (..., 6, k)."""
        return self._views[branch.key][1]

    @cached_property
    def poses(self) -> list[Array]:
        """C_ab, where the second frame of each loop is in the first, (..., 4, 4)."""
        starts = [[inverse(branch.T) @ self._views[branch.key][0] for branch in both] for both in self.branches]
        return [a @ inverse(b) for a, b in starts]

    @cached_property
    def _E(self) -> list[Array]:
        """Ad(C_ab) where loops are closed: the joint does not allow all slides."""
        both = zip(self.m.loops, self.poses, strict=True)
        return [Ad(pose(rotation(C), loop.allowed[3:, 3:] @ position(C))) for loop, C in both]

    @cached_property
    def _relative(self) -> list[Series]:
        """The relative twists of loops."""
        return self.twists(self.q.dot)

    def _drift(self, k: int) -> Series:
        """ad(V) of the relative twist of a loop."""
        allowed = self.m.loops[k].allowed
        return Series(lambda j: ad((allowed @ self._relative[k][j])[..., 0]))

    def twists(self, x: Series) -> list[Series]:
        """V, (..., 6, k), of the second frame of each loop as the first sees it, at velocities x (..., N, k)."""
        tree = self.m.tree
        theta = tree.G @ x
        found: dict[tuple[int, int], Series] = {}

        def end(branch: Branch) -> Series:
            V = _NO_TWIST
            for i in branch.joints:
                key = branch.root, i
                if key not in found:
                    own = self.joints[i].X @ theta.map(lambda x, own=tree.columns[i]: x[..., list(own), :])
                    found[key] = own if V is _NO_TWIST else self.joints[i].twists(V) + own
                V = found[key]
            return branch.Ad @ V

        def relative(k: int, a: Branch, b: Branch) -> Series:
            return from_rates(lambda j: self._E[k] @ end(b)[j], lambda y: self._drift(k) @ y) - end(a)

        return [relative(k, a, b) for k, (a, b) in enumerate(self.branches)]

    def held(self, x: Series) -> Series:
        """A x, (..., c, k), at velocities x (..., N, k): what cut joints do not allow of the relative twists."""
        return join_series([loop.rows @ V for loop, V in zip(self.m.loops, self.twists(x), strict=True)], axis=-2)

    @cached_property
    def A(self) -> Series:
        """A, (..., c, N), from the screws; of one column `held` takes fewer operations."""
        return join_series([self._constraints(k) for k in range(len(self.branches))], axis=-2)

    def _constraints(self, k: int) -> Series:
        """The rows of one loop."""
        rows, (a, b) = self.m.loops[k].rows, self.branches[k]
        X_a, X_b = (branch.Ad @ self.screws(branch) for branch in (a, b))
        seen = from_rates(lambda j: self._E[k] @ X_b[j], lambda y: self._drift(k) @ y)
        return rows @ seen @ b.columns - rows @ X_a @ a.columns

    def end_wrenches(self, y: Series) -> Iterator[tuple[Branch, Array, Series]]:
        """The wrenches on the last bodies of branches, (..., 6, k), where cut joints exert y, (..., c, k).

        Each comes with its branch, and the projection onto the twists that the joint allows, as the body sees them.
        """
        start = 0
        for k, (loop, (a, b)) in enumerate(zip(self.m.loops, self.branches, strict=True)):
            end = start + len(loop.rows)
            W, start = loop.rows.T @ take_rows(y, start, end), end
            E_T, ads = self._E[k].mT, self._drift(k)
            seen = transport_inward(W, partial(matmul, E_T), partial(matmul, ads.mT))
            for branch, own in ((a, -W), (b, seen)):
                yield branch, Ad(branch.T) @ loop.allowed @ branch.Ad, branch.Ad.mT @ own

    def forces(self, y: Series) -> Series:
        """A^T y, (..., N, k): the forces on the coordinates where cut joints exert y, (..., c, k)."""
        tree, at = self.m.tree, dict[tuple[int, int], Series]()

        def add(key: tuple[int, int], W: Series) -> None:
            at[key] = at[key] + W if key in at else W

        for branch, _, W in self.end_wrenches(y):
            add(branch.key, W)
        # inward along the branches, each joint after those beyond it
        Q: dict[int, Series] = {}
        ways = {(branch.root, i) for both in self.branches for branch in both for i in branch.joints}
        for root, i in sorted(ways, key=lambda way: -way[1]):
            joint, W = self.joints[i], at.pop((root, i))
            own = joint.X.mT @ W
            Q[i] = Q[i] + own if i in Q else own
            if joint.parent != root:
                add((root, joint.parent), joint.wrenches(W))
        still = 0 * take_rows(y, 0, 1)
        parts = [
            Q[i] if i in Q else join_series([still] * len(own), axis=-2) for i, own in enumerate(tree.columns) if own
        ]
        return tree.G.T @ join_series(parts, axis=-2)


def _turn(V: Series, S: Series) -> Series:
    """The rates of screws that move with the twist V."""
    return V.map(lambda V: ad(V[..., 0])) @ S


@dataclass(frozen=True)
class Scales:
    """Lengths that make gaps and constraints numbers without units."""

    length: float
    rows: np.ndarray  # (c,)
    coordinates: np.ndarray  # (N,)


@lru_cache(maxsize=64)
def scales(m: Mechanism) -> Scales:
    """The scales of a mechanism with loops."""
    assert m.closure is not None, m.name
    length = robot_size(m)
    slides = np.array([slide for x in m.loops for slide, held in enumerate(x.held) for _ in held], dtype=bool)
    turning = np.abs(m.closure.G.T).astype(float) @ m.X[:, :3].any(axis=1) > 0
    return Scales(length, np.where(slides, 1 / length, 1.0), np.where(turning, 1.0, length))


@lru_cache(maxsize=64)
def constraint_pattern(m: Mechanism) -> np.ndarray:
    """Which entries of A, (c, N), are not zero wherever the coordinates are; of a robot of symbols all of them.

    Entries are analytic functions: those that vanish at some arbitrary places are zero.
    """
    try:
        kinematic = _keep_kinematics(m)
    except (TypeError, ValueError, RuntimeError):  # as symbols of SymPy, of a tape, of CasADi say
        return np.ones((sum(len(loop.rows) for loop in m.loops), m.tree.n), dtype=bool)
    s = scales(kinematic)
    q = np.random.default_rng(0).uniform(-2, 2, (3, m.tree.n)) * s.coordinates
    A = np.abs(s.rows[:, None] * LoopEnds(kinematic, column_series([q])).A[0] * s.coordinates)
    return np.asarray((CONSTRAINT_ENTRY_ROUNDING * A.max() < A).any(axis=0))


@lru_cache(maxsize=64)
def with_solved_loops(m: Mechanism) -> Mechanism:
    """A closed robot with those of its loops alone in which constraints are solved for a coordinate.

    The others are closed wherever followers with constant ratios are in their places.
    """
    if m.closure is None or not m.closure.ratios.places or not m.loops:
        return m
    ends = np.cumsum([len(loop.rows) for loop in m.loops])
    parts = np.split(constraint_pattern(m)[:, list(m.closure.solved)], ends[:-1])
    return replace(m, loops=tuple(loop for loop, part in zip(m.loops, parts, strict=True) if part.any()))


def _keep_kinematics(m: Mechanism) -> Mechanism:
    """A robot without what its loops do not depend on, in doubles; symbols raise an error."""
    B, X, G, g = (x.astype(float) for x in (m.B, m.X, m.G, m.g))
    loops, closure = convert_loops(m.loops, m.closure, lambda x: x.astype(float))
    M, gravity = np.zeros((m.nb, 6, 6)), np.zeros(3)
    return replace(
        m, B=B, X=X, G=G, g=g, M=M, gravity=gravity, loops=loops, closure=closure, frames=(), elasticity=None
    )


@lru_cache(maxsize=64)
def without_ratios(m: Mechanism) -> Mechanism:
    """A closed robot of which constraints are solved for all dependent coordinates."""
    return replace(m, closure=replace(m.closure, ratios=NO_RATIOS)) if m.closure and m.closure.ratios.places else m
