"""The motion of a base and the wrench on it, from and to the vectors of a floating joint.

With R the rotation of the joint, A = R where a library states linear quantities in world axes and A = 1 otherwise:
``v = (A u; w)``, ``a = v'``, ``tau = (A f; m)`` in its order, (linear; angular), for the twist (w; u) and the wrench
(m; f) in the axes of the joint's moved frame, so that powers are equal.
"""

from collections.abc import Sequence

import numpy as np

from jounce.core.errors import JounceError
from jounce.io.models.states.layout import FreeJoint, Layout
from jounce.spatial import lie

UNIT = 1e-6  # how far a quaternion, or a cosine and a sine, may be from unit length


def motion_from(
    layout: Layout, joint: FreeJoint, link: str, terms: Sequence[np.ndarray], label: str
) -> tuple[np.ndarray, ...]:
    """C, V, Vd of a link on a floating joint, as many as there are of q, v and a."""
    C = _pose_from(layout, joint, terms[0], label)
    T, R = joint.moved[link], lie.rotation(C)
    found: list[np.ndarray] = []
    for k, x in enumerate(terms[1:]):
        linear, angular = _halves(joint, x)
        u = _turn(layout, R.mT, linear)
        if k and layout.linear_in_world:
            w, v = found[0][..., :3], found[0][..., 3:]
            u = u - np.cross(w, v)
        found.append(_joined(angular, u))
    to_link = lie.Ad(lie.inverse(T)).T
    return joint.ground @ C @ T, *(V @ to_link for V in found)


def put_motion(
    layout: Layout, joint: FreeJoint, link: str, base: Sequence[np.ndarray], out: Sequence[np.ndarray]
) -> None:
    """Write the motion C, V, Vd of a link into q, v, a."""
    T = joint.moved[link]
    C = lie.inverse(joint.ground) @ base[0] @ lie.inverse(T)
    R, start = lie.rotation(C), joint.q + 3
    out[0][..., joint.q : start] = lie.position(C)[..., 0]
    out[0][..., [start + k for k in layout.quaternion]] = lie.to_quaternion(R)
    twists = [V @ lie.Ad(T).T for V in base[1:]]
    for k, (V, x) in enumerate(zip(twists, out[1:], strict=True)):
        u = V[..., 3:]
        if k and layout.linear_in_world:
            u = u + np.cross(twists[0][..., :3], twists[0][..., 3:])
        x[..., joint.v : joint.v + 6] = _joined(_turn(layout, R, u), V[..., :3])


def wrench_from(
    layout: Layout, joint: FreeJoint, link: str, tau: np.ndarray, q: np.ndarray | None, label: str
) -> np.ndarray:
    """The wrench (moment; force) on a link in its own axes; q is needed where forces are in world axes."""
    force, moment = _halves(joint, tau)
    if q is not None:
        force = _turn(layout, lie.rotation(_pose_from(layout, joint, q, label)).mT, force)
    return _joined(moment, force) @ lie.Ad(joint.moved[link])


def wrench_to(layout: Layout, joint: FreeJoint, link: str, W: np.ndarray, C: np.ndarray | None) -> np.ndarray:
    """The forces of a floating joint, (linear; angular), of a wrench on a link whose pose is C."""
    T = lie.inverse(joint.moved[link])
    W = W @ lie.Ad(T)
    force = W[..., 3:]
    if C is not None:
        force = _turn(layout, lie.rotation(lie.inverse(joint.ground) @ C @ T), force)
    return _joined(force, W[..., :3])


def check_unit(x: np.ndarray, what: str) -> np.ndarray:
    """Return vectors (..., k) that are meant to have unit length, with unit length; NaN passes."""
    length = np.linalg.norm(x, axis=-1, keepdims=True)
    off = np.abs(length - 1)[..., 0]
    if (off > UNIT).any():
        at = np.unravel_index(np.nanargmax(off), off.shape)
        where = f" of sample {', '.join(map(str, at))}" if at else ""
        raise JounceError(f"{what}{where} has norm {length[at][0]:.6g}; expected 1 within {UNIT:g}: normalize it")
    return np.asarray(x / length)


def _pose_from(layout: Layout, joint: FreeJoint, q: np.ndarray, label: str) -> np.ndarray:
    start = joint.q + 3
    Q = check_unit(q[..., [start + k for k in layout.quaternion]], f"{label}: the quaternion")
    return np.asarray(lie.pose(lie.from_quaternion(Q), q[..., joint.q : start, None]))


def _halves(joint: FreeJoint, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return x[..., joint.v : joint.v + 3], x[..., joint.v + 3 : joint.v + 6]


def _joined(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.concatenate(np.broadcast_arrays(a, b), axis=-1)


def _turn(layout: Layout, R: np.ndarray, x: np.ndarray) -> np.ndarray:
    """A linear quantity into the axes of a library by R, or from them by its transpose."""
    return np.asarray((R @ x[..., None])[..., 0] if layout.linear_in_world else x)
