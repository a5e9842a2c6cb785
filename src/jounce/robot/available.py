"""Names that `dir(robot)` lists: what this robot has, and the doors to what others have.

A quantity stands in the list if the robot has what its row needs. Methods that are no quantities need what
`METHOD_NEEDS` states. Doors, which make another robot of this one, are always listed.
"""

from collections.abc import Callable, Iterable

from jounce.dynamics.quantities import QUANTITIES
from jounce.model.mechanism import Mechanism


def _is_elastic(m: Mechanism) -> bool:
    return m.elasticity is not None


def _has_contacts(m: Mechanism) -> bool:
    return len(m.contacts) > 0


METHOD_NEEDS: dict[str, Callable[[Mechanism], bool]] = {
    "motors_along": _is_elastic,
    "elastic_energy": _is_elastic,
    "damping_error": _is_elastic,
    "project": _has_contacts,
    "next_switch": _has_contacts,
    "center_of_pressure": _has_contacts,
}


def list_available(mechanism: Mechanism, names: Iterable[str]) -> list[str]:
    """Return the names of methods and attributes that a robot can serve."""
    absent = {row.name for row in QUANTITIES.values() if row.obstacle(mechanism) is not None}
    absent |= {name for name, is_met in METHOD_NEEDS.items() if not is_met(mechanism)}
    return [name for name in names if name not in absent]
