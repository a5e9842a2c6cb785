"""Contacts balance a floating robot by their wrenches, and hold components of its motion.

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
    """The law of forces with contacts from that of the same motion without."""

    def law(m: Mechanism, x: State) -> Series:
        stance = Stance(m, x)
        W = stance.exerted(stance.components(free(m, x)))
        return free(m, replace(x, W=W if x.W is None else x.W + W))

    return law


@dataclass(frozen=True, eq=False)
class Stance:
    """The contacts of a robot in a state."""

    m: Mechanism
    x: State

    @cached_property
    def _maps(self) -> list[tuple[Series, Series]]:
        """What the wrench of each contact is on its body, and on the base, in their axes about their origins."""
        return list(map(self._wrench_maps, self.m.contacts))

    def _wrench_maps(self, contact: Contact) -> tuple[Series, Series]:
        link = self.m.frame(contact.frame)
        H = bodies.poses(self.m, self.x.q, BASE_AT_REST, link.body)  # seen from the base
        R, T = H.map(rotation), link.T @ contact.place
        if contact.ground_axes is None:
            on_body = Series.constant(rotation(T))
            on_base = R @ on_body
        else:
            on_base = self.x.motion_of_base.H.map(rotation).mT @ contact.ground_axes
            on_body = R.mT @ on_base
        places = Series.constant(position(T)), H.map(position) + R @ position(T)
        own, seen = (_wrench_map(turn, r) for turn, r in zip((on_body, on_base), places, strict=True))
        return own.map(lambda E: E[..., contact.held]), seen.map(lambda E: E[..., contact.held])

    @cached_property
    def G(self) -> Series:
        """(..., 6, k): the wrench on the base of each component that the contacts transmit."""
        return join_series([on_base for _, on_base in self._maps], axis=-1)

    def components(self, Q: Series) -> Series:
        """f, (..., k, 1), where the motion without contacts takes forces Q, (..., nv)."""
        along, y = self._solution(Q)
        return along @ y

    def margins(self, Q: Series) -> Series:
        """(..., r, 1): -C f of limits that are not active, multipliers of those that are; one is 0 at a switch."""
        along, y = self._solution(Q)
        active = np.asarray(self.x.active)[..., None]
        return (active - 1) * (limit_rows(self.m.contacts) @ (along @ y)) - active * y.map(lambda y: y[..., 6:, :])

    def _solution(self, Q: Series) -> tuple[Series, Series]:
        """W^-1 E^T and y of f = W^-1 E^T y, with the rows of G and of the active limits in E."""
        unknown, given, missing = self.G.mT, Q.map(lambda Q: Q[..., :6, None]), 0
        weights = concatenate([contact.weights[contact.held] for contact in self.m.contacts], axis=-1)
        if (active := self.x.active) is not None:
            C = limit_rows(self.m.contacts)
            unknown = join_series([unknown, Series.constant((active[..., None] * C).mT)], axis=-1)
            given = given.map(lambda F: concatenate([F, 0 * F[..., :1, :] + np.zeros((len(C), 1))], axis=-2))
            left = concatenate([np.zeros(6), 1 - active], axis=-1)
            missing = left[..., None] * np.eye(6 + len(C))  # y = 0 of rows that are not active
        along = reciprocal(weights)[:, None] * unknown
        if (presence := self.x.presence) is not None:
            sizes = [len(contact.held) for contact in self.m.contacts]
            along = presence.map(lambda p: np.repeat(p, sizes, axis=-1)[..., None]) * along
            flies = (presence[0].max(axis=-1) <= 0)[..., None, None]
            missing = missing + flies * np.eye(unknown[0].shape[-1])  # any y: f is 0
        return along, solve_series(unknown.mT @ along + missing, given)

    def exerted(self, f: Series) -> Series:
        """W, (..., 6nb, 1): what the bodies exert on the ground."""
        total = dict.fromkeys(range(self.m.nb), _NO_WRENCH)
        for contact, (on_body, _), part in zip(self.m.contacts, self._maps, self._split(f), strict=True):
            total[self.m.frame(contact.frame).body] -= on_body @ part
        return join_series(list(total.values()), axis=-2)

    def wrenches(self, f: Series) -> Series:
        """(..., contacts, 6): the wrenches in contact axes."""
        unit = np.eye(6, dtype=int)
        parts = zip(self.m.contacts, self._split(f), strict=True)
        return join_series([(unit[:, contact.held] @ part).mT for contact, part in parts], axis=-2)

    def _split(self, f: Series) -> list[Series]:
        ends = np.cumsum([0, *(len(contact.held) for contact in self.m.contacts)]).tolist()
        return [take_rows(f, first, last) for first, last in pairwise(ends)]


def _wrench_map(turn: Series, r: Series) -> Series:
    """``[[R, r~ R], [0, R]]``, (..., 6, 6), of wrenches in axes R about a point r."""
    upper = join_series([turn, r.map(lambda r: hat(r[..., 0])) @ turn], axis=-1)
    return join_series([upper, join_series([0 * turn, turn], axis=-1)], axis=-2)


def limit_rows(contacts: Sequence[Contact]) -> Array:
    """C, (r, k): limits ``C f <= 0`` of all contacts in the components that they transmit."""
    from scipy.linalg import block_diag  # imported here to keep start-up fast

    return block_diag(*(contact.limits[:, contact.held] for contact in contacts))


@dataclass(frozen=True, eq=False)
class ContactPaths:
    """The c contacts of a robot, the k components that they hold, and the m joints on the way to them."""

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
        """The poses (..., c, 4, 4) of the contacts from those of all bodies (..., nb, 4, 4)."""
        return H[..., self.bodies, :, :] @ self.places

    def wrenches(self, poses: Array) -> Array:
        """e, (..., k, 6, 1), of contacts at poses (..., c, 4, 4)."""
        return Ad(inverse(poses))[..., self.contact, self.component, :][..., None]

    def screws(self, H: Array) -> Array:
        """S, (..., m, 6, 1), from the poses of all bodies (..., nb, 4, 4)."""
        return Ad(H[..., self.owners, :, :]) @ self.X

    def twists(self, S: np.ndarray, qd: np.ndarray, k: int) -> np.ndarray:
        """The k-th rates of the parts ``S theta'`` of twists that joints add, (..., m, 6).

        S and qd, (..., n, 1), come with their rates up to k, stacked along the first axis.
        """
        return product_rate(S, (self.G @ qd)[..., None], k)[..., 0]

    def columns(self, products: np.ndarray) -> np.ndarray:
        """a, (..., k, n), from the products e . S of all components and joints, (..., k, m)."""
        return (products * self.moves) @ self.G

    def rows_at_rest(self, S: np.ndarray, e: np.ndarray, qd: np.ndarray) -> np.ndarray:
        """A with its rates, stacked (order + 1, ..., k, 6 + n), where the base rests and qd has order - 1 rates."""
        order, m = len(qd), len(self.owners)
        screws, wrenches = with_rates(S, order), with_rates(e, order)
        turns = np.empty((order, *S.shape[:-3], m + len(self.moves), 6, 6))
        ways = np.concatenate([self.carries, self.moves])  # to joints, then to contacts
        for k in range(order):
            turns[k] = ad(ways @ self.twists(screws, qd, k))
            screws[k + 1] = product_rate(turns[..., :m, :, :], screws, k)
            wrenches[k + 1] = -product_rate(turns[..., m:, :, :].mT, wrenches, k)
        e, S = wrenches[..., 0], screws[..., 0]
        products = np.stack([product_rate(e, S.mT, k) for k in range(order + 1)])
        return np.concatenate([e, self.columns(products)], axis=-1)


@lru_cache(maxsize=64)
def contact_paths(m: Mechanism) -> ContactPaths:
    """The contacts of a robot and the joints on the way to them."""
    links, carriers = [m.frame(contact.frame) for contact in m.contacts], ancestors(m).astype(float)
    bodies = [link.body for link in links]
    held = [(i, component) for i, contact in enumerate(m.contacts) for component in contact.held]
    joints = [j for j, owner in enumerate(m.owners) if carriers[bodies, owner].any()]
    owners = [m.owners[j] for j in joints]
    return ContactPaths(
        bodies=bodies,
        places=np.stack([link.T @ contact.place for link, contact in zip(links, m.contacts, strict=True)]),
        contact=[i for i, _ in held],
        component=[component for _, component in held],
        owners=owners,
        X=m.X[joints][..., None],
        G=m.G[joints],
        carries=carriers[np.ix_(owners, owners)],
        moves=carriers[np.ix_([bodies[i] for i, _ in held], owners)],
    )
