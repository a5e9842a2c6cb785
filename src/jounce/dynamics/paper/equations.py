"""The equations of motion and their two time derivatives, assembled from the matrices of Sections 3 and 4.

They are printed for joints of one screw, of which a X = 0. They hold for all others in velocities nu_p = T nu of which
``T' = T alpha`` and T = 1 at the instant, with alpha of `dynamics.state.turning`. The laws take them to the
velocities nu of the mechanism: Q = T^T Q_p, M = T^T M_p T, and, as nu_p' = T nu' + T' nu, C = T^T (C_p T + M_p T').
"""

from collections.abc import Callable, Sequence
from functools import cached_property

import numpy as np

from jounce.core.errors import JounceError
from jounce.core.scalars import Array, concatenate
from jounce.dynamics import system
from jounce.dynamics.paper.section3 import C11, M1, C
from jounce.dynamics.paper.section4 import C21, M21
from jounce.dynamics.state import BASE_AT_REST, JointMotion, State, add_moving_ground, velocity_drift
from jounce.model.mechanism import Mechanism, ancestors
from jounce.spatial.series import Series, from_rate, join_series


class Paper:
    """The equations of motion at one instant, from coordinates q and wrenches W: values and two time derivatives."""

    def __init__(self, m: Mechanism, q: Series, W: Series | None = None, base: JointMotion | None = None):
        self.mechanism, self.W, self.base = m, W, base
        self.X, self.M = system.build_system(m).X, system.build_system(m).M
        self.nu = join_series([(base or BASE_AT_REST).V, q.dot], axis=-2) if m.floats else q.dot
        alpha = velocity_drift(m, q, base)
        self.T = None if alpha is None else from_rate(np.eye(m.nv, dtype=int), lambda T: T @ alpha)
        nu_p = self.nu if self.T is None else self.T @ self.nu
        self.q = Series(lambda k: nu_p[k - 1] if k else q[0])

    @cached_property
    def A(self) -> Array:
        return system.system_A(ancestors(self.mechanism), self.poses)

    @cached_property
    def poses(self) -> Array:
        return system.poses(self.mechanism, self.q, self.base)

    @cached_property
    def J(self) -> Array:
        return self.A @ self.X  # (JbSys)

    @cached_property
    def UG(self) -> Array:
        return system.system_U(self.poses) @ system.system_gravity(self.mechanism)  # (eq_U)

    def a(self, k: int = 0) -> Array:
        """The k-th time derivative of a, itself with that of the joints' own velocities in the place of qd."""
        return system.system_a(self.X, self.nu[k])  # (a)

    def b(self, k: int = 0) -> Array:
        """The k-th time derivative of b."""
        return system.system_b((self.V, self.dV, self.d2V)[k]())  # (b)

    def V(self) -> Array:
        return self.J @ self.q[1]  # (Vsys)

    def dV(self) -> Array:
        return self.J @ self.q[2] - self.A @ self.a() @ self.V()  # (VbdotMat)

    def d2V(self) -> Array:
        """Used by (CSys2dot), (C21), (C22), but not printed."""
        A, a, da = self.A, self.a(), self.a(1)
        return self.J @ self.q[3] - A @ da @ self.V() - 2 * A @ a @ self.dV() - A @ a @ a @ self.V()

    def _project(self, right: Array) -> Series:
        """J^T M^(k) right, k = 0, 1, 2."""
        M, A, a, JT = self.M, self.A, self.a, self.J.mT
        return _printed_series([
            lambda: JT @ M @ right,
            lambda: JT @ M1(M, A, a()) @ right,
            lambda: JT @ M21(M, A, a(), a(1)) @ right,
        ])  # fmt: skip

    @cached_property
    def gM(self) -> Series:
        return self._project(self.J)  # (MC), (Mdot), (Mddot)

    @cached_property
    def gC(self) -> Series:
        M, A, a, b = self.M, self.A, self.a, self.b
        return _printed_series([
            lambda: self.J.mT @ C(M, A, a(), b()) @ self.J,  # (MC)
            lambda: self.J.mT @ C11(M, A, a(), a(1), b(), b(1)) @ self.J,  # (Cdot)
            lambda: self.J.mT @ C21(M, A, a(), a(1), a(2), b(), b(1), b(2)) @ self.J,  # (45)
        ])  # fmt: skip

    @cached_property
    def Qgrav(self) -> Series:
        return self._project(self.UG)  # (25), (Qgravdot), (52)

    @cached_property
    def Qext(self) -> Series:
        if self.W is None:
            return Series.constant(0 * (self.J.mT @ self.UG))
        W, A, a, JT = self.W, self.A, self.a, self.J.mT
        return _printed_series([
            lambda: JT @ W[0],  # (Qext)
            lambda: JT @ (W[1] - (A @ a()).mT @ W[0]),  # (Qextdot)
            lambda: JT @ (
                W[2] - 2 * (A @ a()).mT @ W[1]
                + (2 * (A @ a() @ A @ a()).mT - (A @ a(1)).mT - (A @ a() @ a()).mT) @ W[0]
            ),  # (Qextddot)
        ])  # fmt: skip

    @cached_property
    def Q(self) -> Series:
        q, gM, gC, Qgrav, Qext = self.q, self.gM, self.gC, self.Qgrav, self.Qext
        return _printed_series([
            lambda: gM[0] @ q[2] + gC[0] @ q[1] + Qgrav[0] + Qext[0],  # (EOM1)
            lambda: gM[0] @ q[3] + (gM[1] + gC[0]) @ q[2] + gC[1] @ q[1] + Qgrav[1] + Qext[1],  # (EOM1stOrder)
            lambda: (
                gM[0] @ q[4] + (2 * gM[1] + gC[0]) @ q[3] + (gM[2] + 2 * gC[1]) @ q[2] + gC[2] @ q[1]
                + Qgrav[2] + Qext[2]
            ),  # (EOM2ndOrder)
        ])  # fmt: skip


def _printed_series(expressions: Sequence[Callable[[], Array]]) -> Series:
    def term(k: int) -> Array:
        if k >= len(expressions):
            raise JounceError(f"the paper prints time derivatives up to order 2; order {k} needs method='closed_form'")
        return expressions[k]()

    return Series(term)


def inverse_dynamics(m: Mechanism, x: State) -> Series:
    """Q, (..., nv, 1)."""
    paper = _build_paper(m, x)
    return _project_forces(m, paper, paper.Q)


def gravity_forces(m: Mechanism, x: State) -> Series:
    """Qgrav, (..., nv, 1)."""
    paper = _build_paper(m, x)
    return _project_forces(m, paper, paper.Qgrav)


def mass_matrix(m: Mechanism, x: State) -> Series:
    """gM, (..., nv, nv)."""
    paper = _build_paper(m, x)
    return _own_rows(m, paper.gM if paper.T is None else paper.T.mT @ paper.gM @ paper.T, (-2, -1))


def coriolis_matrix(m: Mechanism, x: State) -> Series:
    """gC, (..., nv, nv)."""
    paper = _build_paper(m, x)
    C, T = paper.gC, paper.T
    return _own_rows(m, C if T is None else T.mT @ (C @ T + paper.gM @ T.dot), (-2, -1))


def _build_paper(m: Mechanism, x: State) -> Paper:
    """The equations of a state; a fixed robot on a ground that moves is carried by a base without inertia."""
    if m.floats or x.base is None:
        return Paper(m, x.q, x.W, x.base)
    W = x.W and x.W.map(lambda W: concatenate([0 * W[..., :6, :], W], axis=-2))
    return Paper(add_moving_ground(m), x.q, W, x.base)


def _project_forces(m: Mechanism, paper: Paper, Q: Series) -> Series:
    return _own_rows(m, Q if paper.T is None else paper.T.mT @ Q, (-2,))


def _own_rows(m: Mechanism, x: Series, axes: tuple[int, ...]) -> Series:
    """The last nv rows, or columns too: those ahead of them are of the ground."""

    def own(x: Array) -> Array:
        for axis in axes:
            x = x[(..., slice(-m.nv, None), *[slice(None)] * (-1 - axis))]
        return x

    return x.map(own)
