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
    """Those column names that are of the base, each as it is with the prefix ``base``."""
    prefixes = {BASE_PREFIX, mechanism.base_body or BASE_PREFIX}
    prefixes -= {joint.name for joint in positions.list_multiscrew_joints(mechanism)}
    parts = [(name, POSE_COLUMN.fullmatch(name)) for name in names if name not in mechanism.coordinates]
    return {
        name: f"{BASE_PREFIX}.{name[match.end(1) + 1 :]}" for name, match in parts if match and match[1] in prefixes
    }


def check_base_columns(names: Sequence[str], mechanism: Mechanism, highest: int) -> None:
    """Raise `JounceError` unless the columns of a base, with the prefix ``base``, are complete."""
    if not names and mechanism.base_body is None:
        return
    if not names:
        raise JounceError(
            f"{mechanism.name!r} floats, and no column says where its base is; expected {', '.join(BASE_COLUMNS)}"
            f" (or with the prefix {mechanism.base_body!r}), position in m and unit quaternion"
        )
    rates = range(1 if are_poses_sampled(names) else highest + 1)
    missing = [
        name for name in (f"{BASE_PREFIX}.{rate_name(x, k)}" for x in POSE_COLUMNS for k in rates) if name not in names
    ]
    if missing:
        last = f" with all rates to {rate_name('x', highest)}" if len(rates) > 1 else ""
        raise JounceError(f"missing {join_names(missing)}; expected {', '.join(BASE_COLUMNS)}{last}")


def are_poses_sampled(names: Sequence[str]) -> bool:
    """Whether columns of a base are samples, without rates of their own."""
    return not any(match[3] for name in names if (match := POSE_COLUMN.fullmatch(name)))


def base_column_unit(name: str) -> tuple[str, str]:
    """The unit of a column of a base, m or none (1) of quaternions, and what its name adds for the rate: d, 2d, ..."""
    match = POSE_COLUMN.fullmatch(name)
    assert match is not None  # `named` selects them
    return "1" if match[2].startswith("q") else "m", match[3] or ""


def curve_from_columns(
    t: np.ndarray, columns: Mapping[str, np.ndarray], way: Smoothing | Spline, highest: int, place: str
) -> tuple[Curve | None, tuple[str, ...]]:
    """The curve of the columns of a base, which are complete, and notes; None without any."""
    if not columns:
        return None, ()
    sampled = are_poses_sampled(list(columns))
    with locate_errors(place):
        columns, notes = align_quaternions(columns, BASE_COLUMNS[3:], sampled, unit=sampled)
    rows, spreads = (collect_rates(columns, BASE_COLUMNS, ending) for ending in ("", "_sd"))
    if sampled:
        curve, further = _curve_from_samples(t, rows[0], way, highest, place)
        return curve, (*notes, *further)
    return HermiteCurve(
        t, rows, spreads if len(spreads) == len(rows) else None, table=place, names=BASE_COLUMNS
    ), tuple(notes)


def curve_from_poses(
    t: Any, C: Any, way: Smoothing | Spline, start: float, stop: float
) -> tuple[Curve, tuple[str, ...]]:
    """The curve of poses C (N, 4, 4) at times t (N,), or of one pose (4, 4), for a motion; and notes."""
    poses = np.asarray(asarray(C, "C"))
    one = t is None
    if poses.dtype.kind != "f" or poses.ndim != (2 if one else 3) or poses.shape[-2:] != (4, 4):
        came = f"C has shape {poses.shape}" if poses.dtype.kind == "f" else f"C is {quote_value(C)}"
        raise JounceError(f"{came}; expected poses (N, 4, 4) at times t (N,), or t=None and one pose (4, 4)")
    if not np.isfinite(poses).all():
        raise JounceError(f"C holds {poses[~np.isfinite(poses)].flat[0]}; expected finite numbers")
    check_pose(poses)
    poses = poses[None] if one else poses
    Q = to_quaternion(rotation(poses))
    samples = np.concatenate([poses[:, :3, 3], Q * neighbouring_signs(Q)[:, None]], axis=1)
    if one:
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
    fastest = float(np.median(np.linalg.norm(np.diff(samples[:, :3], axis=0), axis=1) / np.diff(t)))
    if fastest > MAX_BASE_SPEED:
        warn(f"{place}: the base moves at {fastest:.3g} m/s; expected m: a column in mm is called 'base.x [mm]'")
    found = fit_curve(SampledColumns(t, samples, highest, f"{place}: base", BASE_COLUMNS), way)
    residual = "" if found.residual is None else f", at most {found.residual[:3].max():.2g} m from them"
    return found.curve, tuple(f"base: {text}" for text in (found.source + residual, *found.notes))


# Wrenches that bodies exert.
def select_wrench_columns(names: Sequence[str], mechanism: Mechanism) -> list[str]:
    """Those column names that are of wrenches; a body may be called as a joint is, and a joint ``arm.fx``."""
    joints = set(mechanism.coordinates)
    others = joints - {*mechanism.frame_names}
    return [
        name for name in names if name not in joints and (m := WRENCH_COLUMN.fullmatch(name)) and m[1] not in others
    ]


def are_wrenches_sampled(columns: Iterable[str]) -> bool:
    """Whether wrench columns are samples, without rates of their own."""
    rates = [match[3] for name in columns if (match := WRENCH_COLUMN.fullmatch(name))]
    return bool(rates) and not any(rates)


def build_wrenches(
    t: np.ndarray,
    columns: Mapping[str, np.ndarray],
    mechanism: Mechanism,
    order: int,
    way: Smoothing | Spline,
    place: str,
) -> tuple[dict[str, Curve], tuple[str, ...]]:
    """W over time by body, with rates up to `order` at least, and notes; components left out are zero."""
    parts = [match.groups() for name in columns if (match := WRENCH_COLUMN.fullmatch(name))]
    given = list(dict.fromkeys((body, component) for body, component, _ in parts))
    with locate_errors(place):
        for body, _ in given:
            mechanism.frame(body)
    sampled, notes = are_wrenches_sampled(columns), []
    found: dict[str, Curve] = {}
    for body in dict.fromkeys(body for body, _ in given):
        components = [component for name, component in given if name == body]
        names = tuple(f"{body}.{component}" for component in components)
        rows = [_stack_rates(columns, body, components, k, place) for k in range(1 if sampled else order + 1)]
        curve: Curve
        if sampled:
            samples = fit_curve(
                SampledColumns(t, rows[0], order, f"{place}: wrench of {quote_value(body)}", names, "W"), way
            )
            curve = samples.curve
            if samples.notes:
                notes += [f"wrench of {quote_value(body)}: {text}" for text in (samples.source, *samples.notes)]
        else:
            curve = HermiteCurve(t, tuple(rows), table=place, names=names)
        places = [components.index(component) if component in components else -1 for component in COMPONENTS]
        found[body] = ArrangedCurve(curve, np.array(places))
    return found, tuple(notes)


def _stack_rates(
    columns: Mapping[str, np.ndarray], body: str, components: Sequence[str], k: int, place: str
) -> np.ndarray:
    names = [f"{body}.{rate_name(component, k)}" for component in components]
    missing = [quote_value(name) for name in names if name not in columns]
    if missing:
        raise JounceError(f"{place}: missing {join_names(missing)}; expected every wrench column with all its rates")
    return np.stack([columns[name] for name in names], axis=1)
