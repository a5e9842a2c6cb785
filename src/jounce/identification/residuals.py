"""How far predicted forces are from measured ones, in the band of the motion and sample by sample."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from jounce.identification.cells import averages, places
from jounce.identification.problem import Problem
from jounce.model.coordinates import force_names, force_units


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
    >>> found = robot.identify(motion, 2 * robot.forces_along(motion, order=0).forces[0], prior=1.0)
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


def residuals(posed: Problem, predicted: np.ndarray) -> tuple[ForceResidual, ...]:
    """The residuals of the model and of predicted forces (N, nv): of the samples that are used, then of the rest."""
    parts = (("used", posed.used), ("rest", ~posed.used))
    return tuple(row for part, which in parts if which.any() for row in _of_part(posed, predicted, part, which))


def _of_part(posed: Problem, predicted: np.ndarray, part: str, which: np.ndarray) -> Iterator[ForceResidual]:
    """The residuals of a part of the samples, of the forces that are measured there."""
    m, samples = posed.robot.mechanism, posed.given.part(which)
    place, w = places(samples.t, posed.width), samples.weights
    off = [samples.forces, samples.forces - posed.model[which], samples.forces - predicted[which]]
    counts = averages(np.ones_like(w), w, place)[1]
    band = [_rms(averages(values, w, place)[0], counts) for values in off]
    rows = np.stack([*band, *(_rms(values, w) for values in off[1:])], axis=1)
    for j, (name, unit) in enumerate(zip(force_names(m), force_units(m), strict=True)):
        if counts[:, j].any():
            yield ForceResidual(name, unit, part, *map(float, rows[j]))


def _rms(values: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Weighted root mean squares of columns."""
    total = np.maximum(weights.sum(axis=0), np.finfo(float).tiny)
    return np.sqrt((weights * values**2).sum(axis=0) / total)
