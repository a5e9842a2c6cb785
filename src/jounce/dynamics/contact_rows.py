"""What contacts hold of the motion of a robot on a tree of single joints, ``A nu``, with the time derivatives of A.

All is seen in inertial axes, about the inertial origin. The twist of the base is U, the joints j have the rates theta':

    V_j = U + sum of S_i theta_i' over the joints i on the way to joint j, itself included,    S_j' = ad(V_j) S_j,

as a screw S_j is fixed in the body that the joint moves. Of a contact, each component that it holds is a wrench e of
unit force or moment on the ground, and ``e . V`` is that component of the twist V of the contact. A wrench that is
fixed in the contact has the rate ``e' = -ad(V)^T e``. A row of A, by U and by the rates of the coordinates, is

    [e^T, a],    a = [e . S_j, or 0 where joint j is not on the way to the contact] G.

All joints of all contacts are one array: a recursion along the tree takes a step of Python for every joint and order.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from jounce.core.scalars import Array
from jounce.model.mechanism import Mechanism, ancestors
from jounce.spatial.lie import Ad, ad, inverse
from jounce.spatial.series import product_rate, with_rates


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
