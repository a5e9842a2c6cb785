"""Contacts balance a floating robot, and hold components of its motion.

Wrenches and their rates, of a `Stance`. The six rows of the base of Q = A^T f, what no motor drives, must come from the
contacts: with their columns G, (6, k),

    min f^T W f   subject to   G f = Q_0,      f = W^-1 G^T y,   G W^-1 G^T y = Q_0.

Where rows of friction hold with equality, C_a f = 0 joins the constraints. Rates follow by the series of the solution.
Joint torques are those of the motion with the contact wrenches on its bodies (`balance_law`); the base rows are left
with rounding.

Rows ``A nu`` of what contacts hold of the motion of a robot on a tree of single joints, with the time derivatives of A,
from `ContactPaths`. All is seen in inertial axes, about the inertial origin. The twist of the base is U, the joints j
have the rates theta':

    V_j = U + sum of S_i theta_i' over the joints i on the way to joint j, itself included,    S_j' = ad(V_j) S_j,

as a screw S_j is fixed in the body that the joint moves. Of a contact, each component that it holds is a wrench e of
unit force or moment on the ground, and ``e . V`` is that component of the twist V of the contact. A wrench that is
fixed in the contact has the rate ``e' = -ad(V)^T e``. A row of A, by U and by the rates of the coordinates, is

    [e^T, a],    a = [e . S_j, or 0 where joint j is not on the way to the contact] G.

All joints of all contacts are one array: a recursion along the tree takes a step of Python for every joint and order.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import pairwise

import numpy as np

from jounce.core.scalars import Array, concatenate, reciprocal
from jounce.dynamics.recursion import bodies
from jounce.dynamics.recursion.joints import take_rows
from jounce.dynamics.state import BASE_AT_REST, Law, State
from jounce.model.contacts import Contact
from jounce.model.mechanism import Mechanism, ancestors
from jounce.spatial.lie import Ad, ad, hat, inverse, position, rotation
from jounce.spatial.linear import solve_series
from jounce.spatial.series import Series, join_series, product_rate, with_rates

_NO_WRENCH = Series.constant(np.zeros((6, 1), dtype=int))


def balance_law(free: Law) -> Law:
    """Return the law of forces with contacts from that without."""

    def law(m: Mechanism, x: State) -> Series:
        # The motion without contacts says what the base lacks; its forces with the wrenches that supply it are Q.
        stance = Stance(m, x)
        W = stance.body_wrenches(stance.components(free(m, x)))
        return free(m, replace(x, W=W if x.W is None else x.W + W))

    return law


@dataclass(frozen=True, eq=False)
class Stance:
    """The contacts of a robot in a state."""

    m: Mechanism
    x: State

    @cached_property
    def _maps(self) -> list[tuple[Series, Series]]:
        """The maps of contact wrenches to the body and to the base."""
        return list(map(self._wrench_maps, self.m.contacts))

    def _wrench_maps(self, contact: Contact) -> tuple[Series, Series]:
        """Return the maps of contact components to body and base wrenches.

        The maps are (..., 6, held), from components in contact axes. The wrenches are in the axes of the body and of
        the base, about their origins.
        """
        link = self.m.frame(contact.frame)
        # The base at rest: all is seen from the base, whose own motion turns only the axes of the ground.
        pose_base_from_body = bodies.poses(self.m, self.x.q, BASE_AT_REST, link.body)
        R, pose_body_from_contact = pose_base_from_body.map(rotation), link.T @ contact.place
        if contact.ground_axes is None:
            # The contact turns with its body, as the sole of a foot does.
            axes_in_body = Series.constant(rotation(pose_body_from_contact))
            axes_in_base = R @ axes_in_body
        else:
            # The contact keeps the axes of the ground, as a point does.
            axes_in_base = self.x.motion_of_base.H.map(rotation).mT @ contact.ground_axes
            axes_in_body = R.mT @ axes_in_base
        place_in_body = position(pose_body_from_contact)
        place_in_base = pose_base_from_body.map(position) + R @ place_in_body
        on_body = _wrench_map(axes_in_body, Series.constant(place_in_body))
        on_base = _wrench_map(axes_in_base, place_in_base)
        # (..., 6, 6) -> (..., 6, held): other components are zero.
        return on_body.map(lambda E: E[..., contact.held]), on_base.map(lambda E: E[..., contact.held])

    @cached_property
    def G(self) -> Series:
        """G, (..., 6, k): the wrenches on the base of unit components that the contacts transmit."""
        return join_series([on_base for _, on_base in self._maps], axis=-1)

    def components(self, Q: Series) -> Series:
        """Return f from the forces Q of the motion without contacts.

        f is (..., k, 1), Q is (..., nv).
        """
        weighted_rows, y = self._solution(Q)
        return weighted_rows @ y

    def margins(self, Q: Series) -> Series:
        """Return how far limits are from a switch, which is at zero.

        The shape is (..., r, 1). It is -C f of limits that are not active, which is the slack, and the multiplier of
        active ones.
        """
        weighted_rows, y = self._solution(Q)
        active = np.asarray(self.x.active)[..., None]
        C_f = limit_rows(self.m.contacts) @ (weighted_rows @ y)
        return (active - 1) * C_f - active * y.map(lambda y: y[..., 6:, :])

    def _solution(self, Q: Series) -> tuple[Series, Series]:
        """Return W^-1 E^T and y, with f = W^-1 E^T y.

        E has the rows of G and of active limits. The y solve E W^-1 E^T y = (Q_0; 0).
        """
        E_T, right_side, added_diagonal = self.G.mT, Q.map(lambda Q: Q[..., :6, None]), 0
        weights = concatenate([contact.weights[contact.held] for contact in self.m.contacts], axis=-1)
        active, presence = self.x.active, self.x.presence
        if active is not None:
            # Active limits join the constraints as rows C_a f = 0. The number of rows is the same for all samples of
            # a batch, 6 + r: rows of limits that are not active are zero, and a 1 on the diagonal makes their y zero.
            C = limit_rows(self.m.contacts)
            E_T = join_series([E_T, Series.constant((active[..., None] * C).mT)], axis=-1)
            right_side = right_side.map(lambda F: concatenate([F, 0 * F[..., :1, :] + np.zeros((len(C), 1))], axis=-2))
            inactive = concatenate([np.zeros(6), 1 - active], axis=-1)
            added_diagonal = inactive[..., None] * np.eye(6 + len(C))
        weighted_rows = reciprocal(weights)[:, None] * E_T
        if presence is not None:
            # Contacts that fade in or out have inverse weights between 0 and 1 times their own, per component:
            # (..., contacts) -> (..., k, 1). A robot without any contact gets ones on the diagonal: f is 0 whatever
            # y is.
            sizes = [len(contact.held) for contact in self.m.contacts]
            weighted_rows = presence.map(lambda p: np.repeat(p, sizes, axis=-1)[..., None]) * weighted_rows
            flies = (presence[0].max(axis=-1) <= 0)[..., None, None]
            added_diagonal = added_diagonal + flies * np.eye(E_T[0].shape[-1])
        return weighted_rows, solve_series(E_T.mT @ weighted_rows + added_diagonal, right_side)

    def body_wrenches(self, f: Series) -> Series:
        """Return the wrenches that the bodies exert on the ground.

        They are W, (..., 6nb, 1).
        """
        total = dict.fromkeys(range(self.m.nb), _NO_WRENCH)
        for contact, (on_body, _), part in zip(self.m.contacts, self._maps, self._split(f), strict=True):
            total[self.m.frame(contact.frame).body] -= on_body @ part
        return join_series(list(total.values()), axis=-2)

    def wrenches(self, f: Series) -> Series:
        """Return the wrenches in contact axes, (..., contacts, 6)."""
        unit = np.eye(6, dtype=int)
        parts = zip(self.m.contacts, self._split(f), strict=True)
        return join_series([(unit[:, contact.held] @ part).mT for contact, part in parts], axis=-2)

    def _split(self, f: Series) -> list[Series]:
        """Split components (..., k, 1) into those of each contact."""
        ends = np.cumsum([0, *(len(contact.held) for contact in self.m.contacts)]).tolist()
        return [take_rows(f, first, last) for first, last in pairwise(ends)]


def _wrench_map(R: Series, r: Series) -> Series:
    """Return the map of wrenches in axes R about a point r.

    It is ``[[R, r~ R], [0, R]]``, (..., 6, 6).
    """
    upper = join_series([R, r.map(lambda r: hat(r[..., 0])) @ R], axis=-1)
    return join_series([upper, join_series([0 * R, R], axis=-1)], axis=-2)


def limit_rows(contacts: Sequence[Contact]) -> Array:
    """Return C of the limits ``C f <= 0`` of all contacts.

    C is (r, k).
    """
    from scipy.linalg import block_diag  # imported here to keep start-up fast

    return block_diag(*(contact.limits[:, contact.held] for contact in contacts))


@dataclass(frozen=True, eq=False)
class ContactPaths:
    """The contacts of a robot and the joints that move them.

    There are c contacts, k components that they hold, and m joints.
    """

    bodies: list[int]  # that the contacts are on
    places: np.ndarray  # (c, 4, 4), in the frames of these bodies
    contact: list[int]  # of each component
    component: list[int]  # of a twist of the contact
    owners: list[int]  # the bodies that the joints move
    X: np.ndarray  # (m, 6, 1), the screws of the joints in the frames of these bodies
    G: np.ndarray  # (m, n), the rates of the joints by those of the coordinates
    carries: np.ndarray  # (m, m), 1.0 where joint j is on the way to joint i
    moves: np.ndarray  # (k, m), 1.0 where joint j is on the way to the contact of a component

    def poses(self, H: Array) -> Array:
        """Return the poses of the contacts from those of all bodies.

        The shapes are (..., c, 4, 4) and (..., nb, 4, 4).
        """
        return H[..., self.bodies, :, :] @ self.places

    def wrenches(self, poses: Array) -> Array:
        """Return e of contacts at given poses.

        e is (..., k, 6, 1), poses are (..., c, 4, 4).
        """
        # The rows of Ad(C^-1) take components of twists in contact axes: as wrenches, they are the e.
        return Ad(inverse(poses))[..., self.contact, self.component, :][..., None]

    def screws(self, H: Array) -> Array:
        """Return S from the poses of all bodies.

        S is (..., m, 6, 1), poses are (..., nb, 4, 4).
        """
        return Ad(H[..., self.owners, :, :]) @ self.X

    def twists(self, S: np.ndarray, qd: np.ndarray, k: int) -> np.ndarray:
        """Return the k-th rates of ``S theta'``, the twists that joints add.

        The shape is (..., m, 6). S and qd, (..., n, 1), come with their rates up to k, stacked along the first axis.
        """
        return product_rate(S, (self.G @ qd)[..., None], k)[..., 0]

    def columns(self, products: np.ndarray) -> np.ndarray:
        """Return a from the products e . S.

        a is (..., k, n), the products are (..., k, m).
        """
        return (products * self.moves) @ self.G

    def rows_at_rest(self, S: np.ndarray, e: np.ndarray, qd: np.ndarray) -> np.ndarray:
        """Return A with its rates where the base rests.

        The shape is (order + 1, ..., k, 6 + n). qd comes with order - 1 rates.
        """
        order, m = len(qd), len(self.owners)
        screws, wrenches = with_rates(S, order), with_rates(e, order)
        # ad(V) of the joints and of the contacts, with rates: V is the sum of S theta' over the joints on the way.
        turns = np.empty((order, *S.shape[:-3], m + len(self.moves), 6, 6))
        paths = np.concatenate([self.carries, self.moves])
        for k in range(order):
            # The k-th rates of V take those of S, which the previous round computed; they give rate k + 1 of S and e.
            turns[k] = ad(paths @ self.twists(screws, qd, k))
            screws[k + 1] = product_rate(turns[..., :m, :, :], screws, k)
            wrenches[k + 1] = -product_rate(turns[..., m:, :, :].mT, wrenches, k)
        # (order + 1, ..., k, 6) @ (order + 1, ..., 6, m): all products e . S with their rates.
        e, S = wrenches[..., 0], screws[..., 0]
        products = np.stack([product_rate(e, S.mT, k) for k in range(order + 1)])
        return np.concatenate([e, self.columns(products)], axis=-1)


@lru_cache(maxsize=64)
def contact_paths(m: Mechanism) -> ContactPaths:
    """Return the contacts of a robot and the joints that move them."""
    links, carriers = [m.frame(contact.frame) for contact in m.contacts], ancestors(m).astype(float)
    bodies = [link.body for link in links]
    # Components of all contacts, one after the other, each with the number of its contact.
    components = [(i, component) for i, contact in enumerate(m.contacts) for component in contact.held]
    # Only joints that move a body with a contact are on the way to one.
    joints = [j for j, owner in enumerate(m.owners) if carriers[bodies, owner].any()]
    owners = [m.owners[j] for j in joints]
    return ContactPaths(
        bodies=bodies,
        places=np.stack([link.T @ contact.place for link, contact in zip(links, m.contacts, strict=True)]),
        contact=[i for i, _ in components],
        component=[component for _, component in components],
        owners=owners,
        X=m.X[joints][..., None],
        G=m.G[joints],
        carries=carriers[np.ix_(owners, owners)],
        moves=carriers[np.ix_([bodies[i] for i, _ in components], owners)],
    )
