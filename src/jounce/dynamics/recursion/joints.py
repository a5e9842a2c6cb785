"""Joints in motion: transport of vectors, twists, wrenches and moments of mass from body to body, with rates.

A joint moves its body by H with ``H' = H wedge(X nu)``, X its screws in the frame of the body, nu its velocities. A
matrix E transports such quantities from one frame to the other; the rate of E is E times a constant L times nu, on one
side or the other. Hence ``y = E x`` has the rate ``y' = E x' + L nu y`` towards the body, and ``y' = E (x' + L nu x)``
towards its parent: rates are transported and corrected, and rates of E never appear. With one screw both are the same.

How often what runs: `_placements` and `_turns_and_slides` once per robot, `joints` once per evaluation, with one matrix
exponential for all joints; a transport once per quantity and order.
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
    """Return E x E^T of symmetric x."""
    return mirror_triangle(E @ x @ E.mT)


@dataclass(frozen=True)
class Placement:
    """The constants of a joint: the pose of its body in the parent, and its screws."""

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
        """Return I S, the momenta of moments of mass by screws.

        I S is (..., 6, k), moments of mass are (..., 4, 4).
        """
        return Pi.map(lambda Pi: cowedge(self.X_hat @ Pi[..., None, :, :]).mT)

    def screw_rate(self, V: Series) -> Series:
        """Return the rates in space of screws on a body.

        S' = ad(V) S, (..., 6, k), where the body has the twist V.
        """
        return -(self.ad_X[0] @ V)

    def cross(self, W: Series) -> Series:
        """Return S x W, the rates of a wrench by screws.

        W is (..., 6, 1), S x W is (..., 6, k).
        """
        return -(self.ad_X[0].mT @ W)

    def twists(self, x: Series) -> Series:
        """Transport twists (..., 6, k) from the parent's frame to the body's."""
        # Constants first, then T, which moves: y = A x has the rate A x' - ad(X nu) y.
        x = self.Ad_turn @ (self.Ad_offset @ x)
        return from_rates(lambda k: self.A @ x[k], lambda y: self._along(-self.ad_X, y))

    def wrenches(self, x: Series) -> Series:
        """Transport wrenches (..., 6, k) from the body's frame to the parent's."""
        # By A^T, with the rate A^T (x' - ad(X nu)^T x), then by the constants.
        y = self._inward(x, lambda x: self.A.mT @ x, lambda y: self._along(-self.ad_X.mT, y))
        return y.map(lambda y: self.Ad_offset.mT @ (self.Ad_turn.mT @ y))

    def points(self, x: Series) -> Series:
        """Transport points from the body's frame to the parent's.

        Points are (..., 4, k). Sums of points with weights, (m r; m), are transported alike.
        """
        return self.B @ self._inward(x, lambda x: self.T @ x, lambda y: self._along(self.X_hat, y))

    def moments(self, x: Series) -> Series:
        """Transport moments of mass from the body's frame to the parent's.

        They are (..., 4, 4).
        """
        # T Pi T^T, with the rate T (Pi' + L Pi + Pi L^T) T^T, L = wedge(X nu).
        y = self._inward(x, lambda x: congruence(self.T, x), lambda y: self._along_both(self.X_hat, y))
        return y.map(lambda y: congruence(self.offset, congruence(self.turn, y)))

    def inertias(self, x: Series) -> Series:
        """Transport symmetric forms of twists from the body to the parent.

        They are (..., 6, 6). Inertia is such a form.
        """
        # A^T I A, with the rate A^T (I' - L^T I - I L) A, L = ad(X nu).
        y = self._inward(x, lambda x: congruence(self.A.mT, x), lambda y: self._along_both(-self.ad_X.mT, y))
        return y.map(lambda y: congruence(self.Ad_offset.mT, congruence(self.Ad_turn.mT, y)))

    def forms(self, x: Series) -> Series:
        """Transport bilinear forms of twists from the body to the parent.

        They are (..., 6, 6).
        """
        y = self._inward(x, lambda x: self.A.mT @ x @ self.A, lambda y: self._along_both(-self.ad_X.mT, y))
        return self.Ad_offset.mT @ (self.Ad_turn.mT @ y @ self.Ad_turn) @ self.Ad_offset

    def _along(self, L: Array, y: Series) -> Series:
        """Return L nu y."""
        return self.rate * (L[0] @ y)

    def _along_both(self, L: Array, y: Series) -> Series:
        """Return L nu y + y (L nu)^T."""
        return self.rate * (L[0] @ y + y @ L[0].mT)

    def _inward(self, x: Series, transported: Callable[[Array], Array], drift: Callable[[Series], Series]) -> Series:
        """Return y = E x, where E and its generator commute: y' = E x' + L nu y."""
        return from_rates(lambda k: transported(x[k]), drift)


class FreeJoint(MovingJoint):
    """One joint of several screws at an instant.

    The screws span a subalgebra, and T is any motion of its group.
    """

    @property
    def motion(self) -> Series:
        return from_rate(self.T, lambda T: T @ self._generator(self.X_hat))

    def screw_rate(self, V: Series) -> Series:
        return V.map(lambda V: -(self.ad_X @ V[..., None, :, :])[..., 0].mT)

    def cross(self, W: Series) -> Series:
        return W.map(lambda W: -(self.ad_X.mT @ W[..., None, :, :])[..., 0].mT)

    def _generator(self, L: Array) -> Series:
        """Return L nu, the sum over the screws: (..., k, 1) to (..., 6, 6) or (..., 4, 4)."""
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
    """Return y = E x with ``y' = E (x' + drift(x))``."""
    # The k-th rate of y is E times the k-th of these: the rates that the outer frame sees, in the axes of the inner
    # one.
    outer_rates = [x]

    def term(k: int) -> Array:
        while len(outer_rates) <= k:
            outer_rates.append(outer_rates[-1].dot + drift(outer_rates[-1]))
        return transported(outer_rates[k][0])

    return Series(term)


@lru_cache(maxsize=64)
def split_placements(m: Mechanism) -> tuple[Array, Array]:
    """Split B = S Z of every joint, with Z about its axis.

    Both are (nb, 4, 4). S is where the body hangs on the parent, Z how far it has turned at theta = 0.
    """
    variables = single_variables(m)
    no_turn = np.eye(4, dtype=int)
    factors = [split_turn(B, m.X[variables[i]]) if i in variables else (B, no_turn) for i, B in enumerate(m.B)]
    S, Z = zip(*factors, strict=True)
    return np.stack(S), np.stack(Z)


@lru_cache(maxsize=64)
def _placements(m: Mechanism) -> list[Placement]:
    """Return the constants of all joints."""
    B, X = split_placements(m)[0], [coordinates.body_screws(m, i) for i in range(m.nb)]
    offset, turn = pose(_I, position(B)), pose(rotation(B), np.zeros((3, 1), dtype=int))
    # B^-1 = turn^-1 offset^-1, in two matrices with more zeros than one.
    constants = B, offset, turn, Ad(inverse(offset)), Ad(inverse(turn)), X
    hats = [ad(X_i.mT) for X_i in X], [wedge(X_i.mT) for X_i in X]
    return [Placement(*data) for data in zip(m.parent, *constants, *hats, strict=True)]


@lru_cache(maxsize=64)
def _turns_and_slides(m: Mechanism) -> tuple[Array, Array]:
    """Return the pure turns and slides that make up all screws.

    They are (nc, 4, 4) each.
    """
    turns, slides = zip(*map(turn_and_slide, m.X), strict=True)
    return np.stack(turns), np.stack(slides)


def joint_transforms(m: Mechanism, theta: Array, bodies: Sequence[int]) -> tuple[dict[int, int], Array]:
    """Return Z exp(X theta) of joints of one screw, and places.

    The motions are (..., joints, 4, 4); places are by body. Only joints of the given bodies count.
    """
    variables = single_variables(m)
    bodies_of_one_screw = [i for i in bodies if i in variables]
    # (..., nc, 1) -> (..., joints, 1, 1): all exponentials at once.
    turns, slides = _turns_and_slides(m)
    columns = np.array([variables[i] for i in bodies_of_one_screw], dtype=int)
    motions = exp_turn_and_slide(turns[columns], slides[columns], theta[..., columns, :, None])
    T = split_placements(m)[1][bodies_of_one_screw] @ motions
    T = restore_integers(T) if is_symbolic(T) else T
    return {i: k for k, i in enumerate(bodies_of_one_screw)}, T


def joints(
    m: Mechanism, q: Series, base: JointMotion | None = None, bodies: Sequence[int] | None = None
) -> list[MovingJoint]:
    """Return the joints of some bodies, or of all, for coordinates q.

    `base` is the motion of a base that floats.
    """
    bodies = range(m.nb) if bodies is None else bodies
    theta, placements = coordinates.joint_variables(m, q), _placements(m)
    # All joints of one screw at once: (..., joints, 4, 4) and (..., joints, 6, 6).
    places, T = joint_transforms(m, theta[0], bodies)
    A = Ad(inverse(T))

    def joint(i: int) -> MovingJoint:
        # Joints of several screws, and a base, have poses of their own.
        if i not in places:
            motion = motion_of_joint(m, i, q, base)
            return FreeJoint(**vars(placements[i]), rate=motion.V, T=motion.pose, A=Ad(inverse(motion.pose)))
        k, [j] = places[i], m.columns[i]
        return MovingJoint(
            **vars(placements[i]), rate=take_rows(theta, j, j + 1).dot, T=T[..., k, :, :], A=A[..., k, :, :]
        )

    return [joint(i) for i in bodies]


def take_rows(columns: Series, first: int, last: int) -> Series:
    """Return the rows from `first` to before `last` of columns."""
    return columns.map(lambda x: x[..., first:last, :])


def batch_zeros(q: Series) -> Series:
    """Return zeros (..., 1, 1) with the batch shape of q.

    Added to a quantity that may not depend on q, they give it that shape.
    """
    return 0 * take_rows(q, 0, 1)
