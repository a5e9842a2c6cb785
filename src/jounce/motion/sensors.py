"""Joints whose sensors are read at different times, or at different rates: each holds its value over rows of its own.

Rows of the slowest sensor count, so that no value counts twice. The values that others hold there are late by known
delays: they are moved to the row's time by what the motion passes meanwhile.

Problem: samples at common times t of a motion q with samples ``q_k(t_k)`` at each joint's own times. Fixed point
iteration: a fit to the samples moves them, ``q_k(t_k) + fit(t) - fit(t_k)``, and is repeated until they rest. Errors of
the fit at an angular frequency w grow 2 sin(w delay / 2) times in each round, so that it converges for delays below a
sixth of the shortest period of the motion; otherwise it ends after `MAX_MOVING_ROUNDS`.
"""

from dataclasses import dataclass, replace

import numpy as np

from jounce.motion.holds import SampleHolds, describe_delay, find_holds
from jounce.motion.least_squares import SplineSolution
from jounce.motion.samples import MIN_FIT_SAMPLES, Samples
from jounce.motion.smoothing import fit_even_breaks

PERIOD_TOLERANCE = 0.01  # of a sensor's period, by which that of all joints together may differ
MAX_MOVING_ROUNDS = 8  # each leaves a delay times the highest frequency of the rest
MOVING_TOLERANCE = 0.01  # standard deviations of noise, by which values still move at the end


@dataclass(frozen=True, eq=False)
class SensorClocks:
    """What becomes of samples whose sensors are not read together."""

    held: np.ndarray  # (N,), rows that are left out
    samples: Samples  # the others, moved to common times
    periods: np.ndarray  # (n,), s; 0 for joints as fast as the log, or where the motion is too slow to determine it

    @property
    def notes(self) -> tuple[str, ...]:
        """What a user should know of it."""
        known = self.periods[self.periods > 0]
        rates = dict.fromkeys(f"{1 / period:.4g}" for period in (known.max(), known.min()))
        return (
            f"sensors of {' to '.join(rates)} values per second, which rows hold, are not read together for all joints:"
            f" {self.held.sum()} of {len(self.held)} rows are left out, which the slowest does not read, and values are"
            " moved to the times of the others by the motion itself"
            + describe_delay(np.asarray(self.samples.unsure), float(known.max())),
        )


def find_sensors(
    samples: Samples, curve: np.ndarray, first: SplineSolution, cells: int, together: SampleHolds
) -> SensorClocks | None:
    """The samples at common times, where joints hold values over rows of their own and not all of them `together`."""
    own = [
        find_holds(samples.joints(k), curve[:, k], replace(first, energy=first.energy[k]), cells)
        for k in np.arange(samples.q.shape[1])[:, None]
    ]
    periods = np.array([holds.period or 0.0 for holds in own])
    known = periods[periods > 0]
    slowest = own[int(np.argmax(periods))]
    rows = np.flatnonzero(~slowest.held)
    alike = together.period is not None and (np.abs(known / together.period - 1) < PERIOD_TOLERANCE).all()
    if not known.size or alike or len(rows) < MIN_FIT_SAMPLES:
        return None
    ticks = np.stack([holds.t[np.cumsum(~holds.held)[rows] - 1] for holds in own], axis=1).clip(*samples.span)
    row = float(np.median(np.diff(samples.t)))  # joints as fast as the log have clocks of their own as well
    unsure = np.array([min(holds.unsure or row, periods.max()) for holds in own])
    return SensorClocks(slowest.held, _move_samples(replace(samples.part(rows), unsure=unsure), ticks), periods)


def _move_samples(samples: Samples, ticks: np.ndarray) -> Samples:
    """Samples q (R, n), read at `ticks` (R, n), as they were at the times of the rows."""
    moved = samples
    for _ in range(MAX_MOVING_ROUNDS):  # a fit, what it passes between the times, and whether that has changed
        solution, _ = fit_even_breaks(moved)
        curve = solution.spline
        passed = curve(samples.t) - np.stack([curve(t)[:, k] for k, t in enumerate(ticks.T)], axis=1)
        before, moved = moved, replace(moved, q=samples.q + passed)
        if (np.abs(moved.q - before.q).max(axis=0) < MOVING_TOLERANCE * np.sqrt(solution.energy / len(ticks))).all():
            break
    return moved
