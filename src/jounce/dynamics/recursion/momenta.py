"""Momenta, energies and centre of mass: sums over the bodies at joints or ground, in frames on the joint axes."""

from collections.abc import Sequence
from functools import reduce
from operator import add

from jounce.core.scalars import concatenate
from jounce.dynamics.recursion.joints import MovingJoint, batch_zeros, take_rows
from jounce.dynamics.recursion.sweeps import composites, evaluate_in_order, velocities
from jounce.dynamics.recursion.tree import KinematicTree, kinematic_tree
from jounce.dynamics.state import JointMotion
from jounce.model.equivalent_mechanisms import align_to_axes
from jounce.model.mechanism import Mechanism, reciprocal_mass
from jounce.spatial.inertia import moments
from jounce.spatial.lie import hat
from jounce.spatial.series import Series, join_series


def momentum(m: Mechanism, q: Series, base: JointMotion | None = None) -> Series:
    """h, about the inertial origin, in inertial axes: (..., 6, 1)."""
    return _momentum(kinematic_tree(align_to_axes(m), q, base), q)


def centroidal_momentum(m: Mechanism, q: Series, base: JointMotion | None = None) -> Series:
    """hG, about the centre of mass, in inertial axes: (..., 6, 1)."""
    tree = kinematic_tree(align_to_axes(m), q, base and base.at_origin)
    return shift_to_centre(_momentum(tree, q), find_centre(m, tree, q))


def center_of_mass(m: Mechanism, q: Series, base: JointMotion | None = None) -> Series:
    """c = sum of m_i c_i / m, in the inertial frame: (..., 3, 1)."""
    return find_centre(m, kinematic_tree(align_to_axes(m), q, base), q)


def find_centre(m: Mechanism, tree: KinematicTree[MovingJoint], q: Series) -> Series:
    """The centre of mass of a tree of the mechanism."""
    return take_rows(_first_moment(tree, q), 0, 3) * reciprocal_mass(m)


def shift_to_centre(h: Series, c: Series) -> Series:
    """Momenta (..., 6, k) about a centre of mass c, (..., 3, 1), from those about the origin."""
    linear = take_rows(h, 3, 6)
    return join_series([take_rows(h, 0, 3) - c.map(lambda c: hat(c[..., 0])) @ linear, linear], axis=-2)


def generalized_momentum(m: Mechanism, q: Series, base: JointMotion | None = None) -> Series:
    """p = M nu, (..., nv, 1): the momentum of the bodies that each joint carries, projected onto its screws."""
    tree = kinematic_tree(align_to_axes(m), q, base)
    V, P = _momenta(tree)
    p = join_series([joint.X.T @ P_i + batch_zeros(q) for joint, P_i in zip(tree.joints, P, strict=True)], axis=-2)
    return tree.generalized_forces(evaluate_in_order(p, [*V, *reversed(P)]))


def kinetic_energy(m: Mechanism, q: Series, base: JointMotion | None = None) -> Series:
    """T = 1/2 sum of V_i . M_i V_i, (..., 1, 1)."""
    tree = kinematic_tree(align_to_axes(m), q, base)
    V = velocities(tree.joints)
    twice = reduce(add, [V_i.mT @ (M_i @ V_i) for M_i, V_i in zip(tree.M, V, strict=True)])
    return evaluate_in_order(twice * 0.5 + batch_zeros(q), V)


def potential_energy(m: Mechanism, q: Series, base: JointMotion | None = None) -> Series:
    """U = -g . (sum of m_i c_i), (..., 1, 1)."""
    up = concatenate([-m.gravity, 0 * m.gravity[:1]], axis=-1)[None, :]
    return up @ _first_moment(kinematic_tree(align_to_axes(m), q, base), q)


def _first_moment(tree: KinematicTree[MovingJoint], q: Series) -> Series:
    """The sum of (m c; m) over the bodies, (..., 4, 1), transported inward to the inertial frame."""
    own = [Series.constant(concatenate([h, m], axis=-2)) for m, h, _ in map(moments, tree.M)]
    h = composites(tree.joints, own, MovingJoint.points)
    roots = [joint.points(h_i) for joint, h_i in zip(tree.joints, h, strict=True) if joint.parent < 0]
    return evaluate_in_order(reduce(add, roots) + batch_zeros(q), reversed(h))


def _momentum(tree: KinematicTree[MovingJoint], q: Series) -> Series:
    V, P = _momenta(tree)
    roots = [joint.wrenches(P_i) for joint, P_i in zip(tree.joints, P, strict=True) if joint.parent < 0]
    return evaluate_in_order(reduce(add, roots) + batch_zeros(q), [*V, *reversed(P)])


def _momenta(tree: KinematicTree[MovingJoint]) -> tuple[Sequence[Series], Sequence[Series]]:
    """Return the twists of the bodies, and the momenta of the bodies that each joint carries."""
    V = velocities(tree.joints)
    return V, composites(tree.joints, [M_i @ V_i for M_i, V_i in zip(tree.M, V, strict=True)], MovingJoint.wrenches)
