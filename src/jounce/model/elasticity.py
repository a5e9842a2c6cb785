"""Elasticity puts motors behind springs: the links of a robot hang on its motors only through these.

theta is the position of a motor seen from its link: the angle of the rotor over the gear ratio. A spring that is
deflected by delta = theta - q exerts phi(delta) on the link; Q is the force of the links' inverse dynamics. Spong's
model, in which rotors turn about their own axes only:

    phi(delta) = Q(q, qd, q2d),    B theta'' + F_m(theta') + phi(delta) = tau,    F_m(v) = d_m v + f tanh(v / eps)

`Elasticity` holds the springs and the motors by coordinate. A `Motor` states, of the rotor itself, its gear, its
inertia and friction, the body that carries it, and its electrical side; the joint sees these through the gear.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np

from jounce.core.errors import JounceError, quote_value
from jounce.core.scalars import Array, asarray, is_finite, is_numeric
from jounce.core.typing import Floats
from jounce.model.spring_deflection import AntagonisticSprings
from jounce.model.springs import CubicSpring, DampedSpring, Spring

POSITIVE = ("inertia", "resistance", "constant")
NOT_NEGATIVE = ("damping", "friction", "inductance")


@dataclass(frozen=True, kw_only=True)
class Motor:
    """The motor of an elastic joint. All numbers are those of the rotor itself, in front of the gear.

    The rotor turns by the angle r theta against its carrier, the motor torque at the joint is r times that of the
    rotor. Mass and inertia of the rotor at rest belong to its carrier, as robot files have it.

    Parameters
    ----------
    gear : float, optional
        The gear ratio r, rotor speed over joint speed; a negative one turns the other way. Not zero. Of a prismatic
        joint it is rad/m.
    inertia : float, optional
        Inertia J of the rotor about its axis, kg m^2. The joint sees B = r^2 J, as `rotor` of `Robot.elastic` states
        it otherwise.
    body : str, optional
        The body or link that carries the rotor, "world" for the ground. Couplings other than "spong" need it.
    axis : (3,), optional
        The axis about which the rotor spins, in the axes of `body`; z by default. It need not be a unit vector.
    damping : float, optional
        Viscous damping of the rotor, N m s.
    friction : float, optional
        Coulomb friction of the rotor, N m.
    resistance : float, optional
        Resistance R of the winding, ohm.
    inductance : float, optional
        Inductance L of the winding, H; 0 by default.
    constant : float, optional
        Torque constant k, N m/A, which is the constant of the back electromotive force too, V s.

    Examples
    --------
    >>> import jounce
    >>> motor = jounce.Motor(gear=100, inertia=2e-5, body="link1", axis=(0, 0, 1), resistance=0.5, constant=0.05)
    >>> round(motor.reflected_inertia, 6)
    0.2
    """

    gear: float = 1.0
    inertia: float | None = None
    body: str | None = None
    axis: tuple[float, float, float] = (0.0, 0.0, 1.0)
    damping: float = 0.0
    friction: float = 0.0
    resistance: float | None = None
    inductance: float = 0.0
    constant: float | None = None

    def __post_init__(self) -> None:
        numbers = {name: x for name, x in vars(self).items() if name not in ("body", "axis") and x is not None}
        for name, x in numbers.items():
            if name in POSITIVE:
                expected, is_valid = "above 0", is_finite(x) and x > 0
            elif name in NOT_NEGATIVE:
                expected, is_valid = "0 or more", is_finite(x) and x >= 0
            else:
                expected, is_valid = "not 0", is_finite(x) and x != 0
            if not is_valid:
                raise JounceError(f"{name} of a motor is {quote_value(x)}; expected a finite number, {expected}")
        if self.body is not None and not isinstance(self.body, str):
            raise JounceError(
                f"body of a motor is {quote_value(self.body)}; expected the name of the body that carries it"
            )
        axis = np.asarray(asarray(self.axis, "axis of a motor"))
        if axis.shape != (3,) or not is_numeric(axis) or not (np.isfinite(axis).all() and axis.any()):
            raise JounceError(f"axis of a motor is {quote_value(self.axis)}; expected three finite numbers, not all 0")
        object.__setattr__(self, "axis", tuple((axis / np.linalg.norm(axis)).tolist()))

    @property
    def reflected_inertia(self) -> float | None:
        """B = r^2 J, as the joint sees it, or None.

        It is None if the inertia is not stated.
        """
        return None if self.inertia is None else self.gear**2 * self.inertia


ElasticLaw: TypeAlias = Spring | DampedSpring | AntagonisticSprings
SpringLaw: TypeAlias = Spring | AntagonisticSprings | Callable[[Any], Any]  # as callers give it


@dataclass(frozen=True, eq=False, kw_only=True)
class Elasticity:
    """The springs and motors of elastic joints, one per coordinate.

    `Robot.elastic` makes and checks it.

    Attributes
    ----------
    stiffness : (n,)
        Stiffness of the spring between motor and link, N m/rad or N/m; infinite for a rigid joint.
    rotor : (n,)
        Inertia of the rotor seen from the link, kg m^2 or kg: its own times the gear ratio squared.
    viscous : (n,)
        Viscous damping of the motor, N m s or N s/m.
    friction : (n,)
        Coulomb friction of the motor, N m or N.
    eps : (n,)
        Smoothing velocity of the friction, rad/s or m/s.
    springs : tuple
        A spring per coordinate that is not linear or has a damper, None for others; empty if all are linear.
    motors : tuple of Motor or None
        The motors as stated, one per coordinate; empty if none is.
    level : int or None
        The level of the coupling of rotors and links that carry them; None in Spong's model.

    Examples
    --------
    >>> import jounce
    >>> arm = jounce.load("planar2r").elastic([800.0, 600.0], rotor=0.1)
    >>> arm.elasticity.stiffness
    array([800., 600.])
    """

    stiffness: Floats
    rotor: Floats
    viscous: Floats
    friction: Floats
    eps: Floats
    springs: tuple[ElasticLaw | None, ...] = ()
    motors: tuple[Motor | None, ...] = ()
    level: int | None = None

    @property
    def more_rates(self) -> int:
        """The number of further rates that motor positions and torques take.

        Dampers and couplings need them.
        """
        terms = max([0, *(law.terms - 1 for law in self.springs if isinstance(law, DampedSpring))])
        level = self.level or 0
        return (level + 1) * terms + 2 * level

    @property
    def is_inductive(self) -> bool:
        """Whether a motor has an inductance: voltages take the rate of its torque."""
        return any(motor and motor.inductance for motor in self.motors)

    @property
    def is_rigid(self) -> Array:
        """Whether the joint of each coordinate is rigid, (n,)."""
        return np.array([isinstance(k, int | float | np.number) and bool(k == np.inf) for k in self.stiffness])

    @cached_property
    def joints_of_motors(self) -> list[int]:
        """The coordinate of each motor: a joint with two springs has two."""
        laws = self.springs or (None,) * len(self.stiffness)
        return [j for j, law in enumerate(laws) for _ in range(1 + isinstance(law, AntagonisticSprings))]

    @cached_property
    def laws(self) -> list[Spring | DampedSpring | None]:
        """The spring of each motor, None if linear without a damper.

        The list is empty if all springs are linear.
        """
        pairs = [(law.first, law.second) if isinstance(law, AntagonisticSprings) else (law,) for law in self.springs]
        return [law for pair in pairs for law in pair]

    @property
    def pairs(self) -> list[int]:
        """The coordinates with two motors."""
        return [j for j, law in enumerate(self.springs) if isinstance(law, AntagonisticSprings)]

    @property
    def dampers(self) -> list[int]:
        """The coordinates whose springs have dampers."""
        return [j for j, law in enumerate(self.springs) if isinstance(law, DampedSpring)]

    @property
    def slack(self) -> list[int]:
        """The coordinates whose springs have no stiffness at rest.

        Where such a spring carries no force, rates are infinite.
        """
        return [j for j, law in enumerate(self.springs) if isinstance(law, CubicSpring) and law.k == 0]

    @property
    def of_motors(self) -> "Elasticity":
        """The same springs and motors, with array entries per motor."""
        return self.select(self.joints_of_motors) if self.pairs else self

    @property
    def arrays(self) -> Mapping[str, Array]:
        """The numbers by name, one per coordinate each."""
        return {name: getattr(self, name) for name in ("stiffness", "rotor", "viscous", "friction", "eps")}

    def map(self, convert: Callable[[Array], Array]) -> "Elasticity":
        """The same springs and motors with other numbers.

        Parameters
        ----------
        convert : callable
            Applied to each array.

        Returns
        -------
        Elasticity

        Raises
        ------
        Exception
            What `convert` raises.

        Examples
        --------
        >>> import jounce
        >>> elasticity = jounce.load("planar2r").elastic([800, 600], rotor=0.1).elasticity
        >>> elasticity.map(lambda x: 2 * x).rotor
        array([0.2, 0.2])
        """
        return replace(self, **{name: convert(array) for name, array in self.arrays.items()})

    def select(self, coordinates: Sequence[int]) -> "Elasticity":
        """The springs and motors of some coordinates.

        Parameters
        ----------
        coordinates : sequence of int
            Their indices.

        Returns
        -------
        Elasticity

        Raises
        ------
        IndexError
            If there is no such coordinate.

        Examples
        --------
        >>> import jounce
        >>> jounce.load("planar2r").elastic([800, 600], rotor=0.1).elasticity.select([1]).stiffness
        array([600.])
        """
        springs = tuple(self.springs[j] for j in coordinates) if self.springs else ()
        motors = tuple(self.motors[j] for j in coordinates) if self.motors else ()
        return replace(self.map(lambda array: array[list(coordinates)]), springs=springs, motors=motors)


def motor_names(e: Elasticity, joints: Sequence[str]) -> tuple[str, ...]:
    """Return a name per motor: that of its joint, with _1 and _2 where a joint has two."""
    pairs = [(f"{name}_1", f"{name}_2") if j in e.pairs else (name,) for j, name in enumerate(joints)]
    return tuple(name for pair in pairs for name in pair)
