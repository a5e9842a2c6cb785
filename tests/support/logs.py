"""Logs of measured motions whose truth is known: noise, encoders, stamps and gaps as robots' logs have them."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BPoly

Truth = Callable[..., np.ndarray]  # (t, order) -> (..., 7)
JOINTS = 7


@dataclass(frozen=True)
class Log:
    t: np.ndarray
    q: np.ndarray
    truth: Truth


def harmonics(rng, base=0.1, amplitude=0.6, orders=5) -> Truth:
    k = 2 * np.pi * base * np.arange(1, orders + 1)[:, None]
    sine, cosine = (amplitude * rng.normal(size=(orders, JOINTS)) / np.arange(1, orders + 1)[:, None] for _ in "sc")
    middle = rng.uniform(-0.5, 0.5, JOINTS)

    def truth(t, order=0):
        phase = k * np.asarray(t)[..., None, None] + order * np.pi / 2
        return (k**order * (sine * np.sin(phase) + cosine * np.cos(phase))).sum(axis=-2) + (order == 0) * middle

    return truth


def moves(rng, rest=1.0, seconds=1.5, number=4) -> tuple[Truth, float]:
    """From rest to rest, C^5."""
    t, points = [0.0], [rng.uniform(-0.5, 0.5, JOINTS)]
    for _ in range(number):
        t += [t[-1] + rest, t[-1] + rest + seconds * rng.uniform(0.7, 1.3)]
        points += [points[-1], points[-1] + rng.uniform(-1, 1, JOINTS)]
    t, points = [*t, t[-1] + rest], [*points, points[-1]]
    curve = BPoly.from_derivatives(t, [[point, *np.zeros((5, JOINTS))] for point in points])
    return lambda s, order=0: curve(s, nu=order), t[-1]


def blended_harmonics(rng, seconds=0.5) -> Truth:
    """From rest into harmonics."""
    after = harmonics(rng)
    start = [after(0.0) - 0.02 * rng.normal(size=JOINTS), *np.zeros((5, JOINTS))]
    before = BPoly.from_derivatives([0, seconds], [start, [after(seconds, k) for k in range(6)]])

    def truth(t, order=0):
        early = (np.asarray(t) < seconds)[..., None]
        return np.where(early, before(np.minimum(t, seconds), nu=order), after(t, order))

    return truth


def encoder(q, bits):
    step = 2 * np.pi / 2**bits
    return step * np.round(q / step)


def without_gaps(t, *gaps):
    return t[~np.any([(t > start) & (t < end) for start, end in gaps], axis=0)]


def log(name: str) -> Log:
    rng = np.random.default_rng(sum(map(ord, name)))
    noise = lambda sigma, t: sigma * rng.normal(size=(len(t), JOINTS))  # noqa: E731
    truth = harmonics(rng)
    match name:
        case "17 bits, six digits":
            t = np.arange(10001) / 1000
            q = np.round(encoder(truth(t), 17), 6)
        case "12 bits":
            t = np.arange(8001) / 1000
            q = encoder(truth(t), 12)
        case "20 bits at 4 kHz":
            t = np.arange(24001) / 4000
            q = encoder(truth(t), 20)
        case "16 bits, uneven, 100 Hz":
            t = np.sort(np.arange(2001) / 100 + rng.uniform(-0.003, 0.003, 2001))
            q = encoder(truth(t), 16)
        case "noise 1e-4":
            t = np.arange(8001) / 1000
            q = truth(t) + noise(1e-4, t)
        case "noise 1e-6, gaps":
            t = without_gaps(np.arange(6001) / 500, (2, 2.08), (5.3, 5.38), (8.8, 8.88))
            q = truth(t) + noise(1e-6, t)
        case "noise 1e-5, 19 bits, gaps, 2 kHz":
            t = without_gaps(np.arange(16001) / 2000, (1.5, 1.53), (4.1, 4.13), (6, 6.03))
            q = encoder(truth(t) + noise(1e-5, t), 19)
        case "rests, noise 1e-5, uneven, 250 Hz":
            truth, end = moves(rng)
            t = np.arange(int(250 * end)) / 250
            t += rng.uniform(0, 1e-3, len(t))
            q = truth(t) + noise(1e-5, t)
        case "rests, 16 bits":
            truth, end = moves(rng, rest=0.5)
            t = np.arange(int(1000 * end)) / 1000
            q = encoder(truth(t), 16)
        case "blend, 18 bits":
            truth = blended_harmonics(rng)
            t = np.arange(11001) / 1000
            q = encoder(truth(t) + noise(3e-6, t), 18)
        case "stamps":
            at = np.arange(10001) / 1000
            t = np.sort(at + rng.uniform(-5e-4, 5e-4, len(at)))
            q = np.round(truth(at), 6)
            stale = 1 + np.flatnonzero(rng.random(len(t) - 1) < 0.05)
            q[stale] = q[stale - 1]
        case _:
            raise ValueError(name)
    return Log(t, q, truth)


NAMES = (
    "17 bits, six digits",
    "12 bits",
    "20 bits at 4 kHz",
    "16 bits, uneven, 100 Hz",
    "noise 1e-4",
    "noise 1e-6, gaps",
    "noise 1e-5, 19 bits, gaps, 2 kHz",
    "rests, noise 1e-5, uneven, 250 Hz",
    "rests, 16 bits",
    "blend, 18 bits",
    "stamps",
)
