"""Drives: forces of the drive trains, added to those of the rigid mechanism, by joint variable theta, with exact rates.

    armature   I theta''                   inertia of the rotor, seen through the gear: it adds to the mass matrix
    damping    d theta'                    viscous
    friction   f tanh(theta' / eps)        Coulomb's, smooth: it reaches 76 % of f at the speed eps, 99.99 % at 5 eps
    spring     k (theta - rest)

Robot files state the parameters; the terms enter ``Q = G^T Q_theta`` only if a user selects them. The rotors turn with
their joints only: their effect on momentum and bearings as the links that carry them turn is neglected, as is usual.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from operator import add
from typing import Final, TypeVar

import numpy as np

from jounce.core.errors import JounceError, as_list, check_choice, join_names, quote_value, warn
from jounce.core.scalars import Array, is_finite
from jounce.core.typing import DriveColumn, DriveTerm, Floats
from jounce.model.series_functions import hyperbolic_tangent
from jounce.spatial.series import Series

T = TypeVar("T", bound=str)
Coefficients = Mapping[str, Array]  # columns, one entry per joint
DriveLaw = Callable[[Coefficients, Series], Series]

DEFAULT_SMOOTHING_VELOCITY = 0.05  # rad/s or m/s: below it friction turns over


@dataclass(frozen=True, eq=False, kw_only=True)
class Drives:
    """The parameters of the drive trains, one per joint variable; zero where nothing is stated.

    They enter Q where `Robot.with_drives` or ``load(..., drives=True)`` selects them.

    Attributes
    ----------
    armature : (nb,)
        Inertia of the rotor as seen from the joint, kg m^2 or kg.
    damping : (nb,)
        Viscous damping, N m s or N s/m.
    friction : (nb,)
        Coulomb friction, N m or N.
    eps : (nb,)
        Smoothing velocity of Coulomb friction, rad/s or m/s.
    stiffness : (nb,)
        Stiffness of the joint spring, N m or N/m.
    rest : (nb,)
        Where the spring is slack, rad or m.

    Examples
    --------
    >>> import jounce
    >>> jounce.load("panda").drives.damping[:2]
    array([0.003, 0.003])
    """

    armature: Floats
    damping: Floats
    friction: Floats
    eps: Floats
    stiffness: Floats
    rest: Floats


UNDRIVEN = {
    "armature": 0.0,
    "damping": 0.0,
    "friction": 0.0,
    "eps": DEFAULT_SMOOTHING_VELOCITY,
    "stiffness": 0.0,
    "rest": 0.0,
}
COEFFICIENTS = ("armature", "damping", "friction", "slope", "stiffness", "rest")  # of the laws; slope is 1 / eps
DRIVE_LAWS: dict[DriveTerm, DriveLaw] = {
    "armature": lambda c, theta: c["armature"] * theta.dot.dot,
    "damping": lambda c, theta: c["damping"] * theta.dot,
    "friction": lambda c, theta: c["friction"] * hyperbolic_tangent(c["slope"] * theta.dot),
    "spring": lambda c, theta: c["stiffness"] * (theta - c["rest"]),
}
PARTIALS: dict[DriveTerm, tuple[int, DriveLaw]] = {  # by which rate of theta, and it
    "armature": (2, lambda c, theta: Series.constant(c["armature"])),
    "damping": (1, lambda c, theta: Series.constant(c["damping"])),
    "friction": (1, lambda c, theta: c["friction"] * (c["slope"] * _square_sech(c["slope"] * theta.dot))),
    "spring": (0, lambda c, theta: Series.constant(c["stiffness"])),
}
DRIVE_TERMS = tuple(DRIVE_LAWS)
OFFSET: Final = "offset"  # a constant force, which regressors know and robots do not state
DRIVE_COLUMNS: tuple[DriveColumn, ...] = (*DRIVE_TERMS, OFFSET)
AMOUNTS: dict[str, str] = {term: term for term in DRIVE_TERMS} | {
    "spring": "stiffness"
}  # zero of terms that are not stated
FORCE_LAWS: dict[DriveColumn, DriveLaw] = dict(
    zip(DRIVE_COLUMNS, [*DRIVE_LAWS.values(), lambda c, theta: theta * 0 + 1], strict=True)
)
MOMENTUM_LAWS: dict[DriveColumn, DriveLaw] = {"armature": lambda c, theta: c["armature"] * theta.dot}
ENERGY_LAWS: dict[DriveColumn, DriveLaw] = {
    "armature": lambda c, theta: c["armature"] * (theta.dot * theta.dot) * 0.5,
    "spring": lambda c, theta: c["stiffness"] * ((theta - c["rest"]) * (theta - c["rest"])) * 0.5,
}


def drive_error(**stated: float) -> str | None:
    """Return why numbers are not valid parameters of a drive train, or None if they are."""
    for name, x in stated.items():
        if not np.isfinite(x):
            return f"{name} is {x:g}; expected a finite number"
        if x < 0 and name not in ("stiffness", "rest"):
            return f"{name} is {x:g}; expected 0 or more"
    return (
        None
        if stated.get("eps", DEFAULT_SMOOTHING_VELOCITY) > 0
        else "eps is 0; expected a smoothing velocity of friction above 0"
    )


def coefficients(drives: Drives) -> Coefficients:
    """Return the coefficients of the drive laws as columns (nb, 1)."""
    numbers = vars(drives) | {"slope": 1 / drives.eps}
    return {name: numbers[name][:, None] for name in COEFFICIENTS}


def forces(c: Coefficients, terms: Sequence[str], theta: Series) -> Series:
    """Return the forces of some drive terms on the joint variables, (..., nb, 1)."""
    return reduce(add, [law(c, theta) for term, law in DRIVE_LAWS.items() if term in terms], theta * 0)


def unit_contribution(
    laws: Mapping[DriveColumn, DriveLaw], c: Coefficients, term: DriveColumn, theta: Series
) -> Series:
    """Return what one unit of the parameter of a drive term contributes at each joint, (..., nb, 1)."""
    law, amount = laws.get(term), AMOUNTS.get(term, term)
    return theta * 0 if law is None else law({**c, amount: np.ones_like(c["armature"])}, theta)


def partials(c: Coefficients, terms: Sequence[str], theta: Series) -> tuple[Series, Series, Series]:
    """The partial derivatives of `forces` by theta and its first two rates, (..., nb, 1) each."""
    found = [theta * 0] * 3
    for term, (rate, law) in PARTIALS.items():
        if term in terms:
            found[rate] = found[rate] + law(c, theta)
    return found[0], found[1], found[2]


def _square_sech(x: Series) -> Series:
    """1 / cosh(x)^2, the derivative of tanh."""
    y = hyperbolic_tangent(x)
    return -(y * y) + 1


def select_terms(terms: object) -> tuple[DriveTerm, ...]:
    """Return the selected drive terms in their order: True selects all, False none, otherwise names."""
    return _select("drive term", terms, DRIVE_TERMS)


def select_columns(terms: object) -> tuple[DriveColumn, ...]:
    """Return the selected drive terms of a regressor in their order, the offset last."""
    return _select("drive column", terms, DRIVE_COLUMNS)


def _select(kind: str, terms: object, known: tuple[T, ...]) -> tuple[T, ...]:
    if isinstance(terms, bool):
        return known * terms
    names = {check_choice(kind, name, known) for name in as_list(terms)}
    return tuple(term for term in known if term in names)


def warn_of_idle(drives: Drives, terms: object, eps: float | None, name: str) -> None:
    """Warn where a user asks for terms that a robot does not state, or for an eps without friction."""
    asked = select_terms(terms)
    stated = [term for term in DRIVE_TERMS if np.any(getattr(drives, AMOUNTS[term]))]
    if asked and not set(asked) & set(stated):
        there = f"; it states {join_names(stated)}" if stated else ""
        warn(f"{name}: drives={quote_value(terms)} has no effect: the robot states no {' or '.join(asked)}{there}")
    if eps is not None and not {"friction"} & set(asked) & set(stated):
        why = "the robot states no friction" if "friction" in asked else "it is of friction, which is not selected"
        warn(f"{name}: eps={quote_value(eps)} has no effect: {why}")


def with_eps(drives: Drives, eps: float) -> Drives:
    """Return the drives with another smoothing velocity of friction for all joints."""
    if not is_finite(eps) or not eps > 0:
        raise JounceError(
            f"eps is {quote_value(eps)}; expected a smoothing velocity of friction above 0, in rad/s or m/s"
        )
    return replace(drives, eps=np.full(drives.eps.shape, float(eps)))
