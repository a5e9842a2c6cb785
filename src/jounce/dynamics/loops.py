"""Closed loops: the motion of the tree that is left where they are cut, and quantities in independent coordinates.

Constraints A q' = 0 hold along every motion of the closed robot, q the coordinates of the tree. With independent ones u
and dependent ones d, q' = F u' with F = [1; -A_d^-1 A_u]. The principle of virtual work makes quantities of the closed
robot of those of the tree: forces F^T Q, matrices F^T M F, Jacobians J F. Forces take no F: F^T Q = Q_u - A_u^T y with
A_d^T y = Q_d, where the y are what the cut joints exert.

Followers by ratios, d = F_d u + offset, and by polynomials, count as independent where constraints are solved: with
x_d = F_d u' where velocities are, and F_d^T Q_d added to Q_u where forces are; F_d of polynomials varies with u. Loops
that nothing else moves then need no solution.

How often what runs: a `ClosedMotion` is made once per evaluation of a law; it factors A_d once, for all orders, all
velocities and all forces.
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
    """Return the closure of a mechanism that has one."""
    assert m.closure is not None, m.name
    return m.closure


@dataclass(frozen=True, eq=False)
class ClosedMotion:
    """The motion of the tree of a closed robot.

    It follows from that of the independent coordinates. Velocities of a base that floats come first; no loop acts on
    them.
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
        """The places of independent, follower and solved velocities.

        Independent ones include those of the base.
        """
        c, first = closure_of(self.m), self._first
        groups = (c.independent, c.ratios.places, c.solved)
        independent, followers, solved = ([first + j for j in group] for group in groups)
        return [*range(first), *independent], followers, solved

    def _in_tree_order(self, independent: Array, followers: Array, solved: Array) -> Array:
        """Return all velocities in the order of the tree.

        They come from the independent ones, those of followers, and the solved ones.
        """
        parts = concatenate([independent, followers, solved], axis=-2)
        return parts[..., np.argsort([*self._places[0], *self._places[1], *self._places[2]]), :]

    @cached_property
    def q(self) -> Series:
        """The coordinates of the tree, (..., N, 1)."""
        # No loop acts on the base: zeros in the place of its velocities make room, and are dropped again.
        rates = self.velocities(self.u.dot.map(self._pad_base)).map(self._drop_base)
        return Series(lambda k: rates[k - 1] if k else self.position)

    def _pad_base(self, x: Array) -> Array:
        """Put rows of zeros for the base above the rows of joints."""
        return concatenate([_zero_rows(self._first, x), x], axis=-2)

    def _drop_base(self, x: Array) -> Array:
        """Return the rows of joints, without those of the base."""
        return x[..., self._first :, :]

    @cached_property
    def F(self) -> Series:
        """F, (..., nv of the tree, nv), with q' = F u'."""
        # The columns of F are the velocities of the tree where one independent velocity is 1. A is used as a matrix
        # here, since `constrain` of many columns takes more operations.
        return self._follow(Series.constant(np.eye(self.m.nv, dtype=int)), lambda x: self.ends.A @ x)

    @cached_property
    def ends(self) -> LoopEnds:
        """The motion of the ends of loops in which constraints are solved."""
        return LoopEnds(with_solved_loops(self.m), self.q)

    @cached_property
    def _factors(self) -> OrthogonalFactors:
        """The factors of A_d."""
        solved = list(closure_of(self.m).solved)
        return OrthogonalFactors.of(self.ends.A[0][..., solved], constraint_pattern(self.ends.m)[:, solved])

    def velocities(self, independent: Series) -> Series:
        """Return the velocities of the tree from the independent ones.

        They are x, (..., nv, k). Dependent ones d obey A_d d = -A_u x_u. Their rates follow one after the other, with d
        = 0 in ``A_d[0] d[k] = -(A x)[k]``: no rate of A is needed.
        """
        return self._follow(independent, lambda x: self.ends.constrain(x))

    def _follow(self, independent: Series, constrain: Callable[[Series], Series]) -> Series:
        """Return the same where constrain(x) = A x."""
        known_terms: list[Array] = []
        _, follower_places, solved_places = self._places
        followers = closure_of(self.m).ratios.velocities(self.u, independent.map(self._drop_base))

        def term(k: int) -> Array:
            x_u = independent[k]
            x_f = followers[k] if len(follower_places) > 0 else _zero_rows(0, x_u)
            x_k = self._in_tree_order(x_u, x_f, _zero_rows(len(solved_places), x_u))
            if len(solved_places) > 0:
                # (A x)[k] with the lower rates of d as they are and d[k] = 0 lacks A_d[0] d[k] alone.
                x = Series.of([*known_terms, x_k]).map(self._drop_base)
                x_k = self._in_tree_order(x_u, x_f, -self._factors.solve(constrain(x)[k]))
            known_terms.append(x_k)
            return x_k

        return Series(term)

    def multipliers(self, Q: Series) -> Series:
        """Return y of A_d^T y = Q_d.

        Cut joints exert y against forces Q, (..., nv, k).
        """
        return self._balance(Q, lambda Q_d: self._factors.solve_transposed(Q_d), lambda y: y)

    def shortest_multipliers(self, Q: Series) -> Series:
        """Return the shortest y where constraints are redundant: y = A_d z of A_d^T A_d z = Q_d."""

        def constrain(z: Series) -> Series:
            # A_d z: velocities z of the solved coordinates, all others at rest.
            independent, followers = len(self._places[0]), len(self._places[1])
            return self.ends.constrain(
                z.map(
                    lambda z: self._drop_base(
                        self._in_tree_order(_zero_rows(independent, z), _zero_rows(followers, z), z)
                    )
                )
            )

        # A_d^T A_d = R^T Q^T Q R: first y of A_d^T y = Q_d, then z of A_d z = y.
        return constrain(
            self._balance(Q, lambda Q_d: self._factors.solve(self._factors.solve_transposed(Q_d)), constrain)
        )

    def _balance(self, Q: Series, solve: Callable[[Array], Array], exert: Callable[[Series], Series]) -> Series:
        """Return z for which y = exert(z) obeys A_d^T y = Q_d.

        Its rates follow one after the other, by the same factors.
        """
        known_terms: list[Array] = []

        def term(k: int) -> Array:
            rest = self.dependent(Q)[k]
            if k > 0:
                # (A_d^T y)[k] with the lower rates of z as they are and z[k] = 0 lacks A_d[0]^T exert(z[k]) alone.
                y = exert(Series.of([*known_terms, zeros_like(known_terms[0])]))
                rest = rest - self.dependent(self._exerted(y))[k]
            known_terms.append(solve(rest))
            return known_terms[-1]

        return Series(term)

    def dependent(self, Q: Series) -> Series:
        """Return the rows of the velocities that constraints are solved for."""
        return Q.map(lambda Q: Q[..., self._places[2], :])

    def _exerted(self, y: Series) -> Series:
        """Return A^T y, (..., nv, k)."""
        return self.ends.forces(y).map(self._pad_base)

    def pull(self, Q: Series) -> Series:
        """Return F^T Q = Q_u - A_u^T y of forces on the tree.

        The shape is (..., nv, k).
        """
        if len(self._places[2]) > 0:
            Q = Q - self._exerted(self.multipliers(Q))
        independent, followers, _ = self._places
        of_independent = Q.map(lambda Q: Q[..., independent, :])
        if len(followers) == 0:
            return of_independent
        # Those of followers act on the independent coordinates too, by F_d^T Q_d, and not on the base.
        pulled = closure_of(self.m).ratios.forces(self.u, Q.map(lambda Q: Q[..., followers, :]))

        def term(k: int) -> Array:
            base, joints = of_independent[k][..., : self._first, :], of_independent[k][..., self._first :, :]
            return concatenate([base, joints + pulled[k]], axis=-2)

        return Series(term)

    def follower_curvature(self, Q: Series) -> Series:
        """Return d(F_d^T Q_d)/dq on the tree, of forces Q (..., nv, 1) as they are.

        The shape is (..., N, N). It vanishes where followers have constant ratios.
        """
        closure = closure_of(self.m)
        of_followers = Q.map(lambda Q: Q[..., self._places[1], :])
        diagonal = closure.ratios.curvature(self.u, of_followers)
        columns = np.eye(len(closure.coordinates), dtype=int)[:, list(closure.independent)]
        return columns * diagonal.mT @ columns.T


def _zero_rows(count: int, like: Array) -> Array:
    """Return rows of zeros with as many columns as another array."""
    return np.zeros((count, like.shape[-1]), dtype=int)


def close_law(tree_law: Law, shape: Sequence[int | str], of_turning: Law | None) -> Law:
    """Return the law of a closed robot from that of its tree.

    Axes of velocities become those of independent ones: rows by F^T, columns by F. C and Cbar go with M, which is
    symmetric: as F varies, (F u')' = F u'' + F' u', F^T M F' is added. `of_turning` is the law of M then.
    """
    rows, columns = "nv" in shape[-2:-1] or shape == ("nv",), "nv" in shape[-1:] and len(shape) > 1

    # Runs once per evaluation, or once where native code is recorded.
    def closed(m: Mechanism, x: State) -> Series:
        if not m.is_closed:
            return tree_law(m, x)
        motion = closed_motion(m, x)
        on_tree = replace(x, q=motion.q, position=None)
        X = tree_law(m.tree, on_tree)
        if columns:
            # Quantities of all bodies have a further axis, before the matrix.
            of_all_bodies = "nb" in shape and x.body is None
            X = X @ (motion.F.map(lambda F: F[..., None, :, :]) if of_all_bodies else motion.F)
        if of_turning is not None:
            X = X + of_turning(m.tree, on_tree) @ motion.F.dot
        # Forces take no F: (..., nv) -> (..., nv, 1) for their multipliers, and back.
        if len(shape) == 1 and rows:
            return motion.pull(X.map(lambda Q: Q[..., None])).map(lambda Q: Q[..., 0])
        # Without F' the matrix is M, whose symmetry rounding must not break.
        if rows and columns:
            X = motion.F.mT @ X
            return X if of_turning is not None else X.map(mirror_triangle)
        return motion.pull(X) if rows else X

    return closed


def tree_motion(m: Mechanism, x: State) -> Series:
    """Return the coordinates of the tree with rates, in a state.

    They are (..., N, 1).
    """
    return closed_motion(m, x).q if m.is_closed else x.q


def closed_motion(m: Mechanism, x: State) -> ClosedMotion:
    """Return the motion of a closed robot's tree in a state."""
    c, position = closure_of(m), x.position
    # Without coordinates of the tree in the state, all dependent ones follow by constant ratios.
    if position is None:
        u = x.q[0][..., 0]
        position = all_coordinates(c, u, c.ratios.positions(u))[..., None]
    return ClosedMotion(m, x.q, position)


def actuator_forces(m: Mechanism, F: Series, Q: Series) -> Series:
    """Return the motor forces u with F_u^T u = Q, least u^T W u.

    u is (..., motors, 1). ``u = W^-1 F_u (F_u^T W^-1 F_u)^-1 Q``. F_u are the rows of F, the velocities of all
    coordinates, that belong to the actuated joints; W are their weights. Columns of F_u and rows of Q are those of
    coordinates that motors move. Below them stand Q_p - F_p^T u with the columns and rows of passive coordinates: what
    these lack.
    """
    closure, first = closure_of(m), m.nv - m.n

    # Columns of F count the base's velocities first; rows of Q are those of coordinates alone.
    def select(coordinates: Sequence[int]) -> tuple[Series, Series]:
        rows, columns = [first + j for j in closure.actuated], [first + k for k in coordinates]
        return F.map(lambda F: F[..., rows, :][..., columns]), Q.map(lambda Q: Q[..., coordinates, :])

    F_u, Q_u = select(closure.driven)
    weighted = reciprocal(closure.weights)[:, None] * F_u
    u = weighted @ solve_series(F_u.mT @ weighted, Q_u)
    if len(closure.passive) == 0:
        return u
    # The motors act on passive coordinates too, by F_p^T u.
    F_p, Q_p = select(closure.passive)
    return join_series([u, Q_p - F_p.mT @ u], axis=-2)


def movers(m: Mechanism) -> dict[str, str]:
    """Return what moves each coordinate of a closed robot: "motors", a "spring" or "nothing"."""
    causes = dict.fromkeys(m.coordinates, "motors")
    for k in closure_of(m).passive:
        has_spring = (m.drives.stiffness * m.G[:, k]).any()
        causes[m.coordinates[k]] = "spring" if has_spring else "nothing"
    return causes


def loop_wrenches(m: Mechanism, motion: ClosedMotion, Q: Series) -> Series:
    """Return the wrenches of cut joints where forces Q act.

    They are R^T y, (..., loops, 6); Q acts on the tree. R are the rows of constraints of a cut joint. A^T y = Q - S u,
    where the motors exert u, and what passive coordinates lack. The y are the shortest of A_d^T y = (Q - S u)_d; where
    constraints are redundant, others would serve.
    """
    # S puts the forces of motors and passive coordinates in their places on the tree: what is left of Q, cut joints
    # transmit.
    S = np.eye(m.nv - m.n + m.tree.n, dtype=int)[:, [m.nv - m.n + j for j in closure_of(m).force_places]]
    Q = Q - S @ actuator_forces(m, motion.F, motion.pull(Q).map(lambda Q: Q[..., m.nv - m.n :, :]))
    ends = np.cumsum([len(loop.rows) for loop in m.loops])[:-1]

    # (..., c, 1) -> (..., loops, 6): the rows of each loop make its wrench.
    def wrenches(y: Array) -> Array:
        parts = zip(m.loops, np.split(np.arange(y.shape[-2]), ends), strict=True)
        return concatenate([(loop.rows.T @ y[..., places, :]).mT for loop, places in parts], axis=-2)

    # Loops whose followers have constant ratios transmit forces too: here constraints are solved for all of them.
    full = replace(motion, m=without_ratios(m))
    return full.shortest_multipliers(Q).map(wrenches)
