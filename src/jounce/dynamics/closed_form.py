"""Section 2 of the paper, written once over time series; Sections 3 and 4, and any higher order, follow by Leibniz.

The system matrices are dense, 6nb rows: the form to read and to prove with. `recursion` is the form to compute with.
"""

from dataclasses import dataclass

from jounce._scalars import Array
from jounce.dynamics import system
from jounce.model.mechanism import Mechanism
from jounce.spatial.series import Series, from_rate


@dataclass(frozen=True)
class ClosedForm:
    """The equations of motion along q(t); every series is computed as far as it is asked for."""

    poses: Array  # (..., nb, 4, 4) of the bodies, C_i at the instant itself
    J: Series  # (..., 6nb, n) system Jacobian
    V: Series  # (..., 6nb, 1) system twist, body-fixed
    gM: Series  # (..., n, n) generalized mass matrix
    gC: Series  # (..., n, n) generalized Coriolis matrix of the paper
    gCbar: Series  # (..., n, n) the one for which gM' - 2 gCbar is skew
    Qgrav: Series  # (..., n, 1)
    Qext: Series  # (..., n, 1), zero without wrenches
    Q: Series  # (..., n, 1) generalized forces
    h: Series  # (..., 6, 1) spatial momentum about the inertial origin
    F: Series  # (..., 6, 1) wrench that the ground exerts on the mechanism, about the inertial origin


def closed_form(mechanism: Mechanism, q: Series, W: Series | None = None) -> ClosedForm:
    """The equations of motion for coordinates q, columns (..., n, 1), and wrenches W on the bodies, (..., 6nb, 1)."""
    X, M, G = system.system_X(mechanism), system.system_M(mechanism), system.system_G(mechanism)
    C0 = system.poses(mechanism, q[0])
    qd = q.dot
    a = qd.map(lambda v: system.system_a(mechanism, v))  # (a)
    A = from_rate(system.system_A(mechanism, C0), lambda A: (Aa := A @ a) - Aa @ A)  # (Adot)
    Aa = A @ a
    J = A @ X  # (JbSys)
    V = J @ qd  # (Vsys)
    b = V.map(system.system_b)  # (b)
    U = from_rate(system.system_U(C0), lambda U: -(Aa @ U))  # (eq_U), Udot = -A a U
    UG = U @ G
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
    return ClosedForm(poses=C0, J=J, V=V, gM=gM, gC=gC, gCbar=gCbar, Qgrav=Qgrav, Qext=Qext, Q=Q, h=h, F=F)
