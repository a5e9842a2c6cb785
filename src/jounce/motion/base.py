"""The motion of a base as a curve of seven columns, its position and a quaternion, and its pose and twist from them.

The quaternion may have any length but zero: any smooth curve in four dimensions that avoids zero is a smooth motion,
and its rates give those of the twist exactly. With Q = (w; v), the angular velocity in the axes of the base is
``2 E(Q) Qd / |Q|^2``, ``E = [-v, w 1 - hat(v)]``.
"""

from collections.abc import Sequence

import numpy as np

from jounce.errors import JounceError
from jounce.spatial.lie import hat, pose, rotation
from jounce.spatial.linear import solved
from jounce.spatial.series import Series, from_rate, joined

COLUMNS = ("x", "y", "z", "qw", "qx", "qy", "qz")
NOT_UNIT = 1e-3  # a norm further from 1 than rounding to three digits leaves it


def motion_of(rates: Sequence[np.ndarray]) -> tuple[np.ndarray, ...]:
    """C, V, Vd, ... from position and quaternion (N, 7) and their rates: as many terms as there are rates."""
    from scipy.spatial.transform import Rotation  # slow to import

    x = Series.of([rate[:, :, None] for rate in rates])
    p, Q = x.map(lambda x: x[:, :3]), x.map(lambda x: x[:, 3:])
    R = Rotation.from_quat(rates[0][:, 3:], scalar_first=True).as_matrix()
    C = pose(R, rates[0][:, :3, None])
    w = solved(Q.mT @ Q, (Q.map(_turning) @ Q.dot * 2).mT).mT
    to_base = from_rate(rotation(C).mT, lambda RT: -(w.map(lambda w: hat(w[..., 0])) @ RT))
    V = joined([w, to_base @ p.dot], axis=-2)
    return (C, *(V[k][..., 0] for k in range(len(rates) - 1)))


def _turning(Q: np.ndarray) -> np.ndarray:
    """E of quaternions (N, 4, 1): the vector part of the product of the conjugate with another, (N, 3, 4)."""
    w, v = Q[:, :1], Q[:, 1:]
    return np.concatenate([-v, w * np.eye(3) - hat(v[..., 0])], axis=-1)


def checked_quaternions(Q: np.ndarray, names: Sequence[str]) -> np.ndarray:
    """Unit quaternions (N, 4), each with the sign that is nearest to the one before."""
    norms = np.linalg.norm(Q, axis=1)
    off = np.abs(norms - 1)
    if not (off <= NOT_UNIT).all():
        i = int(np.nanargmax(np.where(np.isfinite(off), off, np.inf)))
        raise JounceError(f"row {i}: {', '.join(names)} have the norm {norms[i]:.6g}; expected unit quaternions")
    unit = Q / norms[:, None]
    turns = np.einsum("ij,ij->i", unit[1:], unit[:-1]) < 0
    return unit * np.where(np.concatenate([[False], np.cumsum(turns) % 2 == 1]), -1, 1)[:, None]
