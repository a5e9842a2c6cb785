"""Motors of elastic joints: gear, rotor, the body that carries it, friction, and the electrical side."""

from dataclasses import dataclass

import numpy as np

from jounce.core.errors import JounceError, quote_value
from jounce.core.scalars import asarray, is_finite, is_numeric

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
        stated = {name: x for name, x in vars(self).items() if name not in ("body", "axis") and x is not None}
        for name, x in stated.items():
            least = "above 0" if name in POSITIVE else "0 or more" if name in NOT_NEGATIVE else "not 0"
            fits = is_finite(x) and (x > 0 if name in POSITIVE else x >= 0 if name in NOT_NEGATIVE else x != 0)
            if not fits:
                raise JounceError(f"{name} of a motor is {quote_value(x)}; expected a finite number, {least}")
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
        """B = r^2 J, as the joint sees it, or None where the inertia is not stated."""
        return None if self.inertia is None else self.gear**2 * self.inertia
