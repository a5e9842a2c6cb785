"""Arguments of products of derivatives: two tuples, with zeros in place of None, as the arrays of one kernel."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from jounce.dynamics.computation import Port, Signature
from jounce.errors import JounceError


def arguments(caller: str, values: Signature, product: Signature, arrays: Any, others: Any) -> list[Any]:
    """Return the arrays of a state, then its weights or directions, as the signature of the product lists them.

    Raises
    ------
    JounceError : if one of both is not a tuple of as many arrays as the signature has.
    """
    rest = product.inputs[len(values.inputs) :]
    if len(rest) == 1 and type(others) not in (tuple, list):
        others = (others,)
    state = _checked(caller, "arrays", values.inputs, arrays)
    given = _checked(caller, "weights" if rest[0].role == "weight" else "directions", rest, others)
    return [*state, *(np.zeros(port.shape) if x is None else x for port, x in zip(rest, given, strict=True))]


def _checked(caller: str, what: str, ports: Sequence[Port], given: Any) -> Sequence[Any]:
    expected = f"expected a tuple of {len(ports)}: {', '.join(port.name for port in ports)}"
    if type(given) not in (tuple, list):
        raise JounceError(f"{caller}: {what} are of type {type(given).__name__}; {expected}")
    if len(given) != len(ports):
        raise JounceError(f"{caller}: there are {len(given)} {what}; {expected}")
    return given
