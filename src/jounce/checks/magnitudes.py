"""Magnitudes: the sizes of what is added up in a quantity and its rates, which stay where the quantity itself cancels.

Rounding errors are in proportion to them: a force that is zero in exact arithmetic comes out as noise of some 1e-16 of
its magnitude. Magnitudes are roots of sums of squares, the sizes of sums of independent terms: sums of absolute values
outgrow the results with every body and every order.

The equations are those of `closed_form`, in squares: of each 3-vector its squared norm, of each 3x3 block its mean
square gain, 1 for a rotation. Differences become sums, and so nothing cancels.
"""

from collections.abc import Sequence
from functools import reduce
from operator import add

import numpy as np

from jounce._scalars import Array
from jounce.dynamics import system
from jounce.dynamics.computation import Computation
from jounce.model import drives
from jounce.model.coordinates import joint_variables
from jounce.model.equivalent import on_axes
from jounce.model.mechanism import Mechanism
from jounce.robot.generic import evaluate
from jounce.spatial.series import Series, diagonal, from_rate


def magnitudes(mechanism: Mechanism, computation: Computation, arrays: Sequence[Array]) -> tuple[np.ndarray, ...]:
    """The magnitudes of the entries of a quantity and of its rates, from q, qd, ..., W, Wd, ....

    The larger ones of two: in the body frames as they are given, and in those on the joint axes of the recursion.
    """

    ports = computation.signature(mechanism.n, mechanism.nb).inputs

    def squares(m: Mechanism, rates: int) -> tuple[Array, ...]:
        def law(x: Sequence[Array]) -> Series:
            state = computation.state(x)
            return _squares(m, state.q, state.W)[computation.name]

        return evaluate(law, ports[:rates], arrays[:rates], computation.order, (6 * m.nb) ** 2)

    both = zip(squares(mechanism, len(arrays)), squares(on_axes(mechanism), computation.rates), strict=True)
    return tuple(np.sqrt(np.maximum(x, y)).astype(float) for x, y in both)


def scale(expected: Array, magnitude: np.ndarray) -> float:
    """What errors of an array are relative to: its largest entry or magnitude; 1 where nothing is added up at all."""
    return float(max(np.abs(expected).max(), magnitude.max())) or 1.0


def _squares(m: Mechanism, q: Series, W: Series | None) -> dict[str, Series]:
    """By quantity the squares of the magnitudes of its entries; each is computed when it is asked for."""
    C0 = system.poses(m, q[0])
    M, X, G = _gains(system.system_M(m)), _norms(system.system_X(m)), _norms(system.system_G(m))
    a = q.dot.map(lambda v: _gains(system.system_a(m, v)))  # (a)
    qd = q.map(np.square).dot
    A = from_rate(_gains(system.system_A(m, C0)), lambda A: (Aa := A @ a) + Aa @ A)  # (Adot)
    Aa = A @ a
    J = A @ X  # (JbSys)
    b = (J @ qd).map(_system_b)  # (Vsys), (b)
    U = from_rate(_gains(system.system_U(C0)), lambda U: Aa @ U)  # (eq_U)
    C = M @ Aa + b.mT @ M  # (Csys)
    JT = J.mT
    gM, gC = JT @ M @ J, JT @ C @ J  # (MC)
    Qgrav = JT @ (M @ (U @ G))
    Q = gM @ qd.dot + gC @ qd + Qgrav + _drives(m, q)  # (EOM1)
    Q = Q if W is None else Q + JT @ W.map(_norms)
    return {
        "inverse_dynamics": Q.map(lambda Q: Q[..., 0]),
        "gravity_forces": Qgrav.map(lambda Q: Q[..., 0]),
        "mass_matrix": gM + _rotors(m),
        "coriolis_matrix": gC,
        "skew_coriolis_matrix": JT @ (C + M @ b) @ J,  # (Cbar)
    }


def _norms(columns: Array) -> Array:
    """Columns (..., 6k, l) as those of the squared norms of their 3-vectors, (..., 2k, l)."""
    return _sums(np.square(columns))


def _gains(matrix: Array) -> Array:
    """A matrix (..., 6k, 6l) as that of the mean square gains of its 3x3 blocks, (..., 2k, 2l)."""
    return _sums(_sums(np.square(matrix)).mT).mT / 3


def _sums(x: Array) -> Array:
    """The sums of each three rows."""
    *lead, rows, width = x.shape
    return x.reshape((*lead, rows // 3, 3, width)).sum(axis=-2)


def _system_b(V: Array) -> Array:
    """The gains of b = diag(ad(V_i)) from the squared norms of V, (..., 2nb, 1)."""
    w, v = V[..., 0::2, 0], V[..., 1::2, 0]
    return diagonal(np.stack([np.stack([w, 0 * w], axis=-1), np.stack([v, w], axis=-1)], axis=-2) * (2 / 3))


def _rotors(m: Mechanism) -> Array:
    return np.square(m.G.T @ (m.drives.armature[:, None] * m.G)) * ("armature" in m.acting)


def _drives(m: Mechanism, q: Series) -> Series:
    c, theta = drives.coefficients(m.drives), joint_variables(m, q)
    terms = (drives.forces(c, [term], theta).map(np.square) for term in m.acting)
    return np.square(m.G.T) @ reduce(add, terms, theta * 0)
