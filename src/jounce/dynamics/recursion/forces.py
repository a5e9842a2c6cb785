"""Generalized forces (RNEA with rates): one sweep outward and one inward over the tree, in the frames with most zeros.

The order of steps is written once, in `sweep`. A `Sweep` specifies what the bodies pass on; a `Tree` stores the numbers
and performs the steps: here on time series, in native code in memory, by a loop over the bodies.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Protocol

import numpy as np

from jounce.core.scalars import Array
from jounce.dynamics.base import BaseMotion
from jounce.dynamics.recursion.joints import batch_zeros, rows
from jounce.dynamics.recursion.steps import (
    AlignedJoint,
    BodyMotion,
    Force,
    Moments,
    aligned_joints,
    inertia_force,
    inward,
    joint_force,
    outward,
    outward_at_rest,
)
from jounce.dynamics.recursion.sweeps import evaluate_in_order
from jounce.model.coordinates import generalized_forces
from jounce.model.equivalent import frame_shifts, minimal, on_axes
from jounce.model.mechanism import Mechanism
from jounce.spatial import inertia
from jounce.spatial.lie import Ad, inverse
from jounce.spatial.series import Series, joined

_STILL = Series.constant(np.zeros((3, 1), dtype=int))
_UNIFORM = Series.constant(np.zeros((3, 3), dtype=int))


def base_motion(gravity: Array, base: BaseMotion) -> BodyMotion:
    """Return the motion of a base, less the acceleration of gravity."""
    K = base.hat_w.dot + base.hat_w @ base.hat_w
    return BodyMotion(base.w, base.v.dot + base.hat_w @ base.v - base.field(gravity), K)


def base_at_rest(gravity: Array, base: BaseMotion) -> BodyMotion:
    """Return the acceleration of a base that replaces gravity."""
    return BodyMotion(_STILL, -base.field(gravity), _UNIFORM)


@dataclass(frozen=True)
class Sweep:
    """The parts of a body's motion, those of the base, their step from parent to body, and the force that they require.

    `parts` are the nonzero parts of `BodyMotion`; each has the number of rates that it needs in addition to those of Q.
    """

    parts: Mapping[str, int]
    base: Callable[[Array, BaseMotion], BodyMotion]
    outward: Callable[[AlignedJoint, BodyMotion], BodyMotion]
    force: Callable[[Moments, BodyMotion], Force] = inertia_force


MOVING = Sweep({"w": 1, "a": 0, "K": 0}, base_motion, outward)
AT_REST = Sweep({"a": 0}, base_at_rest, outward_at_rest)  # under gravity alone


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
    return BodyMotion(_STILL, Series.constant(-gravity[:, None]), _UNIFORM)


def rnea(
    kind: Sweep, mechanism: Mechanism, q: Series, W: Series | None = None, base: BaseMotion | None = None
) -> Series:
    """The generalized forces (EOM1), (..., nv, 1), by RNEA, with wrenches W on the bodies, (..., 6nb, 1)."""
    tree = _Series(kind, mechanism, minimal(mechanism), q, W, base)
    sweep(tree)
    return tree.forces()


def base_wrench(mechanism: Mechanism, q: Series, W: Series | None = None, base: BaseMotion | None = None) -> Series:
    """The wrench (moment; force) on the base, in inertial axes about the inertial origin: (..., 6, 1).

    It is what the bodies pass to the ground. It depends on all of the inertia, drive forces on base parameters only.
    """
    tree = _Series(MOVING, mechanism, on_axes(mechanism), q, W, base)
    sweep(tree)
    return tree.on_base() if base is None else base.in_space(tree.on_base())


def joint_wrenches(mechanism: Mechanism, q: Series, W: Series | None = None, base: BaseMotion | None = None) -> Series:
    """The wrenches (moment; force) that the joints transmit to their bodies, in the body frames: (..., nb, 6).

    They are the forces on the bodies and on what these carry, before they are projected on the joints; that of a base
    that floats is first.
    """
    chain = on_axes(mechanism)
    tree = _Series(MOVING, mechanism, chain, q, W, base)
    sweep(tree)
    to_given = Ad(inverse(frame_shifts(mechanism, chain))).mT
    found = [E @ tree.wrench(i - mechanism.first) for i, E in enumerate(to_given)]
    return joined([F.mT for F in found], axis=-2)


class _Series:
    """The tree in time series: motions, forces on the bodies, forces of the joints."""

    def __init__(
        self, kind: Sweep, given: Mechanism, chain: Mechanism, q: Series, W: Series | None, base: BaseMotion | None
    ) -> None:
        self.kind, self.chain, self.q = kind, chain, q
        self.joints = aligned_joints(self.chain, q)
        self.wrenches = None if W is None else wrenches(given, chain, W)
        root = ground(self.chain.gravity) if base is None else kind.base(self.chain.gravity, base)
        self.motions: dict[int, BodyMotion] = {-1: root}
        self.on: dict[int, Force] = {}
        self.Q: dict[int, Series] = {}
        if chain.base:
            self.on[-1] = kind.force(inertia.moments(chain.base.M), root)
            self.add_wrench(-1)

    def outward(self) -> Iterator[int]:
        yield from range(self.chain.nb)

    def inward(self) -> Iterator[int]:
        yield from reversed(range(self.chain.nb))

    def move(self, i: int) -> None:
        motion = self.motions[i] = self.kind.outward(self.joints[i], self.motions[self.joints[i].parent])
        self.on[i] = self.kind.force(_moments(self.chain)[i], motion)

    def add_wrench(self, i: int) -> None:
        if self.wrenches is not None:
            W = self.wrenches[i + self.chain.first]
            self.on[i] = self.on[i] + Force(f=rows(W, 3, 6), n=rows(W, 0, 3))

    def hand_on(self, i: int) -> None:
        self.Q[i] = joint_force(self.joints[i], self.on[i])
        p, handed = self.joints[i].parent, inward(self.joints[i], self.on[i])
        self.on[p] = self.on[p] + handed if p in self.on else handed

    def collect(self, i: int) -> None:
        self.Q[i] = self.Q[i] + batch_zeros(self.q)

    def forces(self) -> Series:
        """G^T Q of the joints, and before it the wrench on a floating base."""
        Q = generalized_forces(self.chain, joined([self.Q[i] for i in range(self.chain.nb)], axis=-2))
        return self._in_order(joined([self.on[-1].n, self.on[-1].f, Q], axis=-2) if self.chain.base else Q)

    def on_base(self) -> Series:
        """The moment and the force on the base, or on the ground."""
        return self.wrench(-1)

    def wrench(self, i: int) -> Series:
        """The moment and the force on a body and what it carries, (..., 6, 1)."""
        return self._in_order(joined([self.on[i].n, self.on[i].f], axis=-2) + batch_zeros(self.q))

    def _in_order(self, result: Series) -> Series:
        """A result, computed body by body."""
        steps = [*(self.motions[i].a for i in self.outward()), *(self.on[i].n for i in self.inward())]
        return evaluate_in_order(result, steps)


@lru_cache(maxsize=64)
def _moments(chain: Mechanism) -> list[Moments]:
    return [inertia.moments(M) for M in chain.M]


def wrenches(old: Mechanism, chain: Mechanism, W: Series) -> list[Series]:
    """The wrenches (..., 6, 1) on the frames of `chain`, one per body, from those on the frames of `old`."""
    return [carry @ rows(W, 6 * i, 6 * i + 6) for i, carry in enumerate(Ad(frame_shifts(old, chain)).mT)]
