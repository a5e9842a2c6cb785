"""Poses, twists and Jacobians by sweeps outward: one body's at the cost of the path to it."""

from collections.abc import Callable

import numpy as np

from jounce.dynamics.recursion.joints import MovingJoint, batch_zeros, joints
from jounce.dynamics.recursion.sweeps import evaluate_in_order
from jounce.dynamics.state import BASE_AT_REST, JointMotion
from jounce.model.coordinates import velocity_map, velocity_rows
from jounce.model.mechanism import Mechanism, path_to
from jounce.spatial.series import Series, join_series


def poses(m: Mechanism, q: Series, base: JointMotion, body: int | None) -> Series:
    """H_i = H_p B_i exp(X_i theta_i): of one body (..., 4, 4), of the ground, -1, or of all (..., nb, 4, 4)."""
    ground = (BASE_AT_REST if m.floats else base).H
    return _sweep_outward(m, q, base, body, ground, lambda joint, _, H_p: H_p @ joint.B @ joint.motion)  # (Ci)


def twists(m: Mechanism, q: Series, base: JointMotion, body: int | None) -> Series:
    """V_i = Ad(C_ip) V_p + X_i nu_i: of one body (..., 6, 1), or of all (..., nb, 6, 1)."""
    ground = (BASE_AT_REST if m.floats else base).V
    return _sweep_outward(m, q, base, body, ground, lambda joint, _, V_p: joint.twists(V_p) + joint.X @ joint.rate)


def jacobians(m: Mechanism, q: Series, base: JointMotion, body: int | None) -> Series:
    """J_i = Ad(C_ip) J_p + X_i G_i, with the rows G_i of G: of one body (..., 6, nv), or of all (..., nb, 6, nv)."""
    G, ground = velocity_map(m), Series.constant(np.zeros((6, m.nv), dtype=int))
    return _sweep_outward(m, q, base, body, ground, lambda joint, own, J_p: joint.twists(J_p) + joint.X @ G[own])


def _sweep_outward(
    m: Mechanism,
    q: Series,
    base: JointMotion,
    body: int | None,
    ground: Series,
    step: Callable[[MovingJoint, list[int], Series], Series],
) -> Series:
    """Compute a quantity of each body from that of its parent, for one body or for all."""
    bodies = list(range(m.nb)) if body is None else path_to(m, body)
    found = {-1: ground}
    for i, joint in zip(bodies, joints(m, q, base, bodies), strict=True):
        found[i] = step(joint, velocity_rows(m, i), found[joint.parent])
    if body is not None:
        return evaluate_in_order(found[body] + batch_zeros(q), found.values())
    all_bodies = [(found[i] + batch_zeros(q)).map(lambda x: x[..., None, :, :]) for i in bodies]
    return evaluate_in_order(join_series(all_bodies, axis=-3), found.values())
