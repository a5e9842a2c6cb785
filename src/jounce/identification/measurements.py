"""Measured forces along a motion: which samples count, and how much."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from jounce.arguments.names import array_by_name
from jounce.core.cures import Remedy
from jounce.core.errors import JounceError, quote_value
from jounce.core.scalars import asarray
from jounce.core.typing import ArrayLike
from jounce.model.coordinates import force_names
from jounce.model.mechanism import Mechanism
from jounce.motion.motion import Motion

NO_FORCES = "the motion has no measured forces"
NO_FORCES_CURE = Remedy(
    "expected columns such as tau_JOINT in its table, named by torques='tau{number}', or an array (N, n) of forces",
    "expected columns such as tau_JOINT in its table, named by --torques 'tau{number}'",
)

FACTOR_BOUNDS = {  # the least number that a caller may give, and what it means
    "weights": (0.0, "factors of inverse variances: 0, which leaves a force out, or more"),
    "deviations": (1e-100, "standard deviations above 0, N m or N"),  # of which the squares are not 0
}


@dataclass(frozen=True, eq=False)
class Measurements:
    """Forces measured along a motion."""

    t: np.ndarray  # (N,) times within the motion, s, increasing
    forces: np.ndarray  # (N, nv) 0 for those not measured
    weights: np.ndarray  # (N, nv) relative inverse variances; 0 where a force is not measured or does not count

    def part(self, rows: np.ndarray) -> "Measurements":
        """Some of the samples."""
        return Measurements(self.t[rows], self.forces[rows], self.weights[rows])


def check_measurements(
    mechanism: Mechanism,
    motion: Motion,
    forces: ArrayLike | None,
    t: ArrayLike | None,
    weights: ArrayLike | None,
    deviations: ArrayLike | None,
) -> Measurements:
    """The measurements of a caller, checked: forces (N, nv) at times (N,), those of the motion by default."""
    names = force_names(mechanism)
    if forces is None:
        if t is not None:
            raise JounceError("t is for forces that are given too; leave it out, or give forces=")
        times, values = _motion_forces(mechanism, motion)
    else:
        values = _check_numbers(array_by_name(forces, names, "forces"), "forces")
        times = motion.times if t is None else motion.checked(_check_numbers(t, "t"))
    if times.ndim != 1 or values.shape != (len(times), len(names)):
        whose = "times of the motion" if t is None else "times t"
        raise JounceError(f"forces have shape {values.shape}; expected {(times.size, len(names))}: {whose}, forces")
    if np.isinf(values).any():
        raise JounceError(f"forces hold {values[np.isinf(values)][0]:g}; expected numbers, NaN for those not measured")
    if not np.isfinite(times).all() or (np.diff(times) <= 0).any():
        raise JounceError("t does not increase from sample to sample; expected increasing times in s")
    factors = np.broadcast_to(_factors("weights", weights, times.size, names), values.shape)
    if deviations is not None:
        factors = factors / _factors("deviations", deviations, times.size, names) ** 2
    there = np.isfinite(values) & (factors > 0)
    inside = (times >= motion.start) & (times <= motion.stop) & there.any(axis=1)
    if not inside.any():
        span = f"from {motion.start:.6g} to {motion.stop:.6g} s"
        raise JounceError(f"{NO_FORCES} {span} that count; {NO_FORCES_CURE}")
    there = there[inside]
    return Measurements(times[inside], np.where(there, values[inside], 0.0), np.where(there, factors[inside], 0.0))


def _motion_forces(mechanism: Mechanism, motion: Motion) -> tuple[np.ndarray, np.ndarray]:
    """The times and forces that the table of the motion states; those on a base that floats are not measured."""
    if motion.torques is None:
        raise JounceError(f"{NO_FORCES}; {NO_FORCES_CURE}")
    times, torques = motion.torques
    base = np.full((len(times), mechanism.nv - mechanism.n), np.nan)
    return times, np.concatenate([base, torques], axis=1)


def _factors(label: str, given: ArrayLike | None, count: int, names: Sequence[str]) -> np.ndarray:
    """Weights, which may be 0, or standard deviations, of all forces alike, per force, or per sample and force."""
    if given is None:
        return np.ones(())
    found, shape = _check_numbers(array_by_name(given, names, label), label), (count, len(names))
    if found.shape not in ((), shape[1:], shape):
        expected = f"a number, {shape[1:]}, one per force, or {shape}"
        raise JounceError(f"{label} have shape {found.shape}; expected {expected}")
    least, meaning = FACTOR_BOUNDS[label]
    if (wrong := ~(np.isfinite(found) & (found >= least))).any():
        raise JounceError(f"{label} hold {found[wrong].flat[0]:g}; expected {meaning}")
    return found


def _check_numbers(given: ArrayLike, label: str) -> np.ndarray:
    found = np.asarray(asarray(given, label))
    if found.dtype.kind != "f" or not np.size(found):
        raise JounceError(f"{label} is {quote_value(given)}; expected an array of numbers")
    return found
