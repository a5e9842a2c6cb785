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
    """Return ``A @ B`` with the same bits on every processor.

    It serves data of files. BLAS rounds differently on each processor.
    """
    return (A[..., :, :, None] * B[..., None, :, :]).sum(axis=-2)


def hat(v: Array) -> Array:
    """Return the skew matrix with ``hat(x) @ y = x cross y``.

    (..., 3) to (..., 3, 3).
    """
    return (v @ _HAT).reshape((*v.shape[:-1], 3, 3))


def axial(T: Array) -> Array:
    """Return the vector n with ``hat(n) = T - T.mT``: (..., 3, 3) to (..., 3)."""
    return T.reshape((*T.shape[:-2], 9)) @ _HAT.T


def wedge(X: Array) -> Array:
    """Return the 4x4 matrix of a screw, ``[[xi~, eta], [0, 0]]``: (..., 6) to (..., 4, 4)."""
    return (X @ _WEDGE).reshape((*X.shape[:-1], 4, 4))


def cowedge(T: Array) -> Array:
    """Return W with ``W . X = trace(wedge(X).mT @ T)``.

    It is a wrench, and this holds for every screw X. (..., 4, 4) to (..., 6).
    """
    return T.reshape((*T.shape[:-2], 16)) @ _WEDGE.T


def ad(X: Array) -> Array:
    """Return the matrix ``[[xi~, 0], [eta~, xi~]]`` of the Lie bracket.

    It acts on screw coordinates. (..., 6) to (..., 6, 6).
    """
    return (X @ _AD).reshape((*X.shape[:-1], 6, 6))  # (adSE3)


def pose(R: Array, r: Array) -> Array:
    """Return the pose of a rotation and a position column.

    (..., 3, 3) and (..., 3, 1) to (..., 4, 4).
    """
    upper = concatenate([R, r], axis=-1)
    return concatenate([upper, np.array([[0, 0, 0, 1]])], axis=-2)


def from_quaternion(Q: Array) -> Array:
    """Return the 3x3 matrix of a quaternion (w, x, y, z).

    It is a rotation times the square of the length of the quaternion.
    """
    w, v = Q[..., :1, None], hat(Q[..., 1:])
    return (Q[..., None, :] @ Q[..., None]) * np.eye(3) + 2 * w * v + 2 * v @ v


def to_quaternion(R: np.ndarray) -> np.ndarray:
    """Return the unit quaternion (w, x, y, z) of a rotation.

    w >= 0, and the rotation is one of numbers. (..., 3, 3) to (..., 4).
    """
    # The matrix 4 Q Q^T, (..., 4, 4), is linear in R: its diagonal follows from that of R, products with w from the
    # skew part of R, all others from the symmetric part.
    x, y, z = np.moveaxis(np.diagonal(R, axis1=-2, axis2=-1), -1, 0)
    differences, sums = R.mT - R, R.mT + R
    wx, wy, wz = differences[..., 1, 2], differences[..., 2, 0], differences[..., 0, 1]
    xy, xz, yz = sums[..., 0, 1], sums[..., 0, 2], sums[..., 1, 2]
    rows = [
        [1 + x + y + z, wx, wy, wz],
        [wx, 1 + x - y - z, xy, xz],
        [wy, xy, 1 - x + y - z, yz],
        [wz, xz, yz, 1 - x - y + z],
    ]
    products = np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
    # Each row is a multiple of Q. The one with the largest diagonal entry has no cancellation; its length is not small.
    largest = np.argmax(np.diagonal(products, axis1=-2, axis2=-1), axis=-1)[..., None, None]
    Q = np.take_along_axis(products, largest, axis=-2)[..., 0, :]
    Q = Q / np.linalg.norm(Q, axis=-1, keepdims=True)
    return np.where(Q[..., :1] < 0, -Q, Q)


def rotation(C: Array) -> Array:
    """Return the rotation matrix of a pose, (..., 3, 3)."""
    return C[..., :3, :3]


def position(C: Array) -> Array:
    """Return the position column of a pose, (..., 3, 1)."""
    return C[..., :3, 3:]


def inverse(C: Array) -> Array:
    """Return the inverse of a pose, by the transpose of its rotation."""
    R = rotation(C).mT
    return pose(R, -(R @ position(C)))


def Ad(C: Array) -> Array:
    """Return the matrix ``[[R, 0], [r~ R, R]]`` of a pose.

    It transforms screw coordinates: (..., 6, 6).
    """
    R, r = rotation(C), position(C)
    angular = concatenate([R, 0 * R], axis=-1)
    return concatenate([angular, concatenate([hat(r[..., 0]) @ R, R], axis=-1)], axis=-2)  # (AdCij)


def exp(X: Array, phi: Array) -> Array:
    """Return the poses (..., 4, 4) of amounts `phi` of a screw.

    The screw is X = (xi; eta), (6,), `phi` is (..., 1, 1). ``|xi| = 1`` (revolute, helical of any pitch) or ``xi = 0``
    (prismatic), as `from_screws` checks.
    """
    return exp_turn_and_slide(*turn_and_slide(X), phi)  # (6)


def turn_and_slide(X: Array) -> tuple[Array, Array]:
    """Return the matrices of turn and slide along a screw axis.

    They are 4x4. Their sum is the matrix of the screw.
    """
    e, eta = X[:3, None], X[3:, None]
    if all(map(is_zero, X[:3])):  # (Xi) with infinite pitch: prismatic
        return wedge(0 * X), wedge(X)  # (5)
    hat_e = hat(X[:3])
    across, along = -(hat_e @ (hat_e @ eta)), (e.mT @ eta) * e  # with |e| = 1 they add up to eta
    turn, slide = concatenate([e, across], axis=-2), concatenate([0 * e, along], axis=-2)
    return wedge(turn[:, 0]), wedge(slide[:, 0])


def exp_turn_and_slide(turn: Array, slide: Array, phi: Array) -> Array:
    """Return the exponential of a turn and a slide, (..., 4, 4).

    Where the axis is one of the frame, its entries are sines and cosines alone.
    """
    # With Z of the turn Z^3 = -Z: exp(phi Z) = I + sin(phi) Z + (1 - cos(phi)) Z^2. The slide commutes with it.
    square = turn @ turn
    return (np.eye(4, dtype=int) + square) + sin(phi) * turn - cos(phi) * square + phi * slide  # (SO3exp)
