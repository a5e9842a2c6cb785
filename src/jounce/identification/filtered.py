"""Equations of motion without accelerations: the balance of momentum or energy through a low-pass filter.

Both are of the form ``d/dt (A theta) + R theta = b`` in the parameters theta, with A and R functions of q and qd: the
generalized momentum changes by the forces b = Q, one equation per coordinate; the energy by their power b = qd . Q, one
equation. A filter w / (s + w) of both sides takes the derivative away: s w / (s + w) is w - w w / (s + w), so that

    w (A(t) - exp(-w (t - t0)) A(t0)) theta + F[R - w A] theta = F[b],    F[u]' = w (u - F[u]),  F[u](t0) = 0.
"""

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from jounce._typing import DriveColumn
from jounce.identification.low_pass import LowPass
from jounce.motion.motion import Motion
from jounce.robot.robot import Robot


class Balance(NamedTuple):
    """A balance at some times, the columns of the parameters and behind them the model as it is: (N, rows, P + 1)."""

    stored: np.ndarray  # A
    rest: np.ndarray  # R


Law = Callable[[Robot, Motion, np.ndarray, Sequence[DriveColumn]], Balance]


def momentum(robot: Robot, motion: Motion, t: np.ndarray, terms: Sequence[DriveColumn]) -> Balance:
    """The balance of the generalized momentum: one row per velocity, of parameters and drive terms."""
    (q, qd), base = motion(t, 1), motion.base(t, 1)
    base = base and (*base, 0 * base[1])
    still, W = 0 * q, motion.wrench(t, 0)
    Yp, Ypd = robot.momentum_regressor(q, qd, still, drives=terms, base=base)
    p, pd = robot.generalized_momentum(q, qd, still, base=base)
    Y = robot.regressor(q, qd, still, drives=terms, base=base)
    Q = robot.inverse_dynamics(q, qd, still, wrench=W, base=base)
    return Balance(_behind(Yp, p), _behind(Y - Ypd, Q - pd))


def energy(robot: Robot, motion: Motion, t: np.ndarray, terms: Sequence[DriveColumn]) -> Balance:
    """The balance of the energy: one row, of parameters and drive terms."""
    q, qd = motion(t, 1)
    still, W = 0 * q, motion.wrench(t, 0)
    YE, YEd = robot.energy_regressor(q, qd, still, drives=terms)
    (T, Td), (U, Ud) = robot.kinetic_energy(q, qd, still), robot.potential_energy(q, qd)
    Y = robot.regressor(q, qd, still, drives=terms)
    Q = robot.inverse_dynamics(q, qd, still, wrench=W)
    power = np.einsum("ti,tij->tj", qd, _behind(Y, Q))
    return Balance(_behind(YE, T + U)[:, None], (power - _behind(YEd, Td + Ud))[:, None])


def _behind(columns: np.ndarray, model: np.ndarray) -> np.ndarray:
    """Columns of parameters, and the model as it is behind them."""
    return np.concatenate([columns, model[..., None]], axis=-1)


def filtered_rows(
    law: Law, robot: Robot, motion: Motion, terms: Sequence[DriveColumn], through: LowPass
) -> Iterator[tuple[slice, np.ndarray]]:
    """The filtered rows of a balance by pieces of samples: (n, rows, P + 1) that belong to the filtered right sides."""
    w, t = through.cutoff, through.t
    start = law(robot, motion, t[:1], terms).stored
    stored: dict[int, np.ndarray] = {}

    def signal(part: slice) -> np.ndarray:
        found = law(robot, motion, t[part], terms)
        stored[part.start] = found.stored
        return found.rest - w * found.stored

    for part, filtered in through(signal):
        [(origin, of_states)] = stored.items()
        stored.clear()
        here = of_states[part.start - origin : part.stop - origin]
        yield part, filtered + w * (here - np.exp(-w * (t[part] - t[0]))[:, None, None] * start)
