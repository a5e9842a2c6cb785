"""Make curves of arrays and of what planners compute, and check every argument.

The doors are functions ``from_...``, one for each way to state a motion, which return `MotionParts`: samples, logs,
polynomials, Fourier series and pieces first; then Ruckig, toppra, trapezoidal profiles and points of trajectories, as
exact piecewise polynomials. Planners' objects are taken by what they hold, so that neither library has to be installed,
and compared with the planner's own evaluation.
"""

from collections.abc import Sequence
from itertools import groupby, pairwise
from math import factorial
from typing import Any, NamedTuple, cast

import numpy as np

from jounce.arguments.names import array_by_name
from jounce.core.errors import JounceError, check_bool, join_names, one_line, quote_value
from jounce.core.named_entries import entry_names
from jounce.core.scalars import asarray
from jounce.motion import units, wraps
from jounce.motion.analytic import AnalyticCurve, Cosine, Terms
from jounce.motion.curves import DEFAULT_ORDER, Curve, Polynomials
from jounce.motion.hermite import hermite_coefficients
from jounce.motion.sample_curves import fit_curve
from jounce.motion.spline import SampledColumns, Smoothing, Spline

PLACE = "the motion"
PLANNER_TOLERANCE = 1e-6  # of the largest position or velocity, for a planner's own evaluation


class MotionParts(NamedTuple):
    """What a motion is made of: a curve, the names of its coordinates, its source; see `Motion`."""

    curve: Curve
    joint_names: tuple[str, ...] | None
    source: str
    samples: tuple[np.ndarray, np.ndarray] | None = None
    residual: np.ndarray | None = None
    grid: np.ndarray | None = None
    notes: tuple[str, ...] = ()
    angles: str | None = "rad"


class _Columns(NamedTuple):
    t: np.ndarray  # (N,)
    q: np.ndarray  # (N, n)
    names: tuple[str, ...] | None


def from_samples(t: Any, q: Any, way: Spline, joint_names: Any) -> MotionParts:
    """A spline through samples."""
    return _from_columns(_check_columns(t, q, joint_names), way)


def from_log(t: Any, q: Any, way: Smoothing | Spline, joint_names: Any, unwrap: Any) -> MotionParts:
    """A curve of measured samples, fitted by least squares or smoothed; angles that wrap are unwrapped or refused."""
    given = _check_columns(t, q, joint_names)
    check_bool("unwrap", unwrap, "whether angles wrap at whole turns, which are to be taken off")
    joints = wraps.Turning.of_columns(given.names or tuple(f"column {k + 1}" for k in range(given.q.shape[1])))
    if not unwrap:
        wraps.refuse_wraps(given.t, given.q, joints, PLACE)
        return _from_columns(given, way)
    samples, notes = wraps.unwrap(given.t, given.q, joints, PLACE)
    found = _from_columns(given._replace(q=samples), way)
    return found._replace(notes=(*notes, *found.notes))


def _check_columns(t: Any, q: Any, joint_names: Any) -> _Columns:
    """Samples as arrays, with the names of their joints."""
    (q,), joint_names = arrange_joints(joint_names, q=q)
    times, samples = as_finite_array(t, "t", 1), as_finite_array(q, "q", 2)
    if len(times) != len(samples):
        raise JounceError(f"t has {len(times)} times and q {len(samples)} rows; expected as many")
    check_increasing(times, "t")
    return _Columns(times, samples, check_joint_names(joint_names, samples.shape[1]))


def _from_columns(given: _Columns, way: Smoothing | Spline) -> MotionParts:
    times, samples, names = given
    units.warn_of_times(times, samples, PLACE)
    found = fit_curve(SampledColumns(times, samples, DEFAULT_ORDER, PLACE, names), way)
    return MotionParts(found.curve, names, found.source, (times, samples), found.residual, times, found.notes)


def from_polynomials(coefficients: Any, duration: Any, start: Any, joint_names: Any) -> MotionParts:
    """Polynomials in t - start, coefficients (n, degree + 1) with the lowest power first."""
    if entry_names(coefficients) is not None:
        (by_joint,), joint_names = arrange_joints(joint_names, coefficients=coefficients)
        coefficients = np.asarray(by_joint).T  # of (degree + 1, n)
    c, first = as_finite_array(coefficients, "coefficients", 2), float(as_finite_array(start, "start", 0))
    ends = np.array([first, first + _positive_number(duration, "duration")])
    check_increasing(ends, "start and end")
    curve = Polynomials(ends, np.ascontiguousarray(c.T[::-1, None, :]))
    return MotionParts(curve, check_joint_names(joint_names, len(c)), "polynomials, all rates exact")


def from_fourier_series(
    offset: Any, cosines: Any, sines: Any, frequency: Any, duration: Any, start: Any, joint_names: Any
) -> MotionParts:
    """offset + sum_k cosines[k] cos((k + 1) frequency t) + sines[k] sin((k + 1) frequency t)."""
    parts, joint_names = arrange_joints(joint_names, offset=offset, cosines=cosines, sines=sines)
    offset, cosines, sines = parts
    mean, a, b = (
        as_finite_array(offset, "offset", 1),
        as_finite_array(cosines, "cosines", 2),
        as_finite_array(sines, "sines", 2),
    )
    for name, part in (("cosines", a), ("sines", b)):
        if part.shape[1] != len(mean):
            raise JounceError(f"{name} has shape {part.shape}; expected (harmonics, {len(mean)}), as offset has joints")
    w, first = _positive_number(frequency, "frequency"), float(as_finite_array(start, "start", 0))
    terms = []
    for j, constant in enumerate(mean.tolist()):
        waves = [Cosine(x, k * w, 0.0) for k, x in enumerate(a[:, j].tolist(), 1)]
        waves += [Cosine(x, k * w, -np.pi / 2) for k, x in enumerate(b[:, j].tolist(), 1)]
        terms.append(Terms((constant,), tuple(waves)))
    curve = AnalyticCurve(tuple(terms), first, first + _positive_number(duration, "duration"))
    return MotionParts(curve, check_joint_names(joint_names, len(mean)), "Fourier series, all rates exact")


def from_pieces(breaks: Any, coefficients: Any, joint_names: Any) -> MotionParts:
    """Piecewise polynomials as scipy's PPoly has them."""
    (coefficients,), joint_names = arrange_joints(joint_names, coefficients=coefficients)
    x, c = as_finite_array(breaks, "breaks", 1), as_finite_array(coefficients, "coefficients", 3)
    check_increasing(x, "breaks")
    if c.shape[1] != len(x) - 1 or not c.shape[0]:
        came = f"coefficients has shape {c.shape} for {len(x)} breaks"
        raise JounceError(f"{came}; expected (degree + 1, {max(len(x) - 1, 1)}, n), the highest power first")
    units.warn_of_times(x[:-1], c[-1], PLACE)  # the lowest coefficients are the values at the breaks
    return MotionParts(
        Polynomials(x, c), check_joint_names(joint_names, c.shape[2]), "piecewise polynomials, all rates exact"
    )


def arrange_joints(joint_names: Any, **given: Any) -> tuple[list[Any], Any]:
    """What is given of each joint, with joints last in one order, and their names in this order.

    The order is that of `joint_names`, which arrays without names have too, or that of the first argument with names.
    """
    named = {label: entry_names(x) for label, x in given.items()}
    orders = {label: names for label, names in named.items() if names is not None}
    if not orders:
        return [*given.values()], joint_names
    for label, names in orders.items():
        if odd := [name for name in names if not isinstance(name, str)]:
            came = f"{label}: column {quote_value(odd[0])} is not named by a string"
            raise JounceError(f"{came}; expected names of joints")
    first, order = next(iter(orders.items()))
    if joint_names is not None:
        order = [*(check_joint_names(joint_names, len(order)) or ())]
    elif arrays := [label for label, x in given.items() if label not in orders and np.ndim(asarray(x, label))]:
        came = f"{first} names its joints, {join_names(order)}, and {arrays[0]} is an array without names"
        raise JounceError(f"{came}; name both, or state the order of the array by joint_names=")
    return [array_by_name(x, order, label) if label in orders else x for label, x in given.items()], order


def check_joint_names(given: Any, count: int) -> tuple[str, ...] | None:
    """The names of coordinates that a caller gives, or None."""
    if given is None:
        return None
    try:
        names = [] if isinstance(given, str) else list(given)
    except Exception:  # whatever a foreign type raises
        names = []
    if len(names) != count or not all(isinstance(name, str) for name in names) or len(set(names)) != count:
        raise JounceError(f"joint_names is {quote_value(given)}; expected {count} different names, one for each joint")
    return tuple(names)


def check_increasing(t: np.ndarray, what: str) -> None:
    """Raise `JounceError` where there are fewer than two times, or one does not follow the one before."""
    if len(t) < 2:
        raise JounceError(f"{what} holds {len(t)} time{'s' * (len(t) != 1)}; expected two at least")
    late = np.flatnonzero(np.diff(t) <= 0)
    if late.size:
        i = int(late[0])
        raise JounceError(
            f"{what} does not increase: {t[i]:.17g} is followed by {t[i + 1]:.17g}, entries {i} and {i + 1}"
        )


def as_finite_array(given: Any, what: str, axes: int) -> np.ndarray:
    """Finite numbers in an array of some axes, which is not empty along the last."""
    array = np.asarray(asarray(given, what))
    is_float = array.dtype.kind == "f" and np.asarray(given).dtype.kind != "b"
    if not is_float or array.ndim != axes or 0 in array.shape[-1:]:
        shape = ("a number", "an array (N,)", "an array (N, n)", "an array (degree + 1, pieces, n)")[axes]
        raise JounceError(f"{what} is {quote_value(given)}; expected {shape} of numbers")
    if not np.isfinite(array).all():
        raise JounceError(f"{what} holds {array[~np.isfinite(array)].flat[0]}; expected finite numbers")
    return array.astype(float)


def _positive_number(given: Any, what: str) -> float:
    number = float(as_finite_array(given, what, 0))
    if number <= 0:
        raise JounceError(f"{what} is {number:g}; expected a number > 0")
    return number


# What planners compute.
def from_ruckig(trajectory: Any, joint_names: Any) -> MotionParts:
    """The pieces of constant jerk of a `ruckig.Trajectory`: of each joint before, within and after its profile."""
    try:
        sections, duration = list(trajectory.profiles), float(trajectory.duration)
        starts = [0.0, *map(float, trajectory.intermediate_durations)][: len(sections)]
        columns = [
            _collect_phases([section[j] for section in sections], starts) for j in range(trajectory.degrees_of_freedom)
        ]
    except Exception as error:  # whatever another object raises
        raise _foreign_object_error(
            "from_ruckig", "a ruckig.Trajectory that is calculated", trajectory, error
        ) from None
    _check_ends("from_ruckig", duration, columns)
    curve = merge_columns(columns, duration)
    _check_agreement(curve, lambda t: np.array([trajectory.at_time(float(x))[:2] for x in t]), "ruckig")
    return MotionParts(curve, check_joint_names(joint_names, curve.columns), "pieces of constant jerk, of Ruckig")


def _collect_phases(profiles: Sequence[Any], starts: Sequence[float]) -> tuple[np.ndarray, np.ndarray]:
    """Where the phases of one joint begin, and their coefficients (4, m): braking, seven phases, and what follows."""
    rows: list[tuple[float, ...]] = []
    for number, (profile, start) in enumerate(zip(profiles, starts, strict=True)):
        t = start
        brake = profile.brake
        for i in range(2 if number == 0 and brake.duration > 0 else 0):
            rows.append((t, brake.j[i], brake.a[i], brake.v[i], brake.p[i]))
            t += brake.t[i]
        for i in range(7):
            rows.append((t, profile.j[i], profile.a[i], profile.v[i], profile.p[i]))
            t += profile.t[i]
        rows.append((t, 0.0, profile.a[7], profile.v[7], profile.p[7]))
    x, *rates = np.array(rows, dtype=float).T
    ends = np.append(x[1:], np.inf)
    kept = ends > x  # of phases that last
    return x[kept], np.array([rates[0] / 6, rates[1] / 2, rates[2], rates[3]])[:, kept]


def from_toppra(path: Any, joint_names: Any) -> MotionParts:
    """The trajectory that toppra computes: a spline in time, or polynomials of a path that is quadratic in time."""
    if path is None:
        raise JounceError(
            "Motion.from_toppra() got None: toppra found no trajectory; loosen the constraints or take more gridpoints"
        )
    kinds = [kind.__name__ for kind in type(path).__mro__]
    if "SplineInterpolator" in kinds and "ParametrizeSpline" not in kinds:
        raise JounceError(
            "Motion.from_toppra() got a path, which knows no time: give what compute_trajectory() returns along it;"
            " if its variable is time, use Motion.piecewise(path.cspl.x, path.cspl.c)"
        )
    try:
        x, c = _path_polynomials(path) if hasattr(path, "cspl") else _retime_path(path)
    except Exception as error:  # whatever another object raises
        expected = "what toppra's compute_trajectory() returns, along a spline or polynomials"
        cure = "(sample others at times t and use Motion.through(t, path(t)))"
        raise _foreign_object_error("from_toppra", f"{expected} {cure}", path, error) from None
    _check_ends("from_toppra", float(x[-1]), [(x, c[:, :, 0])])
    curve = Polynomials(x, c)
    _check_agreement(curve, lambda t: np.stack([path(t, k).reshape(len(t), -1) for k in (0, 1)], axis=1), "toppra")
    return MotionParts(curve, check_joint_names(joint_names, curve.columns), "piecewise polynomials, of toppra")


def _path_polynomials(path: Any) -> tuple[np.ndarray, np.ndarray]:
    """Breakpoints (m + 1,) and coefficients (degree + 1, m, n) of a geometric path or trajectory."""
    from scipy.interpolate import PPoly

    if hasattr(path, "cspl"):
        x, c = path.cspl.x, path.cspl.c
    elif hasattr(path, "ppoly"):
        x, c = path.ppoly.x, path.ppoly.c
    elif hasattr(path, "uspl"):
        columns = [_univariate_pieces(spline) for spline in path.uspl]
        curve = merge_columns(columns, float(path.path_interval[1]))
        x, c = curve.x, curve.c
    elif hasattr(path, "_polys"):
        pieces = [PPoly.from_bernstein_basis(poly) for poly in path._polys]
        x, c = pieces[0].x, np.stack([piece.c for piece in pieces], axis=2)
    else:
        powers = [poly.coef for poly in path.poly]
        c = np.zeros((max(map(len, powers)), 1, len(powers)))
        for j, power in enumerate(powers):
            c[len(c) - len(power) :, 0, j] = power[::-1]
        x, c = np.array(path.path_interval, dtype=float), shift_polynomials(c, np.array(float(path.path_interval[0])))
    return np.asarray(x, dtype=float), np.asarray(c, dtype=float).reshape(*c.shape[:2], -1)


def _univariate_pieces(spline: Any) -> tuple[np.ndarray, np.ndarray]:
    """Where the pieces of a `scipy.interpolate.UnivariateSpline` begin, and their coefficients (degree + 1, m)."""
    x = np.asarray(spline.get_knots())[:-1]
    rates = np.array([spline.derivatives(at) for at in x]).T
    factorials = np.array([factorial(k) for k in range(len(rates))])
    return x, (rates / factorials[:, None])[::-1]


def _retime_path(path: Any) -> tuple[np.ndarray, np.ndarray]:
    """q(s(t)): s is quadratic in t between grid points, q polynomial in s between the points of the path."""
    t, s, v, u = (np.asarray(part, dtype=float) for part in (path._ts, path._ss, path._velocities, path._us))
    knots, c = _path_polynomials(path._path)
    inner = knots[(knots > s[0]) & (knots < s[-1])]
    i = (np.searchsorted(s, inner, side="right") - 1).clip(0, len(u) - 1)
    ahead = inner - s[i]
    crossings = t[i] + 2 * ahead / (v[i] + np.sqrt(np.maximum(v[i] ** 2 + 2 * u[i] * ahead, 0)))
    x = np.unique(np.concatenate([t, crossings]))
    x = np.append(
        x[:-1][np.diff(x) > 1e-9 * t[-1]], t[-1]
    )  # a crossing on a grid point, but for rounding, is the point
    middle = (x[:-1] + x[1:]) / 2
    i = (np.searchsorted(t, middle, side="right") - 1).clip(0, len(u) - 1)
    since, half = x[:-1] - t[i], middle - t[i]
    piece = np.searchsorted(knots, s[i] + half * (v[i] + half * u[i] / 2), side="right") - 1
    piece = piece.clip(0, len(knots) - 2)
    pace = [(u[i] / 2)[:, None], (v[i] + since * u[i])[:, None]]
    begin = s[i] + since * (v[i] + since * u[i] / 2) - knots[piece]
    return x, _compose_polynomials(shift_polynomials(c[:, piece], begin[:, None]), pace)


def _compose_polynomials(c: np.ndarray, pace: Sequence[np.ndarray]) -> np.ndarray:
    """Coefficients of p(a t^2 + b t), highest power first, of those c (degree + 1, m, n) of p, and a, b (m, 1)."""
    a, b = pace
    found = c[:1]
    for coefficient in c[1:]:
        wider = np.zeros((len(found) + 2, *c.shape[1:]))
        wider[:-2] += a * found
        wider[1:-1] += b * found
        wider[-1] += coefficient
        found = wider
    return found


def from_trapezoidal_profiles(positions: Any, velocity: Any, acceleration: Any, joint_names: Any) -> MotionParts:
    """From rest to rest between positions (m, n), all joints in step, as fast as their limits allow."""
    parts, joint_names = arrange_joints(joint_names, positions=positions, velocity=velocity, acceleration=acceleration)
    positions, velocity, acceleration = parts
    q = as_finite_array(positions, "positions", 2)
    if len(q) < 2 or not np.abs(np.diff(q, axis=0)).max(axis=1).all():
        raise JounceError(f"positions has {len(q)} rows; expected two at least, each unlike the one before")
    limits = []
    for name, given in (("velocity", velocity), ("acceleration", acceleration)):
        limit = np.asarray(asarray(given, name))
        limit = as_finite_array(limit, name, 0 if limit.ndim == 0 else 1)
        if (limit.ndim and len(limit) != q.shape[1]) or (limit <= 0).any():
            raise JounceError(f"{name} is {limit.tolist()}; expected one or {q.shape[1]} numbers > 0")
        limits.append(np.broadcast_to(limit, q.shape[1]))
    rows: list[tuple[float, np.ndarray, np.ndarray, np.ndarray]] = []
    start = 0.0
    for begin, way in zip(q[:-1], np.diff(q, axis=0), strict=True):
        moved = way != 0
        v, a = (float((limit[moved] / np.abs(way[moved])).min()) for limit in limits)
        v = min(v, np.sqrt(a))  # of s from 0 to 1
        rise, total = v / a, 1 / v + v / a
        rows.append((start, a / 2 * way, 0 * way, begin))
        if total - 2 * rise > 1e-12 * total:
            rows.append((start + rise, 0 * way, v * way, begin + v * rise / 2 * way))
        rows.append((start + total - rise, -a / 2 * way, v * way, begin + (1 - v * rise / 2) * way))
        start += total
    x = np.array([*(row[0] for row in rows), start])
    c = np.array([[row[k] for row in rows] for k in (1, 2, 3)])
    return MotionParts(Polynomials(x, c), check_joint_names(joint_names, q.shape[1]), "trapezoidal velocity profiles")


def from_trajectory_points(t: np.ndarray, points: Sequence[Sequence[np.ndarray]], joint_names: Any) -> MotionParts:
    """The curve that ROS makes of trajectory points: of each its positions and perhaps velocities and accelerations.

    Between two points it is linear, cubic or quintic: both state positions, or velocities too, or accelerations too.
    """
    check_increasing(t, "time_from_start")
    common = [min(len(a), len(b), 3) for a, b in pairwise(points)]
    c = np.zeros((2 * max(common), len(common), len(points[0][0])))
    for m, numbered in groupby(sorted(range(len(common)), key=common.__getitem__), key=common.__getitem__):
        which = np.array(list(numbered))
        h = np.diff(t)[which, None]
        left, right = ([np.array([points[i + step][k] for i in which]) for k in range(m)] for step in (0, 1))
        found = hermite_coefficients(left, right, h)
        scale = h[None] ** np.arange(2 * m - 1, -1, -1)[:, None, None]
        c[len(c) - 2 * m :, which] = found / scale
    kinds = {1: "linear", 2: "cubic", 3: "quintic"}
    said = " and ".join(kinds[m] for m in sorted(set(common)))
    curve = Polynomials(t, c)
    return MotionParts(
        curve, check_joint_names(joint_names, curve.columns), f"trajectory points, {said} between them as in ROS"
    )


def _check_ends(name: str, duration: float, columns: Sequence[tuple[np.ndarray, np.ndarray]]) -> None:
    finite = all(np.isfinite(x).all() and np.isfinite(c).all() for x, c in columns)
    if not columns or not finite or not np.isfinite(duration) or duration <= 0:
        came = f"Motion.{name}() got a trajectory of {duration:g} s"
        raise JounceError(f"{came}; expected one that lasts, of finite numbers")


def _check_agreement(curve: Polynomials, evaluate: Any, planner: str) -> None:
    """Refuse a trajectory that its own planner evaluates otherwise: another release may hold other data."""
    middle = (curve.x[:-1] + curve.x[1:]) / 2
    t = middle[:: max(1, len(middle) // 64)]
    ours, theirs = np.stack(curve.rates(t, 1), axis=1), evaluate(t)
    off = np.abs(ours - theirs).max(axis=(0, 2)) / np.maximum(np.abs(theirs).max(axis=(0, 2)), 1e-9)
    if not (off < PLANNER_TOLERANCE).all():
        came = f"the pieces of this trajectory and {planner}'s own values differ by {off.max():.1g}"
        raise JounceError(f"{came}: this release of {planner} is not known; sample it and use Motion.through")


def _foreign_object_error(name: str, expected: str, given: object, error: Exception) -> JounceError:
    came = type(given).__name__
    return JounceError(f"Motion.{name}() expects {expected}, got {came}: {one_line(cast(object, error))}")


def shift_polynomials(c: np.ndarray, by: np.ndarray) -> np.ndarray:
    """Coefficients (degree + 1, ...) of p(s + by): highest power first, as those of p(s); Horner's scheme by Shaw."""
    c = c.copy()
    for last in range(len(c) - 1, 0, -1):
        for i in range(1, last + 1):
            c[i] += by * c[i - 1]
    return c


def merge_columns(parts: Sequence[tuple[np.ndarray, np.ndarray]], stop: float) -> Polynomials:
    """Columns with breakpoints of their own as one curve with the breakpoints of all.

    A column is (x, c): its pieces begin at x (m,), with the coefficients c (degree + 1, m); the last reaches to `stop`.
    Breakpoints closer together than rounding of the time are one.
    """
    start = min(float(x[0]) for x, _ in parts)
    every = np.unique(np.concatenate([x for x, _ in parts]))
    every = every[(every >= start) & (every < stop)]
    apart = np.concatenate([[True], np.diff(every) > 1e-12 * (stop - start)])
    x = np.append(every[apart], stop)
    if len(x) > 2 and x[-1] - x[-2] <= 1e-12 * (stop - start):
        x = np.delete(x, -2)
    middle = (x[:-1] + x[1:]) / 2
    c = np.zeros((max(len(c) for _, c in parts), len(middle), len(parts)))
    for j, (knots, column) in enumerate(parts):
        piece = (np.searchsorted(knots, middle, side="right") - 1).clip(0)
        c[len(c) - len(column) :, :, j] = shift_polynomials(column[:, piece], x[:-1] - knots[piece])
    return Polynomials(x, c)
