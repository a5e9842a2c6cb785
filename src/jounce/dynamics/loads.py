"""Loads ON bodies, in world or body axes and at a point, made into the wrenches W that bodies exert, with rates."""

from collections.abc import Sequence

import numpy as np

from jounce._scalars import Array, asarray, broadcast, concatenate
from jounce.arguments.rates import is_unbatched, rates_in
from jounce.dynamics.kinematics import in_blocks
from jounce.dynamics.recursion import bodies
from jounce.errors import JounceError, one_of, warn
from jounce.model.mechanism import Mechanism
from jounce.spatial import lie
from jounce.spatial.series import Series, rate_name

AXES = ("world", "body")


def wrench(mechanism: Mechanism, q: Series, load: Series, body: str, axes: str, point: Array) -> Series:
    """W, (..., nb, 6), of a load (torque; force), (..., 6, 1), that acts on a body or merged link at a point of it.

    The rates of a load in world axes hold those of the link's rotation.
    """
    link = mechanism.frame(body)
    if axes == "world":
        R = bodies.poses(mechanism, q, link.body).map(lambda H: lie.rotation(H @ link.T))
        load = in_blocks(R.mT, 0 * R) @ load
    about_origin = lie.Ad(lie.pose(np.eye(3, dtype=int), -point[:, None])).mT  # (torque + p x force; force)
    W = -(lie.Ad(lie.inverse(link.T)).mT @ about_origin @ load)
    rows = np.zeros((mechanism.nb, 1), dtype=int)
    rows[max(link.body, 0)] = link.body >= 0  # what acts on the ground moves nothing
    return W.map(lambda W: rows * W[..., None, :, 0])


def checked(force: object, torque: object, order: int, q: Sequence[Array]) -> list[Array]:
    """The load (torque; force), (..., 1, 6), and its rates up to `order`, from a caller's data at the states `q`."""
    torques, forces = _rates(torque, "torque", order, q), _rates(force, "force", order, q)
    both = (broadcast(pair, [1, 1], ["torque", "force"]) for pair in zip(torques, forces, strict=True))
    return [concatenate(pair, axis=-1)[..., None, :] for pair in both]


def checked_place(axes: str, point: object) -> Array:
    """The point (3,) where a load acts, the link's origin if None; the axes are checked beside it."""
    one_of("frame of a load", axes, AXES)
    p = np.zeros(3, dtype=int) if point is None else asarray(point, "point")
    if p.shape != (3,):
        raise JounceError(f"point has shape {p.shape}; expected (3,), in the frame of the link")
    return p


def _rates(given: object, label: str, order: int, q: Sequence[Array]) -> list[Array]:
    """A vector (..., 3) and its rates: a tuple gives them all, an array alone is constant in its axes."""
    rates = rates_in(given)
    if rates is not None and len(rates) != order + 1:
        raise JounceError(f"{label} gives {len(rates)} terms; order {order} takes it and its rates, {order + 1} terms")
    terms = [np.zeros(3) if given is None else given] if rates is None else rates
    arrays = [asarray(term, rate_name(label, k)) for k, term in enumerate(terms)]
    for k, array in enumerate(arrays):
        if array.ndim == 0 or array.shape[-1] != 3:
            raise JounceError(f"{rate_name(label, k)} has shape {array.shape}; expected (..., 3)")
    if order and isinstance(given, list) and arrays[0].shape == (order + 1, 3) and is_unbatched(q):
        warn(f"{label} is a list of {order + 1} vectors, read as a batch; a tuple gives a vector with its rates")
    return arrays + [0 * arrays[0]] * (order + 1 - len(arrays))
