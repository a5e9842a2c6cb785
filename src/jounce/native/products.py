"""Arguments of products of derivatives: two tuples, with zeros in place of None, as the arrays of one kernel."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from jounce.dynamics.computation import Port, Signature
from jounce.errors import JounceError


def arguments(caller: str, signature: Signature, arrays: Any, others: Any) -> list[Any]:
    """Return the arrays of a state, then its weights or directions, as the signature of a product lists them.

    Raises
    ------
    JounceError : if one of both is not a tuple of as many arrays as the signature has.
    """
    count = sum(port.role not in ("weight", "direction") for port in signature.inputs)
    state, rest = signature.inputs[:count], signature.inputs[count:]
    if len(rest) == 1 and type(others) not in (tuple, list):
        others = (others,)
    return [
        *_checked(caller, "arrays", state, arrays),
        *(
            np.zeros(port.shape) if x is None else x
            for port, x in zip(rest, _checked(caller, f"{rest[0].role}s", rest, others), strict=True)
        ),
    ]


def _checked(caller: str, what: str, ports: Sequence[Port], given: Any) -> Sequence[Any]:
    expected = f"expected a tuple of {len(ports)}: {', '.join(port.name for port in ports)}"
    if type(given) not in (tuple, list):
        raise JounceError(f"{caller}: {what} are of type {type(given).__name__}; {expected}")
    if len(given) != len(ports):
        raise JounceError(f"{caller}: there are {len(given)} {what}; {expected}")
    return given
