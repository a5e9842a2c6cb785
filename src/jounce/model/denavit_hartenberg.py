"""Denavit-Hartenberg tables, standard and modified, made into screws.

Frame i comes from frame i - 1 by turns and slides about and along two axes, in the order of the convention:

    standard:  T_i = Rot_z(theta_i) Trans_z(d_i) Trans_x(a_i) Rot_x(alpha_i)    the joint moves about z of frame i - 1
    modified:  T_i = Rot_x(alpha_i) Trans_x(a_i) Rot_z(theta_i) Trans_z(d_i)    the joint moves about z of frame i

In the modified one, Craig's, row i holds what he calls a_{i-1} and alpha_{i-1}. The variable of a revolute joint is
added to theta_i, that of a prismatic one to d_i.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from jounce.core import scalars
from jounce.core.cures import Remedy
from jounce.core.errors import JounceError, as_list, check_bool, check_choice, locate_errors, quote_value, warn
from jounce.core.scalars import Array, asarray, is_symbolic
from jounce.model.coordinates import MIN_DEGREES_ANGLE
from jounce.model.frame import Frame
from jounce.model.mechanism import Mechanism
from jounce.model.screws import exact_pose, from_screws

DEGREES_CURE = Remedy("degrees=True takes degrees", "angles: deg in its file takes degrees")
DH_PARAMETERS = ("a", "alpha", "d", "theta")
CONVENTIONS = ("standard", "modified")
TYPES = ("revolute", "prismatic")
TOOL = "tool"  # the name of its frame

Row = tuple[Array, str]  # a, alpha, d, theta in rad, (4,), and the type of the joint


def from_dh(
    table: Any,
    M: Array,
    convention: str,
    *,
    types: Sequence[str] | None = None,
    degrees: bool = False,
    base: Array | None = None,
    tool: Array | None = None,
    **data: Any,
) -> Mechanism:
    """A mechanism from a table, every entry checked; see `Robot.from_dh` for what they are."""
    check_choice("Denavit-Hartenberg convention", convention, CONVENTIONS)
    check_bool("degrees", degrees, "the unit of alpha and theta")
    rows = _read_rows(table, types)
    if not degrees:
        _warn_of_degrees(rows)
    moved = [_standard_row(*row, degrees) if convention == "standard" else _modified_row(*row, degrees) for row in rows]
    B, X = ([pair[k] for pair in moved] for k in (0, 1))
    if base is not None:
        B[0] = _check_pose(base, "base") @ B[0]
    built = from_screws(np.stack(B), np.stack(X), M, **data)
    if tool is None:
        return built
    if TOOL in built.bodies:
        raise JounceError(f"a body is named {TOOL!r} like the frame of tool=; rename the body")
    return replace(built, frames=(Frame(TOOL, built.nb - 1, _check_pose(tool, "tool")),))


def _standard_row(row: Array, kind: str, degrees: bool) -> tuple[Array, Array]:
    """B and X: the axis, z of the frame before, seen from the frame at the end of the link."""
    a, alpha, d, theta = row
    (ct, st), (ca, sa) = _cos_sin(theta, degrees), _cos_sin(alpha, degrees)
    B = _to_array([
        [ct, -st * ca, st * sa, a * ct],
        [st, ct * ca, -ct * sa, a * st],
        [0, sa, ca, d],
        [0, 0, 0, 1],
    ])  # fmt: skip
    return B, _to_array([0, sa, ca, 0, a * ca, -a * sa] if kind == "revolute" else [0, 0, 0, 0, sa, ca])


def _modified_row(row: Array, kind: str, degrees: bool) -> tuple[Array, Array]:
    """B and X: the axis is z of the frame itself."""
    a, alpha, d, theta = row
    (ct, st), (ca, sa) = _cos_sin(theta, degrees), _cos_sin(alpha, degrees)
    B = _to_array([
        [ct, -st, 0, a],
        [st * ca, ct * ca, -sa, -d * sa],
        [st * sa, ct * sa, ca, d * ca],
        [0, 0, 0, 1],
    ])  # fmt: skip
    return B, _to_array([0, 0, 1, 0, 0, 0] if kind == "revolute" else [0, 0, 0, 0, 0, 1])


def _cos_sin(angle: Any, degrees: bool) -> tuple[Any, Any]:
    """Cosine and sine; those of right angles exact, so that zeros of an arm are zeros."""
    if isinstance(angle, int | float):
        right = 90 if degrees else np.pi / 2
        quarters = round(angle / right)
        if quarters * right == angle:
            return ((1, 0), (0, 1), (-1, 0), (0, -1))[quarters % 4]
    x = np.array([angle * (np.pi / 180) if degrees else angle])
    return scalars.cos(x)[0], scalars.sin(x)[0]


def _to_array(entries: list[Any]) -> Array:
    """Numbers, or an object array where a symbol is among them."""
    row = np.array(entries, dtype=object)
    return row.astype(float) if all(isinstance(x, int | float) for x in row.flat) else row


def _read_rows(table: Any, types: Sequence[str] | None) -> list[Row]:
    rows = as_list(table) if isinstance(table, Sequence | np.ndarray) and not isinstance(table, str) else []
    if not rows:
        raise JounceError(f"table is {quote_value(table)}; expected rows of {', '.join(DH_PARAMETERS)}")
    named = [isinstance(row, Mapping) for row in rows]
    if types is None:
        kinds = [row.get("type", TYPES[0]) if isinstance(row, Mapping) else TYPES[0] for row in rows]
    elif any(named):
        raise JounceError("types= applies to rows of numbers; rows of names have their own 'type'")
    else:
        kinds = [] if isinstance(types, str) else as_list(types)
    if len(kinds) != len(rows):
        raise JounceError(f"types is {quote_value(types)}; expected {len(rows)} of {', '.join(TYPES)}, one per row")
    for i, kind in enumerate(kinds):
        with locate_errors(f"joint of table[{i}]"):
            check_choice("type", kind, TYPES)
    return [(_read_row(row, f"table[{i}]"), kind) for i, (row, kind) in enumerate(zip(rows, kinds, strict=True))]


def _read_row(row: Any, label: str) -> Array:
    """a, alpha, d and theta of a row, which are numbers in this order or have these names."""
    order = ", ".join(DH_PARAMETERS)
    if isinstance(row, Mapping):
        for key in row:
            check_choice("key", key, [*DH_PARAMETERS, "type"], label)
        for key in DH_PARAMETERS:
            if key not in row:
                raise JounceError(f"{label} has no {key!r}; expected {order}")
        row = [row[key] for key in DH_PARAMETERS]
    numbers = asarray(row, label)
    if numbers.shape != (4,):
        raise JounceError(f"{label} has shape {numbers.shape}; expected 4 numbers: {order}")
    if is_symbolic(numbers):
        return numbers
    if not np.isfinite(numbers).all():
        raise JounceError(f"{label} is {numbers.tolist()}; expected finite numbers: {order}")
    return numbers.astype(float).astype(object)  # Python's own floats


def _warn_of_degrees(rows: Sequence[Row]) -> None:
    """Warn of the first angle that is more than a turn."""
    for i, (row, _) in enumerate(rows):
        for name in ("alpha", "theta"):
            angle = row[DH_PARAMETERS.index(name)]
            if isinstance(angle, float) and abs(angle) > MIN_DEGREES_ANGLE:
                warn(f"table[{i}]: {name} is {angle:g} rad, more than a turn; {DEGREES_CURE}")
                return


def _check_pose(T: Array, label: str) -> Array:
    array = asarray(T, label)
    if array.shape != (4, 4):
        raise JounceError(f"{label} has shape {array.shape}; expected a pose (4, 4)")
    return exact_pose(array, label)
