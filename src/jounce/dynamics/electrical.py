"""Currents and voltages of motors from their torques and positions, with rates."""

from collections.abc import Sequence

import numpy as np

from jounce.core.errors import JounceError
from jounce.core.scalars import Array
from jounce.model.elasticity import Elasticity


def currents(e: Elasticity, tau: Sequence[Array]) -> tuple[Array, ...]:
    """i = tau / (r k) and its rates, as many as those of the torques."""
    gear, constant = _data(e, "gear"), _data(e, "constant")
    if np.isnan(constant).all():
        raise JounceError("currents need the torque constant of a motor: motors=jounce.Motor(constant=..., gear=...)")
    per_torque = 1 / (gear * constant)
    return tuple(x * per_torque for x in tau)


def voltages(e: Elasticity, theta: Sequence[Array], tau: Sequence[Array]) -> tuple[Array, ...]:
    """u = R i + L di/dt + k r thetad and its rates: one less than of the torques, unless there is no inductance."""
    i, R, L = currents(e, tau), _data(e, "resistance"), _data(e, "inductance")
    back = _data(e, "constant") * _data(e, "gear")
    if np.isnan(R).all():
        raise JounceError("voltages need the resistance of a motor: motors=jounce.Motor(resistance=..., constant=...)")
    if not np.nansum(L):
        return tuple(R * i_k + back * v for i_k, v in zip(i, theta[1:], strict=False))
    return tuple(R * i_k + L * i_next + back * v for i_k, i_next, v in zip(i, i[1:], theta[1:], strict=False))


def outputs(
    e: Elasticity, theta: Sequence[Array], tau: Sequence[Array]
) -> tuple[tuple[Array, ...] | None, tuple[Array, ...] | None]:
    """Currents and voltages as far as the data of motors and the rates of tau go; None if they do not."""
    lacking = [np.isnan(_data(e, name)).all() for name in ("constant", "resistance")]
    return (
        None if lacking[0] else currents(e, tau),
        None if any(lacking) else voltages(e, theta, tau) or None,
    )


def _data(e: Elasticity, name: str) -> np.ndarray:
    """One number per motor, NaN where it is not stated."""
    motors = [e.motors[j] if e.motors else None for j in e.joints_of_motors]
    stated = [None if motor is None else getattr(motor, name) for motor in motors]
    return np.array([np.nan if x is None else x for x in stated], dtype=float)
