"""Accelerations of links and rotors that they carry: the inertia of the whole couples both.

    [ M    S ] [ q2d     ]   [ phi - bias                  ]
    [ S^T  B ] [ theta2d ] = [ tau - F_m - phi - r J a . w' ]

Column j of S is the force by which the spin of rotor j, per theta2d, acts on the links; the bias holds the gyroscopic
moments, and w' is that of q2d = 0.
"""

from functools import reduce
from operator import add
from typing import TYPE_CHECKING

import numpy as np

from jounce.core.scalars import Array, reciprocal
from jounce.dynamics import coupling
from jounce.dynamics.base import STILL
from jounce.dynamics.quantities import FORCES, QUANTITIES
from jounce.dynamics.recursion import bodies
from jounce.dynamics.state import State
from jounce.dynamics.stretch import elasticity_of
from jounce.model.mechanism import Mechanism
from jounce.spatial.linear import Factors
from jounce.spatial.series import Series, columns, wrench_columns

if TYPE_CHECKING:
    from collections.abc import Sequence


def coupled_accelerations(
    m: Mechanism, state: "Sequence[Array]", force: Array, free: Array, W: "Sequence[Array]"
) -> tuple[Array, Array]:
    """q2d and theta2d (..., n) of a state q, qd, theta, thetad.

    `force` are those of the springs, `free` what motors have left for their rotors, `W` wrenches (..., nb, 6) or none.
    """
    q, qd, theta, thetad = state
    still = columns([q, qd, 0 * q])
    moments = coupling.reaction_wrenches(m, still, columns([theta, thetad, 0 * theta]))
    moments = moments + wrench_columns(W) if W else moments
    bias = FORCES.law("recursion", m)(m, State(still, moments))[0]
    (M,) = QUANTITIES["mass_matrix"].law("recursion", m)(m, State(still)).upto(0)
    S, inverse_B = _spin_forces(m, columns([q])), reciprocal(elasticity_of(m).rotor)
    left = (free - coupling.motor_reactions(m, still)[0][..., 0]) * inverse_B
    q2d = Factors.of(M - S * inverse_B @ S.mT).solve((force - bias)[..., None] - S @ left[..., None])
    return q2d[..., 0], left - inverse_B * (S.mT @ q2d)[..., 0]


def _spin_forces(m: Mechanism, q: Series) -> Array:
    """S (..., n, n): the generalized forces of the momenta of rotors."""
    J, unit = bodies.jacobians(m, q, STILL, None)[0], np.eye(m.n, dtype=int)
    parts = [J[..., x.body, :3, :].mT @ x.momentum @ unit[x.coordinate : x.coordinate + 1] for x in coupling.rotors(m)]
    return reduce(add, parts, 0 * J[..., 0, :1, :] * unit)
