"""Momentum, the wrench on the base, and energy: what every body adds, carried to its joint or to the ground."""

from collections.abc import Sequence
from functools import reduce
from operator import add

from jounce._scalars import concatenate
from jounce.dynamics.recursion.joints import Joint, batch_zeros, joints, rows
from jounce.dynamics.recursion.sweeps import composites, evaluate_in_order, velocities
from jounce.dynamics.system import system_G
from jounce.model.coordinates import generalized_forces
from jounce.model.mechanism import Mechanism
from jounce.spatial.inertia import moments
from jounce.spatial.series import Series, joined


def momentum(mechanism: Mechanism, q: Series) -> Series:
    """h, about the inertial origin, in inertial axes: (..., 6, 1)."""
    return _momentum(mechanism, joints(mechanism, q)) + batch_zeros(q)


def generalized_momentum(mechanism: Mechanism, q: Series) -> Series:
    """p = M qd, (..., n, 1): the momentum of all that each joint carries, projected onto its screw."""
    tree = joints(mechanism, q)
    V = velocities(tree)
    P = composites(tree, [M_i @ V_i for M_i, V_i in zip(mechanism.M, V, strict=True)], Joint.wrenches)
    p = joined([joint.X.mT @ P_i + batch_zeros(q) for joint, P_i in zip(tree, P, strict=True)], axis=-2)
    return generalized_forces(mechanism, evaluate_in_order(p, [*V, *reversed(P)]))


def kinetic_energy(mechanism: Mechanism, q: Series) -> Series:
    """T = 1/2 sum of V_i . M_i V_i, (..., 1, 1)."""
    V = velocities(joints(mechanism, q))
    twice = reduce(add, [V_i.mT @ (M_i @ V_i) for M_i, V_i in zip(mechanism.M, V, strict=True)])
    return evaluate_in_order(twice * 0.5 + batch_zeros(q), V)


def potential_energy(mechanism: Mechanism, q: Series) -> Series:
    """U = -g . (sum of m_i c_i), (..., 1, 1), with the first moments carried to the ground as columns (m c; m)."""
    tree = joints(mechanism, q)
    own = [Series.constant(concatenate([h, m], axis=-2)) for m, h, _ in map(moments, mechanism.M)]
    h = composites(tree, own, Joint.points)
    total = reduce(add, [joint.points(h_i) for joint, h_i in zip(tree, h, strict=True) if joint.parent < 0])
    up = concatenate([-mechanism.gravity, 0 * mechanism.gravity[:1]], axis=-1)[None, :]
    return evaluate_in_order(up @ total + batch_zeros(q), reversed(h))


def base_wrench(mechanism: Mechanism, q: Series, W: Series | None = None) -> Series:
    """F of the ground, (..., 6, 1) as the momentum: the rate of the momentum, less gravity and the loads -W."""
    tree = joints(mechanism, q)
    up: list[Series] = []  # the acceleration -g as a twist of every body, (eq_U) times G
    for joint in tree:
        up.append(joint.twists(Series.constant(system_G(mechanism)) if joint.parent < 0 else up[joint.parent]))
    loads = [M_i @ up_i for M_i, up_i in zip(mechanism.M, up, strict=True)]
    if W is not None:
        loads = [load + rows(W, 6 * i, 6 * i + 6) for i, load in enumerate(loads)]
    return _momentum(mechanism, tree).dot + _on_ground(tree, loads, outward=up) + batch_zeros(q)


def _momentum(mechanism: Mechanism, tree: Sequence[Joint]) -> Series:
    V = velocities(tree)
    return _on_ground(tree, [M_i @ V_i for M_i, V_i in zip(mechanism.M, V, strict=True)], outward=V)


def _on_ground(tree: Sequence[Joint], wrenches: Sequence[Series], outward: Sequence[Series]) -> Series:
    """The sum of wrenches or momenta of the bodies, about the inertial origin; `outward` is what they are made of."""
    sums = composites(tree, wrenches, Joint.wrenches)
    roots = [joint.wrenches(sum_i) for joint, sum_i in zip(tree, sums, strict=True) if joint.parent < 0]
    return evaluate_in_order(reduce(add, roots), [*outward, *reversed(sums)])
