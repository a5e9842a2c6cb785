"""How fast drives make errors of accelerations grow, from one rate to the next.

Problem: the rates of forward dynamics follow one after the other, q^(k+2) = M^-1 (Q^(k) - D q^(k+1) - K q^(k) - ...).
Damping D, and friction by its slope, makes errors grow by M^-1 D with each of them, springs K by M^-1 K with each
second one. Where that is 1000 / s, little of the fourth rate is left. The growth is bounded here for all positions.

Algorithm: the kinetic energy T of a robot is at least that of two neighbouring bodies alone, and this at least that
with the inner one free in space. So 2 T >= J theta'^2 at each joint, with the least J of two bodies that a joint moves
against each other (the parallel sum of their inertias along its screw). Thus qd^T D qd = sum d_i theta_i'^2 is at most
2 T sum d_i / J_i, and the eigenvalues of M^-1 D are at most that sum. Loops and joints that follow others leave less
freedom, and the same bound.

Invariant: a bound, if not a close one: where a joint moves no inertia of its own, it is infinite.
"""

from functools import lru_cache

import numpy as np

from jounce.dynamics.joint_springs import elasticity_of
from jounce.model.drives import LOAD_FRICTION, stated_terms
from jounce.model.mechanism import Mechanism
from jounce.spatial import lie

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
    e, J = elasticity_of(m), least_inertias(m)
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
