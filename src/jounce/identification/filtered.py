"""Equations of motion without accelerations: the balance of momentum or energy through a low-pass filter.

Both are of the form ``d/dt (A theta) + R theta = b`` in the parameters theta, with A and R functions of q and qd: the
generalized momentum changes by the forces b = Q, one equation per coordinate; the energy by their power b = qd . Q, one
equation. A filter w / (s + w) of both sides takes the derivative away: s w / (s + w) is w - w w / (s + w), so that

    w (A(t) - exp(-w (t - t0)) A(t0)) theta + F[R - w A] theta = F[b],    F[u]' = w (u - F[u]),  F[u](t0) = 0.

The filter is exact for signals that are cubic between samples, at any times.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.special import hyp1f1

from jounce._typing import DriveColumn
from jounce.motion.motion import Motion
from jounce.robot.robot import Robot

PIECE = 2000  # states whose rows are held at once
POINTS = 4  # samples that a cubic passes through
EVEN = 0.1  # ratio of the intervals between them, below which it is a line: a cubic would amplify noise


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


@dataclass(frozen=True, eq=False)
class LowPass:
    """A filter w / (s + w) on samples: y[k + 1] = decay[k] y[k] + sum of weights[k, m] u[first[k] + m]."""

    t: np.ndarray
    cutoff: float  # w, rad/s
    decay: np.ndarray  # (N - 1,)
    first: np.ndarray  # (N - 1,)
    weights: np.ndarray  # (N - 1, POINTS)

    def __call__(self, signal: Callable[[slice], np.ndarray]) -> Iterator[tuple[slice, np.ndarray]]:
        """The filtered signal by pieces of samples, from a function that returns the signal at some samples."""
        y = 0 * signal(slice(0, 1))
        yield slice(0, 1), y
        for start in range(0, len(self.decay), PIECE):
            steps = slice(start, min(start + PIECE, len(self.decay)))
            first = self.first[steps]
            u = signal(slice(first[0], first[-1] + POINTS))
            filtered = np.zeros((len(first), *u.shape[1:]))
            for m, weight in enumerate(self.weights[steps].T):
                filtered += weight.reshape(-1, *[1] * (u.ndim - 1)) * u[first - first[0] + m]
            for k, decay in enumerate(self.decay[steps]):
                filtered[k] += decay * y[0]
                y = filtered[k : k + 1]
            yield slice(steps.start + 1, steps.stop + 1), filtered

    def of(self, values: np.ndarray) -> np.ndarray:
        """The filtered signal of values (N, ...) at all samples."""
        return np.concatenate([y for _, y in self(values.__getitem__)])


def low_pass(t: np.ndarray, cutoff: float) -> LowPass:
    """The filter for increasing times (N,), N at least 4, and a cutoff frequency in Hz."""
    w, h = 2 * np.pi * cutoff, np.diff(t)
    first = np.clip(np.arange(len(h)) - 1, 0, len(t) - POINTS)
    near = first[:, None] + np.arange(POINTS)
    powers = np.arange(POINTS)
    x = ((t[near] - t[:-1, None]) / h[:, None])[:, None] ** powers[:, None]  # (N - 1, powers, points)
    moments = (w * h)[:, None] * hyp1f1(1, powers + 2, -(w * h)[:, None]) / (powers + 1)
    cubic = np.linalg.solve(x, moments[..., None])[..., 0]
    later, earlier = (near == np.arange(len(h))[:, None] + k for k in (1, 0))
    line = later * moments[:, 1:2] + earlier * (moments[:, :1] - moments[:, 1:2])
    gaps = np.diff(t[near], axis=1)
    even = gaps.min(axis=1) >= EVEN * gaps.max(axis=1)
    return LowPass(t, w, np.exp(-w * h), first, np.where(even[:, None], cubic, line))


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
