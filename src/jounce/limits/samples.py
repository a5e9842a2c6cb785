"""The worst limit at samples of a motion whose forces are known; only a check finds what happens between them."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from jounce.core.errors import join_names, warn
from jounce.limits.joints import joint_limits, limits_of_coordinates
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
    """The limits that are looked at where forces are computed: those of coordinates.

    Limits of forces are of motors: where these are elsewhere, Q says nothing of them, and a warning does.
    """
    limits = limits_of_coordinates(m)
    if of_motors := [kind for kind in joint_limits(m).kinds if kind not in (*limits.kinds, *LIMIT_KINDS.motion)]:
        warn(
            f"{m.name!r}: limits of {join_names(of_motors)} are of motors, which Q is not of; jounce check judges them"
        )
    return limits


def find_worst_broken(
    limits: Limits, t: np.ndarray, rates: tuple[np.ndarray, ...], forces: tuple[np.ndarray, ...]
) -> Sample | None:
    """The limit of a coordinate that rates q, qd, ... (N, n) and forces Q, Qd, ... (N, nv) break most.

    Limits that are 0 on both sides are not known: files state them so.
    """
    forces = tuple(force[:, -rates[0].shape[1] :] for force in forces)  # without those of a base
    found = []
    for kind, value in limited_values(limits, rates, forces).items():
        bounds = limits.bounds(kind)
        bounds = np.where((bounds == 0).all(axis=0), [[-np.inf], [np.inf]], bounds)
        if not np.isfinite(bounds).any():
            continue
        scale = build_scale(bounds, kind)
        x = np.asfortranarray(value)  # whose columns are reduced several times as fast
        ends = np.maximum(scale.ratio(x.max(axis=0), 1), scale.ratio(x.min(axis=0), -1))
        if not (ends <= 1).all():  # or some are not known
            ratio = scale.largest(value)
            ratio[np.isnan(ratio)] = 0
            i, j = np.unravel_index(ratio.argmax(), ratio.shape)
            found.append(Sample(float(ratio[i, j]), kind, int(j), float(t[i])))
    return max((sample for sample in found if sample.ratio > 1), default=None)


def limited_values(
    limits: Limits, rates: Sequence[np.ndarray], forces: Sequence[np.ndarray], gravity: Sequence[np.ndarray] = ()
) -> dict[str, np.ndarray]:
    """The limited values by kind, from q, qd, ..., Q, Qd, ... and Qgrav (N, n); without Qgrav none of Q - Qgrav."""
    found, weight = (
        dict(zip(LIMIT_KINDS.motion, rates, strict=False)),
        dict(zip(LIMIT_KINDS.effort, gravity, strict=False)),
    )
    slope = limits.effort_slope
    for kind, row in LIMIT_KINDS.items():
        if row.force and row.rate < len(forces) and (kind in weight or kind not in limits.without_gravity):
            Q = forces[row.rate] - weight[kind] if kind in limits.without_gravity else forces[row.rate]
            found[kind] = row.law(Q, rates[1], slope)
    return found
