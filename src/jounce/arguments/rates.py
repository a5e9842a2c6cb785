"""Rates of the coordinates that a caller gives, q, qd, q2d, ... or q, qd, Q, Qd, ..., checked, as arrays."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from jounce.arguments import names
from jounce.core.errors import JounceError, at, listed, quoted
from jounce.core.scalars import (
    FLOAT,
    Array,
    asarray,
    broadcast,
    element,
    exact_integers,
    is_scalar,
    is_symbolic,
    namespace,
)
from jounce.model.elasticity import motor_names
from jounce.model.mechanism import Mechanism
from jounce.spatial.series import rate_name

HIGHEST_ORDER = 100  # order: beyond it computing takes minutes, and nobody's numbers have the digits


def checked_order(order: object, highest: int = HIGHEST_ORDER) -> int:
    """Return a caller's order, checked."""
    if not isinstance(order, int | np.integer) or isinstance(order, bool) or not 0 <= order <= highest:
        raise JounceError(f"order is {quoted(order)}; expected 0 to {highest}")
    return int(order)


def rates_in(given: object) -> tuple[Any, ...] | None:
    """Return (value, rate, ...) if a caller gives such a tuple; None for one array or a tuple of scalars.

    Nested lists are one array.
    """
    return given if isinstance(given, tuple) and not (given and all(map(is_scalar, given))) else None


def coordinate_names(count: int) -> tuple[str, ...]:
    """Return q, qd, q2d, ..."""
    return tuple(rate_name("q", k) for k in range(count))


def rates_of(
    given: Sequence[Any],
    least: int,
    mechanism: Mechanism,
    named: Callable[[int], Sequence[str]] = coordinate_names,
    coordinates: int | None = None,
) -> list[Array]:
    """Return the coordinates and their rates as arrays (..., n): at least `least` of them, none skipped.

    Terms from number `coordinates` on are forces (..., nv).
    """
    terms = list(given)
    while len(terms) > least and terms[-1] is None:
        terms.pop()
    if len(terms) > least + HIGHEST_ORDER:
        last = named(len(terms))[-1]
        raise JounceError(
            f"{last} is given, for order {len(terms) - least}; expected rates for order 0 to {HIGHEST_ORDER}"
        )
    if len(terms) < least:  # where springs and motors of a robot take more rates than its methods name
        count = max([1, *(k + 1 for k, term in enumerate(terms) if term is not None)])
        have, lacking = named(count)[-1], named(least)[-1]
        raise JounceError(
            f"{have} is the last rate given; the springs and motors of {mechanism.name!r} take {lacking} too"
        )
    labels, own = named(len(terms)), len(terms) if coordinates is None else coordinates
    tails = [(mechanism.n if k < own else mechanism.nv,) for k in range(len(terms))]
    return [
        term  # as most are, and some a thousand times a second
        if type(term) is np.ndarray and term.dtype is FLOAT and term.shape[-1:] == tails[k]
        else _column(term, k, mechanism, terms, labels, *tails[k])
        for k, term in enumerate(terms)
    ]


def state_of(given: Sequence[Any], mechanism: Mechanism, named: Sequence[str]) -> list[Array]:
    """Return q, qd, then theta, thetad, ... (..., m) of the m motors, with the names of all."""
    e, least = mechanism.elasticity, len(named) - 2
    pairs = e is not None and e.pairs
    motors = replace(mechanism, coordinates=motor_names(e, mechanism.coordinates)) if e and pairs else mechanism
    links = rates_of(given[:2], 2, mechanism, lambda count: named[:count])
    return [*links, *rates_of(given[2:], least, motors, lambda count: named[2 : 2 + count])]


def is_unbatched(q: Sequence[Array]) -> bool:
    """Return whether the coordinates and their rates are one state without batch axes."""
    return all(term.ndim == 1 for term in q)


def _skipped_rate(terms: Sequence[Array | None], labels: Sequence[str]) -> JounceError:
    k = next(k for k, term in enumerate(terms) if term is None)
    after = [labels[j] for j in range(k + 1, len(terms)) if terms[j] is not None]
    skipped = f", yet {after[0]} is given" if after else ""
    return JounceError(f"{labels[k]} is None{skipped}; expected every rate up to the last")


def _column(term: Any, k: int, mechanism: Mechanism, terms: Sequence[Any], labels: Sequence[str], size: int) -> Array:
    if term is None:
        raise _skipped_rate(terms, labels)
    label = labels[k]
    of_base = size > mechanism.n
    if names.listed_in(term) is not None and not of_base:
        with at(label):
            return _by_name(term, mechanism)
    array, joints = asarray(term, label), mechanism.coordinates
    if array.ndim == 0 or array.shape[-1] != size:
        cure = "" if of_base else _cure(array.shape, label, mechanism)
        rows = ("moment (3) and force (3) on the base", *joints) if of_base else joints
        raise JounceError(f"{label} has shape {array.shape}; expected (..., {size}): {', '.join(rows)}{cure}")
    return array


def _cure(shape: tuple[int, ...], label: str, mechanism: Mechanism) -> str:
    """What makes coordinates of a wrong shape fit, as the end of a sentence, or nothing."""
    n, count = mechanism.n, shape[-1] if shape else 0
    if len(shape) > 1 and shape[-2] == n:
        return f"; transpose it: {label}.swapaxes(-1, -2) has the coordinates last"
    if 0 < count < n:
        return f"; {names.LOCK}"
    if mechanism.closure and label == "q":
        return f"; or all {mechanism.tree.n} of the tree: {listed(mechanism.tree.coordinates)}"
    followers = [name for name in mechanism.joints if name not in mechanism.coordinates]
    if followers and count == mechanism.nb:
        return f"; leave out joints that follow others: {listed(followers)}"
    return ""


def _by_name(term: Any, mechanism: Mechanism) -> Array:
    """Return an array (..., n) of coordinates (...) given by joint name, broadcast."""
    joints, named = mechanism.coordinates, names.entries(term)
    cure = f"{listed(joints)}; {names.LOCK}" if len(named) < len(joints) else ""
    names.check(named, joints, names.followers(mechanism), cure)
    parts = [element(named[joint], repr(joint)) for joint in joints]
    if any(map(is_symbolic, parts)):
        parts = [part if is_symbolic(part) else exact_integers(part) for part in parts]
    parts = broadcast(parts, [0] * len(parts), [repr(joint) for joint in joints])
    return namespace(*parts).stack(parts, axis=-1)
