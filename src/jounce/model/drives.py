"""Drives: what a drive train adds to the forces of a rigid mechanism, by joint variable theta, with exact rates.

    armature   I theta''                   inertia of the rotor, seen through the gear: it adds to the mass matrix
    damping    d theta'                    viscous
    friction   f tanh(theta' / eps)        Coulomb's, smooth: it reaches 76 % of f at the speed eps, 99.99 % at 5 eps
    spring     k (theta - rest)

A file states them; they are off until a user asks for them, and then enter ``Q = G^T Q_theta``. The rotors turn with
their joints only: what they do to momentum and bearings as their carriers turn is left out, as is usual.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from operator import add

import numpy as np

from jounce._scalars import Array, is_finite, tanh
from jounce._typing import DriveTerm, Floats
from jounce.errors import JounceError, listed, one_of, quoted, several, warn
from jounce.spatial.series import Series, from_rate

Coefficients = Mapping[str, Array]  # columns, one entry a joint

EPS = 0.05  # rad/s or m/s: below it friction turns over


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


UNDRIVEN = {"armature": 0.0, "damping": 0.0, "friction": 0.0, "eps": EPS, "stiffness": 0.0, "rest": 0.0}
COEFFICIENTS = ("armature", "damping", "friction", "slope", "stiffness", "rest")  # of the laws; slope is 1 / eps
LAWS: dict[DriveTerm, Callable[[Coefficients, Series], Series]] = {
    "armature": lambda c, theta: c["armature"] * theta.dot.dot,
    "damping": lambda c, theta: c["damping"] * theta.dot,
    "friction": lambda c, theta: c["friction"] * _tanh(c["slope"] * theta.dot),
    "spring": lambda c, theta: c["stiffness"] * (theta - c["rest"]),
}
TERMS = tuple(LAWS)
AMOUNTS = {term: term for term in TERMS} | {"spring": "stiffness"}  # of the terms: where all are zero, none is stated


def drive_error(**stated: float) -> str | None:
    """What keeps numbers from being those of a joint variable's drive train, or None."""
    for name, x in stated.items():
        if not np.isfinite(x):
            return f"{name} is {x:g}; expected a finite number"
        if x < 0 and name not in ("stiffness", "rest"):
            return f"{name} is {x:g}; expected 0 or more"
    return None if stated.get("eps", EPS) > 0 else "eps is 0; expected a speed above 0, over which friction turns over"


def coefficients(drives: Drives) -> Coefficients:
    """The numbers of the laws as columns (nb, 1)."""
    numbers = vars(drives) | {"slope": 1 / drives.eps}
    return {name: numbers[name][:, None] for name in COEFFICIENTS}


def forces(c: Coefficients, terms: Sequence[str], theta: Series) -> Series:
    """What some terms add to the forces of the joint variables, (..., nb, 1)."""
    return reduce(add, [law(c, theta) for term, law in LAWS.items() if term in terms], theta * 0)


def _tanh(x: Series) -> Series:
    return from_rate(tanh(x[0]), lambda y: (-(y * y) + 1) * x.dot)


def chosen(terms: object) -> tuple[DriveTerm, ...]:
    """The terms that a user asks for, in their order: True is all of them, False none, else their names."""
    if isinstance(terms, bool):
        return TERMS * terms
    names = {one_of("drive term", name, TERMS) for name in several(terms)}
    return tuple(term for term in TERMS if term in names)


def warn_of_idle(drives: Drives, terms: object, eps: float | None, name: str) -> None:
    """Warn where a user asks for terms that a robot does not state, or for an eps without friction."""
    asked = chosen(terms)
    stated = [term for term in TERMS if np.any(getattr(drives, AMOUNTS[term]))]
    if asked and not set(asked) & set(stated):
        there = f"; it states {listed(stated)}" if stated else ""
        warn(f"{name}: drives={quoted(terms)} has no effect: the robot states no {' or '.join(asked)}{there}")
    if eps is not None and not {"friction"} & set(asked) & set(stated):
        why = "the robot states no friction" if "friction" in asked else "it is of friction, which is not selected"
        warn(f"{name}: eps={quoted(eps)} has no effect: {why}")


def with_eps(drives: Drives, eps: float) -> Drives:
    """The drives with another speed over which friction turns over, of all joints."""
    if not is_finite(eps) or not eps > 0:
        raise JounceError(
            f"eps is {quoted(eps)}; expected a speed above 0 in rad/s or m/s, over which friction turns over"
        )
    return replace(drives, eps=np.full(drives.eps.shape, float(eps)))
