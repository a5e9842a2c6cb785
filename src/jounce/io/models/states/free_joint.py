"""The motion of a joint of several screws and the forces on it, from and to the vectors of other libraries.

With nu = (w; u) its velocities here, those of a library are the same numbers in another order; where it states linear
quantities in world axes, they are A u with the rotation A of the joint. ``a = v'``, and forces are such that powers are
equal.
"""

from collections.abc import Sequence

import numpy as np

from jounce.arguments.poses import POSE_TOLERANCE, worst_sample
from jounce.core.errors import JounceError, quote_value
from jounce.io.models.states.layout import FreeJointPlace
from jounce.spatial.groups import FREE
from jounce.spatial.lie import Ad, inverse, rotation


def motion_from(joint: FreeJointPlace, terms: Sequence[np.ndarray], label: str) -> list[np.ndarray]:
    """The numbers p of a joint, nu and nu', as many as there are of q, v and a."""
    p = terms[0][..., joint.q]
    count = len(joint.group.places)
    what = "the quaternion" if p.shape[-1] - count == 4 else "cosine and sine"
    where = f"{label} of {quote_value(joint.name)}" if joint.T is None else label
    p = np.concatenate([p[..., :count], check_unit(p[..., count:], f"{where}: {what}")], axis=-1)
    rates = [_rotate_linear(joint, p, x[..., joint.v], back=True) for x in terms[1:]]
    rates = [*rates[:1], *(nu - _transport_acceleration(rates[0]) if joint.in_world else nu for nu in rates[1:])]
    if joint.T is None:
        return [p, *rates]
    return [FREE.numbers(joint.ground @ FREE.pose(p) @ joint.T), *(nu @ Ad(inverse(joint.T)).T for nu in rates)]


def put_motion(joint: FreeJointPlace, motion: Sequence[np.ndarray], out: Sequence[np.ndarray]) -> None:
    """Write p, nu, nu' of a joint into q, v, a."""
    out[0][..., joint.q] = p = _joint_numbers(joint, motion[0])
    rates = motion[1:] if joint.T is None else [nu @ Ad(joint.T).T for nu in motion[1:]]
    for k, (nu, x) in enumerate(zip(rates, out[1:], strict=True)):
        x[..., joint.v] = _rotate_linear(
            joint, p, nu + _transport_acceleration(rates[0]) if k and joint.in_world else nu
        )


def _transport_acceleration(nu: np.ndarray) -> np.ndarray:
    """What the turning of its axes adds to the acceleration, (0; w x u)."""
    return np.concatenate([0 * nu[..., :3], np.cross(nu[..., :3], nu[..., 3:])], axis=-1)


def force_from(joint: FreeJointPlace, p: np.ndarray | None, tau: np.ndarray) -> np.ndarray:
    """The forces of a joint from those of a library; at p, where these are in world axes."""
    W = (
        tau[..., joint.v]
        if p is None
        else _rotate_linear(joint, _joint_numbers(joint, p), tau[..., joint.v], back=True)
    )
    return W if joint.T is None else np.asarray(W @ Ad(joint.T))


def force_to(joint: FreeJointPlace, p: np.ndarray | None, W: np.ndarray) -> np.ndarray:
    """The forces of a library from those of a joint."""
    W = W if joint.T is None else W @ Ad(inverse(joint.T))
    return W if p is None else _rotate_linear(joint, _joint_numbers(joint, p), W)


def _joint_numbers(joint: FreeJointPlace, p: np.ndarray) -> np.ndarray:
    """The numbers of the joint itself, of the link that it carries: w of quaternions is not negative."""
    C = joint.group.pose(p)
    return joint.group.numbers(C if joint.T is None else inverse(joint.ground) @ C @ inverse(joint.T))


def _rotate_linear(joint: FreeJointPlace, p: np.ndarray, x: np.ndarray, back: bool = False) -> np.ndarray:
    """Velocities or forces of a joint at p into the axes of its library, or back from them."""
    if not joint.in_world:
        return x
    A = rotation(joint.group.pose(p))
    linear = ((A.mT if back else A) @ x[..., 3:, None])[..., 0]
    return np.concatenate(np.broadcast_arrays(x[..., :3], linear), axis=-1)


def check_unit(x: np.ndarray, what: str) -> np.ndarray:
    """Return vectors (..., k) that are meant to have unit length, with unit length; NaN passes."""
    length = np.linalg.norm(x, axis=-1, keepdims=True)
    off = np.abs(length - 1)[..., 0]
    if (off > POSE_TOLERANCE).any():
        at, where = worst_sample(off)
        came = f"{what}{where} has norm {length[at][0]:.6g}"
        raise JounceError(f"{came}; expected 1 within {POSE_TOLERANCE:g}: normalize it")
    return np.asarray(x / length)
