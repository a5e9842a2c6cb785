"""Twists by sweeps outward: the Jacobians of bodies, one body's at the cost of the path to it."""

import numpy as np

from jounce._scalars import Array
from jounce.dynamics.recursion.joints import Joint, joint_variables, joints, motions, still
from jounce.dynamics.recursion.sweeps import in_order
from jounce.model.mechanism import Mechanism, path_to
from jounce.spatial.series import Series, joined

_NONE = Series.constant(np.zeros((6, 0), dtype=int))  # the Jacobian of the ground, a column for each joint below


def jacobian(mechanism: Mechanism, q: Series, body: int) -> Series:
    """The body-fixed Jacobian of one body, (..., 6, n), or of the ground, -1; J_i = Ad(C_ip) J_p, and X_i besides."""
    path = path_to(mechanism, body)
    steps = [_NONE]
    for joint in joints(mechanism, q, path):
        steps.append(_outward(joint, steps[-1]))
    return in_order(steps[-1] @ mechanism.G[path] + still(q), steps)


def system_jacobian(mechanism: Mechanism, q: Series) -> Series:
    """The Jacobians of all bodies, (..., nb, 6, n); J_i = Ad(C_ip) J_p + X_i G_i, with the row G_i of G."""
    steps: list[Series] = []
    for i, joint in enumerate(joints(mechanism, q)):
        own = Series.constant(joint.X @ mechanism.G[i : i + 1])
        steps.append(own if joint.parent < 0 else joint.twists(steps[joint.parent]) + own)
    J = [(J_i + still(q)).map(lambda x: x[..., None, :, :]) for J_i in steps]
    return in_order(joined(J, axis=-3), steps)


def _outward(joint: Joint, J_p: Series) -> Series:
    return joined([joint.twists(J_p), Series.constant(joint.X)], axis=-1)


def pose(mechanism: Mechanism, q: Series, body: int) -> Array:
    """C, the pose of one body, or of the ground, -1: (..., 4, 4)."""
    path = path_to(mechanism, body)
    T = motions(mechanism, joint_variables(mechanism, q)[0], path)
    C = np.eye(4, dtype=int) + still(q)[0]
    for k, i in enumerate(path):
        C = C @ mechanism.B[i] @ T[..., k, :, :]  # (Ci)
    return C
