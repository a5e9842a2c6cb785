"""Products of derivatives by the complex step, as an independent check of those by accumulation on programs.

``f(x + i h d) = f(x) + i h J d + ...``: no difference is taken, so that a tiny h gives all digits.

[1] W. Squire, G. Trapp, Using complex variables to estimate derivatives of real functions, SIAM Review 40 (1998).
"""

from collections.abc import Sequence
from dataclasses import replace
from math import prod

import numpy as np

from jounce.checks.magnitudes import magnitudes
from jounce.dynamics.computation import Computation, change
from jounce.dynamics.loops import closure_of
from jounce.engine.generic_methods import compute_by_method
from jounce.model.mechanism import Mechanism

_COMPLEX_STEP = 1e-100  # its square vanishes, and it is no difference: no digits cancel


def product(
    computation: Computation, method: str, mechanism: Mechanism, arrays: Sequence[np.ndarray]
) -> list[np.ndarray]:
    """The gradients or tangents of a quantity by a method, for arrays with the same batch axes."""
    values = replace(computation, product=None)
    ports = values.signature(mechanism).inputs
    x, others = arrays[: len(ports)], arrays[len(ports) :]

    free = [port for port in ports if port.is_free]

    def along(directions: Sequence[np.ndarray]) -> list[np.ndarray]:
        rates = [change(mechanism, port, a, d) for port, a, d in zip(free, x, directions, strict=False)]
        rates += _follower_rates(mechanism, x[0], rates[0], x[-1]) if mechanism.takes_dependent else []
        moved = [a + 1j * _COMPLEX_STEP * d for a, d in zip(x, rates, strict=True)]
        return [y.imag / _COMPLEX_STEP for y in compute_by_method(values, method, mechanism, moved)]

    if computation.product == "jvp":
        return along(others)
    batch = x[0].shape[:-1]
    gradients = []
    for port in free:
        size = prod(port.displacement)
        units = np.eye(size).reshape(size, *[1] * len(batch), *port.displacement)  # a direction for each scalar
        tangents = along([units if port is other else np.zeros(other.displacement) for other in free])
        sums = [(dy * w).reshape(size, *batch, -1).sum(axis=-1) for dy, w in zip(tangents, others, strict=True)]
        gradients.append(np.moveaxis(sum(sums), 0, -1).reshape((*batch, *port.displacement)))
    return gradients


def _follower_rates(mechanism: Mechanism, q: np.ndarray, dq: np.ndarray, dependent: np.ndarray) -> list[np.ndarray]:
    """The rates of the dependent coordinates of a closed robot, where the others have the rates dq."""
    rates = compute_by_method(Computation("coordinates", 1), "recursion", mechanism, [q, dq, dependent])[1]
    return [rates[..., list(closure_of(mechanism).dependent)]]


def product_magnitudes(
    mechanism: Mechanism, computation: Computation, arrays: Sequence[np.ndarray]
) -> list[np.ndarray]:
    """The magnitudes of gradients or tangents: those of the results, as derivatives are of the size of their terms."""
    values = replace(computation, product=None)
    ports = values.signature(mechanism).inputs
    x, others = arrays[: len(ports)], arrays[len(ports) :]
    sizes = magnitudes(mechanism, values, x)
    if computation.product == "jvp":
        return [*sizes]
    batch = x[0].shape[:-1]
    squares = [np.square(size * w).reshape(*batch, -1).sum(axis=-1) for size, w in zip(sizes, others, strict=True)]
    total = np.sqrt(sum(squares).astype(float))
    return [
        np.broadcast_to(total.reshape(*batch, *[1] * len(port.displacement)), (*batch, *port.displacement))
        for port in ports
        if port.is_free
    ]
