"""Coordinates q and joint variables theta of a mechanism: ``theta = G q + g`` and what follows from it.

Forces and matrices of the joint variables become those of the coordinates by G^T (the principle of virtual work). All
three maps take arrays and time series alike.
"""

from typing import TypeVar

import numpy as np

from jounce._scalars import Array
from jounce.model.mechanism import Mechanism
from jounce.spatial.series import Series

T = TypeVar("T", Array, Series)

TURNS = 8 * np.pi  # rad: four turns, further than joints without limits are taken to go


def joint_variables(mechanism: Mechanism, q: T) -> T:
    """theta = G q + g: (..., n, 1) to (..., nb, 1)."""
    return mechanism.G @ q + mechanism.g[:, None]


def generalized_forces(mechanism: Mechanism, Q: T) -> T:
    """G^T Q of forces or momenta of the joint variables: (..., nb, k) to (..., n, k)."""
    return mechanism.G.T @ Q


def generalized_matrix(mechanism: Mechanism, M: T) -> T:
    """G^T M G of a matrix of the joint variables: (..., nb, nb) to (..., n, n)."""
    return mechanism.G.T @ M @ mechanism.G


def leading_joints(mechanism: Mechanism) -> list[int]:
    """Return for each coordinate the joint with its name, or the first joint that follows it."""
    places = {joint: i for i, joint in enumerate(mechanism.joints)}
    return [
        places[name] if name in places else int(np.flatnonzero(column)[0])
        for name, column in zip(mechanism.coordinates, mechanism.G.T, strict=True)
    ]


def coordinate_units(mechanism: Mechanism) -> list[str]:
    """rad or m: the unit of each coordinate."""
    return ["rad" if np.any(X[:3]) else "m" for X in mechanism.X[leading_joints(mechanism)]]


def likely_positions(mechanism: Mechanism) -> tuple[np.ndarray, np.ndarray]:
    """Bounds (nb,) of the joint variables: their limits, and some turns for those that turn without any."""
    widest = np.where(mechanism.X[:, :3].any(axis=1), TURNS, np.inf)
    lower, upper = mechanism.limits.lower, mechanism.limits.upper
    return np.where(np.isfinite(lower), lower, -widest), np.where(np.isfinite(upper), upper, widest)
