"""Rates of the coordinates that a caller gives, q, qd, q2d, ... or q, qd, Q, Qd, ..., checked, as arrays."""

from collections.abc import Sequence
from dataclasses import replace
from types import NoneType
from typing import Any

import numpy as np

from jounce.arguments import names
from jounce.arguments.joints import check_positions, numbers_by_name, velocities_by_name
from jounce.core import named_entries, scalars
from jounce.core.errors import JounceError, join_names, locate_errors, quote_value
from jounce.core.scalars import FLOAT, Array, array_of_shape, asarray
from jounce.dynamics.quantities import Quantity
from jounce.model.elasticity import motor_names
from jounce.model.mechanism import Mechanism
from jounce.model.positions import multiscrew_joints, position_names

MAX_ORDER = 100  # rates: computing more takes minutes, and no data have the digits for them


def check_order(order: object, highest: int = MAX_ORDER) -> int:
    """Return a caller's order, checked."""
    if not isinstance(order, int | np.integer) or isinstance(order, bool) or not 0 <= order <= highest:
        raise JounceError(f"order is {quote_value(order)}; expected 0 to {highest}")
    return int(order)


def find_rates(given: object) -> tuple[Any, ...] | None:
    """Return (value, rate, ...) if a caller gives such a tuple; None for one array or a tuple of scalars.

    Nested lists are one array.
    """
    return given if isinstance(given, tuple) and not (given and all(map(scalars.is_scalar, given))) else None


def trim_rates(mechanism: Mechanism, given: Sequence[Any], row: Quantity, more: int = 0) -> list[Any]:
    """Return what a caller gives of q, qd, ..., Q, Qd, ..., without None at the end: no less than a quantity takes.

    Its row takes `more` rates for springs and motors of the robot than that of other robots.

    Raises
    ------
    JounceError : if rates are too few or too many, or one is skipped.
    """
    terms, least = list(given), row.takes.rates
    while len(terms) > least - more and terms[-1] is None:
        terms.pop()
    labels = row.takes.names(len(terms))
    if len(terms) > least + MAX_ORDER:
        came = f"{labels[-1]} is given, for order {len(terms) - least}"
        raise JounceError(f"{came}; expected rates for order 0 to {MAX_ORDER}")
    if len(terms) < least:
        have = [label for label, term in zip(labels, terms, strict=True) if term is not None] or labels
        takes = f"the springs and motors of {mechanism.name!r} take {row.takes.names(least)[-1]} too"
        raise JounceError(f"{have[-1]} is the last rate given; {takes}")
    if NoneType in map(type, terms):
        k = next(k for k, term in enumerate(terms) if term is None)
        after = [label for label, term in zip(labels[k:], terms[k:], strict=True) if term is not None]
        skipped = f", yet {after[0]} is given" if after else ""
        raise JounceError(f"{labels[k]} is None{skipped}; expected every rate up to the last")
    return terms


def convert_rates(mechanism: Mechanism, given: Sequence[Any], row: Quantity, more: int = 0) -> list[Array]:
    """Return what a quantity takes of a caller's q, qd, ..., Q, Qd, ... as arrays, see `trim_rates`."""
    terms = trim_rates(mechanism, given, row, more)
    labels, own = row.takes.names(len(terms)), row.takes.coordinates(len(terms))
    e = mechanism.elasticity if row.takes.motors else None
    others = replace(mechanism, coordinates=motor_names(e, mechanism.coordinates)) if e and e.pairs else mechanism
    q = [convert_position(mechanism, term) for term in terms[: min(own, 1)]]
    q += [convert_coordinates(mechanism, *both, mechanism.n) for both in zip(terms[1:own], labels[1:], strict=False)]
    return q + [convert_coordinates(others, *both, others.nv) for both in zip(terms[own:], labels[own:], strict=True)]


def is_unbatched(q: Sequence[Array]) -> bool:
    """Return whether the coordinates and their rates are one state without batch axes."""
    return all(term.ndim == 1 for term in q)


def convert_position(mechanism: Mechanism, term: Any) -> Array:
    """Return the numbers of q, (..., nq), from an array or by joint name."""
    if not multiscrew_joints(mechanism):
        return convert_coordinates(mechanism, term, "q", mechanism.n)
    joints = position_names(mechanism)
    if named_entries.entry_names(term) is not None:
        with locate_errors("q"):
            numbers = _stack_by_name(numbers_by_name(mechanism, term), mechanism, joints)
        return check_positions(mechanism, numbers)
    array = asarray(term, "q")
    meant = "" if array.shape[-1:] != (mechanism.n,) else f"; {mechanism.n} are velocities, which q has no numbers of"
    return check_positions(mechanism, array_of_shape(array, (len(joints),), "q", f": {', '.join(joints)}{meant}"))


def convert_coordinates(mechanism: Mechanism, term: Any, label: str, size: int) -> Array:
    """Return coordinates, or a rate of them, (..., n), or forces (..., nv), from an array or by joint name."""
    if type(term) is np.ndarray and term.dtype is FLOAT and term.shape[-1:] == (size,):
        return term  # as most are, and some a thousand times a second
    of_base, joints = size > mechanism.n, mechanism.coordinates
    if named_entries.entry_names(term) is not None and not of_base:
        with locate_errors(label):
            return _stack_by_name(velocities_by_name(mechanism, term), mechanism, joints)
    array = asarray(term, label)
    if array.shape[-1:] == (size,):
        return array
    cure = "" if of_base else _shape_cure(array.shape, label, mechanism)
    rows = ("moment (3) and force (3) on the base", *joints) if of_base else joints
    return array_of_shape(array, (size,), label, f": {', '.join(rows)}{cure}")


def _shape_cure(shape: tuple[int, ...], label: str, mechanism: Mechanism) -> str:
    """What makes coordinates of a wrong shape fit, as the end of a sentence, or nothing."""
    n, count = mechanism.n, shape[-1] if shape else 0
    if len(shape) > 1 and shape[-2] == n:
        return f"; transpose it: {label}.swapaxes(-1, -2) has the coordinates last"
    if 0 < count < n:
        return f"; {names.LOCK_CURE}"
    if mechanism.closure and label == "q":
        return f"; or all {mechanism.tree.n} of the tree: {join_names(mechanism.tree.coordinates)}"
    followers = [name for name in mechanism.joints if name not in mechanism.coordinates]
    if followers and count == len(mechanism.joints):
        return f"; leave out joints that follow others: {join_names(followers)}"
    return ""


def _stack_by_name(term: Any, mechanism: Mechanism, joints: Sequence[str]) -> Array:
    """Return an array (..., n) of coordinates (...) given by joint name, broadcast."""
    lacking = len(named_entries.entry_names(term) or ()) < len(joints)
    cure = f"{join_names(joints)}; {names.LOCK_CURE}" if lacking else ""
    return names.stack_entries(term, joints, names.find_followers(mechanism), cure)
