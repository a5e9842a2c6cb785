"""Joints in motion: transport of vectors, twists, wrenches and moments of mass from body to body, with rates.

A joint moves its body by H with ``H' = H wedge(X nu)``, X its screws in the frame of the body, nu its velocities. A
matrix E transports such quantities from one frame to the other; the rate of E is E times a constant L times nu, on one
side or the other. Hence ``y = E x`` has the rate ``y' = E x' + L nu y`` towards the body, and ``y' = E (x' + L nu x)``
towards its parent: rates are transported and corrected, and rates of E never appear. With one screw both are the same.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from jounce.core.scalars import Array, is_symbolic, restore_integers
from jounce.dynamics.state import JointMotion, motion_of_joint
from jounce.model import coordinates
from jounce.model.equivalent_mechanisms import split_turn
from jounce.model.mechanism import Mechanism, single_variables
from jounce.spatial.lie import (
    Ad,
    ad,
    cowedge,
    exp_turn_and_slide,
    inverse,
    pose,
    position,
    rotation,
    turn_and_slide,
    wedge,
)
from jounce.spatial.linear import mirror_triangle
from jounce.spatial.series import Series, from_rate, from_rates

_I = np.eye(3, dtype=int)


def congruence(E: Array, x: Array) -> Array:
    """E x E^T of symmetric x."""
    return mirror_triangle(E @ x @ E.mT)


@dataclass(frozen=True)
class Placement:
    """The constants of a joint: its pose in the parent, and its screws."""

    parent: int
    B: Array  # (4, 4) pose of the body in its parent's frame at theta = 0, but for the turn that T has then
    offset: Array  # (4, 4) B is the product of its offset and its turn; one after the other costs less than both
    turn: Array
    Ad_offset: Array  # (6, 6) of their inverses
    Ad_turn: Array
    X: Array  # (6, k) joint screws in the body frame
    ad_X: Array  # (k, 6, 6)
    X_hat: Array  # (k, 4, 4), wedge(X)


@dataclass(frozen=True)
class MovingJoint(Placement):
    """One joint of one screw at an instant."""

    rate: Series  # (..., k, 1) its velocities
    T: Array  # (..., 4, 4), Z exp(X theta), or where it moves its body
    A: Array  # (..., 6, 6), Ad(T^-1)

    @property
    def motion(self) -> Series:
        """T with its rates."""
        return from_rate(self.T, lambda T: T @ self.X_hat[0] * self.rate)

    def momentum(self, Pi: Series) -> Series:
        """I S, (..., 6, k): the momenta that the screws give moments of mass, (..., 4, 4)."""
        return Pi.map(lambda Pi: cowedge(self.X_hat @ Pi[..., None, :, :]).mT)

    def screw_rate(self, V: Series) -> Series:
        """S' = ad(V) S, (..., 6, k): the rates in space of the screws on a body that moves with the twist V."""
        return -(self.ad_X[0] @ V)

    def cross(self, W: Series) -> Series:
        """S x W, (..., 6, k): the rates of a wrench W, (..., 6, 1), that moves with one of the screws."""
        return -(self.ad_X[0].mT @ W)

    def twists(self, x: Series) -> Series:
        """Transport twists (..., 6, k) from the parent's frame to the body's."""
        x = self.Ad_turn @ (self.Ad_offset @ x)
        return from_rates(lambda k: self.A @ x[k], lambda y: self._along(-self.ad_X, y))

    def wrenches(self, x: Series) -> Series:
        """Transport wrenches (..., 6, k) from the body's frame to the parent's."""
        y = self._inward(x, lambda x: self.A.mT @ x, lambda y: self._along(-self.ad_X.mT, y))
        return y.map(lambda y: self.Ad_offset.mT @ (self.Ad_turn.mT @ y))

    def points(self, x: Series) -> Series:
        """Transport points and weighted sums of points (..., 4, k), (m r; m), from the body's frame to the parent's."""
        return self.B @ self._inward(x, lambda x: self.T @ x, lambda y: self._along(self.X_hat, y))

    def moments(self, x: Series) -> Series:
        """Transport moments of mass (..., 4, 4) from the body's frame to the parent's."""
        y = self._inward(x, lambda x: congruence(self.T, x), lambda y: self._along_both(self.X_hat, y))
        return y.map(lambda y: congruence(self.offset, congruence(self.turn, y)))

    def inertias(self, x: Series) -> Series:
        """Transport symmetric forms of twists (..., 6, 6), as inertia is, from the body's frame to the parent's."""
        y = self._inward(x, lambda x: congruence(self.A.mT, x), lambda y: self._along_both(-self.ad_X.mT, y))
        return y.map(lambda y: congruence(self.Ad_offset.mT, congruence(self.Ad_turn.mT, y)))

    def forms(self, x: Series) -> Series:
        """Transport bilinear forms of twists (..., 6, 6) from the body's frame to the parent's."""
        y = self._inward(x, lambda x: self.A.mT @ x @ self.A, lambda y: self._along_both(-self.ad_X.mT, y))
        return self.Ad_offset.mT @ (self.Ad_turn.mT @ y @ self.Ad_turn) @ self.Ad_offset

    def _along(self, L: Array, y: Series) -> Series:
        """L nu y."""
        return self.rate * (L[0] @ y)

    def _along_both(self, L: Array, y: Series) -> Series:
        """L nu y + y (L nu)^T."""
        return self.rate * (L[0] @ y + y @ L[0].mT)

    def _inward(self, x: Series, transported: Callable[[Array], Array], drift: Callable[[Series], Series]) -> Series:
        """y = E x, where E and its generator commute."""
        return from_rates(lambda k: transported(x[k]), drift)


class FreeJoint(MovingJoint):
    """One joint of several screws at an instant: they span a subalgebra, and T is any motion of its group."""

    @property
    def motion(self) -> Series:
        return from_rate(self.T, lambda T: T @ self._generator(self.X_hat))

    def screw_rate(self, V: Series) -> Series:
        return V.map(lambda V: -(self.ad_X @ V[..., None, :, :])[..., 0].mT)

    def cross(self, W: Series) -> Series:
        return W.map(lambda W: -(self.ad_X.mT @ W[..., None, :, :])[..., 0].mT)

    def _generator(self, L: Array) -> Series:
        """L nu, the sum over the screws."""
        flat = L.reshape(len(L), -1)
        return self.rate.map(lambda nu: (nu[..., 0] @ flat).reshape((*nu.shape[:-2], *L.shape[1:])))

    def _along(self, L: Array, y: Series) -> Series:
        return self._generator(L) @ y

    def _along_both(self, L: Array, y: Series) -> Series:
        L_nu = self._generator(L)
        return L_nu @ y + y @ L_nu.mT

    def _inward(self, x: Series, transported: Callable[[Array], Array], drift: Callable[[Series], Series]) -> Series:
        return transport_inward(x, transported, drift)


def transport_inward(x: Series, transported: Callable[[Array], Array], drift: Callable[[Series], Series]) -> Series:
    """y = E x, of which ``y' = E (x' + drift(x))``."""
    seen = [x]  # the rates as the outer frame sees them, in the axes of the inner one

    def term(k: int) -> Array:
        while len(seen) <= k:
            seen.append(seen[-1].dot + drift(seen[-1]))
        return transported(seen[k][0])

    return Series(term)


@lru_cache(maxsize=64)
def split_placements(m: Mechanism) -> tuple[Array, Array]:
    """B = S Z of every joint: where its body hangs on the parent, and how far it has turned at theta = 0."""
    alone = single_variables(m)
    both = [split_turn(B, m.X[alone[i]]) if i in alone else (B, np.eye(4, dtype=int)) for i, B in enumerate(m.B)]
    S, Z = zip(*both, strict=True)
    return np.stack(S), np.stack(Z)


@lru_cache(maxsize=64)
def _placements(m: Mechanism) -> list[Placement]:
    B, X = split_placements(m)[0], [coordinates.body_screws(m, i) for i in range(m.nb)]
    offset, turn = pose(_I, position(B)), pose(rotation(B), np.zeros((3, 1), dtype=int))
    constants = B, offset, turn, Ad(inverse(offset)), Ad(inverse(turn)), X
    hats = [ad(X_i.mT) for X_i in X], [wedge(X_i.mT) for X_i in X]
    return [Placement(*data) for data in zip(m.parent, *constants, *hats, strict=True)]


@lru_cache(maxsize=64)
def _turns_and_slides(m: Mechanism) -> tuple[Array, Array]:
    turns, slides = zip(*map(turn_and_slide, m.X), strict=True)
    return np.stack(turns), np.stack(slides)


def joint_transforms(m: Mechanism, theta: Array, bodies: Sequence[int]) -> tuple[dict[int, int], Array]:
    """Z exp(X theta) of those joints of some bodies that have one screw, (..., joints, 4, 4), and where each is."""
    variables = single_variables(m)
    alone = [i for i in bodies if i in variables]
    turns, slides = _turns_and_slides(m)
    chosen = np.array([variables[i] for i in alone], dtype=int)
    T = split_placements(m)[1][alone] @ exp_turn_and_slide(turns[chosen], slides[chosen], theta[..., chosen, :, None])
    T = restore_integers(T) if is_symbolic(T) else T
    return {i: k for k, i in enumerate(alone)}, T


def joints(
    m: Mechanism, q: Series, base: JointMotion | None = None, bodies: Sequence[int] | None = None
) -> list[MovingJoint]:
    """The joints of some bodies, or of all, for coordinates q and the motion of a base that floats."""
    bodies = range(m.nb) if bodies is None else bodies
    theta, placements = coordinates.joint_variables(m, q), _placements(m)
    places, T = joint_transforms(m, theta[0], bodies)
    A = Ad(inverse(T))

    def joint(i: int) -> MovingJoint:
        if i not in places:
            own = motion_of_joint(m, i, q, base)
            return FreeJoint(**vars(placements[i]), rate=own.V, T=own.pose, A=Ad(inverse(own.pose)))
        k, [j] = places[i], m.columns[i]
        return MovingJoint(
            **vars(placements[i]), rate=take_rows(theta, j, j + 1).dot, T=T[..., k, :, :], A=A[..., k, :, :]
        )

    return [joint(i) for i in bodies]


def take_rows(columns: Series, first: int, last: int) -> Series:
    """Some rows of columns."""
    return columns.map(lambda x: x[..., first:last, :])


def batch_zeros(q: Series) -> Series:
    """Return zeros (..., 1, 1) with the batch shape of q, to be added to what does not depend on q."""
    return 0 * take_rows(q, 0, 1)
