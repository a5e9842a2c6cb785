"""Other libraries that know rigid body dynamics at order 0, to check a robot against, where they are installed."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from jounce.errors import JounceError, one_line
from jounce.model.mechanism import Mechanism

OWN_READING, OUR_DATA = "its own reading of the file", "our data"
OTHER_JOINTS = "joints differ from those of the file: some were locked, welded or left out"


class NotComparableError(JounceError):
    """A robot that another library cannot represent; the message says why."""


@dataclass(frozen=True)
class Peer:
    """A library's model of a mechanism, in its joint variables: theta, theta', theta'' (nb,).

    Where the robot floats, it takes the pose C, the twist V and V' of the base besides; six rows more come first.
    """

    name: str
    source: str  # where the library has the robot's numbers from
    forces: Callable[..., np.ndarray]  # (nb,) of theta, theta', theta'', and C, V, V'
    mass_matrix: Callable[[np.ndarray], np.ndarray]  # (nb, nb)


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
