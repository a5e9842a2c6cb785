"""Kinematics of bodies and of links merged into them, in three frames.

Rates follow by the same formulas; loads act at points of links. A form, `recursion.bodies` or `closed_form`, provides
the functions of the bodies themselves: of the mechanism, the coordinates, the motion of the base and a body (None for
all), poses (..., nb, 4, 4) or (..., 4, 4), and columns of screws in body frames (..., nb, 6, k) or (..., 6, k).
"""

from collections.abc import Callable
from types import ModuleType

import numpy as np

from jounce.core.scalars import Array
from jounce.dynamics.recursion import bodies
from jounce.dynamics.state import JointMotion, State
from jounce.model.mechanism import Mechanism
from jounce.spatial import lie
from jounce.spatial.series import Series, join_series

BodyQuantity = Callable[[Mechanism, Series, JointMotion, int | None], Series]

SCREW_FRAMES = {  # of screws: the axes and the origin of their components
    "body": "the axes of the body, about its origin",
    "world": "inertial axes, about the origin of the body",
    "spatial": "inertial axes, about the inertial origin",
}


def poses(m: Mechanism, x: State, form: ModuleType) -> Series:
    """Return H of all bodies, or of one body or merged link."""
    if x.body is None:
        return form.poses(m, x.q, x.motion_of_base, None)
    link = m.frame(x.body)
    return form.poses(m, x.q, x.motion_of_base, link.body) @ link.T


def screws(m: Mechanism, x: State, form: ModuleType, screws_of: BodyQuantity) -> Series:
    """Return columns of screws, twists or Jacobians, in a frame.

    They are those of all bodies (..., nb, 6, k), or of one body or merged link (..., 6, k).
    """
    Y = screws_of(m, x.q, x.motion_of_base, None if x.body is None else m.frame(x.body).body)
    # From the body to the frame of a link that is merged into it, then to the axes that the caller names.
    if x.body is not None:
        Y = lie.Ad(lie.inverse(m.frame(x.body).T)) @ Y
    return Y if x.frame == "body" else _adjoint(poses(m, x, form), x.frame) @ Y


def _adjoint(H: Series, frame: str) -> Series:
    """Return Ad(H), from the body frame to the spatial one.

    To the world frame it is taken without the offset. In the world frame, world axes at the origin of the body, a screw
    is what it would be if the frame did not move.
    """
    R = H.map(lie.rotation)
    return _assemble_blocks(
        R, R * 0 if frame == "world" else H.map(lambda C: lie.hat(lie.position(C)[..., 0])) @ R
    )  # (AdCij)


def _assemble_blocks(R: Series, below: Series) -> Series:
    """Return ``[[R, 0], [below, R]]``, (..., 6, 6)."""
    return join_series([join_series([R, 0 * R], axis=-1), join_series([below, R], axis=-1)], axis=-2)


def load_wrench(m: Mechanism, x: State, load: Series, *, body: str, axes: str, point: Array) -> Series:
    """Return W of a load on a body or merged link.

    The load (torque; force) is (..., 6, 1), W is (..., nb, 6). The load acts at a point of the link. `axes` are those
    of its components, "body" for the link or "world"; rates of a load in world axes hold those of the link's rotation.
    """
    link = m.frame(body)
    # To the axes of the link.
    if axes == "world":
        R = bodies.poses(m, x.q, x.motion_of_base, link.body).map(lambda H: lie.rotation(H @ link.T))
        load = _assemble_blocks(R.mT, 0 * R) @ load
    # (torque; force) at the point -> (torque + p x force; force) at the origin of the link -> of the body. A load acts
    # on the robot, W is what the bodies exert.
    about_origin = lie.Ad(lie.pose(np.eye(3, dtype=int), -point[:, None])).mT
    W = -(lie.Ad(lie.inverse(link.T)).mT @ about_origin @ load)
    # (..., 6, 1) -> (..., nb, 6), the row of the body alone; a load on the ground (-1) moves nothing.
    rows = np.zeros((m.nb, 1), dtype=int)
    rows[max(link.body, 0)] = link.body >= 0
    return W.map(lambda W: rows * W[..., None, :, 0])
