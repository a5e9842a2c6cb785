"""Make curves of the columns of bodies: poses of a base, and wrenches.

A base has columns ``base.x .. base.z, base.qw .. base.qz`` in a table, or poses that a caller gives; what bodies exert
has ``BODY.mx .. BODY.fz``. Both are samples, or come with all rates. Names are selected first, since joints may be
called so too (`select_base_columns`, `select_wrench_columns`), and curves are made of the columns then
(`curve_from_columns`, `build_wrenches`).
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from jounce.arguments.poses import check_pose
from jounce.core.errors import JounceError, join_names, locate_errors, quote_value, warn
from jounce.core.scalars import asarray
from jounce.model import positions
from jounce.model.mechanism import Mechanism
from jounce.motion.base import BASE_COLUMNS, POSE_COLUMNS, align_quaternions, neighbouring_signs
from jounce.motion.composite_curves import CurvePart
from jounce.motion.constructors import as_finite_array, check_increasing
from jounce.motion.curves import COMPONENTS, DEFAULT_ORDER, ArrangedCurve, Curve, Polynomials
from jounce.motion.hermite import HermiteCurve, collect_rates
from jounce.motion.sample_curves import fit_curve
from jounce.motion.spline import SampledColumns, Smoothing, Spline, refuse_smoothing
from jounce.spatial.lie import rotation, to_quaternion
from jounce.spatial.series import RATE_SUFFIX, rate_name

BASE_PREFIX = "base"  # of its columns, for which the name of the base link may stand too
MAX_BASE_SPEED = 50.0  # m/s, which no robot keeps up: positions look like another unit
POSE_COLUMN = re.compile(rf"(.*)\.({'|'.join(POSE_COLUMNS)}){RATE_SUFFIX}(_sd)?", re.DOTALL)
WRENCH_COLUMN = re.compile(r"(.*)\.([mf][xyz])" + RATE_SUFFIX, re.DOTALL)


def select_base_columns(names: Sequence[str], mechanism: Mechanism) -> dict[str, str]:
    """Return the column names of the base, each with the prefix ``base``."""
    prefixes = {BASE_PREFIX, mechanism.base_body or BASE_PREFIX}
    prefixes -= {joint.name for joint in positions.list_multiscrew_joints(mechanism)}
    parts = [(name, POSE_COLUMN.fullmatch(name)) for name in names if name not in mechanism.coordinates]
    return {
        name: f"{BASE_PREFIX}.{name[match.end(1) + 1 :]}" for name, match in parts if match and match[1] in prefixes
    }


def check_base_columns(names: Sequence[str], mechanism: Mechanism, highest: int) -> None:
    """Raise `JounceError` unless the columns of a base are complete.

    They have the prefix ``base``.
    """
    if len(names) == 0 and mechanism.base_body is None:
        return
    if len(names) == 0:
        raise JounceError(
            f"{mechanism.name!r} floats, and no column says where its base is; expected {', '.join(BASE_COLUMNS)}"
            f" (or with the prefix {mechanism.base_body!r}), position in m and unit quaternion"
        )
    rates = range(1 if are_poses_sampled(names) else highest + 1)
    missing = [
        name for name in (f"{BASE_PREFIX}.{rate_name(x, k)}" for x in POSE_COLUMNS for k in rates) if name not in names
    ]
    if len(missing) > 0:
        last = f" with all rates to {rate_name('x', highest)}" if len(rates) > 1 else ""
        raise JounceError(f"missing {join_names(missing)}; expected {', '.join(BASE_COLUMNS)}{last}")


def are_poses_sampled(names: Sequence[str]) -> bool:
    """Return whether columns of a base are samples, without rates."""
    matches = [POSE_COLUMN.fullmatch(name) for name in names]
    return not any(match[3] for match in matches if match is not None)


def base_column_unit(name: str) -> tuple[str, str]:
    """Return the unit of a base column, and its rate's suffix.

    The unit is m, or none (1) of quaternions; the suffix is d, 2d, ....
    """
    match = POSE_COLUMN.fullmatch(name)
    assert match is not None  # `select_base_columns` selects them
    return "1" if match[2].startswith("q") else "m", match[3] or ""


def curve_from_columns(
    t: np.ndarray, columns: Mapping[str, np.ndarray], way: Smoothing | Spline, highest: int, place: str
) -> tuple[Curve | None, tuple[str, ...]]:
    """Return the curve of the columns of a base, and notes.

    The columns are complete; without any there is no curve, None.
    """
    if len(columns) == 0:
        return None, ()
    sampled = are_poses_sampled(list(columns))
    with locate_errors(place):
        columns, notes = align_quaternions(columns, BASE_COLUMNS[3:], sampled, unit=sampled)
    rows, spreads = (collect_rates(columns, BASE_COLUMNS, ending) for ending in ("", "_sd"))
    if sampled:
        curve, further = _curve_from_samples(t, rows[0], way, highest, place)
        return curve, (*notes, *further)
    deviations = spreads if len(spreads) == len(rows) else None
    return HermiteCurve(t, rows, deviations, table=place, names=BASE_COLUMNS), tuple(notes)


def curve_from_poses(
    t: Any, C: Any, way: Smoothing | Spline, start: float, stop: float
) -> tuple[Curve, tuple[str, ...]]:
    """Return the curve of poses of a base, and notes.

    They are C (N, 4, 4) at times t (N,), or one pose (4, 4).
    """
    poses = np.asarray(asarray(C, "C"))
    is_resting = t is None
    if poses.dtype.kind != "f" or poses.ndim != (2 if is_resting else 3) or poses.shape[-2:] != (4, 4):
        came = f"C has shape {poses.shape}" if poses.dtype.kind == "f" else f"C is {quote_value(C)}"
        raise JounceError(f"{came}; expected poses (N, 4, 4) at times t (N,), or t=None and one pose (4, 4)")
    if not np.isfinite(poses).all():
        raise JounceError(f"C holds {poses[~np.isfinite(poses)].flat[0]}; expected finite numbers")
    check_pose(poses)
    poses = poses[None] if is_resting else poses
    # (N, 4, 4) -> (N, 7): positions, and quaternions whose signs follow each other.
    Q = to_quaternion(rotation(poses))
    samples = np.concatenate([poses[:, :3, 3], Q * neighbouring_signs(Q)[:, None]], axis=1)
    if is_resting:
        refuse_smoothing(way, "base", "one pose rests")
        return Polynomials(np.array([start, stop]), samples[None]), ()
    times = as_finite_array(t, "t", 1)
    if len(times) != len(samples):
        raise JounceError(f"t has {len(times)} times and C {len(samples)} poses; expected as many")
    check_increasing(times, "t")
    if times[0] > start or times[-1] < stop:
        raise JounceError(
            f"t goes from {times[0]:g} to {times[-1]:g} s; expected the whole motion, from {start:g} to {stop:g} s"
        )
    curve, notes = _curve_from_samples(times, samples, way, DEFAULT_ORDER, "the motion")
    return CurvePart(curve, start, stop), notes


def _curve_from_samples(
    t: np.ndarray, samples: np.ndarray, way: Smoothing | Spline, highest: int, place: str
) -> tuple[Curve, tuple[str, ...]]:
    """Return the curve of sampled poses (N, 7), and notes."""
    fastest = float(np.median(np.linalg.norm(np.diff(samples[:, :3], axis=0), axis=1) / np.diff(t)))
    if fastest > MAX_BASE_SPEED:
        warn(f"{place}: the base moves at {fastest:.3g} m/s; expected m: a column in mm is called 'base.x [mm]'")
    made = fit_curve(SampledColumns(t, samples, highest, f"{place}: base", BASE_COLUMNS), way)
    residual = "" if made.residual is None else f", at most {made.residual[:3].max():.2g} m from them"
    return made.curve, tuple(f"base: {text}" for text in (made.source + residual, *made.notes))


# Wrenches that bodies exert.
def select_wrench_columns(names: Sequence[str], mechanism: Mechanism) -> list[str]:
    """Return the column names of wrenches.

    A body may be called as a joint is, and a joint ``arm.fx``.
    """
    joints = set(mechanism.coordinates)
    # Names of joints that are no bodies: NAME.fx is then no component of a wrench.
    joints_alone = joints - {*mechanism.frame_names}
    matches = [(name, WRENCH_COLUMN.fullmatch(name)) for name in names if name not in joints]
    return [name for name, match in matches if match is not None and match[1] not in joints_alone]


def are_wrenches_sampled(columns: Iterable[str]) -> bool:
    """Return whether wrench columns are samples, without rates."""
    matches = [WRENCH_COLUMN.fullmatch(name) for name in columns]
    rates = [match[3] for match in matches if match is not None]
    return len(rates) > 0 and not any(rates)


def build_wrenches(
    t: np.ndarray,
    columns: Mapping[str, np.ndarray],
    mechanism: Mechanism,
    order: int,
    way: Smoothing | Spline,
    place: str,
) -> tuple[dict[str, Curve], tuple[str, ...]]:
    """Return W over time by body, and notes.

    It has rates up to `order` at least; components left out are zero.
    """
    # The components of each body, in the order of the columns.
    matches = [WRENCH_COLUMN.fullmatch(name) for name in columns]
    parts = [match.groups() for match in matches if match is not None]
    entries = list(dict.fromkeys((body, component) for body, component, _ in parts))
    with locate_errors(place):
        for body, _ in entries:
            mechanism.frame(body)
    sampled, notes = are_wrenches_sampled(columns), []
    wrenches: dict[str, Curve] = {}
    for body in dict.fromkeys(body for body, _ in entries):
        components = [component for name, component in entries if name == body]
        names = tuple(f"{body}.{component}" for component in components)
        rows = [_stack_rates(columns, body, components, k, place) for k in range(1 if sampled else order + 1)]
        curve: Curve
        if sampled:
            samples = fit_curve(
                SampledColumns(t, rows[0], order, f"{place}: wrench of {quote_value(body)}", names, "W"), way
            )
            curve = samples.curve
            if len(samples.notes) > 0:
                notes += [f"wrench of {quote_value(body)}: {text}" for text in (samples.source, *samples.notes)]
        else:
            curve = HermiteCurve(t, tuple(rows), table=place, names=names)
        # Columns of a wrench in its order, (moment; force): -1 is zero.
        places = [components.index(component) if component in components else -1 for component in COMPONENTS]
        wrenches[body] = ArrangedCurve(curve, np.array(places))
    return wrenches, tuple(notes)


def _stack_rates(
    columns: Mapping[str, np.ndarray], body: str, components: Sequence[str], k: int, place: str
) -> np.ndarray:
    """Return the k-th rate (N, components) of a body's wrench."""
    names = [f"{body}.{rate_name(component, k)}" for component in components]
    missing = [quote_value(name) for name in names if name not in columns]
    if len(missing) > 0:
        raise JounceError(f"{place}: missing {join_names(missing)}; expected every wrench column with all its rates")
    return np.stack([columns[name] for name in names], axis=1)
