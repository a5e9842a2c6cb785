"""Poses and screws of bodies, and of links merged into them, in the three usual frames, with rates.

Each method provides functions of the mechanism, the coordinates, the motion of the base and a body (None for all) for
the bodies themselves: poses (..., nb, 4, 4) or (..., 4, 4), and columns of screws (..., nb, 6, k) or (..., 6, k) in
body frames.
"""

from collections.abc import Callable

from jounce.dynamics.joint_motion import JointMotion
from jounce.model.mechanism import Mechanism
from jounce.spatial import lie
from jounce.spatial.series import Series, joined

OfBodies = Callable[[Mechanism, Series, JointMotion, int | None], Series]

FRAMES = {  # of screws: the axes and the origin of their components
    "body": "the axes of the body, about its origin",
    "world": "inertial axes, about the origin of the body",
    "spatial": "inertial axes, about the inertial origin",
}


def poses(m: Mechanism, q: Series, base: JointMotion, body: str | None, of_bodies: OfBodies) -> Series:
    """H of all bodies, or of one body or merged link."""
    if body is None:
        return of_bodies(m, q, base, None)
    link = m.frame(body)
    return of_bodies(m, q, base, link.body) @ link.T


def screws(
    m: Mechanism, q: Series, base: JointMotion, body: str | None, frame: str, poses_of: OfBodies, screws_of: OfBodies
) -> Series:
    """Columns of screws, twists or Jacobians, of all bodies or of one body or merged link, in a frame."""
    Y = screws_of(m, q, base, None if body is None else m.frame(body).body)
    if body is not None:
        Y = lie.Ad(lie.inverse(m.frame(body).T)) @ Y
    return Y if frame == "body" else _adjoint(poses(m, q, base, body, poses_of), frame) @ Y


def _adjoint(H: Series, frame: str) -> Series:
    """Ad(H), which takes screws from the body frame to the spatial one; without the offset to the world frame.

    In the world frame, world axes at the origin of the body, a screw is what it would be if the frame did not move.
    """
    R = H.map(lie.rotation)
    return in_blocks(R, R * 0 if frame == "world" else H.map(lambda C: lie.hat(lie.position(C)[..., 0])) @ R)  # (AdCij)


def in_blocks(R: Series, below: Series) -> Series:
    """``[[R, 0], [below, R]]``, (..., 6, 6)."""
    return joined([joined([R, 0 * R], axis=-1), joined([below, R], axis=-1)], axis=-2)
