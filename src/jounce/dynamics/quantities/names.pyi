"""Written by `make stubs` from the table of quantities."""

from typing import Literal, TypeAlias

QuantityName: TypeAlias = Literal[
    "inverse_dynamics",
    "gravity_forces",
    "forward_dynamics",
    "inverse_dynamics_partials",
    "forward_dynamics_partials",
    "regressor",
    "momentum_regressor",
    "energy_regressor",
    "mass_matrix",
    "coriolis_matrix",
    "skew_coriolis_matrix",
    "poses",
    "twists",
    "jacobian",
    "momentum",
    "centroidal_momentum",
    "centroidal_momentum_matrix",
    "center_of_mass",
    "generalized_momentum",
    "kinetic_energy",
    "potential_energy",
    "base_wrench",
    "joint_wrenches",
    "motor_positions",
    "motor_torques",
    "coordinates",
    "actuator_forces",
    "loop_wrenches",
]
