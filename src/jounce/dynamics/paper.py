"""Sections 3 and 4 of the paper stand here as printed, corrected: an independent check of the product rule.

`closed_form` has that rule; this module and `closed_form` share Section 2 (`system`), and nothing else. Each line
carries the label of its equation in the paper's source; a label on an unnumbered row stands for its equation. Dense
system matrices: M, A, a, b and C are the sans-serif ones, ``da, d2a`` the time derivatives of a, ``M1, C1`` the paper's
M^(1), C^(1).

Section 3 is the first time derivative of the system matrices, from `M1` to `C12`; Section 4 the second, from
`dM1_first` to `C22`. They follow from the constant M and two rates: A' = A a A - A a (Adot), and J' = -A a J, which
turns the rate of J^T X J into J^T (X' - X A a - a^T A^T X) J. `Paper` assembles from them the equations of motion and
their two time derivatives, and `inverse_dynamics` and the functions below it are laws of quantities.

The equations are printed for joints of one screw, of which a X = 0. They hold for all others in velocities nu_p = T nu
of which ``T' = T alpha`` and T = 1 at the instant, with alpha of `dynamics.state.velocity_drift`. The laws take them to
the velocities nu of the mechanism: Q = T^T Q_p, M = T^T M_p T, and, as nu_p' = T nu' + T' nu, C = T^T (C_p T + M_p T').

Errata, each with a test of its own:

* (M21) is printed with M^(1)(q, qd) as its first term; it must be M^(1)(q, q2d), as the sentence after it says.
* Before (Adot), the printed rate of Ad(C_ij) holds for j = i-1 only, which is where the paper uses it.
* After (Cbar), property 2) holds for every C; skew symmetry of gM' - 2C is what needs an arrangement, that of (Cbar).
* (CSys2dot), (C21) and (C22) print 3 a a' for 2 a a' + a' a, which is the same where every joint has one screw.
* (Qext), (Qextdot), (Qextddot) write W_EE and W_ext for one and the same vector, W here.
"""

from collections.abc import Callable, Sequence
from functools import cached_property

import numpy as np

from jounce.core.errors import JounceError
from jounce.core.scalars import Array, concatenate
from jounce.dynamics import system
from jounce.dynamics.state import BASE_AT_REST, JointMotion, State, add_moving_ground, velocity_drift
from jounce.model.mechanism import Mechanism, ancestors
from jounce.spatial.series import Series, from_rate, join_series


# Section 3: the first time derivatives of the system matrices M and C.
def M1(M: Array, A: Array, a: Array) -> Array:
    """M^(1), with gM' = J^T M^(1) J."""
    return -M @ A @ a - (M @ A @ a).mT  # (M1)


def C(M: Array, A: Array, a: Array, b: Array) -> Array:
    """The system matrix C(q, qd, V).

    With da, db in the place of a, b it is C(q, q2d, dV).
    """
    return -M @ A @ a - b.mT @ M  # (Csys)


def dC_first(M: Array, A: Array, a: Array, da: Array, db: Array) -> Array:
    """The time derivative of C, reusing (Csys)."""
    return C(M, A, da, db) + M @ A @ a @ A @ a - M @ A @ a @ a  # (CSysdot)


def dC_second(M: Array, A: Array, a: Array, da: Array, db: Array) -> Array:
    """The same, expanded."""
    return M @ A @ a @ A @ a - M @ A @ a @ a - M @ A @ da - db.mT @ M  # (CSysdot)


# The last two terms are those of J' = -A a J on both sides of J^T C J.
def C1(C: Array, dC: Array, A: Array, a: Array) -> Array:
    """C^(1) by its definition, with gC' = J^T C^(1) J."""
    return dC - C @ A @ a - a.mT @ A.mT @ C  # (C1)


# The rate of C put into C^1: first with C0 = C kept as a matrix, then multiplied out.
def C11(M: Array, A: Array, a: Array, da: Array, b: Array, db: Array) -> Array:
    """C^(1), reusing (Csys)."""
    C0 = C(M, A, a, b)
    return C(M, A, da, db) + M @ A @ a @ A @ a - M @ A @ a @ a - C0 @ A @ a - a.mT @ A.mT @ C0  # (C11)


def C12(M: Array, A: Array, a: Array, da: Array, b: Array, db: Array) -> Array:
    """C^(1), expanded."""
    return (
        -M @ A @ da - db.mT @ M + b.mT @ M @ A @ a + a.mT @ A.mT @ b.mT @ M
        + a.mT @ A.mT @ M @ A @ a + 2 * M @ A @ a @ A @ a - M @ A @ a @ a
    )  # (C12)  # fmt: skip


# Section 4: the second time derivatives of the system matrices M and C.
def dM1_first(M: Array, A: Array, a: Array, da: Array) -> Array:
    """The time derivative of M^(1)."""
    S = M @ (A @ a @ A - A @ a) @ a
    return M1(M, A, da) + S + S.mT  # (41)


def dM1_second(M: Array, A: Array, a: Array, da: Array) -> Array:
    """The same, expanded."""
    return M1(M, A, da) - M @ A @ a @ a + M @ A @ a @ A @ a - (M @ A @ a @ a).mT + (M @ A @ a @ A @ a).mT  # (42)


# From here M^1 and C^1 take the part of M and C: once more their rates, and J' on both sides.
def M2(M: Array, A: Array, a: Array, da: Array) -> Array:
    """M^(2) by its definition after (Mddot), with gM'' = J^T M^(2) J."""
    return dM1_first(M, A, a, da) - M1(M, A, a) @ A @ a - a.mT @ A.mT @ M1(M, A, a)  # (39)


def M21(M: Array, A: Array, a: Array, da: Array) -> Array:
    """M^(2) in its first explicit form. Printed with M^(1)(q, qd) in the first term; M^(1)(q, q2d) is right."""
    S = M @ (A @ a @ A - A @ a) @ a
    return M1(M, A, da) + S + S.mT - M1(M, A, a) @ A @ a - (M1(M, A, a) @ A @ a).mT  # (M21), corrected


def M22(M: Array, A: Array, a: Array, da: Array) -> Array:
    """M^(2) in its second explicit form."""
    S = -M @ A @ da + 2 * M @ A @ a @ A @ a - M @ A @ a @ a
    return S + S.mT + 2 * a.mT @ A.mT @ M @ A @ a  # (M22)


def dC1_first(C: Array, dC: Array, d2C: Array, A: Array, a: Array, da: Array) -> Array:
    """The time derivative of C^(1)."""
    return (
        d2C - dC @ A @ a - a.mT @ A.mT @ dC - C @ A @ da - da.mT @ A.mT @ C + C @ A @ a @ A @ a
        + a.mT @ A.mT @ a.mT @ A.mT @ C - C @ A @ a @ a - a.mT @ a.mT @ A.mT @ C
    )  # (C1dot)  # fmt: skip


def dC1_second(C: Array, C1: Array, d2C: Array, A: Array, a: Array, da: Array) -> Array:
    """The same, reusing C^(1)."""
    return (
        d2C - (C1 + a.mT @ A.mT @ C) @ A @ a - a.mT @ A.mT @ (C1 + C @ A @ a) - C @ A @ da
        - da.mT @ A.mT @ C - C @ A @ a @ a - a.mT @ a.mT @ A.mT @ C
    )  # (C1dot)  # fmt: skip


def _tail(M: Array, A: Array, a: Array, da: Array) -> Array:
    """The terms that both forms of (CSys2dot), and (C21), end with.

    2 a a' + a' a is printed as 3 a a': they commute where every joint has one screw.
    """
    return (
        M @ A @ da @ A @ a + 2 * M @ A @ a @ A @ da - 2 * M @ A @ a @ A @ a @ A @ a + 2 * M @ A @ a @ A @ a @ a
        - 2 * M @ A @ a @ da - M @ A @ da @ a - M @ A @ a @ a @ a + M @ A @ a @ a @ A @ a
    )  # fmt: skip


def d2C_first(M: Array, A: Array, a: Array, da: Array, d2a: Array, d2b: Array) -> Array:
    """The second time derivative of C, reusing (Csys)."""
    return C(M, A, d2a, d2b) + _tail(M, A, a, da)  # (CSys2dot)


def d2C_second(M: Array, A: Array, a: Array, da: Array, d2a: Array, d2b: Array) -> Array:
    """The same, expanded."""
    return -M @ A @ d2a - d2b.mT @ M + _tail(M, A, a, da)  # (49)


def C2(C1: Array, dC1: Array, A: Array, a: Array) -> Array:
    """C^(2) by its definition, with gC'' = J^T C^(2) J."""
    return dC1 - C1 @ A @ a - a.mT @ A.mT @ C1  # (C2temp)


# C21 and C22 stay at eight parameters: as in the paper, they are formulas in the system matrices and their rates, and a
# container for these would hide what each formula depends on.
def C21(M: Array, A: Array, a: Array, da: Array, d2a: Array, b: Array, db: Array, d2b: Array) -> Array:
    """C^(2), reusing C and C^(1)."""
    C0, C_1 = C(M, A, a, b), C11(M, A, a, da, b, db)
    return (
        C(M, A, d2a, d2b) - 2 * C_1 @ A @ a - 2 * a.mT @ A.mT @ C_1 - C0 @ A @ da - da.mT @ A.mT @ C0
        - 2 * a.mT @ A.mT @ C0 @ A @ a - C0 @ A @ a @ a - a.mT @ a.mT @ A.mT @ C0
        + _tail(M, A, a, da)
    )  # (C21)  # fmt: skip


def C22(M: Array, A: Array, a: Array, da: Array, d2a: Array, b: Array, db: Array, d2b: Array) -> Array:
    """C^(2), expanded."""
    C0 = C(M, A, a, b)
    return (
        -M @ A @ d2a - d2b.mT @ M + 2 * db.mT @ M @ A @ a + 2 * a.mT @ A.mT @ db.mT @ M
        + 3 * M @ A @ da @ A @ a + 2 * M @ A @ a @ A @ da + 2 * a.mT @ A.mT @ M @ A @ da - C0 @ A @ da
        - da.mT @ A.mT @ C0 + 2 * C0 @ A @ a @ A @ a + 2 * a.mT @ A.mT @ C0 @ A @ a
        + 2 * a.mT @ A.mT @ a.mT @ A.mT @ C0 - 4 * M @ A @ a @ A @ a @ A @ a
        - 2 * a.mT @ A.mT @ M @ A @ a @ A @ a + 2 * M @ A @ a @ a @ A @ a + 2 * a.mT @ A.mT @ M @ A @ a @ a
        + 2 * M @ A @ a @ A @ a @ a - 2 * M @ A @ a @ da - M @ A @ da @ a - M @ A @ a @ a @ a + M @ A @ a @ a @ A @ a
        - C0 @ A @ a @ a - a.mT @ a.mT @ A.mT @ C0
    )  # (C22)  # fmt: skip


# The equations of motion, assembled from the matrices of both sections.
class Paper:
    """The equations of motion at one instant, from q and W.

    They are values and two time derivatives.
    """

    def __init__(self, m: Mechanism, q: Series, W: Series | None = None, base: JointMotion | None = None):
        self.mechanism, self.W, self.base = m, W, base
        # nu: velocities, of which those of a base come first. T: their map to the velocities nu_p of the paper, None
        # where both are the same. q: the series of the equations, coordinates followed by nu_p and its rates.
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
        """Return the k-th time derivative of a.

        a itself takes the joints' own velocities in the place of qd.
        """
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
        """Return J^T M^(k) right, k = 0, 1, 2.

        With J as right factor these are gM and its rates; with UG they are those of gravity, as U' = -A a U.
        """
        M, A, a, JT = self.M, self.A, self.a, self.J.mT
        return _printed_series([
            lambda: JT @ M @ right,
            lambda: JT @ M1(M, A, a()) @ right,
            lambda: JT @ M21(M, A, a(), a(1)) @ right,
        ])  # fmt: skip

    @cached_property
    def gM(self) -> Series:
        return self._project(self.J)  # (MC), (Mdot), (Mddot)

    # Matrices of the first printed form; tests compare them with the other forms.
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
        # J' = -A a J turns every rate of J^T W into one of W and factors (A a)^T.
        W, A, a, JT = self.W, self.A, self.a, self.J.mT
        return _printed_series([
            lambda: JT @ W[0],  # (Qext)
            lambda: JT @ (W[1] - (A @ a()).mT @ W[0]),  # (Qextdot)
            lambda: JT @ (
                W[2] - 2 * (A @ a()).mT @ W[1]
                + (2 * (A @ a() @ A @ a()).mT - (A @ a(1)).mT - (A @ a() @ a()).mT) @ W[0]
            ),  # (Qextddot)
        ])  # fmt: skip

    # Leibniz' rule for gM q'' + gC q' + Qgrav + Qext, with terms of the same rate of q collected.
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
    """Return the series of printed expressions.

    Each is evaluated when it is asked for.
    """

    def term(k: int) -> Array:
        if k >= len(expressions):
            raise JounceError(f"the paper prints time derivatives up to order 2; order {k} needs method='closed_form'")
        return expressions[k]()

    return Series(term)


def inverse_dynamics(m: Mechanism, x: State) -> Series:
    """Return Q, (..., nv, 1)."""
    paper = _build_paper(m, x)
    return _project_forces(m, paper, paper.Q)


def gravity_forces(m: Mechanism, x: State) -> Series:
    """Return Qgrav, (..., nv, 1)."""
    paper = _build_paper(m, x)
    return _project_forces(m, paper, paper.Qgrav)


def mass_matrix(m: Mechanism, x: State) -> Series:
    """Return gM, (..., nv, nv)."""
    paper = _build_paper(m, x)
    return _own_rows(m, paper.gM if paper.T is None else paper.T.mT @ paper.gM @ paper.T, (-2, -1))


def coriolis_matrix(m: Mechanism, x: State) -> Series:
    """Return gC, (..., nv, nv)."""
    paper = _build_paper(m, x)
    C, T = paper.gC, paper.T
    return _own_rows(m, C if T is None else T.mT @ (C @ T + paper.gM @ T.dot), (-2, -1))


def _build_paper(m: Mechanism, x: State) -> Paper:
    """Return the equations of a state.

    A fixed robot on a ground that moves is carried by a base without inertia.
    """
    if m.floats or x.base is None:
        return Paper(m, x.q, x.W, x.base)
    # That base comes first among the bodies, and bears no wrench.
    W = None if x.W is None else x.W.map(lambda W: concatenate([0 * W[..., :6, :], W], axis=-2))
    return Paper(add_moving_ground(m), x.q, W, x.base)


def _project_forces(m: Mechanism, paper: Paper, Q: Series) -> Series:
    """Return forces on the velocities of the mechanism, T^T Q_p."""
    return _own_rows(m, Q if paper.T is None else paper.T.mT @ Q, (-2,))


def _own_rows(m: Mechanism, x: Series, axes: tuple[int, ...]) -> Series:
    """Return the last nv entries along some axes: those ahead of them are of a moving ground."""

    def select(x: Array) -> Array:
        for axis in axes:
            x = x[(..., slice(-m.nv, None), *[slice(None)] * (-1 - axis))]
        return x

    return x.map(select)
