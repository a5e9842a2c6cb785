"""Sweeps outward give kinematics of bodies, sweeps inward momenta and energies.

`poses`, `twists` and `jacobians` go from parent to body: those of one body cost no more than the path to it. They are
one of the two forms that `kinematics` takes, `closed_form` is the other. Momenta, energies and the centre of mass are
sums over the bodies, at joints or at the ground, in frames on the joint axes (`align_to_axes`), because of the zeros
there; `find_centre` and `shift_to_centre` serve the matrix of the centroidal momentum as well.
"""

from collections.abc import Callable, Sequence
from functools import reduce
from operator import add

import numpy as np

from jounce.core.scalars import concatenate
from jounce.dynamics.recursion.joints import MovingJoint, batch_zeros, joints, take_rows
from jounce.dynamics.recursion.tree import KinematicTree, composites, evaluate_in_order, kinematic_tree, velocities
from jounce.dynamics.state import BASE_AT_REST, JointMotion
from jounce.model import coordinates
from jounce.model.equivalent_mechanisms import align_to_axes
from jounce.model.mechanism import Mechanism, path_to, reciprocal_mass
from jounce.spatial.inertia import moments
from jounce.spatial.lie import hat
from jounce.spatial.series import Series, join_series


def poses(m: Mechanism, q: Series, base: JointMotion, body: int | None) -> Series:
    """Return H_i = H_p B_i exp(X_i theta_i) of one body or all.

    The shape is (..., 4, 4) of one body or the ground, -1, else (..., nb, 4, 4). All are (..., nb, 4, 4); the ground is
    -1.
    """
    ground = (BASE_AT_REST if m.floats else base).H
    return _sweep_outward(m, q, base, body, ground, lambda joint, _, H_p: H_p @ joint.B @ joint.motion)  # (Ci)


def twists(m: Mechanism, q: Series, base: JointMotion, body: int | None) -> Series:
    """Return V_i = Ad(C_ip) V_p + X_i nu_i of one body or all.

    The shape is (..., 6, 1) or (..., nb, 6, 1).
    """
    ground = (BASE_AT_REST if m.floats else base).V
    return _sweep_outward(m, q, base, body, ground, lambda joint, _, V_p: joint.twists(V_p) + joint.X @ joint.rate)


def jacobians(m: Mechanism, q: Series, base: JointMotion, body: int | None) -> Series:
    """Return J_i = Ad(C_ip) J_p + X_i G_i of one body or all.

    The shape is (..., 6, nv) or (..., nb, 6, nv). G_i are the rows of G for the joint.
    """
    G, ground = coordinates.velocity_map(m), Series.constant(np.zeros((6, m.nv), dtype=int))
    return _sweep_outward(m, q, base, body, ground, lambda joint, rows, J_p: joint.twists(J_p) + joint.X @ G[rows])


def _sweep_outward(
    m: Mechanism,
    q: Series,
    base: JointMotion,
    body: int | None,
    ground: Series,
    step: Callable[[MovingJoint, list[int], Series], Series],
) -> Series:
    """Compute a quantity of each body from that of its parent.

    This is done for all bodies or for the path to one.
    """
    bodies = list(range(m.nb)) if body is None else path_to(m, body)
    # Of one body only the path to it is swept; each step takes the quantity of the parent.
    by_body = {-1: ground}
    for i, joint in zip(bodies, joints(m, q, base, bodies), strict=True):
        by_body[i] = step(joint, coordinates.velocity_rows(m, i), by_body[joint.parent])
    if body is not None:
        return evaluate_in_order(by_body[body] + batch_zeros(q), by_body.values())
    all_bodies = [(by_body[i] + batch_zeros(q)).map(lambda x: x[..., None, :, :]) for i in bodies]
    return evaluate_in_order(join_series(all_bodies, axis=-3), by_body.values())


# Sums over the bodies, by sweeps inward.
def momentum(m: Mechanism, q: Series, base: JointMotion | None = None) -> Series:
    """Return h, about the inertial origin, in inertial axes: (..., 6, 1)."""
    return _momentum(kinematic_tree(align_to_axes(m), q, base), q)


def centroidal_momentum(m: Mechanism, q: Series, base: JointMotion | None = None) -> Series:
    """Return hG, about the centre of mass, in inertial axes: (..., 6, 1)."""
    tree = kinematic_tree(align_to_axes(m), q, None if base is None else base.at_origin)
    return shift_to_centre(_momentum(tree, q), find_centre(m, tree, q))


def center_of_mass(m: Mechanism, q: Series, base: JointMotion | None = None) -> Series:
    """Return c = sum of m_i c_i / m in the inertial frame.

    c is (..., 3, 1).
    """
    return find_centre(m, kinematic_tree(align_to_axes(m), q, base), q)


def find_centre(m: Mechanism, tree: KinematicTree[MovingJoint], q: Series) -> Series:
    """Return the centre of mass of a tree of the mechanism."""
    return take_rows(_first_moment(tree, q), 0, 3) * reciprocal_mass(m)


def shift_to_centre(h: Series, c: Series) -> Series:
    """Return momenta about c from those about the origin.

    Momenta are (..., 6, k), c is (..., 3, 1).
    """
    linear = take_rows(h, 3, 6)
    return join_series([take_rows(h, 0, 3) - c.map(lambda c: hat(c[..., 0])) @ linear, linear], axis=-2)


def generalized_momentum(m: Mechanism, q: Series, base: JointMotion | None = None) -> Series:
    """Return p = M nu, (..., nv, 1): momenta of carried bodies, projected onto joint screws."""
    tree = kinematic_tree(align_to_axes(m), q, base)
    V, P = _momenta(tree)
    p = join_series([joint.X.T @ P_i + batch_zeros(q) for joint, P_i in zip(tree.joints, P, strict=True)], axis=-2)
    return tree.generalized_forces(evaluate_in_order(p, [*V, *reversed(P)]))


def kinetic_energy(m: Mechanism, q: Series, base: JointMotion | None = None) -> Series:
    """Return T = 1/2 sum of V_i . M_i V_i.

    The shape is (..., 1, 1).
    """
    tree = kinematic_tree(align_to_axes(m), q, base)
    V = velocities(tree.joints)
    # 2 T, body by body; no sweep inward is needed.
    twice = reduce(add, [V_i.mT @ (M_i @ V_i) for M_i, V_i in zip(tree.M, V, strict=True)])
    return evaluate_in_order(twice * 0.5 + batch_zeros(q), V)


def potential_energy(m: Mechanism, q: Series, base: JointMotion | None = None) -> Series:
    """Return U = -g . (sum of m_i c_i), (..., 1, 1)."""
    # (-g; 0) . (sum of m_i c_i; sum of m_i).
    up = concatenate([-m.gravity, 0 * m.gravity[:1]], axis=-1)[None, :]
    return up @ _first_moment(kinematic_tree(align_to_axes(m), q, base), q)


def _first_moment(tree: KinematicTree[MovingJoint], q: Series) -> Series:
    """Return the sum of (m c; m) over the bodies.

    It is in the inertial frame, (..., 4, 1).
    """
    by_body = [Series.constant(concatenate([h, m], axis=-2)) for m, h, _ in map(moments, tree.M)]
    h = composites(tree.joints, by_body, MovingJoint.points)
    # Joints on the ground have the sums of all bodies.
    roots = [joint.points(h_i) for joint, h_i in zip(tree.joints, h, strict=True) if joint.parent < 0]
    return evaluate_in_order(reduce(add, roots) + batch_zeros(q), reversed(h))


def _momentum(tree: KinematicTree[MovingJoint], q: Series) -> Series:
    """Return h of a tree: the momenta at the joints on the ground, seen from there."""
    V, P = _momenta(tree)
    roots = [joint.wrenches(P_i) for joint, P_i in zip(tree.joints, P, strict=True) if joint.parent < 0]
    return evaluate_in_order(reduce(add, roots) + batch_zeros(q), [*V, *reversed(P)])


def _momenta(tree: KinematicTree[MovingJoint]) -> tuple[Sequence[Series], Sequence[Series]]:
    """Return the twists of the bodies, and momenta of carried bodies.

    Each joint has the momentum of the bodies that it carries.
    """
    V = velocities(tree.joints)
    return V, composites(tree.joints, [M_i @ V_i for M_i, V_i in zip(tree.M, V, strict=True)], MovingJoint.wrenches)
