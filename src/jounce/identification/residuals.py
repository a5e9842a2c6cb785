"""How far predicted forces are from measured ones, in the band of the motion and sample by sample."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from jounce.identification.cells import averages, places
from jounce.identification.measurements import Measurements


@dataclass(frozen=True)
class ForceResidual:
    """How far predicted forces are from measured ones, as root mean squares of one force.

    Attributes
    ----------
    force, unit : str
        The coordinate that it acts on, or the component of the wrench on a base that floats.
    part : {"used", "rest"}
        The samples that the result is fitted to, or the others.
    measured : float
        The measured force itself, in the band of the motion.
    model, identified : float
        What the model as it was leaves, and what the identified robot leaves, in the band of the motion.
    model_samples, identified_samples : float
        The same of single samples, with all that is faster.

    Examples
    --------
    >>> import jounce
    >>> robot = jounce.load("planar2r")
    >>> motion = jounce.Motion.fourier([0, 0], [[0.5, 0.2], [0.1, 0.4]], [[0.1, 0.3], [0.5, 0.2]], 3.0, 4.0)
    >>> found = jounce.identify(robot, motion, 2 * robot.forces_along(motion, order=0).forces[0], prior=1.0)
    >>> row = found.residuals[0]
    >>> row.force, row.part, row.identified < 0.01 * row.model
    ('joint1', 'used', True)
    """

    force: str
    unit: str
    part: str
    measured: float
    model: float
    identified: float
    model_samples: float
    identified_samples: float


def residuals(
    part: str,
    samples: Measurements,
    model: np.ndarray,
    predicted: np.ndarray,
    width: float,
    names: Sequence[str],
    units: Sequence[str],
) -> list[ForceResidual]:
    """The residuals of forces (N, nv) of the model and of the identified robot, of the forces that are measured."""
    if not len(samples.t):
        return []
    place, w = places(samples.t, width), samples.weights
    off = [samples.forces, samples.forces - model, samples.forces - predicted]
    counts = averages(np.ones_like(w), w, place)[1]
    band = [_rms(averages(values, w, place)[0], counts) for values in off]
    single = [_rms(values, w) for values in off[1:]]
    rows = np.stack([*band, *single], axis=1)
    return [
        ForceResidual(name, unit, part, *map(float, row))
        for name, unit, row, count in zip(names, units, rows, counts.sum(axis=0), strict=True)
        if count
    ]


def _rms(values: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Weighted root mean squares of columns."""
    total = np.maximum(weights.sum(axis=0), np.finfo(float).tiny)
    return np.sqrt((weights * values**2).sum(axis=0) / total)
