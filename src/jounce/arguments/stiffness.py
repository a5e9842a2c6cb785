"""The stiffness of joints with two motors as a caller gives it, with rates, as arrays."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from jounce.arguments.base import split_terms
from jounce.arguments.names import array_by_name
from jounce.core.errors import JounceError, join_names
from jounce.core.scalars import Array, array_of_shape
from jounce.dynamics.joint_springs import elasticity_of
from jounce.model.mechanism import Mechanism
from jounce.spatial.series import rate_name


def convert_stiffness(m: Mechanism, given: Any, count: int) -> list[Array]:
    """S, Sd, ... (..., k) of the k joints with two motors, by name or in their order: `count` of them."""
    names = [m.coordinates[j] for j in elasticity_of(m).pairs]
    if not names:
        if given is None:
            return []
        why = "no joint has two motors: spring=AntagonisticSprings(...)"
        raise JounceError(f"stiffness is given; expected None, as {why}")
    if given is None:
        raise JounceError(
            f"stiffness is None; expected the stiffness of the joints with two motors: {join_names(names)}"
        )
    terms = split_terms(given)
    if len(terms) < count:
        takes = ", ".join(rate_name("S", k) for k in range(count))
        raise JounceError(f"stiffness has {len(terms)} terms; expected a tuple ({takes}), one for each rate of Q")
    return [_stack_by_joint(term, names, rate_name("stiffness", k)) for k, term in enumerate(terms[:count])]


def _stack_by_joint(given: Any, names: Sequence[str], label: str) -> Array:
    array = np.asarray(array_by_name(given, names, label))
    array = np.broadcast_to(array, (len(names),)) if array.ndim == 0 else array
    return array_of_shape(array, (len(names),), label, f", for {join_names(names)}")
