"""Wrenches of the bodies as a caller gives them, converted to arrays (..., nb, 6) in the body frames.

A wrench W_i = (moment; force) is what body i EXERTS ON its environment, in body-frame components about the origin of
the body frame: Qext = +J^T W.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from jounce.arguments.rates import is_unbatched, rates_in
from jounce.core.errors import JounceError, quoted
from jounce.core.scalars import Array, broadcast, exact_integers, is_symbolic, shaped
from jounce.model.mechanism import Mechanism
from jounce.spatial.lie import Ad, inverse
from jounce.spatial.series import rate_name


def wrenches_of(mechanism: Mechanism, wrench: object, order: int, q: Sequence[Array], least: int = 1) -> list[Array]:
    """Return W and its rates for a quantity to an order, at the states `q`; an empty list if `wrench` is None.

    The quantity itself takes the first `least` of W, Wd, ...; each of its rates takes one more.
    """
    if wrench is None:
        return []
    given, count = rates_in(wrench), least + order
    terms = (wrench,) if given is None else given
    if len(terms) != count:
        have = "W alone" if given is None else _rates(len(given)) or "nothing"
        takes = f"a tuple ({_rates(count)})" if count > 1 else "W alone"
        raise JounceError(f"wrench gives {have}; order {order} takes {takes}; a list is one array")
    at_one_state = is_unbatched(q)
    return [_on_bodies(mechanism, W, rate_name("W", k), at_one_state) for k, W in enumerate(terms)]


def _rates(count: int) -> str:
    """The names of W and its rates."""
    names = [rate_name("W", k) for k in range(count)]
    return ", ".join([*names[:2], "...", names[-1]] if count > 3 else names)


def _on_bodies(mechanism: Mechanism, W: object, label: str, at_one_state: bool) -> Array:
    """W of all bodies; wrenches on merged links, by name, are transported to the body frames."""
    nb = mechanism.nb
    if not isinstance(W, Mapping):
        return shaped(W, (nb, 6), label, ", or a dict of body names to (..., 6)")
    parts: list[Array] = [np.zeros((nb, 6))]
    for name, value in W.items():
        frame, what = mechanism.frame(name), f"{label}[{quoted(name)}]"
        array = shaped(value, (6,), what, ", (moment; force)")
        if at_one_state and array.shape == (nb, 6) != (1, 6):
            raise JounceError(
                f"{what} has shape {array.shape}, as W of all bodies has; expected (6,), or W without names;"
                f" for {nb} wrenches in turn make a batch of the state, q[None]"
            )
        if frame.body >= 0:  # a wrench between the ground and its environment moves nothing
            T = exact_integers(frame.T) if is_symbolic(array) else frame.T
            local = Ad(inverse(T)).mT @ array[..., None]
            parts.append(np.eye(nb, dtype=int)[frame.body][:, None] * local[..., None, :, 0])
    return sum(broadcast(parts, [2] * len(parts), ["bodies", *(f"{label}[{quoted(name)}]" for name in W)]))
