"""An oracle of forces at joints of several screws: jets of momenta in the inertial frame.

Everything is a Taylor polynomial in time: positions of joints follow from their velocities by H' = H wedge(X nu), poses
by products, momenta of the bodies from these; forces are rates of momenta in space, and each joint takes the part along
its screws. No rate is ever written down.

Shares with jounce: the model, whose screws and inertias it takes, and the poses from which a motion begins.
"""

from math import factorial

import numpy as np

import jounce
from jounce.model.mechanism import Mechanism
from jounce.spatial.lie import inverse, wedge


def _product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The product of matrices that are polynomials, coefficients first."""
    return np.stack([sum(a[j] @ b[k - j] for j in range(k + 1)) for k in range(min(len(a), len(b)))])


def _inverse(H: np.ndarray) -> np.ndarray:
    """The inverse of poses that are polynomials."""
    R, r = H[:, :3, :3].swapaxes(-1, -2), H[:, :3, 3:]
    return np.concatenate([np.concatenate([R, -_product(R, r)], axis=2), H[:, 3:]], axis=1)


def _derivative(a: np.ndarray) -> np.ndarray:
    return a[1:] * np.arange(1, len(a)).reshape(-1, *[1] * (a.ndim - 1))


def _adjoint(H: np.ndarray) -> np.ndarray:
    """Ad of poses that are polynomials."""
    R, r = H[:, :3, :3], wedge(np.concatenate([H[:, :3, 3], 0 * H[:, :3, 3]], axis=1))[:, :3, :3]
    return np.concatenate([np.concatenate([R, 0 * R], axis=2), np.concatenate([_product(r, R), R], axis=2)], axis=1)


def forces_by_jets(m: Mechanism, start: list[np.ndarray], rates: list[np.ndarray], order: int) -> np.ndarray:
    """Q, Qd, ... (order + 1, nv) of a tree whose joints begin at poses `start`, with nu, nu', ... (nv,) each.

    As many rates as order + 2 are given, those of a base that floats first.
    """
    count = order + 3
    nu = np.stack([np.asarray(x, dtype=np.longdouble) / factorial(k) for k, x in enumerate(rates)])
    columns = [list(range(6))] if m.floats else []
    columns += [[6 * m.floats + j for j in own] for own in m.columns if own]
    X = [np.eye(6)] if m.floats else []
    X += [m.X[list(own)].T for own in m.columns if own]
    C: list[np.ndarray] = []
    for i, p in enumerate(m.parent):
        H = [np.asarray(start[i], dtype=np.longdouble)]
        twist = [wedge(X[i] @ x[columns[i]]) for x in nu]
        for k in range(count - 1):  # (k + 1) H_(k + 1) = sum of H_j wedge(X nu)_(k - j)
            H.append(sum(H[j] @ twist[k - j] for j in range(k + 1)) / (k + 1))
        moved = m.B[i] @ np.stack(H)
        C.append(moved if p < 0 else _product(C[p], moved))
    on = []
    for i in range(m.nb):
        from_space = _adjoint(_inverse(C[i]))
        V = _product(_inverse(C[i]), _derivative(C[i]))  # C^-1 C'
        twist = np.stack([[x[2, 1], x[0, 2], x[1, 0], *x[:3, 3]] for x in V])[..., None]
        momentum = _product(from_space.swapaxes(-1, -2), m.M[i] @ twist)  # about the inertial origin
        mass, first = m.M[i][3, 3], m.M[i][[2, 0, 1], [4, 5, 3]]
        place = (C[i] @ np.append(first, mass))[:, :3]
        weight = np.concatenate([np.cross(place, m.gravity), np.outer(mass * np.eye(len(place))[0], m.gravity)], axis=1)
        on.append(_derivative(momentum)[: order + 1, :, 0] - weight[: order + 1])
    Q = np.zeros((order + 1, m.nv), dtype=np.longdouble)
    for i in reversed(range(m.nb)):
        screws = _adjoint(C[i]) @ X[i]
        Q[:, columns[i]] = _product(screws.swapaxes(-1, -2), on[i][..., None])[..., 0]
        if m.parent[i] >= 0:
            on[m.parent[i]] = on[m.parent[i]] + on[i]
    return Q * np.array([factorial(k) for k in range(order + 1)])[:, None]


def start_of(m: Mechanism, q: np.ndarray, base: np.ndarray | None = None) -> list[np.ndarray]:
    """Where joints have moved their bodies at q, by the kinematics of jounce: B_i^-1 C_p^-1 C_i."""
    robot = jounce.Robot(m)
    C = np.asarray(robot.poses(q, base=base) if base is not None else robot.poses(q))
    carriers = [np.eye(4) if p < 0 else C[p] for p in m.parent]
    return [inverse(B) @ inverse(carrier) @ C_i for B, carrier, C_i in zip(m.B, carriers, C, strict=True)]
