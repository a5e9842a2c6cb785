"""Generalized forces (RNEA with rates): one sweep outward and one inward over the tree, in the frames with most zeros.

The order of steps is written once, in `sweep`. A `Sweep` specifies what the bodies pass on; a `Tree` stores the numbers
and performs the steps: here on time series, in native code in memory, by a loop over the bodies.

RNEA: R. Featherstone, Rigid Body Dynamics Algorithms, 5.3. Its rates: C. Guarino Lo Bianco, IEEE Trans. Robotics 25(4),
2009, the first; G. Buondonno, A. De Luca, IROS 2015, the second; S. Kumar, A. Müller, ICRA 2021, any.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Protocol

import numpy as np

from jounce.core.scalars import Array
from jounce.dynamics.recursion import steps
from jounce.dynamics.recursion.joints import batch_zeros, take_rows
from jounce.dynamics.recursion.steps import AnyJoint, BodyForce, BodyMotion, Moments
from jounce.dynamics.recursion.sweeps import evaluate_in_order
from jounce.dynamics.recursion.tree import KinematicTree, aligned_tree
from jounce.dynamics.state import JointMotion
from jounce.model.equivalent_mechanisms import align_to_axes, frame_shifts, minimal_mechanism
from jounce.model.mechanism import Mechanism
from jounce.spatial import inertia
from jounce.spatial.lie import Ad, inverse
from jounce.spatial.series import Series, join_series

_ZERO_VECTOR = Series.constant(np.zeros((3, 1), dtype=int))
_ZERO_MATRIX = Series.constant(np.zeros((3, 3), dtype=int))


@dataclass(frozen=True)
class Sweep:
    """The parts of a body's motion, their step from parent to body, and the force that they require.

    `parts` are the nonzero parts of `BodyMotion`; each has the number of rates that it needs in addition to those of Q.
    """

    parts: Mapping[str, int]
    outward: Callable[[AnyJoint, BodyMotion], BodyMotion]
    force: Callable[[Moments, BodyMotion], BodyForce] = steps.inertia_force


MOVING_SWEEP = Sweep({"w": 1, "a": 0, "K": 0}, steps.propagate_motion)
RESTING_SWEEP = Sweep({"a": 0}, steps.propagate_acceleration)  # under gravity alone


class Tree(Protocol):
    """The bodies of a mechanism, independent of where their data are stored; a body is identified by its index."""

    def outward(self) -> Iterator[Any]:
        """The bodies, each after its parent."""

    def inward(self) -> Iterator[Any]:
        """The bodies, each before its parent."""

    def move(self, i: Any) -> None:
        """Compute the motion of a body from its parent's, and the force that the motion requires."""

    def add_wrench(self, i: Any) -> None:
        """Add the wrench that a body exerts, if any, to the force on it."""

    def hand_on(self, i: Any) -> None:
        """Project the force on a body onto its joint, and add it to that on the parent."""

    def collect(self, i: Any) -> None:
        """Add the force of a joint to those of the coordinates that it follows."""


def sweep(tree: Tree) -> None:
    """Compute motions and inertia forces outward, then joint forces inward."""
    for i in tree.outward():
        tree.move(i)
        tree.add_wrench(i)
    for i in tree.inward():
        tree.hand_on(i)
        tree.collect(i)


def ground(gravity: Array) -> BodyMotion:
    """Return the motion of the ground: it accelerates by -g, which replaces gravity."""
    return BodyMotion(_ZERO_VECTOR, Series.constant(-gravity[:, None]), _ZERO_MATRIX)


def rnea(kind: Sweep, m: Mechanism, q: Series, W: Series | None = None, base: JointMotion | None = None) -> Series:
    """The generalized forces (EOM1), (..., nv, 1), by RNEA, with wrenches W on the bodies, (..., 6nb, 1)."""
    return _run_sweep(kind, m, minimal_mechanism(m), q, W, base).forces()


def base_wrench(m: Mechanism, q: Series, W: Series | None = None, base: JointMotion | None = None) -> Series:
    """The wrench (moment; force) on the base, in inertial axes about the inertial origin: (..., 6, 1).

    It is what the bodies pass to the ground. It depends on all of the inertia, drive forces on base parameters only.
    """
    return _run_sweep(MOVING_SWEEP, m, align_to_axes(m), q, W, base).wrench(-1)


def joint_wrenches(m: Mechanism, q: Series, W: Series | None = None, base: JointMotion | None = None) -> Series:
    """The wrenches (moment; force) that the joints transmit to their bodies, in the body frames: (..., nb, 6).

    They are the forces on the bodies and on what these carry, before they are projected on the joints.
    """
    chain = align_to_axes(m)
    swept = _run_sweep(MOVING_SWEEP, m, chain, q, W, base)
    to_given = Ad(inverse(frame_shifts(m, chain))).mT
    return join_series([(E @ swept.wrench(i)).mT for i, E in zip(swept.tree.own, to_given, strict=True)], axis=-2)


def _run_sweep(
    kind: Sweep, given: Mechanism, chain: Mechanism, q: Series, W: Series | None, base: JointMotion | None
) -> "_SeriesTree":
    """The tree of a mechanism, with forces in the frames of `chain` and wrenches on those of `given`."""
    tree = aligned_tree(chain, q, base)
    on_bodies = [] if W is None else shift_wrenches(given, chain, W)
    swept = _SeriesTree(
        kind, tree, q, dict(zip(tree.own, on_bodies, strict=False)), {-1: ground(chain.gravity)}, {}, {}
    )
    sweep(swept)
    return swept


@dataclass(frozen=True)
class _SeriesTree:
    """The tree in time series: motions, forces on the bodies, forces of the joints."""

    kind: Sweep
    tree: KinematicTree[AnyJoint]
    q: Series
    wrenches: Mapping[int, Series]
    motions: dict[int, BodyMotion]
    on: dict[int, BodyForce]
    Q: dict[int, Series]

    def outward(self) -> Iterator[int]:
        yield from range(len(self.tree.joints))

    def inward(self) -> Iterator[int]:
        yield from reversed(range(len(self.tree.joints)))

    def move(self, i: int) -> None:
        joint = self.tree.joints[i]
        self.motions[i] = self.kind.outward(joint, self.motions[joint.parent])
        self.on[i] = self.kind.force(_moments(self.tree.mechanism)[i], self.motions[i])

    def add_wrench(self, i: int) -> None:
        if i in self.wrenches:
            W = self.wrenches[i]
            self.on[i] = self.on[i] + BodyForce(f=take_rows(W, 3, 6), n=take_rows(W, 0, 3))

    def hand_on(self, i: int) -> None:
        joint = self.tree.joints[i]
        self.Q[i] = joint.force(self.on[i])
        p, handed = joint.parent, joint.inward(self.on[i])
        self.on[p] = self.on[p] + handed if p in self.on else handed

    def collect(self, i: int) -> None:
        self.Q[i] = self.Q[i] + batch_zeros(self.q)

    def forces(self) -> Series:
        """G^T Q of the joints."""
        return self._in_order(self.tree.generalized_forces(join_series([self.Q[i] for i in self.outward()], axis=-2)))

    def wrench(self, i: int) -> Series:
        """The moment and the force on a body and what it carries, or on the ground, (..., 6, 1)."""
        return self._in_order(join_series([self.on[i].n, self.on[i].f], axis=-2) + batch_zeros(self.q))

    def _in_order(self, result: Series) -> Series:
        """A result, computed body by body."""
        steps = [*(self.motions[i].a for i in self.outward()), *(self.on[i].n for i in self.inward())]
        return evaluate_in_order(result, steps)


@lru_cache(maxsize=64)
def _moments(chain: Mechanism) -> list[Moments]:
    return [inertia.moments(M) for M in chain.M]


def shift_wrenches(old: Mechanism, chain: Mechanism, W: Series) -> list[Series]:
    """The wrenches (..., 6, 1) on the frames of `chain`, one per body, from those on the frames of `old`."""
    return [carry @ take_rows(W, 6 * i, 6 * i + 6) for i, carry in enumerate(Ad(frame_shifts(old, chain)).mT)]
