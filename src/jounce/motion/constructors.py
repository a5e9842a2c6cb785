"""Curves of arrays: through samples, polynomials, Fourier series, pieces, profiles; every argument is checked here."""

from typing import Any, NamedTuple

import numpy as np

from jounce.arguments.names import array_by_name
from jounce.core.errors import JounceError, check_bool, join_names, quote_value
from jounce.core.named_entries import entry_names
from jounce.core.scalars import asarray
from jounce.motion import wraps
from jounce.motion.analytic import AnalyticCurve, Cosine, Terms
from jounce.motion.curves import DEFAULT_ORDER, Curve, Polynomials
from jounce.motion.sample_curves import fit_curve
from jounce.motion.spline import SampledColumns, Smoothing, Spline
from jounce.motion.units import warn_of_times

PLACE = "the motion"


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
    warn_of_times(times, samples, PLACE)
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
    warn_of_times(x[:-1], c[-1], PLACE)  # the lowest coefficients are the values at the breaks
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
