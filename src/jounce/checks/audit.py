"""Audits a robot's data for impossible values and likely mistakes.

`audit` runs all `CHECKS` in a row and returns their findings, errors first. Each check examines one kind of data of a
mechanism, and yields a `Finding` for all bodies or joints concerned. There are four groups of checks:

* inertias that no body can have, placeholders, and joints that move none;
* orders of magnitude: lengths, masses and moments in other units than m, kg and kg m^2, and odd gravity;
* limits and axes that a file leaves out, and limits in degrees;
* names that are formulas.

The sharpest test of units, `check_densities`, needs no scale. The second moments of a mass m within any shape of
density rho are at least those of a ball, ``tr P >= 3/5 m R^2`` with ``m = 4/3 pi rho R^3``. Mass and moments hence give
a density that the body exceeds somewhere. If the moments are too large, the density of the ellipsoid with these moments
is too low.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from jounce.core.cures import Remedy
from jounce.core.errors import JounceError, join_names
from jounce.core.typing import JsonObject
from jounce.dynamics import mobility
from jounce.model import coordinates, positions
from jounce.model.limits import LIMIT_KINDS
from jounce.model.mechanism import Mechanism, reference_poses, robot_size, single_variables
from jounce.spatial import inertia

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
        """Return the finding as plain data for JSON."""
        return vars(self) | {"bodies": list(self.bodies), "joints": list(self.joints)}


# Inertias that no body can have, and joints that move none.
_TENSOR_TOLERANCE = 1e-9  # of the largest entry of a tensor: smaller violations are rounding
_MOMENT_TOLERANCE = 1e-6  # relative: poses and Steiner's theorem change copied moments by rounding
_MEASURE = "take it from CAD, a data sheet or an identification"


def check_inertias(mechanism: Mechanism) -> list[Finding]:
    """Find negative masses and moments, and violations of the triangle inequality.

    Second moments about the COM are positive semidefinite if and only if the principal moments are non-negative and
    keep the triangle inequality.
    """
    defects = [_find_defect(body, M) for body, M in zip(mechanism.bodies, mechanism.M, strict=True)]
    return [finding for finding in defects if finding is not None]


def _find_defect(body: str, M: np.ndarray) -> Finding | None:
    """Return the finding of a body whose inertia no body can have."""
    error = partial(Finding, severity="error", bodies=(body,))
    # The first defect counts: moments have no meaning where the mass is negative, nor a slack where one is negative.
    mass, largest = float(M[3, 3]), float(np.abs(M[:3, :3]).max())
    if mass < 0:
        text, advice = (
            f"mass {mass:g} kg is negative",
            "state the mass of the body, or omit the mass of a massless body",
        )
        return error(kind="negative mass", number=mass, unit="kg", text=text, advice=advice)
    if mass == 0:
        text, advice = "massless, yet with moments of inertia", "state a mass, or no inertia"
        massless = error(kind="moments without mass", number=largest, unit="kg m^2", text=text, advice=advice)
        return massless if np.any(M) else None
    principal = inertia.principal_moments(M)
    least, slack = float(principal[0]), inertia.triangle_slack(principal)
    if least < -_TENSOR_TOLERANCE * largest:
        text = f"principal moment {least:.3g} kg m^2 about the COM is negative"
        advice = "check the signs of the products of inertia, and that the tensor is about the COM, not the link frame"
        return error(kind="negative moment", number=least, unit="kg m^2", text=text, advice=advice)
    if slack < -_TENSOR_TOLERANCE * largest:
        share = f"{-100 * slack / float(principal[2]):.2g} % of the largest"
        text = f"principal moments about the COM violate the triangle inequality by {-slack:.3g} kg m^2, {share}"
        advice = "keep more digits or use the nearest valid tensor; a large violation is a wrong axis, sign or order"
        return error(kind="triangle inequality", number=slack, unit="kg m^2", text=text, advice=advice)
    return None


def check_placeholders(mechanism: Mechanism) -> Iterator[Finding]:
    """Find tensors that are placeholders.

    They are one round number times the identity, or the same on bodies of different mass.
    """
    M = mechanism.M
    massive = np.flatnonzero(M[:, 3, 3] > 0)
    moments = np.array([inertia.principal_moments(M[i]) for i in massive]).reshape(-1, 3)
    is_unassigned = np.ones(len(massive), dtype=bool)
    for i, principal in zip(massive, moments, strict=True):
        # Each body belongs to the group of the first body with the same moments, and is judged once.
        equal_bodies = massive[
            is_unassigned & np.isclose(moments, principal, rtol=_MOMENT_TOLERANCE, atol=0).all(axis=1)
        ]
        if i not in equal_bodies or is_point(M[i]):
            continue
        is_unassigned &= ~np.isin(massive, equal_bodies)
        masses = M[equal_bodies, 3, 3]
        if _is_round(principal):
            text = f"moments about the COM are {principal[0]:.3g} kg m^2 times the identity"
        elif max(masses) > 1.01 * min(masses):
            mass_range = f"from {min(masses):.3g} to {max(masses):.3g} kg"
            where = f"on {len(equal_bodies)} bodies {mass_range}"
            text = f"the same principal moments, up to {principal[2]:.3g} kg m^2, {where}"
        else:
            continue
        yield _describe_placeholder(mechanism, equal_bodies.tolist(), float(principal[2]), "kg m^2", text, "inertia")


def check_unit_masses(mechanism: Mechanism) -> Iterator[Finding]:
    """Find masses of exactly 1 kg on most bodies, at least three."""
    masses = mechanism.M[:, 3, 3]
    unit_bodies = [i for i, mass in enumerate(masses) if mass == 1]
    if len(unit_bodies) < 3 or 2 * len(unit_bodies) <= len(masses):
        return
    text = f"mass 1 kg on {len(unit_bodies)} of {len(masses)} bodies"
    yield _describe_placeholder(mechanism, unit_bodies, 1.0, "kg", text, "mass")


def check_point_masses(mechanism: Mechanism) -> Iterator[Finding]:
    """Find bodies with mass and no moments about their COM."""
    inertias = mechanism.M
    points = [i for i, M in enumerate(inertias) if M[3, 3] > 0 and is_point(M)]
    if not points:
        return
    heaviest = float(max(inertias[i, 3, 3] for i in points))
    yield Finding(
        severity="note",
        kind="point mass",
        bodies=_body_names(mechanism, points),
        number=heaviest,
        unit="kg",
        text=f"mass, {heaviest:.3g} kg at most, without moments about its COM",
        advice="fine for a point mass; otherwise state the moments of inertia",
    )


def is_point(M: np.ndarray) -> bool:
    """Whether a body with mass has no moments about its COM.

    Moments within rounding do not count.
    """
    return bool(np.abs(inertia.principal_moments(M)).max() <= _TENSOR_TOLERANCE * np.abs(M[:3, :3]).max())


def _is_round(moments: np.ndarray) -> bool:
    """Whether three moments are one number of one digit.

    Examples are 1, 0.1 and 0.002.
    """
    number = float(f"{moments[2]:.0e}")
    return bool(np.allclose(moments, number, rtol=_MOMENT_TOLERANCE, atol=0))


def _describe_placeholder(
    mechanism: Mechanism, bodies: Sequence[int], number: float, unit: str, text: str, what: str
) -> Finding:
    """Return the finding of a placeholder on some bodies."""
    return Finding(
        severity="warning",
        kind=f"placeholder {what}",
        bodies=_body_names(mechanism, bodies),
        number=number,
        unit=unit,
        text=f"{text}: a placeholder",
        advice=f"the forces are wrong until it is replaced; {_MEASURE}",
    )


def _body_names(mechanism: Mechanism, bodies: Iterable[int]) -> tuple[str, ...]:
    """Return the names of bodies."""
    return tuple(mechanism.bodies[i] for i in bodies)


def check_massless(mechanism: Mechanism) -> Iterator[Finding]:
    """Find massless bodies that carry mass, and massless tips.

    The former have no effect; the joints of the latter need no force.
    """
    carrying, tips = map(np.flatnonzero, mobility.find_massless(mechanism))
    if carrying.size:
        yield Finding(
            severity="note",
            kind="massless",
            bodies=_body_names(mechanism, carrying),
            number=0.0,
            unit="kg",
            text="massless, but carries bodies with mass: no effect on forces or mass matrix",
            advice="correct for an intermediate frame of a joint with several axes; otherwise state the inertia",
        )
    if tips.size:
        yield Finding(
            severity="warning",
            kind="massless tip",
            bodies=_body_names(mechanism, tips),
            number=0.0,
            unit="kg",
            text="massless, as is everything it carries: its joint needs no force",
            advice="state the inertia, or make the joint fixed",
        )


def check_singular(mechanism: Mechanism) -> Iterator[Finding]:
    """Find coordinates that move without kinetic energy in every configuration.

    There is no forward dynamics then, and no ``M^-1``.
    """
    rank, idle = mobility.idle_coordinates(mechanism)
    if not idle:
        return
    unit = "coordinates" if mechanism.base_body is None else "velocities"
    yield Finding(
        severity="error",
        kind="singular mass matrix",
        joints=idle,
        number=float(mechanism.nv - rank),
        unit=unit,
        text=f"moves no inertia{' together' if len(idle) > mechanism.nv - rank else ''}: "
        f"the mass matrix is singular, of rank {rank} for {mechanism.nv} {unit}",
        advice="inverse dynamics is not affected; for forward dynamics state the inertia, or fix the joint",
    )


# Orders of magnitude: lengths, masses and moments in other units, and odd gravity.
_OSMIUM_DENSITY = 22600.0  # kg/m^3, the densest metal: no link is denser
_WATER_DENSITY = 1000.0  # kg/m^3, to compare with: most links are near it
_AIR_DENSITY = 1.2  # kg/m^3: no link is lighter
_MIN_ROBOT_SIZE, _MAX_ROBOT_SIZE = 0.005, 50.0  # m between the joints: a factor of 1000 in units leaves this range
_MEETING_AXES = 1e-9  # of the size of the robot: axes that are as close meet but for rounding
_MAX_COM_DISTANCE = 3.0  # sizes of the robot, from a joint to the COM that it moves
_MAX_MASS_RATIO = 1000.0  # to the median mass: grams for kilograms
_EARTH_GRAVITY, _PLANET_GRAVITY = (9.7, 9.9), (1.0, 30.0)  # m/s^2: anywhere on Earth; from the Moon to Jupiter


def check_densities(mechanism: Mechanism) -> Iterator[Finding]:
    """Find bodies denser than osmium or lighter than air.

    Their masses or moments are off by powers of 1000.
    """
    dense, thin = {}, {}
    for i, M in enumerate(mechanism.M):
        if not M[3, 3] > 0 or is_point(M):
            continue
        principal = inertia.principal_moments(M)
        # Moments that are not positive are an error of `check_inertias`.
        if not principal[2] > 0:
            continue
        # Principal second moments per unit of mass, P = tr(I) / 2 - I.
        P = np.maximum(principal.sum() / 2 - principal, 0) / M[3, 3]
        ball, ellipsoid = _ball(P.sum()), _ellipsoid(P)
        if ball > 0 and M[3, 3] / ball > _OSMIUM_DENSITY:
            dense[i] = float(M[3, 3] / ball)
        elif ellipsoid > 0 and 0 < M[3, 3] / ellipsoid < _AIR_DENSITY:
            thin[i] = float(M[3, 3] / ellipsoid)
    yield from _density(mechanism, dense, max, "small", "denser than osmium, the densest metal")
    yield from _density(mechanism, thin, min, "large", "lighter than air")


def _ball(trace: float) -> float:
    """Return the volume of the ball with a trace of second moments.

    The trace per unit of mass is 3/5 R^2.
    """
    return float(4 / 3 * np.pi * (5 / 3 * trace) ** 1.5)


def _ellipsoid(P: np.ndarray) -> float:
    """Return the volume of the ellipsoid with these principal second moments.

    Per unit of mass they are a^2/5, b^2/5, c^2/5.
    """
    return float(4 / 3 * np.pi * np.sqrt(np.prod(5 * P)))


def _density(
    mechanism: Mechanism,
    densities: dict[int, float],
    select_worst: Callable[..., int],
    size_word: str,
    than_what: str,
) -> Iterator[Finding]:
    """Yield the finding of bodies with impossible densities, if there are any."""
    if not densities:
        return
    # The text describes the worst body: its radius of gyration, and its moments next to those of as much water.
    i = select_worst(densities, key=densities.__getitem__)
    M, names = mechanism.M[i], mechanism.bodies
    k = float(np.sqrt(inertia.principal_moments(M)[2] / M[3, 3]))
    comparison = f"moments {(_WATER_DENSITY / densities[i]) ** (2 / 3):.2g} times those of as much water"
    worst_name = f"; {names[i]} most" if len(densities) > 1 else ""
    gyration = f"{M[3, 3]:.3g} kg with a radius of gyration of {k:.2g} m"
    cause = f"moments too {size_word} for the mass, {than_what}{worst_name}"
    yield Finding(
        severity="warning",
        kind="density",
        bodies=tuple(names[j] for j in densities),
        number=densities[i],
        unit="kg/m^3",
        text=f"{cause}: {gyration}, {densities[i]:.2g} kg/m^3; {comparison}",
        advice="mass in kg, lengths in m, moments in kg m^2 about the COM: 1 g = 1e-3 kg, 1 kg mm^2 = 1e-6 kg m^2",
    )


def check_masses(mechanism: Mechanism) -> Iterator[Finding]:
    """Find masses off the median by a factor of 1000 or more."""
    m, names = mechanism.M[:, 3, 3], mechanism.bodies
    median = float(np.median(m[m > 0])) if np.any(m > 0) else 0.0
    outliers = [i for i in range(len(m)) if m[i] > 0 and not 1 / _MAX_MASS_RATIO < m[i] / median < _MAX_MASS_RATIO]
    if not outliers:
        return
    # The worst one is farthest from the median in orders of magnitude.
    i = max(outliers, key=lambda i: abs(np.log(m[i] / median)))
    ratio = f"{m[i] / median:.2g} times the median of this robot, {median:.3g} kg"
    yield Finding(
        severity="warning",
        kind="mass",
        bodies=tuple(names[k] for k in outliers),
        number=float(m[i]),
        unit="kg",
        text=f"mass {m[i]:.3g} kg{f' of {names[i]}' if len(outliers) > 1 else ''} is {ratio}",
        advice="masses are in kg: 1 g = 1e-3 kg",
    )


def check_sizes(mechanism: Mechanism) -> Iterator[Finding]:
    """Find robots of odd size, and COMs far from their joints.

    Sizes of tens of metres or few millimetres are odd; COMs are far beyond the size of the robot.
    """
    points = positions.anchors(mechanism)
    size, reach = _size(mechanism, points), _reach(mechanism, points)
    # A robot whose joint axes meet in one point is measured from its joints to its COMs.
    span = size or max(reach)
    if span > 0 and not _MIN_ROBOT_SIZE <= span <= _MAX_ROBOT_SIZE:
        measured_span = "between its joints" if size else "from its joint to a COM"
        yield Finding(
            severity="warning",
            kind="size",
            number=span,
            unit="m",
            text=f"measures {span:.3g} m {measured_span}",
            advice="lengths are in m: 1 mm = 1e-3 m; scale positions of joints and COMs, and moments",
        )
    # A COM is too far where it lies beyond several sizes of the robot, and metres away.
    far_joints = [j for j, x in enumerate(reach) if size and x > max(_MAX_COM_DISTANCE * size, 5.0)]
    if far_joints:
        k, bodies = max(far_joints, key=reach.__getitem__), [mechanism.bodies[mechanism.owners[j]] for j in far_joints]
        worst_name = f" of {bodies[far_joints.index(k)]}" if len(far_joints) > 1 else ""
        yield Finding(
            severity="warning",
            kind="centre of mass",
            bodies=tuple(dict.fromkeys(bodies)),
            number=reach[k],
            unit="m",
            text=f"COM{worst_name} lies {reach[k]:.3g} m from its joint, in a robot of {size:.3g} m between the joints",
            advice="positions of COMs are in m, in the frame of the body: 1 mm = 1e-3 m",
        )


def _size(mechanism: Mechanism, points: np.ndarray) -> float:
    """Return the largest distance between joints at theta = 0.

    Of several trees on the ground it is the largest one.
    """
    # Joints are compared within the tree that hangs at one root; trees may stand far apart.
    C, owners = reference_poses(mechanism), list(mechanism.owners)
    places = np.stack([C[i][:3, :3] @ x + C[i][:3, 3] for i, x in zip(owners, points, strict=True)])
    roots: list[int] = []
    for i, p in enumerate(mechanism.parent):
        roots.append(roots[p] if p >= 0 else i)
    root_of_joint = np.array(roots)[owners]
    trees = [places[root_of_joint == root] for root in set(root_of_joint.tolist())]
    size = max(float(np.linalg.norm(tree - x, axis=-1).max()) for tree in trees for x in tree)
    return size if size > _MEETING_AXES * robot_size(mechanism) else 0.0


def _reach(mechanism: Mechanism, points: np.ndarray) -> list[float]:
    """Return the distances of COMs from the joints that move them.

    They are 0 for massless bodies.
    """
    reach = []
    for M, x in zip(mechanism.M[list(mechanism.owners)], points, strict=True):
        m, h, _ = inertia.moments(M)
        reach.append(float(np.linalg.norm(h[:, 0] / m[0, 0] - x)) if m[0, 0] > 0 else 0.0)
    return reach


def check_gravity(mechanism: Mechanism) -> Iterator[Finding]:
    """Find gravity that is zero, of another planet, or of no planet."""
    g = float(np.linalg.norm(mechanism.gravity))
    if _EARTH_GRAVITY[0] <= g <= _EARTH_GRAVITY[1]:
        return
    is_planet = g == 0 or _PLANET_GRAVITY[0] <= g <= _PLANET_GRAVITY[1]
    text = "no gravity" if g == 0 else f"gravity is {g:.4g} m/s^2"
    if g == 0:
        advice = "correct in orbit"
    elif is_planet:
        advice = "correct on another planet"
    else:
        advice = "not the gravity of any planet"
    yield Finding(
        severity="note" if is_planet else "warning",
        kind="gravity",
        number=g,
        unit="m/s^2",
        text=f"{text}, on Earth it is 9.81 m/s^2",
        advice=f"{advice}; otherwise load with {Remedy('gravity=(0, 0, -9.81)', '--gravity 0 0 -9.81')}",
    )


# What a file states of joints: limits, axes and names.
_MAX_DEGREES = 720.0  # two turns: a larger position limit stands for no limit rather than for degrees
FORMULA_STARTS = ("=", "+", "-", "@", "\t", "\r")  # of cells that spreadsheets take for formulas


def check_stated_limits(mechanism: Mechanism) -> Iterator[Finding]:
    """Find missing or zero limits of effort and velocity, by kind.

    Only joints that are driven need them.
    """
    # Joints of several screws have no motors, and joints that follow others have no drives of their own.
    single_joints = single_variables(mechanism).values()
    driven = sorted({*single_joints} & {*coordinates.leading_joints(mechanism)})
    for kind, verb in (("effort", "exert a force"), ("velocity", "move")):
        limits, unit = getattr(mechanism.limits, kind)[driven], LIMIT_KINDS[kind].units
        missing, zero = np.isinf(limits), limits == 0
        if kind == "effort":
            missing &= ~np.isin(driven, _joints_of_limited_motors(mechanism))
        everywhere = bool(missing.all())
        where = " on any joint" if everywhere else f", unlike the other {int((~missing).sum())}"
        if missing.any():
            yield Finding(
                severity="note" if everywhere else "warning",
                kind=f"{kind} limit",
                joints=tuple(mechanism.joints[i] for i in np.compress(missing, driven)),
                number=float(missing.sum()),
                unit="joints",
                text=f"no {kind} limit{where}",
                advice=f"nothing checks a motion against it; state {kind}= in {unit}",
            )
        if zero.any():
            yield Finding(
                severity="warning",
                kind=f"{kind} limit",
                joints=tuple(mechanism.joints[i] for i in np.compress(zero, driven)),
                number=0.0,
                unit=unit,
                text=f"{kind} limit 0: the joint could never {verb}",
                advice=f"state that of the drive in {unit}, or omit it if it is unknown",
            )


def _joints_of_limited_motors(mechanism: Mechanism) -> list[int]:
    """Return joints that motors elsewhere move, if all motors are limited."""
    together = coordinates.shared_coordinates(mechanism)
    if len(together) == 0 or mechanism.closure is None:
        return []
    leaders = coordinates.leading_joints(mechanism.tree)
    motors = [leaders[j] for j in mechanism.closure.actuated if j not in mechanism.closure.independent]
    is_limited = np.isfinite(mechanism.limits.bounds("effort")[:, motors]).any(axis=0)
    return [leaders[j] for j in together] if is_limited.all() else []


def check_degrees(mechanism: Mechanism) -> Iterator[Finding]:
    """Find position limits of revolute joints that look like degrees."""
    # Limits beyond four turns look like degrees; limits beyond 720, two turns in degrees, stand for no limit.
    largest = np.maximum(
        *(np.nan_to_num(np.abs(x), posinf=0) for x in (mechanism.limits.lower, mechanism.limits.upper))
    )
    suspicious = np.flatnonzero(
        mechanism.X[:, :3].any(axis=1) & (largest > coordinates.MAX_UNLIMITED_ANGLE) & (largest <= _MAX_DEGREES)
    )
    if not suspicious.size:
        return
    worst = float(largest[suspicious].max())
    yield Finding(
        severity="warning",
        kind="position limit",
        joints=tuple(mechanism.joints[i] for i in suspicious),
        number=worst,
        unit="rad",
        text=f"position limit of up to {worst:.4g} rad, {worst / (2 * np.pi):.3g} turns: it looks like degrees",
        advice=f"limits are in rad: {worst:.4g} deg are {np.deg2rad(worst):.4g} rad",
    )


def check_axes(mechanism: Mechanism) -> Iterator[Finding]:
    """Find joints whose axis the file leaves out."""
    joints = tuple(joint for joint in mechanism.default_axes if joint in mechanism.joints)
    if not joints:
        return
    yield Finding(
        severity="note",
        kind="axis",
        joints=joints,
        number=float(len(joints)),
        unit="joints",
        text="the file states no <axis>: the axis is the format's default, 1 0 0",
        advice='state it: <axis xyz="1 0 0"/>',
    )


def check_formulas(mechanism: Mechanism) -> list[Finding]:
    """Find names of joints and links that a spreadsheet would compute.

    They are heads of columns and cells of tables.
    """
    joints = tuple(name for name in mechanism.joints if name.startswith(FORMULA_STARTS))
    links = tuple(name for name in mechanism.frame_names if name.startswith(FORMULA_STARTS))
    return [
        Finding(
            severity="warning",
            kind="name",
            bodies=() if unit == "joints" else names,
            joints=names if unit == "joints" else (),
            number=float(len(names)),
            unit=unit,
            text=f"the name begins with {names[0][0]!r}: spreadsheets that open a CSV table execute it as a formula",
            advice="rename it in the file, or import tables as text",
        )
        for unit, names in (("joints", joints), ("links", links))
        if names
    ]


CHECKS: tuple[Callable[[Mechanism], Iterable[Finding]], ...] = (
    check_inertias,
    check_singular,
    check_placeholders,
    check_unit_masses,
    check_densities,
    check_masses,
    check_sizes,
    check_massless,
    check_point_masses,
    check_stated_limits,
    check_degrees,
    check_axes,
    check_gravity,
    check_formulas,
)


def audit(mechanism: Mechanism) -> tuple[Finding, ...]:
    """Check the data of a mechanism, and return the findings, errors first.

    The mechanism is one of numbers.
    """
    if not mechanism.is_numeric:
        raise JounceError(f"robot {mechanism.name!r} contains symbols; an audit needs numbers")
    # Numbers near the limits of doubles overflow, and are not judged.
    with np.errstate(all="ignore"):
        findings = [finding for check in CHECKS for finding in check(mechanism)]
    return tuple(sorted(findings, key=lambda finding: list(SEVERITIES).index(finding.severity)))
