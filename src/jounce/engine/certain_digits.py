"""Decide which results have certain digits, by results at displaced inputs.

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
# eps, of closed loops: with 2 three of 18,000 results passed that were off by more than 1e-6, now 7e-7 at most.
_LOOP_GAP_EPS = 4
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
    """Return the condition number up to which digits are certain.

    No error is above `_MAX_ERROR` up to there, even at change points. An error eps cond of positions grows by cond
    with every rate of the dependent coordinates that the results hold, and results may vanish there as 1 / cond.
    """
    # eps cond^powers = _MAX_ERROR.
    powers = computation.quantity.held_rates + computation.order + 2
    return float((_MAX_ERROR / _DOUBLE_EPS) ** (1 / powers))


def displace_dependent(
    m: Mechanism, u: Array, dependent: Array, limit: float, step: NewtonStep | None = None
) -> list[np.ndarray] | None:
    """Return dependent coordinates moved by what rounding leaves open, two arrays.

    They are moved where the condition number exceeds a limit: along all singular ways, as several loops may be nearly
    singular, and along the least one alone, as the difference that one displacement makes may vanish by chance. None
    where the limit is exceeded nowhere, and for symbols.
    """
    c, s = closure_of(m), scales(m)
    if not is_numeric(u) or not is_numeric(dependent) or len(c.solved) == 0:
        return None
    # All coordinates of all states, (..., N) -> (K, N).
    q = all_coordinates(c, np.asarray(u, dtype=float), np.asarray(dependent, dtype=float)).reshape(
        -1, len(c.coordinates)
    )
    _, measures, A = (step or loop_assembly.numpy_step(m))(q, np.zeros(m.n))
    # The second measure is a bound of cond^2, cheap and for all states. Singular values are exact, for few.
    near_singular = np.flatnonzero(measures[:, 1] > limit**2)
    if len(near_singular) == 0:
        return None
    _, sizes, ways = np.linalg.svd(A[near_singular])
    near_singular, sizes, ways = (x[sizes[:, 0] > limit * sizes[:, -1]] for x in (near_singular, sizes, ways))
    if len(near_singular) == 0:
        return None
    # Along each right singular vector, a gap of some eps leaves eps / sigma open: (K', d, d), in units of coordinates.
    eps = np.finfo(dependent.dtype).eps
    solved = np.searchsorted(c.dependent, c.solved)
    displacements = _LOOP_GAP_EPS * eps * ways / sizes[..., None] * s.coordinates[list(c.solved)]
    displaced = []
    for displacement in (displacements.sum(axis=-2), displacements[:, -1]):
        rows = dependent.reshape(len(q), -1).copy()
        rows[np.ix_(near_singular, solved)] += displacement
        displaced.append(rows.reshape(dependent.shape))
    return displaced


def describe_uncertain(m: Mechanism, names: Sequence[str], times: Iterable[np.ndarray], count: int) -> str:
    """Say how many rows have no certain digits, and when."""

    def span(t: np.ndarray) -> str:
        return f"{t.min():.6g}" if len(t) == 1 else f"{t.min():.6g} .. {t.max():.6g}"

    parts = [
        f"{name} in {len(t)} of {count} rows, t = {span(t)} s"
        for name, t in zip(names, times, strict=True)
        if len(t) > 0
    ]
    return (
        f"{m.name!r}: the loops are so nearly singular that results have errors above {_MAX_ERROR:g} of their"
        f" size, and are NaN: {'; '.join(parts)}"
    )


Results = tuple[np.ndarray, ...]


def may_be_lost(m: Mechanism, computation: Computation) -> bool:
    """Return whether digits of results may be lost at some positions.

    They may near singular positions of closed robots, and where drives are steep.
    """
    return m.closure is not None or is_steep(m, computation)


def is_steep(m: Mechanism, computation: Computation) -> bool:
    """Return whether drives may make accelerations or their rates too inexact.

    Too inexact are errors above `_MAX_ERROR` of their size.
    """
    row, e = computation.quantity, m.elasticity
    # Only accelerations, and what inverts M, make errors of forces grow.
    if not (row.inverts or row.are_accelerations) or not m.is_numeric:
        return False
    # Symbols of stiffness have no size.
    if row.takes.motors and e is not None and not all(map(is_numeric, e.arrays.values())):
        return False
    # Each rate, and one more for accelerations, makes errors of drives grow once.
    growth = plant_growth(m) if row.takes.motors else drive_growth(m) ** (computation.order + 1)
    return growth > _MAX_ERROR / (_CANCELLATION * _DOUBLE_EPS)


def displace_inputs(m: Mechanism, computation: Computation, arrays: Sequence[Array]) -> list[Array]:
    """Return the arrays with inputs moved by some eps.

    They are moved in proportion to their size. Inputs are the state, and the forces or the motors.
    """
    displaced = list(arrays)
    for k, x in enumerate(arrays[: computation.rates]):
        size = np.abs(x)
        # Forces of springs are as exact as q and the position of rest, of which they take the difference.
        if k == 0 and "spring" in m.acting and m.closure is None and x.shape[-1] == m.n:
            size = size + np.abs(m.drives.rest) @ np.abs(m.G)
        displaced[k] = x + _INPUT_WAYS[k % len(_INPUT_WAYS)] * _INPUT_EPS * np.finfo(x.dtype).eps * size
    return displaced


def _numbers(arrays: Sequence[Array]) -> list[np.ndarray] | None:
    """Return arrays as arrays of NumPy; None for symbols.

    Those of JAX are converted to double precision.
    """
    if any(is_traced(x) or not (is_jax(x) or is_numeric(x)) for x in arrays):
        return None
    return [np.asarray(x, dtype=float) if is_jax(x) else x for x in arrays]


def _least_sizes(m: Mechanism, computation: Computation, arrays: Sequence[Array], results: Results) -> list[Array]:
    """Return the size that each result is compared with at least.

    Accelerations and their rates vanish at rest, and errors are then no part of them.
    """
    if not computation.quantity.are_accelerations:
        return [0.0] * len(results)
    # Coordinates in m count by the length of the robot, its longest link, if no joint turns.
    link_lengths = np.linalg.norm(m.B[:, :3, 3], axis=1)
    unit = 1.0 if m.X[:, :3].any() else float(link_lengths.max())
    # A rate counts as at least a small part of the largest lower one, from qd on.
    rate, sizes = np.abs(arrays[1]).max(axis=-1, keepdims=True, initial=0.0), []
    for x in results:
        sizes.append(np.maximum(_QUIET * unit, _SLOWEST * rate))
        rate = np.fmax(rate, np.abs(x).max(axis=-1, keepdims=True, initial=0.0))
    return sizes


def compute_certain_results(
    m: Mechanism,
    computation: Computation,
    names: Sequence[str],
    arrays: Sequence[Array],
    run: Callable[[Sequence[Array]], Results],
    step: NewtonStep | None = None,
) -> Results | None:
    """Return checked results; None where no digits can be lost.

    No digits can be lost of trees without steep drives, and of closed robots at regular positions.

    Raises
    ------
    UncertainError : where results at displaced inputs differ by more than `_MAX_ERROR` of their size.
    """
    # Two causes of doubt, each with inputs at which results are the same if rounding does no harm: near singular
    # positions the dependent coordinates, the last array, are moved; with steep drives the state is.
    doubts = []
    displaced = None
    if m.closure is not None:
        displaced = displace_dependent(m, arrays[0], arrays[-1], max_condition(computation), step)
    if displaced is not None:
        cause = "the loops are nearly singular there"
        doubts.append(Doubt([[*arrays[:-1], x] for x in displaced], cause, "expected q farther away"))
    numbers = _numbers(arrays) if is_steep(m, computation) else None
    if numbers is not None:
        cause = "damping, friction or springs are steep for the inertia that they move"
        fewer = Remedy("robot.with_drives([...])", "--drives")
        cure = f"let fewer drive terms act, {fewer}, or state a larger armature or rotor"
        doubts.append(Doubt([displace_inputs(m, computation, numbers)], cause, cure))
    if len(doubts) == 0:
        return None
    results = run(arrays)
    # Results in single precision, of JAX, are compared in double precision, where displacements are not rounded away.
    compared = run(numbers) if numbers is not None and any(map(is_jax, arrays)) else results
    least = [0.0] * len(compared) if numbers is None else _least_sizes(m, computation, numbers, compared)
    displaced_results = [(doubt, [run(x) for x in doubt.inputs]) for doubt in doubts]
    check_digits(m, computation, names, compared, least, displaced_results)
    return results


def check_digits(
    m: Mechanism,
    computation: Computation,
    names: Sequence[str],
    results: Results,
    least: Sequence[Array],
    displaced: Sequence[tuple[Doubt, Sequence[Results]]],
) -> None:
    """Compare results with those at displaced inputs.

    `least` are the sizes that results have at least, as arrays that broadcast with them.

    Raises
    ------
    UncertainError : where they differ by more than `_MAX_ERROR` of their size.
    """
    # Axes of a result are the last ones, behind those of the batch: each state is judged by its largest entry.
    axis_count = len(computation.shape(m))
    axes = tuple(range(-axis_count, 0))
    errors, uncertain, marked, causes = [0.0], [], [], list[Doubt]()
    for k, x in enumerate(results):
        size = np.maximum(np.abs(x).max(axis=axes, keepdims=True), least[k])
        # States that are NaN already, of missing numbers, are not counted.
        is_known, is_lost = np.isfinite(size), np.zeros(size.shape, dtype=bool)
        for doubt, displaced_results in displaced:
            # Displaced results may be infinite or NaN, which the negated comparison counts as lost.
            with np.errstate(all="ignore"):
                error = np.max([np.abs(y[k] - x).max(axis=axes, keepdims=True) for y in displaced_results], axis=0)
                lost_by_doubt = is_known & ~(error <= _MAX_ERROR * size)
                errors.append(float(np.max(error / size, where=lost_by_doubt, initial=0.0)))
            if lost_by_doubt.any():
                causes.append(doubt)
            is_lost |= lost_by_doubt
        marked.append(np.where(is_lost, np.nan, x))
        uncertain.append(is_lost.reshape(is_lost.shape[: is_lost.ndim - axis_count]))
    if len(causes) == 0:
        return
    lost_names = [name for name, is_lost in zip(names, uncertain, strict=True) if is_lost.any()]
    # Lower rates may be certain: then fewer rates are the cure, unless the results are no rates of each other.
    certain_names = [name for name in names if name not in lost_names and not computation.quantity.gives.results]
    states = np.logical_or.reduce([x.ravel() for x in uncertain])
    count = f" of {states.sum()} of {states.size} samples, first {states.argmax()}," if states.size > 1 else ""
    cure = causes[0].cure
    if len(certain_names) > 0:
        verb = "is" if len(certain_names) == 1 else "are"
        cure = f"{join_names(certain_names)} {verb} certain there: give fewer rates"
    raise UncertainError(
        f"{m.name!r}: {join_names(lost_names)} at q{count} would be off by up to {max(errors):.2g} of the size, since"
        f" {' and '.join(dict.fromkeys(doubt.cause for doubt in causes))}; expected an error below {_MAX_ERROR:g};"
        f" {cure}",
        tuple(marked),
        names,
        uncertain,
    )


TURNS = np.linspace(0, 2 * np.pi, 8, endpoint=False)  # positions of a joint: J changes by sines of one and two turns
TURN_MARGIN = 2  # by which J may be smaller between them


@lru_cache(maxsize=64)
def drive_growth(m: Mechanism) -> float:
    """Return a bound, 1/s, of how errors grow with each rate.

    Drive terms that act make them grow: damping and friction by their slopes, springs by their stiffness.
    """
    terms = set(m.acting) & set(stated_terms(m.drives))
    # The slope of this friction goes with the load, which has no bound.
    if LOAD_FRICTION in terms:
        return np.inf
    # The largest slopes of forces over velocities are at rest: 1 / eps of tanh(v / eps).
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
    # Slopes are bounds of M^-1 D, 1/s. Springs, M^-1 K in 1/s^2, act on each second rate: their root counts.
    J = least_inertias(m)
    return _sum_of_ratios(slope, J) + float(np.sqrt(_sum_of_ratios(stiffness, J)))


@lru_cache(maxsize=64)
def plant_growth(m: Mechanism) -> float:
    """Return a bound, 1/s^2, of how errors of motors grow.

    They become errors of accelerations. The motors are behind springs. Of links, the factor is K over the inertia
    that resists; of motors, K and the slope of their friction over their rotors.
    """
    e, J = joint_springs.elasticity_of(m), least_inertias(m)
    # The stiffness goes with the deflection, or motors share inertias: no bound is known.
    if any(law is not None for law in e.springs) or e.level is not None:
        return np.inf
    # The inertia that resists coordinate j is at least that of one joint that follows it alone, seen over its ratio.
    places = range(m.n) if m.closure is None else m.closure.independent
    follows_one = np.count_nonzero(m.tree.G, axis=1) == 1
    G = m.tree.G[:, list(places)] * follows_one[:, None]
    links = (G**2 * J[:, None]).max(axis=0)
    soft = ~e.is_rigid
    motors = e.stiffness[soft] + e.viscous[soft] + e.friction[soft] / e.eps[soft]
    return _sum_of_ratios(e.stiffness[soft], links[soft]) + _sum_of_ratios(motors, e.rotor[soft])


def least_inertias(m: Mechanism) -> np.ndarray:
    """Return the least inertia, (joints,), that resists each joint at any position.

    Rotors that act belong to it. It is zero for joints of several screws that a body carries, and for joints whose body
    resists nothing.
    """
    tree = m.tree
    rotors, inertias = m.drives.armature * ("armature" in m.acting), np.zeros(len(tree.joints))
    roots = [_root(M) for M in tree.M]
    for i, columns in enumerate(tree.columns):
        places, parent = list(columns), tree.parent[i]
        X = tree.X[places].T
        # On the ground, a body alone resists; of joints with several screws, the direction that resists least counts.
        if parent < 0:
            inertias[places] = np.linalg.eigvalsh(X.T @ tree.M[i] @ X)[:1]
        # On a body that is free in space, both resist: the parallel sum, at some turns of the joint.
        elif len(places) == 1:
            poses = [tree.B[i] @ lie.exp(X[:, 0], np.full((1, 1), phi)) for phi in TURNS]
            inertias[places] = min(_parallel_sum(roots[i], roots[parent] @ lie.Ad(C), X) for C in poses) / TURN_MARGIN
    return inertias.clip(0) + rotors


def _root(M: np.ndarray) -> np.ndarray:
    """Return L of L^T L = M, which may be singular."""
    sizes, ways = np.linalg.eigh(M)
    return np.sqrt(sizes.clip(0))[:, None] * ways.T


def _parallel_sum(outer_root: np.ndarray, inner_root: np.ndarray, X: np.ndarray) -> float:
    """Return the least kinetic form of two bodies against each other.

    It is min over V of (V + X)^T M (V + X) + V^T N V, of M and N by their roots. V is the twist of the inner body
    as the joint moves the outer one by X against it.
    """
    # With the roots, it is a least-squares problem: min |L_M (V + X)|^2 + |L_N V|^2.
    rows, constant = np.concatenate([outer_root, inner_root]), np.concatenate([outer_root @ X, 0 * X])
    V = np.linalg.lstsq(rows, -constant)[0]
    return float(((rows @ V + constant) ** 2).sum())


def _sum_of_ratios(forces: np.ndarray, inertias: np.ndarray) -> float:
    """Return the sum of forces over inertias, or infinity.

    It is infinite if a force acts on no inertia.
    """
    acts = forces > 0
    with np.errstate(divide="ignore", over="ignore"):
        return float((forces[acts] / inertias[acts]).sum())
