"""Loads on a body as a caller gives them, force and torque with their rates or without, as arrays.

A *tuple* is a vector with its rates; anything else, lists and a tuple of three numbers included, is the vector alone.
"""

from collections.abc import Sequence

import numpy as np

from jounce.arguments.rates import is_unbatched, rates_in
from jounce.core.errors import JounceError, one_of, warn
from jounce.core.scalars import Array, asarray, broadcast, concatenate, shaped
from jounce.spatial.series import rate_name

LOAD_FRAMES = ("world", "body")


def load_of(force: object, torque: object, order: int, q: Sequence[Array]) -> list[Array]:
    """Return a caller's load (torque; force), (..., 1, 6), and its rates up to `order`, at the states `q`."""
    if force is None and torque is None:
        raise JounceError("neither force nor torque is given; expected force=, torque= or both")
    torques, forces = _rates(torque, "torque", order, q), _rates(force, "force", order, q)
    both = (broadcast(pair, [1, 1], ["torque", "force"]) for pair in zip(torques, forces, strict=True))
    return [concatenate(pair, axis=-1)[..., None, :] for pair in both]


def place_of(axes: str, point: object, force: object) -> Array:
    """Return the point (3,) where a force acts, the link's origin if None, and check the name of the axes."""
    one_of("frame of a load", axes, LOAD_FRAMES)
    p = np.zeros(3, dtype=int) if point is None else asarray(point, "point")
    if p.shape != (3,):
        raise JounceError(f"point has shape {p.shape}; expected (3,), in the frame of the link")
    if point is not None and force is None:
        warn("point has no effect on a torque: it is where force= acts")
    return p


def _rates(given: object, label: str, order: int, q: Sequence[Array]) -> list[Array]:
    """Return a vector (..., 3) and its rates: a tuple has all of them, a single array is constant in its axes."""
    rates = rates_in(given)
    if rates is not None and len(rates) != order + 1:
        raise JounceError(f"{label} gives {len(rates)} terms; order {order} takes it and its rates, {order + 1} terms")
    terms = [np.zeros(3) if given is None else given] if rates is None else rates
    arrays = [shaped(term, (3,), rate_name(label, k)) for k, term in enumerate(terms)]
    if order and isinstance(given, list) and arrays[0].shape == (order + 1, 3) and is_unbatched(q):
        warn(f"{label} is a list of {order + 1} vectors, read as a batch; a tuple gives a vector with its rates")
    return arrays + [0 * arrays[0]] * (order + 1 - len(arrays))
