"""Poses and Jacobians of bodies and of links merged into them, the latter in the three usual frames, with rates."""

import numpy as np

from jounce import lie, system
from jounce._scalars import Array
from jounce.closed_form import closed_form
from jounce.errors import no_such
from jounce.mechanism import Frame, Mechanism
from jounce.series import Series, from_rate

FRAMES = ("body", "world", "spatial")


def jacobian(mechanism: Mechanism, q: Series, body: str | None, frame: str) -> Series:
    """J with V = J qd: of all bodies (..., nb, 6, n), or of one body or merged link (..., 6, n)."""
    if frame not in FRAMES:
        raise no_such("frame", frame, FRAMES)
    J, C = _of_bodies(mechanism, q) if body is None else of_link(mechanism, q, body)
    if frame == "body":
        return J
    V = J @ (q.dot if body is not None else q.dot.map(lambda v: v[..., None, :, :]))
    if frame == "world":  # world axes, body origin: as if the frame did not translate
        C = lie.pose(lie.rotation(C), 0 * lie.position(C))
        V = np.diag([1, 1, 1, 0, 0, 0]) @ V
    return from_rate(lie.Ad(C), lambda S: S @ V.map(lambda v: lie.ad(v[..., 0]))) @ J  # d/dt Ad(C) = Ad(C) ad(V)


def poses(mechanism: Mechanism, q: Series, body: str | None) -> Series:
    """C of all bodies (..., nb, 4, 4), or of one body or merged link (..., 4, 4)."""
    C = system.poses(mechanism, q[0])
    return Series.of([C if body is None else _link_pose(mechanism.frame(body), C)])


def of_link(mechanism: Mechanism, q: Series, body: str) -> tuple[Series, Array]:
    """The body-fixed Jacobian and the pose of one body or merged link."""
    link = mechanism.frame(body)
    J, C = _of_bodies(mechanism, q)
    if link.body < 0:  # fixed on the ground
        return J.map(lambda J: 0 * J[..., 0, :, :]), _link_pose(link, C)
    return lie.Ad(lie.inverse(link.T)) @ J.map(lambda J: J[..., link.body, :, :]), _link_pose(link, C)


def _link_pose(link: Frame, C: Array) -> Array:
    return 0 * C[..., 0, :, :] + link.T if link.body < 0 else C[..., link.body, :, :] @ link.T


def _of_bodies(mechanism: Mechanism, q: Series) -> tuple[Series, Array]:
    F = closed_form(mechanism, q)
    return F.J.map(lambda J: J.reshape((*J.shape[:-2], mechanism.nb, 6, mechanism.n))), F.poses
