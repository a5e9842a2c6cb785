"""The worst limit at samples of a motion whose forces are computed anyway; between them only a check looks."""

from typing import NamedTuple

import numpy as np

from jounce.limits.ratios import scale_of
from jounce.limits.worst import SIGNS
from jounce.model.limits import EFFORT_KINDS, FORCES, MOTION_KINDS, Limits


class Sample(NamedTuple):
    """The largest ratio of a value to its limit: of which kind and coordinate, and when."""

    ratio: float
    kind: str
    joint: int
    t: float


def worst_broken(
    limits: Limits, t: np.ndarray, rates: tuple[np.ndarray, ...], forces: tuple[np.ndarray, ...]
) -> Sample | None:
    """The limit of a coordinate that rates q, qd, ... (N, n) and forces Q, Qd, ... (N, nv) break most."""
    forces = tuple(force[:, -rates[0].shape[1] :] for force in forces)  # without those of a base
    values = dict(zip(MOTION_KINDS, rates, strict=False)) | {
        kind: force
        for kind, force in zip(EFFORT_KINDS, forces, strict=False)
        if limits.of(kind) == FORCES[0]
    }  # fmt: skip
    found = []
    values |= {"power": rates[1] * forces[0], "stall_effort": forces[0] + limits.effort_slope * rates[1]}
    for kind, value in values.items():
        if not np.isfinite(limits.bounds(kind)).any():
            continue
        scale = scale_of(limits.bounds(kind), kind)
        x = np.asfortranarray(value)  # whose columns are summed up several times as fast
        ends = np.maximum(scale.ratio(x.max(axis=0), 1), scale.ratio(x.min(axis=0), -1))
        if not (ends <= 1).all():  # or some are not known
            ratio = np.maximum(*(scale.ratio(value, sign) for sign in SIGNS))
            ratio[np.isnan(ratio)] = 0
            i, j = np.unravel_index(ratio.argmax(), ratio.shape)
            found.append(Sample(float(ratio[i, j]), kind, int(j), float(t[i])))
    return max((sample for sample in found if sample.ratio > 1), default=None)
