"""Coordinates that move no inertia: those in which the mass matrix is singular."""

from functools import lru_cache

import numpy as np

from jounce.dynamics.base import STILL
from jounce.dynamics.recursion import bodies
from jounce.model.mechanism import Mechanism
from jounce.spatial import lie
from jounce.spatial.series import columns

SINGULAR = 1e-12  # of what a mass matrix could be: rounding leaves less
SAMPLES = 3  # configurations; where the mass matrix is regular in one, it is in almost all


@lru_cache(maxsize=64)
def idle_coordinates(mechanism: Mechanism) -> tuple[int, tuple[str, ...]]:
    """The rank of the mass matrix, and which coordinates take part in motions without kinetic energy, everywhere."""
    rank, idle = -1, np.zeros(0)
    for k in range(SAMPLES):
        q = np.cos(1.0 + k + 1.7 * np.arange(mechanism.n))
        if _is_regular(mechanism, q):
            return mechanism.n, ()
        trial = _idle(mechanism, q)
        rank, idle = max((rank, idle), trial, key=lambda found: found[0])
        if rank == mechanism.n:
            return rank, ()
    return rank, tuple(mechanism.coordinates[j] for j in np.flatnonzero(idle))


def _is_regular(mechanism: Mechanism, q: np.ndarray) -> bool:
    """Whether every joint feels inertia while all the others are free: the pivots of the mass matrix, in O(n).

    Where joints follow others, pivots of the joint variables tell nothing.
    """
    nb, X = mechanism.nb, mechanism.X
    if mechanism.n != nb or not np.array_equal(mechanism.G, np.eye(nb)):
        return False
    rotors = mechanism.drives.armature * ("armature" in mechanism.acting)
    theta = q + mechanism.g
    moved = np.stack([lie.exp(X_i, theta[i : i + 1, None]) for i, X_i in enumerate(X)])
    Ad = lie.Ad(lie.inverse(mechanism.B @ moved))
    articulated = mechanism.M.copy()  # inertia of a body with all beyond it, whose joints are free
    for i in reversed(range(nb)):
        own = articulated[i]
        momentum = own @ X[i]
        pivot = X[i] @ momentum + rotors[i]
        if not pivot > SINGULAR * np.abs(own).max() or not np.isfinite(pivot):
            return False
        if (p := mechanism.parent[i]) >= 0:
            articulated[p] += Ad[i].T @ (own - np.outer(momentum, momentum / pivot)) @ Ad[i]
    return True


def _idle(mechanism: Mechanism, q: np.ndarray) -> tuple[int, np.ndarray]:
    """The rank of the mass matrix at q, and which coordinates take part in motions without kinetic energy."""
    J = bodies.jacobians(mechanism, columns([q]), STILL, None)[0]
    rotors = mechanism.drives.armature * ("armature" in mechanism.acting)
    momenta = (mechanism.M @ J).reshape(-1, mechanism.n)
    gM = J.reshape(momenta.shape).T @ momenta + mechanism.G.T * rotors @ mechanism.G  # (MC)
    most = np.einsum("iaj,iaj,i->j", J, J, np.abs(mechanism.M).max(axis=(1, 2))) + rotors @ mechanism.G**2
    own = np.abs(np.diag(gM))
    moves = own > SINGULAR * most
    scale = np.sqrt(np.where(moves, own, 1.0))
    scaled = np.where(moves[:, None] & moves, gM / np.outer(scale, scale), 0.0)
    if not np.isfinite(scaled).all():  # overflown: nothing can be said
        return mechanism.n, np.zeros(mechanism.n, dtype=bool)
    if (np.abs(np.linalg.eigvalsh(scaled)) > SINGULAR * mechanism.n).all():  # as most are, at a fraction of the cost
        return mechanism.n, np.zeros(mechanism.n, dtype=bool)
    values, vectors = np.linalg.eigh(scaled)
    null = np.abs(values) <= SINGULAR * mechanism.n
    return int(mechanism.n - null.sum()), (np.abs(vectors[:, null]) > 1e-4).any(axis=1)
