"""Section 3: the first time derivative of the system matrices, M^(1) and C^(1)."""

from jounce.core.scalars import Array


def M1(M: Array, A: Array, a: Array) -> Array:
    """M^(1), with gM' = J^T M^(1) J."""
    return -M @ A @ a - (M @ A @ a).mT  # (M1)


def C(M: Array, A: Array, a: Array, b: Array) -> Array:
    """The system matrix C(q, qd, V), or with da, db in their place C(q, q2d, dV)."""
    return -M @ A @ a - b.mT @ M  # (Csys)


def dC_first(M: Array, A: Array, a: Array, da: Array, db: Array) -> Array:
    """The time derivative of C, reusing (Csys)."""
    return C(M, A, da, db) + M @ A @ a @ A @ a - M @ A @ a @ a  # (CSysdot)


def dC_second(M: Array, A: Array, a: Array, da: Array, db: Array) -> Array:
    """The same, expanded."""
    return M @ A @ a @ A @ a - M @ A @ a @ a - M @ A @ da - db.mT @ M  # (CSysdot)


def C1(C: Array, dC: Array, A: Array, a: Array) -> Array:
    """C^(1) by its definition, with gC' = J^T C^(1) J."""
    return dC - C @ A @ a - a.mT @ A.mT @ C  # (C1)


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
