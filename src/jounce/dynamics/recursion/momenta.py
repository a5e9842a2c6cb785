"""Momentum and energy: sums over the bodies at their joints or the ground, in frames on the joint axes."""

from collections.abc import Sequence
from functools import reduce
from operator import add

from jounce._scalars import concatenate
from jounce.dynamics.recursion.joints import Joint, batch_zeros, joints
from jounce.dynamics.recursion.sweeps import composites, evaluate_in_order, velocities
from jounce.model.coordinates import generalized_forces
from jounce.model.equivalent import on_axes
from jounce.model.mechanism import Mechanism
from jounce.spatial.inertia import moments
from jounce.spatial.series import Series, joined


def momentum(mechanism: Mechanism, q: Series) -> Series:
    """h, about the inertial origin, in inertial axes: (..., 6, 1)."""
    tree, V, P = _momenta(on_axes(mechanism), q)
    roots = [joint.wrenches(P_i) for joint, P_i in zip(tree, P, strict=True) if joint.parent < 0]
    return evaluate_in_order(reduce(add, roots) + batch_zeros(q), [*V, *reversed(P)])


def generalized_momentum(mechanism: Mechanism, q: Series) -> Series:
    """p = M qd, (..., n, 1): the momentum of the bodies that each joint carries, projected onto its screw."""
    tree, V, P = _momenta(on_axes(mechanism), q)
    p = joined([joint.X.mT @ P_i + batch_zeros(q) for joint, P_i in zip(tree, P, strict=True)], axis=-2)
    return generalized_forces(mechanism, evaluate_in_order(p, [*V, *reversed(P)]))


def kinetic_energy(mechanism: Mechanism, q: Series) -> Series:
    """T = 1/2 sum of V_i . M_i V_i, (..., 1, 1)."""
    chain = on_axes(mechanism)
    V = velocities(joints(chain, q))
    twice = reduce(add, [V_i.mT @ (M_i @ V_i) for M_i, V_i in zip(chain.M, V, strict=True)])
    return evaluate_in_order(twice * 0.5 + batch_zeros(q), V)


def potential_energy(mechanism: Mechanism, q: Series) -> Series:
    """U = -g . (sum of m_i c_i), (..., 1, 1), with the first moments transported to the ground as columns (m c; m)."""
    chain = on_axes(mechanism)
    tree = joints(chain, q)
    own = [Series.constant(concatenate([h, m], axis=-2)) for m, h, _ in map(moments, chain.M)]
    h = composites(tree, own, Joint.points)
    total = reduce(add, [joint.points(h_i) for joint, h_i in zip(tree, h, strict=True) if joint.parent < 0])
    up = concatenate([-chain.gravity, 0 * chain.gravity[:1]], axis=-1)[None, :]
    return evaluate_in_order(up @ total + batch_zeros(q), reversed(h))


def _momenta(chain: Mechanism, q: Series) -> tuple[Sequence[Joint], Sequence[Series], Sequence[Series]]:
    """Return the joints, the twists of their bodies, and the momenta of the bodies that they carry."""
    tree = joints(chain, q)
    V = velocities(tree)
    return tree, V, composites(tree, [M_i @ V_i for M_i, V_i in zip(chain.M, V, strict=True)], Joint.wrenches)
