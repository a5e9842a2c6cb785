"""SE(3) in matrices: the few maps that the paper uses, over any scalar type and any leading batch axes.

Twists and screws are (angular; linear). ``C_i`` maps body coordinates to inertial ones, ``C_ij = inverse(C_i) @ C_j``,
and ``Ad(C_ij)`` maps screw coordinates of frame j to frame i: inner letters cancel.
"""

import numpy as np

from jounce.core.scalars import Array, concatenate, cos, is_zero, sin

_E = np.eye(3, dtype=int)
# hat, ad and wedge are linear, hence constant tensors: hat(v) = v @ _HAT, reshaped. Integers keep symbols exact.
_HAT = np.stack([np.cross(e, _E).T for e in _E]).reshape(3, 9)
_SCREWS = [*((e, 0 * e) for e in _E), *((0 * e, e) for e in _E)]
_AD = np.stack(
    [np.block([[np.cross(w, _E).T, 0 * _E], [np.cross(v, _E).T, np.cross(w, _E).T]]) for w, v in _SCREWS]
).reshape(6, 36)
_WEDGE = np.stack(
    [np.block([[np.cross(w, _E).T, v[:, None]], [np.zeros((1, 4), dtype=int)]]) for w, v in _SCREWS]
).reshape(6, 16)


def portable_product(A: Array, B: Array) -> Array:
    """The product ``A @ B`` to the same bits on every processor, for data of files; BLAS rounds differently on each."""
    return (A[..., :, :, None] * B[..., None, :, :]).sum(axis=-2)


def hat(v: Array) -> Array:
    """The skew matrix of a vector, ``hat(x) @ y = x cross y``: (..., 3) to (..., 3, 3)."""
    return (v @ _HAT).reshape((*v.shape[:-1], 3, 3))


def axial(T: Array) -> Array:
    """The vector n with ``hat(n) = T - T.mT``: (..., 3, 3) to (..., 3)."""
    return T.reshape((*T.shape[:-2], 9)) @ _HAT.T


def wedge(X: Array) -> Array:
    """The 4x4 matrix of a screw, ``[[xi~, eta], [0, 0]]``: (..., 6) to (..., 4, 4)."""
    return (X @ _WEDGE).reshape((*X.shape[:-1], 4, 4))


def cowedge(T: Array) -> Array:
    """The wrench W with ``W . X = trace(wedge(X).mT @ T)`` for every screw X: (..., 4, 4) to (..., 6)."""
    return T.reshape((*T.shape[:-2], 16)) @ _WEDGE.T


def ad(X: Array) -> Array:
    """The matrix of the Lie bracket in screw coordinates, ``[[xi~, 0], [eta~, xi~]]``: (..., 6) to (..., 6, 6)."""
    return (X @ _AD).reshape((*X.shape[:-1], 6, 6))  # (adSE3)


def pose(R: Array, r: Array) -> Array:
    """The 4x4 matrix of a rotation (..., 3, 3) and a position column (..., 3, 1)."""
    upper = concatenate([R, r], axis=-1)
    return concatenate([upper, np.array([[0, 0, 0, 1]])], axis=-2)


def from_quaternion(Q: Array) -> Array:
    """The 3x3 matrix of a quaternion (w, x, y, z): a rotation where its length is 1, else that times its square."""
    w, v = Q[..., :1, None], hat(Q[..., 1:])
    return (Q[..., None, :] @ Q[..., None]) * np.eye(3) + 2 * w * v + 2 * v @ v


def to_quaternion(R: np.ndarray) -> np.ndarray:
    """The unit quaternion (w, x, y, z) of a rotation of numbers, with w >= 0: (..., 3, 3) to (..., 4)."""
    x, y, z = np.moveaxis(np.diagonal(R, axis1=-2, axis2=-1), -1, 0)
    turned, sums = R.mT - R, R.mT + R  # all of Q Q^T, times 4, is in them
    wx, wy, wz = turned[..., 1, 2], turned[..., 2, 0], turned[..., 0, 1]
    xy, xz, yz = sums[..., 0, 1], sums[..., 0, 2], sums[..., 1, 2]
    rows = [
        [1 + x + y + z, wx, wy, wz],
        [wx, 1 + x - y - z, xy, xz],
        [wy, xy, 1 - x + y - z, yz],
        [wz, xz, yz, 1 - x - y + z],
    ]
    products = np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
    largest = np.argmax(np.diagonal(products, axis1=-2, axis2=-1), axis=-1)[..., None, None]
    Q = np.take_along_axis(products, largest, axis=-2)[..., 0, :]
    Q = Q / np.linalg.norm(Q, axis=-1, keepdims=True)
    return np.where(Q[..., :1] < 0, -Q, Q)


def rotation(C: Array) -> Array:
    """The rotation matrix of a pose, (..., 3, 3)."""
    return C[..., :3, :3]


def position(C: Array) -> Array:
    """The position column of a pose, (..., 3, 1)."""
    return C[..., :3, 3:]


def inverse(C: Array) -> Array:
    """The inverse of a pose, by the transpose of its rotation."""
    R = rotation(C).mT
    return pose(R, -(R @ position(C)))


def Ad(C: Array) -> Array:
    """The matrix that transforms screw coordinates by a pose, ``[[R, 0], [r~ R, R]]``: (..., 6, 6)."""
    R, r = rotation(C), position(C)
    angular = concatenate([R, 0 * R], axis=-1)
    return concatenate([angular, concatenate([hat(r[..., 0]) @ R, R], axis=-1)], axis=-2)  # (AdCij)


def exp(X: Array, phi: Array) -> Array:
    """The exponential of a screw X = (xi; eta), (6,), by the amounts `phi`, (..., 1, 1): poses (..., 4, 4).

    ``|xi| = 1`` (revolute, helical of any pitch) or ``xi = 0`` (prismatic), as `from_screws` checks.
    """
    return exp_turn_and_slide(*turn_and_slide(X), phi)  # (6)


def turn_and_slide(X: Array) -> tuple[Array, Array]:
    """The 4x4 matrices of the two screws that make up a screw: a pure turn about its axis, a pure slide along it."""
    e, eta = X[:3, None], X[3:, None]
    if all(map(is_zero, X[:3])):  # (Xi) with infinite pitch: prismatic
        return wedge(0 * X), wedge(X)  # (5)
    hat_e = hat(X[:3])
    across, along = -(hat_e @ (hat_e @ eta)), (e.mT @ eta) * e  # with |e| = 1 they add up to eta
    turn, slide = concatenate([e, across], axis=-2), concatenate([0 * e, along], axis=-2)
    return wedge(turn[:, 0]), wedge(slide[:, 0])


def exp_turn_and_slide(turn: Array, slide: Array, phi: Array) -> Array:
    """The exponential of a turn and a slide, (..., 4, 4); cosines alone where an axis is one of the frame's."""
    square = turn @ turn
    return (np.eye(4, dtype=int) + square) + sin(phi) * turn - cos(phi) * square + phi * slide  # (SO3exp)
