"""Loops are assembled: Newton's method closes them, and singular values show which coordinates follow.

Problem: the gaps r of the loops, as many numbers as the cut joints hold, are to be zero. Rows may be redundant, and the
start of a robot may be far from closed, or singular.

One step, `newton_step`, over any scalar type, which native code and generated code record as well: with constraints A,
the derivatives of the gaps, and a change h of the independent coordinates, the step of the dependent ones is
``A_d step = -(r + A_u h)``: a correction where h = 0, else a prediction along the tangent. A_d is taken as Q R by
modified Gram-Schmidt (Golub, Van Loan, Matrix Computations, 5.2), which needs no pivots and can be traced. Followers
with constant ratios are set to their places, and count as independent then. It reports no failure: the measures of a
step hold what a caller judges by, the squares of the gap before it and of an estimate of the condition number, |A_d|
times |Q^-1| without the factor R: large, infinite or NaN where constraints are lost.

The first position, `assemble`, on numbers: Gauss-Newton steps of least length (Deuflhard, Newton Methods for Nonlinear
Problems, 2011, 4.4), that is, with the pseudo-inverse. The independent coordinates are held first; if the loops do not
close nearby, all coordinates move, at first by shorter steps. The best coordinates so far are kept; the iteration ends
where a step does not make the gaps smaller. Gaps stay above `CLOSED_GAP` where the start is too far away or the loops
cannot close; `assemble` raises `JounceError` then, `minimize_gaps` returns what is left of them.

Invariant: lengths are divided by the size of the robot, so that gaps, A_d and its condition have no units.
"""

from collections.abc import Callable, Sequence
from typing import TypeAlias

import numpy as np

from jounce.core.cures import Remedy
from jounce.core.errors import JounceError, join_names
from jounce.core.scalars import Array, concatenate
from jounce.dynamics.loop_branches import LoopEnds, Scales, constraint_pattern, scales, with_solved_loops
from jounce.dynamics.loops import closure_of
from jounce.model.loops import Loop
from jounce.model.mechanism import Mechanism
from jounce.spatial.lie import axial, hat, position, rotation
from jounce.spatial.linear import OrthogonalFactors
from jounce.spatial.series import column_series

NewtonStep: TypeAlias = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray]]
STEP_MEASURES = 2  # of a step: squares of the gap before it, and of an estimate of the condition number
CLOSED_GAP = 1e-13  # without unit, see `Scales`: where loops are closed, rounding leaves less than 500 eps
GAP_ROUNDING = 1e-16  # without unit: half an ulp of the robot's size, which no further step makes smaller
MAX_DIRECT_CORRECTION = 0.5  # rad or sizes of the robot: up to it Newton's method needs no continuation
CONSTRAINT_RANK_TOLERANCE = 1e-8  # of singular values, relative to the largest: sqrt(eps), well above their rounding
# Smallest over largest singular value of constraints, below which positions are lost: their error is eps over it, which
# at sqrt(eps) is no longer small against it.
MIN_INVERSE_CONDITION = 1e-7
MIN_SAMPLE_INVERSE_CONDITION = 1e-5  # the same of random samples that stand for all positions: well above the limit
MAX_ASSEMBLY_STEPS = 20  # Gauss-Newton, quadratic near the end: more do not help
OPEN_SHARE = 0.3  # of the largest gap: least squares share what two loops contradict, by the lengths of their levers
# Without unit: files state lengths in 5 to 7 digits, so that a loop that is open by less is closed as far as they say.
MAX_ROUNDED_GAP = 1e-5
HALF_TURN_GAP = 1e8  # 2 tan(phi / 2) where axes point in opposite directions, instead of infinity: a large turn is due


def loop_gaps(m: Mechanism, q: Array) -> tuple[Array, Array]:
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
    gap, A = loop_gaps(m, q)
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


# The same on numbers: gaps, constraints, and what their singular values say.
def gaps(m: Mechanism, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How far loops are from closed (k, c), and the constraints A (k, c, N), at coordinates (k, N) of the tree."""
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        gap, A = loop_gaps(m, q)
    known = np.isfinite(q).all(axis=-1)[:, None]
    opposite = known & ~(np.abs(gap[..., 0]) < HALF_TURN_GAP)
    return np.where(opposite, HALF_TURN_GAP, gap[..., 0]), A.astype(float)


def inverse_conditions(m: Mechanism, q: np.ndarray) -> np.ndarray:
    """1 / cond, (k,), of A_d at coordinates (k, N): zero where the dependent ones do not follow the others."""
    finite, found = np.isfinite(q).all(axis=1), np.full(len(q), np.nan)
    found[finite] = compute_inverse_conditions(solved_constraints(m, q[finite]))
    return found


def solved_constraints(m: Mechanism, q: np.ndarray) -> np.ndarray:
    """A_d, (k, c, d), at coordinates (k, N), of numbers without units."""
    solved, m = list(closure_of(m).solved), with_solved_loops(m)
    return scaled_constraints(m, q)[..., solved] if solved else np.zeros((len(q), 0, 0))


def compute_inverse_conditions(A: np.ndarray) -> np.ndarray:
    """1 / cond, (k,), of constraints (k, c, d): zero where there are fewer rows than columns."""
    if not A.shape[-1]:  # all others follow by constant ratios
        return np.ones(len(A))
    sizes = np.linalg.svd(A, compute_uv=False)
    return np.asarray(sizes[:, -1] / sizes[:, 0] if A.shape[-2] >= A.shape[-1] else np.zeros(len(A)))


def crosses_singularity(A: np.ndarray, B: np.ndarray) -> np.ndarray:
    """Whether a singular configuration lies between constraints (k, c, d): a determinant changes its sign."""
    return np.asarray(np.linalg.slogdet(A.mT @ B)[0] <= 0)


def scaled_constraints(m: Mechanism, q: np.ndarray) -> np.ndarray:
    """The constraints (k, c, N) at coordinates (k, N), of numbers without units."""
    s = scales(m)
    return np.asarray(s.rows[:, None] * gaps(m, q)[1] * s.coordinates)


def loose_coordinates(A: np.ndarray, dependent: Sequence[int]) -> np.ndarray:
    """Which dependent coordinates can move while the others are held."""
    _, sizes, ways = np.linalg.svd(A[:, list(dependent)])
    rank = (sizes > CONSTRAINT_RANK_TOLERANCE * sizes.max(initial=0.0)).sum()
    return np.asarray((np.abs(ways[rank:]) > 1e-6).any(axis=0))


def tangent_map(A: np.ndarray, own: Sequence[int], dependent: Sequence[int]) -> np.ndarray:
    """F (N, n) at constraints without units."""
    F = np.zeros((A.shape[1], len(own)))
    F[list(own)] = np.eye(len(own))
    F[list(dependent)] = -np.linalg.pinv(A[:, list(dependent)]) @ A[:, list(own)]
    return F


def assemble(m: Mechanism, start: np.ndarray) -> np.ndarray:
    """The configuration (N,) near a start in which the loops are closed.

    The independent coordinates stay if they can; else all move, as little as possible.

    Raises
    ------
    JounceError : if there is no such configuration nearby.
    """
    s, q = scales(m), np.array(start, dtype=float)[None]
    found, off = minimize_gaps(m, s, q, list(closure_of(m).dependent))
    if (
        off[0] <= CLOSED_GAP and (np.abs((found - q) / s.coordinates) <= MAX_DIRECT_CORRECTION).all()
    ):  # the independent ones can stay
        return np.asarray(found[0])
    everything = range(q.shape[1])
    # far away all coordinates move by shorter steps, as Newton's do not lead there
    for _ in range(10 * MAX_ASSEMBLY_STEPS):
        gap, A = gaps(m, q)
        if (np.abs(gap * s.rows) <= 0.1).all():
            break
        change = _least_motion(s, A, -gap, everything)
        q = q + change * min(1.0, 0.3 / max(np.abs(change / s.coordinates).max(), 1e-300))
    # near enough for Newton's steps
    q, off = minimize_gaps(m, s, q, everything)
    if off[0] > CLOSED_GAP:
        raise JounceError(
            f"{m.name!r}: {describe_worst_gap(m, s, q[0])}; the loops cannot be closed from this start;"
            f" give {Remedy('start=', 'a start in its file')}, joint positions near a configuration in which they are"
            " closed"
        )
    return np.asarray(q[0])


def describe_worst_gap(m: Mechanism, s: Scales, q: np.ndarray) -> str:
    """Which loop is open, and how far, in words, with those that are open nearly as far: they contradict each other."""
    gap, ends = gaps(m, q[None])[0][0], np.cumsum([len(loop.rows) for loop in m.loops])[:-1]
    sizes = np.array([np.abs(part).max() for part in np.split(gap * s.rows, ends)])
    worst, *others = (k for k in np.argsort(-sizes) if sizes[k] >= OPEN_SHARE * sizes.max())
    size = _describe_gap(m.loops[worst], np.split(gap, ends)[worst])
    more = f", nearly as far as {join_names(m.loops[k].name for k in others)}" if others else ""
    if sizes.max() > MAX_ROUNDED_GAP:
        return f"loop {m.loops[worst].name} is open by {size}{more}"
    cause = "joints that hold the same twice differ in the last digits that are stated of them"
    cure = "state more digits, or let the loop hold less"
    return f"loop {m.loops[worst].name} closes to {size} and no better{more}: {cause}; {cure}"


def _describe_gap(loop: Loop, gap: np.ndarray) -> str:
    """How far a loop is open, in m and rad: its turns are 2 tan(phi / 2) of the angle phi, at most pi."""
    turns, slides = np.split(gap, [len(loop.held[0])])
    angle = 2 * np.arctan(np.linalg.norm(turns) / 2)
    return f"{np.linalg.norm(slides):.3g} m and {angle:.3g} rad"


def _least_motion(s: Scales, A: np.ndarray, gap: np.ndarray, free: Sequence[int]) -> np.ndarray:
    """The least motion of some coordinates, (k, free), that makes a change (k, c)."""
    scaled = s.rows[:, None] * A[..., free] * s.coordinates[free]
    return (np.linalg.pinv(scaled, rcond=1e-12) @ (gap * s.rows)[..., None])[..., 0] * s.coordinates[free]


def minimize_gaps(m: Mechanism, s: Scales, q: np.ndarray, free: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates (k, N) with loops closed by moving some of them, and the gaps that are left, relative."""
    best, least = q, np.full(len(q), np.inf)
    for _ in range(MAX_ASSEMBLY_STEPS):
        # keep what is best, sample by sample
        gap, A = gaps(m, q)
        off = np.abs(gap * s.rows).max(axis=-1)
        better = off < least
        best, least = np.where(better[:, None], q, best), np.where(better, off, least)
        if not (better & (off > GAP_ROUNDING)).any():
            break
        # step: the shortest motion that closes the linearized loops
        q = q.copy()
        q[:, free] += _least_motion(s, A, -gap, free)
    return best, least


def sample_positions(m: Mechanism, count: int) -> np.ndarray:
    """Coordinates (count, N) of the tree at random places around the start, with loops closed; the start comes first.

    They differ by about a radian, or the size of the robot, where the loops allow it.
    """
    c, s, rng = closure_of(m), scales(m), np.random.default_rng(0)
    F = tangent_map(scaled_constraints(m, c.start[None])[0], c.independent, c.dependent)
    found, size = c.start[None], 1.0
    while len(found) < count:
        moved = rng.uniform(-size, size, (count, m.n)) @ F.T * s.coordinates
        q, off = minimize_gaps(m, s, c.start + moved, range(len(c.coordinates)))
        near = np.abs((q - c.start) / s.coordinates).max(axis=1) < 3 * size
        good = near & (off <= CLOSED_GAP) & (inverse_conditions(m, q) >= MIN_SAMPLE_INVERSE_CONDITION)
        found, size = np.concatenate([found, q[good]]), size * 0.7
    return found[:count]
