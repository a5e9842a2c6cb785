"""The laws of the printed equations, in the velocities of the mechanism.

With nu_p = T nu of `equations` come Q = T^T Q_p and M = T^T M_p T, and, as nu_p' = T nu' + T' nu, C = T^T (C_p T +
M_p T').
"""

from jounce.core.scalars import Array, concatenate
from jounce.dynamics.joint_motion import on_moving_ground
from jounce.dynamics.paper.equations import Paper
from jounce.dynamics.state import State
from jounce.model.mechanism import Mechanism
from jounce.spatial.series import Series


def inverse_dynamics(m: Mechanism, x: State) -> Series:
    """Q, (..., nv, 1)."""
    paper = _paper(m, x)
    return _forces(m, paper, paper.Q)


def gravity_forces(m: Mechanism, x: State) -> Series:
    """Qgrav, (..., nv, 1)."""
    paper = _paper(m, x)
    return _forces(m, paper, paper.Qgrav)


def mass_matrix(m: Mechanism, x: State) -> Series:
    """gM, (..., nv, nv)."""
    paper = _paper(m, x)
    return _own_rows(m, paper.gM if paper.T is None else paper.T.mT @ paper.gM @ paper.T, (-2, -1))


def coriolis_matrix(m: Mechanism, x: State) -> Series:
    """gC, (..., nv, nv)."""
    paper = _paper(m, x)
    C, T = paper.gC, paper.T
    return _own_rows(m, C if T is None else T.mT @ (C @ T + paper.gM @ T.dot), (-2, -1))


def _paper(m: Mechanism, x: State) -> Paper:
    """The equations of a state; a fixed robot on a ground that moves is carried by a base without inertia."""
    if m.floats or x.base is None:
        return Paper(m, x.q, x.W, x.base)
    W = x.W and x.W.map(lambda W: concatenate([0 * W[..., :6, :], W], axis=-2))
    return Paper(on_moving_ground(m), x.q, W, x.base)


def _forces(m: Mechanism, paper: Paper, Q: Series) -> Series:
    return _own_rows(m, Q if paper.T is None else paper.T.mT @ Q, (-2,))


def _own_rows(m: Mechanism, x: Series, axes: tuple[int, ...]) -> Series:
    """The last nv rows, or columns too: those ahead of them are of the ground."""

    def own(x: Array) -> Array:
        for axis in axes:
            x = x[(..., slice(-m.nv, None), *[slice(None)] * (-1 - axis))]
        return x

    return x.map(own)
