"""The equations of motion by sweeps outward and inward over the tree: any order, any scalar type.

Forces, momentum and the Jacobian of a body take O(n) steps, matrices as many as they have entries. Every function takes
coordinates as columns (..., n, 1) and returns a series, computed as far as it is asked for.
"""

from jounce.dynamics.recursion.forces import external_forces, gravity_forces, inverse_dynamics
from jounce.dynamics.recursion.matrices import coriolis_matrix, mass_matrix, skew_coriolis_matrix
from jounce.dynamics.recursion.momenta import base_wrench, momentum
from jounce.dynamics.recursion.twists import jacobian, pose, system_jacobian

__all__ = [
    "base_wrench",
    "coriolis_matrix",
    "external_forces",
    "gravity_forces",
    "inverse_dynamics",
    "jacobian",
    "mass_matrix",
    "momentum",
    "pose",
    "skew_coriolis_matrix",
    "system_jacobian",
]
