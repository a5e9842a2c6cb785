"""Poses, twists and Jacobians by sweeps outward: one body's at the cost of the path to it."""

from collections.abc import Callable

from jounce.dynamics.base import BaseMotion
from jounce.dynamics.recursion.joints import Joint, batch_zeros, joints
from jounce.dynamics.recursion.sweeps import evaluate_in_order
from jounce.model.coordinates import base_columns, joint_columns
from jounce.model.mechanism import Mechanism, path_to
from jounce.spatial.series import Series, from_rate, joined


def poses(mechanism: Mechanism, q: Series, base: BaseMotion, body: int | None) -> Series:
    """H_i = H_p B_i exp(X_i theta_i): of one body (..., 4, 4), of the ground or base, -1, or of all (..., nb, 4, 4)."""
    return _outward(mechanism, q, body, base.H, lambda joint, H_p: H_p @ joint.B @ _motion(joint))  # (Ci)


def _motion(joint: Joint) -> Series:
    return from_rate(joint.T, lambda T: T @ joint.X_hat * joint.rate)


def twists(mechanism: Mechanism, q: Series, base: BaseMotion, body: int | None) -> Series:
    """V_i = Ad(C_ip) V_p + X_i theta_i': of one body (..., 6, 1), or of all (..., nb, 6, 1)."""
    return _outward(mechanism, q, body, base.V, lambda joint, V_p: joint.twists(V_p) + joint.X * joint.rate)


def jacobians(mechanism: Mechanism, q: Series, base: BaseMotion, body: int | None) -> Series:
    """J_i = Ad(C_ip) J_p + X_i G_i, with the row G_i of G: of one body (..., 6, nv), or of all (..., nb, 6, nv)."""
    own, root = joint_columns(mechanism), Series.constant(base_columns(mechanism))
    return _outward(mechanism, q, body, root, lambda joint, J_p: joint.twists(J_p) + joint.X @ (joint.G @ own))


def _outward(
    mechanism: Mechanism, q: Series, body: int | None, root: Series, step: Callable[[Joint, Series], Series]
) -> Series:
    """Compute a quantity of each body from that of its parent, for one body or for all."""
    bodies = list(range(mechanism.nb)) if body is None else path_to(mechanism, body)
    found = {-1: root}
    for i, joint in zip(bodies, joints(mechanism, q, bodies), strict=True):
        found[i] = step(joint, found[joint.parent])
    if body is not None:
        return evaluate_in_order(found[body] + batch_zeros(q), found.values())
    named = [-1, *bodies] if mechanism.base else bodies
    all_bodies = [(found[i] + batch_zeros(q)).map(lambda x: x[..., None, :, :]) for i in named]
    return evaluate_in_order(joined(all_bodies, axis=-3), found.values())
