"""Samples before they are smoothed: what no smoothing mends, rows that repeat, and stamps that say the wrong time.

A controller's log is stamped when rows are written. Each row then tells the joints' positions at another time than its
stamp says, all of them at the same: one shift per row, estimated from all joints together, explains their scatter.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from jounce.errors import JounceError, quoted

LEAST = 24  # samples
SUBSET = 20000  # rows from which the scatter of stamps is estimated, at most
ROUNDS = 30  # of expectation and maximisation


@dataclass(frozen=True, eq=False)
class Shifts:
    """By how much each row belongs to a later time than its stamp, (N,) in s, the standard deviation of that, and each joint's own noise (n,)."""

    shift: np.ndarray
    sigma: float
    own: np.ndarray


def check(t: object, q: object, names: Sequence[str] | None) -> tuple[np.ndarray, np.ndarray, tuple[str, ...]]:
    """Samples as arrays (N,) and (N, n), and the joints' names; raises `JounceError` where they are none."""
    times, samples = (_numbers(x, label) for x, label in ((t, "t"), (q, "q")))
    samples = samples[:, None] if samples.ndim == 1 else samples
    if times.ndim != 1 or samples.ndim != 2 or len(times) != len(samples):
        raise JounceError(f"t has shape {times.shape} and q {samples.shape}; expected (N,) and (N, n)")
    joints = tuple(names or (f"column {k + 1}" for k in range(samples.shape[1])))
    if len(joints) != samples.shape[1]:
        raise JounceError(f"{len(joints)} names for {samples.shape[1]} columns; expected one per column")
    if not np.isfinite(times).all():
        raise JounceError(f"the time of sample {_first(~np.isfinite(times))} is not a number; remove the row")
    for name, column in zip(joints, samples.T, strict=True):
        if not np.isfinite(column).all():
            where = _first(~np.isfinite(column))
            raise JounceError(f"{name} is {column[where]} at t = {times[where]:g} s; expected numbers: remove such rows")
    kept = np.append(True, (np.diff(times) != 0) | (np.diff(samples, axis=0) != 0).any(axis=1))
    times, samples = times[kept], samples[kept]
    if (np.diff(times) <= 0).any():
        where = _first(np.diff(times) <= 0)
        raise JounceError(
            f"time goes from {times[where]:.9g} to {times[where + 1]:.9g} s at sample {where + 1}; expected increasing"
            " times: sort the rows, or write the time with more digits"
        )
    if len(times) < LEAST:
        raise JounceError(f"{len(times)} samples; smoothing needs at least {LEAST}: give a longer log, or through()")
    return times, samples, joints


def fresh(t: np.ndarray, q: np.ndarray, velocity: np.ndarray, size: np.ndarray) -> np.ndarray:
    """Which rows, (N,), are no mere repetitions of the one before, from which the joints should have moved.

    `size` (n,) is what a joint moves at least, twice, where repetition is no accident: its steps and its noise.
    """
    same = np.append(False, (np.diff(q, axis=0) == 0).all(axis=1))
    moved = (np.abs(velocity) * np.diff(t, prepend=t[0])[:, None] > 2 * size).any(axis=1)
    return ~(same & moved)


def shifts(residual: np.ndarray, velocity: np.ndarray, before: np.ndarray) -> Shifts | None:
    """The shift of each row that explains what a fit leaves, (N, n), where shifts explain more than noise per joint.

    With r = v d + e per row, d ~ N(0, s^2) and e ~ N(0, D) of a diagonal D: factor analysis with known loadings v, by
    expectation and maximisation (Rubin & Thayer, Psychometrika 47, 1982). `before` (N,) is in the times already.
    """
    r = residual + velocity * before[:, None]
    if r.shape[1] < 2:
        return None
    step = len(r) // SUBSET + 1
    some, v = r[::step], velocity[::step]
    own = np.maximum((some**2).mean(axis=0), np.finfo(float).tiny)
    alone = -0.5 * (np.log(own).sum() + len(own))
    own, s2 = own / 2, float((own / np.maximum((v**2).mean(axis=0), np.finfo(float).tiny)).min()) / 2
    for _ in range(ROUNDS):
        shift, spread = _posterior(some, v, own, s2)
        own = ((some - v * shift[:, None]) ** 2 + v**2 * spread[:, None]).mean(axis=0)
        s2 = float((shift**2 + spread).mean())
    shift, spread = _posterior(some, v, own, s2)
    quadratic = ((some**2) / own).sum(axis=1) - shift**2 / spread
    together = -0.5 * (np.log(own).sum() + np.log(s2 / spread) + quadratic).mean()
    if together - alone < 0.05 or len(some) * (together - alone) < 50:
        return None
    return Shifts(_posterior(r, velocity, own, s2)[0], float(np.sqrt(s2)), np.sqrt(own))


def _posterior(r: np.ndarray, v: np.ndarray, own: np.ndarray, s2: float) -> tuple[np.ndarray, np.ndarray]:
    """The mean and the variance (N,) of each row's shift."""
    spread = 1 / (1 / s2 + (v**2 / own).sum(axis=1))
    return spread * (v * r / own).sum(axis=1), spread


def _numbers(given: object, label: str) -> np.ndarray:
    array = np.asarray(given)
    if array.dtype.kind not in "fiu":
        raise JounceError(f"{label} is {quoted(given)}; expected an array of numbers")
    return array.astype(float)


def _first(wrong: np.ndarray) -> int:
    return int(np.argmax(wrong))
