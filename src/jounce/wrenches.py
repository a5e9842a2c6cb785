"""Wrenches on the bodies, in whatever form a caller gives them, as arrays (..., nb, 6) in the body frames.

A wrench W_i = (moment; force) is what body i EXERTS ON its environment, in body-frame components about the origin of
the body frame: Qext = +J^T W.
"""

from collections.abc import Mapping

import numpy as np

from jounce._scalars import Array, asarray, is_symbolic, whole
from jounce.errors import JounceError
from jounce.lie import Ad, inverse
from jounce.mechanism import Mechanism
from jounce.rates import broadcast, has_rates, rate_name


def checked(mechanism: Mechanism, wrench: object, order: int) -> list[Array]:
    """W and its rates up to `order`; no arrays where `wrench` is None."""
    if wrench is None:
        return []
    given = list(wrench) if has_rates(wrench, axes=2) else [wrench]  # type: ignore[call-overload]
    if len(given) != order + 1:
        have = ", ".join(rate_name("W", k) for k in range(len(given))) or "nothing"
        raise JounceError(f"wrench gives {have}; order {order} takes W and its rates up to {rate_name('W', order)}")
    return [_on_bodies(mechanism, W, rate_name("W", k)) for k, W in enumerate(given)]


def _on_bodies(mechanism: Mechanism, W: object, label: str) -> Array:
    if isinstance(W, Mapping):
        return _from_names(mechanism, W, label)
    array = asarray(W, label)
    if array.ndim < 2 or array.shape[-2:] != (mechanism.nb, 6):
        raise JounceError(
            f"{label} has shape {array.shape}; expected (..., {mechanism.nb}, 6), or a dict of body names to (..., 6)"
        )
    return array


def _from_names(mechanism: Mechanism, W: Mapping[str, object], label: str) -> Array:
    """Wrenches by body or merged link, the latter transported to the frame of the body that carries it."""
    parts: list[Array] = [np.zeros((mechanism.nb, 6))]
    for name, value in W.items():
        frame = mechanism.frame(name)
        array = asarray(value, f"{label}[{name!r}]")
        if array.ndim == 0 or array.shape[-1] != 6:
            raise JounceError(f"{label}[{name!r}] has shape {array.shape}; expected (..., 6), (moment; force)")
        if frame.body >= 0:  # a wrench between the ground and its environment moves nothing
            T = whole(frame.T) if is_symbolic(array) else frame.T
            local = Ad(inverse(T)).mT @ array[..., None]
            parts.append(np.eye(mechanism.nb, dtype=int)[frame.body][:, None] * local[..., None, :, 0])
    return sum(broadcast(parts, [2] * len(parts), ["bodies", *(f"{label}[{name!r}]" for name in W)]))
