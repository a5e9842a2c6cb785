"""The same forces by sweeps outward and inward over the tree: O(n), any order, any scalar type.

The K/P form, in frames on the joint axes. A point r of body i has the acceleration a_i + K_i r, in body coordinates,
with a_i that of the frame's origin and ``K = hat(wdot) + hat(w) hat(w)``. With the body's mass m, first moment h and
second moments P, all constant in its frame, its inertia force and moment about the origin are

    f = m a + K h,    n = h x a + axial(K P),

so that rates of f and n take no product rule for the inertia, and no linear velocity occurs at all.

Every function takes coordinates as columns (..., n, 1) and returns a series, computed as far as it is asked for.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache, reduce
from operator import add

import numpy as np

from jounce import inertia
from jounce._scalars import Array, concatenate, cos, is_zero, namespace, sin
from jounce.equivalent import minimal, moves
from jounce.lie import Ad, axial, hat, position, rotation
from jounce.mechanism import Mechanism
from jounce.series import Series, from_rate, joined

_Z = np.eye(3, dtype=int)[:, 2:]
_Z_HAT = hat(_Z[:, 0])


def inverse_dynamics(mechanism: Mechanism, q: Series, W: Series | None = None) -> Series:
    """Q, the generalized forces (EOM1), with wrenches W on the bodies, (..., 6nb, 1)."""
    chain = minimal(mechanism)
    joints = _joints(chain, q)
    w = _angular(joints, [joint.theta.dot for joint in joints])
    K = [(hat_w := w_i.map(_hat)).dot + hat_w @ hat_w for w_i in w]
    slides = [
        joint.d and _Z * joint.d.dot.dot + 2 * (w_i.map(_hat) @ _Z) * joint.d.dot
        for joint, w_i in zip(joints, w, strict=True)
    ]
    a = _linear(joints, Series.constant(-chain.gravity[:, None]), K, slides)
    forces = _inertia_forces(chain, a, K)
    if W is not None:
        loads = _wrenches(mechanism, chain, W)
        forces = [(f + W_f, n + W_n) for (f, n), (W_f, W_n) in zip(forces, loads, strict=True)]
    return _gathered(chain, joints, forces, outward=a)


def gravity_forces(mechanism: Mechanism, q: Series) -> Series:
    """Qgrav: the forces that the acceleration -g of every body's frame takes."""
    chain = minimal(mechanism)
    joints = _joints(chain, q)
    K = [Series.constant(np.zeros((3, 3), dtype=int))] * chain.nb
    a = _linear(joints, Series.constant(-chain.gravity[:, None]), K, [None] * chain.nb)
    return _gathered(chain, joints, _inertia_forces(chain, a, K), outward=a)


def external_forces(mechanism: Mechanism, q: Series, W: Series) -> Series:
    """Qext = J^T W (Qext), which `inverse_dynamics` holds; alone it is a witness."""
    chain = minimal(mechanism)
    return _gathered(chain, _joints(chain, q), _wrenches(mechanism, chain, W), outward=())


def mass_matrix(mechanism: Mechanism, q: Series) -> Series:
    """gM (..., n, n): column j holds the forces that a unit acceleration of coordinate j takes from rest."""
    chain = minimal(mechanism)
    joints = _joints(chain, q)
    batch = (1,) * (q[0].ndim - 2)
    units = [Series.constant(G_i.reshape((chain.n, *batch, 1, 1))) for G_i in chain.G]  # column j on a leading axis
    K = [alpha.map(_hat) for alpha in _angular(joints, units)]
    slides = [joint.d and _Z * joint.pitch * unit for joint, unit in zip(joints, units, strict=True)]
    a = _linear(joints, Series.constant(0 * _Z), K, slides)
    columns = _gathered(chain, joints, _inertia_forces(chain, a, K), outward=a)
    return columns.map(lambda Q: namespace(Q).moveaxis(Q[..., 0], 0, -1))


def _hat(column: Array) -> Array:
    return hat(column[..., 0])


@dataclass(frozen=True)
class _Joint:
    """One joint in motion: it turns by theta about the z axis of its body and slides by d along it."""

    parent: int
    R: Array  # rotation of the body frame in its parent's at theta = 0, and the offset of its origin
    r: Array
    theta: Series
    turn: "_Turn | None"  # None: prismatic
    d: Series | None  # None: revolute
    pitch: Array  # (1,) of the screw; 1 for a prismatic joint

    def inward(self, x: Series) -> Series:
        """Body coordinates of a vector given in the parent's."""
        return self.turn.back(self.R.T @ x) if self.turn else self.R.T @ x

    def outward(self, x: Series) -> Series:
        """Parent's coordinates of a vector given in the body's."""
        return self.R @ (self.turn(x) if self.turn else x)


@dataclass(frozen=True)
class _Turn:
    """The rotation R_z by an angle with this cosine, sine and rate."""

    c: Array
    s: Array
    rate: Series

    def __call__(self, x: Series) -> Series:
        """y = R_z x. Rotate first, then correct, y' = R_z x' + rate e_z x y: rates of R_z never appear."""
        x_0, x_1, x_2 = (x[0][..., i : i + 1, :] for i in range(3))
        y = concatenate([self.c * x_0 - self.s * x_1, self.s * x_0 + self.c * x_1, x_2], axis=-2)
        return from_rate(y, lambda y: self(x.dot) + self.rate * (_Z_HAT @ y))

    def back(self, y: Series) -> Series:
        """x = R_z^T y."""
        return _Turn(self.c, -self.s, -self.rate)(y)


def _joints(chain: Mechanism, q: Series) -> list[_Joint]:
    joints = []
    for i, (B, X, p) in enumerate(zip(chain.B, chain.X, chain.parent, strict=True)):
        theta = chain.G[i : i + 1] @ q + chain.g[i : i + 1]
        turn = None if is_zero(X[2]) else _Turn(cos(theta[0]), sin(theta[0]), theta.dot)
        d = None if is_zero(X[5]) else theta * X[5:]
        joints.append(_Joint(p, rotation(B), position(B), theta, turn, d, pitch=X[5:]))
    return joints


def _angular(joints: Sequence[_Joint], rates: Sequence[Series]) -> list[Series]:
    """Angular velocities (or accelerations) of the bodies, in body coordinates, from those of the joints."""
    w: list[Series] = []
    for joint, rate in zip(joints, rates, strict=True):
        own = _Z * rate if joint.turn else Series.constant(0 * _Z)
        w.append(own if joint.parent < 0 else joint.inward(w[joint.parent]) + own)
    return w


def _linear(
    joints: Sequence[_Joint], ground: Series, K: Sequence[Series], slides: Sequence[Series | None]
) -> list[Series]:
    """Accelerations of the frames' origins, in body coordinates: carried by the parent, and along the slide."""
    a: list[Series] = []
    for joint, K_i, slide in zip(joints, K, slides, strict=True):
        p = joint.parent
        a_i = joint.inward(ground if p < 0 else a[p] + K[p] @ joint.r)
        if joint.d is not None:
            a_i = a_i + (K_i @ _Z) * joint.d
        a.append(a_i if slide is None else a_i + slide)
    return a


@lru_cache(maxsize=64)
def _moments(chain: Mechanism) -> list[tuple[Array, Array, Array]]:
    return [inertia.moments(M) for M in chain.M]


def _inertia_forces(chain: Mechanism, a: Sequence[Series], K: Sequence[Series]) -> list[tuple[Series, Series]]:
    forces = []
    for a_i, K_i, (m, h, P) in zip(a, K, _moments(chain), strict=True):
        f = a_i * m + K_i @ h
        n = _hat(h) @ a_i + (K_i @ P).map(lambda T: axial(T)[..., None])
        forces.append((f, n))
    return forces


def _wrenches(old: Mechanism, chain: Mechanism, W: Series) -> list[tuple[Series, Series]]:
    """Forces and moments on the frames of `chain` from wrenches (moment; force) on those of `old`."""
    loads = []
    for i, carry in enumerate(Ad(moves(old, chain)).mT):
        W_i = carry @ _rows(W, 6 * i, 6 * i + 6)
        loads.append((_rows(W_i, 3, 6), _rows(W_i, 0, 3)))
    return loads


def _gathered(
    chain: Mechanism, joints: Sequence[_Joint], forces: Sequence[tuple[Series, Series]], outward: Sequence[Series]
) -> Series:
    """The inward sweep: the forces in the coordinates that balance the forces and moments on the bodies."""
    f, n = (list(x) for x in zip(*forces, strict=True))
    Q: list[Series] = []
    for i in reversed(range(chain.nb)):
        joint, p = joints[i], joints[i].parent
        felt = [_rows(n[i], 2, 3)] if joint.turn else []
        felt += [_rows(f[i], 2, 3) * joint.pitch] if joint.d else []
        Q.append(reduce(add, felt))
        if p >= 0:
            n_i = n[i] if joint.d is None else n[i] + (_Z_HAT @ f[i]) * joint.d
            f_p = joint.outward(f[i])
            f[p], n[p] = f[p] + f_p, n[p] + joint.outward(n_i) + _hat(joint.r) @ f_p
    still = 0 * joints[0].theta  # carries the batch axes, which forces that depend on no angle lack
    Q_theta = joined([Q_i + still for Q_i in reversed(Q)], axis=-2)

    def swept(k: int) -> Array:
        for x in (*outward, *reversed(n)):  # in the order of the sweeps, so that no call nests deeper than one joint
            x[k]
        return chain.G.T @ Q_theta[k]

    return Series(swept)


def _rows(columns: Series, first: int, last: int) -> Series:
    return columns.map(lambda x: x[..., first:last, :])
