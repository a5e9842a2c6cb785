"""The matrices of Section 2 of the paper at one instant: the system matrices from which every closed form is built.

Sans-serif *system* matrices act on all the bodies at once, with 6 rows per body. They are written for trees: the
predecessor i-1 of the paper is ``parent[i]``. Joint variables are ``theta = G q + g``, columns (..., nb, 1).

A base that floats is the first body: its six columns of X are the unit matrix, its velocities its twist.
"""

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from jounce.core.scalars import Array, concatenate
from jounce.dynamics.state import JointMotion, motion_of_joint
from jounce.model import coordinates
from jounce.model.mechanism import Mechanism, ancestors
from jounce.spatial.inertia import moments
from jounce.spatial.lie import Ad, ad, exp, inverse
from jounce.spatial.series import Series, diagonal


@dataclass(frozen=True, eq=False)
class System:
    """What does not depend on the state: the screws of the velocities, the inertia matrices, and the tree."""

    S: Array  # (6nb, k) the screws of the joints, each in the rows of its body, the six of a base that floats first
    G: Array  # (k, nv), so that the own twists of the bodies are S G qd
    inertias: Array  # (nb, 6, 6)
    carries: np.ndarray  # (nb, nb): 1 where body j carries body i or is it

    @cached_property
    def X(self) -> Array:
        """The screws of the velocities, so that V = A X qd: (6nb, nv)."""
        return self.S @ self.G  # (Ab)

    @cached_property
    def M(self) -> Array:
        """The inertia matrices along the diagonal: (6nb, 6nb)."""
        return diagonal(self.inertias)  # (Msys)


@lru_cache(maxsize=64)
def build_system(m: Mechanism) -> System:
    """Return the system of the bodies."""
    # Screws (k, 6) of all bodies, one after the other, -> (6nb, k), each in the six rows of its body.
    parts = [coordinates.body_screws(m, i).T for i in range(m.nb)]
    moves = np.repeat(np.eye(len(parts), dtype=int), list(map(len, parts)), axis=0)  # (k, nb): screw by body
    S = (moves[..., None] * concatenate(parts, axis=-2)[:, None, :]).reshape(len(moves), -1).T
    return System(S, coordinates.velocity_map(m), m.M, ancestors(m))


def poses(m: Mechanism, q: Series, base: JointMotion | None) -> Array:
    """Return C_i, the pose of every body in the inertial frame: (..., nb, 4, 4)."""
    theta = coordinates.joint_variables(m, q)[0]
    C: list[Array] = []
    for i, (B, columns, p) in enumerate(zip(m.B, m.columns, m.parent, strict=True)):
        # A joint of one screw moves by exp(X theta). Others, a base among them, have poses of their own.
        if len(columns) == 1:
            H = exp(m.X[columns[0]], theta[..., columns[0] : columns[0] + 1, :])
        else:
            H = motion_of_joint(m, i, q, base).pose
        C.append(B @ H if p < 0 else C[p] @ (B @ H))  # (Ci)
    return concatenate([C_i[..., None, :, :] for C_i in C], axis=-3)


def system_A(carries: np.ndarray, C: Array) -> Array:
    """Return A, the blocks Ad(C_ij) for every body j that carries i: (..., 6nb, 6nb)."""
    return _blocks(C, carries)  # (Ab)


def system_D(m: Mechanism, C: Array) -> Array:
    """Return D, with A = (I - D)^-1.

    Its blocks are Ad(C_ip) for the parent p of i.
    """
    # Row i of the pattern has a 1 at its parent; the parent -1 is the last column, which is left out.
    carried_by = np.eye(m.nb + 1, dtype=int)[np.array(m.parent)][:, : m.nb]
    return _blocks(C, carried_by)  # (D)


def system_U(C: Array) -> Array:
    """Return U, the column of blocks Ad(C_i)^-1: (..., 6nb, 6)."""
    U = Ad(inverse(C))
    return U.reshape((*U.shape[:-3], 6 * U.shape[-3], 6))  # (eq_U)


def _blocks(C: Array, pattern: np.ndarray) -> Array:
    """Return the blocks Ad(C_ij) where a pattern (nb, nb) is 1.

    The shape is (..., 6nb, 6nb).
    """
    C_ij = inverse(C)[..., :, None, :, :] @ C[..., None, :, :, :]  # (Cij)
    # (..., nb, nb, 6, 6) -> (..., nb, 6, nb, 6) -> (..., 6nb, 6nb).
    blocks = Ad(C_ij) * pattern[:, :, None, None]
    *lead, nb, _, _, _ = blocks.shape
    return blocks.swapaxes(-3, -2).reshape((*lead, 6 * nb, 6 * nb))


def system_a(X: Array, qd: Array) -> Array:
    """Return a = diag(thetad_i ad(X_i)), linear in qd: (..., n, 1) to (..., 6nb, 6nb)."""
    return system_b(X @ qd)  # (a)


def system_b(V: Array) -> Array:
    """Return b = diag(ad(V_i)), linear in V.

    (..., 6nb, 1) becomes (..., 6nb, 6nb).
    """
    return diagonal(ad(V.reshape((*V.shape[:-2], V.shape[-2] // 6, 6))))  # (b)


def system_wrench_rate(W: Array) -> Array:
    """Return the blocks that map a screw x to -ad(x)^T W_i.

    The shape is (..., 6nb, 6nb). That is the rate of a wrench W_i that moves along x.
    """
    by_body = W.reshape((*W.shape[:-2], W.shape[-2] // 6, 1, 6, 1))
    return diagonal(-(ad(np.eye(6, dtype=int)).mT @ by_body)[..., 0].mT)


def system_gravity(m: Mechanism) -> Array:
    """Return the paper's G = -(0; g), which replaces gravity.

    It is the acceleration of the ground, (6, 1).
    """
    return concatenate([0 * m.gravity, -m.gravity], axis=-1)[:, None]  # (eq_U)


def first_moment(inertias: Array, C: Array) -> Array:
    """Return the sum of m_i c_i, linear in the poses.

    It is (..., 3, 1).
    """
    m, h, _ = moments(inertias)
    return (C @ concatenate([h, m], axis=-2))[..., :3, :].sum(axis=-3)


def shift_to_point(r: Array) -> Array:
    """Return the matrix that takes wrenches about r, less 1.

    It is linear in r. They are given about the origin.
    """
    return ad(concatenate([0 * r, r], axis=-2)[..., 0]).mT


def potential_energy(inertias: Array, C: Array, gravity: Array) -> Array:
    """Return U = -sum of m_i g . c_i from poses.

    U is (..., 1, 1). It is zero at the height of the inertial origin.
    """
    return -(gravity @ first_moment(inertias, C))[..., None]
