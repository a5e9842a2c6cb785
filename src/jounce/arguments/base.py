"""Check the motion of the base that a caller gives.

It is the pose C, the twist V and their rates, as arrays. The twist is (angular; linear), in the axes of the base and
about its origin; its rates are those of these components.
"""

from collections.abc import Mapping, Sequence
from typing import Any

from jounce.arguments.poses import check_pose
from jounce.arguments.rates import find_rates
from jounce.core.errors import JounceError, quote_value
from jounce.core.scalars import Array, array_of_shape, asarray
from jounce.model.equivalent_mechanisms import BASE_COORDINATES
from jounce.model.mechanism import Mechanism
from jounce.spatial.series import rate_name


def split_terms(base: object) -> tuple[Any, ...]:
    """Return the terms C, V, ... of the motion of a base.

    A tuple has all of them; anything else is the pose alone.
    """
    if base is None:
        return ()
    rates = find_rates(base)
    return (base,) if rates is None else rates


def convert_base_motion(mechanism: Mechanism, base: object, count: int, what: str) -> list[Array]:
    """Return the `count` terms C, V, Vd, ... that a quantity takes.

    The pose C is (..., 4, 4), the others are (..., 6).
    """
    terms = split_terms(base)
    c = mechanism.closure
    if c is not None and c.coordinates[: len(BASE_COORDINATES)] == BASE_COORDINATES:
        raise JounceError(
            f"base= of {mechanism.name!r}: {', '.join(BASE_COORDINATES)} are its coordinates, in q; leave base= out"
        )
    if len(terms) != count or any(term is None for term in terms):
        raise _term_count_error(mechanism, terms, count, what)
    arrays = [asarray(term, f"{_term_label(k)} of base") for k, term in enumerate(terms)]
    for k, array in enumerate(arrays):
        if k == 0:
            array_of_shape(array, (4, 4), f"base: {_term_label(k)}", ", a pose, body to inertial frame")
        else:
            array_of_shape(array, (6,), f"base: {_term_label(k)}", ", (angular; linear)")
    check_pose(arrays[0])
    return arrays


def _term_label(k: int) -> str:
    return "C" if k == 0 else rate_name("V", k - 1)


def _term_count_error(mechanism: Mechanism, terms: Sequence[Any], count: int, what: str) -> JounceError:
    """Return the error for terms of a wrong number, or None."""
    takes = ", ".join(map(_term_label, range(count))) if count < 5 else f"C, V, ..., {_term_label(count - 1)}"
    takes = f"base=({takes})" if count > 1 else "base=C"
    if len(terms) == 0:
        came = f"base is None, yet {mechanism.name!r} floats"
        return JounceError(f"{came}; {what} takes {takes}: pose, twist and its rates")
    missing_terms = [_term_label(k) for k, term in enumerate(terms) if term is None]
    if len(missing_terms) > 0:
        return JounceError(f"base: {missing_terms[0]} is None; {what} takes {takes}, none of them left out")
    if isinstance(terms[0], Mapping | str):
        return JounceError(f"base is {quote_value(terms[0])}; {what} takes {takes}")
    if len(terms) > 1:
        came = f"{len(terms)} terms, up to {_term_label(len(terms) - 1)}"
    elif isinstance(terms[0], list):
        came = "C alone, as a list is one array"
    else:
        came = "C alone"
    return JounceError(f"base gives {came}; {what} with these rates of q takes {takes}")
