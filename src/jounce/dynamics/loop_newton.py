"""Newton's method for the dependent coordinates of closed robots: one step, over any scalar type.

Problem: the gaps r of the loops, as many numbers as the cut joints hold, are to be zero. Rows may be redundant.

Algorithm: with constraints A, the derivatives of the gaps, and a change h of the independent coordinates, the step of
the dependent ones is ``A_d step = -(r + A_u h)``: a correction where h = 0, else a prediction along the tangent. A_d is
taken as Q R by modified Gram-Schmidt (Golub, Van Loan, Matrix Computations, 5.2), which needs no pivots and can be
traced. Followers with constant ratios are set to their places, and count as independent then.

Invariants: lengths are divided by the size of the robot, so that gaps, A_d and its condition have no units.

Failure: it reports none. The measures of a step hold what a caller judges by, the squares of the gap before it and of
an estimate of the condition number, |A_d| times |Q^-1| without the factor R: large, infinite or NaN where constraints
are lost.
"""

from collections.abc import Callable
from typing import TypeAlias

import numpy as np

from jounce.core.scalars import Array, concatenate
from jounce.dynamics.loop_branches import LoopEnds, constraint_pattern, scales, with_solved_loops
from jounce.dynamics.loops import closure_of
from jounce.model.loops import Loop
from jounce.model.mechanism import Mechanism
from jounce.spatial.lie import axial, hat, position, rotation
from jounce.spatial.linear import OrthogonalFactors
from jounce.spatial.series import column_series

STEP_MEASURES = 2  # of a step: squares of the gap before it, and of an estimate of the condition number
CLOSED_GAP = 1e-13  # without unit, see `Scales`: where loops are closed, rounding leaves less than 500 eps
MAX_DIRECT_CORRECTION = 0.5  # rad or sizes of the robot: up to it Newton's method needs no continuation
NewtonStep: TypeAlias = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray]]


def gaps(m: Mechanism, q: Array) -> tuple[Array, Array]:
    """How far loops are from closed (..., c, 1), and the constraints A (..., c, N), at coordinates (..., N)."""
    ends = LoopEnds(m, column_series([q]))
    found = [_gap(loop, C) for loop, C in zip(m.loops, ends.poses, strict=True)]
    return concatenate(found, axis=-2), ends.A[0]


def _gap(loop: Loop, C: Array) -> Array:
    """The turns, 2 tan(phi / 2) about their axes, and the slides that a cut joint would have to allow, (..., k, 1)."""
    turns, slides = loop.held
    R, axis = rotation(C), np.asarray(loop.axis)[:, None]
    if len(turns) == 3:
        rest, sine = 1 + (R * np.eye(3, dtype=int)).sum(axis=(-2, -1), keepdims=True), axial(R)[..., None]
    else:
        turned = R @ axis
        rest, sine = 1 + axis.mT @ turned, hat(axis[:, 0]) @ turned
    return concatenate([turns @ (2 * sine / rest), slides @ position(C)], axis=-2)


def newton_step(m: Mechanism, q: Array, change: Array) -> tuple[Array, Array, Array]:
    """Return the dependent coordinates (..., N - n) after a step from q (..., N), its `STEP_MEASURES`, and A_d at q.

    `change`, (..., n), is that of the independent coordinates; A_d has no units, and a column for each coordinate that
    constraints are solved for.
    """
    m = with_solved_loops(m)
    c = closure_of(m)
    own, others, following = list(c.independent), list(c.solved), q[..., []]
    if not others:  # there may be no loop left, nor a scale
        return c.ratios.positions(q[..., own] + change), np.array([0.0, 1.0]), np.zeros((0, 0))
    # followers: they go to their places, and their changes count as those of independent coordinates
    if c.ratios.places:
        following = c.ratios.positions(q[..., own] + change)
        change = concatenate([change, following - q[..., list(c.ratios.places)]], axis=-1)
        own += c.ratios.places
    # linearize, without units
    s = scales(m)
    gap, A = gaps(m, q)
    gap, A = s.rows[:, None] * gap, s.rows[:, None] * A * s.coordinates
    A_d = A[..., others]
    # solve: A_d step = -(r + A_u h)
    factors = OrthogonalFactors.of(A_d, constraint_pattern(m)[:, others])
    moved = factors.solve(-(gap + A[..., own] @ (change / s.coordinates[own])[..., None]))
    # measure: squares of Frobenius norms
    measures = concatenate([_square(gap), _square(concatenate(factors.inverse_Q, axis=-2)) * _square(A_d)], axis=-1)
    found = concatenate([following, q[..., others] + s.coordinates[others] * moved[..., 0]], axis=-1)
    return found[..., np.argsort([*c.ratios.places, *others])], measures, A_d


def _square(x: Array) -> Array:
    """The sum of the squares of a matrix, (..., 1)."""
    return (x * x).sum(axis=(-2, -1), keepdims=True)[..., 0]


def numpy_step(m: Mechanism) -> NewtonStep:
    """The step of a robot, by NumPy."""

    def of_arrays(q: np.ndarray, change: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        with np.errstate(all="ignore"):  # where constraints are lost, and far away
            found, *others = newton_step(m, q, change)
        measures, A = (np.broadcast_to(x, (*q.shape[:-1], *x.shape[-k:])) for k, x in enumerate(others, start=1))
        return found, measures, A.astype(float)  # the same everywhere if constraints are constant

    return of_arrays
