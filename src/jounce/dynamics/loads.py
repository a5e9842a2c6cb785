"""Wrenches W that bodies exert, with rates, from loads ON bodies in world or body axes and at a point."""

import numpy as np

from jounce.core.scalars import Array
from jounce.dynamics.joint_motion import JointMotion
from jounce.dynamics.kinematics import in_blocks
from jounce.dynamics.recursion import bodies
from jounce.model.mechanism import Mechanism
from jounce.spatial import lie
from jounce.spatial.series import Series


def wrench_of(m: Mechanism, q: Series, base: JointMotion, load: Series, body: str, axes: str, point: Array) -> Series:
    """W, (..., nb, 6), of a load (torque; force), (..., 6, 1), that acts on a body or merged link at a point of it.

    The rates of a load in world axes hold those of the link's rotation.
    """
    link = m.frame(body)
    if axes == "world":
        R = bodies.poses(m, q, base, link.body).map(lambda H: lie.rotation(H @ link.T))
        load = in_blocks(R.mT, 0 * R) @ load
    about_origin = lie.Ad(lie.pose(np.eye(3, dtype=int), -point[:, None])).mT  # (torque + p x force; force)
    W = -(lie.Ad(lie.inverse(link.T)).mT @ about_origin @ load)
    rows = np.zeros((m.nb, 1), dtype=int)
    rows[max(link.body, 0)] = link.body >= 0  # what acts on the ground moves nothing
    return W.map(lambda W: rows * W[..., None, :, 0])
