"""Joints in motion: transport of vectors, twists, wrenches and moments of mass from body to body, with rates.

A joint moves its body by ``exp(X theta)``. It transports such quantities from one frame to the other by a matrix E with
``E' = theta' L E`` and a constant L. Hence ``y = E x`` has the rate ``y' = E x' + theta' L y``: rates are transported
first and then corrected, and rates of E never appear.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from jounce._scalars import Array, exact_integers, is_symbolic
from jounce.model.coordinates import joint_variables
from jounce.model.equivalent import split_turn
from jounce.model.mechanism import Mechanism
from jounce.spatial.lie import Ad, ad, exp_of, inverse, turn_and_slide, wedge
from jounce.spatial.series import Series, from_rates


def transport(E: Array, L: Array, rate: Series, x: Series) -> Series:
    """y = E x, with E' = rate L E."""
    return from_rates(lambda k: E @ x[k], lambda y: rate * (L @ y))


def transport_form(E: Array, L: Array, rate: Series, x: Series) -> Series:
    """y = E x E^T, with E' = rate L E."""
    return from_rates(lambda k: E @ x[k] @ E.mT, lambda y: rate * (L @ y + y @ L.mT))


@dataclass(frozen=True)
class Placement:
    """The constants of a joint: its pose in the parent, and its screw."""

    parent: int
    G: Array  # (1, n) the coordinates that the joint follows
    B: Array  # (4, 4) pose of the body in its parent's frame at theta = 0, but for the turn that T has then
    X: Array  # (6, 1) joint screw in the body frame
    Ad_B: Array  # Ad(B^-1)
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

    def twists(self, x: Series) -> Series:
        """Transport twists (..., 6, k) from the parent's frame to the body's."""
        return transport(self.A, -self.ad_X, self.rate, self.Ad_B @ x)

    def wrenches(self, x: Series) -> Series:
        """Transport wrenches (..., 6, k) from the body's frame to the parent's."""
        return self.Ad_B.mT @ transport(self.A.mT, -self.ad_X.mT, self.rate, x)

    def points(self, x: Series) -> Series:
        """Transport points and weighted sums of points (..., 4, k), (m r; m), from the body's frame to the parent's."""
        return self.B @ transport(self.T, self.X_hat, self.rate, x)

    def moments(self, x: Series) -> Series:
        """Transport moments of mass (..., 4, 4) from the body's frame to the parent's."""
        return self.B @ transport_form(self.T, self.X_hat, self.rate, x) @ self.B.mT

    def forms(self, x: Series) -> Series:
        """Transport bilinear forms of twists (..., 6, 6), such as inertia, from the body's frame to the parent's."""
        return self.Ad_B.mT @ transport_form(self.A.mT, -self.ad_X.mT, self.rate, x) @ self.Ad_B


@lru_cache(maxsize=64)
def placed(mechanism: Mechanism) -> tuple[Array, Array]:
    """B = S Z of every joint: where its body hangs on the parent, and how far it has turned at theta = 0."""
    S, Z = zip(*map(split_turn, mechanism.B, mechanism.X), strict=True)
    return np.stack(S), np.stack(Z)


@lru_cache(maxsize=64)
def _placements(mechanism: Mechanism) -> list[Placement]:
    (B, _), X = placed(mechanism), mechanism.X
    data = (mechanism.parent, mechanism.G[:, None, :], B, X[..., None], Ad(inverse(B)), ad(X), wedge(X))
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
