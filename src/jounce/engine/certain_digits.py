"""Decide which results have digits where small errors grow, by results at displaced inputs.

Near singular positions of closed robots, rounding leaves a gap of some eps where loops are closed, so that positions
are off by eps / sigma along the directions that the constraints hold least, sigma the singular values of A_d. At a
fold, where two branches end, relative errors are eps cond^2 at every order; at a change point, where branches cross,
those of the k-th rate of Q are eps cond^(k + 3). One threshold of the condition number serves neither. The estimate is
the difference to the results at the position moved by some eps / sigma along each.

Rates of accelerations lose digits where drives are steep for the inertia that they move. They follow one after the
other, q^(k+2) = M^-1 (Q^(k) - D q^(k+1) - K q^(k) - ...): damping D, and friction by its slope, makes errors grow by
M^-1 D with each of them, springs K by M^-1 K with each second one. Where that is 1000 / s, little of the fourth rate is
left. The estimate is the difference to the results of inputs that are moved by some eps.

The growth is bounded for all positions, once a robot (`drive_growth`, `plant_growth`): the kinetic energy T of a robot
is at least that of two neighbouring bodies alone, and this at least that with the inner one free in space. So 2 T >= J
theta'^2 at each joint, with the least J of two bodies that a joint moves against each other (the parallel sum of their
inertias along its screw). Thus qd^T D qd = sum d_i theta_i'^2 is at most 2 T sum d_i / J_i, and the eigenvalues of M^-1
D are at most that sum. Loops and joints that follow others leave less freedom, and the same bound. It is a bound, if
not a close one: where a joint moves no inertia of its own, it is infinite.

`compute_certain_results` is the door of each call, `check_digits` its comparison.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from jounce.core.cures import Remedy
from jounce.core.errors import UncertainError, join_names
from jounce.core.scalars import Array, is_jax, is_numeric, is_traced
from jounce.dynamics import joint_springs, loop_assembly
from jounce.dynamics.computation import Computation
from jounce.dynamics.loop_assembly import NewtonStep
from jounce.dynamics.loop_branches import scales
from jounce.dynamics.loops import closure_of
from jounce.model.drive_trains import LOAD_FRICTION, stated_terms
from jounce.model.loops import all_coordinates
from jounce.model.mechanism import Mechanism
from jounce.spatial import lie

_DOUBLE_EPS = float(np.finfo(float).eps)
_LOOP_GAP_EPS = (
    4  # eps, of closed loops: with 2 three of 18,000 results passed that were off by more than 1e-6, now 7e-7 at most
)
_MAX_ERROR = 1e-6  # of a result, relative to its size: a control loop's other errors are larger
# The growth of errors, 1/s, whose power for each rate and one more for accelerations leaves a thousandth of the bound:
# accelerations are differences of larger terms, of gravity and of forces that balance it.
_CANCELLATION = 1e3
_INPUT_EPS = 4  # eps, of inputs of accelerations: their rounding, and that of sums of terms as large
# How q, qd, Q, Qd, ... or q, qd, theta, thetad, tau move: terms that balance each other must not move alike.
_INPUT_WAYS = (-1.0, -0.5, 1.0, 0.5)
_QUIET = 0.1  # rad/s^k: what accelerations and their rates are compared with at least, as all vanish at rest
_SLOWEST = 0.01  # 1/s: rates below this part of lower ones count as that, as those of steady motions vanish


@dataclass(frozen=True)
class Doubt:
    """Why digits may be lost: inputs at which results are the same if rounding does no harm, and words for it."""

    inputs: Sequence[Sequence[Array]]
    cause: str
    cure: str


def max_condition(computation: Computation) -> float:
    """The condition number up to which no result can have an error above `_MAX_ERROR`: at a change point.

    An error eps cond of positions grows by cond with every rate of the dependent coordinates that the results hold, and
    results may vanish there as 1 / cond.
    """
    powers = computation.quantity.held_rates + computation.order + 2
    return float((_MAX_ERROR / _DOUBLE_EPS) ** (1 / powers))


def displace_dependent(
    m: Mechanism, u: Array, dependent: Array, limit: float, step: NewtonStep | None = None
) -> list[np.ndarray] | None:
    """The dependent coordinates moved by what rounding leaves open, where the condition number exceeds a limit.

    They are moved along all singular ways, as several loops may be nearly singular, and along the least one alone: the
    difference that one displacement makes may vanish by chance. None where the limit is exceeded nowhere, and for
    symbols.
    """
    c, s = closure_of(m), scales(m)
    if not (is_numeric(u) and is_numeric(dependent) and c.solved):
        return None
    q = all_coordinates(c, np.asarray(u, dtype=float), np.asarray(dependent, dtype=float)).reshape(
        -1, len(c.coordinates)
    )
    _, measures, A = (step or loop_assembly.numpy_step(m))(q, np.zeros(m.n))
    near = np.flatnonzero(measures[:, 1] > limit**2)  # an estimate of the condition number, which takes longer
    if not len(near):
        return None
    _, sizes, ways = np.linalg.svd(A[near])
    near, sizes, ways = (x[sizes[:, 0] > limit * sizes[:, -1]] for x in (near, sizes, ways))
    if not len(near):
        return None
    eps = np.finfo(dependent.dtype).eps
    solved = np.searchsorted(c.dependent, c.solved)
    off = _LOOP_GAP_EPS * eps * ways / sizes[..., None] * s.coordinates[list(c.solved)]
    found = []
    for way in (off.sum(axis=-2), off[:, -1]):
        moved = dependent.reshape(len(q), -1).copy()
        moved[np.ix_(near, solved)] += way
        found.append(moved.reshape(dependent.shape))
    return found


def describe_uncertain(m: Mechanism, names: Sequence[str], times: Iterable[np.ndarray], count: int) -> str:
    """How many of the rows along a motion have results without certain digits, and when, in words."""
    parts = [
        f"{name} in {len(t)} of {count} rows, t = {t.min():.6g}{f' .. {t.max():.6g}' if len(t) > 1 else ''} s"
        for name, t in zip(names, times, strict=True)
        if len(t)
    ]
    return (
        f"{m.name!r}: the loops are so nearly singular that results have errors above {_MAX_ERROR:g} of their"
        f" size, and are NaN: {'; '.join(parts)}"
    )


Results = tuple[np.ndarray, ...]


def may_be_lost(m: Mechanism, asked: Computation) -> bool:
    """Whether digits of results may be lost: near singular positions of closed robots, or where drives are steep."""
    return m.closure is not None or is_steep(m, asked)


def is_steep(m: Mechanism, asked: Computation) -> bool:
    """Whether drives may make errors of accelerations, or of their rates, exceed `_MAX_ERROR` of their size."""
    row, e = asked.quantity, m.elasticity
    if not (row.inverts or row.are_accelerations) or not m.is_numeric:
        return False
    if row.takes.motors and e and not all(map(is_numeric, e.arrays.values())):
        return False
    growth = plant_growth(m) if row.takes.motors else drive_growth(m) ** (asked.order + 1)
    return growth > _MAX_ERROR / (_CANCELLATION * _DOUBLE_EPS)


def displace_inputs(m: Mechanism, asked: Computation, arrays: Sequence[Array]) -> list[Array]:
    """Arrays of a computation with the state, and the forces or the motors, moved by what rounding leaves open."""
    moved = list(arrays)
    for k, x in enumerate(arrays[: asked.rates]):
        size = np.abs(x)
        if k == 0 and "spring" in m.acting and m.closure is None and x.shape[-1] == m.n:
            size = size + np.abs(m.drives.rest) @ np.abs(m.G)  # springs are as exact as what they are deflected from
        moved[k] = x + _INPUT_WAYS[k % len(_INPUT_WAYS)] * _INPUT_EPS * np.finfo(x.dtype).eps * size
    return moved


def _numbers(arrays: Sequence[Array]) -> list[np.ndarray] | None:
    """Arrays of NumPy, of those of JAX in double precision; None if there are symbols among them."""
    if any(is_traced(x) or not (is_jax(x) or is_numeric(x)) for x in arrays):
        return None
    return [np.asarray(x, dtype=float) if is_jax(x) else x for x in arrays]


def _least_sizes(m: Mechanism, asked: Computation, arrays: Sequence[Array], results: Results) -> list[Array]:
    """What each result is compared with at least: accelerations and their rates vanish at rest, and along with others.

    Coordinates in m count by the length of the robot.
    """
    if not asked.quantity.are_accelerations:
        return [0.0] * len(results)
    placed = np.linalg.norm(m.B[:, :3, 3], axis=1)
    unit = 1.0 if m.X[:, :3].any() else float(placed.max())
    rate, found = np.abs(arrays[1]).max(axis=-1, keepdims=True, initial=0.0), []
    for x in results:
        found.append(np.maximum(_QUIET * unit, _SLOWEST * rate))
        rate = np.fmax(rate, np.abs(x).max(axis=-1, keepdims=True, initial=0.0))
    return found


def compute_certain_results(
    m: Mechanism,
    asked: Computation,
    names: Sequence[str],
    arrays: Sequence[Array],
    run: Callable[[Sequence[Array]], Results],
    step: NewtonStep | None = None,
) -> Results | None:
    """Results from the arrays of a computation, checked; None where no digits can be lost.

    Those are trees without steep drives, and closed robots at regular positions.

    Raises
    ------
    UncertainError : where results at displaced inputs differ by more than `_MAX_ERROR` of their size.
    """
    doubts = []
    moved = displace_dependent(m, arrays[0], arrays[-1], max_condition(asked), step) if m.closure else None
    if moved is not None:
        cause = "the loops are nearly singular there"
        doubts.append(Doubt([[*arrays[:-1], x] for x in moved], cause, "expected q farther away"))
    numbers = _numbers(arrays) if is_steep(m, asked) else None
    if numbers is not None:
        cause = "damping, friction or springs are steep for the inertia that they move"
        fewer = Remedy("robot.with_drives([...])", "--drives")
        cure = f"let fewer drive terms act, {fewer}, or state a larger armature or rotor"
        doubts.append(Doubt([displace_inputs(m, asked, numbers)], cause, cure))
    if not doubts:
        return None
    results = run(arrays)
    own = run(numbers) if numbers is not None and any(map(is_jax, arrays)) else results
    least = _least_sizes(m, asked, numbers, own) if numbers is not None else [0.0] * len(own)
    others = [(doubt, [run(x) for x in doubt.inputs]) for doubt in doubts]
    check_digits(m, asked, names, own, least, others)
    return results


def check_digits(
    m: Mechanism,
    asked: Computation,
    names: Sequence[str],
    results: Results,
    least: Sequence[Array],
    others: Sequence[tuple[Doubt, Sequence[Results]]],
) -> None:
    """Compare results with those at displaced inputs.

    `least` are the sizes that results have at least, as arrays that broadcast with them.

    Raises
    ------
    UncertainError : where they differ by more than `_MAX_ERROR` of their size.
    """
    axes = len(asked.shape(m))
    errors, uncertain, kept, causes, own = [0.0], [], [], [], tuple(range(-axes, 0))
    for k, x in enumerate(results):
        size = np.maximum(np.abs(x).max(axis=own, keepdims=True), least[k])
        known, bad = np.isfinite(size), np.zeros(size.shape, dtype=bool)  # those of missing numbers are missing
        for doubt, moved in others:
            with np.errstate(all="ignore"):
                off = np.max([np.abs(y[k] - x).max(axis=own, keepdims=True) for y in moved], axis=0)
                lost = known & ~(off <= _MAX_ERROR * size)
                errors.append(float(np.max(off / size, where=lost, initial=0.0)))
            causes += [doubt] if lost.any() else []
            bad |= lost
        kept.append(np.where(bad, np.nan, x))
        uncertain.append(bad.reshape(bad.shape[: bad.ndim - axes]))
    if not causes:
        return
    lacking = [name for name, where in zip(names, uncertain, strict=True) if where.any()]
    good = [name for name in names if name not in lacking and not asked.quantity.gives.results]
    states = np.logical_or.reduce([x.ravel() for x in uncertain])
    which = f" of {states.sum()} of {states.size} samples, first {states.argmax()}," if states.size > 1 else ""
    cure = f"; {join_names(good)} {'is' if len(good) == 1 else 'are'} certain there: give fewer rates" if good else ""
    raise UncertainError(
        f"{m.name!r}: {join_names(lacking)} at q{which} would be off by up to {max(errors):.2g} of the size, since"
        f" {' and '.join(dict.fromkeys(doubt.cause for doubt in causes))}; expected an error below {_MAX_ERROR:g}"
        f"{cure or f'; {causes[0].cure}'}",
        tuple(kept),
        names,
        uncertain,
    )


TURNS = np.linspace(0, 2 * np.pi, 8, endpoint=False)  # positions of a joint: J changes by sines of one and two turns
TURN_MARGIN = 2  # by which J may be smaller between them


@lru_cache(maxsize=64)
def drive_growth(m: Mechanism) -> float:
    """A bound of the factor, 1/s, by which errors grow with each rate of q, by the drive terms that act."""
    terms = set(m.acting) & set(stated_terms(m.drives))
    if LOAD_FRICTION in terms:
        return np.inf  # its slope goes with the load
    d, slope, stiffness = m.drives, np.zeros(len(m.joints)), np.zeros(len(m.joints))
    if "damping" in terms:
        slope = slope + d.damping
    if "friction" in terms:
        slope = slope + d.friction / d.eps
    if "stribeck" in terms:
        slope = slope + d.stribeck * (1 / d.eps + 1 / d.stribeck_velocity)
    if "spring" in terms:
        stiffness = np.abs(d.stiffness)
    if not (slope.any() or stiffness.any()):
        return 0.0
    J = least_inertias(m)
    return _sum_of_ratios(slope, J) + float(np.sqrt(_sum_of_ratios(stiffness, J)))


@lru_cache(maxsize=64)
def plant_growth(m: Mechanism) -> float:
    """A bound of the factor by which errors of the positions and torques of motors behind springs are accelerations.

    1/s^2: of links, K over what they resist; of motors, K and the slope of their friction over their rotors.
    """
    e, J = joint_springs.elasticity_of(m), least_inertias(m)
    if any(law is not None for law in e.springs) or e.level is not None:
        return np.inf  # the stiffness goes with the deflection, or inertias are shared
    places = range(m.n) if m.closure is None else m.closure.independent
    alone = np.count_nonzero(m.tree.G, axis=1) == 1  # joints that one coordinate moves
    G = m.tree.G[:, list(places)] * alone[:, None]
    links = (G**2 * J[:, None]).max(axis=0)
    soft = ~e.is_rigid
    motors = e.stiffness[soft] + e.viscous[soft] + e.friction[soft] / e.eps[soft]
    return _sum_of_ratios(e.stiffness[soft], links[soft]) + _sum_of_ratios(motors, e.rotor[soft])


def least_inertias(m: Mechanism) -> np.ndarray:
    """The least inertia, (joints,), that resists each joint at any position, with its rotor where that acts.

    Zero of joints of several screws that a body carries, and of all whose body resists nothing.
    """
    tree = m.tree
    rotors, found = m.drives.armature * ("armature" in m.acting), np.zeros(len(tree.joints))
    roots = [_root(M) for M in tree.M]
    for i, columns in enumerate(tree.columns):
        places, parent = list(columns), tree.parent[i]
        X = tree.X[places].T
        if parent < 0:
            found[places] = np.linalg.eigvalsh(X.T @ tree.M[i] @ X)[:1]
        elif len(places) == 1:
            poses = [tree.B[i] @ lie.exp(X[:, 0], np.full((1, 1), phi)) for phi in TURNS]
            found[places] = min(_parallel_sum(roots[i], roots[parent] @ lie.Ad(C), X) for C in poses) / TURN_MARGIN
    return found.clip(0) + rotors


def _root(M: np.ndarray) -> np.ndarray:
    """L of L^T L = M."""
    sizes, ways = np.linalg.eigh(M)
    return np.sqrt(sizes.clip(0))[:, None] * ways.T


def _parallel_sum(outer: np.ndarray, inner: np.ndarray, X: np.ndarray) -> float:
    """The least (V + X)^T M (V + X) + V^T N V over all twists V, of M and N by their roots: least squares."""
    rows, moved = np.concatenate([outer, inner]), np.concatenate([outer @ X, 0 * X])
    V = np.linalg.lstsq(rows, -moved)[0]
    return float(((rows @ V + moved) ** 2).sum())


def _sum_of_ratios(forces: np.ndarray, inertias: np.ndarray) -> float:
    """The sum of forces over inertias; infinite where one acts on no inertia."""
    acts = forces > 0
    with np.errstate(divide="ignore", over="ignore"):
        return float((forces[acts] / inertias[acts]).sum())
