"""Section 4: the second time derivative of the system matrices, M^(2) and C^(2)."""

from jounce.core.scalars import Array
from jounce.dynamics.paper.section3 import C11, M1, C


def dM1_first(M: Array, A: Array, a: Array, da: Array) -> Array:
    """The time derivative of M^(1)."""
    S = M @ (A @ a @ A - A @ a) @ a
    return M1(M, A, da) + S + S.mT  # (41)


def dM1_second(M: Array, A: Array, a: Array, da: Array) -> Array:
    """The same, expanded."""
    return M1(M, A, da) - M @ A @ a @ a + M @ A @ a @ A @ a - (M @ A @ a @ a).mT + (M @ A @ a @ A @ a).mT  # (42)


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
