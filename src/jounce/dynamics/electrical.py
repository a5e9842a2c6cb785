"""Currents and voltages of motors from their torques and positions, series (..., m) with an entry per motor."""

from collections.abc import Sequence

import numpy as np

from jounce.core.cures import Remedy
from jounce.core.scalars import Array
from jounce.dynamics.joint_springs import elasticity_of
from jounce.model.elasticity import Elasticity
from jounce.model.mechanism import Mechanism
from jounce.spatial.series import Series


def currents(e: Elasticity, tau: Series) -> Series:
    """i = tau / (r k)."""
    return _scale_terms(1 / (_motor_data(e, "gear") * _motor_data(e, "constant")), tau)


def voltages(e: Elasticity, theta: Series, tau: Series) -> Series:
    """u = R i + L di/dt + k r thetad: a rate takes one more of the torques, unless there is no inductance."""
    i, back = currents(e, tau), _motor_data(e, "constant") * _motor_data(e, "gear")
    u = _scale_terms(_motor_data(e, "resistance"), i) + _scale_terms(back, theta.dot)
    return u + _scale_terms(_motor_data(e, "inductance"), i.dot) if e.is_inductive else u


def outputs(
    e: Elasticity, theta: Sequence[Array], tau: Sequence[Array]
) -> tuple[tuple[Array, ...] | None, tuple[Array, ...] | None]:
    """Currents and voltages as far as the data of motors and the rates of tau go; None if they do not."""
    lacking = [np.isnan(_motor_data(e, name)).all() for name in ("constant", "resistance")]
    i, u = currents(e, Series.of(tau)), voltages(e, Series.of(theta), Series.of(tau))
    known = min(len(tau) - e.is_inductive, len(theta) - 1)
    return (None if lacking[0] else i.upto(len(tau) - 1), None if any(lacking) or known < 1 else u.upto(known - 1))


def current_obstacle(m: Mechanism) -> str | None:
    """Why motors have no currents, as the end of a sentence, or None."""
    if np.isnan(_motor_data(elasticity_of(m), "constant")).all():
        motor = Remedy(": motors=jounce.Motor(constant=..., gear=...)", " in its file")
        return f" needs the torque constant of a motor{motor}"
    return None


def voltage_obstacle(m: Mechanism) -> str | None:
    """Why motors have no voltages, as the end of a sentence, or None."""
    if np.isnan(_motor_data(elasticity_of(m), "resistance")).all():
        motor = Remedy(": motors=jounce.Motor(resistance=..., constant=...)", " in its file")
        return f" needs the resistance of a motor{motor}"
    return current_obstacle(m)


def _scale_terms(factors: Array, x: Series) -> Series:
    """The product, without NumPy's warning where a factor is not stated and x are symbols."""

    def product(x: Array) -> Array:
        with np.errstate(invalid="ignore"):
            return factors * x

    return x.map(product)


def _motor_data(e: Elasticity, name: str) -> np.ndarray:
    """One number per motor, NaN where it is not stated."""
    motors = [e.motors[j] if e.motors else None for j in e.joints_of_motors]
    stated = [None if motor is None else getattr(motor, name) for motor in motors]
    return np.array([np.nan if x is None else x for x in stated], dtype=float)
