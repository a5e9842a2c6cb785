"""Audits a robot's data: physically impossible values, and values that suggest a mistake.

`audit` runs all `CHECKS` in a row and returns their findings, errors first. Each check looks at one kind of data of a
mechanism, and yields a `Finding` for all bodies or joints concerned. They are of four groups:

* inertias that no body can have, placeholders, and joints that move none;
* orders of magnitude: lengths, masses and moments in other units than m, kg and kg m^2, and odd gravity;
* limits and axes that a file leaves out, and limits in degrees;
* names that are formulas.

The sharpest test of units, `check_densities`, needs no scale: the second moments of a mass m within any shape of
density rho are at least those of a ball of it, ``tr P >= 3/5 m R^2`` with ``m = 4/3 pi rho R^3``, so that from mass and
moments follows a density that the body exceeds somewhere. Where the moments are large, the density of the ellipsoid
that has them says by how much.
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
        """The finding as plain data, ready for JSON."""
        return vars(self) | {"bodies": list(self.bodies), "joints": list(self.joints)}


# Inertias that no body can have, and joints that move none.
_TENSOR_TOLERANCE = 1e-9  # of the largest entry of a tensor: less is rounding, and breaks no law
_MOMENT_TOLERANCE = 1e-6  # relative: what poses and Steiner's theorem leave of copied moments
_MEASURE = "take it from CAD, a data sheet or an identification"


def check_inertias(mechanism: Mechanism) -> list[Finding]:
    """Negative masses and moments, and principal moments that break the triangle inequality.

    Second moments about the COM that are positive semidefinite are the same as: principal moments non-negative and
    within the triangle inequality.
    """
    found = [_find_defect(body, M) for body, M in zip(mechanism.bodies, mechanism.M, strict=True)]
    return [finding for finding in found if finding is not None]


def _find_defect(body: str, M: np.ndarray) -> Finding | None:
    error = partial(Finding, severity="error", bodies=(body,))
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
    """Tensors of one round number times the identity, and the same tensor on bodies of different mass."""
    M = mechanism.M
    massive = np.flatnonzero(M[:, 3, 3] > 0)
    moments = np.array([inertia.principal_moments(M[i]) for i in massive]).reshape(-1, 3)
    left = np.ones(len(massive), dtype=bool)
    for i, own in zip(massive, moments, strict=True):
        alike = massive[left & np.isclose(moments, own, rtol=_MOMENT_TOLERANCE, atol=0).all(axis=1)]
        if i not in alike or is_point(M[i]):
            continue
        left &= ~np.isin(massive, alike)
        masses = M[alike, 3, 3]
        if _is_round(own):
            text = f"moments about the COM are {own[0]:.3g} kg m^2 times the identity"
        elif max(masses) > 1.01 * min(masses):
            spread = f"from {min(masses):.3g} to {max(masses):.3g} kg"
            text = f"the same principal moments, up to {own[2]:.3g} kg m^2, on {len(alike)} bodies {spread}"
        else:
            continue
        yield _describe_placeholder(mechanism, alike.tolist(), float(own[2]), "kg m^2", text, "inertia")


def check_unit_masses(mechanism: Mechanism) -> Iterator[Finding]:
    """Masses of exactly 1 kg on most bodies, at least three."""
    masses = mechanism.M[:, 3, 3]
    ones = [i for i, mass in enumerate(masses) if mass == 1]
    if len(ones) < 3 or 2 * len(ones) <= len(masses):
        return
    text = f"mass 1 kg on {len(ones)} of {len(masses)} bodies"
    yield _describe_placeholder(mechanism, ones, 1.0, "kg", text, "mass")


def check_point_masses(mechanism: Mechanism) -> Iterator[Finding]:
    """Bodies with mass and no moments about their COM."""
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
    """Whether a body with mass has no moments about its COM beyond rounding."""
    return bool(np.abs(inertia.principal_moments(M)).max() <= _TENSOR_TOLERANCE * np.abs(M[:3, :3]).max())


def _is_round(moments: np.ndarray) -> bool:
    """Whether three moments are one number of one digit, such as 1, 0.1 or 0.002."""
    number = float(f"{moments[2]:.0e}")
    return bool(np.allclose(moments, number, rtol=_MOMENT_TOLERANCE, atol=0))


def _describe_placeholder(
    mechanism: Mechanism, bodies: Sequence[int], number: float, unit: str, text: str, what: str
) -> Finding:
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
    return tuple(mechanism.bodies[i] for i in bodies)


def check_massless(mechanism: Mechanism) -> Iterator[Finding]:
    """Find massless bodies: those that carry mass, which have no effect, and those that carry none."""
    between, tips = map(np.flatnonzero, mobility.find_massless(mechanism))
    if between.size:
        yield Finding(
            severity="note",
            kind="massless",
            bodies=_body_names(mechanism, between),
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
    """Coordinates that move without kinetic energy in every configuration: no forward dynamics, no ``M^-1``."""
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
    """Bodies that would be denser than osmium or lighter than air: masses or moments off by powers of 1000."""
    dense, thin = {}, {}
    for i, M in enumerate(mechanism.M):
        if not M[3, 3] > 0 or is_point(M):
            continue
        principal = inertia.principal_moments(M)
        if not principal[2] > 0:  # an error already
            continue
        P = np.maximum(principal.sum() / 2 - principal, 0) / M[3, 3]  # principal second moments, a unit of mass
        ball, ellipsoid = _ball(P.sum()), _ellipsoid(P)
        if ball > 0 and M[3, 3] / ball > _OSMIUM_DENSITY:
            dense[i] = float(M[3, 3] / ball)
        elif ellipsoid > 0 and 0 < M[3, 3] / ellipsoid < _AIR_DENSITY:
            thin[i] = float(M[3, 3] / ellipsoid)
    yield from _density(mechanism, dense, max, "small", "denser than osmium, the densest metal")
    yield from _density(mechanism, thin, min, "large", "lighter than air")


def _ball(trace: float) -> float:
    """The volume of the ball whose second moments, a unit of mass, have the trace 3/5 R^2."""
    return float(4 / 3 * np.pi * (5 / 3 * trace) ** 1.5)


def _ellipsoid(P: np.ndarray) -> float:
    """The volume of the ellipsoid of the principal second moments, a unit of mass, a^2/5, b^2/5, c^2/5."""
    return float(4 / 3 * np.pi * np.sqrt(np.prod(5 * P)))


def _density(
    mechanism: Mechanism, found: dict[int, float], worst: Callable[..., int], what: str, like: str
) -> Iterator[Finding]:
    if not found:
        return
    i = worst(found, key=found.__getitem__)
    M, names = mechanism.M[i], mechanism.bodies
    k = float(np.sqrt(inertia.principal_moments(M)[2] / M[3, 3]))
    off = f"moments {(_WATER_DENSITY / found[i]) ** (2 / 3):.2g} times those of as much water"
    most = f"; {names[i]} most" if len(found) > 1 else ""
    gyration = f"{M[3, 3]:.3g} kg with a radius of gyration of {k:.2g} m"
    yield Finding(
        severity="warning",
        kind="density",
        bodies=tuple(names[j] for j in found),
        number=found[i],
        unit="kg/m^3",
        text=f"moments too {what} for the mass, {like}{most}: {gyration}, {found[i]:.2g} kg/m^3; {off}",
        advice="mass in kg, lengths in m, moments in kg m^2 about the COM: 1 g = 1e-3 kg, 1 kg mm^2 = 1e-6 kg m^2",
    )


def check_masses(mechanism: Mechanism) -> Iterator[Finding]:
    """Masses a factor of 1000 and more from the median."""
    m, names = mechanism.M[:, 3, 3], mechanism.bodies
    median = float(np.median(m[m > 0])) if np.any(m > 0) else 0.0
    off = [i for i in range(len(m)) if m[i] > 0 and not 1 / _MAX_MASS_RATIO < m[i] / median < _MAX_MASS_RATIO]
    if not off:
        return
    i = max(off, key=lambda i: abs(np.log(m[i] / median)))
    ratio = f"{m[i] / median:.2g} times the median of this robot, {median:.3g} kg"
    yield Finding(
        severity="warning",
        kind="mass",
        bodies=tuple(names[k] for k in off),
        number=float(m[i]),
        unit="kg",
        text=f"mass {m[i]:.3g} kg{f' of {names[i]}' if len(off) > 1 else ''} is {ratio}",
        advice="masses are in kg: 1 g = 1e-3 kg",
    )


def check_sizes(mechanism: Mechanism) -> Iterator[Finding]:
    """A robot of tens of metres or few millimetres, and COMs far beyond a robot's size from their joint."""
    points = positions.anchors(mechanism)
    size, reach = _size(mechanism, points), _reach(mechanism, points)
    span = size or max(reach)
    if span > 0 and not _MIN_ROBOT_SIZE <= span <= _MAX_ROBOT_SIZE:
        between = "between its joints" if size else "from its joint to a COM"
        yield Finding(
            severity="warning",
            kind="size",
            number=span,
            unit="m",
            text=f"measures {span:.3g} m {between}",
            advice="lengths are in m: 1 mm = 1e-3 m; scale positions of joints and COMs, and moments",
        )
    far = [j for j, x in enumerate(reach) if size and x > max(_MAX_COM_DISTANCE * size, 5.0)]
    if far:
        k, bodies = max(far, key=reach.__getitem__), [mechanism.bodies[mechanism.owners[j]] for j in far]
        most = f" of {bodies[far.index(k)]}" if len(far) > 1 else ""
        yield Finding(
            severity="warning",
            kind="centre of mass",
            bodies=tuple(dict.fromkeys(bodies)),
            number=reach[k],
            unit="m",
            text=f"COM{most} lies {reach[k]:.3g} m from its joint, in a robot of {size:.3g} m between the joints",
            advice="positions of COMs are in m, in the frame of the body: 1 mm = 1e-3 m",
        )


def _size(mechanism: Mechanism, points: np.ndarray) -> float:
    """The largest distance between joints at theta = 0, of several trees on the ground the largest."""
    C, owners = reference_poses(mechanism), list(mechanism.owners)
    places = np.stack([C[i][:3, :3] @ x + C[i][:3, 3] for i, x in zip(owners, points, strict=True)])
    roots: list[int] = []
    for i, p in enumerate(mechanism.parent):
        roots.append(roots[p] if p >= 0 else i)
    of_root = np.array(roots)[owners]
    trees = [places[of_root == root] for root in set(of_root.tolist())]
    size = max(float(np.linalg.norm(tree - x, axis=-1).max()) for tree in trees for x in tree)
    return size if size > _MEETING_AXES * robot_size(mechanism) else 0.0


def _reach(mechanism: Mechanism, points: np.ndarray) -> list[float]:
    """The distance of the COM of each body from the joint that moves it; 0 of the massless."""
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
    likely = g == 0 or _PLANET_GRAVITY[0] <= g <= _PLANET_GRAVITY[1]
    text = "no gravity" if g == 0 else f"gravity is {g:.4g} m/s^2"
    advice = (
        "correct in orbit" if g == 0 else "correct on another planet" if likely else "not the gravity of any planet"
    )
    yield Finding(
        severity="note" if likely else "warning",
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
    """Effort and velocity limits that are missing or zero, of the joints that are driven; a finding for each kind."""
    alone = single_variables(mechanism).values()  # no motor turns a ball
    driven = sorted({*alone} & {*coordinates.leading_joints(mechanism)})  # what follows others has no drive of its own
    for kind, act in (("effort", "exert a force"), ("velocity", "move")):
        stated, unit = getattr(mechanism.limits, kind)[driven], LIMIT_KINDS[kind].units
        missing, zero = np.isinf(stated), stated == 0
        everywhere = bool(missing.all())
        others = " on any joint" if everywhere else f", unlike the other {int((~missing).sum())}"
        if missing.any():
            yield Finding(
                severity="note" if everywhere else "warning",
                kind=f"{kind} limit",
                joints=tuple(mechanism.joints[i] for i in np.compress(missing, driven)),
                number=float(missing.sum()),
                unit="joints",
                text=f"no {kind} limit{others}",
                advice=f"nothing checks a motion against it; state {kind}= in {unit}",
            )
        if zero.any():
            yield Finding(
                severity="warning",
                kind=f"{kind} limit",
                joints=tuple(mechanism.joints[i] for i in np.compress(zero, driven)),
                number=0.0,
                unit=unit,
                text=f"{kind} limit 0: the joint could never {act}",
                advice=f"state that of the drive in {unit}, or omit it if it is unknown",
            )


def check_degrees(mechanism: Mechanism) -> Iterator[Finding]:
    """Position limits of revolute joints that look like degrees."""
    largest = np.maximum(
        *(np.nan_to_num(np.abs(x), posinf=0) for x in (mechanism.limits.lower, mechanism.limits.upper))
    )
    found = np.flatnonzero(
        mechanism.X[:, :3].any(axis=1) & (largest > coordinates.MAX_UNLIMITED_ANGLE) & (largest <= _MAX_DEGREES)
    )
    if not found.size:
        return
    worst = float(largest[found].max())
    yield Finding(
        severity="warning",
        kind="position limit",
        joints=tuple(mechanism.joints[i] for i in found),
        number=worst,
        unit="rad",
        text=f"position limit of up to {worst:.4g} rad, {worst / (2 * np.pi):.3g} turns: it looks like degrees",
        advice=f"limits are in rad: {worst:.4g} deg are {np.deg2rad(worst):.4g} rad",
    )


def check_axes(mechanism: Mechanism) -> Iterator[Finding]:
    """Joints whose axis the file leaves out."""
    found = tuple(joint for joint in mechanism.default_axes if joint in mechanism.joints)
    if not found:
        return
    yield Finding(
        severity="note",
        kind="axis",
        joints=found,
        number=float(len(found)),
        unit="joints",
        text="the file states no <axis>: the axis is the format's default, 1 0 0",
        advice='state it: <axis xyz="1 0 0"/>',
    )


def check_formulas(mechanism: Mechanism) -> list[Finding]:
    """Names of joints and links that a spreadsheet computes: they are heads of columns, and cells of tables."""
    joints = tuple(name for name in mechanism.joints if name.startswith(FORMULA_STARTS))
    links = tuple(name for name in mechanism.frame_names if name.startswith(FORMULA_STARTS))
    return [
        Finding(
            severity="warning",
            kind="name",
            bodies=() if of == "joints" else names,
            joints=names if of == "joints" else (),
            number=float(len(names)),
            unit=of,
            text=f"the name begins with {names[0][0]!r}: spreadsheets that open a CSV table execute it as a formula",
            advice="rename it in the file, or import tables as text",
        )
        for of, names in (("joints", joints), ("links", links))
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
    """Check the data of a mechanism of numbers, and return the findings, errors first."""
    if not mechanism.is_numeric:
        raise JounceError(f"robot {mechanism.name!r} contains symbols; an audit needs numbers")
    with np.errstate(all="ignore"):  # of numbers near the ends of the doubles, which are not judged
        found = [finding for check in CHECKS for finding in check(mechanism)]
    return tuple(sorted(found, key=lambda finding: list(SEVERITIES).index(finding.severity)))
