"""Section 2 of the paper, written once over time series; Sections 3 and 4, and any higher order, follow by Leibniz.

The system matrices are dense, 6nb rows: the form to read and to prove with. `recursion` is the form to compute with.
"""

from dataclasses import dataclass

import numpy as np

from jounce._scalars import Array
from jounce.dynamics import system
from jounce.model.mechanism import Mechanism
from jounce.spatial.lie import wedge
from jounce.spatial.series import Series, from_rate


@dataclass(frozen=True)
class ClosedForm:
    """The equations of motion along q(t); the terms of every series are computed on demand."""

    H: Series  # (..., nb, 4, 4) poses of the bodies
    A: Series  # (..., 6nb, 6nb)
    J: Series  # (..., 6nb, n) system Jacobian
    V: Series  # (..., 6nb, 1) system twist, body-fixed
    b: Series  # (..., 6nb, 6nb)
    UG: Series  # (..., 6nb, 1) acceleration of the ground that replaces gravity, seen from the bodies
    gM: Series  # (..., n, n) generalized mass matrix
    gC: Series  # (..., n, n) generalized Coriolis matrix of the paper
    gCbar: Series  # (..., n, n) the one for which gM' - 2 gCbar is skew
    Qgrav: Series  # (..., n, 1)
    Qext: Series  # (..., n, 1), zero without wrenches
    Q: Series  # (..., n, 1) generalized forces
    h: Series  # (..., 6, 1) spatial momentum about the inertial origin
    F: Series  # (..., 6, 1) wrench that the ground exerts on the mechanism, about the inertial origin
    p: Series  # (..., n, 1) generalized momentum
    U: Series  # (..., 1, 1) potential energy


def closed_form(mechanism: Mechanism, q: Series, W: Series | None = None) -> ClosedForm:
    """The equations of motion for coordinates q, columns (..., n, 1), and wrenches W on the bodies, (..., 6nb, 1)."""
    X, M, g = system.system_X(mechanism), system.system_M(mechanism), system.system_gravity(mechanism)
    C0 = system.poses(mechanism, q[0])
    qd = q.dot
    a = qd.map(lambda v: system.system_a(mechanism, v))  # (a)
    A = from_rate(system.system_A(mechanism, C0), lambda A: (Aa := A @ a) - Aa @ A)  # (Adot)
    Aa = A @ a
    J = A @ X  # (JbSys)
    V = J @ qd  # (Vsys)
    b = V.map(system.system_b)  # (b)
    U = from_rate(system.system_U(C0), lambda U: -(Aa @ U))  # (eq_U), Udot = -A a U
    UG = U @ g
    C = -(M @ Aa) - b.mT @ M  # (Csys)
    JT = J.mT
    gM = JT @ (M @ J)  # (MC)
    gC = JT @ C @ J  # (MC)
    gCbar = JT @ (C + M @ b) @ J  # (Cbar)
    Qgrav = JT @ (M @ UG)
    Qext = 0 * Qgrav if W is None else JT @ W  # (Qext)
    Q = gM @ qd.dot + gC @ qd + Qgrav + Qext  # (EOM1)
    UT = U.mT
    h = UT @ (M @ V)
    F = h.dot + UT @ (M @ UG)  # Newton and Euler: the momentum changes by the ground, by gravity and by loads -W
    F = F if W is None else F + UT @ W
    H = from_rate(C0, lambda H: H @ by_body(V).map(lambda v: wedge(v[..., 0])))
    p = gM @ qd
    power = qd.mT @ Qgrav
    U = from_rate(system.potential_energy(mechanism, C0), lambda _: power)
    motion = {"H": H, "A": A, "J": J, "V": V, "b": b, "UG": UG, "h": h, "p": p, "U": U}
    return ClosedForm(**motion, gM=gM, gC=gC, gCbar=gCbar, Qgrav=Qgrav, Qext=Qext, Q=Q, F=F)


def by_body(x: Series) -> Series:
    """System rows (..., 6nb, k) as those of each body, (..., nb, 6, k)."""
    return x.map(lambda a: a.reshape((*a.shape[:-2], a.shape[-2] // 6, 6, a.shape[-1])))


def poses(mechanism: Mechanism, q: Series, body: int | None) -> Series:
    """H of all bodies (..., nb, 4, 4), of one (..., 4, 4), or of the ground, -1."""
    return _of_body(closed_form(mechanism, q).H, body, ground=np.eye(4, dtype=int))


def twists(mechanism: Mechanism, q: Series, body: int | None) -> Series:
    """V of all bodies (..., nb, 6, 1), of one (..., 6, 1), or of the ground, -1."""
    return _of_body(by_body(closed_form(mechanism, q).V), body, ground=np.zeros((6, 1), dtype=int))


def jacobians(mechanism: Mechanism, q: Series, body: int | None) -> Series:
    """J of all bodies (..., nb, 6, n), of one (..., 6, n), or of the ground, -1."""
    return _of_body(by_body(closed_form(mechanism, q).J), body, ground=np.zeros((6, mechanism.n), dtype=int))


def _of_body(x: Series, body: int | None, ground: Array) -> Series:
    if body is None:
        return x
    return 0 * x.map(lambda a: a[..., 0, :, :]) + ground if body < 0 else x.map(lambda a: a[..., body, :, :])
