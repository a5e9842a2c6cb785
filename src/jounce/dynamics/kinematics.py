"""Poses and screws of bodies, and of links merged into them, in the three usual frames, with rates.

What a method knows of the bodies themselves comes as functions of the mechanism, the coordinates and a body, None for
all of them: poses (..., nb, 4, 4) or (..., 4, 4), and columns of screws (..., nb, 6, k) or (..., 6, k) in body frames.
"""

from collections.abc import Callable

from jounce.dynamics.state import State
from jounce.model.mechanism import Mechanism
from jounce.spatial import lie
from jounce.spatial.series import Series, joined

OfBodies = Callable[[Mechanism, Series, int | None], Series]

FRAMES = {  # of screws: the axes and the origin of their components
    "body": "the axes of the body, about its origin",
    "world": "inertial axes, about the origin of the body",
    "spatial": "inertial axes, about the inertial origin",
}


def poses(mechanism: Mechanism, x: State, of_bodies: OfBodies) -> Series:
    """H of all bodies, or of the body or merged link that the state names."""
    if x.body is None:
        return of_bodies(mechanism, x.q, None)
    link = mechanism.frame(x.body)
    return of_bodies(mechanism, x.q, link.body) @ link.T


def screws(mechanism: Mechanism, x: State, poses_of: OfBodies, screws_of: OfBodies) -> Series:
    """Columns of screws, twists or Jacobians, of all bodies or of the one that the state names, in its frame."""
    body = None if x.body is None else mechanism.frame(x.body).body
    Y = screws_of(mechanism, x.q, body)
    if x.body is not None:
        Y = lie.Ad(lie.inverse(mechanism.frame(x.body).T)) @ Y
    return Y if x.frame == "body" else _adjoint(poses(mechanism, x, poses_of), x.frame) @ Y


def _adjoint(H: Series, frame: str) -> Series:
    """Ad(H), which takes screws from the body frame to the spatial one; without the offset to the world frame.

    In the world frame, world axes at the origin of the body, a screw is what it would be if the frame did not move.
    """
    R = H.map(lie.rotation)
    return in_blocks(R, R * 0 if frame == "world" else H.map(lambda C: lie.hat(lie.position(C)[..., 0])) @ R)  # (AdCij)


def in_blocks(R: Series, below: Series) -> Series:
    """``[[R, 0], [below, R]]``, (..., 6, 6)."""
    return joined([joined([R, 0 * R], axis=-1), joined([below, R], axis=-1)], axis=-2)
