"""Closed loops: the motion of the tree that is left where they are cut, and quantities in independent coordinates.

Constraints A q' = 0 hold along every motion of the closed robot, q the coordinates of the tree. With independent ones u
and dependent ones d, q' = F u' with F = [1; -A_d^-1 A_u]. The principle of virtual work makes quantities of the closed
robot of those of the tree: forces F^T Q, matrices F^T M F, Jacobians J F. Forces take no F: F^T Q = Q_u - A_u^T y with
A_d^T y = Q_d, where the y are what the cut joints exert.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from jounce._scalars import Array, concatenate, reciprocal
from jounce.model.coordinates import joint_variables
from jounce.model.loops import Closure
from jounce.model.mechanism import Mechanism, path_to
from jounce.spatial.lie import Ad, ad, exp, inverse
from jounce.spatial.linear import OrthogonalFactors, solved
from jounce.spatial.series import Series, from_rate, joined

if TYPE_CHECKING:
    from jounce.dynamics.quantities import Law, State


def closure_of(m: Mechanism) -> Closure:
    """The closure of a mechanism that has one."""
    assert m.closure is not None, m.name
    return m.closure


class View:
    """The bodies of a tree as one of them sees them: poses, and screws and twists with their rates."""

    def __init__(self, tree: Mechanism, theta: Series, origin: int) -> None:
        self.tree, self.theta = tree, theta
        self.poses: dict[int, Array] = {origin: np.eye(4, dtype=int)}
        self.screws: dict[int, Series] = {}
        self._twists = {origin: Series.constant(np.zeros((6, 1), dtype=int))}
        for i in reversed(path_to(tree, origin)):
            self._pass(i, i, tree.parent[i])

    def _pass(self, joint: int, known: int, found: int) -> None:
        """Go from one of the bodies that a joint joins to the other: outward, or inward."""
        tree = self.tree
        theta = self.theta.map(lambda x: x[..., joint : joint + 1, :])
        moved = tree.B[joint] @ exp(tree.X[joint], theta[0])
        inward = joint == known
        self.poses[found] = self.poses[known] @ (inverse(moved) if inward else moved)
        at_rest, twist = Ad(self.poses[joint]) @ tree.X[joint, :, None], self._twists[known]
        ads = twist.map(lambda V: ad(V[..., 0]))
        screw = self.screws[joint] = from_rate(at_rest, lambda S: ads @ S)
        moving = screw @ theta.dot
        self._twists[found] = twist - moving if inward else twist + moving

    def reach(self, body: int) -> None:
        """Find the pose of a body, and the screws of the joints on the way there."""
        for i in path_to(self.tree, body):
            if i not in self.poses:
                self._pass(i, self.tree.parent[i], i)


def views(m: Mechanism, q: Series) -> dict[int, View]:
    """What the bodies of the first frames of loops see of those of the second, at coordinates q of the tree."""
    theta, loops = joint_variables(m.tree, q), m.loops
    found = {body: View(m.tree, theta, body) for body in dict.fromkeys(loop.a.body for loop in loops)}
    for loop in loops:
        found[loop.a.body].reach(loop.b.body)
    return found


def constraints(m: Mechanism, seen: Mapping[int, View]) -> Series:
    """A, (..., c, N), of what bodies see: A q' are the relative twists that cut joints do not allow."""
    tree, closure = m.tree, closure_of(m)
    blocks = []
    for loop in m.loops:
        screws, rows = seen[loop.a.body].screws, loop.rows @ Ad(inverse(loop.a.T))
        inward, outward = path_to(tree, loop.a.body), path_to(tree, loop.b.body)
        signs = [(i in outward) - (i in inward) for i in range(tree.nb)]
        still = Series.constant(np.zeros((len(rows), 1), dtype=int))
        columns = [sign * rows @ screws[i] if sign else still for i, sign in enumerate(signs)]
        blocks.append(joined(columns, axis=-1) @ closure.G)
    return joined(blocks, axis=-2)


@dataclass(frozen=True, eq=False)
class ClosedMotion:
    """The motion of the tree of a closed robot, from that of the independent coordinates.

    Velocities of a base that floats come first; no loop acts on them.
    """

    m: Mechanism
    u: Series  # (..., n, 1) the independent coordinates
    position: Array  # (..., N, 1) the coordinates of the tree, with loops closed

    @cached_property
    def _places(self) -> tuple[list[int], list[int]]:
        """The places of the independent velocities, those of the base among them, and of the dependent ones."""
        closure, first = closure_of(self.m), self._first
        return [*range(first), *(first + j for j in closure.independent)], [first + j for j in closure.dependent]

    @property
    def _first(self) -> int:
        """The number of velocities of the base."""
        return self.m.nv - self.m.n

    def _in_order(self, own: Series, others: Series) -> Series:
        """Rows of the independent velocities and of the dependent ones in the order of the tree."""
        order = np.argsort(np.concatenate(self._places))
        return joined([own, others], axis=-2).map(lambda x: x[..., order, :])

    @cached_property
    def q(self) -> Series:
        """The coordinates of the tree, (..., N, 1)."""
        return Series(lambda k: self._all_rates[k - 1] if k else self.position)

    @cached_property
    def _all_rates(self) -> Series:
        """The velocities of the coordinates of the tree; those of the dependent ones d' obey A_d d' = -A_u u'."""
        A_u = self.A_u.map(lambda A: A[..., self._first :])
        d = solved(self.A_d, -(A_u @ self.u.dot), lambda b: self._factors.solve(b))
        still = Series.constant(np.zeros((self._first, 1), dtype=int))
        rates = self._in_order(joined([still, self.u.dot], axis=-2), d)
        return rates.map(lambda x: x[..., self._first :, :])

    @cached_property
    def A_u(self) -> Series:
        """The constraints of the independent velocities."""
        return self._A.map(lambda A: A[..., self._places[0]])

    @cached_property
    def A_d(self) -> Series:
        """The constraints of the dependent velocities."""
        return self._A.map(lambda A: A[..., self._places[1]])

    @cached_property
    def _A(self) -> Series:
        still = Series.constant(np.zeros((1, self._first), dtype=int))
        return joined([still, constraints(self.m, views(self.m, self.q))], axis=-1)

    @cached_property
    def _factors(self) -> OrthogonalFactors:
        return OrthogonalFactors.of(self.A_d[0])

    @cached_property
    def F(self) -> Series:
        """The velocities of the tree from the independent ones."""
        own = Series.constant(np.eye(self.m.nv, dtype=int))
        return self._in_order(own, solved(self.A_d, -self.A_u, lambda b: self._factors.solve(b)))

    def multipliers(self, Q: Series) -> Series:
        """y of A_d^T y = Q_d: what the cut joints exert where forces Q, (..., nv, k), act on the tree."""
        return solved(self.A_d.mT, self.dependent(Q), lambda b: self._factors.solve_transposed(b))

    def dependent(self, Q: Series) -> Series:
        """The rows of the dependent velocities."""
        return Q.map(lambda Q: Q[..., self._places[1], :])

    def pull(self, Q: Series) -> Series:
        """F^T Q = Q_u - A_u^T y: forces on the tree as those on the independent coordinates, (..., nv, k)."""
        return Q.map(lambda Q: Q[..., self._places[0], :]) - self.A_u.mT @ self.multipliers(Q)


def law(tree_law: "Law", shape: Sequence[int | str], of_turning: "Law | None") -> "Law":
    """The law of a closed robot from that of its tree: axes of velocities become those of the independent ones.

    C and Cbar go with M: as F varies, (F u')' = F u'' + F' u', F^T M F' is added. `of_turning` is the law of M then.
    """
    rows, columns = "nv" in shape[-2:-1] or shape == ("nv",), "nv" in shape[-1:] and len(shape) > 1

    def closed(m: Mechanism, x: "State") -> Series:
        motion = closed_motion(m, x)
        on_tree = replace(x, q=motion.q, position=None)
        X = tree_law(m.tree, on_tree)
        if columns:
            of_bodies = "nb" in shape and x.body is None  # a further axis, before the matrix
            X = X @ (motion.F.map(lambda F: F[..., None, :, :]) if of_bodies else motion.F)
        if of_turning:
            X = X + of_turning(m.tree, on_tree) @ motion.F.dot
        if len(shape) == 1 and rows:
            return motion.pull(X.map(lambda Q: Q[..., None])).map(lambda Q: Q[..., 0])
        if rows:
            return motion.F.mT @ X if columns else motion.pull(X)
        return X

    return closed


def closed_motion(m: Mechanism, x: "State") -> ClosedMotion:
    """The motion of the tree in a state."""
    assert x.position is not None, m.name
    return ClosedMotion(m, x.q, x.position)


def actuator_forces(m: Mechanism, F: Series, Q: Series) -> Series:
    """u = W^-1 F_u (F_u^T W^-1 F_u)^-1 Q, (..., motors, 1): the forces with F_u^T u = Q of which u^T W u is least.

    F_u are the rows of F, the velocities of all coordinates, that belong to the actuated joints; W are their weights.
    """
    closure, first = closure_of(m), m.nv - m.n
    F_u = F.map(lambda F: F[..., [first + j for j in closure.actuated], first:])
    weighted = reciprocal(closure.weights)[:, None] * F_u
    return weighted @ solved(F_u.mT @ weighted, Q)


def loop_wrenches(m: Mechanism, motion: ClosedMotion, Q: Series) -> Series:
    """R^T y, (..., loops, 6), of forces Q on the tree: the wrenches of cut joints with rows R of constraints.

    y = A_d (A_d^T A_d)^-1 Q_d is the shortest one; where constraints are redundant, others would serve.
    """
    y = motion.A_d @ solved(motion.A_d.mT @ motion.A_d, motion.dependent(Q))
    ends = np.cumsum([len(loop.rows) for loop in m.loops])[:-1]

    def wrenches(y: Array) -> Array:
        parts = zip(m.loops, np.split(np.arange(y.shape[-2]), ends), strict=True)
        return concatenate([(loop.rows.T @ y[..., places, :]).mT for loop, places in parts], axis=-2)

    return y.map(wrenches)
