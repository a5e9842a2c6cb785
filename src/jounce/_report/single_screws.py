"""Joints of several screws as joints of one screw each, for pages and sliders: turns about x, y and z, then shifts.

A pose in the group is ``exp(X_1 s_1) exp(X_2 s_2) ...`` over its screws, each in the axes that the former ones moved.
"""

import numpy as np

from jounce.model.mechanism import Mechanism
from jounce.model.positions import Position, multiscrew_joints, position_count, single_joint_positions, single_positions
from jounce.spatial.lie import exp


def to_single_screws(m: Mechanism, q: np.ndarray) -> np.ndarray:
    """s (..., n) of positions q (..., nq): these themselves for joints of one screw."""
    if not multiscrew_joints(m):
        return q
    s = single_joint_positions(m, q)
    for joint in multiscrew_joints(m).values():
        s[..., joint.coordinates] = _split_pose(joint, q[..., joint.numbers])
    return s


def from_single_screws(m: Mechanism, s: np.ndarray) -> np.ndarray:
    """Positions q (nq,) of s (n,)."""
    if not multiscrew_joints(m):
        return s
    q = np.zeros(position_count(m)) + s @ single_positions(m)
    for joint in multiscrew_joints(m).values():
        H = np.eye(4)
        for X, step in zip(joint.group.X.T.astype(float), s[joint.coordinates], strict=True):
            H = H @ exp(X, step[None, None])
        q[joint.numbers] = joint.group.numbers(H)
    return q


def _split_pose(joint: Position, p: np.ndarray) -> np.ndarray:
    H = np.asarray(joint.group.pose(p))
    R, r = H[..., :3, :3], H[..., :3, 3:]
    a = np.arctan2(-R[..., 1, 2], R[..., 2, 2])
    c, s = np.cos(a)[..., None], np.sin(a)[..., None]
    y, z = c * R[..., 1, :] + s * R[..., 2, :], c * R[..., 2, :] - s * R[..., 1, :]  # without the turn about x
    turns = [a, np.arctan2(R[..., 0, 2], z[..., 2]), np.arctan2(y[..., 0], y[..., 1])]
    return np.concatenate([np.stack(turns, axis=-1), (R.mT @ r)[..., 0]], axis=-1)[..., list(joint.group.axes)] + 0.0
