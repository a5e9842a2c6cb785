"""Generalized forces by a sweep outward and a sweep inward over the tree, in the frames with the fewest numbers."""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from jounce._scalars import Array
from jounce.dynamics.recursion.joints import rows, still
from jounce.dynamics.recursion.steps import (
    AlignedJoint,
    Force,
    Motion,
    aligned_joints,
    carried_along,
    felt,
    inertia_force,
    inward,
    outward,
)
from jounce.dynamics.recursion.sweeps import in_order
from jounce.model.equivalent import minimal, moves
from jounce.model.mechanism import Mechanism
from jounce.spatial import inertia
from jounce.spatial.lie import Ad
from jounce.spatial.series import Series, joined

_AT_REST = Series.constant(np.zeros((3, 1), dtype=int))
_NO_FIELD = Series.constant(np.zeros((3, 3), dtype=int))


def inverse_dynamics(mechanism: Mechanism, q: Series, W: Series | None = None) -> Series:
    """Q, the generalized forces (EOM1), with wrenches W on the bodies, (..., 6nb, 1)."""
    chain = minimal(mechanism)
    joints = aligned_joints(chain, q)
    ground = Motion(_AT_REST, _upward(chain), _NO_FIELD)
    motions: list[Motion] = []
    for joint in joints:
        motions.append(outward(joint, ground if joint.parent < 0 else motions[joint.parent]))
    forces = [inertia_force(own, x.a, x.K) for own, x in zip(_moments(chain), motions, strict=True)]
    if W is not None:
        forces = [force + load for force, load in zip(forces, _wrenches(mechanism, chain, W), strict=True)]
    return _gathered(chain, joints, q, forces, outward=[x.a for x in motions])


def gravity_forces(mechanism: Mechanism, q: Series) -> Series:
    """Qgrav: the forces that the acceleration -g of every body's frame takes."""
    chain = minimal(mechanism)
    joints = aligned_joints(chain, q)
    a: list[Series] = []
    for joint in joints:
        a.append(carried_along(joint, _upward(chain) if joint.parent < 0 else a[joint.parent], _NO_FIELD))
    forces = [inertia_force(own, a_i, _NO_FIELD) for own, a_i in zip(_moments(chain), a, strict=True)]
    return _gathered(chain, joints, q, forces, outward=a)


def external_forces(mechanism: Mechanism, q: Series, W: Series) -> Series:
    """Qext = J^T W (Qext), which `inverse_dynamics` holds; alone it is a witness."""
    chain = minimal(mechanism)
    return _gathered(chain, aligned_joints(chain, q), q, _wrenches(mechanism, chain, W), outward=())


def _upward(chain: Mechanism) -> Series:
    return Series.constant(-chain.gravity[:, None])


@lru_cache(maxsize=64)
def _moments(chain: Mechanism) -> list[tuple[Array, Array, Array]]:
    return [inertia.moments(M) for M in chain.M]


def _wrenches(old: Mechanism, chain: Mechanism, W: Series) -> list[Force]:
    """Forces and moments on the frames of `chain` from wrenches (moment; force) on those of `old`."""
    loads = []
    for i, carry in enumerate(Ad(moves(old, chain)).mT):
        W_i = carry @ rows(W, 6 * i, 6 * i + 6)
        loads.append(Force(f=rows(W_i, 3, 6), n=rows(W_i, 0, 3)))
    return loads


def _gathered(
    chain: Mechanism, joints: Sequence[AlignedJoint], q: Series, forces: Sequence[Force], outward: Sequence[Series]
) -> Series:
    """The inward sweep: the forces in the coordinates that balance what acts on the bodies."""
    on = list(forces)
    for i in reversed(range(chain.nb)):
        if (p := joints[i].parent) >= 0:
            on[p] = on[p] + inward(joints[i], on[i])
    Q = joined([felt(joint, force) + still(q) for joint, force in zip(joints, on, strict=True)], axis=-2)
    return chain.G.T @ in_order(Q, [*outward, *(force.n for force in reversed(on))])
