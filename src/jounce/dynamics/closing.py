"""Positions of closed robots: the dependent coordinates for which the loops close, by Newton's method, on numbers.

Loops close in several ways, called branches. Positions are continued from a start along a straight line of the
independent coordinates, in steps that the tangent predicts well: the start decides on the branch, and samples of a
batch do not depend on each other.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from jounce.dynamics.loops import closure_of, constraints, views
from jounce.errors import JounceError, listed
from jounce.model.loops import Loop
from jounce.model.mechanism import Mechanism
from jounce.spatial.lie import inverse, position, rotation, to_quaternion
from jounce.spatial.series import columns

CLOSED = 1e-13  # of a gap, relative to the size of the robot: rounding leaves less
ROUNDING = 1e-16  # of a gap that nothing can make smaller
SINGULAR = 1e-8  # of the smallest singular value of the constraints, relative to the largest
ITERATIONS = 20
STEP = 0.25  # rad or sizes of the robot, of a continuation
SHORTEST = 1e-4  # of the way from the start: shorter steps tell that there is no way


@dataclass(frozen=True)
class Scales:
    """Lengths that make gaps and constraints numbers without units."""

    length: float
    rows: np.ndarray  # (c,)
    coordinates: np.ndarray  # (N,)


def scales(m: Mechanism) -> Scales:
    """The scales of a mechanism with loops."""
    closure = closure_of(m)
    placed = [m.B[:, :3, 3], *(frame.T[None, :3, 3] for loop in m.loops for frame in (loop.a, loop.b))]
    length = float(max(1e-9, *np.linalg.norm(np.concatenate(placed).astype(float), axis=1)))
    slides = np.concatenate([[*[False] * len(x.held[0]), *[True] * len(x.held[1])] for x in m.loops])
    turning = np.abs(closure.G.T).astype(float) @ m.X[:, :3].any(axis=1) > 0
    return Scales(length, np.where(slides, 1 / length, 1.0), np.where(turning, 1.0, length))


def gaps(m: Mechanism, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How far loops are from closed (k, c), and the constraints A (k, c, N), at coordinates (k, N) of the tree."""
    seen = views(m, columns([q]))
    found = [_gap(loop, seen[loop.a.body].poses[loop.b.body]) for loop in m.loops]
    A = constraints(m, seen)[0]
    return np.concatenate(found, axis=-1), A.astype(float)


def _gap(loop: Loop, seen: np.ndarray) -> np.ndarray:
    """The turns and slides that a cut joint would have to allow, (k, c)."""
    turns, slides = loop.held
    C = inverse(loop.a.T) @ seen @ loop.b.T
    R, axis = rotation(C), np.asarray(loop.axis, dtype=float)
    if len(turns) == 3:
        turned = 2 * to_quaternion(R)[..., 1:] @ turns.T
    else:  # where the axes point in opposite directions, a large turn is due
        turned = np.cross(axis, R @ axis) @ turns.T
        turned = np.where((R @ axis @ axis < 0)[..., None], np.eye(1, len(turns)) * 2, turned)
    return np.concatenate([turned, position(C)[..., 0] @ slides.T], axis=-1)


def closed(m: Mechanism, u: np.ndarray, start: np.ndarray) -> np.ndarray:
    """The coordinates (k, N) of the tree where the loops are closed, from the independent ones (k, n) and a start.

    Raises
    ------
    JounceError : where the loops cannot be closed, or constraints are lost.
    """
    c, s = closure_of(m), scales(m)
    own, others = list(c.independent), list(c.dependent)
    q = np.array(np.broadcast_to(start, (len(u), len(c.coordinates))), dtype=float)
    left = np.isfinite(u).all(axis=1) * 1.0  # the share of the way that is left
    q[left == 0] = np.nan  # as all results are that depend on missing numbers
    way = u - q[:, own]
    step = np.minimum(1.0, STEP / np.maximum(np.abs(way / s.coordinates[own]).max(axis=1, initial=STEP), STEP))
    while len(k := np.flatnonzero(left)):
        share = np.minimum(step[k], left[k])
        moved = way[k] * share[:, None]
        predicted = q[k]
        predicted[:, others] += _least(s, gaps(m, q[k])[1], moved, own, others)
        predicted[:, own] = u[k] - way[k] * (left[k] - share)[:, None]
        found, off = _newton(m, s, predicted, others)
        good = (off <= CLOSED) & _is_near(s, found - predicted, predicted - q[k])
        q[k[good]] = found[good]
        left[k[good]] -= share[good]
        step[k] = np.where(good, 2 * share, share / 2)
        if len(stuck := k[~good & (step[k] < SHORTEST)]):
            raise _not_closed(m, s, q[stuck[0]], u[stuck[0]], _sample(stuck[0], len(u)))
    inverse_cond = inverse_conditions(m, q, others)
    if (inverse_cond < SINGULAR).any():
        worst = int(np.nanargmin(inverse_cond))
        raise _singular(m, inverse_cond[worst], _sample(worst, len(u)))
    return q


def refined(m: Mechanism, u: np.ndarray, q: np.ndarray) -> np.ndarray:
    """The coordinates (k, N) of the tree, from those for rounded u, with loops closed to the precision of u (k, n)."""
    c, s, q = closure_of(m), scales(m), q.astype(u.dtype)
    q[:, list(c.independent)], others = u, list(c.dependent)
    for _ in range(2):
        gap, A = gaps(m, q)
        q[:, others] += _solved(s, A, -gap, others)
    return q


def samples(m: Mechanism, count: int) -> np.ndarray:
    """Coordinates (count, N) of the tree at random places around the start, with loops closed; the start comes first.

    They differ by about a radian, or the size of the robot, where the loops allow it.
    """
    c, s, rng = closure_of(m), scales(m), np.random.default_rng(0)
    F = tangent(scaled_constraints(m, c.start[None])[0], c.independent, c.dependent)
    found, size = c.start[None], 1.0
    while len(found) < count:
        moved = rng.uniform(-size, size, (count, m.n)) @ F.T * s.coordinates
        q, off = _newton(m, s, c.start + moved, range(len(c.coordinates)))
        near = np.abs((q - c.start) / s.coordinates).max(axis=1) < 3 * size
        good = near & (off <= CLOSED) & (inverse_conditions(m, q, c.dependent) >= SINGULAR)
        found, size = np.concatenate([found, q[good]]), size * 0.7
    return found[:count]


def inverse_conditions(m: Mechanism, q: np.ndarray, free: Sequence[int]) -> np.ndarray:
    """1 / cond, (k,), of the constraints of some coordinates (k, N): zero where these do not follow the others."""
    finite = np.isfinite(q).all(axis=1)
    A = scaled_constraints(m, q[finite])[..., free]
    sizes = np.linalg.svd(A, compute_uv=False)
    found = np.full(len(q), np.nan)
    found[finite] = sizes[:, -1] / sizes[:, 0] if A.shape[-2] >= len(free) else 0.0
    return found


def scaled_constraints(m: Mechanism, q: np.ndarray) -> np.ndarray:
    """The constraints (k, c, N) at coordinates (k, N), of numbers without units."""
    s = scales(m)
    return np.asarray(s.rows[:, None] * gaps(m, q)[1] * s.coordinates)


def undetermined(A: np.ndarray, dependent: Sequence[int]) -> np.ndarray:
    """Which dependent coordinates can move while the others are held."""
    _, sizes, ways = np.linalg.svd(A[:, list(dependent)])
    rank = (sizes > SINGULAR * sizes.max(initial=0.0)).sum()
    return np.asarray((np.abs(ways[rank:]) > 1e-6).any(axis=0))


def tangent(A: np.ndarray, own: Sequence[int], dependent: Sequence[int]) -> np.ndarray:
    """F (N, n) at constraints without units."""
    F = np.zeros((A.shape[1], len(own)))
    F[list(own)] = np.eye(len(own))
    F[list(dependent)] = -np.linalg.pinv(A[:, list(dependent)]) @ A[:, list(own)]
    return F


def assembled(m: Mechanism, start: np.ndarray) -> np.ndarray:
    """The configuration (N,) near a start in which the loops are closed.

    The independent coordinates stay if they can; else all move, as little as possible.

    Raises
    ------
    JounceError : if there is no such configuration nearby.
    """
    s, q = scales(m), np.array(start, dtype=float)[None]
    found, off = _newton(m, s, q, list(closure_of(m).dependent))
    if off[0] <= CLOSED and _is_near(s, found - q, 0 * q)[0]:  # the independent ones can stay
        return np.asarray(found[0])
    everything = range(q.shape[1])
    for _ in range(10 * ITERATIONS):  # shorter steps far away, as Newton's do not lead there
        gap, A = gaps(m, q)
        if (np.abs(gap * s.rows) <= 0.1).all():
            break
        change = _solved(s, A, -gap, everything)
        q = q + change * min(1.0, 0.3 / max(np.abs(change / s.coordinates).max(), 1e-300))
    q, off = _newton(m, s, q, everything)
    if off[0] > CLOSED:
        raise JounceError(
            f"{m.name!r}: {_worst_gap(m, s, q[0])}; the loops cannot be closed from this start; give start=, joint"
            " positions near a configuration in which they are closed"
        )
    return np.asarray(q[0])


def _worst_gap(m: Mechanism, s: Scales, q: np.ndarray) -> str:
    """Which loop is open, and how far, in words."""
    gap = gaps(m, q[None])[0][0]
    sizes = [len(loop.rows) for loop in m.loops]
    parts = np.split(gap * s.rows, np.cumsum(sizes)[:-1])
    worst = int(np.argmax([np.abs(part).max() for part in parts]))
    loop = m.loops[worst]
    turns = len(loop.held[0])
    own = np.split(gap, np.cumsum(sizes)[:-1])[worst]
    return f"loop {loop.name} is open by {np.linalg.norm(own[turns:]):.3g} m and {np.linalg.norm(own[:turns]):.3g} rad"


def _sample(k: int, count: int) -> str:
    return f" of sample {k}" if count > 1 else ""


def _not_closed(m: Mechanism, s: Scales, q: np.ndarray, u: np.ndarray, sample: str) -> JounceError:
    c = closure_of(m)
    trial = q.copy()
    trial[list(c.independent)] = u
    trial, _ = _newton(m, s, trial[None], list(c.dependent))
    at = ", ".join(f"{name} = {x:.4g}" for name, x in zip(m.coordinates, q[list(c.independent)], strict=True))
    return JounceError(
        f"{m.name!r} cannot be closed at q{sample}: {_worst_gap(m, s, trial[0])}; from the start it comes to {at},"
        f" where 1/cond of the constraints is {inverse_conditions(m, q[None], c.dependent)[0]:.2g}; give all"
        f" {len(c.coordinates)} coordinates of the tree, near the wanted branch, in place of q"
    )


def _singular(m: Mechanism, inverse_cond: float, sample: str) -> JounceError:
    return JounceError(
        f"{m.name!r}: constraints are lost at q{sample}, where 1/cond is {inverse_cond:.2g}, expected {SINGULAR:g} or"
        f" more: {listed(m.coordinates)} do not determine the other joints there"
    )


def _least(s: Scales, A: np.ndarray, moved: np.ndarray, own: Sequence[int], free: Sequence[int]) -> np.ndarray:
    """How some coordinates move, (k, free), to hold the constraints where others do."""
    return _solved(s, A, -(A[..., own] @ moved[..., None])[..., 0], free)


def _solved(s: Scales, A: np.ndarray, gap: np.ndarray, free: Sequence[int]) -> np.ndarray:
    """The least motion of some coordinates, (k, free), that makes a change (k, c)."""
    scaled = s.rows[:, None] * A[..., free] * s.coordinates[free]
    return (np.linalg.pinv(scaled, rcond=1e-12) @ (gap * s.rows)[..., None])[..., 0] * s.coordinates[free]


def _is_near(s: Scales, bent: np.ndarray, straight: np.ndarray) -> np.ndarray:
    """Whether a step ended near where its tangent pointed: else it may have come to another branch."""
    far, long = (np.abs(x / s.coordinates).max(axis=1) for x in (bent, straight))
    return np.asarray(far <= np.where(long > 0, np.maximum(0.3 * long, 1e-6), 0.5))


def _newton(m: Mechanism, s: Scales, q: np.ndarray, free: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates (k, N) with loops closed by moving some of them, and the gaps that are left, relative."""
    best, least = q, np.full(len(q), np.inf)
    for _ in range(ITERATIONS):
        gap, A = gaps(m, q)
        off = np.abs(gap * s.rows).max(axis=-1)
        better = off < least
        best, least = np.where(better[:, None], q, best), np.where(better, off, least)
        if not (better & (off > ROUNDING)).any():
            break
        q = q.copy()
        q[:, free] += _solved(s, A, -gap, free)
    return best, least
