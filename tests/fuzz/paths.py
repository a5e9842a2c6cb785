"""Random paths and limits along them, for attacks on retiming."""

import warnings
from collections.abc import Callable

import numpy as np

from jounce import JounceError, JounceWarning, Motion, Robot

SEPTIC = np.array([-20.0, 70, -84, 35, 0, 0, 0, 0])  # from 0 to 1, the highest power first, at rest to the third rate
MOST_POINTS = 30
RATES = ("velocity", "acceleration", "jerk", "snap")
FORCES = ("effort", "effort_rate", "second_effort_rate")


def way_points(rng: np.random.Generator, n: int) -> np.ndarray:
    """(m, n): anywhere, nearly on a line, repeated as neighbours and far apart, closed, of one joint, tiny, long."""
    m = int(rng.choice([2, 2, 3, 3, 4, 6, int(rng.integers(2, MOST_POINTS + 1))]))
    points = rng.uniform(-1, 1, (m, n))
    kind = rng.choice(["any", "line", "neighbours", "far", "closed", "joint", "there and back"])
    if kind == "line":
        points = np.outer(np.sort(rng.uniform(-1, 1, m)), rng.uniform(-1, 1, n)) + 1e-4 * points
    elif kind == "neighbours":
        points = np.repeat(points, rng.integers(1, 3, m), axis=0)
    elif kind == "far":
        points = points[rng.integers(m, size=m)]
    elif kind == "closed":
        points = np.concatenate([points, points[:1]])
    elif kind == "joint":
        points[:] = np.where(np.arange(n) == rng.integers(n), points, points[0])
    elif kind == "there and back":
        points = np.concatenate([points, points[-2::-1]])
    return points * rng.choice([1, 1, 1, 1e-5, 50])


def leg_path(rng: np.random.Generator, points: np.ndarray) -> Motion:
    """Straight from point to point, at rest in each corner."""
    way, lasting = np.diff(points, axis=0), rng.uniform(0.3, 1, len(points) - 1)
    c = SEPTIC[:, None, None] * way / lasting[:, None] ** np.arange(7, -1, -1)[:, None, None]
    c[-1] += points[:-1]
    return Motion.piecewise(np.concatenate([[0], np.cumsum(lasting)]), c)


def corners(rng: np.random.Generator, points: np.ndarray) -> Motion:
    """Trapezoidal velocities, whose corners are blended or not."""
    apart = np.append(True, np.abs(np.diff(points, axis=0)).max(axis=1) > 0)
    size = np.abs(points).max()
    motion = Motion.trapezoidal(points[apart], *size * rng.uniform(0.5, 2, 2))
    gap = np.diff([motion.start, *sorted({found.t for found in motion.breaks}), motion.stop]).min()
    return motion if rng.random() < 0.5 else motion.blended(0.9 * gap, int(rng.choice([2, 3, 4, 6])))


def smooth(rng: np.random.Generator, points: np.ndarray) -> Motion:
    """A spline through all points, that moves at its ends; where many points go there and back, it warns of a jump."""
    t = np.cumsum(rng.uniform(0.3, 1, len(points)))
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", ".* jumps at", JounceWarning)
        return Motion.through(t, points, int(rng.choice([5, 7])))


def smooth_from_rest(rng: np.random.Generator, points: np.ndarray) -> Motion:
    """A spline through all points, from rest to rest."""
    u = np.polyval(SEPTIC, np.linspace(0, 1, 40 * len(points)))
    geometry = smooth(rng, points)
    return Motion.through(np.linspace(0, len(points), len(u)), geometry(geometry.start + u * geometry.duration, 0)[0])


def wave_path(rng: np.random.Generator, points: np.ndarray) -> Motion:
    """A closed path."""
    harmonics = min(len(points) - 1, 4)
    cosines, sines = rng.normal(size=(2, harmonics, points.shape[1])) * np.abs(points).max()
    return Motion.fourier(points[0], cosines, sines, 2 * np.pi, float(rng.choice([1, 1, rng.uniform(0.1, 2)])))


WAYS: tuple[Callable[[np.random.Generator, np.ndarray], Motion], ...] = (
    leg_path,
    corners,
    smooth,
    smooth_from_rest,
    wave_path,
)


def random_path(rng: np.random.Generator, n: int) -> Motion:
    """A motion of any duration, from any time on, whose path is of one of all kinds."""
    motion = None
    while motion is None:
        try:
            motion = WAYS[rng.integers(len(WAYS))](rng, way_points(rng, n))
        except JounceError:  # too few points for a spline, or all the same
            continue
    factor = float(rng.choice([1, 10 ** rng.uniform(-2, 2)]))
    return motion.scaled(factor).shifted(float(rng.choice([0, rng.uniform(-50, 50), 1e4])))


def random_limits(rng: np.random.Generator, robot: Robot, motion: Motion) -> Robot:
    """The robot with limits of some kinds, of the size of what the motion takes, or of another one."""
    t = np.linspace(motion.start, motion.stop, 501)
    along = robot.forces_along(motion, t)
    weight = robot.gravity_forces(*along.rates[:3])
    peaks = {kind: np.abs(rate).max(axis=0) for kind, rate in zip(RATES, along.rates[1:], strict=False)}
    peaks |= {kind: np.abs(Q - G).max(axis=0) for kind, Q, G in zip(FORCES, along.forces, weight, strict=True)}
    peaks["power"] = np.abs(along.forces[0] * along.rates[1]).max(axis=0)
    kinds = [kind for kind in peaks if rng.random() < (0.7 if kind == "velocity" else 0.3)] or ["velocity"]
    without = [kind for kind in FORCES if rng.random() < 0.3]
    size = 10 ** rng.uniform(-1, 1) if rng.random() < 0.8 else 10 ** rng.uniform(-4, 4)
    if np.abs([along.rates[1][0], along.rates[1][-1]]).max() > 0 and rng.random() < 0.9:  # it moves at an end
        size = rng.uniform(2.1, 10)
    limits = {}
    for kind in kinds:
        peak = np.maximum(peaks[kind], 0.01 * peaks[kind].max())
        bound = np.where(peak > 0, peak, 1.0) * size * rng.uniform(0.5, 2, (2, robot.n))
        if kind == "effort" and "effort" not in without:
            bound += np.abs(weight[0]).max(axis=0) * rng.uniform(1.02, 1.5)
        bound[0] = -(bound[0] if rng.random() < 0.3 else bound[1])
        limits[kind] = list(map(tuple, bound.T.tolist()))
    if rng.random() < 0.2:
        q = motion(np.linspace(motion.start, motion.stop, 5001), 0)[0]
        room = rng.choice([0.01, -0.01], p=[0.9, 0.1]) * np.ptp(q, axis=0)
        limits |= {"lower": q.min(axis=0) - abs(room), "upper": q.max(axis=0) + room}
    of = {kind: "Q - Qgrav" for kind in without if kind in limits}
    return robot.with_limits(**limits, **({"of": of} if of else {}))
