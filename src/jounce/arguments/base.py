"""The motion of the base as a caller gives it, its pose C and its twist V with rates, checked, as arrays.

The twist is (angular; linear), in the axes of the base and about its origin; its rates are those of these components.
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
    """Return the terms of the motion of a base; a tuple has all of them, anything else is the pose alone."""
    rates = find_rates(base)
    return () if base is None else (base,) if rates is None else rates


def convert_base_motion(mechanism: Mechanism, base: object, count: int, what: str) -> list[Array]:
    """Return the `count` terms C, V, Vd, ... that a quantity takes, the pose (..., 4, 4), the others (..., 6)."""
    terms = split_terms(base)
    if mechanism.closure and mechanism.closure.coordinates[: len(BASE_COORDINATES)] == BASE_COORDINATES:
        raise JounceError(
            f"base= of {mechanism.name!r}: {', '.join(BASE_COORDINATES)} are its coordinates, in q; leave base= out"
        )
    if len(terms) != count or any(term is None for term in terms):
        raise _term_count_error(mechanism, terms, count, what)
    arrays = [asarray(term, f"{_term_label(k)} of base") for k, term in enumerate(terms)]
    for k, array in enumerate(arrays):
        shape, parts = ((6,), ", (angular; linear)") if k else ((4, 4), ", a pose, body to inertial frame")
        array_of_shape(array, shape, f"base: {_term_label(k)}", parts)
    check_pose(arrays[0])
    return arrays


def _term_label(k: int) -> str:
    return rate_name("V", k - 1) if k else "C"


def _term_count_error(mechanism: Mechanism, terms: Sequence[Any], count: int, what: str) -> JounceError:
    takes = ", ".join(map(_term_label, range(count))) if count < 5 else f"C, V, ..., {_term_label(count - 1)}"
    takes = f"base=({takes})" if count > 1 else "base=C"
    if not terms:
        came = f"base is None, yet {mechanism.name!r} floats"
        return JounceError(f"{came}; {what} takes {takes}: pose, twist and its rates")
    if missing := [_term_label(k) for k, term in enumerate(terms) if term is None]:
        return JounceError(f"base: {missing[0]} is None; {what} takes {takes}, none of them left out")
    if isinstance(terms[0], Mapping | str):
        return JounceError(f"base is {quote_value(terms[0])}; {what} takes {takes}")
    alone = "C alone, as a list is one array" if isinstance(terms[0], list) else "C alone"
    given = f"{len(terms)} terms, up to {_term_label(len(terms) - 1)}" if len(terms) > 1 else alone
    return JounceError(f"base gives {given}; {what} with these rates of q takes {takes}")
