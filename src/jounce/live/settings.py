"""Check the settings of a live estimator, and derive others from them."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from jounce.arguments.names import array_by_name
from jounce.core import cures, scalars
from jounce.core.cures import WITHOUT_TRANSMISSIONS
from jounce.core.errors import JounceError, quote_value
from jounce.model import coordinates, positions
from jounce.model.mechanism import Mechanism
from jounce.motion import units
from jounce.motion.wraps import without_turns

BANK = 1.5 ** np.arange(9)  # Hz, from 1 to 25.6: a bandwidth within 25 % of the best is nearly as good
RATE_COUNT = 5  # q to q4d
STATES = range(RATE_COUNT, 9)
MAX_LAG = 1.0  # s, which the kept states span
KEPT_STATES = 20  # within the lag: Taylor's series from the nearest one is exact to far below its deviation
MIN_JUMP_TIME = 0.01  # s, in which samples without stamps may be lost, and coarse encoders pass a step
MAX_GAP_ANGLE = 15.0  # rad of the highest bandwidth without a sample, after which nothing is known of the motion
MAX_CYCLE_SHARE = 0.25  # of a cycle of the bandwidth, per sample


@dataclass(frozen=True, eq=False)
class Settings:
    """The settings of a live estimator.

    `omega` are its bandwidths, rad/s, `sigma` the noise (n,), NaN if unknown.
    """

    mechanism: Mechanism
    dt: float
    omega: np.ndarray
    lag: float
    states: int
    sigma: np.ndarray

    @cached_property
    def scaled_dt(self) -> np.ndarray:
        """The spacing of samples in the scaled time of each filter (B,)."""
        return self.omega * self.dt

    @cached_property
    def rate_scales(self) -> np.ndarray:
        """The factors from scaled rates of each filter to rates per s: (B, 5)."""
        return np.asarray(self.omega[:, None] ** np.arange(RATE_COUNT))

    @cached_property
    def turns(self) -> np.ndarray:
        """A mask (n,) of the revolute joints: their encoders may wrap."""
        return np.array([unit == "rad" for unit in coordinates.units(self.mechanism)])

    @cached_property
    def fastest(self) -> np.ndarray:
        """The speed of each joint (n,) beyond which samples are errors: rad/s or m/s."""
        speed = self.mechanism.limits.velocity[coordinates.leading_joints(self.mechanism)] * units.MAX_SPEED_TO_LIMIT
        return np.where(np.isfinite(speed) & (speed > 0), speed, units.DEFAULT_MAX_SPEED)

    @cached_property
    def finds_noise(self) -> bool:
        """Whether the noise of some joint is found from its samples."""
        return bool(np.isnan(self.sigma).any())

    @cached_property
    def kept(self) -> int:
        """The number of states that are kept."""
        # Without a lag only the present one; else those that span it, one beyond its end among them.
        if self.lag == 0:
            return 1
        return 2 + int(np.ceil(self.lag / self.spacing - 1e-9))

    @cached_property
    def longest_gap(self) -> float:
        """The time without a sample after which nothing is known, s."""
        return MAX_GAP_ANGLE / float(self.omega[-1])

    @cached_property
    def spacing(self) -> float:
        """The spacing of kept states, s."""
        return max(self.dt, self.lag / KEPT_STATES)

    def check_jump(self, y: np.ndarray, now: float, last: np.ndarray, sampled: float) -> np.ndarray:
        """Return by how much joints moved, or raise `JounceError` for a jump.

        Joints may pass the ends of a turn.
        """
        # The longest way at the fastest speed since the last sample.
        change = without_turns(y - last, self.turns)
        most = self.fastest * max(now - sampled, self.dt, MIN_JUMP_TIME)
        if (np.abs(change) > most).any():
            j = int((np.abs(change) - most).argmax())
            came = f"joint {quote_value(self.mechanism.coordinates[j])} jumps from {last[j]:.4g} to {y[j]:.4g}"
            hint = f": {units.IN_DEGREES}" if np.abs(np.deg2rad(y) - last)[self.turns].max(initial=0) < most[j] else ""
            raise JounceError(
                f"{came} at t = {now:.9g} s, more than at {self.fastest[j]:.3g}/s{hint}; leave the row out"
            )
        return change


def check_settings(m: Mechanism, dt: Any, bandwidth: Any, lag: Any, states: Any, noise: Any) -> Settings:
    """Check the settings that a caller gives."""
    if not (m.is_fixed_tree and m.is_numeric):
        raise JounceError(
            f"live() of {m.name!r}; expected a robot on a fixed base without loops, symbols and coupled drives:"
            f" {WITHOUT_TRANSMISSIONS} leaves out those of a file"
        )
    positions.check_single_screws(m, "live()")
    if not scalars.is_finite(dt) or not dt > 0:
        raise JounceError(f"dt is {quote_value(dt)}; expected the spacing of samples in s, above 0")
    if not scalars.is_finite(lag) or not 0 <= lag <= MAX_LAG:
        raise JounceError(f"lag is {quote_value(lag)}; expected 0 to {MAX_LAG:g} s, which is what the buffer holds")
    if isinstance(states, bool) or not isinstance(states, int | np.integer) or states not in STATES:
        raise JounceError(f"states is {quote_value(states)}; expected {STATES[0]} to {STATES[-1]}")
    # A bank of bandwidths up to the one that samples resolve, or a single one.
    highest = MAX_CYCLE_SHARE / float(dt)
    if bandwidth is None:
        f = BANK[highest >= BANK]
    elif scalars.is_finite(bandwidth):
        f = np.array([float(bandwidth)])
    else:
        raise JounceError(f"bandwidth is {quote_value(bandwidth)}; expected Hz, or None for a bank of bandwidths")
    if len(f) == 0 or not 0 < f[0] <= highest:
        came = f"bandwidth {f[0]:g} Hz" if len(f) > 0 else f"the bank from {BANK[0]:g} Hz on"
        raise JounceError(
            f"{came} does not fit samples every {float(dt):g} s;"
            f" expected {cures.option_name('bandwidth')} above 0 to {highest:g} Hz"
        )
    sigma = np.full(m.n, np.nan)
    if noise is not None:
        given = array_by_name(noise, m.coordinates, "noise")
        sigma = np.array(
            np.broadcast_to(given, m.n) if given.ndim == 0 else scalars.array_of_shape(given, (m.n,), "noise")
        )
        if not scalars.is_numeric(sigma) or sigma.ndim != 1 or not (np.isfinite(sigma) & (sigma > 0)).all():
            raise JounceError(f"noise is {quote_value(noise)}; expected standard deviations above 0, rad or m, or None")
    return Settings(m, float(dt), 2 * np.pi * f, float(lag), int(states), sigma)
