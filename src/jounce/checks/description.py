"""The description of a robot: what `jounce info` shows, as text or JSON."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from jounce.checks.audit import Finding, audit
from jounce.core.typing import JsonObject
from jounce.dynamics.loops import movers
from jounce.model import coordinates, positions
from jounce.model.limits import LIMIT_KINDS, Limits
from jounce.model.mechanism import Mechanism, body_name
from jounce.model.polynomials import polynomial_laws
from jounce.model.transmissions import with_followers
from jounce.spatial import inertia

_PITCH_ROUNDING = 1e-12  # of the distance to the axis, m/rad: a joint with a smaller pitch is a hinge


@dataclass(frozen=True)
class VariableDescription:
    """A joint variable: of a joint, or one of its several velocities."""

    joint: str
    type: str
    unit: str | None
    extent: str | None
    axis: list[float] | None
    pitch: float | None
    follows: str | None
    limits: Mapping[str, Any] | None  # numbers, pairs of bounds, and None for missing limits
    drive: Mapping[str, float] | None


@dataclass(frozen=True)
class InertiaDescription:
    """The mass, COM and principal moments of a body.

    The latter are None if it has no mass.
    """

    mass: float
    com: list[float] | None
    principal_moments: list[float] | None
    triangle_slack: float | None


@dataclass(frozen=True)
class BodyDescription:
    """A body and the joint that moves it.

    The joint has `nq` numbers in q, and `nv` velocities.
    """

    name: str
    parent: str
    joint: VariableDescription
    nq: int
    nv: int
    velocities: tuple[VariableDescription, ...]
    inertia: InertiaDescription

    @property
    def variables(self) -> tuple[VariableDescription, ...]:
        """The joint variables that have limits and drives of their own."""
        return self.velocities or (self.joint,)

    def json(self) -> JsonObject:
        """Return the body as plain data, with its joint and inertia."""
        data = {"name": self.name, "parent": self.parent, **asdict(self.joint), "nq": self.nq, "nv": self.nv}
        return data | {"velocities": [asdict(x) for x in self.velocities], **asdict(self.inertia)}


@dataclass(frozen=True)
class RobotDescription:
    """The names, tree, joints, inertias and findings of a robot."""

    mechanism: Mechanism
    base: InertiaDescription | None
    elastic: Mapping[str, Mapping[str, float | None]] | None
    bodies: tuple[BodyDescription, ...]
    findings: tuple[Finding, ...]

    @property
    def mass(self) -> float:
        """The mass of the moving bodies, kg."""
        return float(self.mechanism.M[:, 3, 3].sum())

    @property
    def coordinate_units(self) -> dict[str, str]:
        """The unit of each coordinate: rad or m."""
        return dict(zip(self.mechanism.coordinates, coordinates.units(self.mechanism), strict=True))

    @property
    def following(self) -> list[str]:
        """The coordinates that follow others in closed loops."""
        m = self.mechanism
        return [name for name in m.tree.coordinates if name not in m.coordinates]

    @property
    def moved_by(self) -> Mapping[str, str]:
        """The mover of each joint of a closed robot: motor, spring, or nothing."""
        return movers(self.mechanism) if self.mechanism.is_closed else {}

    @property
    def merged_links(self) -> dict[str, str]:
        """The bodies of merged links, by link."""
        return {frame.name: body_name(self.mechanism, frame.body) for frame in self.mechanism.frames}

    def json(self) -> JsonObject:
        """Return the description as plain data."""
        m = self.mechanism
        loops = [
            {"frames": [loop.a.name, loop.b.name], "joint": loop.joint, "axis": np.asarray(loop.axis).tolist()}
            for loop in m.loops
        ]
        return {
            "name": m.name,
            "n": m.n,
            "nq": positions.whole_count(m),
            "nv": m.nv,
            "nb": len(m.moving_bodies),
            "gravity": m.gravity.tolist(),
            "mass": self.mass,
            "base": self.base and {"name": m.base_body, **asdict(self.base)},
            "coordinates": [{"name": name, "unit": unit} for name, unit in self.coordinate_units.items()],
            "positions": list(positions.names(m)),
            "acting": list(m.acting),
            "limits": dict.fromkeys(LIMIT_KINDS.totals) | m.limits.stated_totals,
            "elastic": self.elastic,
            "loops": loops,
            "contacts": [{"frame": contact.frame, "kind": contact.kind} for contact in m.contacts],
            "following": self.following,
            "moved_by": self.moved_by,
            "bodies": [body.json() for body in self.bodies],
            "merged_links": self.merged_links,
            "findings": [finding.as_data() for finding in self.findings],
        }


def describe(mechanism: Mechanism) -> RobotDescription:
    """Describe a mechanism of numbers."""
    # Joints of motors that move others together follow these by ratios, those of cams by polynomials.
    whole = with_followers(mechanism)
    laws = {name: law.words for name, law in polynomial_laws(mechanism).items()}
    bodies = tuple(_with_law(_body(whole, i), laws) for i in mechanism.moving_bodies)
    base = _inertia(mechanism.M[0]) if mechanism.base_body else None
    elastic = None if mechanism.elasticity is None else _elastic(mechanism)
    return RobotDescription(mechanism, base, elastic, bodies, tuple(audit(mechanism)))


def _elastic(mechanism: Mechanism) -> dict[str, dict[str, float | None]]:
    """Return the springs and motors of each coordinate.

    The infinite stiffness of a rigid joint is None.
    """
    arrays = mechanism.elasticity.arrays if mechanism.elasticity else {}
    return {
        name: {key: float(array[j]) if np.isfinite(array[j]) else None for key, array in arrays.items()}
        for j, name in enumerate(mechanism.coordinates)
    }


def _body(mechanism: Mechanism, i: int) -> BodyDescription:
    """Describe a body with its joint."""
    columns, multiscrew = mechanism.columns[i], positions.multiscrew_joints(mechanism).get(i)
    joint, velocities, nq = _variable(mechanism, columns[0]), tuple[VariableDescription, ...](), 1
    # A joint of several screws has no axis, limits or drive of its own, but those of its velocities.
    if multiscrew is not None:
        joint = VariableDescription(multiscrew.name, multiscrew.group.name, *[None] * 7)
        velocities, nq = tuple(_variable(mechanism, j) for j in columns), len(multiscrew.group.positions)
    name, parent = mechanism.bodies[i], body_name(mechanism, mechanism.parent[i])
    return BodyDescription(name, parent, joint, nq, len(columns), velocities, _inertia(mechanism.M[i]))


def _with_law(body: BodyDescription, laws: Mapping[str, str]) -> BodyDescription:
    """Return a body with the law of its joint in words."""
    joint = body.joint
    return replace(body, joint=replace(joint, follows=laws.get(joint.joint, joint.follows)))


def _variable(mechanism: Mechanism, j: int) -> VariableDescription:
    """Describe a joint variable."""
    X, kind = mechanism.X[j], joint_kind(mechanism, j)
    turns = bool(X[:3].any())
    return VariableDescription(
        joint=mechanism.joints[j],
        type=kind,
        unit="rad" if turns else "m",
        extent=_extent(mechanism, j),
        axis=(X[:3] if turns else X[3:]).tolist(),
        pitch=float(X[:3] @ X[3:]) if kind == "helical" else None,
        follows=_describe_dependence(mechanism, j),
        limits=dict.fromkeys(LIMIT_KINDS.bound_names) | mechanism.limits.stated(j),
        drive={key: float(array[j]) for key, array in vars(mechanism.drives).items()},
    )


def _extent(mechanism: Mechanism, j: int) -> str | None:
    """Return the position that limits bound for a joint variable.

    It is None for joints of one screw, and for others stands in the place of a velocity.
    """
    i = mechanism.owners[j]
    joint = positions.multiscrew_joints(mechanism).get(i)
    return None if joint is None else joint.group.extents[mechanism.columns[i].index(j)]


def joint_kind(mechanism: Mechanism, j: int) -> str:
    """Return the kind of the joint of a joint variable.

    It is revolute, prismatic, helical or, with several screws, ball, planar or free.
    """
    joint, X = positions.multiscrew_joints(mechanism).get(mechanism.owners[j]), mechanism.X[j]
    if joint is not None:
        return joint.group.name
    if not X[:3].any():
        return "prismatic"
    return "helical" if abs(X[:3] @ X[3:]) > _PITCH_ROUNDING * np.abs(X[3:]).max() else "revolute"


def _inertia(M: np.ndarray) -> InertiaDescription:
    """Describe the inertia of a body."""
    m, h, _ = inertia.moments(M)
    mass = float(m[0, 0])
    if not mass:
        return InertiaDescription(mass, None, None, None)
    principal = inertia.principal_moments(M)
    return InertiaDescription(mass, (h[:, 0] / mass).tolist(), principal.tolist(), inertia.triangle_slack(principal))


def _describe_dependence(mechanism: Mechanism, i: int) -> str | None:
    """Describe how a joint variable depends on coordinates.

    It is None if the variable is a coordinate.
    """
    row, offset = mechanism.G[i], float(mechanism.g[i])
    terms = [f"{_factor(row[j])}{mechanism.coordinates[j]}" for j in np.flatnonzero(row)]
    is_coordinate = len(terms) == 1 and row.sum() == 1 and offset == 0 and mechanism.joints[i] in mechanism.coordinates
    if is_coordinate:
        return None
    if offset != 0:
        terms.append(f"{offset:g}")
    return " + ".join(terms).replace("+ -", "- ") if len(terms) > 0 else "0"


def _factor(x: float) -> str:
    """Return a factor as it stands before a name."""
    return {1.0: "", -1.0: "-"}.get(x, f"{x:g} ")


def totals_in_words(limits: Limits) -> tuple[str, ...]:
    """Return the limits of the whole robot, one sentence for each."""
    return tuple(
        f"{kind.replace('_', ' ')} of the robot: {_range_in_words(value)} {LIMIT_KINDS[kind].units}"
        for kind, value in limits.stated_totals.items()
    )


def limit_in_words(variable: VariableDescription, kind: str) -> str:
    """Return the limit of a joint variable with its unit, or "-"."""
    # A joint of several screws has limits on its velocities only.
    if variable.limits is None or variable.unit is None:
        return "-"
    limits, unit = variable.limits, LIMIT_KINDS[kind].unit(variable.unit)
    value = [limits["lower"], limits["upper"]] if kind == "position" else limits[kind]
    if value in (None, [None, None]):
        return "-"
    extent = f"{variable.extent} " if kind == "position" and variable.extent else ""
    return f"{extent}{_range_in_words(value)} {unit}"


def _range_in_words(value: float | list[float | None]) -> str:
    """Return a bound of both directions, or two.

    One of two may be missing.
    """
    ends = zip(value, ("-inf", "inf"), strict=True) if isinstance(value, list) else [(value, "")]
    return " .. ".join(infinity if x is None else f"{x:.5g}" for x, infinity in ends)
