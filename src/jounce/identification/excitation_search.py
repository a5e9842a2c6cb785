"""The search for the Fourier series that excites the parameters most within limits.

Problem: maximise log det of the information matrix of the forces (a D-optimal experiment: V. V. Fedorov, Theory of
Optimal Experiments, 1972) over the free amplitudes of series that start and end at rest, within all limits.
Algorithm: minimise -log det plus the relaxed barrier of the limits (`room`), weighted less in each of three stages, by
BFGS (J. Nocedal, S. J. Wright, Numerical Optimization, chapter 6), each stage from the minimum of the last, the first
from several random series; the best counts. Gradients are exact, by vector-Jacobian products of native code.
Invariants: every series meets the conditions at its ends, whatever its amplitudes; a series beyond limits has a value
too, so that any series is a start. A minimum is a local one, and may exceed limits a little: `excitation` shrinks it.
Failure: `rest` raises if effort limits let the robot hold no pose that it finds.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.optimize import minimize

from jounce.core.cures import Remedy
from jounce.core.errors import JounceError, quote_value
from jounce.identification.barrier_terms import LimitBarrier
from jounce.identification.harmonics import Harmonics
from jounce.identification.information_matrix import Information
from jounce.model.limit_kinds import MOTION_KINDS
from jounce.model.limits import Limits

BARRIER_STAGES = ((2.5, 0.15), (0.25, 0.015), (0.025, 0.0015))  # weight of the barrier per parameter, room that is kept
MAX_BFGS_STEPS = 300  # in each stage, a bound of the time that it takes
MAX_LOSS_SLOPE = 0.1  # per unit of amplitudes, ends a stage: the rest changes deviations by less than 1 %
MAX_START_AMPLITUDE = 0.3  # of random series, in units of the limits: several of them add up
MAX_REST_STARTS = 20  # poses from which one is sought that effort limits let the robot hold

Progress = Callable[[int, int], object]  # of the number of starts done, and of all


@dataclass(frozen=True, eq=False)
class ExcitationSearch:
    """Series of a robot's coordinates, the information that they give and the room that limits leave them.

    `reaches` (order + 1, n) are the bounds of q and its rates, q about its `middle` (n,); where that of a rate is 0,
    the coordinate stands still. A `share` of each limit is used.
    """

    series: Harmonics
    information: Information
    room: LimitBarrier
    middle: np.ndarray
    reaches: np.ndarray
    share: float

    @cached_property
    def basis(self) -> np.ndarray:
        """The series of the free amplitudes at the points of a period."""
        return self.series.basis(self.room.order)

    @cached_property
    def units(self) -> np.ndarray:
        """The largest free amplitudes (free, n) that the limits of q and its rates allow if they are alone."""
        peaks = np.abs(self.basis).max(axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):  # of means, whose rates are 0
            ways = self.reaches[:, None, :] / peaks[:, :, None]
        return np.vstack([self.reaches[:1], ways.min(axis=0)[1:]])

    def amplitudes(self, u: np.ndarray) -> np.ndarray:
        """The free amplitudes (free, n) of a vector in their units, about the middle of the range."""
        x = self.units * u.reshape(self.units.shape)
        x[0] += self.middle
        return x

    def rates(self, x: np.ndarray) -> tuple[np.ndarray, ...]:
        """q, qd, ... (points, n) of free amplitudes."""
        return tuple(self.basis @ x)

    def loss(self, u: np.ndarray, weight: float, delta: float) -> tuple[float, np.ndarray]:
        """-log det and the weighted barrier, and the gradient."""
        rates = self.rates(self.amplitudes(u))
        value, gradients = self.information.loss(rates)
        barrier, pushes = self.room.loss(rates, self.share, delta)
        # the chain rule: from the rates of q at points to the amplitudes, over which they are linear
        for k, push in enumerate(pushes):
            pushes[k] = weight * push + (gradients[k] if k < len(gradients) else 0)
        by_amplitude = sum(rate.T @ push for rate, push in zip(self.basis, pushes, strict=True))
        return value + weight * barrier, (self.units * by_amplitude).ravel()

    def find_best(self, starts: int, rng: np.random.Generator, progress: Progress | None) -> np.ndarray:
        """The free amplitudes of the best series from some random ones."""
        found, count = [], len(self.information.names)
        for i in range(starts):
            u = self.random_start(rng)
            for weight, delta in BARRIER_STAGES:
                u = _minimise(self.loss, u, count * weight, delta)
            x = self.amplitudes(u)
            found.append((self.information.log_det(self.rates(x)), i, x))
            if progress is not None:
                progress(i + 1, starts)
        return max(found)[2]

    def random_start(self, rng: np.random.Generator) -> np.ndarray:
        """A random series about a random pose, in the units of amplitudes."""
        u = MAX_START_AMPLITUDE * rng.uniform(-1, 1, self.units.shape)
        u[0] = rng.uniform(-0.5, 0.5, len(self.middle))
        return u.ravel()

    def find_rest(self, rng: np.random.Generator) -> np.ndarray:
        """A pose (n,) in which all limits leave room at rest; raise `JounceError` if none is found."""
        zero = np.zeros((self.room.order, 1, len(self.middle)))

        def rates(u: np.ndarray) -> tuple[np.ndarray, ...]:
            return (self.middle + self.reaches[:1] * u, *zero)

        def barrier(u: np.ndarray) -> tuple[float, np.ndarray]:
            value, gradients = self.room.loss(rates(u), self.share, BARRIER_STAGES[1][1])
            return value, gradients[0][0] * self.reaches[0]

        worst = []
        for i in range(MAX_REST_STARTS):
            u = rng.uniform(-0.8, 0.8, len(self.middle)) if i else np.zeros(len(self.middle))
            u = _minimise(barrier, u)
            worst.append(self.room.worst(rates(u)))  # the barrier's minimum may be beyond a limit
            if worst[-1][0] < self.share:
                return rates(u)[0][0]
        ratio, kind, joint = min(worst)
        what = f"{kind.replace('_', ' ')} of joint {quote_value(self.information.robot.joint_names[joint])}"
        came = f"the {what} takes {ratio:.3g} times its limit at rest, or more"
        cure = f"raise it with {Remedy(f'robot.with_limits({kind}=...)', '--limits FILE')}"
        raise JounceError(f"no pose is found that the limits let the robot hold: {came}; {cure}")


def _minimise(loss: Callable[..., tuple[float, np.ndarray]], u: np.ndarray, *arguments: float) -> np.ndarray:
    """A local minimum of a loss with its gradient, by BFGS: L-BFGS takes half as many steps again."""
    found = minimize(loss, u, arguments, "BFGS", jac=True, options={"maxiter": MAX_BFGS_STEPS, "gtol": MAX_LOSS_SLOPE})
    return np.asarray(found.x)


def motion_reaches(limits: Limits, series: Harmonics, order: int) -> np.ndarray:
    """How far q and its rates may go, (order + 1, n): as limits say, and no rate further than series of such q do.

    A coordinate stands still, with rates 0, if any limit of it leaves no way.
    """
    lower, upper = limits.bounds(MOTION_KINDS[0])
    found = [(upper - lower) / 2]
    for k, kind in enumerate(MOTION_KINDS[1 : order + 1], 1):
        common = found[0] * (series.frequency * (series.count + 1) / 2) ** k
        found.append(np.minimum(common, np.abs(limits.bounds(kind)).min(axis=0)))
    return np.stack([found[0], *(np.array(found[1:]) * np.all(found, axis=0))])
