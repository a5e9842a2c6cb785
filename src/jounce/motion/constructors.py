"""Make curves of arrays and of planners' trajectories, and check every argument.

The doors are functions ``from_...``, one for each way to state a motion, which return `MotionParts`: samples, logs,
polynomials, Fourier series and pieces first; then Ruckig, toppra, trapezoidal profiles and points of trajectories, as
exact piecewise polynomials. Planners' objects are taken by what they hold, so that neither library has to be installed,
and compared with the planner's own evaluation.
"""

from collections.abc import Sequence
from dataclasses import dataclass
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
    """The parts of a motion; see `Motion`."""

    curve: Curve
    joint_names: tuple[str, ...] | None
    source: str
    samples: tuple[np.ndarray, np.ndarray] | None = None
    residual: np.ndarray | None = None
    grid: np.ndarray | None = None
    notes: tuple[str, ...] = ()
    angles: str | None = "rad"


class _Columns(NamedTuple):
    """Samples of a motion, checked."""

    t: np.ndarray  # (N,)
    q: np.ndarray  # (N, n)
    names: tuple[str, ...] | None


def from_samples(t: Any, q: Any, way: Spline, joint_names: Any) -> MotionParts:
    """Return a spline through samples."""
    return _from_columns(_check_columns(t, q, joint_names), way)


def from_log(t: Any, q: Any, way: Smoothing | Spline, joint_names: Any, unwrap: Any) -> MotionParts:
    """Return a curve of measured samples, fitted or smoothed.

    Angles that wrap are unwrapped or refused.
    """
    samples = _check_columns(t, q, joint_names)
    check_bool("unwrap", unwrap, "whether angles wrap at whole turns, which are to be taken off")
    column_names = samples.names
    if column_names is None:
        column_names = tuple(f"column {k + 1}" for k in range(samples.q.shape[1]))
    joints = wraps.Turning.of_columns(column_names)
    if not unwrap:
        wraps.refuse_wraps(samples.t, samples.q, joints, PLACE)
        return _from_columns(samples, way)
    positions, notes = wraps.unwrap(samples.t, samples.q, joints, PLACE)
    parts = _from_columns(samples._replace(q=positions), way)
    return parts._replace(notes=(*notes, *parts.notes))


def _check_columns(t: Any, q: Any, joint_names: Any) -> _Columns:
    """Return samples as arrays, with the names of their joints."""
    (q,), joint_names = arrange_joints(joint_names, q=q)
    times, samples = as_finite_array(t, "t", 1), as_finite_array(q, "q", 2)
    if len(times) != len(samples):
        raise JounceError(f"t has {len(times)} times and q {len(samples)} rows; expected as many")
    check_increasing(times, "t")
    return _Columns(times, samples, check_joint_names(joint_names, samples.shape[1]))


def _from_columns(columns: _Columns, way: Smoothing | Spline) -> MotionParts:
    """Return the motion of samples that are checked."""
    times, samples, names = columns
    units.warn_of_times(times, samples, PLACE)
    made = fit_curve(SampledColumns(times, samples, DEFAULT_ORDER, PLACE, names), way)
    return MotionParts(made.curve, names, made.source, (times, samples), made.residual, times, made.notes)


def from_polynomials(coefficients: Any, duration: Any, start: Any, joint_names: Any) -> MotionParts:
    """Return polynomials in t - start.

    Coefficients are (n, degree + 1), with the lowest power first.
    """
    if entry_names(coefficients) is not None:
        # Joints are last in what is given by name: (degree + 1, n) -> (n, degree + 1).
        (by_joint,), joint_names = arrange_joints(joint_names, coefficients=coefficients)
        coefficients = np.asarray(by_joint).T
    c, first = as_finite_array(coefficients, "coefficients", 2), float(as_finite_array(start, "start", 0))
    ends = np.array([first, first + _positive_number(duration, "duration")])
    check_increasing(ends, "start and end")
    # One piece, the highest power first: (n, degree + 1) -> (degree + 1, 1, n).
    curve = Polynomials(ends, np.ascontiguousarray(c.T[::-1, None, :]))
    return MotionParts(curve, check_joint_names(joint_names, len(c)), "polynomials, all rates exact")


@dataclass(frozen=True)
class FourierSeries:
    """A Fourier series as a caller states it, of any types: see `Motion.fourier`."""

    offset: Any
    cosines: Any
    sines: Any
    frequency: Any
    duration: Any
    start: Any


def from_fourier_series(series: FourierSeries, joint_names: Any) -> MotionParts:
    """Return the motion of a Fourier series.

    It is offset + sum_k cosines[k] cos((k + 1) frequency t) + sines[k] sin((k + 1) frequency t).
    """
    parts, joint_names = arrange_joints(joint_names, offset=series.offset, cosines=series.cosines, sines=series.sines)
    mean = as_finite_array(parts[0], "offset", 1)
    a = as_finite_array(parts[1], "cosines", 2)
    b = as_finite_array(parts[2], "sines", 2)
    for name, part in (("cosines", a), ("sines", b)):
        if part.shape[1] != len(mean):
            raise JounceError(f"{name} has shape {part.shape}; expected (harmonics, {len(mean)}), as offset has joints")
    w, first = _positive_number(series.frequency, "frequency"), float(as_finite_array(series.start, "start", 0))
    # sin(x) = cos(x - pi / 2), so that all waves of a joint are cosines.
    terms = []
    for j, constant in enumerate(mean.tolist()):
        waves = [Cosine(x, k * w, 0.0) for k, x in enumerate(a[:, j].tolist(), 1)]
        waves += [Cosine(x, k * w, -np.pi / 2) for k, x in enumerate(b[:, j].tolist(), 1)]
        terms.append(Terms((constant,), tuple(waves)))
    curve = AnalyticCurve(tuple(terms), first, first + _positive_number(series.duration, "duration"))
    return MotionParts(curve, check_joint_names(joint_names, len(mean)), "Fourier series, all rates exact")


def from_pieces(breaks: Any, coefficients: Any, joint_names: Any) -> MotionParts:
    """Return piecewise polynomials as scipy's PPoly has them."""
    (coefficients,), joint_names = arrange_joints(joint_names, coefficients=coefficients)
    x, c = as_finite_array(breaks, "breaks", 1), as_finite_array(coefficients, "coefficients", 3)
    check_increasing(x, "breaks")
    if c.shape[1] != len(x) - 1 or not c.shape[0]:
        came = f"coefficients has shape {c.shape} for {len(x)} breaks"
        raise JounceError(f"{came}; expected (degree + 1, {max(len(x) - 1, 1)}, n), the highest power first")
    # The lowest coefficients are the values at the breaks.
    units.warn_of_times(x[:-1], c[-1], PLACE)
    return MotionParts(
        Polynomials(x, c), check_joint_names(joint_names, c.shape[2]), "piecewise polynomials, all rates exact"
    )


def arrange_joints(joint_names: Any, **arguments: Any) -> tuple[list[Any], Any]:
    """Return arguments with joints last in one order, and their names.

    The order is that of `joint_names`, which arrays without names have too, or that of the first argument with names.
    """
    named = {label: entry_names(x) for label, x in arguments.items()}
    orders = {label: names for label, names in named.items() if names is not None}
    if len(orders) == 0:
        return [*arguments.values()], joint_names
    for label, names in orders.items():
        odd = [name for name in names if not isinstance(name, str)]
        if len(odd) > 0:
            came = f"{label}: column {quote_value(odd[0])} is not named by a string"
            raise JounceError(f"{came}; expected names of joints")
    first, order = next(iter(orders.items()))
    if joint_names is not None:
        order = [*(check_joint_names(joint_names, len(order)) or ())]
    else:
        # An array without names has the order of `joint_names` alone; a number is one for all joints.
        arrays = [label for label, x in arguments.items() if label not in orders and np.ndim(asarray(x, label)) > 0]
        if len(arrays) > 0:
            came = f"{first} names its joints, {join_names(order)}, and {arrays[0]} is an array without names"
            raise JounceError(f"{came}; name both, or state the order of the array by joint_names=")
    return [array_by_name(x, order, label) if label in orders else x for label, x in arguments.items()], order


def check_joint_names(joint_names: Any, count: int | None) -> tuple[str, ...] | None:
    """Return the names of coordinates that a caller states, or None.

    Without a count there may be any number of them.
    """
    if joint_names is None:
        return None
    # A text is a sequence of letters too, and foreign types may raise anything.
    try:
        names = [] if isinstance(joint_names, str) else list(joint_names)
    except Exception:
        names = []
    count = max(len(names), 1) if count is None else count
    if len(names) != count or not all(isinstance(name, str) for name in names) or len(set(names)) != count:
        expected = f"{count} different names, one for each joint"
        raise JounceError(f"joint_names is {quote_value(joint_names)}; expected {expected}")
    return tuple(names)


def check_increasing(t: np.ndarray, what: str) -> None:
    """Raise `JounceError` where times do not increase, or are fewer than two."""
    if len(t) < 2:
        raise JounceError(f"{what} holds {len(t)} time{'s' * (len(t) != 1)}; expected two at least")
    late = np.flatnonzero(np.diff(t) <= 0)
    if late.size > 0:
        i = int(late[0])
        raise JounceError(
            f"{what} does not increase: {t[i]:.17g} is followed by {t[i + 1]:.17g}, entries {i} and {i + 1}"
        )


def as_finite_array(numbers: Any, what: str, axes: int) -> np.ndarray:
    """Return finite numbers in an array of some axes.

    The array is not empty along the last of them.
    """
    array = np.asarray(asarray(numbers, what))
    is_float = array.dtype.kind == "f" and np.asarray(numbers).dtype.kind != "b"
    if not is_float or array.ndim != axes or 0 in array.shape[-1:]:
        shape = ("a number", "an array (N,)", "an array (N, n)", "an array (degree + 1, pieces, n)")[axes]
        raise JounceError(f"{what} is {quote_value(numbers)}; expected {shape} of numbers")
    if not np.isfinite(array).all():
        raise JounceError(f"{what} holds {array[~np.isfinite(array)].flat[0]}; expected finite numbers")
    return array.astype(float)


def _positive_number(number: Any, what: str) -> float:
    """Return a number that is checked to be above 0."""
    checked = float(as_finite_array(number, what, 0))
    if checked <= 0:
        raise JounceError(f"{what} is {checked:g}; expected a number > 0")
    return checked


# What planners compute.
def from_ruckig(trajectory: Any, joint_names: Any) -> MotionParts:
    """Return the pieces of constant jerk of a `ruckig.Trajectory`.

    They are of each joint before, within and after its profile.
    """
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
    """Return the starts of one joint's phases, and their coefficients.

    Coefficients are (4, m): of braking, seven phases, and what follows.
    """
    rows: list[tuple[float, ...]] = []
    for number, (profile, start) in enumerate(zip(profiles, starts, strict=True)):
        # A profile may begin beyond its limits: up to two phases brake first, in the first section alone.
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
    # Phases that do not last are left out. j / 6, a / 2, v, p are the coefficients of a cubic, highest power first.
    lasts = ends > x
    return x[lasts], np.array([rates[0] / 6, rates[1] / 2, rates[2], rates[3]])[:, lasts]


def from_toppra(path: Any, joint_names: Any) -> MotionParts:
    """Return the trajectory that toppra computes.

    It is a spline in time, or polynomials of a path that is quadratic in time.
    """
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
    # Either of toppra's parametrizers: one has a spline in time, the other a path and its pace.
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
    """Return the breakpoints and coefficients of a geometric path.

    Breakpoints are (m + 1,), coefficients (degree + 1, m, n). A trajectory is a path in time.
    """
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
        # Polynomials of all the path: their powers are of s, and those of pieces of s less the start.
        powers = [poly.coef for poly in path.poly]
        c = np.zeros((max(map(len, powers)), 1, len(powers)))
        for j, power in enumerate(powers):
            c[len(c) - len(power) :, 0, j] = power[::-1]
        x, c = np.array(path.path_interval, dtype=float), shift_polynomials(c, np.array(float(path.path_interval[0])))
    return np.asarray(x, dtype=float), np.asarray(c, dtype=float).reshape(*c.shape[:2], -1)


def _univariate_pieces(spline: Any) -> tuple[np.ndarray, np.ndarray]:
    """Return the pieces of a `scipy.interpolate.UnivariateSpline`.

    They are where the pieces begin, and their coefficients (degree + 1, m).
    """
    x = np.asarray(spline.get_knots())[:-1]
    # The k-th coefficient is the k-th derivative at the start over k!.
    rates = np.array([spline.derivatives(start) for start in x]).T
    factorials = np.array([factorial(k) for k in range(len(rates))])
    return x, (rates / factorials[:, None])[::-1]


def _retime_path(path: Any) -> tuple[np.ndarray, np.ndarray]:
    """Return q(s(t)) as piecewise polynomials.

    s is quadratic in t between grid points, q polynomial in s between the points of the path.
    """
    t, s, v, u = (np.asarray(part, dtype=float) for part in (path._ts, path._ss, path._velocities, path._us))
    knots, c = _path_polynomials(path._path)
    # The times at which points of the path are passed, from s_i + v_i dt + u_i dt^2 / 2 = s: in the form of the root
    # that loses no digits where u_i is small.
    passed = knots[(knots > s[0]) & (knots < s[-1])]
    i = (np.searchsorted(s, passed, side="right") - 1).clip(0, len(u) - 1)
    ahead = passed - s[i]
    crossings = t[i] + 2 * ahead / (v[i] + np.sqrt(np.maximum(v[i] ** 2 + 2 * u[i] * ahead, 0)))
    x = np.unique(np.concatenate([t, crossings]))
    # A crossing on a grid point, but for rounding, is the point.
    x = np.append(x[:-1][np.diff(x) > 1e-9 * t[-1]], t[-1])
    # Each piece in time lies in one grid interval i and in one piece of the path, which its middle shows.
    middle = (x[:-1] + x[1:]) / 2
    i = (np.searchsorted(t, middle, side="right") - 1).clip(0, len(u) - 1)
    since, half = x[:-1] - t[i], middle - t[i]
    piece = np.searchsorted(knots, s[i] + half * (v[i] + half * u[i] / 2), side="right") - 1
    piece = piece.clip(0, len(knots) - 2)
    # s less the start of the path's piece, as a t^2 + b t + `begin` from the start of the piece in time.
    pace = [(u[i] / 2)[:, None], (v[i] + since * u[i])[:, None]]
    begin = s[i] + since * (v[i] + since * u[i] / 2) - knots[piece]
    return x, _compose_polynomials(shift_polynomials(c[:, piece], begin[:, None]), pace)


def _compose_polynomials(c: np.ndarray, pace: Sequence[np.ndarray]) -> np.ndarray:
    """Return the coefficients of p(a t^2 + b t), highest power first.

    Those of p are c (degree + 1, m, n), and a, b are (m, 1).
    """
    a, b = pace
    # Horner's scheme: (p so far) times (a t^2 + b t) plus the next coefficient.
    composed = c[:1]
    for coefficient in c[1:]:
        wider = np.zeros((len(composed) + 2, *c.shape[1:]))
        wider[:-2] += a * composed
        wider[1:-1] += b * composed
        wider[-1] += coefficient
        composed = wider
    return composed


def from_trapezoidal_profiles(positions: Any, velocity: Any, acceleration: Any, joint_names: Any) -> MotionParts:
    """Return a motion from rest to rest between positions (m, n).

    All joints are in step, as fast as their limits allow.
    """
    parts, joint_names = arrange_joints(joint_names, positions=positions, velocity=velocity, acceleration=acceleration)
    positions, velocity, acceleration = parts
    q = as_finite_array(positions, "positions", 2)
    if len(q) < 2 or not np.abs(np.diff(q, axis=0)).max(axis=1).all():
        raise JounceError(f"positions has {len(q)} rows; expected two at least, each unlike the one before")
    limits = []
    for name, bound in (("velocity", velocity), ("acceleration", acceleration)):
        limit = np.asarray(asarray(bound, name))
        limit = as_finite_array(limit, name, 0 if limit.ndim == 0 else 1)
        if (limit.ndim > 0 and len(limit) != q.shape[1]) or (limit <= 0).any():
            raise JounceError(f"{name} is {limit.tolist()}; expected one or {q.shape[1]} numbers > 0")
        limits.append(np.broadcast_to(limit, q.shape[1]))
    rows: list[tuple[float, np.ndarray, np.ndarray, np.ndarray]] = []
    start = 0.0
    for begin, way in zip(q[:-1], np.diff(q, axis=0), strict=True):
        # The limits of s, which goes from 0 to 1 for all joints: that of the slowest joint. Where v is not reached, the
        # profile is a triangle of the height sqrt(a).
        moves = way != 0
        v, a = (float((limit[moves] / np.abs(way[moves])).min()) for limit in limits)
        v = min(v, np.sqrt(a))
        rise, total = v / a, 1 / v + v / a
        # Pieces of the second degree: start, and coefficients of t^2, t and 1.
        rows.append((start, a / 2 * way, 0 * way, begin))
        if total - 2 * rise > 1e-12 * total:
            rows.append((start + rise, 0 * way, v * way, begin + v * rise / 2 * way))
        rows.append((start + total - rise, -a / 2 * way, v * way, begin + (1 - v * rise / 2) * way))
        start += total
    x = np.array([*(row[0] for row in rows), start])
    c = np.array([[row[k] for row in rows] for k in (1, 2, 3)])
    return MotionParts(Polynomials(x, c), check_joint_names(joint_names, q.shape[1]), "trapezoidal velocity profiles")


def from_trajectory_points(t: np.ndarray, points: Sequence[Sequence[np.ndarray]], joint_names: Any) -> MotionParts:
    """Return the curve that ROS makes of trajectory points.

    Each point has positions and perhaps velocities and accelerations. Between two points the curve is linear,
    cubic or quintic: both state positions, or velocities too, or accelerations too.
    """
    check_increasing(t, "time_from_start")
    common = [min(len(a), len(b), 3) for a, b in pairwise(points)]
    c = np.zeros((2 * max(common), len(common), len(points[0][0])))
    # All pieces that have m rates in common at both ends are computed at once.
    for m, numbers in groupby(sorted(range(len(common)), key=common.__getitem__), key=common.__getitem__):
        pieces = np.array(list(numbers))
        h = np.diff(t)[pieces, None]
        left, right = ([np.array([points[i + step][k] for i in pieces]) for k in range(m)] for step in (0, 1))
        # Polynomials in u = (t - t_left) / h, (2 m, pieces, n), become ones in t - t_left.
        of_shares = hermite_coefficients(left, right, h)
        scale = h[None] ** np.arange(2 * m - 1, -1, -1)[:, None, None]
        c[len(c) - 2 * m :, pieces] = of_shares / scale
    kinds = {1: "linear", 2: "cubic", 3: "quintic"}
    between = " and ".join(kinds[m] for m in sorted(set(common)))
    curve = Polynomials(t, c)
    return MotionParts(
        curve, check_joint_names(joint_names, curve.columns), f"trajectory points, {between} between them as in ROS"
    )


def _check_ends(name: str, duration: float, columns: Sequence[tuple[np.ndarray, np.ndarray]]) -> None:
    """Raise `JounceError` unless a trajectory lasts, with finite numbers."""
    finite = all(np.isfinite(x).all() and np.isfinite(c).all() for x, c in columns)
    if not columns or not finite or not np.isfinite(duration) or duration <= 0:
        came = f"Motion.{name}() got a trajectory of {duration:g} s"
        raise JounceError(f"{came}; expected one that lasts, of finite numbers")


def _check_agreement(curve: Polynomials, evaluate: Any, planner: str) -> None:
    """Refuse a trajectory that its own planner evaluates otherwise.

    Another release may hold other data.
    """
    middle = (curve.x[:-1] + curve.x[1:]) / 2
    t = middle[:: max(1, len(middle) // 64)]
    # Positions and velocities, (T, 2, n), each over its largest value.
    rates, planner_rates = np.stack(curve.rates(t, 1), axis=1), evaluate(t)
    off = np.abs(rates - planner_rates).max(axis=(0, 2)) / np.maximum(np.abs(planner_rates).max(axis=(0, 2)), 1e-9)
    if not (off < PLANNER_TOLERANCE).all():
        came = f"the pieces of this trajectory and {planner}'s own values differ by {off.max():.1g}"
        raise JounceError(f"{came}: this release of {planner} is not known; sample it and use Motion.through")


def _foreign_object_error(name: str, expected: str, foreign: object, error: Exception) -> JounceError:
    """Return the error for an object that no planner makes."""
    came = type(foreign).__name__
    return JounceError(f"Motion.{name}() expects {expected}, got {came}: {one_line(cast(object, error))}")


def shift_polynomials(c: np.ndarray, by: np.ndarray) -> np.ndarray:
    """Return coefficients (degree + 1, ...) of p(s + by).

    They are highest power first, as those of p(s); Horner's scheme by Shaw.
    """
    c = c.copy()
    for last in range(len(c) - 1, 0, -1):
        for i in range(1, last + 1):
            c[i] += by * c[i - 1]
    return c


def merge_columns(parts: Sequence[tuple[np.ndarray, np.ndarray]], stop: float) -> Polynomials:
    """Return columns as one curve with the breakpoints of all.

    Each column has breakpoints of its own. A column is (x, c): its pieces begin at x (m,), with the coefficients
    c (degree + 1, m); the last reaches to `stop`. Breakpoints closer together than rounding of the time are one.
    """
    start = min(float(x[0]) for x, _ in parts)
    starts = np.unique(np.concatenate([x for x, _ in parts]))
    starts = starts[(starts >= start) & (starts < stop)]
    is_apart = np.concatenate([[True], np.diff(starts) > 1e-12 * (stop - start)])
    x = np.append(starts[is_apart], stop)
    if len(x) > 2 and x[-1] - x[-2] <= 1e-12 * (stop - start):
        x = np.delete(x, -2)
    # The middle of a piece shows in which piece of each column it lies; there the polynomial is shifted to its start.
    middle = (x[:-1] + x[1:]) / 2
    c = np.zeros((max(len(c) for _, c in parts), len(middle), len(parts)))
    for j, (knots, column) in enumerate(parts):
        piece = (np.searchsorted(knots, middle, side="right") - 1).clip(0)
        c[len(c) - len(column) :, :, j] = shift_polynomials(column[:, piece], x[:-1] - knots[piece])
    return Polynomials(x, c)
