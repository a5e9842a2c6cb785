"""Momentum and energy: sums over the bodies at their joints or the ground, in frames on the joint axes."""

from collections.abc import Sequence
from functools import reduce
from operator import add

from jounce._scalars import concatenate
from jounce.dynamics.base import BaseMotion
from jounce.dynamics.recursion.joints import Joint, batch_zeros
from jounce.dynamics.recursion.sweeps import composites, evaluate_in_order, velocities
from jounce.dynamics.recursion.tree import KinematicTree, kinematic_tree
from jounce.model.equivalent import on_axes
from jounce.model.mechanism import Mechanism
from jounce.spatial.inertia import moments
from jounce.spatial.series import Series, joined


def momentum(mechanism: Mechanism, q: Series, base: BaseMotion | None = None) -> Series:
    """h, about the inertial origin, in inertial axes: (..., 6, 1)."""
    tree = kinematic_tree(on_axes(mechanism), q, base)
    V, P = _momenta(tree)
    roots = [joint.wrenches(P_i) for joint, P_i in zip(tree.joints, P, strict=True) if joint.parent < 0]
    return evaluate_in_order(reduce(add, roots) + batch_zeros(q), [*V, *reversed(P)])


def generalized_momentum(mechanism: Mechanism, q: Series, base: BaseMotion | None = None) -> Series:
    """p = M nu, (..., nv, 1): the momentum of the bodies that each joint carries, projected onto its screws."""
    tree = kinematic_tree(on_axes(mechanism), q, base)
    V, P = _momenta(tree)
    p = joined([joint.X.T @ P_i + batch_zeros(q) for joint, P_i in zip(tree.joints, P, strict=True)], axis=-2)
    return tree.generalized_forces(evaluate_in_order(p, [*V, *reversed(P)]))


def kinetic_energy(mechanism: Mechanism, q: Series, base: BaseMotion | None = None) -> Series:
    """T = 1/2 sum of V_i . M_i V_i, (..., 1, 1)."""
    tree = kinematic_tree(on_axes(mechanism), q, base)
    V = velocities(tree.joints)
    twice = reduce(add, [V_i.mT @ (M_i @ V_i) for M_i, V_i in zip(tree.M, V, strict=True)])
    return evaluate_in_order(twice * 0.5 + batch_zeros(q), V)


def potential_energy(mechanism: Mechanism, q: Series, base: BaseMotion | None = None) -> Series:
    """U = -g . (sum of m_i c_i), (..., 1, 1)."""
    up = concatenate([-mechanism.gravity, 0 * mechanism.gravity[:1]], axis=-1)[None, :]
    return up @ _first_moment(kinematic_tree(on_axes(mechanism), q, base), q)


def _first_moment(tree: KinematicTree, q: Series) -> Series:
    """The sum of (m c; m) over the bodies, (..., 4, 1), transported inward to the inertial frame."""
    own = [Series.constant(concatenate([h, m], axis=-2)) for m, h, _ in map(moments, tree.M)]
    h = composites(tree.joints, own, Joint.points)
    roots = [joint.points(h_i) for joint, h_i in zip(tree.joints, h, strict=True) if joint.parent < 0]
    return evaluate_in_order(reduce(add, roots) + batch_zeros(q), reversed(h))


def _momenta(tree: KinematicTree) -> tuple[Sequence[Series], Sequence[Series]]:
    """Return the twists of the bodies, and the momenta of the bodies that each joint carries."""
    V = velocities(tree.joints)
    return V, composites(tree.joints, [M_i @ V_i for M_i, V_i in zip(tree.M, V, strict=True)], Joint.wrenches)
