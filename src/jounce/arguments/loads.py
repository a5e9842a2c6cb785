"""Convert the loads that a caller gives, with their rates, to arrays.

Loads are force and torque on a body, and wrenches of the bodies.

A *tuple* is a load with its rates; anything else, lists and a tuple of three numbers included, is the load alone. A
wrench W_i = (moment; force) is what body i EXERTS ON its environment, in body-frame components about the origin of the
body frame: Qext = +J^T W.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from jounce.arguments.rates import find_rates, is_unbatched
from jounce.core import scalars
from jounce.core.errors import JounceError, check_choice, quote_value, warn
from jounce.core.scalars import Array, array_of_shape, asarray, broadcast
from jounce.model.mechanism import Mechanism
from jounce.spatial.lie import Ad, inverse
from jounce.spatial.series import rate_name

LOAD_FRAMES = ("world", "body")


def convert_load(force: object, torque: object, order: int, q: Sequence[Array]) -> list[Array]:
    """Return a load (torque; force), (..., 1, 6), with its rates.

    Its rates go up to `order`, at the states `q`.
    """
    if force is None and torque is None:
        raise JounceError("neither force nor torque is given; expected force=, torque= or both")
    torques, forces = _vector_rates(torque, "torque", order, q), _vector_rates(force, "force", order, q)
    pairs = (broadcast(pair, [1, 1], ["torque", "force"]) for pair in zip(torques, forces, strict=True))
    # Two (..., 3) -> (..., 1, 6), a wrench on one body.
    return [scalars.concatenate(pair, axis=-1)[..., None, :] for pair in pairs]


def convert_load_point(axes: str, point: object, force: object) -> Array:
    """Return the point (3,) where a force acts.

    It is the origin of the link if None. The name of the axes is checked.
    """
    check_choice("frame of a load", axes, LOAD_FRAMES)
    p = np.zeros(3, dtype=int) if point is None else asarray(point, "point")
    if p.shape != (3,):
        raise JounceError(f"point has shape {p.shape}; expected (3,), in the frame of the link")
    if point is not None and force is None:
        warn("point has no effect on a torque: it is where force= acts")
    return p


def _vector_rates(vector: object, label: str, order: int, q: Sequence[Array]) -> list[Array]:
    """Return a vector (..., 3) and its rates.

    A tuple has all of them; a single array is constant in its axes.
    """
    rates = find_rates(vector)
    if rates is not None and len(rates) != order + 1:
        raise JounceError(f"{label} gives {len(rates)} terms; order {order} takes it and its rates, {order + 1} terms")
    constant = np.zeros(3) if vector is None else vector
    terms = [constant] if rates is None else rates
    arrays = [array_of_shape(term, (3,), rate_name(label, k)) for k, term in enumerate(terms)]
    # A list of as many vectors as there are rates is mistaken for a tuple easily.
    if order > 0 and isinstance(vector, list) and arrays[0].shape == (order + 1, 3) and is_unbatched(q):
        warn(f"{label} is a list of {order + 1} vectors, read as a batch; a tuple gives a vector with its rates")
    return arrays + [0 * arrays[0]] * (order + 1 - len(arrays))


def convert_wrenches(
    mechanism: Mechanism, wrench: object, order: int, q: Sequence[Array], least: int = 1
) -> list[Array]:
    """Return W and its rates for a quantity to an order.

    The list is empty if `wrench` is None. `q` are the states. The quantity itself takes the first `least` of W, Wd,
    ...; each of its rates takes one more.
    """
    if wrench is None:
        return []
    rates, count = find_rates(wrench), least + order
    terms = (wrench,) if rates is None else rates
    if len(terms) != count:
        have = "nothing"
        if rates is None:
            have = "W alone"
        elif len(rates) > 0:
            have = _rate_names(len(rates))
        takes = f"a tuple ({_rate_names(count)})" if count > 1 else "W alone"
        raise JounceError(f"wrench gives {have}; order {order} takes {takes}; a list is one array")
    at_one_state = is_unbatched(q)
    return [_wrenches_on_bodies(mechanism, W, rate_name("W", k), at_one_state) for k, W in enumerate(terms)]


def _rate_names(count: int) -> str:
    """Return the names of W and its rates."""
    names = [rate_name("W", k) for k in range(count)]
    return ", ".join([*names[:2], "...", names[-1]] if count > 3 else names)


def _wrenches_on_bodies(mechanism: Mechanism, W: object, label: str, at_one_state: bool) -> Array:
    """Return W (..., nb, 6) of all bodies.

    Wrenches on merged links, by name, are transported to the body frames.
    """
    nb = mechanism.nb
    if not isinstance(W, Mapping):
        return array_of_shape(W, (nb, 6), label, ", or a dict of body names to (..., 6)")
    parts: list[Array] = [np.zeros((nb, 6))]
    for name, value in W.items():
        frame, what = mechanism.frame(name), f"{label}[{quote_value(name)}]"
        array = array_of_shape(value, (6,), what, ", (moment; force)")
        if at_one_state and array.shape == (nb, 6) != (1, 6):
            raise JounceError(
                f"{what} has shape {array.shape}, as W of all bodies has; expected (6,), or W without names;"
                f" for {nb} wrenches in turn make a batch of the state, q[None]"
            )
        # A wrench between the ground and its environment moves nothing.
        if frame.body >= 0:
            # W_body = Ad(T^-1)^T W_frame, in the row of the body: (..., 6) -> (..., nb, 6).
            T = scalars.restore_integers(frame.T) if scalars.is_symbolic(array) else frame.T
            W_body = Ad(inverse(T)).mT @ array[..., None]
            parts.append(np.eye(nb, dtype=int)[frame.body][:, None] * W_body[..., None, :, 0])
    return sum(broadcast(parts, [2] * len(parts), ["bodies", *(f"{label}[{quote_value(name)}]" for name in W)]))
