"""A library's model of a mechanism, and its vectors from and to those of the mechanism."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from jounce.core.errors import JounceError
from jounce.io.models import states
from jounce.model.mechanism import Mechanism, single_variables
from jounce.model.positions import multiscrew_joints, single_positions

OWN_READING, OUR_DATA = "its own reading of the file", "our data"
OTHER_JOINTS = "joints differ from those of the file: some were locked, welded or left out"


class NotComparableError(JounceError):
    """A robot that another library cannot represent; the message says why."""


@dataclass(frozen=True)
class Peer:
    """A library's model of a mechanism in its joint variables theta (nc,), at one state of these and of the base."""

    name: str
    source: str  # where the library has the robot's numbers from
    forces: Callable[[Sequence[np.ndarray], object], np.ndarray]  # (nc,), or (6 + nc,), of theta, rates and base
    mass_matrix: Callable[[np.ndarray, object], np.ndarray]  # as many rows and columns, of theta and base


def _use_joint_variables(mechanism: Mechanism) -> Mechanism:
    """The mechanism whose coordinates are its joint variables."""
    nc = len(mechanism.joints)
    return replace(mechanism, G=np.eye(nc), g=np.zeros(nc), coordinates=mechanism.joints, elasticity=None)


def joint_rates(mechanism: Mechanism, rates: Sequence[np.ndarray]) -> list[np.ndarray]:
    """The joint variables and their rates, numbers of joints of several screws included, of the coordinates."""
    free = _use_joint_variables(mechanism)
    theta = rates[0] @ (single_positions(mechanism).T @ mechanism.G.T) + mechanism.g
    theta = theta @ single_positions(free)
    for i, x in multiscrew_joints(mechanism).items():
        theta[..., multiscrew_joints(free)[i].numbers] = rates[0][..., x.numbers]
    return [theta, *(x @ mechanism.G.T for x in rates[1:])]


@dataclass(frozen=True)
class Converter:
    """Joint variables and forces of a mechanism from and to the vectors of a library's model."""

    mechanism: Mechanism
    layout: states.ModelLayout

    @classmethod
    def match(cls, mechanism: Mechanism, layout: states.ModelLayout) -> "Converter":
        """Raise `NotComparableError` unless the joints of the mechanism are those of the model."""
        several = {x.name for x in multiscrew_joints(mechanism).values()}
        single = {mechanism.joints[j] for j in single_variables(mechanism).values()}
        if set(layout.places) != single or len(layout.free) != len(several & set(layout.free)) + mechanism.floats:
            raise NotComparableError(OTHER_JOINTS)
        return cls(_use_joint_variables(mechanism), layout)

    def state(self, theta: Sequence[np.ndarray], base: object) -> tuple[np.ndarray, ...]:
        """The vectors q, v, a of the model."""
        return states.state_to(self.mechanism, self.layout, theta, base)

    def forces(self, tau: np.ndarray, q: np.ndarray) -> np.ndarray:
        """The forces of the mechanism from those of the model at q."""
        return states.forces_from(self.mechanism, self.layout, tau, q)

    def mass_matrix(self, M: np.ndarray, q: np.ndarray) -> np.ndarray:
        """The mass matrix of the mechanism from that of the model at q: both sides of it are forces."""
        return self.forces(self.forces(M, q).T, q)
