"""Other libraries that know rigid body dynamics at order 0, to check a robot against, where they are installed.

Their vectors are converted by joint names, see `jounce.models.states`.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from jounce.errors import JounceError, one_line
from jounce.model.mechanism import Mechanism
from jounce.models import states

OWN_READING, OUR_DATA = "its own reading of the file", "our data"
OTHER_JOINTS = "joints differ from those of the file: some were locked, welded or left out"


class NotComparableError(JounceError):
    """A robot that another library cannot represent; the message says why."""


@dataclass(frozen=True)
class Peer:
    """A library's model of a mechanism in its joint variables theta (nb,), at one state of these and of the base."""

    name: str
    source: str  # where the library has the robot's numbers from
    forces: Callable[[Sequence[np.ndarray], object], np.ndarray]  # (nb,), or (6 + nb,), of theta, rates and base
    mass_matrix: Callable[[np.ndarray, object], np.ndarray]  # as many rows and columns, of theta and base


@dataclass(frozen=True)
class Converter:
    """Joint variables and forces of a mechanism from and to the vectors of a library's model."""

    mechanism: Mechanism
    layout: states.Layout

    @classmethod
    def of(cls, mechanism: Mechanism, layout: states.Layout) -> "Converter":
        """Raise `NotComparableError` unless the joints of the mechanism are those of the model."""
        if set(layout.places) != set(mechanism.joints) or len(layout.free) != (mechanism.base is not None):
            raise NotComparableError(OTHER_JOINTS)
        nb = mechanism.nb
        free = replace(mechanism, G=np.eye(nb), g=np.zeros(nb), coordinates=mechanism.joints, elasticity=None)
        return cls(free, layout)

    def state(self, theta: Sequence[np.ndarray], base: object) -> tuple[np.ndarray, ...]:
        """The vectors q, v, a of the model."""
        return states.state_to(self.mechanism, self.layout, theta, base)

    def forces(self, tau: np.ndarray, q: np.ndarray) -> np.ndarray:
        """The forces of the mechanism from those of the model at q."""
        return states.forces_from(self.mechanism, self.layout, tau, "tau", q)

    def mass_matrix(self, M: np.ndarray, q: np.ndarray) -> np.ndarray:
        """The mass matrix of the mechanism from that of the model at q: both sides of it are forces."""
        return self.forces(self.forces(M, q).T, q)


@dataclass(frozen=True)
class Absence:
    """The reason that a library takes no part in the comparison."""

    name: str
    reason: str


def peers(mechanism: Mechanism, path: Path | None) -> Iterator[Peer | Absence]:
    """Return the installed libraries' models: read from the file where possible, otherwise built from the mechanism."""
    from jounce.checks.reference import mujoco, pinocchio

    for library in (pinocchio, mujoco):
        ways = [partial(library.of_data, mechanism)]
        if path is not None and path.suffix.lower() == library.SUFFIX:
            ways.insert(0, partial(library.of_file, mechanism, path))
        yield from _first(library.NAME, ways)


def _first(name: str, ways: Sequence[Callable[[], Peer]]) -> Iterator[Peer | Absence]:
    """Return the first model of a library that can be built, and the reasons that the earlier ways failed."""
    for way in ways:
        try:
            yield way()
        except ImportError:
            yield Absence(name, "not installed")
        except Exception as error:  # whatever a foreign library raises at a robot that it cannot hold
            yield Absence(name, one_line(error))
            continue
        return
