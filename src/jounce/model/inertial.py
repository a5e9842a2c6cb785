"""The inertial parameters of all bodies of a mechanism as one vector, of which generalized forces are linear."""

from dataclasses import replace

import numpy as np

from jounce.core.errors import JounceError
from jounce.core.scalars import Array, asarray, is_numeric
from jounce.model.mechanism import Mechanism
from jounce.spatial import inertia


def parameters_of(mechanism: Mechanism) -> Array:
    """Return the ten parameters of each body, in the order of `bodies`: (10 nb,)."""
    return inertia.parameters(mechanism.M).reshape(-1)


def with_parameters(mechanism: Mechanism, given: object) -> Mechanism:
    """Return the mechanism with other inertial parameters, (10 nb,)."""
    p, names = asarray(given, "p"), mechanism.bodies
    if p.shape != (len(inertia.PARAMETERS) * len(names),):
        raise JounceError(
            f"p has shape {p.shape}; expected ({len(inertia.PARAMETERS) * len(names)},):"
            f" {', '.join(inertia.PARAMETERS)} of each of {len(names)} bodies"
        )
    if is_numeric(p) and not np.isfinite(p).all():
        body, k = divmod(int(np.flatnonzero(~np.isfinite(p))[0]), len(inertia.PARAMETERS))
        raise JounceError(
            f"p: {inertia.PARAMETERS[k]} of {names[body]!r} is {p[10 * body + k]}; expected finite numbers"
        )
    M = inertia.from_parameters(p.reshape((len(names), len(inertia.PARAMETERS))))
    return replace(mechanism, M=M)
