"""Partial derivatives of the generalized forces, with rates, from wrenches projected onto joint screws.

The coordinate of joint j displaces the bodies that the joint carries along its screw S_j. With a prime for the rate in
space, S' = ad(V) S and S'' the rates of a screw, g the field of gravity, and of the bodies that joint j carries the
inertia I_j, the momentum p_j and the force F_j, the partial derivatives of the forces of the joint variables are, where
joint i carries joint j or is j itself,

    K_ij = S_i . (I_j A_j + B_j S_j' + S_j x F_j),    K_ji = (I_j S_j) . A_i + (B_j^T S_j) . S_i',
    D_ji = 2 (I_j S_j) . S_i' + (B_j^T S_j) . S_i,    D_ij = 2 M_ij' - D_ji,

where ``A = S'' + S x g`` and ``B x = I' x + x x p``. Wrenches on the bodies, fixed in them, are part of F.

Singh, Russell, Wensing, "Efficient Analytical Derivatives of Rigid-Body Dynamics Using Spatial Vector Algebra",
IEEE Robotics and Automation Letters 7(2), 2022.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from jounce._scalars import Array
from jounce.dynamics.base import BaseMotion
from jounce.dynamics.recursion.joints import Joint, batch_zeros, joints, rows
from jounce.dynamics.recursion.sweeps import above, collect, composites, evaluate_in_order, project, velocities
from jounce.model.coordinates import generalized_matrix
from jounce.model.equivalent import frame_shifts, minimal
from jounce.model.mechanism import Mechanism
from jounce.spatial.inertia import moment_matrix
from jounce.spatial.lie import Ad, ad, cowedge, wedge
from jounce.spatial.series import Series

Partials = tuple[Series, Series, Series]  # K, D, M: by q, qd and q2d


@dataclass(frozen=True)
class _Subtree:
    """The bodies that a joint carries, and the joint itself, in its body frame; rates are those in space."""

    joint: Joint
    Pi: Series  # (..., 4, 4) moments of mass
    Pi_rate: Series
    p: Series  # (..., 6, 1) momentum and force
    F: Series
    S_rate: Series
    A: Series

    def momentum(self) -> Series:
        """I S."""
        return _wrench(self.joint.X_hat @ self.Pi)

    def reaction(self) -> Series:
        """B^T S."""
        return _wrench(self.joint.X_hat @ self.Pi_rate) + self.joint.ad_X.mT @ self.p

    def change(self) -> Series:
        """I A + B S' + S x F."""
        moved = self.A.map(_wedge) @ self.Pi + self.S_rate.map(_wedge) @ self.Pi_rate
        return _wrench(moved) + _cross(self.S_rate, self.p) - self.joint.ad_X.mT @ self.F


def partials(mechanism: Mechanism, q: Series, W: Series | None = None, base: BaseMotion | None = None) -> Partials:
    """K, D, M of the generalized forces, (..., n, n) each, with wrenches W on the bodies, (..., 6nb, 1)."""
    chain = minimal(mechanism)
    tree = joints(chain, q)
    V, field = velocities(tree), _gravity(tree, chain.gravity)
    accelerations = [V_i.dot - g for V_i, g in zip(V, field, strict=True)]
    Pi = composites(tree, [Series.constant(Pi_i) for Pi_i in moment_matrix(chain.M)], Joint.moments)
    p = composites(tree, [M_i @ V_i for M_i, V_i in zip(chain.M, V, strict=True)], Joint.wrenches)
    loads = None if W is None else composites(tree, _loads(mechanism, chain, W), Joint.wrenches)
    subtrees = []
    for i, joint in enumerate(tree):
        flow = V[i].map(_wedge) @ Pi[i]
        F = p[i].dot + _cross(V[i], p[i]) - _wrench(field[i].map(_wedge) @ Pi[i])
        F = F if loads is None else F + loads[i]
        S_rate = -(joint.ad_X @ V[i])
        A = -(joint.ad_X @ accelerations[i]) + V[i].map(_ad) @ S_rate
        subtrees.append(_Subtree(joint, Pi[i], Pi[i].dot + flow + flow.mT, p[i], F, S_rate, A))
    return _projected(chain, q, subtrees, [*V, *field, *Pi[::-1], *p[::-1]])


def _projected(chain: Mechanism, q: Series, subtrees: Sequence[_Subtree], before: Sequence[Series]) -> Partials:
    """Transport the wrenches of the joints inward, and project them onto the screws."""
    tree = [x.joint for x in subtrees]
    momenta, reactions, changes = (
        collect(tree, [wrench(x) for x in subtrees])
        for wrench in (_Subtree.momentum, _Subtree.reaction, _Subtree.change)
    )
    S, S_rate, A = [Series.constant(x.joint.X) for x in subtrees], [x.S_rate for x in subtrees], [x.A for x in subtrees]
    M, by_rate = project(S, momenta), project(S_rate, momenta) * 2 + project(S, reactions)
    by_place = project(A, momenta) + project(S_rate, reactions)
    K = project(S, changes) + above(by_place, tree).mT
    D = M.dot * 2 - by_rate + above(by_rate, tree).mT
    steps = [*before, *(column.values for sweep in (momenta, reactions, changes) for column in reversed(sweep))]

    def of_coordinates(matrix: Series) -> Series:
        return evaluate_in_order(generalized_matrix(chain, matrix + batch_zeros(q)), steps)

    return of_coordinates(K), of_coordinates(D), of_coordinates(M + above(M, tree).mT)


def _gravity(tree: Sequence[Joint], gravity: Array) -> list[Series]:
    """The field of gravity as a twist of each body, which moves as a twist that is constant in space."""
    ground = Series.constant(np.concatenate([0 * gravity, gravity])[:, None])
    field: list[Series] = []
    for joint in tree:
        field.append(joint.twists(ground if joint.parent < 0 else field[joint.parent]))
    return field


def _loads(old: Mechanism, chain: Mechanism, W: Series) -> list[Series]:
    """Wrenches on the frames of `chain` from those on the frames of `old`."""
    return [Ad_i.mT @ rows(W, 6 * i, 6 * i + 6) for i, Ad_i in enumerate(Ad(frame_shifts(old, chain)))]


def _wrench(T: Series) -> Series:
    return T.map(lambda x: cowedge(x)[..., None])


def _cross(X: Series, wrench: Series) -> Series:
    """X x W, the rate of a wrench that moves with the screw X."""
    return -(X.map(_ad).mT @ wrench)


def _ad(X: Array) -> Array:
    return ad(X[..., 0])


def _wedge(X: Array) -> Array:
    return wedge(X[..., 0])
