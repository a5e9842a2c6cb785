"""Other libraries that know rigid body dynamics at order 0, to check a robot against, where they are installed.

Their vectors are converted by joint names, see `jounce.io.models.states`.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from jounce.checks.reference import mujoco, pinocchio
from jounce.checks.reference.peer import Peer
from jounce.core.errors import one_line
from jounce.model.mechanism import Mechanism


@dataclass(frozen=True)
class Absence:
    """The reason that a library takes no part in the comparison."""

    name: str
    reason: str


def peers(mechanism: Mechanism, path: Path | None) -> Iterator[Peer | Absence]:
    """Return the installed libraries' models: read from the file where possible, otherwise built from the mechanism."""
    for library in (pinocchio, mujoco):
        ways = [partial(library.build_peer, mechanism)]
        if path is not None and path.suffix.lower() == library.FILE_SUFFIX:
            ways.insert(0, partial(library.read_peer, mechanism, path))
        yield from _try_ways(library.NAME, ways)


def _try_ways(name: str, ways: Sequence[Callable[[], Peer]]) -> Iterator[Peer | Absence]:
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
