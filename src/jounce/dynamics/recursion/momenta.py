"""The momentum of the whole mechanism and the wrench on its base: what every body adds, carried to the ground."""

from collections.abc import Sequence
from functools import reduce
from operator import add

from jounce.dynamics.recursion.joints import Joint, joints, rows, still
from jounce.dynamics.recursion.sweeps import composites, in_order, velocities
from jounce.dynamics.system import system_G
from jounce.model.mechanism import Mechanism
from jounce.spatial.series import Series


def momentum(mechanism: Mechanism, q: Series) -> Series:
    """h, about the inertial origin, in inertial axes: (..., 6, 1)."""
    return _momentum(mechanism, joints(mechanism, q)) + still(q)


def base_wrench(mechanism: Mechanism, q: Series, W: Series | None = None) -> Series:
    """F of the ground, (..., 6, 1) as the momentum: the rate of the momentum, less gravity and the loads -W."""
    tree = joints(mechanism, q)
    up: list[Series] = []  # the acceleration -g as a twist of every body, (eq_U) times G
    for joint in tree:
        up.append(joint.twists(Series.constant(system_G(mechanism)) if joint.parent < 0 else up[joint.parent]))
    loads = [M_i @ up_i for M_i, up_i in zip(mechanism.M, up, strict=True)]
    if W is not None:
        loads = [load + rows(W, 6 * i, 6 * i + 6) for i, load in enumerate(loads)]
    return _momentum(mechanism, tree).dot + _on_ground(tree, loads, outward=up) + still(q)


def _momentum(mechanism: Mechanism, tree: Sequence[Joint]) -> Series:
    V = velocities(tree)
    return _on_ground(tree, [M_i @ V_i for M_i, V_i in zip(mechanism.M, V, strict=True)], outward=V)


def _on_ground(tree: Sequence[Joint], wrenches: Sequence[Series], outward: Sequence[Series]) -> Series:
    """The sum of wrenches or momenta of the bodies, about the inertial origin; `outward` is what they are made of."""
    sums = composites(tree, wrenches, Joint.wrenches)
    roots = [joint.wrenches(sum_i) for joint, sum_i in zip(tree, sums, strict=True) if joint.parent < 0]
    return in_order(reduce(add, roots), [*outward, *reversed(sums)])
