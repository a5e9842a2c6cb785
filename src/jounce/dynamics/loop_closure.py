"""Close loops on numbers: continuation finds the dependent coordinates on the branch of the start.

Problem: the independent coordinates u and a start are given. The dependent ones d are to close the loops, that is, to
make their gaps zero. Loops close in several ways, as with the elbow up or down: each way is a branch, and the one of
the start is wanted. In `loop_branches` the word has another meaning: the two chains of joints of a loop.
`close_loops` is the door.

Symbols: q are all coordinates of the tree, u and d together. The constraints A are the derivatives of the gaps by q
where loops are closed, A_u and A_d their columns of u and d. F = [1; -A_d^-1 A_u] is the tangent of a branch, with
q' = F u'; F_d are its rows of d.

Algorithm: predictor-corrector continuation (Allgower, Georg, Introduction to Numerical Continuation Methods, 2003)
along a straight line of the independent coordinates, which is the parameter: the tangent predicts, Newton's method
corrects, and the length of steps doubles or halves. Samples of a batch do not depend on each other.

How often what runs: `close_loops` once per batch; a round of `_continue_branch` once per trial step, for all samples
that are not yet at the end of their lines; in a round, a Newton step up to `MAX_CLOSURE_STEPS` times by
`_iterate_newton`, and once more for the tangent at the new position. `with_ratios` runs once per robot.

Invariants: accepted positions have closed loops and lie on the branch of the start. A step from q to p counts as one
along the branch where the correction is short, the tangents at q and at p are alike, and the determinant of A_d keeps
its sign, det(A_d(q)^T A_d(p)) > 0. The last two tests need each other. Two branches that nearly meet look like a
hyperbola at its centre: a step straight across lands on the other branch with the same tangent, and only the sign has
changed. A step across two such places keeps the sign, and so does one on which two loops change their branches; then
only the tangents differ.

Failure: steps shrink in front of a singular position or the end of the workspace; below `MIN_CONTINUATION_STEP`, and
where constraints are lost at the end of the line, `JounceError` is raised.

Followers by constant ratios, `with_ratios`: d = F_d u + offset, as in parallelograms of palletizers and of parallel
grippers. Entries of F are analytic along a branch: one that is the same at several arbitrary positions is constant. The
ratios hold everywhere. Constraints that are solved for such a coordinate lose all digits near change points, where the
parallelogram is flat.
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

MAX_CONDITION_ESTIMATE = 1e4  # of A_d: one step from CLOSED_GAP leaves the square of 1e4 CLOSED_GAP, less than rounding
MAX_CLOSURE_STEPS = 20  # of Newton's method, which is quadratic: what takes more does not converge
FIRST_CONTINUATION_STEP = 0.25  # rad or sizes of the robot: about 15 degrees, doubled or halved later
MIN_CONTINUATION_STEP = 1e-5  # of what is left of the way: where a step as short fails, none leads on
MAX_CORRECTION_RATIO = 0.3  # of the length of a step: correcting it further may lead to another branch
MAX_TANGENT_TURN = 0.7  # change of the tangent over a step, relative to the tangent or to the way: about 40 degrees
FOLLOWER_PLACE_TOLERANCE = 1e-6  # rad or sizes of the robot: numbers in files are rounded
MAX_OTHER_BRANCH_GAP = 1e-3  # of how far followers are off: where gaps are smaller, loops close there too
MIN_COMPARED_STEP = 1e-8  # rad or sizes of the robot, sqrt(eps): steps as short change tangents by rounding only
RATIO_SAMPLES = 6  # positions where F is compared with that at the start: one would do, but for accidents
RATIO_SAMPLE_REACH = 0.3  # rad or sizes of the robot around the start: large enough that F changes, within most reaches
RATIO_TOLERANCE = 1e-10  # of F and positions: lengths rounded to doubles leave less, those rounded to micrometers more


@lru_cache(maxsize=64)
def max_gap(m: Mechanism) -> float:
    """Return the square of the gap up to which loops are closed.

    It limits the first measure of a Newton step, a sum over all rows, each of which may be open by `CLOSED_GAP`.
    """
    return sum(len(loop.rows) for loop in m.loops) * CLOSED_GAP**2


def close_loops(
    m: Mechanism, u: np.ndarray, start: np.ndarray | None = None, step: NewtonStep | None = None
) -> np.ndarray:
    """Return the coordinates of the tree with loops closed.

    They are (k, N), from independent ones u (k, n), and NaN where numbers are missing. They are continued along a
    straight line from a start, (k, N) or (N,), by default that of the closure. A start with these u needs no way: its
    loops may be open a little, and are closed there. `step` is `newton_step` of the robot, by default in NumPy.

    Raises
    ------
    JounceError : where the loops cannot be closed, or constraints are lost.
    """
    c = closure_of(m)
    # (N,) or (k, N) -> (k, N): every sample has a start of its own.
    start = np.broadcast_to(c.start if start is None else start, (len(u), len(c.coordinates)))
    if c.ratios.places:
        _check_followers(m, start, u)
    # Without loops every dependent coordinate follows by constant ratios.
    if len(m.loops) == 0:
        return all_coordinates(c, u, c.ratios.positions(u))
    q, A, squared_conditions = _continue_branch(m, u, start, loop_assembly.numpy_step(m) if step is None else step)
    # Newton steps estimate the condition of A_d at no cost. Where the estimate is large, singular values decide.
    suspects = np.flatnonzero(squared_conditions > MAX_CONDITION_ESTIMATE**2)
    if len(suspects) == 0:
        return q
    inverse_conditions = loop_assembly.compute_inverse_conditions(A[suspects])
    if (inverse_conditions < loop_assembly.MIN_INVERSE_CONDITION).any():
        worst = int(inverse_conditions.argmin())
        raise JounceError(
            f"{m.name!r}: constraints are lost at q{_sample_label(int(suspects[worst]), len(q))}, where 1/cond is"
            f" {inverse_conditions[worst]:.2g}, expected {loop_assembly.MIN_INVERSE_CONDITION:g} or more:"
            f" {join_names(m.coordinates)} do not determine the other joints there, or with few digits"
        )
    return q


def _continue_branch(
    m: Mechanism, u: np.ndarray, start: np.ndarray, step: NewtonStep
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Follow the branch of a start to independent coordinates u.

    All samples take their steps together, each of a length of its own. Return the coordinates (k, N) with closed loops,
    A_d (k, c, d) there, and (k,) estimates of its condition number, squared.
    """
    c, s = closure_of(m), scales(m)
    independent, dependent = list(c.independent), np.array(c.dependent)
    q = np.array(start, dtype=float)
    # A sample goes from its start, u(q), to u along a straight line. `remaining` is the share of that way which is
    # still ahead: 1 at the start, 0 at the end. A sample with missing numbers has no way: its result is NaN.
    remaining = (np.isfinite(u).all(axis=1) & np.isfinite(q).all(axis=1)) * 1.0
    q[remaining == 0] = np.nan
    way = u - q[:, independent]  # (k, n)
    # A start that has the wanted u already has no way to go: only its loops are closed there.
    moves = way.any(axis=1)[:, None]  # (k, 1)
    # The largest change of an independent coordinate over the way, in rad or sizes of the robot.
    way_length = np.abs(way / s.coordinates[independent]).max(axis=1, initial=0)
    # The next step as a share of the way: 1 for ways up to FIRST_CONTINUATION_STEP, which are tried at once.
    next_share = FIRST_CONTINUATION_STEP / np.maximum(way_length, FIRST_CONTINUATION_STEP)
    # A Newton step with the whole way as change of u, where loops are closed already, moves the dependent coordinates
    # along the tangent of the branch, by F_d (u - u(q)). `tangent` is this motion: a step takes its share of it.
    stepped, measures, A = step(q, way)
    squared_conditions = np.where(remaining > 0, measures[:, 1], 0)
    tangent = np.where(moves, stepped - q[:, dependent], 0)  # (k, N - n)
    active = np.flatnonzero(remaining)
    while len(active) > 0:
        # Predict: the dependent coordinates go along the tangent, the independent ones along their line. The latter are
        # counted back from u, so that the last step ends at u exactly.
        share, before = np.minimum(next_share[active], remaining[active]), q[active]
        predicted = before.copy()
        predicted[:, dependent] += share[:, None] * tangent[active]
        predicted[:, independent] = u[active] - way[active] * (remaining[active] - share)[:, None]
        # Correct: Newton's method closes the loops by the dependent coordinates alone. One further step from there,
        # with the way as change, gives the tangent and A_d at the new position.
        corrected, accepted = _iterate_newton(m, predicted, step)
        stepped, measures, A_corrected = step(corrected, way[active])
        tangent_change = stepped - corrected[:, dependent] - tangent[active]
        # First test of the branch: the correction is short compared with the prediction.
        accepted &= _is_near(s, corrected - predicted, predicted - before)
        # Second test: the tangents at both ends are alike. Their difference is compared with the tangent or the way,
        # whichever is longer, since dependent coordinates may be nearly at rest. Where the difference moves them by
        # rounding only, it says nothing, and the step passes.
        largest_change, largest_tangent = (
            np.abs(x / s.coordinates[dependent]).max(axis=1) for x in (tangent_change, tangent[active])
        )
        accepted &= (largest_change * share <= MIN_COMPARED_STEP) | (
            largest_change <= MAX_TANGENT_TURN * np.maximum(largest_tangent, way_length[active])
        )
        # Third test: det(A_d(q)^T A_d(p)) > 0. A sample that does not move skips it: its start is inexact, and may be
        # on the other side of a singular position nearby.
        accepted &= ~(moves[active, 0] & loop_assembly.crosses_singularity(A[active], A_corrected))
        # Where all tests pass, the next step begins at the new position, with the tangent there.
        done = active[accepted]
        q[done], A[done], squared_conditions[done] = corrected[accepted], A_corrected[accepted], measures[accepted, 1]
        tangent[done] += tangent_change[accepted]
        remaining[done] -= share[accepted]
        # The next step is twice as long after success, half as long after failure. A sample that does not move has no
        # shorter step to try: 0 gives it up below.
        next_share[active] = np.where(accepted, 2 * share, np.where(moves[active, 0], share / 2, 0))
        # Give up where even the shortest step failed, or where a sample that does not move did not close.
        stuck = active[~accepted & (next_share[active] < MIN_CONTINUATION_STEP * remaining[active])]
        if len(stuck) > 0:
            raise _closing_error(m, s, q[stuck[0]], u[stuck[0]], _sample_label(stuck[0], len(u)))
        active = np.flatnonzero(remaining)
    return q, A, squared_conditions


def _iterate_newton(m: Mechanism, q: np.ndarray, step: NewtonStep) -> tuple[np.ndarray, np.ndarray]:
    """Close loops by Newton's method, with the independent coordinates held.

    Return the coordinates (k, N), and (k,) which of them close the loops. Samples leave the iteration one by one. A
    regular one takes a last step from where it is closed; any other goes on while its gap falls.
    """
    c, no_change = closure_of(m), np.zeros(m.n)
    dependent, limit = np.array(c.dependent), max_gap(m)
    q, closed, smallest = q.copy(), np.zeros(len(q), dtype=bool), np.full(len(q), np.inf)
    active = np.arange(len(q))
    for _ in range(MAX_CLOSURE_STEPS):
        # The measures of a step are those of the position before it: a position is judged by the step that leaves it.
        stepped, measures, _ = step(q[active], no_change)
        squared_gap, squared_condition = measures[:, 0], measures[:, 1]
        improves = squared_gap < smallest[active]
        smallest[active] = np.minimum(squared_gap, smallest[active])
        closed[active] = smallest[active] <= limit
        # Take the step, which squares the gap, where the last one made the gap smaller. Where loops are closed and A_d
        # is nearly singular, a step would only amplify rounding.
        is_regular = squared_condition <= loop_assembly.MIN_INVERSE_CONDITION**-2
        useful = improves & (~closed[active] | is_regular)
        q[active[useful, None], dependent] = stepped[useful]
        # Samples stay while their gap falls. A closed one has had its last step, which leaves rounding, unless its
        # condition is so large that one step from CLOSED_GAP leaves more.
        active = active[improves & ~(closed[active] & (squared_condition <= MAX_CONDITION_ESTIMATE**2))]
        if len(active) == 0:
            break
    return q, closed


def _is_near(s: Scales, correction: np.ndarray, prediction: np.ndarray) -> np.ndarray:
    """Return whether corrections (k, N) are short compared with predictions (k, N).

    Both are changes of q. A longer correction may have led to another branch.
    """
    deviation, length = (np.abs(x / s.coordinates).max(axis=1) for x in (correction, prediction))
    allowed = np.maximum(MAX_CORRECTION_RATIO * length, MIN_COMPARED_STEP)
    # Without a prediction the sample does not move: its loops are closed, as far as Newton's method can be trusted to
    # stay on the branch of the start.
    return np.asarray(deviation <= np.where(length > 0, allowed, MAX_DIRECT_CORRECTION))


def _check_followers(m: Mechanism, start: np.ndarray, u: np.ndarray) -> None:
    """Raise `JounceError` where followers of a start are on another branch.

    On the branch of the robot the ratios give the positions of followers. Where a start (k, N) states other ones and
    its loops are closed, it is on another branch, which the ratios do not describe; where they are open, it is inexact.
    """
    c, s = closure_of(m), scales(m)
    independent, followers = list(c.independent), list(c.ratios.places)
    offsets = (start[:, followers] - c.ratios.positions(u)) / s.coordinates[followers]
    largest = np.abs(offsets).max(axis=1)
    # Only a start with the wanted u says where followers are to be at u; any other one says where they begin.
    deviating = np.flatnonzero((largest > FOLLOWER_PLACE_TOLERANCE) & (start[:, independent] == u).all(axis=1))
    if m.loops:
        gaps = np.abs(loop_assembly.gaps(m, start[deviating])[0] * s.rows).max(axis=1)
    else:
        # Without loops nothing is open: any other position counts as another branch.
        gaps = 0 * largest[deviating]
    other_branch = deviating[gaps < MAX_OTHER_BRANCH_GAP * largest[deviating]]
    if len(other_branch) == 0:
        return
    # Name the follower that is farthest off in the first such sample.
    k, j = other_branch[0], np.abs(offsets[other_branch[0]]).argmax()
    name, start_value, value = c.coordinates[followers[j]], start[k, followers[j]], c.ratios.positions(u[k])[j]
    raise JounceError(
        f"{m.name!r}: {name} = {start_value:.4g}{_sample_label(int(k), len(u))} is on another branch; on that of the"
        f" start it follows {join_names(m.coordinates)} by constant ratios, to {value:.4g}; give {name} = {value:.4g}"
        f"{Remedy(', or robot.closed(start=...) with a start on the other branch') if m.loops else ''}"
    )


def _sample_label(k: int, count: int) -> str:
    return f" of sample {k}" if count > 1 else ""


def _closing_error(m: Mechanism, s: Scales, q: np.ndarray, u: np.ndarray, sample: str) -> JounceError:
    """Return the error for a sample that does not reach u.

    It came as far as q (N,) on its way to u (n,).
    """
    c = closure_of(m)
    independent = list(c.independent)
    # Ask why no step led on: Gauss-Newton steps of d from q, with u in place, show whether loops close there at all.
    trial = q.copy()
    trial[independent] = u
    [nearest], [gap] = loop_assembly.minimize_gaps(m, s, trial[None], list(c.dependent))
    closes = gap <= CLOSED_GAP
    if (q[independent] == u).all():
        # The start had these independent coordinates: the caller stated all coordinates, and they do not close. Say
        # which of them is farthest from where the loops close, if they do.
        distances = np.abs((nearest - q) / s.coordinates)
        joint = int(distances.argmax())
        worst_gap = loop_assembly.describe_worst_gap(m, s, q if closes else nearest)
        hint = f"; they close with {c.coordinates[joint]} = {nearest[joint]:.4g}, not {q[joint]:.4g}" if closes else ""
        return JounceError(
            f"{m.name!r} cannot be closed near the coordinates given{sample}: {worst_gap}{hint};"
            f" expected all {len(c.coordinates)} coordinates of the tree near positions in which loops are closed, or"
            f" {join_names(m.coordinates)} alone"
        )
    # The start was elsewhere: say how far the continuation came, and what stopped it.
    reached = ", ".join(f"{name} = {x:.4g}" for name, x in zip(m.coordinates, q[independent], strict=True))
    if closes:
        reason = "no straight line of the coordinates leads there"
    else:
        reason = loop_assembly.describe_worst_gap(m, s, nearest)
    return JounceError(
        f"{m.name!r} cannot be closed at q{sample}: {reason}; from the start it comes to {reached},"
        f" where 1/cond of the constraints is {loop_assembly.inverse_conditions(m, q[None])[0]:.2g}; expected q in the"
        f" workspace, or all {len(c.coordinates)} coordinates of the tree, near the wanted branch, in place of q"
    )


# Followers by constant ratios: they are found once, when a robot is closed.
def with_ratios(m: Mechanism) -> Mechanism:
    """Return a closed robot with its followers by constant ratios.

    It comes without ratios, and its start must be regular.
    """
    c, s, rng = closure_of(m), scales(m), np.random.default_rng(0)
    independent = list(c.independent)
    # At first every dependent coordinate may follow, by its row of F (N, n) at the start; `units` gives F its units.
    units = s.coordinates[:, None] / s.coordinates[independent]
    F = _tangent(m, c.start) * units
    follows = np.isin(range(len(F)), c.dependent)
    # The first position is near the start, where loops surely close: most robots show there already that they have no
    # such followers.
    compared, reach = 0, RATIO_SAMPLE_REACH / 16
    for _ in range(3 * RATIO_SAMPLES):
        u = c.start[independent] + rng.uniform(-reach, reach, m.n) * s.coordinates[independent]
        try:
            [q] = close_loops(m, u[None])
        except JounceError:
            # The position is out of the workspace: those nearer to the start serve as well.
            reach /= 4
            continue
        # Near a singular position F is off by eps cond, and constant rows would not be recognized. The root of the
        # usual limit keeps that error well below RATIO_TOLERANCE.
        A = loop_assembly.scaled_constraints(m, q[None])[..., c.dependent]
        if compute_inverse_conditions(A)[0] < np.sqrt(loop_assembly.MIN_SAMPLE_INVERSE_CONDITION):
            continue
        compared, reach = compared + 1, RATIO_SAMPLE_REACH
        # A follower has the same row of F as at the start, and has moved by it: d = d_0 + F_d (u - u_0).
        row_changes = np.abs((_tangent(m, q) * units - F) / units).max(axis=1)
        deviations = np.abs(q - c.start - F @ (u - c.start[independent])) / s.coordinates
        follows &= np.maximum(row_changes, deviations) <= RATIO_TOLERANCE
        if compared == RATIO_SAMPLES or not follows.any():
            break
    # Too few positions prove nothing: constraints are solved for all dependent coordinates then.
    if compared < RATIO_SAMPLES or not follows.any():
        return m
    places = np.flatnonzero(follows)
    F, units = F[places], units[places]
    # Ratios that are integers but for rounding, as of parallelograms, become integers: zeros among them cost nothing
    # where operations are recorded. Adding 0 turns -0 into 0.
    integers = np.rint(F / units)
    F = np.where(np.abs(F / units - integers) <= RATIO_TOLERANCE, integers * units + 0.0, F)
    ratios = FollowerRatios(tuple(places.tolist()), F, c.start[places] - F @ c.start[independent])
    return replace(m, closure=replace(c, ratios=ratios))


def _tangent(m: Mechanism, q: np.ndarray) -> np.ndarray:
    """Return F (N, n) at coordinates (N,), without units."""
    c = closure_of(m)
    return loop_assembly.tangent_map(loop_assembly.scaled_constraints(m, q[None])[0], c.independent, c.dependent)
