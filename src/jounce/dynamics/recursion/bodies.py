"""Poses, twists and Jacobians by sweeps outward: one body's at the cost of the path to it."""

from collections.abc import Callable

import numpy as np

from jounce.dynamics.recursion.joints import Joint, joints, still
from jounce.dynamics.recursion.sweeps import in_order
from jounce.model.mechanism import Mechanism, path_to
from jounce.spatial.series import Series, from_rate, joined

_NONE = Series.constant(np.zeros((6, 0), dtype=int))  # the Jacobian of the ground, a column for each joint below
_AT_REST = Series.constant(np.zeros((6, 1), dtype=int))
_ORIGIN = Series.constant(np.eye(4, dtype=int))


def poses(mechanism: Mechanism, q: Series, body: int | None) -> Series:
    """H_i = H_p B_i exp(X_i theta_i): of one body (..., 4, 4), of the ground, -1, or of all (..., nb, 4, 4)."""
    return _outward(mechanism, q, body, _ORIGIN, lambda joint, H_p: H_p @ joint.B @ _motion(joint))  # (Ci)


def _motion(joint: Joint) -> Series:
    return from_rate(joint.T, lambda T: T @ joint.X_hat * joint.rate)


def twists(mechanism: Mechanism, q: Series, body: int | None) -> Series:
    """V_i = Ad(C_ip) V_p + X_i theta_i': of one body (..., 6, 1), or of all (..., nb, 6, 1)."""
    return _outward(mechanism, q, body, _AT_REST, lambda joint, V_p: joint.twists(V_p) + joint.X * joint.rate)


def jacobians(mechanism: Mechanism, q: Series, body: int | None) -> Series:
    """The body-fixed Jacobian of one body (..., 6, n), or of all (..., nb, 6, n); J_i = Ad(C_ip) J_p, and X_i."""

    def step(joint: Joint, J_p: Series) -> Series:
        return joined([joint.twists(J_p), Series.constant(joint.X)], axis=-1)

    def in_coordinates(J: Series, i: int) -> Series:
        return J @ mechanism.G[path_to(mechanism, i)]

    return _outward(mechanism, q, body, _NONE, step, in_coordinates)


def _outward(
    mechanism: Mechanism,
    q: Series,
    body: int | None,
    ground: Series,
    step: Callable[[Joint, Series], Series],
    finish: Callable[[Series, int], Series] = lambda x, i: x,
) -> Series:
    """What each body gets from its parent, of one body or of all of them side by side."""
    bodies = list(range(mechanism.nb)) if body is None else path_to(mechanism, body)
    found = {-1: ground}
    for i, joint in zip(bodies, joints(mechanism, q, bodies), strict=True):
        found[i] = step(joint, found[joint.parent])
    asked = bodies if body is None else [body]
    results = [finish(found[i], i) + still(q) for i in asked]
    together = results[0] if body is not None else joined([x.map(lambda a: a[..., None, :, :]) for x in results], -3)
    return in_order(together, found.values())
