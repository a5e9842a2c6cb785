"""Finding: one result of an audit."""

from dataclasses import dataclass

from jounce.core.errors import join_names
from jounce.core.typing import JsonObject

SEVERITIES = {
    "error": "physically impossible, or leaves the mass matrix singular",
    "warning": "possible, but probably a mistake",
    "note": "good to know",
}


@dataclass(frozen=True, kw_only=True)
class Finding:
    """One finding of an audit of a robot's data: where, what, by how much, and what to do about it.

    Parameters
    ----------
    severity : str
        "error": physically impossible, or a singular mass matrix; "warning": possible, but probably a mistake;
        "note": for information.
    kind : str
        What was checked, in two or three words: "triangle inequality", "placeholder inertia", "effort limit", ...
    bodies, joints : tuple of str
        Where it was found; both empty where it is the robot as a whole.
    number : float
        What was measured, in `unit`: of several bodies, the number of the one that is farthest off.
    unit : str
        An SI unit, or what is counted.
    text : str
        What was found, in a line that holds the number.
    advice : str
        What to do.

    Examples
    --------
    >>> import jounce
    >>> finding = jounce.load("iiwa14").audit()[0]
    >>> finding.severity, finding.kind, finding.bodies, finding.unit
    ('error', 'triangle inequality', ('link4',), 'kg m^2')
    """

    severity: str
    kind: str
    bodies: tuple[str, ...] = ()
    joints: tuple[str, ...] = ()
    number: float
    unit: str
    text: str
    advice: str

    @property
    def where(self) -> str:
        """The bodies or joints in a row, or "robot"."""
        return join_names(self.bodies or self.joints, most=8) or "robot"

    def __str__(self) -> str:
        return f"{self.where}: {self.text}"

    def as_data(self) -> JsonObject:
        """The finding as plain data, ready for JSON."""
        return vars(self) | {"bodies": list(self.bodies), "joints": list(self.joints)}
