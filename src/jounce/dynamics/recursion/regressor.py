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

How often what runs: unit moments, parts and shifts once per robot; one sweep outward and one inward per regressor.
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
    """Forces on one body, a column for each of some unit parameters."""

    numbers: list[int]
    force: BodyForce  # (..., 3, len(numbers))


def regressor(m: Mechanism, q: Series, base: JointMotion | None = None) -> Series:
    """Return Y, the generalized forces of unit inertial parameters.

    Y is (..., nv, 10 nb); columns of a floating base come first.
    """
    return _project_parameters(m, q, base, ground(m.gravity), forces.propagate_motion, _forces)


def momentum_regressor(m: Mechanism, q: Series, base: JointMotion | None = None) -> Series:
    """Return Yp, the generalized momenta of unit inertial parameters.

    Yp is (..., nv, 10 nb); columns of a floating base come first.
    """
    return _project_parameters(m, q, base, ground(0 * m.gravity), forces.propagate_velocity, _momenta)


def _project_parameters(
    m: Mechanism,
    q: Series,
    base: JointMotion | None,
    root: BodyMotion,
    step: Callable[[forces.AnyJoint, BodyMotion], BodyMotion],
    columns_of_motion: Callable[[BodyMotion, Array, Array, Array], BodyForce],
) -> Series:
    """Compute columns of unit parameters, and project them onto joints.

    Every joint gets the columns of the bodies that it carries.
    """
    tree, units = forces.aligned_tree(align_to_axes(m), q, base), _unit_moments(m)
    size, count = len(INERTIAL_PARAMETERS) * m.nb, len(tree.joints)
    # Outward: the motion of each body from that of its parent.
    motions = {-1: root}
    for i, joint in enumerate(tree.joints):
        motions[i] = step(joint, motions[joint.parent])
    # The columns that begin at each body; the ground (-1) collects those that no joint needs any more.
    columns_on: dict[int, list[ParameterColumns]] = {i: [] for i in range(-1, count)}
    for i, unit_moments in zip(tree.own, units, strict=True):
        if len(unit_moments) > 0:
            force = columns_of_motion(motions[i], *_parts(unit_moments))
            columns_on[i].append(ParameterColumns(list(unit_moments), force))
    # Inward: the columns on a body and on all that it carries give a row of Y, and go on to the parent.
    projected: dict[int, Series] = {}
    steps = [motions[i].a for i in range(count)]
    for i, joint in reversed(list(enumerate(tree.joints))):
        total = _join_parts(columns_on[i])
        projected[i] = spread_columns(joint.force(total.force), total.numbers, size)
        columns_on[joint.parent].append(ParameterColumns(total.numbers, joint.inward(total.force)))
        steps.append(total.force.n)
    Y = tree.generalized_forces(join_series([projected[i] for i in range(count)], axis=-2))
    return evaluate_in_order(Y.map(_restore_Iyy) + batch_zeros(q), steps)


def _parts(units: dict[int, Array]) -> tuple[Array, Array, Array]:
    """Return masses, first moments and inertia tensors of unit parameters.

    They are (1, k), (3, k) and (k, 3, 3).
    """
    Pi = np.stack(list(units.values()))
    tensors = inertia.from_moment_matrix(Pi)[:, :3, :3]
    return Pi[:, 3:, 3].mT, Pi[:, :3, 3].mT, tensors


def _forces(motion: BodyMotion, m: Array, h: Array, tensors: Array) -> BodyForce:
    """Return the forces that unit parameters require for a motion."""
    # m a + K h and h x a + I wd are the momenta of the field a + K r with wd in place of w; axial(I hat(w)^2) is left.
    hat_w = motion.w.map(lambda w: hat(w[..., 0]))
    turning = _momenta(replace(motion, w=motion.w.dot), m, h, tensors)
    return BodyForce(turning.f, turning.n + (hat_w @ hat_w).map(lambda S: axial(tensors @ S[..., None, :, :]).mT))


def _momenta(motion: BodyMotion, m: Array, h: Array, tensors: Array) -> BodyForce:
    """Return the momenta of unit parameters in a velocity field."""
    # hat(a)^T h = h x a; tensors (k, 3, 3) @ w (..., 1, 3, 1) -> (..., k, 3, 1) -> (..., 3, k).
    n = motion.a.map(lambda a: hat(a[..., 0]).mT @ h)
    n = n + motion.w.map(lambda w: (tensors @ w[..., None, :, :])[..., 0].mT)
    return BodyForce(motion.a * m + motion.K @ h, n)


def _join_parts(parts: Sequence[ParameterColumns]) -> ParameterColumns:
    """Join columns of several parts side by side."""
    f, n = (join_series([getattr(part.force, name) for part in parts], axis=-1) for name in "fn")
    return ParameterColumns([number for part in parts for number in part.numbers], BodyForce(f, n))


def _restore_Iyy(Y: Array) -> Array:
    """Restore the columns of Iyy from those of Ixx + Iyy."""
    # (..., nv, 10 nb) -> (..., nv, nb, 10): the column of Iyy less that of Ixx, and back.
    by_body = Y.reshape((*Y.shape[:-1], Y.shape[-1] // len(INERTIAL_PARAMETERS), len(INERTIAL_PARAMETERS)))
    Iyy = by_body[..., _YY : _YY + 1] - by_body[..., _XX : _XX + 1]
    return concatenate([by_body[..., :_YY], Iyy, by_body[..., _YY + 1 :]], axis=-1).reshape(Y.shape)


@lru_cache(maxsize=64)
def _unit_moments(m: Mechanism) -> list[dict[int, Array]]:
    """Return the unit moments of mass that begin at each body.

    They are (4, 4), by the number of the parameter. Moments that reach the ground require no forces.
    """
    chain = align_to_axes(m)
    parameters = np.eye(len(INERTIAL_PARAMETERS), dtype=int)
    # Ixx and Iyy together are one unit parameter: more joints leave it unmoved than Iyy alone.
    parameters[_YY, _XX] = 1
    units: list[dict[int, Array]] = [{} for _ in chain.parent]
    for row, T in enumerate(map(inverse, frame_shifts(m, chain))):
        for k, Pi in enumerate(inertia.moment_matrix(inertia.from_parameters(parameters))):
            # In the frame on the axis; then, as long as the joint does not move them, in the frame of the parent.
            body, Pi = row, T @ Pi @ T.T
            while body >= 0 and not _moves_mass(coordinates.body_screws(chain, body), Pi):
                body, Pi = chain.parent[body], chain.B[body] @ Pi @ chain.B[body].T
            if body >= 0:
                units[body][len(INERTIAL_PARAMETERS) * row + k] = Pi
    return units


def _moves_mass(X: Array, Pi: Array) -> bool:
    """Return whether a joint with screws X moves moments of mass.

    X is (6, k). If not, its forces do not depend on them.
    """
    return not all(map(is_zero, np.ravel(wedge(X.T) @ Pi)))


def energy_regressor(m: Mechanism, q: Series, base: JointMotion | None = None) -> Series:
    """Return YE, the energies T + U of unit inertial parameters.

    YE is (..., 10 nb, 1); rows of a floating base come first.
    """
    tree, gravity = forces.aligned_tree(align_to_axes(m), q, base), m.gravity[:, None]
    # Outward: velocities, g in body axes, and g . r of the origins.
    velocities = {-1: ground(0 * m.gravity)}
    field, work = {-1: Series.constant(gravity)}, {-1: Series.constant(0 * gravity[:1])}
    for i, joint in enumerate(tree.joints):
        velocities[i] = forces.propagate_velocity(joint, velocities[joint.parent])
        field[i], work[i] = joint.gravity_at_body(field[joint.parent], work[joint.parent])
    # Energies in frames on the axes, then of the parameters in the given frames.
    energies = [_energies(velocities[i], field[i], work[i]) @ S for i, S in zip(tree.own, _shifts(m), strict=True)]
    steps = [x for i in range(len(tree.joints)) for x in (velocities[i].a, field[i], work[i])]
    return evaluate_in_order(join_series([E.mT + batch_zeros(q) for E in energies], axis=-2), steps)


def _energies(motion: BodyMotion, field: Series, work: Series) -> Series:
    """Return the energies of the unit parameters of one body.

    They are (..., 1, 10).
    """
    w, v, half = motion.w, motion.a, motion.w * 0.5
    of_m = v.mT @ (v * 0.5) - work
    of_h = v.map(lambda v: hat(v[..., 0])) @ w - field
    x, y, z = (take_rows(w, k, k + 1) for k in range(3))
    half_x, half_y, half_z = (take_rows(half, k, k + 1) for k in range(3))
    # w . I w / 2, by Ixx, Ixy, Iyy, Ixz, Iyz, Izz: products off the diagonal occur twice.
    of_I = [half_x * x, x * y, half_y * y, x * z, y * z, half_z * z]
    return join_series([of_m, of_h.mT, *of_I], axis=-1)


@lru_cache(maxsize=64)
def _shifts(m: Mechanism) -> Array:
    """Return the maps of parameters to frames on the axes.

    They are (nb, 10, 10), from the given frames.
    """
    units = inertia.from_parameters(np.eye(len(INERTIAL_PARAMETERS), dtype=int))
    to_axes = [inverse(T) for T in frame_shifts(m, align_to_axes(m))]
    return np.stack([inertia.parameters(inertia.shift_inertia(units, C)).T for C in to_axes])
