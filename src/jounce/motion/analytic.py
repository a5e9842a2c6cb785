"""Motions in closed form: sums of cosines and polynomials, whose rates of every order are exact."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import Polynomial

from jounce.arguments import names
from jounce.errors import JounceError, listed, quoted
from jounce.model.mechanism import Mechanism
from jounce.motion.states import COMPONENTS, Motion


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
class Curve:
    """A coordinate over time: a polynomial in t, lowest power first, and cosines."""

    polynomial: tuple[float, ...] = (0.0,)
    cosines: tuple[Cosine, ...] = ()

    def rate(self, t: np.ndarray, k: int) -> np.ndarray:
        """The k-th time derivative at the times t."""
        power = Polynomial(self.polynomial)
        total = (power.deriv(k) if k else power)(t) + 0 * t
        return sum((cosine.rate(t, k) for cosine in self.cosines), start=total)


@dataclass(frozen=True)
class Terms:
    """A motion in closed form: curves by joint, by body and component of its wrench, and the times to look at."""

    joints: Mapping[str, Curve]
    wrenches: Mapping[str, Mapping[str, Curve]]
    t: np.ndarray


def along(terms: Terms, mechanism: Mechanism, highest: int) -> Motion:
    """The motion that terms describe, with rates up to the one of order `highest`."""
    joints, curves = mechanism.coordinates, terms.joints
    names.check(curves, joints, names.followers(mechanism), f"terms for each of {listed(joints)}")
    for body in terms.wrenches:
        mechanism.frame(body)
    rates = (
        np.stack([_finite(curves[joint], terms.t, k, f"joint {quoted(joint)}") for joint in joints], axis=1)
        for k in range(highest + 1)
    )
    wrench = tuple(
        {body: _wrench(body, components, terms.t, k) for body, components in terms.wrenches.items()}
        for k in range(max(highest - 2, 0) + 1)
    )
    source = "analytic terms, all rates exact"
    return Motion(terms.t, tuple(rates), joints, source, wrench if terms.wrenches else None)


def _wrench(body: str, components: Mapping[str, Curve], t: np.ndarray, k: int) -> np.ndarray:
    """The k-th rate of a wrench (mx, my, mz, fx, fy, fz); components left out are zero."""
    named = ((components.get(name, Curve()), f"{name} of the wrench of {quoted(body)}") for name in COMPONENTS)
    return np.stack([_finite(curve, t, k, what) for curve, what in named], axis=1)


@np.errstate(over="ignore", invalid="ignore")  # refused in words
def _finite(curve: Curve, t: np.ndarray, k: int, what: str) -> np.ndarray:
    rate = curve.rate(t, k)
    if not np.isfinite(rate).all():
        raise JounceError(f"the terms of {what} overflow; expected a finite time derivative of order {k}")
    return rate
