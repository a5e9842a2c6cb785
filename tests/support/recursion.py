"""The recursion's laws on series under one name, as tests of it take them."""

from dataclasses import replace

from jounce.dynamics.recursion.bodies import (
    center_of_mass,
    centroidal_momentum,
    generalized_momentum,
    jacobians,
    kinetic_energy,
    momentum,
    poses,
    potential_energy,
    twists,
)
from jounce.dynamics.recursion.forces import MOVING_SWEEP, RESTING_SWEEP, base_wrench, rnea
from jounce.dynamics.recursion.matrices import (
    centroidal_momentum_matrix,
    coriolis_matrix,
    mass_matrix,
    skew_coriolis_matrix,
)

__all__ = [
    "base_wrench",
    "center_of_mass",
    "centroidal_momentum",
    "centroidal_momentum_matrix",
    "coriolis_matrix",
    "external_forces",
    "generalized_momentum",
    "gravity_forces",
    "inverse_dynamics",
    "jacobians",
    "kinetic_energy",
    "mass_matrix",
    "momentum",
    "poses",
    "potential_energy",
    "skew_coriolis_matrix",
    "twists",
]


def inverse_dynamics(mechanism, q, W=None):
    return rnea(MOVING_SWEEP, mechanism, q, W)


def gravity_forces(mechanism, q):
    return rnea(RESTING_SWEEP, mechanism, q)


def external_forces(mechanism, q, W):
    """Qext: the forces without masses."""
    return rnea(MOVING_SWEEP, replace(mechanism, M=0 * mechanism.M), q, W)
