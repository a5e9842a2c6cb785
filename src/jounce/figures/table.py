"""Panels of a table: the columns ``NAME.Q, NAME.Qd, ...`` and ``NAME.q, NAME.qd, ...``, one panel per quantity."""

import re
from collections.abc import Mapping, Sequence

import numpy as np

from jounce.errors import JounceError, listed, no_such, quoted
from jounce.figures.curves import Panel
from jounce.spatial.series import SUFFIX

UNITS = {"q": ("rad", "m"), "Q": ("N m", "N")}  # of revolute and prismatic joints; a table does not tell which is which
LARGEST = 1e300  # beyond it matplotlib cannot number an axis
KINDS = {"_sd": "deviations", "_sample": "points", "_measured": "points"}
COLUMN = re.compile(
    rf"(.*)\.([qQ])({SUFFIX})(_sd|_sample|_measured)?", re.DOTALL
)  # a name may be of any characters, or of none


def panels(
    columns: Mapping[str, np.ndarray], place: str, joints: Sequence[str] = (), quantities: Sequence[str] = ()
) -> list[Panel]:
    """The panels of a table: of all that it holds, or of some joints and quantities (Q, Qd, ...) only.

    Raises
    ------
    JounceError : where the table has no column t, none of a quantity or not those asked for, or numbers too large.
    """
    if "t" not in columns:
        raise JounceError(f"{place}: no column 't'; available: {listed(columns)}")
    found: dict[str, dict[str, np.ndarray]] = {}
    beside: dict[str, dict[str, dict[str, np.ndarray]]] = {}  # by what the columns are of, and quantity
    for name, values in columns.items():
        if match := COLUMN.fullmatch(name):
            kind = match[len(match.groups())]
            of = found if kind is None else beside.setdefault(KINDS[kind], {})
            of.setdefault(match[2] + (match[3] or ""), {})[match[1]] = values
    if not found:
        raise JounceError(
            f"{place}: no columns NAME.Q, NAME.Qd, ... or NAME.q, NAME.qd, ...; available: {listed(columns)}"
        )
    known = list(dict.fromkeys(joint for curves in found.values() for joint in curves))
    for kind, asked, existing in (("joint", joints, known), ("quantity", quantities, list(found))):
        for name in asked:
            if name not in existing:
                raise JounceError(f"{place}: {no_such(kind, name, existing)}")
    shown = {
        quantity: {joint: values for joint, values in curves.items() if joint in (joints or known)}
        for quantity, curves in found.items()
        if quantity in (quantities or found)
    }
    drawn = [
        Panel(_label(quantity), curves, None, **{kind: of.get(quantity, {}) for kind, of in beside.items()})
        for quantity, curves in shown.items()
        if curves
    ]
    if residuals := _residuals(shown, beside.get("points", {})):
        drawn.insert(1 + list(shown).index("q"), Panel("residual of q [rad or m]", residuals))
    if not drawn:
        raise JounceError(f"{place}: no column of {listed(quantities)} for {listed(joints)}")
    for name in ["t", *(f"{joint}.{quantity}" for quantity, curves in shown.items() for joint in curves)]:
        peak = np.abs(columns[name]).max()
        if peak > LARGEST:
            came = f"column {quoted(name)} holds {peak:g}"
            raise JounceError(f"{place}: {came}; values above {LARGEST:g} cannot be drawn")
    return drawn


def _residuals(
    shown: Mapping[str, Mapping[str, np.ndarray]], points: Mapping[str, Mapping[str, np.ndarray]]
) -> dict[str, np.ndarray]:
    """Samples less the curve, by joint."""
    curves = shown.get("q", {})
    return {joint: samples - curves[joint] for joint, samples in points.get("q", {}).items() if joint in curves}


def breaks_of(columns: Mapping[str, np.ndarray]) -> list[float]:
    """The times of the rows before which a derivative jumps, as `jounce motion` marks them."""
    return [] if "break" not in columns else columns["t"][columns["break"] >= 0].tolist()


def _label(quantity: str) -> str:
    """``Q2d [N m/s² or N/s²]``."""
    k = {"": 0, "d": 1}.get(quantity[1:]) if len(quantity) < 3 else int(quantity[1:-1])
    per = "" if not k else "/s" if k == 1 else f"/s$^{{{k}}}$"
    return f"{quantity} [{' or '.join(unit + per for unit in UNITS[quantity[0]])}]"
