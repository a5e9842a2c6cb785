"""Closed loops: the motion of the tree that is left where they are cut, and quantities in independent coordinates.

Constraints A q' = 0 hold along every motion of the closed robot, q the coordinates of the tree. With independent ones u
and dependent ones d, q' = F u' with F = [1; -A_d^-1 A_u]. The principle of virtual work makes quantities of the closed
robot of those of the tree: forces F^T Q, matrices F^T M F, Jacobians J F. Forces take no F: F^T Q = Q_u - A_u^T y with
A_d^T y = Q_d, where the y are what the cut joints exert.

Followers with constant ratios, d = F_d u + offset, count as independent where constraints are solved: with x_d = F_d u'
where velocities are, and F_d^T Q_d added to Q_u where forces are. Loops that nothing else moves then need no solution.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from jounce.core.scalars import Array, concatenate, reciprocal, zeros_like
from jounce.dynamics.loop_branches import LoopEnds, constraint_pattern, with_solved_loops, without_ratios
from jounce.dynamics.state import Law, State
from jounce.model.loops import Closure, all_coordinates
from jounce.model.mechanism import Mechanism
from jounce.spatial.linear import OrthogonalFactors, mirror_triangle, solve_series
from jounce.spatial.series import Series, join_series


def closure_of(m: Mechanism) -> Closure:
    """The closure of a mechanism that has one."""
    assert m.closure is not None, m.name
    return m.closure


@dataclass(frozen=True, eq=False)
class ClosedMotion:
    """The motion of the tree of a closed robot, from that of the independent coordinates.

    Velocities of a base that floats come first; no loop acts on them.
    """

    m: Mechanism
    u: Series  # (..., n, 1) the independent coordinates
    position: Array  # (..., N, 1) the coordinates of the tree, with loops closed

    @property
    def _first(self) -> int:
        """The number of velocities of the base."""
        return self.m.nv - self.m.n

    @cached_property
    def _places(self) -> tuple[list[int], list[int], list[int]]:
        """The places of independent velocities, the base's among them, of followers, and of those solved for."""
        c, first = closure_of(self.m), self._first
        groups = (c.independent, c.ratios.places, c.solved)
        own, following, solved = ([first + j for j in group] for group in groups)
        return [*range(first), *own], following, solved

    def _whole(self, own: Array, solved: Array) -> Array:
        """Velocities in the order of the tree from the independent ones and those solved for."""
        following = closure_of(self.m).ratios.F @ own[..., self._first :, :] if self._places[1] else _zero_rows(0, own)
        parts = concatenate([own, following, solved], axis=-2)
        return parts[..., np.argsort([*self._places[0], *self._places[1], *self._places[2]]), :]

    @cached_property
    def q(self) -> Series:
        """The coordinates of the tree, (..., N, 1)."""
        rates = self.velocities(self.u.dot.map(self._behind_base)).map(self._of_joints)
        return Series(lambda k: rates[k - 1] if k else self.position)

    def _behind_base(self, x: Array) -> Array:
        """Rows of joints below those of the base, which are zero."""
        return concatenate([_zero_rows(self._first, x), x], axis=-2)

    def _of_joints(self, x: Array) -> Array:
        """The rows of the velocities of joints."""
        return x[..., self._first :, :]

    @cached_property
    def F(self) -> Series:
        """The velocities of the tree from the independent ones."""
        return self._follow(Series.constant(np.eye(self.m.nv, dtype=int)), lambda x: self.ends.A @ x)

    @cached_property
    def ends(self) -> LoopEnds:
        """The motion of the ends of loops in which constraints are solved."""
        return LoopEnds(with_solved_loops(self.m), self.q)

    @cached_property
    def _factors(self) -> OrthogonalFactors:
        """Those of A_d."""
        solved = list(closure_of(self.m).solved)
        return OrthogonalFactors.of(self.ends.A[0][..., solved], constraint_pattern(self.ends.m)[:, solved])

    def velocities(self, own: Series) -> Series:
        """The velocities x of the tree, (..., k), from the independent ones: dependent ones d obey A_d d = -A_u x_u.

        Their rates follow one after the other, with d = 0 in ``A_d[0] d[k] = -(A x)[k]``: no rate of A is needed.
        """
        return self._follow(own, lambda x: self.ends.held(x))

    def _follow(self, own: Series, held: Callable[[Series], Series]) -> Series:
        """The same, with held(x) = A x."""
        known: list[Array] = []

        def term(k: int) -> Array:
            found = self._whole(own[k], _zero_rows(len(self._places[2]), own[k]))
            if self._places[2]:
                x = Series.of([*known, found]).map(self._of_joints)
                found = self._whole(own[k], -self._factors.solve(held(x)[k]))
            known.append(found)
            return found

        return Series(term)

    def multipliers(self, Q: Series) -> Series:
        """y of A_d^T y = Q_d: what the cut joints exert where forces Q, (..., nv, k), act on the tree."""
        return self._balance(Q, lambda rest: self._factors.solve_transposed(rest), lambda y: y)

    def shortest_multipliers(self, Q: Series) -> Series:
        """The shortest y where constraints are redundant: y = A_d z of A_d^T A_d z = Q_d."""

        def along(z: Series) -> Series:
            independent = len(self._places[0])
            return self.ends.held(z.map(lambda z: self._of_joints(self._whole(_zero_rows(independent, z), z))))

        return along(self._balance(Q, lambda x: self._factors.solve(self._factors.solve_transposed(x)), along))

    def _balance(self, Q: Series, solve: Callable[[Array], Array], exert: Callable[[Series], Series]) -> Series:
        """z for which y = exert(z) obeys A_d^T y = Q_d: its rates follow one after the other, by the same factors."""
        known: list[Array] = []

        def term(k: int) -> Array:
            rest = self.dependent(Q)[k]
            if k:
                y = exert(Series.of([*known, zeros_like(known[0])]))
                rest = rest - self.dependent(self._exerted(y))[k]
            known.append(solve(rest))
            return known[-1]

        return Series(term)

    def dependent(self, Q: Series) -> Series:
        """The rows of the velocities that constraints are solved for."""
        return Q.map(lambda Q: Q[..., self._places[2], :])

    def _exerted(self, y: Series) -> Series:
        """A^T y, (..., nv, k)."""
        return self.ends.forces(y).map(self._behind_base)

    def pull(self, Q: Series) -> Series:
        """F^T Q = Q_u - A_u^T y: forces on the tree as those on the independent coordinates, (..., nv, k)."""
        return (Q - self._exerted(self.multipliers(Q)) if self._places[2] else Q).map(self._independent)

    def _independent(self, Q: Array) -> Array:
        """The rows of the independent velocities, with the forces on followers."""
        own, following, _ = (Q[..., places, :] for places in self._places)
        if not self._places[1]:
            return own
        pulled = closure_of(self.m).ratios.F.mT @ following
        return concatenate([own[..., : self._first, :], own[..., self._first :, :] + pulled], axis=-2)


def _zero_rows(count: int, like: Array) -> Array:
    """Rows of zeros, as many columns as another array has."""
    return np.zeros((count, like.shape[-1]), dtype=int)


def close_law(tree_law: Law, shape: Sequence[int | str], of_turning: Law | None) -> Law:
    """The law of a robot from that of its tree; where loops are closed, axes of velocities become independent ones.

    C and Cbar go with M, which is symmetric: as F varies, (F u')' = F u'' + F' u', F^T M F' is added. `of_turning` is
    the law of M then.
    """
    rows, columns = "nv" in shape[-2:-1] or shape == ("nv",), "nv" in shape[-1:] and len(shape) > 1

    def closed(m: Mechanism, x: State) -> Series:
        if not m.is_closed:
            return tree_law(m, x)
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
        if rows and columns:
            X = motion.F.mT @ X
            return X if of_turning else X.map(mirror_triangle)
        return motion.pull(X) if rows else X

    return closed


def tree_motion(m: Mechanism, x: State) -> Series:
    """The coordinates (..., N, 1) of the tree, and their rates, in a state."""
    return closed_motion(m, x).q if m.is_closed else x.q


def closed_motion(m: Mechanism, x: State) -> ClosedMotion:
    """The motion of the tree of a closed robot in a state."""
    c, position = closure_of(m), x.position
    if position is None:  # all others follow by constant ratios
        u = x.q[0][..., 0]
        position = all_coordinates(c, u, c.ratios.positions(u))[..., None]
    return ClosedMotion(m, x.q, position)


def actuator_forces(m: Mechanism, F: Series, Q: Series) -> Series:
    """u = W^-1 F_u (F_u^T W^-1 F_u)^-1 Q, (..., motors, 1): the forces with F_u^T u = Q of which u^T W u is least.

    F_u are the rows of F, the velocities of all coordinates, that belong to the actuated joints; W are their weights.
    Columns of F_u and rows of Q are those of coordinates that motors move. Below them stand Q_p - F_p^T u with the
    columns and rows of passive coordinates: what these lack.
    """
    closure, first = closure_of(m), m.nv - m.n

    def select(columns: Sequence[int]) -> tuple[Series, Series]:
        rows, those = [first + j for j in closure.actuated], [first + k for k in columns]
        return F.map(lambda F: F[..., rows, :][..., those]), Q.map(lambda Q: Q[..., columns, :])

    F_u, driven = select(closure.driven)
    weighted = reciprocal(closure.weights)[:, None] * F_u
    u = weighted @ solve_series(F_u.mT @ weighted, driven)
    if not closure.passive:
        return u
    F_p, Q_p = select(closure.passive)
    return join_series([u, Q_p - F_p.mT @ u], axis=-2)


def movers(m: Mechanism) -> dict[str, str]:
    """What moves each coordinate of a closed robot: "motors", a "spring", or "nothing" where it is passive."""
    sprung = {k: (m.drives.stiffness * m.G[:, k]).any() for k in closure_of(m).passive}
    return {x: {None: "motors", True: "spring", False: "nothing"}[sprung.get(k)] for k, x in enumerate(m.coordinates)}


def loop_wrenches(m: Mechanism, motion: ClosedMotion, Q: Series) -> Series:
    """R^T y, (..., loops, 6), of forces Q on the tree: the wrenches of cut joints with rows R of constraints.

    A^T y = Q - S u, where the motors exert u, and what passive coordinates lack. The y are the shortest of A_d^T y =
    (Q - S u)_d; where constraints are redundant, others would serve.
    """
    S = np.eye(m.nv - m.n + m.tree.n, dtype=int)[:, [m.nv - m.n + j for j in closure_of(m).force_places]]
    Q = Q - S @ actuator_forces(m, motion.F, motion.pull(Q).map(lambda Q: Q[..., m.nv - m.n :, :]))
    ends = np.cumsum([len(loop.rows) for loop in m.loops])[:-1]

    def wrenches(y: Array) -> Array:
        parts = zip(m.loops, np.split(np.arange(y.shape[-2]), ends), strict=True)
        return concatenate([(loop.rows.T @ y[..., places, :]).mT for loop, places in parts], axis=-2)

    full = replace(motion, m=without_ratios(m))
    return full.shortest_multipliers(Q).map(wrenches)
