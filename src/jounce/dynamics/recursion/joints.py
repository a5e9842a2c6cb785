"""Joints in motion: transport of vectors, twists, wrenches and moments of mass from body to body, with rates.

A joint moves its body by ``exp(X theta)``. It transports such quantities from one frame to the other by a matrix E with
``E' = theta' L E`` and a constant L. Hence ``y = E x`` has the rate ``y' = E x' + theta' L y``: rates are transported
first and then corrected, and rates of E never appear.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from jounce.core.scalars import Array, exact_integers, is_symbolic
from jounce.model.coordinates import joint_variables
from jounce.model.equivalent import split_turn
from jounce.model.mechanism import Mechanism
from jounce.spatial.lie import Ad, ad, cowedge, exp_of, inverse, pose, position, rotation, turn_and_slide, wedge
from jounce.spatial.linear import mirrored
from jounce.spatial.series import Series, from_rates

_I = np.eye(3, dtype=int)


def transport(E: Array, L: Array, rate: Series, x: Series) -> Series:
    """y = E x, with E' = rate L E."""
    return from_rates(lambda k: E @ x[k], lambda y: rate * (L @ y))


def transport_form(E: Array, L: Array, rate: Series, x: Series) -> Series:
    """y = E x E^T, with E' = rate L E."""
    return from_rates(lambda k: E @ x[k] @ E.mT, lambda y: rate * (L @ y + y @ L.mT))


def transport_symmetric(E: Array, L: Array, rate: Series, x: Series) -> Series:
    """y = E x E^T of symmetric x, with E' = rate L E."""
    return from_rates(lambda k: congruence(E, x[k]), lambda y: rate * (L @ y + y @ L.mT))


def congruence(E: Array, x: Array) -> Array:
    """E x E^T of symmetric x."""
    return mirrored(E @ x @ E.mT)


@dataclass(frozen=True)
class Placement:
    """The constants of a joint: its pose in the parent, and its screw."""

    parent: int
    G: Array  # (1, n) the coordinates that the joint follows
    B: Array  # (4, 4) pose of the body in its parent's frame at theta = 0, but for the turn that T has then
    offset: Array  # (4, 4) B is the product of its offset and its turn; one after the other costs less than both
    turn: Array
    Ad_offset: Array  # (6, 6) of their inverses
    Ad_turn: Array
    X: Array  # (6, 1) joint screw in the body frame
    ad_X: Array
    X_hat: Array  # wedge(X)


@dataclass(frozen=True)
class Joint(Placement):
    """One joint at an instant."""

    theta: Series  # (..., 1, 1)
    T: Array  # (..., 4, 4), Z exp(X theta)
    A: Array  # (..., 6, 6), Ad(T^-1)

    @property
    def rate(self) -> Series:
        """The joint's velocity."""
        return self.theta.dot

    def momentum(self, Pi: Series) -> Series:
        """I S, (..., 6, 1): the momentum that the screw gives moments of mass, (..., 4, 4)."""
        return momentum(self.X_hat[None], Pi)

    def screw_rate(self, V: Series) -> Series:
        """S' = ad(V) S, (..., 6, 1): the rate in space of the screw on a body that moves with the twist V."""
        return -(self.ad_X @ V)

    def cross(self, W: Series) -> Series:
        """S x W, (..., 6, 1): the rate of a wrench W, (..., 6, 1), that moves with the screw."""
        return -(self.ad_X.mT @ W)

    def twists(self, x: Series) -> Series:
        """Transport twists (..., 6, k) from the parent's frame to the body's."""
        return transport(self.A, -self.ad_X, self.rate, self.Ad_turn @ (self.Ad_offset @ x))

    def wrenches(self, x: Series) -> Series:
        """Transport wrenches (..., 6, k) from the body's frame to the parent's."""
        y = transport(self.A.mT, -self.ad_X.mT, self.rate, x)
        return y.map(lambda y: self.Ad_offset.mT @ (self.Ad_turn.mT @ y))

    def points(self, x: Series) -> Series:
        """Transport points and weighted sums of points (..., 4, k), (m r; m), from the body's frame to the parent's."""
        return self.B @ transport(self.T, self.X_hat, self.rate, x)

    def moments(self, x: Series) -> Series:
        """Transport moments of mass (..., 4, 4) from the body's frame to the parent's."""
        y = transport_symmetric(self.T, self.X_hat, self.rate, x)
        return y.map(lambda y: congruence(self.offset, congruence(self.turn, y)))

    def inertias(self, x: Series) -> Series:
        """Transport symmetric forms of twists (..., 6, 6), as inertia is, from the body's frame to the parent's."""
        y = transport_symmetric(self.A.mT, -self.ad_X.mT, self.rate, x)
        return y.map(lambda y: congruence(self.Ad_offset.mT, congruence(self.Ad_turn.mT, y)))

    def forms(self, x: Series) -> Series:
        """Transport bilinear forms of twists (..., 6, 6) from the body's frame to the parent's."""
        y = self.Ad_turn.mT @ transport_form(self.A.mT, -self.ad_X.mT, self.rate, x) @ self.Ad_turn
        return self.Ad_offset.mT @ y @ self.Ad_offset


def momentum(S_hat: Array, Pi: Series) -> Series:
    """I S, (..., 6, k), of screws as matrices, wedge(S), (k, 4, 4), and moments of mass, (..., 4, 4)."""
    return Pi.map(lambda Pi: cowedge(S_hat @ Pi[..., None, :, :]).mT)


@lru_cache(maxsize=64)
def placed(mechanism: Mechanism) -> tuple[Array, Array]:
    """B = S Z of every joint: where its body hangs on the parent, and how far it has turned at theta = 0."""
    S, Z = zip(*map(split_turn, mechanism.B, mechanism.X), strict=True)
    return np.stack(S), np.stack(Z)


@lru_cache(maxsize=64)
def _placements(mechanism: Mechanism) -> list[Placement]:
    (B, _), X = placed(mechanism), mechanism.X
    offset, turn = pose(_I, position(B)), pose(rotation(B), np.zeros((3, 1), dtype=int))
    ads = Ad(inverse(offset)), Ad(inverse(turn))
    data = (mechanism.parent, mechanism.G[:, None, :], B, offset, turn, *ads, X[..., None], ad(X), wedge(X))
    return [Placement(*of_joint) for of_joint in zip(*data, strict=True)]


@lru_cache(maxsize=64)
def _turns_and_slides(mechanism: Mechanism) -> tuple[Array, Array]:
    turns, slides = zip(*map(turn_and_slide, mechanism.X), strict=True)
    return np.stack(turns), np.stack(slides)


def motions(mechanism: Mechanism, theta: Array, bodies: Sequence[int]) -> Array:
    """Z exp(X theta) of the joints of some bodies, all at once: (..., len(bodies), 4, 4)."""
    turns, slides = _turns_and_slides(mechanism)
    chosen = np.array(bodies, dtype=int)
    T = placed(mechanism)[1][chosen] @ exp_of(turns[chosen], slides[chosen], theta[..., chosen, :, None])
    return exact_integers(T) if is_symbolic(T) else T


def joints(mechanism: Mechanism, q: Series, bodies: Sequence[int] | None = None) -> list[Joint]:
    """The joints of some bodies, or of all, for coordinates q."""
    bodies = range(mechanism.nb) if bodies is None else bodies
    theta = joint_variables(mechanism, q)
    T = motions(mechanism, theta[0], bodies)
    A = Ad(inverse(T))
    placements = _placements(mechanism)
    return [
        Joint(**vars(placements[i]), theta=rows(theta, i, i + 1), T=T[..., k, :, :], A=A[..., k, :, :])
        for k, i in enumerate(bodies)
    ]


def rows(columns: Series, first: int, last: int) -> Series:
    """Some rows of columns."""
    return columns.map(lambda x: x[..., first:last, :])


def batch_zeros(q: Series) -> Series:
    """Return zeros (..., 1, 1) with the batch shape of q, to be added to what does not depend on q."""
    return 0 * rows(q, 0, 1)
