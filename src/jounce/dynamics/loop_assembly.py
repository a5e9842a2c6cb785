"""Assemble loops: one step of Newton's method, and the first position of a robot.

Problem: the gaps r of the loops, as many numbers as the cut joints hold, are to be zero. Rows may be redundant, and the
start of a robot may be far from closed, or singular.

One step, `newton_step`, over any scalar type, so that native code and generated code record it as well. The constraints
A are the derivatives of the gaps where loops are closed, A_u and A_d their columns of the independent and of the
dependent coordinates. With a change h of the independent coordinates, the dependent ones change by the solution of
``A_d step = -(r + A_u h)``: a correction where h = 0, a prediction along the tangent where r = 0. A_d is factored as
Q R by modified Gram-Schmidt (Golub, Van Loan, Matrix Computations, 5.2), which needs no pivots and can be recorded: the
columns of Q are orthogonal, but not of length 1, and the diagonal of R is 1. Followers by constant ratios are set to
what their ratios say, and count as independent then. A step reports no failure. Its measures hold what a caller judges
by: the squares of the gap before it, and of an estimate of the condition number of A_d, |A_d| times |Q^-1|. The
estimate leaves out R; it is large, infinite or NaN where constraints are lost.

The first position, `assemble`, on numbers: Gauss-Newton steps of least length (Deuflhard, Newton Methods for Nonlinear
Problems, 2011, 4.4), that is, with the pseudo-inverse. The independent coordinates are held first; if the loops do not
close nearby, all coordinates move, at first by shorter steps. The best coordinates so far are kept; the iteration ends
where a step does not make the gaps smaller. Gaps stay above `CLOSED_GAP` where the start is too far away or the loops
cannot close; `assemble` raises `JounceError` then, `minimize_gaps` returns what is left of them.

Between both stand the gaps and constraints on numbers, and what singular values say of them: how near constraints are
to being lost, and which coordinates they leave loose.

How often what runs: `assemble` once per robot, `newton_step` several times per position that is closed, by NumPy or
recorded once and compiled; `sample_positions` once per question that is answered by random positions.

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
LOOSE_SHARE = 1e-6  # of a unit motion in the null space: what moves by less moves by rounding only
CONSTRAINT_RANK_TOLERANCE = 1e-8  # of singular values, relative to the largest: sqrt(eps), well above their rounding
# Smallest over largest singular value of constraints, below which positions are lost. Their error is eps over this
# ratio, and so as large as the ratio where it is sqrt(eps), not far below the limit.
MIN_INVERSE_CONDITION = 1e-7
MIN_SAMPLE_INVERSE_CONDITION = 1e-5  # the same of random samples that stand for all positions: well above the limit
MAX_ASSEMBLY_STEPS = 20  # Gauss-Newton, quadratic near the end: more do not help
ASSEMBLY_STEP_LENGTH = 0.3  # rad or sizes of the robot: about 17 degrees, above NEARLY_CLOSED_GAP
NEARLY_CLOSED_GAP = 0.1  # without unit: smaller gaps are nearly linear, so that full steps converge
# Of the largest gap: where loops contradict each other, least squares leave a part open in each, by their levers.
OPEN_SHARE = 0.3
# Without unit: files state lengths in 5 to 7 digits, so that a loop that is open by less is closed as far as they say.
MAX_ROUNDED_GAP = 1e-5
HALF_TURN_GAP = 1e8  # 2 tan(phi / 2) where axes point in opposite directions, instead of infinity: a large turn is due


def loop_gaps(m: Mechanism, q: Array) -> tuple[Array, Array]:
    """Return the gaps r and the constraints A at coordinates q.

    r is (..., c, 1), A is (..., c, N), q is (..., N), of any scalar type; both have units.
    """
    ends = LoopEnds(m, column_series([q]))
    by_loop = [_gap(loop, C) for loop, C in zip(m.loops, ends.poses, strict=True)]
    return concatenate(by_loop, axis=-2), ends.A[0]


def _gap(loop: Loop, C: Array) -> Array:
    """Return the turns and the slides that open a loop.

    The shape is (..., k, 1): only those that the cut joint holds count. A turn by phi is its axis times 2 tan(phi / 2).
    C is the pose of the second frame in the first.
    """
    turns, slides = loop.held
    R, axis = rotation(C), np.asarray(loop.axis)[:, None]
    # 2 tan(phi / 2) = 2 sin(phi) / (1 + cos(phi)) is near phi where turns are small, and vanishes with it. It takes no
    # square root, as phi itself would.
    if len(turns) == 3:
        # All turns are held: trace(R) = 1 + 2 cos(phi), axial(R) = 2 sin(phi) times the axis of the turn. Numerator and
        # denominator are both twice those above.
        denominator, sine = 1 + (R * np.eye(3, dtype=int)).sum(axis=(-2, -1), keepdims=True), axial(R)[..., None]
    else:
        # The joint turns about its axis: phi is the angle between the axes of both frames. A joint that holds no turn
        # has no rows for it.
        second_axis = R @ axis
        denominator, sine = 1 + axis.mT @ second_axis, hat(axis[:, 0]) @ second_axis
    return concatenate([turns @ (2 * sine / denominator), slides @ position(C)], axis=-2)


def newton_step(m: Mechanism, q: Array, change: Array) -> tuple[Array, Array, Array]:
    """Return the dependent coordinates after a step, measures, and A_d.

    The coordinates are (..., N - n), from q (..., N), where the independent ones change by `change`, (..., n). Measures
    and A_d are those at q, before the step: `STEP_MEASURES` numbers, and a matrix without units with a column for each
    coordinate that constraints are solved for.
    """
    m = with_solved_loops(m)
    c = closure_of(m)
    independent, solved, followers = list(c.independent), list(c.solved), q[..., []]
    # Ratios may determine all dependent coordinates: then no gap is left, and nothing that could be lost.
    if len(solved) == 0:
        return c.ratios.positions(q[..., independent] + change), np.array([0.0, 1.0]), np.zeros((0, 0))
    # Followers go where their ratios say, and their changes count as those of independent coordinates: h, `change`, has
    # more entries then.
    if c.ratios.places:
        followers = c.ratios.positions(q[..., independent] + change)
        change = concatenate([change, followers - q[..., list(c.ratios.places)]], axis=-1)
        independent += c.ratios.places
    # Linearize: r, `gap`, and A lose their units, rows by the scales of gaps, columns by those of coordinates.
    s = scales(m)
    gap, A = loop_gaps(m, q)
    gap, A = s.rows[:, None] * gap, s.rows[:, None] * A * s.coordinates
    A_d = A[..., solved]
    # Solve A_d step = -(r + A_u h). The factors know which entries of A_d are always zero.
    factors = OrthogonalFactors.of(A_d, constraint_pattern(m)[:, solved])
    newton_change = factors.solve(-(gap + A[..., independent] @ (change / s.coordinates[independent])[..., None]))
    # Measure |r|^2 and |Q^-1|^2 |A_d|^2 by Frobenius norms, whose squares need no square root.
    measures = concatenate([_square(gap), _square(concatenate(factors.inverse_Q, axis=-2)) * _square(A_d)], axis=-1)
    # Take the step, in units again, and put followers and solved coordinates in the order of the tree.
    dependent = concatenate([followers, q[..., solved] + s.coordinates[solved] * newton_change[..., 0]], axis=-1)
    return dependent[..., np.argsort([*c.ratios.places, *solved])], measures, A_d


def _square(x: Array) -> Array:
    """Return the sum of squared entries of a matrix, (..., 1)."""
    return (x * x).sum(axis=(-2, -1), keepdims=True)[..., 0]


def numpy_step(m: Mechanism) -> NewtonStep:
    """Return the step of a robot, by NumPy."""

    def step_arrays(q: np.ndarray, change: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        # Measures tell of divisions by zero, not warnings: they occur where constraints are lost, and at half turns.
        with np.errstate(all="ignore"):
            dependent, measures, A_d = newton_step(m, q, change)
        # Measures and A_d may have no batch axes: they are the same everywhere if constraints are constant.
        batch = q.shape[:-1]
        measures = np.broadcast_to(measures, (*batch, *measures.shape[-1:]))
        A_d = np.broadcast_to(A_d, (*batch, *A_d.shape[-2:]))
        return dependent, measures, A_d.astype(float)

    return step_arrays


# Gaps and constraints on numbers, and what singular values say of them.
def gaps(m: Mechanism, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return finite gaps and the constraints A at coordinates q.

    They are those of `loop_gaps` on numbers, with units: gaps are (k, c), A is (k, c, N), q is (k, N).
    """
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        gap, A = loop_gaps(m, q)
    # Where axes are opposite, 2 tan(phi / 2) is infinite or NaN: a large finite turn lets Newton's method go on. NaN
    # from missing numbers stays.
    known = np.isfinite(q).all(axis=-1)[:, None]
    opposite = known & ~(np.abs(gap[..., 0]) < HALF_TURN_GAP)
    return np.where(opposite, HALF_TURN_GAP, gap[..., 0]), A.astype(float)


def inverse_conditions(m: Mechanism, q: np.ndarray) -> np.ndarray:
    """Return 1 / cond, (k,), of A_d at coordinates (k, N).

    It is zero where the dependent coordinates do not follow the independent ones, NaN where numbers are missing.
    """
    finite, conditions = np.isfinite(q).all(axis=1), np.full(len(q), np.nan)
    conditions[finite] = compute_inverse_conditions(solved_constraints(m, q[finite]))
    return conditions


def solved_constraints(m: Mechanism, q: np.ndarray) -> np.ndarray:
    """Return A_d, (k, c, d), at coordinates (k, N), without units."""
    solved, m = list(closure_of(m).solved), with_solved_loops(m)
    return scaled_constraints(m, q)[..., solved] if len(solved) > 0 else np.zeros((len(q), 0, 0))


def compute_inverse_conditions(A: np.ndarray) -> np.ndarray:
    """Return 1 / cond of constraints; zero for fewer rows than columns.

    The constraints are (k, c, d), the result is (k,).
    """
    # No column is left where all dependent coordinates follow by constant ratios: nothing can be lost.
    if A.shape[-1] == 0:
        return np.ones(len(A))
    singular_values = np.linalg.svd(A, compute_uv=False)
    return np.asarray(
        singular_values[:, -1] / singular_values[:, 0] if A.shape[-2] >= A.shape[-1] else np.zeros(len(A))
    )


def crosses_singularity(A: np.ndarray, B: np.ndarray) -> np.ndarray:
    """Return whether det(A^T B) is not positive, for constraints at two positions.

    A and B are (k, c, d), the result is (k,). A determinant changes its sign at a singular position, which lies between
    both then. The product serves matrices that are not square, too.
    """
    return np.asarray(np.linalg.slogdet(A.mT @ B)[0] <= 0)


def scaled_constraints(m: Mechanism, q: np.ndarray) -> np.ndarray:
    """Return the constraints without units.

    They are (k, c, N) at coordinates (k, N).
    """
    s = scales(m)
    return np.asarray(s.rows[:, None] * gaps(m, q)[1] * s.coordinates)


def loose_coordinates(A: np.ndarray, dependent: Sequence[int]) -> np.ndarray:
    """Return which dependent coordinates can move while independent ones are held.

    The constraints A are (c, N), without units.
    """
    # Rows of `directions` beyond the rank span the null space of A_d: the motions that constraints allow.
    _, singular_values, directions = np.linalg.svd(A[:, list(dependent)])
    rank = (singular_values > CONSTRAINT_RANK_TOLERANCE * singular_values.max(initial=0.0)).sum()
    return np.asarray((np.abs(directions[rank:]) > LOOSE_SHARE).any(axis=0))


def loose_basis(A: np.ndarray, held: Sequence[int], preferred: Sequence[int]) -> tuple[int, ...]:
    """Return the coordinates that determine what moves while others are held.

    The constraints A are (c, N), without units. Preferred coordinates are taken first; of several the one that moves
    most is taken, so that what it determines keeps its digits.
    """
    # The null space of the constraints and of the held coordinates: (ways, N), one row for each way to move.
    holding = np.concatenate([A, np.eye(A.shape[1])[list(held)]])
    _, singular_values, directions = np.linalg.svd(holding)
    ways = directions[(singular_values > CONSTRAINT_RANK_TOLERANCE * singular_values.max(initial=0.0)).sum() :]
    taken: list[int] = []
    while len(ways) > 0:
        motion = np.linalg.norm(ways, axis=0)
        moving_preferred = [j for j in preferred if motion[j] > LOOSE_SHARE]
        candidates = moving_preferred if len(moving_preferred) > 0 else range(A.shape[1])
        # Rounding must not decide between coordinates that move alike: the first of them is taken.
        chosen = max(candidates, key=lambda j: (round(float(motion[j]), 6), -j))
        taken.append(int(chosen))
        # What is left are the ways in which the chosen coordinate rests: those across its column.
        _, _, across = np.linalg.svd(ways[:, chosen][None])
        ways = across[1:] @ ways
    return tuple(taken)


def tangent_map(A: np.ndarray, independent: Sequence[int], dependent: Sequence[int]) -> np.ndarray:
    """Return F = [1; -A_d^-1 A_u] from constraints without units.

    F is (N, n), with its rows in the order of the tree; the constraints are (c, N).
    """
    F = np.zeros((A.shape[1], len(independent)))
    F[list(independent)] = np.eye(len(independent))
    F[list(dependent)] = -np.linalg.pinv(A[:, list(dependent)]) @ A[:, list(independent)]
    return F


def assemble(m: Mechanism, start: np.ndarray) -> np.ndarray:
    """Return the position near a start in which loops are closed.

    The shape is (N,). The independent coordinates stay if they can; else all move, as little as possible.

    Raises
    ------
    JounceError : if there is no such position nearby.
    """
    s, q = scales(m), np.array(start, dtype=float)[None]
    # First the dependent coordinates alone: the independent ones stay if the loops close nearby.
    closed, gap_size = minimize_gaps(m, s, q, list(closure_of(m).dependent))
    if gap_size[0] <= CLOSED_GAP and (np.abs((closed - q) / s.coordinates) <= MAX_DIRECT_CORRECTION).all():
        return np.asarray(closed[0])
    # Then all coordinates move, from the start again, by steps up to ASSEMBLY_STEP_LENGTH while gaps are large: full
    # steps would lead anywhere.
    all_coordinates = range(q.shape[1])
    for _ in range(10 * MAX_ASSEMBLY_STEPS):
        gap, A = gaps(m, q)
        if (np.abs(gap * s.rows) <= NEARLY_CLOSED_GAP).all():
            break
        change = _least_motion(s, A, -gap, all_coordinates)
        q = q + change * min(1.0, ASSEMBLY_STEP_LENGTH / max(np.abs(change / s.coordinates).max(), 1e-300))
    # Full steps converge quadratically once gaps are small.
    q, gap_size = minimize_gaps(m, s, q, all_coordinates)
    if gap_size[0] > CLOSED_GAP:
        raise JounceError(
            f"{m.name!r}: {describe_worst_gap(m, s, q[0])}; the loops cannot be closed from this start;"
            f" give {Remedy('start=', 'a start in its file')}, joint positions near a configuration in which they are"
            " closed"
        )
    return np.asarray(q[0])


def describe_worst_gap(m: Mechanism, s: Scales, q: np.ndarray) -> str:
    """Describe which loop is open, and how far, in words.

    Loops that are open nearly as far are named too: they may contradict each other.
    """
    # Each loop counts by the largest of its gaps, without units.
    gap, ends = gaps(m, q[None])[0][0], np.cumsum([len(loop.rows) for loop in m.loops])[:-1]
    gap_sizes = np.array([np.abs(part).max() for part in np.split(gap * s.rows, ends)])
    worst, *similar = (k for k in np.argsort(-gap_sizes) if gap_sizes[k] >= OPEN_SHARE * gap_sizes.max())
    description = _describe_gap(m.loops[worst], np.split(gap, ends)[worst])
    more = f", nearly as far as {join_names(m.loops[k].name for k in similar)}" if similar else ""
    # Gaps below the digits of files do not mean that the search failed: two joints hold the same motion, with numbers
    # that were rounded differently.
    if gap_sizes.max() > MAX_ROUNDED_GAP:
        return f"loop {m.loops[worst].name} is open by {description}{more}"
    cause = "joints that hold the same twice differ in the last digits that are stated of them"
    cure = "state more digits, or let the loop hold less"
    return f"loop {m.loops[worst].name} closes to {description} and no better{more}: {cause}; {cure}"


def _describe_gap(loop: Loop, gap: np.ndarray) -> str:
    """Describe how far a loop is open, in m and rad.

    Its turns have the length 2 tan(phi / 2), from which the angle phi comes, at most pi.
    """
    turns, slides = np.split(gap, [len(loop.held[0])])
    angle = 2 * np.arctan(np.linalg.norm(turns) / 2)
    return f"{np.linalg.norm(slides):.3g} m and {angle:.3g} rad"


def _least_motion(s: Scales, A: np.ndarray, gap_change: np.ndarray, free: Sequence[int]) -> np.ndarray:
    """Return the least motion that changes gaps by `gap_change`, to first order.

    The change is (k, c), the motion of the coordinates `free` is (k, free), both with units. Its sum of squares without
    units is least, by the pseudo-inverse. It takes singular values near rounding as zero, as rows may be redundant.
    """
    scaled = s.rows[:, None] * A[..., free] * s.coordinates[free]
    return (np.linalg.pinv(scaled, rcond=1e-12) @ (gap_change * s.rows)[..., None])[..., 0] * s.coordinates[free]


def minimize_gaps(m: Mechanism, s: Scales, q: np.ndarray, free: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
    """Close loops as far as the coordinates `free` can, by Gauss-Newton steps.

    Return the best coordinates (k, N) of each sample, and the largest gap that each is left with, (k,), without units.
    """
    best, smallest_gap = q, np.full(len(q), np.inf)
    for _ in range(MAX_ASSEMBLY_STEPS):
        # Keep the best coordinates, sample by sample: a step may lead away.
        gap, A = gaps(m, q)
        gap_size = np.abs(gap * s.rows).max(axis=-1)
        improves = gap_size < smallest_gap
        best, smallest_gap = np.where(improves[:, None], q, best), np.where(improves, gap_size, smallest_gap)
        # The batch ends once no sample improves whose gap is more than rounding.
        if not (improves & (gap_size > GAP_ROUNDING)).any():
            break
        # The shortest motion that closes the linearized loops, from where the last step led, better or not.
        q = q.copy()
        q[:, free] += _least_motion(s, A, -gap, free)
    return best, smallest_gap


def sample_positions(m: Mechanism, count: int) -> np.ndarray:
    """Return random coordinates around the start, with loops closed.

    The shape is (count, N). The start comes first. The others are about a radian, or a size of the robot, away from it
    where the loops allow that.
    """
    c, s, rng = closure_of(m), scales(m), np.random.default_rng(0)
    F = tangent_map(scaled_constraints(m, c.start[None])[0], c.independent, c.dependent)
    samples, reach = c.start[None], 1.0
    while len(samples) < count:
        # Displace the start along its tangent, where loops stay nearly closed. Then all coordinates move to close them.
        displacements = rng.uniform(-reach, reach, (count, m.n)) @ F.T * s.coordinates
        q, gap_size = minimize_gaps(m, s, c.start + displacements, range(len(c.coordinates)))
        # Results far away may be on another branch, and near singular positions constraints have few digits.
        is_near = np.abs((q - c.start) / s.coordinates).max(axis=1) < 3 * reach
        is_regular = inverse_conditions(m, q) >= MIN_SAMPLE_INVERSE_CONDITION
        usable = is_near & (gap_size <= CLOSED_GAP) & is_regular
        # Shorter displacements, where loops close more often, give the samples that are still missing.
        samples, reach = np.concatenate([samples, q[usable]]), reach * 0.7
    return samples[:count]
