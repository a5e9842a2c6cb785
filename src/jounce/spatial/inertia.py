"""The inertia of one body: 6x6 matrix, its parts, and what a mass distribution can be.

``M = [[Theta, h~], [-h~, m I]]`` in the body frame, with h = m c the first moment and Theta the inertia tensor about
the frame's origin (eqn_body_fixed_mass_inertia_matrix). The same ten numbers as moments of mass: m, h, and the second
moments P = integral of r r^T dm = tr(Theta)/2 I - Theta.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jounce.core.errors import JounceError, door
from jounce.core.scalars import (
    Array,
    asarray,
    broadcast,
    concatenate,
    convert_element,
    is_numeric,
    is_symbolic,
    restore_integers,
)
from jounce.core.typing import ArrayLike
from jounce.spatial.lie import Ad, axial, hat, inverse, portable_product

_I = np.eye(3, dtype=int)
CONSISTENCY_TOLERANCE = 1e-9  # of the largest entry of a tensor: less is rounding of poses and Steiner's theorem
INERTIAL_PARAMETERS = (
    "m",
    "mcx",
    "mcy",
    "mcz",
    "Ixx",
    "Ixy",
    "Iyy",
    "Ixz",
    "Iyz",
    "Izz",
)  # of one body, as Pinocchio has them
_PARAMETER_PLACES = (
    [3, 2, 0, 1, 0, 0, 1, 0, 1, 2],
    [3, 4, 5, 3, 0, 1, 1, 2, 2, 2],
)  # rows and columns of M that hold them


@door
def inertia_matrix(
    mass: ArrayLike, com: ArrayLike, inertia_com: ArrayLike, rotation: ArrayLike | None = None
) -> NDArray[Any]:
    """Return the 6x6 inertia matrix of a body, by Steiner's theorem.

    It is that in the frame of the body. ``M = [[Theta, m c~], [-m c~, m I]]`` with ``Theta = R_bc Theta_c R_bc^T - m c~
    c~``.


    Parameters
    ----------
    mass : (...)
        Mass m in kg.
    com : (..., 3)
        Centre of mass c in the body frame, m.
    inertia_com : (..., 3, 3)
        Inertia tensor about the COM, kg m^2, in the COM frame.
    rotation : (..., 3, 3)
        Rotation R_bc of the COM frame to the body frame; parallel axes if left out.

    Returns
    -------
    M : (..., 6, 6)
        Inertia matrix, (angular; linear). Symbols are values too.

    References
    ----------
    Müller & Kumar, (eqn_body_fixed_mass_inertia_matrix) and the line after it. The authors' published code leaves
    Steiner's theorem out.

    Examples
    --------
    >>> from jounce import inertia_matrix
    >>> inertia_matrix(2.0, [0, 0, 0.5], [[0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.05]])[0, 0]
    np.float64(0.6)
    """
    m, c, theta = convert_element(mass, "mass"), asarray(com, "com"), asarray(inertia_com, "inertia_com")
    if any(map(is_symbolic, (m, c, theta))):
        m, c, theta = restore_integers(m), restore_integers(c), restore_integers(theta)
    for name, array, shape in (("com", c, (3,)), ("inertia_com", theta, (3, 3))):
        if array.shape[-len(shape) :] != shape:
            raise JounceError(f"{name} has shape {array.shape}; expected (..., {', '.join(map(str, shape))})")
    if rotation is not None:
        R = asarray(rotation, "rotation")
        if R.shape[-2:] != (3, 3):
            raise JounceError(f"rotation has shape {R.shape}; expected (..., 3, 3)")
        if is_numeric(R):
            error = np.abs(R.mT @ R - _I).max(initial=0.0)
            if not error < 1e-9:
                raise JounceError(f"rotation is not a rotation matrix: max abs(R^T R - I) = {error:.3g}")
        theta = R @ theta @ R.mT
    m, c, theta = broadcast([m[..., None, None], hat(c), theta], [2, 2, 2], ["mass", "com", "inertia_com"])
    theta = theta - m * portable_product(c, c)  # Steiner, after (eqn_body_fixed_mass_inertia_matrix)
    return _matrix(m, c * m, theta)


def _matrix(m: Array, h_hat: Array, theta: Array) -> Array:
    """Return ``[[Theta, h~], [-h~, m I]]`` (..., 6, 6) of its parts."""
    upper = concatenate([theta, h_hat], axis=-1)
    return concatenate([upper, concatenate([-h_hat, m * _I], axis=-1)], axis=-2)  # (eqn_body_fixed_mass_inertia_matrix)


def _unit(i: int, j: int) -> Array:
    """Return the inertia matrix with one parameter, which is 1.

    The parameter is at row i and column j.
    """
    # Row 3 has the mass, columns 3 to 5 of the upper rows the skew matrix of h, all others the tensor.
    if i == 3:
        return _matrix(np.ones((1, 1), dtype=int), hat(0 * _I[0]), 0 * _I)
    if j > 2:
        return _matrix(np.zeros((1, 1), dtype=int), hat(np.cross(_I[j - 3], _I[i])), 0 * _I)
    theta = np.outer(_I[i], _I[j])
    return _matrix(np.zeros((1, 1), dtype=int), hat(0 * _I[0]), theta | theta.T)


_PARAMETER_BASIS = np.stack([_unit(i, j) for i, j in zip(*_PARAMETER_PLACES, strict=True)]).reshape(10, 36)


def symmetric_matrix(entries: Array) -> Array:
    """Return the symmetric matrix of its upper triangle, row by row.

    Of a tensor they are xx, xy, xz, yy, yz, zz: (6) to (3, 3).
    """
    # n (n + 1) / 2 entries make n rows; `places` says for each entry of the matrix which of them it is.
    upper = np.triu_indices((math.isqrt(8 * len(entries) + 1) - 1) // 2)
    places = np.zeros((upper[0][-1] + 1,) * 2, dtype=int)
    places[upper] = places.T[upper] = range(len(entries))
    return entries[places]


def parameters(M: Array) -> Array:
    """Return the inertial parameters (..., 10) of an inertia matrix.

    They are those about the origin of the frame.
    """
    return M[..., *_PARAMETER_PLACES]


def from_parameters(p: Array) -> Array:
    """Return the inertia matrix of inertial parameters: the linear inverse of `parameters`."""
    return (p @ _PARAMETER_BASIS).reshape((*p.shape[:-1], 6, 6))


def moments(M: Array) -> tuple[Array, Array, Array]:
    """Return mass m, first moment h and second moments P.

    They are those of an inertia matrix. (..., 6, 6) to (..., 1, 1), (..., 3, 1) and (..., 3, 3).
    """
    # P_xx = (Theta_yy + Theta_zz - Theta_xx) / 2, P_xy = -Theta_xy. The order of the sums is such that a moment that
    # `from_moments` took as zero comes back as exactly zero.
    theta = M[..., :3, :3]
    t = [theta[..., i : i + 1, i : i + 1] for i in range(3)]
    diagonal = [(t[1] + t[2]) - t[0], (t[0] + t[2]) - t[1], (t[0] + t[1]) - t[2]]
    P = concatenate([d / 2 for d in diagonal], axis=-1) * _I - theta * (1 - _I)
    h = axial(M[..., :3, 3:])[..., None] / 2
    # Halves of integers among symbols become integers again.
    if is_symbolic(M):
        h, P = restore_integers(h), restore_integers(P)
    return M[..., 3:4, 3:4], h, P


def from_moments(m: Array, h: Array, P: Array) -> Array:
    """Return the inertia matrix of mass, first and second moments: the inverse of `moments`."""
    p = [P[..., i : i + 1, i : i + 1] for i in range(3)]
    diagonal = [p[1] + p[2], p[0] + p[2], p[0] + p[1]]
    return _matrix(m, hat(h[..., 0]), concatenate(diagonal, axis=-1) * _I - P * (1 - _I))


def moment_matrix(M: Array) -> Array:
    """Return the moments as one matrix, ``[[P, h], [h^T, m]]``.

    They are those of an inertia matrix. It is the integral of (r; 1) (r; 1)^T dm, (..., 4, 4). A rigid motion T carries
    it as ``T Pi T^T``; mass that moves with the screw X has the momentum ``cowedge(wedge(X) @ Pi)``, which is M X.
    """
    m, h, P = moments(M)
    return concatenate([concatenate([P, h], axis=-1), concatenate([h.mT, m], axis=-1)], axis=-2)


def from_moment_matrix(Pi: Array) -> Array:
    """Return the inertia matrix of a moment matrix: the inverse of `moment_matrix`."""
    return from_moments(Pi[..., 3:, 3:], Pi[..., :3, 3:], Pi[..., :3, :3])


def shift_inertia(M: Array, C: Array) -> Array:
    """Return the inertia matrix M of a frame at pose C.

    It is seen from the frame in which C is given.
    """
    T = Ad(inverse(C))
    return T.mT @ M @ T


def form_error(M: np.ndarray, tolerance: float = 1e-9) -> str | None:
    """Return why a matrix has no inertia form, or None.

    The form is ``[[Theta, h~], [-h~, m I]]``. Errors are compared with the size of their block: kg m^2, kg m and kg
    have none in common.
    """
    theta, h_hat, mass = M[:3, :3], M[:3, 3:], M[3:, 3:]
    theta_size, h_size, mass_size = (float(np.abs(block).max()) for block in (theta, h_hat, mass))
    # m |c| of any body is at most of the size of (m Theta)^1/2, which is a scale where the COM is at the origin, too.
    h_size = max(h_size, np.sqrt(theta_size * mass_size))

    theta_error, h_error = np.abs(theta - theta.T).max(), np.abs(h_hat - M[3:, :3].T).max()
    if theta_error > tolerance * theta_size or h_error > tolerance * h_size:
        return "is not symmetric"
    if np.abs(mass - M[3, 3] * _I).max() > tolerance * mass_size:
        return "has no m I in its lower right block"
    if np.abs(h_hat + h_hat.T).max() > tolerance * h_size:
        return "has no skew matrix m c~ in its upper right block"
    return None


def restore_form(M: np.ndarray) -> np.ndarray:
    """Return the nearest matrix of exactly the inertia form.

    The form is ``[[Theta, h~], [-h~, m I]]``. The matrix has this form up to rounding.
    """
    h_hat = _mean(M[:3, 3:], M[3:, :3].T)
    return _matrix(M[3, 3], _mean(h_hat, -h_hat.T), _mean(M[:3, :3], M[:3, :3].T))


def _mean(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return the mean of numbers that are the same but for rounding.

    It is the same for (x, y) and (y, x), and does not overflow as their sum might.
    """
    is_smaller = np.abs(x) <= np.abs(y)
    smaller, larger = np.where(is_smaller, x, y), np.where(is_smaller, y, x)
    return smaller + (larger - smaller) / 2


def principal_moments(M: np.ndarray) -> np.ndarray:
    """Return the principal moments (3,) about the COM, ascending.

    The body has mass. They are NaN where they overflow.
    """
    m, h, _ = moments(M)
    c = hat(h[:, 0] / m[0, 0])
    theta = M[:3, :3] + m * (c @ c)  # Steiner, back to the COM
    return np.linalg.eigvalsh(theta) if np.isfinite(theta).all() else np.full(3, np.nan)


def nearest_consistent(M: np.ndarray) -> np.ndarray:
    """Return the nearest inertia matrix that a body can have.

    It is (6, 6), and nearest in second moments. Mass and centre of mass stay, and second moments about it lose their
    negative principal parts: the nearest positive semidefinite matrix, by Frobenius' norm. A body without positive mass
    has none, nor a first moment. N. J. Higham, Computing a nearest symmetric positive semidefinite matrix, Linear
    Algebra and its Applications 103, 1988.
    """
    m, h, P = moments(M)
    if not m[0, 0] > 0:
        m, h = 0 * m, 0 * h
    # Second moments about the COM, P - m c c^T, as principal moments and axes.
    c = h / m if m[0, 0] else h
    size, axes = np.linalg.eigh(P - c @ h.T)
    if size[0] >= -CONSISTENCY_TOLERANCE * np.abs(M[:3, :3]).max() and m[0, 0] == M[3, 3]:
        return M  # consistent, but for rounding
    return np.asarray(from_moments(m, h, axes * size.clip(0) @ axes.T + c @ h.T))


def triangle_slack(principal: np.ndarray) -> float:
    """Return the sum of the two smaller principal moments minus the largest.

    It is never negative for a body that can exist.
    """
    return float(principal[0] + principal[1] - principal[2])
