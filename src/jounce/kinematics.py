"""Poses and Jacobians of bodies and of links merged into them, the latter in the three usual frames, with rates."""

import numpy as np

from jounce import lie, system
from jounce._scalars import Array
from jounce.closed_form import closed_form
from jounce.errors import no_such
from jounce.mechanism import Mechanism
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
    if body is None:
        return Series.of([C])
    link = mechanism.frame(body)
    if link.body < 0:  # fixed on the ground
        return Series.of([0 * C[..., 0, :, :] + link.T])
    return Series.of([C[..., link.body, :, :] @ link.T])


def of_link(mechanism: Mechanism, q: Series, body: str) -> tuple[Series, Array]:
    """The body-fixed Jacobian and the pose of one body or merged link."""
    link = mechanism.frame(body)
    J, C = _of_bodies(mechanism, q)[0], poses(mechanism, q, body)[0]
    if link.body < 0:
        return J.map(lambda J: 0 * J[..., 0, :, :]), C
    return lie.Ad(lie.inverse(link.T)) @ J.map(lambda J: J[..., link.body, :, :]), C


def _of_bodies(mechanism: Mechanism, q: Series) -> tuple[Series, Array]:
    J = closed_form(mechanism, q).J
    return J.map(lambda J: J.reshape((*J.shape[:-2], mechanism.nb, 6, mechanism.n))), system.poses(mechanism, q[0])
