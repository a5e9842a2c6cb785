"""The energy regressor: the kinetic and potential energy of the unit inertial parameters of all bodies.

A body whose origin has the velocity v and the place r has the energy

    E = m (v . v / 2 - g . r) + h . (v x w - g) + w . I w / 2

in its own axes, with its first moment h and its inertia tensor I about the origin. Velocities, g and g . r are taken
outward in frames on the joint axes, where they need the fewest operations; constants take the parameters there.
"""

from functools import lru_cache

import numpy as np

from jounce.core.scalars import Array
from jounce.dynamics.joint_motion import JointMotion
from jounce.dynamics.recursion.forces import ground
from jounce.dynamics.recursion.joints import batch_zeros, rows
from jounce.dynamics.recursion.steps import BodyMotion, outward_velocity
from jounce.dynamics.recursion.sweeps import evaluate_in_order
from jounce.dynamics.recursion.tree import aligned_tree
from jounce.model.equivalent import frame_shifts, on_axes
from jounce.model.mechanism import Mechanism
from jounce.spatial import inertia
from jounce.spatial.inertia import PARAMETERS
from jounce.spatial.lie import hat, inverse
from jounce.spatial.series import Series, joined


def energy_regressor(m: Mechanism, q: Series, base: JointMotion | None = None) -> Series:
    """YE, (..., 10 nb, 1): the energies T + U of the unit inertial parameters of all bodies, the base's first."""
    tree, gravity = aligned_tree(on_axes(m), q, base), m.gravity[:, None]
    velocities = {-1: ground(0 * m.gravity)}
    field, work = {-1: Series.constant(gravity)}, {-1: Series.constant(0 * gravity[:1])}  # g, and g . r
    for i, joint in enumerate(tree.joints):
        velocities[i] = outward_velocity(joint, velocities[joint.parent])
        field[i], work[i] = joint.lowered(field[joint.parent], work[joint.parent])
    energies = [_energies(velocities[i], field[i], work[i]) @ S for i, S in zip(tree.own, _shifts(m), strict=True)]
    steps = [x for i in range(len(tree.joints)) for x in (velocities[i].a, field[i], work[i])]
    return evaluate_in_order(joined([E.mT + batch_zeros(q) for E in energies], axis=-2), steps)


def _energies(motion: BodyMotion, field: Series, work: Series) -> Series:
    """The energies of the ten unit parameters of one body, (..., 1, 10)."""
    w, v, half = motion.w, motion.a, motion.w * 0.5
    of_m = v.mT @ (v * 0.5) - work
    of_h = v.map(lambda v: hat(v[..., 0])) @ w - field
    x, y, z = (rows(w, k, k + 1) for k in range(3))
    half_x, half_y, half_z = (rows(half, k, k + 1) for k in range(3))
    of_I = [half_x * x, x * y, half_y * y, x * z, y * z, half_z * z]
    return joined([of_m, of_h.mT, *of_I], axis=-1)


@lru_cache(maxsize=64)
def _shifts(m: Mechanism) -> Array:
    """The parameters of each body in a frame on its axis from those in the given frame: (nb, 10, 10)."""
    units = inertia.from_parameters(np.eye(len(PARAMETERS), dtype=int))
    to_axes = [inverse(T) for T in frame_shifts(m, on_axes(m))]
    return np.stack([inertia.parameters(inertia.shift_inertia(units, C)).T for C in to_axes])
