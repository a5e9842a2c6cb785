"""The motion of a joint of several screws and the forces on it, from and to the vectors of other libraries.

With nu = (w; u) its velocities here, those of a library are the same numbers in another order; where it states linear
quantities in world axes, they are A u with the rotation A of the joint. ``a = v'``, and forces are such that powers are
equal.
"""

from collections.abc import Sequence

import numpy as np

from jounce.core.errors import JounceError
from jounce.io.models.states.layout import FreeJoint
from jounce.spatial.lie import rotation

UNIT = 1e-6  # how far a quaternion, or a cosine and a sine, may be from unit length


def motion_from(joint: FreeJoint, terms: Sequence[np.ndarray], label: str) -> list[np.ndarray]:
    """The numbers p of a joint, nu and nu', as many as there are of q, v and a."""
    p = terms[0][..., joint.q]
    count = len(joint.group.places)
    what = "the quaternion" if p.shape[-1] - count == 4 else "cosine and sine"
    p = np.concatenate([p[..., :count], check_unit(p[..., count:], f"{label}: {what}")], axis=-1)
    rates = [turned(joint, p, x[..., joint.v], back=True) for x in terms[1:]]
    return [p, *rates[:1], *(nu - _turning(rates[0]) if joint.in_world else nu for nu in rates[1:])]


def put_motion(joint: FreeJoint, motion: Sequence[np.ndarray], out: Sequence[np.ndarray]) -> None:
    """Write p, nu, nu' of a joint into q, v, a."""
    p, *rates = motion
    out[0][..., joint.q] = p
    for k, (nu, x) in enumerate(zip(rates, out[1:], strict=True)):
        x[..., joint.v] = turned(joint, p, nu + _turning(rates[0]) if k and joint.in_world else nu)


def _turning(nu: np.ndarray) -> np.ndarray:
    """What the turning of its axes adds to the acceleration, (0; w x u)."""
    return np.concatenate([0 * nu[..., :3], np.cross(nu[..., :3], nu[..., 3:])], axis=-1)


def turned(joint: FreeJoint, p: np.ndarray | None, x: np.ndarray, back: bool = False) -> np.ndarray:
    """Velocities or forces of a joint at p into the axes of its library, or back from them."""
    if not joint.in_world or p is None:
        return x
    A = rotation(joint.group.pose(p))
    linear = ((A.mT if back else A) @ x[..., 3:, None])[..., 0]
    return np.concatenate(np.broadcast_arrays(x[..., :3], linear), axis=-1)


def check_unit(x: np.ndarray, what: str) -> np.ndarray:
    """Return vectors (..., k) that are meant to have unit length, with unit length; NaN passes."""
    length = np.linalg.norm(x, axis=-1, keepdims=True)
    off = np.abs(length - 1)[..., 0]
    if (off > UNIT).any():
        at = np.unravel_index(np.nanargmax(off), off.shape)
        where = f" of sample {', '.join(map(str, at))}" if at else ""
        raise JounceError(f"{what}{where} has norm {length[at][0]:.6g}; expected 1 within {UNIT:g}: normalize it")
    return np.asarray(x / length)
