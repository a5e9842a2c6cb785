"""Other libraries that know rigid body dynamics at order 0, to check a robot against, where they are installed."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from jounce.errors import JounceError, one_line
from jounce.mechanism import Mechanism

OWN_READING, OUR_DATA = "its own reading of the file", "our data"


class NotComparableError(JounceError):
    """A robot that a peer cannot hold; the message says why."""


@dataclass(frozen=True)
class Peer:
    """A library's model of a mechanism, in its joint variables: theta, theta', theta'' (nb,)."""

    name: str
    source: str  # where the library has the robot's numbers from
    forces: Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]  # (nb,)
    mass_matrix: Callable[[np.ndarray], np.ndarray]  # (nb, nb)


@dataclass(frozen=True)
class Absence:
    """Why a library is not among the peers."""

    name: str
    reason: str


def peers(mechanism: Mechanism, path: Path | None) -> Iterator[Peer | Absence]:
    """What is installed, reading the file itself where it can, else given our data."""
    from jounce.peers import mujoco, pinocchio

    for library in (pinocchio, mujoco):
        try:
            yield library.model(mechanism, path)
        except ImportError:
            yield Absence(library.NAME, "not installed")
        except NotComparableError as error:
            yield Absence(library.NAME, str(error))
        except Exception as error:  # whatever a foreign library raises at a robot that it cannot hold
            yield Absence(library.NAME, one_line(error))
