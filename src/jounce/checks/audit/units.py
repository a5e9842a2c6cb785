"""Orders of magnitude: lengths, masses and moments in other units than m, kg and kg m^2, and odd gravity.

The sharpest of these tests needs no scale: the second moments of a mass m within any shape of density rho are at
least those of a ball of it, ``tr P >= 3/5 m R^2`` with ``m = 4/3 pi rho R^3``, so that from mass and moments follows a
density that the body exceeds somewhere. Where the moments are large, the density of the ellipsoid that has them says by
how much.
"""

from collections.abc import Callable, Iterator

import numpy as np

from jounce.checks.audit.finding import Finding
from jounce.checks.audit.inertias import is_point
from jounce.core.cures import Remedy
from jounce.model.mechanism import Mechanism, reference_poses, robot_size
from jounce.model.positions import anchors
from jounce.spatial import inertia

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
    points = anchors(mechanism)
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
