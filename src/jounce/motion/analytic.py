"""Curves in closed form: sums of cosines and polynomials, whose rates of every order are exact."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import Polynomial

from jounce.arguments import names
from jounce.errors import JounceError, listed
from jounce.model.mechanism import Mechanism
from jounce.motion.base import COLUMNS
from jounce.motion.curves import COMPONENTS, Jump
from jounce.motion.motion import Motion


@dataclass(frozen=True)
class Cosine:
    """amplitude * cos(frequency * t + phase): rad or m, rad/s, rad."""

    amplitude: float
    frequency: float
    phase: float

    def rate(self, t: np.ndarray, k: int) -> np.ndarray:
        """The k-th time derivative; whole quarter turns exchange cosine and sine, so that no phase is rounded."""
        angle = self.frequency * t + self.phase
        turned = np.cos(angle) if k % 2 == 0 else np.sin(angle)
        return (1, -1, -1, 1)[k % 4] * self.amplitude * np.float64(self.frequency) ** k * turned


@dataclass(frozen=True)
class Terms:
    """A coordinate over time: a polynomial in t, lowest power first, and cosines."""

    polynomial: tuple[float, ...] = (0.0,)
    cosines: tuple[Cosine, ...] = ()

    def rate(self, t: np.ndarray, k: int) -> np.ndarray:
        """The k-th time derivative at the times t."""
        power = Polynomial(self.polynomial)
        total = (power.deriv(k) if k else power)(t) + 0 * t
        return sum((cosine.rate(t, k) for cosine in self.cosines), start=total)


@dataclass(frozen=True)
class Analytic:
    """Coordinates in closed form from one time to another."""

    terms: tuple[Terms, ...]
    start: float
    stop: float

    @property
    def columns(self) -> int:
        """The number of coordinates."""
        return len(self.terms)

    @property
    def highest(self) -> None:
        """None: derivatives of every order are known."""

    @np.errstate(over="ignore", invalid="ignore")  # whoever asks refuses what is not finite
    def rates(self, t: np.ndarray, order: int, left: bool = False) -> list[np.ndarray]:
        """The values and their derivatives up to `order`."""
        return [np.stack([terms.rate(t, k) for terms in self.terms], axis=1) for k in range(order + 1)]

    def jumps(self, order: int) -> list[Jump]:
        """None: sums of cosines and polynomials are smooth."""
        return []

    def deviations(self, t: np.ndarray, order: int) -> None:
        """None: the curve is exact."""


@dataclass(frozen=True)
class Description:
    """A motion in closed form as a file states it: terms by joint, by body and component of its wrench, and times.

    `base` are the terms of position and quaternion of the base, None if it has none.
    """

    joints: Mapping[str, Terms]
    wrenches: Mapping[str, Mapping[str, Terms]]
    t: np.ndarray
    base: Mapping[str, Terms] | None = None


def motion_of(description: Description, mechanism: Mechanism) -> Motion:
    """The motion that terms describe; components of wrenches and the base that they leave out are zero, qw one."""
    joints, t = mechanism.coordinates, description.t
    names.check(description.joints, joints, names.followers(mechanism), f"terms for each of {listed(joints)}")
    for body in description.wrenches:
        mechanism.frame(body)
    ends = float(t[0]), float(t[-1])
    loads = {
        body: Analytic(tuple(components.get(name, Terms()) for name in COMPONENTS), *ends)
        for body, components in description.wrenches.items()
    }
    q = Analytic(tuple(description.joints[joint] for joint in joints), *ends)
    if mechanism.base and description.base is None:
        raise JounceError(
            f"{mechanism.name!r} floats, and nothing says where its base is; expected base: with terms of some of"
            f" {listed(COLUMNS)}, position in m and quaternion"
        )
    base = None
    if description.base is not None:
        others = {"qw": Terms((1.0,))} if not {*COLUMNS[3:]} & {*description.base} else {}
        base = Analytic(tuple(description.base.get(name, others.get(name, Terms())) for name in COLUMNS), *ends)
    return Motion(q, joints, "analytic terms, all rates exact", loads, grid=t, base_curve=base)
