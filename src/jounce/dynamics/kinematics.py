"""Poses and Jacobians of bodies and of links merged into them, the latter in the three usual frames, with rates."""

import numpy as np

from jounce.dynamics import recursion, system
from jounce.errors import one_of
from jounce.model.mechanism import Mechanism
from jounce.spatial import lie
from jounce.spatial.series import Series, from_rate

FRAMES = ("body", "world", "spatial")


def jacobian(mechanism: Mechanism, q: Series, body: str | None, frame: str) -> Series:
    """J with V = J qd: of all bodies (..., nb, 6, n), or of one body or merged link (..., 6, n)."""
    one_of("frame", frame, FRAMES)
    J = recursion.system_jacobian(mechanism, q) if body is None else of_link(mechanism, q, body)
    if frame == "body":
        return J
    C = poses(mechanism, q, body)[0]
    V = J @ (q.dot if body is not None else q.dot.map(lambda v: v[..., None, :, :]))
    if frame == "world":  # world axes, body origin: as if the frame did not translate
        C = lie.pose(lie.rotation(C), 0 * lie.position(C))
        V = np.diag([1, 1, 1, 0, 0, 0]) @ V
    return from_rate(lie.Ad(C), lambda S: S @ V.map(lambda v: lie.ad(v[..., 0]))) @ J  # d/dt Ad(C) = Ad(C) ad(V)


def poses(mechanism: Mechanism, q: Series, body: str | None) -> Series:
    """C of all bodies (..., nb, 4, 4), or of one body or merged link (..., 4, 4)."""
    if body is None:
        return Series.of([system.poses(mechanism, q[0])])
    link = mechanism.frame(body)
    return Series.of([recursion.pose(mechanism, q, link.body) @ link.T])


def of_link(mechanism: Mechanism, q: Series, body: str) -> Series:
    """The body-fixed Jacobian of one body or merged link, on the ground too."""
    link = mechanism.frame(body)
    return lie.Ad(lie.inverse(link.T)) @ recursion.jacobian(mechanism, q, link.body)
