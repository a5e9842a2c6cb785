"""Find the worst limit at samples with known forces.

Only a check finds what happens between them.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from jounce.core.errors import join_names, warn
from jounce.limits.joints import (
    drives_coordinates,
    has_motors,
    joint_limits,
    limits_of_coordinates,
    power_factors,
)
from jounce.limits.ratios import build_scale
from jounce.model.limits import LIMIT_KINDS, Limits
from jounce.model.mechanism import Mechanism


class Sample(NamedTuple):
    """The largest ratio of a value to its limit: of which kind and coordinate, and when."""

    ratio: float
    kind: str
    joint: int
    t: float


def reported_limits(m: Mechanism) -> Limits:
    """Return the limits that are looked at where forces are computed: those of coordinates.

    Limits of forces are of motors. Where motors are elsewhere, Q does not show their forces, and a warning says so.
    """
    limits = limits_of_coordinates(m)
    if not drives_coordinates(m) or m.elasticity is not None:
        limits = limits.without((kind, 0) for kind in LIMIT_KINDS.totals)
    motor_kinds = [kind for kind in joint_limits(m).kinds if kind not in (*limits.kinds, *LIMIT_KINDS.motion)]
    if len(motor_kinds) > 0:
        warn(
            f"{m.name!r}: limits of {join_names(motor_kinds)} are of motors, which Q is not of;"
            " jounce check judges them"
        )
    return limits


def find_worst_broken(
    limits: Limits, t: np.ndarray, rates: tuple[np.ndarray, ...], forces: tuple[np.ndarray, ...]
) -> Sample | None:
    """Find the limit of a coordinate that rates and forces break most.

    The rates q, qd, ... are (N, n), and the forces Q, Qd, ... (N, nv). Limits that are 0 on both sides are not known:
    files state them so.
    """
    # (N, nv) -> (N, n), without the forces of a base.
    forces = tuple(force[:, -rates[0].shape[1] :] for force in forces)
    samples, values = [], limited_values(limits, rates, forces)
    if "total_power" in limits.kinds and len(rates) > 1:
        values["total_power"] = (forces[0] * rates[1]).sum(axis=1, keepdims=True)
    for kind, value in values.items():
        bounds = limits.bounds(kind)
        bounds = np.where((bounds == 0).all(axis=0), [[-np.inf], [np.inf]], bounds)
        if not np.isfinite(bounds).any():
            continue
        scale = build_scale(bounds, kind)
        # Columns of an array in Fortran's order are reduced several times as fast. Extremes alone show that most limits
        # are kept; NaN, a value that is not known, shows nothing.
        x = np.asfortranarray(value)
        ends = np.maximum(scale.ratio(x.max(axis=0), 1), scale.ratio(x.min(axis=0), -1))
        if not (ends <= 1).all():
            ratio = scale.largest(value)
            ratio[np.isnan(ratio)] = 0
            i, j = np.unravel_index(ratio.argmax(), ratio.shape)
            samples.append(Sample(float(ratio[i, j]), kind, int(j), float(t[i])))
    return max((sample for sample in samples if sample.ratio > 1), default=None)


def sum_powers(m: Mechanism, factors: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return the sums over all joints that limits bound, by kind.

    Each is (N, 1). Factors are values (N, joints) by kind. Sums whose factors are not among them are left out.
    """
    sums = {}
    for kind in LIMIT_KINDS.totals:
        names = power_factors(m, kind)
        if all(name in factors for name in names):
            product = factors[names[0]] * factors[names[1]]
            sums[kind] = np.where(has_motors(m), product, 0).sum(axis=1, keepdims=True)
    return sums


def limited_values(
    limits: Limits, rates: Sequence[np.ndarray], forces: Sequence[np.ndarray], gravity: Sequence[np.ndarray] = ()
) -> dict[str, np.ndarray]:
    """Return the limited values by kind from rates and forces.

    Rates are q, qd, ..., forces Q, Qd, ..., and gravity is Qgrav with its rates, (N, n) each. Without gravity there are
    no values of Q - Qgrav.
    """
    values = dict(zip(LIMIT_KINDS.motion, rates, strict=False))
    weight = dict(zip(LIMIT_KINDS.effort, gravity, strict=False))
    slope = limits.effort_slope
    for kind, row in LIMIT_KINDS.items():
        if not row.force or row.rate >= len(forces):
            continue
        Q = forces[row.rate]
        if kind in limits.without_gravity:
            if kind not in weight:
                continue
            Q = Q - weight[kind]
        values[kind] = row.law(Q, rates[1], slope)
    return values
