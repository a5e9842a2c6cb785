"""Drives: forces of the drive trains, added to those of the rigid mechanism, by joint variable theta, with exact rates.

    armature   I theta''                   inertia of the rotor, seen through the gear: it adds to the mass matrix
    damping    d theta'                    viscous
    friction   f tanh(theta' / eps)        Coulomb's, smooth: it reaches 76 % of f at the speed eps, 99.99 % at 5 eps
    stribeck   s tanh(theta' / eps) exp(-(theta' / vs)^2)    more friction near rest, which speed takes away
    spring     k (theta - rest)
    offset     o                           constant, as of a torque sensor that is not at zero

Friction that grows with the load takes the force Q that the joint transmits, all other terms included: motors exert
``Q + a (Q^2 + d^2)^1/2`` with ``a = c tanh(theta' / eps)``, c < 1. The load d makes it smooth where Q changes its sign.

Robot files state the parameters; the terms enter ``Q = G^T Q_theta`` only if a user selects them. The rotors turn with
their joints only: their effect on momentum and bearings as the links that carry them turn is neglected, as is usual.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import reduce
from operator import add

import numpy as np

from jounce.core.cures import Remedy, option_value
from jounce.core.display import HtmlDisplay, print_table
from jounce.core.equality import EqualByValue
from jounce.core.errors import JounceError, as_list, check_choice, join_names, quote_value, shorten, warn
from jounce.core.scalars import Array, is_finite
from jounce.core.typing import DriveTerm, Floats
from jounce.model.series_functions import SERIES_RULES, exponential, hyperbolic_slope, hyperbolic_tangent, inverse
from jounce.spatial.series import Series

Coefficients = Mapping[str, Array]  # columns, one entry per joint
DriveLaw = Callable[[Coefficients, Series], Series]
DEFAULT_SMOOTHING_VELOCITY = 0.05  # rad/s or m/s: below it friction turns over
DEFAULT_STRIBECK_VELOCITY = 0.1  # rad/s or m/s: that of many gears, of 0.03 to 0.25
DEFAULT_LOAD_EPS = 0.1  # N m or N: c times as much is added at no load, some mN m, which sensors of arms do not show
SIGNED_PARAMETERS = ("stiffness", "rest", "offset")  # which may be negative


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Drives(EqualByValue, HtmlDisplay):
    """The parameters of the drive trains, one per joint variable.

    They are zero where nothing is stated. They enter Q where `Robot.with_drives` or ``load(..., drives=True)`` selects
    them.


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
    stribeck : (nb,)
        Friction near rest beyond Coulomb's, N m or N.
    stribeck_velocity : (nb,)
        The speed at which 37 % of it is left, rad/s or m/s.
    stiffness : (nb,)
        Stiffness of the joint spring, N m or N/m.
    rest : (nb,)
        Where the spring is slack, rad or m.
    offset : (nb,)
        Constant force, N m or N.
    load_friction : (nb,)
        Friction over the load that a joint transmits, below 1.
    load_eps : (nb,)
        Smoothing load of this friction, N m or N.

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
    stribeck: Floats
    stribeck_velocity: Floats
    stiffness: Floats
    rest: Floats
    offset: Floats
    load_friction: Floats
    load_eps: Floats

    @property
    def summary(self) -> str:
        """The number of joint variables and the stated terms."""
        return f"Drives of {len(self.armature)} joint variables: {join_names(stated_terms(self)) or 'none stated'}"

    @property
    def stated_parameters(self) -> tuple[str, ...]:
        """The parameters of the terms that are not zero for all joints."""
        return tuple(name for term in stated_terms(self) for name in (AMOUNTS[term], *SHAPES.get(term, ())))

    @property
    def rows(self) -> list[tuple[str, ...]]:
        """The number and the stated parameters of each driven joint variable."""
        names = self.stated_parameters
        if len(names) == 0:
            return []
        is_driven = np.any([getattr(self, AMOUNTS[term]) != 0 for term in stated_terms(self)], axis=0)
        return [(f"{j}", *(f"{getattr(self, name)[j]:.4g}" for name in names)) for j in np.flatnonzero(is_driven)]

    def __repr__(self) -> str:
        """Return at most twelve lines: the parameters that are stated, joint by joint."""
        return print_table(self.summary, ("joint", *self.stated_parameters), self.rows)


UNDRIVEN: dict[str, float] = dict.fromkeys((of.name for of in fields(Drives)), 0.0) | {
    "eps": DEFAULT_SMOOTHING_VELOCITY, "stribeck_velocity": DEFAULT_STRIBECK_VELOCITY, "load_eps": DEFAULT_LOAD_EPS,
}  # fmt: skip
COEFFICIENTS = (*UNDRIVEN, "slope", "stribeck_slope")  # of the laws; the slopes are 1 / eps and 1 / vs


def _fading(c: Coefficients, speed: Series) -> Series:
    """Return exp(-(theta' / vs)^2), the share of Stribeck friction at a speed."""
    slow = c["stribeck_slope"] * speed
    return exponential(-(slow * slow))


DRIVE_LAWS: dict[DriveTerm, DriveLaw] = {
    "armature": lambda c, theta: c["armature"] * theta.dot.dot,
    "damping": lambda c, theta: c["damping"] * theta.dot,
    "friction": lambda c, theta: c["friction"] * hyperbolic_tangent(c["slope"] * theta.dot),
    "stribeck": lambda c, theta: c["stribeck"] * (hyperbolic_tangent(c["slope"] * theta.dot) * _fading(c, theta.dot)),
    "spring": lambda c, theta: c["stiffness"] * (theta - c["rest"]),
    "offset": lambda c, theta: theta * 0 + c["offset"],
}


def _stribeck_slope(c: Coefficients, speed: Series) -> Series:
    """Return the derivative of tanh(theta' / eps) exp(-(theta' / vs)^2) by theta'."""
    # With t = tanh(theta' / eps): (t' - 2 t theta' / vs^2) exp(-(theta' / vs)^2).
    decrease = hyperbolic_tangent(c["slope"] * speed) * (c["stribeck_slope"] * c["stribeck_slope"] * speed) * 2
    return (c["slope"] * hyperbolic_slope(c["slope"] * speed) - decrease) * _fading(c, speed)


# Partial derivatives of the laws, with the rate of theta that they are by: each law depends on one rate only.
PARTIALS: dict[DriveTerm, tuple[int, DriveLaw]] = {
    "armature": (2, lambda c, theta: Series.constant(c["armature"])),
    "damping": (1, lambda c, theta: Series.constant(c["damping"])),
    "friction": (1, lambda c, theta: c["friction"] * (c["slope"] * hyperbolic_slope(c["slope"] * theta.dot))),
    "stribeck": (1, lambda c, theta: c["stribeck"] * _stribeck_slope(c, theta.dot)),
    "spring": (0, lambda c, theta: Series.constant(c["stiffness"])),
    "offset": (0, lambda c, theta: theta * 0),
}
DRIVE_TERMS = tuple(DRIVE_LAWS)  # whose forces follow from the motion alone
LOAD_FRICTION: DriveTerm = "load_friction"
ALL_DRIVE_TERMS = (*DRIVE_TERMS, LOAD_FRICTION)
OMIT_LOAD_FRICTION = Remedy(  # where it is not served
    f"omit it, robot.with_drives({list(DRIVE_TERMS)})", f"omit it, --drives {','.join(DRIVE_TERMS)}"
)
AMOUNTS: dict[str, str] = {term: term for term in ALL_DRIVE_TERMS} | {"spring": "stiffness"}  # 0 if not stated
SHAPES: dict[DriveTerm, tuple[str, ...]] = {  # of the law of a term, what is not its amount
    "friction": ("eps",), "stribeck": ("stribeck_velocity",), "spring": ("rest",), LOAD_FRICTION: ("load_eps",)
}  # fmt: skip
MOMENTUM_LAWS: dict[DriveTerm, DriveLaw] = {"armature": lambda c, theta: c["armature"] * theta.dot}
ENERGY_LAWS: dict[DriveTerm, DriveLaw] = {
    "armature": lambda c, theta: c["armature"] * (theta.dot * theta.dot) * 0.5,
    "spring": lambda c, theta: c["stiffness"] * ((theta - c["rest"]) * (theta - c["rest"])) * 0.5,
}


def drive_error(**stated: float) -> str | None:
    """Return why numbers are no valid drive parameters, or None."""
    for name, x in stated.items():
        if not np.isfinite(x):
            return f"{name} is {x:g}; expected a finite number"
        if x < 0 and name not in SIGNED_PARAMETERS:
            return f"{name} is {x:g}; expected 0 or more"
    for name, what in (("eps", "smoothing velocity of friction"), ("stribeck_velocity", "speed"), ("load_eps", "load")):
        if stated.get(name) == 0:
            return f"{name} is 0; expected a {what} above 0"
    share = stated.get(LOAD_FRICTION, 0)
    if share >= 1:
        return f"{LOAD_FRICTION} is {share:g}; expected a share of the load below 1: no force moves such a joint"
    return None


def coefficients(drives: Drives) -> Coefficients:
    """Return the coefficients of the drive laws as columns (nb, 1)."""
    numbers = vars(drives) | {"slope": 1 / drives.eps, "stribeck_slope": 1 / drives.stribeck_velocity}
    return {name: numbers[name][:, None] for name in COEFFICIENTS}


def forces(c: Coefficients, terms: Sequence[str], theta: Series) -> Series:
    """Return the forces (..., nb, 1) of drive terms on joint variables."""
    return reduce(add, [law(c, theta) for term, law in DRIVE_LAWS.items() if term in terms], theta * 0)


def load_friction(c: Coefficients, theta: Series, Q: Series) -> Series:
    """Return friction by load at joints that transmit Q, (..., nb, 1)."""
    # (Q^2 + d^2)^1/2 is the smooth absolute value of the load, and a the smooth sign of the speed.
    a = c["load_friction"] * hyperbolic_tangent(c["slope"] * theta.dot)
    return a * SERIES_RULES["sqrt"](Q * Q + c["load_eps"] ** 2)


def load_friction_of_motors(c: Coefficients, theta: Series, tau: Series) -> Series:
    """Return friction by load at motors that exert tau, (..., nb, 1).

    What friction leaves of tau is the load Q: tau = Q + a (Q^2 + d^2)^1/2.
    """
    # Solved for Q, with Q = tau - F: F = a ((tau^2 + (1 - a^2) d^2)^1/2 - a tau) / (1 - a^2).
    a = c["load_friction"] * hyperbolic_tangent(c["slope"] * theta.dot)
    remainder = -(a * a) + 1
    return a * (SERIES_RULES["sqrt"](tau * tau + remainder * c["load_eps"] ** 2) - a * tau) * inverse(remainder)


def unit_contribution(laws: Mapping[DriveTerm, DriveLaw], c: Coefficients, term: DriveTerm, theta: Series) -> Series:
    """Return the force of one unit of a parameter, (..., nb, 1).

    The parameter is the amount of a drive term, of which all laws are linear.
    """
    law = laws.get(term)
    return theta * 0 if law is None else law({**c, AMOUNTS[term]: np.ones_like(c["armature"])}, theta)


def partials(c: Coefficients, terms: Sequence[str], theta: Series) -> tuple[Series, Series, Series]:
    """Return the partial derivatives of `forces` by theta, theta', theta''.

    Each is (..., nb, 1).
    """
    by_rate = [theta * 0] * 3
    for term, (rate, law) in PARTIALS.items():
        if term in terms:
            by_rate[rate] = by_rate[rate] + law(c, theta)
    return by_rate[0], by_rate[1], by_rate[2]


def select_terms(terms: object, choices: tuple[DriveTerm, ...] = ALL_DRIVE_TERMS) -> tuple[DriveTerm, ...]:
    """Return the selected drive terms in their order.

    True selects all, False none; anything else are names.
    """
    if isinstance(terms, bool):
        return choices if terms else ()
    kind = "linear drive term" if choices is DRIVE_TERMS else "drive term"
    names = {check_choice(kind, x, choices) for x in as_list(terms)}
    return tuple(term for term in choices if term in names)


def stated_terms(drives: Drives) -> tuple[DriveTerm, ...]:
    """Return the drive terms that are not zero for all joints."""
    return tuple(term for term in ALL_DRIVE_TERMS if np.any(getattr(drives, AMOUNTS[term])))


def describe_terms(terms: object) -> str:
    """Return drive terms in the words of a user.

    They are ``drives=['damping']`` or ``--drives damping``.
    """
    words = "all" if terms is True else ",".join(map(str, as_list(terms)))
    return str(Remedy(f"drives={quote_value(terms)}", f"--drives {shorten(words)}"))


def warn_of_idle(drives: Drives, terms: object, eps: float | None, name: str) -> None:
    """Warn of selected terms and an eps without effect.

    Terms have none if the robot does not state them, eps if there is no friction.
    """
    selected = select_terms(terms)
    stated = stated_terms(drives)
    acting = {*selected} & {*stated}
    if len(selected) > 0 and len(acting) == 0:
        others = f"; it states {join_names(stated)}" if len(stated) > 0 else ""
        warn(f"{name}: {describe_terms(terms)} has no effect: the robot states no {' or '.join(selected)}{others}")
    # The smoothing velocity is one of friction, and of friction by the load.
    if eps is not None and not acting & {"friction", LOAD_FRICTION}:
        why = "the robot states no friction" if "friction" in selected else "it is of friction, which is not selected"
        warn(f"{name}: {option_value('eps', eps)} has no effect: {why}")


def with_eps(drives: Drives, eps: float) -> Drives:
    """Return the drives with another smoothing velocity of friction for all joints."""
    if not is_finite(eps) or not eps > 0:
        raise JounceError(
            f"eps is {quote_value(eps)}; expected a smoothing velocity of friction above 0, in rad/s or m/s"
        )
    return replace(drives, eps=np.full(drives.eps.shape, float(eps)))
