"""What a robot is: its mechanism under the names that users know, judged, locked, with drives or without."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Self

from jounce._scalars import Array
from jounce.errors import JounceError
from jounce.model.drives import Drives, chosen, with_eps
from jounce.model.locking import locked
from jounce.model.mechanism import Limits, Mechanism

if TYPE_CHECKING:
    from jounce.checks.audit import Finding


@dataclass(frozen=True, eq=False, repr=False)
class Data:
    """A mechanism in a user's hands: how it is built, what it is called."""

    mechanism: Mechanism

    def __post_init__(self) -> None:
        if not isinstance(self.mechanism, Mechanism):
            raise JounceError(
                f"a Robot is made of a Mechanism, not of {type(self.mechanism).__name__}; try jounce.load"
            )

    def __repr__(self) -> str:
        return f"<Robot {self.name!r}: {self.n} coordinates, {self.mechanism.nb} bodies>"

    @property
    def name(self) -> str:
        """The robot's name."""
        return self.mechanism.name

    @property
    def n(self) -> int:
        """The number of coordinates."""
        return self.mechanism.n

    @property
    def joint_names(self) -> tuple[str, ...]:
        """The names of the coordinates, in the order of the last axis of q."""
        return self.mechanism.coordinates

    @property
    def body_names(self) -> tuple[str, ...]:
        """The names of the bodies, in the order of the rows of wrenches, poses and Jacobians."""
        return self.mechanism.bodies

    @property
    def gravity(self) -> Array:
        """The gravitational acceleration in the inertial frame, m/s^2."""
        return self.mechanism.gravity

    @property
    def limits(self) -> Limits:
        """What bounds the nb joint variables: `lower`, `upper`, `velocity`, `effort`, (nb,) each, SI units.

        Infinite where nothing is stated. They do not enter Q.
        """
        return self.mechanism.limits

    @property
    def drives(self) -> Drives:
        """The drive trains as stated: `armature`, `damping`, `friction`, `eps`, `stiffness`, `rest`, (nb,) each.

        Of the nb joint variables, SI units. They enter Q where `with_drives` or ``load(..., drives=True)`` says so.
        """
        return self.mechanism.drives

    def with_drives(self, terms: bool | str | Iterable[str] = True, eps: float | None = None) -> Self:
        """The same robot with some terms of its drives in Q, the armature in M too: all, none, or those named.

        ``Q_theta = armature theta'' + damping theta' + friction tanh(theta' / eps) + stiffness (theta - rest)`` of the
        joint variables theta = G q + g; Q gains ``G^T Q_theta`` and M ``G^T diag(armature) G``, with exact rates.

        Parameters
        ----------
        terms : bool, str or several
            "armature", "damping", "friction", "spring"; True for all, False for none.
        eps : float
            Speed in rad/s or m/s over which friction turns over; that of each joint (0.05 unless stated) if left out.

        Examples
        --------
        >>> import jounce
        >>> arm = jounce.Robot(jounce.load("planar2r").mechanism)
        >>> arm.with_drives("armature").mechanism.acting
        ('armature',)
        """
        drives = self.drives if eps is None else with_eps(self.drives, eps)
        return type(self)(replace(self.mechanism, acting=chosen(terms), drives=drives))

    def locked(self, values: Mapping[str, float]) -> Self:
        """The robot with some joints held at values, {joint: rad or m}: their bodies merge into those that carry them.

        Examples
        --------
        >>> import jounce
        >>> jounce.load("iiwa14").locked({"joint3": 0.0, "joint7": 0.5}).n
        5
        """
        return type(self)(locked(self.mechanism, values))

    def audit(self) -> "tuple[Finding, ...]":
        """What in the data no body can have, or looks like a mistake: findings, errors first; empty where all is well.

        Inertias that are not positive semidefinite or break the triangle inequality, placeholders, massless bodies and
        a singular mass matrix, masses, lengths and moments off by powers of 1000, missing effort and velocity limits,
        odd gravity. See `jounce.checks.audit.Finding`.

        Raises
        ------
        JounceError
            Where the robot holds symbols.

        Examples
        --------
        >>> import jounce
        >>> for finding in jounce.load("planar2r").audit():
        ...     print(finding.severity, finding)
        note body1, body2: mass, 1 kg at most, without moments about its COM
        note joint1, joint2: no effort limit on any joint
        note joint1, joint2: no velocity limit on any joint
        """
        from jounce.checks.audit import audit  # what few programs need

        return audit(self.mechanism)
