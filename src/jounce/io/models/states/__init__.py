"""Whole states and forces of other libraries: joints by name, and the base of a robot that floats in their conventions.

| | quaternion | linear velocity of the base | angular | acceleration |
|---|---|---|---|---|
| Pinocchio | x, y, z, w | base axes | base axes | rates of the components of v |
| MuJoCo | w, x, y, z | world axes | base axes | rates of the components of qvel |
"""

from jounce.io.models.states.conversion import (
    RobotState,
    forces_from,
    forces_to,
    read_model_layout,
    state_from,
    state_to,
)
from jounce.io.models.states.layout import ModelLayout

__all__ = ["ModelLayout", "RobotState", "forces_from", "forces_to", "read_model_layout", "state_from", "state_to"]
