"""Regressors of forces, momenta and energies: RNEA on the unit parameters of all bodies, one column each.

Forces are linear in the inertial parameters of the bodies, and motions do not depend on them. A mass m, a first moment
h and an inertia tensor I about the origin of a frame on the joint axis require

    f = m a + K h,    n = h x a + I wd + w x (I w) = h x a + I wd + axial(I hat(w)^2),

with a and K of `forces`. Their momenta, m v + w x h and h x v + I w, are the same function of the velocity field
v + w x r. Columns of unit parameters are transported inward as one force is, and projected onto every joint that
carries them. The parameters are those of the given body frames; constants take them to frames on the axes.

What a joint does not move, such as a mass on its axis, requires the same forces as if it belonged to the parent: such
columns begin there, as in `equivalent_mechanisms.reduce_inertias`. So that there are more of them, Ixx + Iyy takes the
place of Iyy, from which it is a subtraction.

Energies need no sums: a body whose origin has the velocity v and the place r has the energy

    E = m (v . v / 2 - g . r) + h . (v x w - g) + w . I w / 2

in its own axes. Velocities, g and g . r are taken outward in frames on the joint axes, where they need the fewest
operations.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from jounce.core.scalars import Array, concatenate, is_zero
from jounce.dynamics.recursion import forces
from jounce.dynamics.recursion.forces import BodyForce, BodyMotion, ground
from jounce.dynamics.recursion.joints import batch_zeros, take_rows
from jounce.dynamics.recursion.tree import evaluate_in_order, spread_columns
from jounce.dynamics.state import JointMotion
from jounce.model import coordinates
from jounce.model.equivalent_mechanisms import align_to_axes, frame_shifts
from jounce.model.mechanism import Mechanism
from jounce.spatial import inertia
from jounce.spatial.inertia import INERTIAL_PARAMETERS
from jounce.spatial.lie import axial, hat, inverse, wedge
from jounce.spatial.series import Series, join_series

_XX, _YY = (INERTIAL_PARAMETERS.index(name) for name in ("Ixx", "Iyy"))


@dataclass(frozen=True)
class ParameterColumns:
    """Forces on one body, a column for each of some numbered unit parameters."""

    numbers: list[int]
    force: BodyForce  # (..., 3, len(numbers))


def regressor(m: Mechanism, q: Series, base: JointMotion | None = None) -> Series:
    """Y, (..., nv, 10 nb): the generalized forces of the unit inertial parameters of all bodies, the base's first."""
    return _project_parameters(m, q, base, ground(m.gravity), forces.propagate_motion, _forces)


def momentum_regressor(m: Mechanism, q: Series, base: JointMotion | None = None) -> Series:
    """Yp, (..., nv, 10 nb): the generalized momenta of the unit inertial parameters of all bodies, the base's first."""
    return _project_parameters(m, q, base, ground(0 * m.gravity), forces.propagate_velocity, _momenta)


def _project_parameters(
    m: Mechanism,
    q: Series,
    base: JointMotion | None,
    root: BodyMotion,
    step: Callable[[forces.AnyJoint, BodyMotion], BodyMotion],
    of_motion: Callable[[BodyMotion, Array, Array, Array], BodyForce],
) -> Series:
    """What the motion of every body makes of its unit parameters, projected onto the joints that carry it."""
    tree, units = forces.aligned_tree(align_to_axes(m), q, base), _unit_moments(m)
    size, count = len(INERTIAL_PARAMETERS) * m.nb, len(tree.joints)
    motions = {-1: root}
    for i, joint in enumerate(tree.joints):
        motions[i] = step(joint, motions[joint.parent])
    on: dict[int, list[ParameterColumns]] = {i: [] for i in range(-1, count)}
    for i, own in zip(tree.own, units, strict=True):
        on[i] += [ParameterColumns(list(own), of_motion(motions[i], *_parts(own)))] if own else []
    projected: dict[int, Series] = {}
    steps = [motions[i].a for i in range(count)]
    for i, joint in reversed(list(enumerate(tree.joints))):
        total = _join_parts(on[i])
        projected[i] = spread_columns(joint.force(total.force), total.numbers, size)
        on[joint.parent].append(ParameterColumns(total.numbers, joint.inward(total.force)))
        steps.append(total.force.n)
    Y = tree.generalized_forces(join_series([projected[i] for i in range(count)], axis=-2))
    return evaluate_in_order(Y.map(_restore_Iyy) + batch_zeros(q), steps)


def _parts(units: dict[int, Array]) -> tuple[Array, Array, Array]:
    """Masses (1, k), first moments (3, k) and inertia tensors (k, 3, 3) of unit parameters."""
    Pi = np.stack(list(units.values()))
    tensors = inertia.from_moment_matrix(Pi)[:, :3, :3]
    return Pi[:, 3:, 3].mT, Pi[:, :3, 3].mT, tensors


def _forces(motion: BodyMotion, m: Array, h: Array, tensors: Array) -> BodyForce:
    """The forces that unit parameters require for a motion."""
    hat_w = motion.w.map(lambda w: hat(w[..., 0]))
    turning = _momenta(replace(motion, w=motion.w.dot), m, h, tensors)
    return BodyForce(turning.f, turning.n + (hat_w @ hat_w).map(lambda S: axial(tensors @ S[..., None, :, :]).mT))


def _momenta(motion: BodyMotion, m: Array, h: Array, tensors: Array) -> BodyForce:
    """The momenta, linear and angular, of unit parameters that have the velocity field of a motion."""
    n = motion.a.map(lambda a: hat(a[..., 0]).mT @ h)
    n = n + motion.w.map(lambda w: (tensors @ w[..., None, :, :])[..., 0].mT)
    return BodyForce(motion.a * m + motion.K @ h, n)


def _join_parts(parts: Sequence[ParameterColumns]) -> ParameterColumns:
    f, n = (join_series([getattr(part.force, name) for part in parts], axis=-1) for name in "fn")
    return ParameterColumns([number for part in parts for number in part.numbers], BodyForce(f, n))


def _restore_Iyy(Y: Array) -> Array:
    """Columns of all parameters from those with Ixx + Iyy in the place of Iyy."""
    by_body = Y.reshape((*Y.shape[:-1], Y.shape[-1] // len(INERTIAL_PARAMETERS), len(INERTIAL_PARAMETERS)))
    Iyy = by_body[..., _YY : _YY + 1] - by_body[..., _XX : _XX + 1]
    return concatenate([by_body[..., :_YY], Iyy, by_body[..., _YY + 1 :]], axis=-1).reshape(Y.shape)


@lru_cache(maxsize=64)
def _unit_moments(m: Mechanism) -> list[dict[int, Array]]:
    """The moments of mass (4, 4) of unit parameters, by number, of each body at which columns begin.

    Those that reach the ground require no forces.
    """
    chain = align_to_axes(m)
    parameters = np.eye(len(INERTIAL_PARAMETERS), dtype=int)
    parameters[_YY, _XX] = 1
    units: list[dict[int, Array]] = [{} for _ in chain.parent]
    for row, T in enumerate(map(inverse, frame_shifts(m, chain))):
        for k, Pi in enumerate(inertia.moment_matrix(inertia.from_parameters(parameters))):
            at, Pi = row, T @ Pi @ T.T
            while at >= 0 and not _moves_mass(coordinates.body_screws(chain, at), Pi):
                at, Pi = chain.parent[at], chain.B[at] @ Pi @ chain.B[at].T
            if at >= 0:
                units[at][len(INERTIAL_PARAMETERS) * row + k] = Pi
    return units


def _moves_mass(X: Array, Pi: Array) -> bool:
    """Whether a joint with screws X, (6, k), moves moments of mass; if not, its forces do not depend on them."""
    return not all(map(is_zero, np.ravel(wedge(X.T) @ Pi)))


def energy_regressor(m: Mechanism, q: Series, base: JointMotion | None = None) -> Series:
    """YE, (..., 10 nb, 1): the energies T + U of the unit inertial parameters of all bodies, the base's first."""
    tree, gravity = forces.aligned_tree(align_to_axes(m), q, base), m.gravity[:, None]
    velocities = {-1: ground(0 * m.gravity)}
    field, work = {-1: Series.constant(gravity)}, {-1: Series.constant(0 * gravity[:1])}  # g, and g . r
    for i, joint in enumerate(tree.joints):
        velocities[i] = forces.propagate_velocity(joint, velocities[joint.parent])
        field[i], work[i] = joint.lowered(field[joint.parent], work[joint.parent])
    energies = [_energies(velocities[i], field[i], work[i]) @ S for i, S in zip(tree.own, _shifts(m), strict=True)]
    steps = [x for i in range(len(tree.joints)) for x in (velocities[i].a, field[i], work[i])]
    return evaluate_in_order(join_series([E.mT + batch_zeros(q) for E in energies], axis=-2), steps)


def _energies(motion: BodyMotion, field: Series, work: Series) -> Series:
    """The energies of the ten unit parameters of one body, (..., 1, 10)."""
    w, v, half = motion.w, motion.a, motion.w * 0.5
    of_m = v.mT @ (v * 0.5) - work
    of_h = v.map(lambda v: hat(v[..., 0])) @ w - field
    x, y, z = (take_rows(w, k, k + 1) for k in range(3))
    half_x, half_y, half_z = (take_rows(half, k, k + 1) for k in range(3))
    of_I = [half_x * x, x * y, half_y * y, x * z, y * z, half_z * z]
    return join_series([of_m, of_h.mT, *of_I], axis=-1)


@lru_cache(maxsize=64)
def _shifts(m: Mechanism) -> Array:
    """The parameters of each body in a frame on its axis from those in the given frame: (nb, 10, 10)."""
    units = inertia.from_parameters(np.eye(len(INERTIAL_PARAMETERS), dtype=int))
    to_axes = [inverse(T) for T in frame_shifts(m, align_to_axes(m))]
    return np.stack([inertia.parameters(inertia.shift_inertia(units, C)).T for C in to_axes])
