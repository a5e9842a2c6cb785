"""Positions of closed robots: the dependent coordinates for which the loops close, by Newton's method, on numbers.

Loops close in several ways, called branches. Positions are continued from a start along a straight line of the
independent coordinates, in steps that the tangent predicts well: the start decides on the branch, and samples of a
batch do not depend on each other.
"""

from functools import lru_cache

import numpy as np

from jounce.dynamics import newton
from jounce.dynamics.assembly import LOST, crossing, inverse_conditions, least_gaps, scaled_constraints, worst_gap
from jounce.dynamics.loops import closure_of
from jounce.dynamics.newton import CLOSED, NEAR, Scales, Step, scales
from jounce.errors import JounceError, listed
from jounce.model.mechanism import Mechanism

SUSPECT = 1e5  # bound of the condition number from which on singular values are computed
CLOSE = 1e2  # of that bound from which on other branches may be near
ITERATIONS = 20
STEP = 0.25  # rad or sizes of the robot, of a continuation
SHORTEST = 1e-4  # of the way from the start: shorter steps tell that there is no way


@lru_cache(maxsize=64)
def most(m: Mechanism) -> tuple[float, float]:
    """The measures of a step up to which loops are closed, and surely not singular."""
    return sum(len(loop.rows) for loop in m.loops) * CLOSED**2, SUSPECT**2


def close_loops(m: Mechanism, u: np.ndarray, start: np.ndarray | None = None, step: Step | None = None) -> np.ndarray:
    """The coordinates (k, N) of the tree where the loops are closed, from the independent ones (k, n).

    They are continued along a straight line from a start, (k, N) or (N,), by default that of the closure; where it has
    these independent coordinates already, its loops need be nearly closed only. `step` is `newton.step` of the robot,
    by default in NumPy.

    Raises
    ------
    JounceError : where the loops cannot be closed, or constraints are lost.
    """
    c = closure_of(m)
    start = np.broadcast_to(c.start if start is None else start, (len(u), len(c.coordinates)))
    q, bounds = _continued(m, u, start, step or newton.step_of_arrays(m))
    if (bounds > SUSPECT**2).any():
        found = inverse_conditions(m, q, c.dependent)
        if (found < LOST).any():
            worst = int(np.nanargmin(found))
            raise _singular(m, found[worst], _sample(worst, len(q)))
    return q


def _continued(m: Mechanism, u: np.ndarray, start: np.ndarray, step: Step) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates with closed loops, continued from a start, and the measures of their conditions."""
    c, s = closure_of(m), scales(m)
    own, others = list(c.independent), np.array(c.dependent)
    q, bounds = np.array(start, dtype=float), np.zeros(len(u))
    left = (np.isfinite(u).all(axis=1) & np.isfinite(q).all(axis=1)) * 1.0  # the share of the way that is left
    q[left == 0] = np.nan  # as all results are that depend on missing numbers
    way = u - q[:, own]
    size = np.minimum(1.0, STEP / np.maximum(np.abs(way / s.coordinates[own]).max(axis=1, initial=STEP), STEP))
    while len(k := np.flatnonzero(left)):
        share, before = np.minimum(size[k], left[k]), q[k]
        moved = way[k] * share[:, None]
        predicted = before.copy()
        moves = moved.any(axis=1)
        if moves.any():
            predicted[np.ix_(moves, others)] = step(before[moves], moved[moves])[0]
        predicted[:, own] = u[k] - way[k] * (left[k] - share)[:, None]
        found, good, bound = _newton(m, predicted, step)
        good &= _is_near(s, found - predicted, predicted - before)
        if len(close := np.flatnonzero(good & moves & (bound > CLOSE**2))):
            A, B = (scaled_constraints(m, x[close])[..., c.dependent] for x in (before, found))
            good[close] &= ~crossing(A, B)
        q[k[good]], bounds[k[good]] = found[good], bound[good]
        left[k[good]] -= share[good]
        size[k] = np.where(good, 2 * share, np.where(moves, share / 2, 0))  # no shorter way helps where there is none
        if len(stuck := k[~good & (size[k] < SHORTEST)]):
            raise _not_closed(m, s, q[stuck[0]], u[stuck[0]], _sample(stuck[0], len(u)))
    return q, bounds


def _newton(m: Mechanism, q: np.ndarray, step: Step) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Coordinates (k, N) with dependent ones found by Newton's method, whether loops are closed, and their conditions.

    Samples leave the iteration one by one: where they are closed, or where their gaps stay as they are.
    """
    c, still = closure_of(m), np.zeros(m.n)
    others, limit = np.array(c.dependent), most(m)[0]
    q, good, least, bounds = q.copy(), np.zeros(len(q), dtype=bool), np.full(len(q), np.inf), np.zeros(len(q))
    k = np.arange(len(q))
    for _ in range(ITERATIONS):
        found, measures = step(q[k], still)
        gap, better = measures[:, 0], measures[:, 0] < least[k]
        least[k], bounds[k] = gap, measures[:, 1]
        closed = gap <= limit
        good[k] = closed
        useful = np.where(closed, measures[:, 1] <= SUSPECT**2, better)  # of closed ones, none that rounding makes
        q[np.ix_(k[useful], others)] = found[useful]
        k = k[better & ~closed]
        if not len(k):
            break
    return q, good, bounds


def _is_near(s: Scales, bent: np.ndarray, straight: np.ndarray) -> np.ndarray:
    """Whether a step ended near where its tangent pointed: else it may have come to another branch."""
    far, long = (np.abs(x / s.coordinates).max(axis=1) for x in (bent, straight))
    return np.asarray(far <= np.where(long > 0, np.maximum(0.3 * long, 1e-6), NEAR))


def _sample(k: int, count: int) -> str:
    return f" of sample {k}" if count > 1 else ""


def _not_closed(m: Mechanism, s: Scales, q: np.ndarray, u: np.ndarray, sample: str) -> JounceError:
    c = closure_of(m)
    own = list(c.independent)
    trial = q.copy()
    trial[own] = u
    [found], [off] = least_gaps(m, s, trial[None], list(c.dependent))
    if (q[own] == u).all():  # all coordinates were given
        far = np.abs((found - q) / s.coordinates)
        joint = int(far.argmax())
        closes = f"they close with {c.coordinates[joint]} = {found[joint]:.4g}, not {q[joint]:.4g}"
        gap = worst_gap(m, s, q if off <= CLOSED else found)
        return JounceError(
            f"{m.name!r} cannot be closed near the coordinates given{sample}: {gap}"
            f"{'; ' + closes if off <= CLOSED else ''}; expected all {len(c.coordinates)} coordinates of the tree near"
            f" positions in which loops are closed, or {listed(m.coordinates)} alone"
        )
    at = ", ".join(f"{name} = {x:.4g}" for name, x in zip(m.coordinates, q[own], strict=True))
    gap = "no straight line of the coordinates leads there" if off <= CLOSED else worst_gap(m, s, found)
    return JounceError(
        f"{m.name!r} cannot be closed at q{sample}: {gap}; from the start it comes to {at},"
        f" where 1/cond of the constraints is {inverse_conditions(m, q[None], c.dependent)[0]:.2g}; expected q in the"
        f" workspace, or all {len(c.coordinates)} coordinates of the tree, near the wanted branch, in place of q"
    )


def _singular(m: Mechanism, inverse_cond: float, sample: str) -> JounceError:
    return JounceError(
        f"{m.name!r}: constraints are lost at q{sample}, where 1/cond is {inverse_cond:.2g}, expected {LOST:g} or"
        f" more: {listed(m.coordinates)} do not determine the other joints there, or with few digits"
    )
