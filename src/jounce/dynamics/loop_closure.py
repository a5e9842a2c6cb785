"""Loops close on numbers: continuation finds the dependent coordinates on the branch of the start.

Problem: independent coordinates and a start are given; the gaps of the loops are to be zero on the branch of the start,
one of the several ways in which loops close. `close_loops` is the door.

Algorithm: predictor-corrector continuation (Allgower, Georg, Introduction to Numerical Continuation Methods, 2003)
along a straight line of the independent coordinates, which is the parameter: the tangent predicts, Newton's method
corrects, and the length of steps doubles or halves. Samples of a batch do not depend on each other.

Invariants: accepted positions have closed loops and lie on the branch of the start. A step from q to p stays on its
branch where the determinant of A_d keeps its sign, det(A_d(q)^T A_d(p)) > 0, and the tangent at p is much like that at
q. Neither suffices alone. Where two branches nearly meet, each is nearly straight, and a step that crosses the gap
between them finds its tangent again, but the determinant has changed its sign. Where two such gaps are crossed, or one
of several loops does not matter to the sign, the tangents differ.

Failure: steps shrink in front of a singular position or the end of the workspace; below `MIN_CONTINUATION_STEP`, and
where constraints are lost at the end of the line, `JounceError` is raised.

Followers by constant ratios, `with_ratios`, once for each closed robot: parallelograms of palletizers and of parallel
grippers. Entries of F are analytic along a branch: one that is the same at several arbitrary positions is constant.
Such a coordinate has no singular position, where constraints, solved for it, lose all digits near their change
points.
"""

from dataclasses import replace
from functools import lru_cache

import numpy as np

from jounce.core.cures import Remedy
from jounce.core.errors import JounceError, join_names
from jounce.dynamics import loop_assembly
from jounce.dynamics.loop_assembly import CLOSED_GAP, MAX_DIRECT_CORRECTION, NewtonStep, compute_inverse_conditions
from jounce.dynamics.loop_branches import Scales, scales
from jounce.dynamics.loops import closure_of
from jounce.model.loops import FollowerRatios, all_coordinates
from jounce.model.mechanism import Mechanism

MAX_CONDITION_ESTIMATE = 1e4  # of A_d: up to it one step from CLOSED_GAP leaves (1e4 CLOSED_GAP)^2, which is rounding
MAX_CLOSURE_STEPS = 20  # of Newton's method, which is quadratic: what takes more does not converge
FIRST_CONTINUATION_STEP = 0.25  # rad or sizes of the robot: about 15 degrees, to be doubled or halved
MIN_CONTINUATION_STEP = 1e-5  # of what is left of the way: where steps as short fail, none leads on
MAX_CORRECTION_RATIO = 0.3  # of the length of a step: correcting it further may lead to another branch
MAX_TANGENT_TURN = 0.7  # change of the tangent over a step, relative to the tangent or to the way: about 40 degrees
FOLLOWER_PLACE_TOLERANCE = 1e-6  # rad or sizes of the robot: numbers in files are rounded
MAX_OTHER_BRANCH_GAP = 1e-3  # of the distance to followers' places: where gaps are smaller, loops close there too
MIN_COMPARED_STEP = 1e-8  # rad or sizes of the robot, sqrt(eps): rounding turns the tangents of steps as short
RATIO_SAMPLES = 6  # positions at which F is compared with that at the start: one would do, but for accidents
RATIO_SAMPLE_REACH = 0.3  # rad or sizes of the robot around the start: large enough that F changes, within most reaches
RATIO_TOLERANCE = 1e-10  # of F and positions: lengths rounded to doubles leave less, those rounded to micrometers more


@lru_cache(maxsize=64)
def max_gap(m: Mechanism) -> float:
    """The square of the gap up to which loops are closed."""
    return sum(len(loop.rows) for loop in m.loops) * CLOSED_GAP**2


def close_loops(
    m: Mechanism, u: np.ndarray, start: np.ndarray | None = None, step: NewtonStep | None = None
) -> np.ndarray:
    """The coordinates (k, N) of the tree where the loops are closed, from the independent ones (k, n).

    They are continued along a straight line from a start, (k, N) or (N,), by default that of the closure; where it has
    these independent coordinates already, its loops need be nearly closed only. `step` is `newton_step` of the robot,
    by default in NumPy.

    Raises
    ------
    JounceError : where the loops cannot be closed, or constraints are lost.
    """
    c = closure_of(m)
    start = np.broadcast_to(c.start if start is None else start, (len(u), len(c.coordinates)))
    if c.ratios.places:
        _check_followers(m, start, u)
    if not m.loops:
        return all_coordinates(c, u, c.ratios.positions(u))
    q, A, estimates = _continue_branch(m, u, start, step or loop_assembly.numpy_step(m))
    # estimates of conditions come at no cost; where they are large, singular values decide
    if len(near := np.flatnonzero(estimates > MAX_CONDITION_ESTIMATE**2)):
        conditions = loop_assembly.compute_inverse_conditions(A[near])
        if (conditions < loop_assembly.MIN_INVERSE_CONDITION).any():
            worst = int(conditions.argmin())
            raise JounceError(
                f"{m.name!r}: constraints are lost at q{_sample_label(int(near[worst]), len(q))}, where 1/cond is"
                f" {conditions[worst]:.2g}, expected {loop_assembly.MIN_INVERSE_CONDITION:g} or more:"
                f" {join_names(m.coordinates)} do not determine the other joints there, or with few digits"
            )
    return q


def _continue_branch(
    m: Mechanism, u: np.ndarray, start: np.ndarray, step: NewtonStep
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Coordinates with closed loops, continued from a start, A_d there, and the measures of its condition."""
    c, s = closure_of(m), scales(m)
    own, others = list(c.independent), np.array(c.dependent)
    q = np.array(start, dtype=float)
    # start: no sample has moved, but those with missing numbers are done, as all that depends on them is missing
    left = (np.isfinite(u).all(axis=1) & np.isfinite(q).all(axis=1)) * 1.0  # the share of the way that is left
    q[left == 0] = np.nan
    way = u - q[:, own]
    moves = way.any(axis=1)[:, None]
    length = np.abs(way / s.coordinates[own]).max(axis=1, initial=0)
    size = FIRST_CONTINUATION_STEP / np.maximum(length, FIRST_CONTINUATION_STEP)
    moved, measures, A = step(q, way)
    estimates = np.where(left > 0, measures[:, 1], 0)
    tangent = np.where(moves, moved - q[:, others], 0)  # of the dependent coordinates, per whole way
    while len(k := np.flatnonzero(left)):
        # predict: along the tangent, the independent coordinates exactly on their line
        share, before = np.minimum(size[k], left[k]), q[k]
        predicted = before.copy()
        predicted[:, others] += share[:, None] * tangent[k]
        predicted[:, own] = u[k] - way[k] * (left[k] - share)[:, None]
        # correct: close the loops, and look at tangent and constraints there
        found, good = _iterate_newton(m, predicted, step)
        moved, measures, A_found = step(found, way[k])
        turned = moved - found[:, others] - tangent[k]
        # compare: the correction with the step, the tangents at both ends, and the signs of the determinants
        good &= _is_near(s, found - predicted, predicted - before)
        turn, longest = (np.abs(x / s.coordinates[others]).max(axis=1) for x in (turned, tangent[k]))
        good &= (turn * share <= MIN_COMPARED_STEP) | (turn <= MAX_TANGENT_TURN * np.maximum(longest, length[k]))
        good &= ~(moves[k, 0] & loop_assembly.crosses_singularity(A[k], A_found))
        # accept where the branch is surely the same, and try twice the step; else half of it
        done = k[good]
        q[done], A[done], estimates[done] = found[good], A_found[good], measures[good, 1]
        tangent[done] += turned[good]
        left[done] -= share[good]
        size[k] = np.where(good, 2 * share, np.where(moves[k, 0], share / 2, 0))
        # give up where no step is short enough, or none leads on as the independent coordinates are in their places
        if len(stuck := k[~good & (size[k] < MIN_CONTINUATION_STEP * left[k])]):
            raise _closing_error(m, s, q[stuck[0]], u[stuck[0]], _sample_label(stuck[0], len(u)))
    return q, A, estimates


def _iterate_newton(m: Mechanism, q: np.ndarray, step: NewtonStep) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates (k, N) with dependent ones found by Newton's method, and whether loops are closed.

    Samples leave the iteration one by one: with the step after they are closed, and nearly singular ones where their
    gaps become no smaller.
    """
    c, still = closure_of(m), np.zeros(m.n)
    others, limit = np.array(c.dependent), max_gap(m)
    q, good, least = q.copy(), np.zeros(len(q), dtype=bool), np.full(len(q), np.inf)
    k = np.arange(len(q))
    for _ in range(MAX_CLOSURE_STEPS):
        # step: the gaps are those before it
        found, measures, _ = step(q[k], still)
        gap, estimate = measures[:, 0], measures[:, 1]
        # judge: positions are closed once a gap is small enough
        better = gap < least[k]
        least[k] = np.minimum(gap, least[k])
        good[k] = least[k] <= limit
        # take the step, but of closed and nearly singular samples none that rounding makes
        useful = better & (~good[k] | (estimate <= loop_assembly.MIN_INVERSE_CONDITION**-2))
        q[k[useful, None], others] = found[useful]
        # go on with samples whose gap fell, until the step after the one that closed them
        k = k[better & ~(good[k] & (estimate <= MAX_CONDITION_ESTIMATE**2))]
        if not len(k):
            break
    return q, good


def _is_near(s: Scales, bent: np.ndarray, straight: np.ndarray) -> np.ndarray:
    """Whether a step ended near where its tangent pointed: else it may have come to another branch."""
    off, length = (np.abs(x / s.coordinates).max(axis=1) for x in (bent, straight))
    allowed = np.maximum(MAX_CORRECTION_RATIO * length, MIN_COMPARED_STEP)
    return np.asarray(off <= np.where(length > 0, allowed, MAX_DIRECT_CORRECTION))


def _check_followers(m: Mechanism, start: np.ndarray, u: np.ndarray) -> None:
    """Raise `JounceError` where loops are closed at a start too, and followers are not at their places there."""
    c, s = closure_of(m), scales(m)
    own, following = list(c.independent), list(c.ratios.places)
    away = (start[:, following] - c.ratios.positions(u)) / s.coordinates[following]
    far = np.abs(away).max(axis=1)
    off = np.flatnonzero((far > FOLLOWER_PLACE_TOLERANCE) & (start[:, own] == u).all(axis=1))
    gaps = np.abs(loop_assembly.gaps(m, start[off])[0] * s.rows).max(axis=1) if m.loops else 0 * far[off]
    other = off[gaps < MAX_OTHER_BRANCH_GAP * far[off]]
    if len(other):
        k, j = other[0], np.abs(away[other[0]]).argmax()
        name, given, place = c.coordinates[following[j]], start[k, following[j]], c.ratios.positions(u[k])[j]
        raise JounceError(
            f"{m.name!r}: {name} = {given:.4g}{_sample_label(int(k), len(u))} is on another branch; on that"
            f" of the start it follows {join_names(m.coordinates)} by constant ratios, to {place:.4g}; expected that"
            f"{Remedy(', or robot.closed(start=...) with a start on the other branch') if m.loops else ''}"
        )


def _sample_label(k: int, count: int) -> str:
    return f" of sample {k}" if count > 1 else ""


def _closing_error(m: Mechanism, s: Scales, q: np.ndarray, u: np.ndarray, sample: str) -> JounceError:
    c = closure_of(m)
    own = list(c.independent)
    trial = q.copy()
    trial[own] = u
    [found], [off] = loop_assembly.minimize_gaps(m, s, trial[None], list(c.dependent))
    if (q[own] == u).all():  # all coordinates were given
        far = np.abs((found - q) / s.coordinates)
        joint = int(far.argmax())
        closes = f"they close with {c.coordinates[joint]} = {found[joint]:.4g}, not {q[joint]:.4g}"
        gap = loop_assembly.describe_worst_gap(m, s, q if off <= CLOSED_GAP else found)
        return JounceError(
            f"{m.name!r} cannot be closed near the coordinates given{sample}: {gap}"
            f"{'; ' + closes if off <= CLOSED_GAP else ''}; expected all {len(c.coordinates)} coordinates of the tree"
            f" near positions in which loops are closed, or {join_names(m.coordinates)} alone"
        )
    at = ", ".join(f"{name} = {x:.4g}" for name, x in zip(m.coordinates, q[own], strict=True))
    gap = (
        "no straight line of the coordinates leads there"
        if off <= CLOSED_GAP
        else loop_assembly.describe_worst_gap(m, s, found)
    )
    return JounceError(
        f"{m.name!r} cannot be closed at q{sample}: {gap}; from the start it comes to {at},"
        f" where 1/cond of the constraints is {loop_assembly.inverse_conditions(m, q[None])[0]:.2g}; expected q in the"
        f" workspace, or all {len(c.coordinates)} coordinates of the tree, near the wanted branch, in place of q"
    )


# Followers by constant ratios.
def with_ratios(m: Mechanism) -> Mechanism:
    """A closed robot with its followers found; the start must be regular."""
    c, s, rng = closure_of(m), scales(m), np.random.default_rng(0)
    own = list(c.independent)
    sizes = s.coordinates[:, None] / s.coordinates[own]
    F = _tangent(m, c.start) * sizes
    constant = np.isin(range(len(F)), c.dependent)
    found, reach = 0, RATIO_SAMPLE_REACH / 16  # first near the start, where most robots show that they have none
    for _ in range(3 * RATIO_SAMPLES):
        u = c.start[own] + rng.uniform(-reach, reach, m.n) * s.coordinates[own]
        try:
            [q] = close_loops(m, u[None])
        except JounceError:  # out of reach
            reach /= 4
            continue
        A = loop_assembly.scaled_constraints(m, q[None])[..., c.dependent]
        if compute_inverse_conditions(A)[0] < np.sqrt(loop_assembly.MIN_SAMPLE_INVERSE_CONDITION):
            continue
        found, reach = found + 1, RATIO_SAMPLE_REACH
        turned = np.abs((_tangent(m, q) * sizes - F) / sizes).max(axis=1)
        off = np.abs(q - c.start - F @ (u - c.start[own])) / s.coordinates
        constant &= np.maximum(turned, off) <= RATIO_TOLERANCE
        if found == RATIO_SAMPLES or not constant.any():
            break
    if found < RATIO_SAMPLES or not constant.any():
        return m
    places = np.flatnonzero(constant)
    F, sizes = F[places], sizes[places]
    whole = np.rint(F / sizes)
    F = np.where(np.abs(F / sizes - whole) <= RATIO_TOLERANCE, whole * sizes + 0.0, F)
    ratios = FollowerRatios(tuple(places.tolist()), F, c.start[places] - F @ c.start[own])
    return replace(m, closure=replace(c, ratios=ratios))


def _tangent(m: Mechanism, q: np.ndarray) -> np.ndarray:
    """F (N, n) at coordinates (N,), without units."""
    c = closure_of(m)
    return loop_assembly.tangent_map(loop_assembly.scaled_constraints(m, q[None])[0], c.independent, c.dependent)
