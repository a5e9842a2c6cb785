"""The branches of loops: what the frames that cut joints join see of each other, by sweeps over the joints between.

Problem: the constraints A q' = 0 of the loops, their rates, and the forces A^T y that cut joints exert.

Algorithm: a loop consists of two branches, from the body that carries both to the frames a and b. Twists are summed up
outward along the branches, forces inward; joints that branches share from the same body are done once. E = Ad(C_ab)
takes twists from b to a.

Invariant: where the loop is closed the relative twist V obeys R V = 0, with the constant rows R of the cut joint, so
that only what the joint allows is left of it and ``E' = ad(V) E``: rates of E never appear.

How often what runs: `branches`, `scales` and `constraint_pattern` once per robot; a `LoopEnds` is made once per Newton
step or evaluation, and computes its views, poses and constraints once, when they are first asked for.

Failure: none is noticed. E takes the loops as closed: where they are open, A is approximate and its rates mean nothing.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, partial
from itertools import chain
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
        """Ad(T^-1), from the last body to the frame, (6, 6)."""
        return Ad(inverse(self.T))

    @property
    def key(self) -> tuple[int, int]:
        """The first body, and the last one."""
        return self.root, self.joints[-1] if self.joints else self.root


@lru_cache(maxsize=64)
def loop_chain(tree: Mechanism) -> Mechanism:
    """Return the tree in frames on its joint axes.

    Most entries are zero there.
    """
    try:
        return align_to_axes(tree)
    except JounceError:
        # Directions of joints that are symbols have no frames on their axes.
        return tree


@lru_cache(maxsize=64)
def branches(m: Mechanism) -> list[tuple[Branch, Branch]]:
    """Return the branches of each loop, to its frames a and b."""
    tree = m.tree
    shifts = [inverse(T) for T in frame_shifts(tree, loop_chain(tree))]

    def branch(frame: Frame, shared: Sequence[int]) -> Branch:
        bodies = [i for i in path_to(tree, frame.body) if i not in shared]
        # Frames of the loop are stated in the given body frames; branches use those of `loop_chain`.
        T = shifts[frame.body] @ frame.T if frame.body >= 0 else frame.T
        columns = tree.G[[j for i in bodies for j in tree.columns[i]]]
        return Branch(shared[-1] if len(shared) > 0 else -1, tuple(bodies), columns, T)

    pairs = []
    for loop in m.loops:
        # Joints on the way to both frames move both alike: the branches begin behind the last of them.
        shared = [i for i in path_to(tree, loop.a.body) if i in path_to(tree, loop.b.body)]
        pairs.append((branch(loop.a, shared), branch(loop.b, shared)))
    return pairs


class LoopEnds:
    """The motion of the ends of loops, at coordinates q.

    q is (..., N, 1), of the tree.
    """

    def __init__(self, m: Mechanism, q: Series) -> None:
        self.m, self.q, self.branches = m, q, branches(m)
        # Only joints on branches are set up: the others do not move the ends of a loop against each other.
        bodies = sorted({i for branch in self._both_branches() for i in branch.joints})
        self.joints: Mapping[int, MovingJoint] = dict(
            zip(bodies, joints(loop_chain(m.tree), q, None, bodies), strict=True)
        )

    def _both_branches(self) -> Iterator[Branch]:
        """Yield the two branches of each loop."""
        return chain.from_iterable(self.branches)

    @cached_property
    def _views(self) -> dict[tuple[int, int], tuple[Array, Series]]:
        """The view of the last body of each branch.

        Loops may share branches.
        """
        distinct = {branch.key: branch for branch in self._both_branches()}
        return {key: self._view(branch) for key, branch in distinct.items()}

    def _view(self, branch: Branch) -> tuple[Array, Series]:
        """Return the pose of the first body and the joint screws.

        Seen from the last body, they are (..., 4, 4) and (..., 6, k).
        """
        # From the last joint inward: E is Ad of the pose of the body reached so far as the last body sees it, r its
        # origin, V its twist, S the screws collected so far, first joint first.
        E, r, V, S = np.eye(6, dtype=int), _ORIGIN, _NO_TWIST, [_NO_TWIST @ np.zeros((1, 0), dtype=int)]
        for joint in (self.joints[i] for i in reversed(branch.joints)):
            # S' = ad(V) S: a screw is fixed in the body that its joint moves.
            S.insert(0, from_rate(E @ joint.X, partial(_turn, V)))
            # On to the parent, in which the body has the pose B T: E becomes E Ad(T^-1) Ad(B^-1), and the origin of
            # the parent lies at -R_T^T (p_T + R_B^T p_B) of the body.
            V, E = V - S[0] @ joint.rate, E @ joint.A
            r = r - rotation(E) @ (position(joint.T) + rotation(joint.B).mT @ position(joint.B))
            E = E @ joint.Ad_turn @ joint.Ad_offset
        return pose(rotation(E), r), join_series(S, axis=-1)

    def screws(self, branch: Branch) -> Series:
        """Return the joint screws of a branch, seen by its last body.

        They are (..., 6, k).
        """
        return self._views[branch.key][1]

    @cached_property
    def poses(self) -> list[Array]:
        """C_ab, the pose of frame b of each loop in frame a.

        The shape is (..., 4, 4).
        """
        # Each frame sees the body from which both branches begin: C_ab = C_a0 C_b0^-1.
        root_poses = [[inverse(branch.T) @ self._views[branch.key][0] for branch in pair] for pair in self.branches]
        return [a @ inverse(b) for a, b in root_poses]

    @cached_property
    def _E(self) -> list[Array]:
        """Ad(C_ab) of closed loops: slides that the cut joint does not allow are left out."""
        return [
            Ad(pose(rotation(C), loop.allowed[3:, 3:] @ position(C)))
            for loop, C in zip(self.m.loops, self.poses, strict=True)
        ]

    @cached_property
    def _relative(self) -> list[Series]:
        """The relative twists V of the loops along the motion."""
        return self.twists(self.q.dot)

    def _drift(self, k: int) -> Series:
        """Return ad(V) of the relative twist of a loop.

        E' = ad(V) E.
        """
        allowed = self.m.loops[k].allowed
        return Series(lambda j: ad((allowed @ self._relative[k][j])[..., 0]))

    def twists(self, x: Series) -> list[Series]:
        """Return the relative twist V of each loop at velocities x.

        V is (..., 6, k), x is (..., N, k). It is the twist of the second frame as the first sees it.
        """
        tree = self.m.tree
        theta = tree.G @ x
        # Twists of bodies against the first body of their branch, by both: loops with joints in common share them.
        sums: dict[tuple[int, int], Series] = {}

        def end_twist(branch: Branch) -> Series:
            V = _NO_TWIST
            for i in branch.joints:
                key = branch.root, i
                if key not in sums:
                    joint_twist = self.joints[i].X @ theta.map(lambda x, rows=tree.columns[i]: x[..., list(rows), :])
                    # The first joint of a branch has nothing to transport.
                    sums[key] = joint_twist if V is _NO_TWIST else self.joints[i].twists(V) + joint_twist
                V = sums[key]
            return branch.Ad @ V

        def relative_twist(k: int, a: Branch, b: Branch) -> Series:
            # V = E V_b - V_a, of which (E y)' = E y' + ad(V) E y.
            V_b_seen_from_a = from_rates(lambda j: self._E[k] @ end_twist(b)[j], lambda y: self._drift(k) @ y)
            return V_b_seen_from_a - end_twist(a)

        return [relative_twist(k, a, b) for k, (a, b) in enumerate(self.branches)]

    def constrain(self, x: Series) -> Series:
        """Return A x = R V at velocities x.

        A x is (..., c, k), x is (..., N, k). These are the components of the relative twists that the cut joints hold.
        """
        return join_series([loop.rows @ V for loop, V in zip(self.m.loops, self.twists(x), strict=True)], axis=-2)

    @cached_property
    def A(self) -> Series:
        """A, (..., c, N), from the screws.

        For a single column `constrain` takes fewer operations.
        """
        return join_series([self._constraints(k) for k in range(len(self.branches))], axis=-2)

    def _constraints(self, k: int) -> Series:
        """Return the rows of one loop: R (E X_b G_b - X_a G_a), (..., c_k, N)."""
        rows, (a, b) = self.m.loops[k].rows, self.branches[k]
        X_a, X_b = (branch.Ad @ self.screws(branch) for branch in (a, b))
        X_b_seen_from_a = from_rates(lambda j: self._E[k] @ X_b[j], lambda y: self._drift(k) @ y)
        return rows @ X_b_seen_from_a @ b.columns - rows @ X_a @ a.columns

    def end_wrenches(self, y: Series) -> Iterator[tuple[Branch, Array, Series]]:
        """Yield the wrenches of multipliers y on last bodies of branches.

        Wrenches are (..., 6, k), y is (..., c, k). Each comes with its branch, and the projection onto the twists that
        the joint allows, as the body sees them.
        """
        start = 0
        for k, (loop, (a, b)) in enumerate(zip(self.m.loops, self.branches, strict=True)):
            # R^T y acts on frame b, seen from frame a; its reaction acts on frame a.
            end = start + len(loop.rows)
            W, start = loop.rows.T @ take_rows(y, start, end), end
            # E^T takes wrenches from a to b, with (E^T W)' = E^T (W' + ad(V)^T W).
            E_T, ads = self._E[k].mT, self._drift(k)
            W_seen_from_b = transport_inward(W, partial(matmul, E_T), partial(matmul, ads.mT))
            for branch, frame_wrench in ((a, -W), (b, W_seen_from_b)):
                yield branch, Ad(branch.T) @ loop.allowed @ branch.Ad, branch.Ad.mT @ frame_wrench

    def forces(self, y: Series) -> Series:
        """Return A^T y, the forces of cut joints on the coordinates.

        The shape is (..., N, k).
        """
        # Wrenches not yet carried inward, by root of the branch and body. Roots keep branches apart, since a wrench
        # ends at the root: what acts there is balanced by the other branch.
        tree, pending = self.m.tree, dict[tuple[int, int], Series]()

        def add(key: tuple[int, int], W: Series) -> None:
            pending[key] = pending[key] + W if key in pending else W

        for branch, _, W in self.end_wrenches(y):
            add(branch.key, W)
        # Inward along the branches: bodies have larger numbers than their parents, so that the largest come first and
        # every joint comes after those beyond it. Loops of several roots may move the same joint.
        Q: dict[int, Series] = {}
        root_and_joint = {(branch.root, i) for branch in self._both_branches() for i in branch.joints}
        for root, i in sorted(root_and_joint, key=lambda pair: -pair[1]):
            joint, W = self.joints[i], pending.pop((root, i))
            force = joint.X.mT @ W
            Q[i] = Q[i] + force if i in Q else force
            if joint.parent != root:
                add((root, joint.parent), joint.wrenches(W))
        # Joints on no branch feel nothing.
        no_force = 0 * take_rows(y, 0, 1)
        parts = [
            Q[i] if i in Q else join_series([no_force] * len(rows), axis=-2)
            for i, rows in enumerate(tree.columns)
            if len(rows) > 0
        ]
        return tree.G.T @ join_series(parts, axis=-2)


def _turn(V: Series, S: Series) -> Series:
    """Return ad(V) S, the rates of screws with the twist V."""
    return V.map(lambda V: ad(V[..., 0])) @ S


@dataclass(frozen=True)
class Scales:
    """Lengths that make gaps and constraints numbers without units."""

    length: float
    rows: np.ndarray  # (c,)
    coordinates: np.ndarray  # (N,)


@lru_cache(maxsize=64)
def scales(m: Mechanism) -> Scales:
    """Return the scales of a mechanism with loops."""
    assert m.closure is not None, m.name
    length = robot_size(m)
    # Rows of A: turns have no unit, slides are divided by the length. Columns: coordinates that turn any joint are in
    # rad, all others in m.
    slides = np.array([slide for x in m.loops for slide, held in enumerate(x.held) for _ in held], dtype=bool)
    turning = np.abs(m.closure.G.T).astype(float) @ m.X[:, :3].any(axis=1) > 0
    return Scales(length, np.where(slides, 1 / length, 1.0), np.where(turning, 1.0, length))


@lru_cache(maxsize=64)
def constraint_pattern(m: Mechanism) -> np.ndarray:
    """Return which entries of A, (c, N), may differ from zero.

    Entries are analytic functions: those that vanish at some arbitrary places are zero everywhere. All entries of a
    robot of symbols count as nonzero.
    """
    try:
        kinematic = _keep_kinematics(m)
    except (TypeError, ValueError, RuntimeError):  # as symbols of SymPy, of a tape, of CasADi say
        return np.ones((sum(len(loop.rows) for loop in m.loops), m.tree.n), dtype=bool)
    # Loops are open at random coordinates, where only the pattern of A means something, not its values.
    s = scales(kinematic)
    q = np.random.default_rng(0).uniform(-2, 2, (3, m.tree.n)) * s.coordinates
    A = np.abs(s.rows[:, None] * LoopEnds(kinematic, column_series([q])).A[0] * s.coordinates)
    return np.asarray((CONSTRAINT_ENTRY_ROUNDING * A.max() < A).any(axis=0))


@lru_cache(maxsize=64)
def with_solved_loops(m: Mechanism) -> Mechanism:
    """Return a closed robot with only the loops that are solved.

    Their constraints are solved for a coordinate. The others are closed wherever followers with constant ratios are in
    their places.
    """
    if m.closure is None or not m.closure.ratios.places or not m.loops:
        return m
    # A loop is solved for a coordinate if a column of A_d has an entry in the rows of the loop.
    ends = np.cumsum([len(loop.rows) for loop in m.loops])
    parts = np.split(constraint_pattern(m)[:, list(m.closure.solved)], ends[:-1])
    return replace(m, loops=tuple(loop for loop, part in zip(m.loops, parts, strict=True) if part.any()))


def _keep_kinematics(m: Mechanism) -> Mechanism:
    """Return a robot in doubles with what its loops depend on.

    Symbols raise an error. So inertias may be symbols, and robots that differ in them share what is cached by robot.
    """
    B, X, G, g = (x.astype(float) for x in (m.B, m.X, m.G, m.g))
    loops, closure = convert_loops(m.loops, m.closure, lambda x: x.astype(float))
    M, gravity = np.zeros((m.nb, 6, 6)), np.zeros(3)
    return replace(
        m, B=B, X=X, G=G, g=g, M=M, gravity=gravity, loops=loops, closure=closure, frames=(), elasticity=None
    )


@lru_cache(maxsize=64)
def without_ratios(m: Mechanism) -> Mechanism:
    """Return a closed robot whose constraints are solved for all dependent coordinates."""
    if m.closure is None or not m.closure.ratios.places:
        return m
    return replace(m, closure=replace(m.closure, ratios=NO_RATIOS))
