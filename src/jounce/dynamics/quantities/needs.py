"""What quantities ask of a robot, and why one that lacks it has none of them."""

from collections.abc import Callable
from dataclasses import dataclass

from jounce.core.cures import Remedy
from jounce.model.mechanism import Mechanism


@dataclass(frozen=True, eq=False)  # the same need is the same object
class Need:
    """One thing that a quantity asks of a robot.

    Its obstacle is why a robot lacks it, as the end of a sentence that begins with the quantity and the robot, or None.
    """

    obstacle: Callable[[Mechanism], str | None]


def _rigid_joints(m: Mechanism) -> str | None:
    if m.elasticity is not None:
        return None
    return f": its joints are rigid{Remedy('; robot.elastic(stiffness) makes them elastic')}"


def _open_tree(m: Mechanism) -> str | None:
    return f": no loop is closed{_CLOSE_LOOPS}" if m.closure is None else None


def _uncut_tree(m: Mechanism) -> str | None:
    return None if m.loops else f": no loop is closed{_CLOSE_LOOPS}"


def _no_contacts(m: Mechanism) -> str | None:
    if m.contacts:
        return None
    return f": it has no contacts{Remedy('; robot.contacts([jounce.Contact(frame, kind), ...]) states them')}"


def _contacts(m: Mechanism) -> str | None:
    without = Remedy("; robot.contacts([]) is the robot without contacts")
    return f": the wrenches of its contacts would enter{without}" if m.contacts else None


_CLOSE_LOOPS = Remedy("; robot.closed(loops, actuated) closes some")

ELASTIC = Need(_rigid_joints)
CLOSED = Need(_open_tree)  # coordinates that others follow, by loops or by constant ratios
CUT_JOINTS = Need(_uncut_tree)  # loops, whose constraints are solved for followers with constant ratios too
ON_CONTACTS = Need(_no_contacts)
WITHOUT_CONTACTS = Need(_contacts)  # what these do would enter
