"""Check the logs of an identification: motions, forces, weights of samples.

`check_logs` takes one log or several with what is measured along them, and makes a `MeasuredLog` of each: a name, a
motion of the joints of the robot in its order, and its `Measurements`. `check_measurements` is its step for one log:
forces of a caller or of the motion's own table, their times, and how much each sample counts, by weights or deviations.
A force that is not measured is 0 and has the weight 0. Samples of several logs count by the time between them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np

from jounce.arguments.names import array_by_name
from jounce.core import cures, errors, scalars
from jounce.core.cures import Remedy
from jounce.core.errors import JounceError, join_names, quote_value
from jounce.core.typing import ArrayLike
from jounce.engine import along
from jounce.model import coordinates
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
Logs = Motion | Sequence[Motion] | Mapping[str, Motion]  # one log, or several with their names


@dataclass(frozen=True, eq=False)
class Measurements:
    """Forces measured along a motion."""

    t: np.ndarray  # (N,) times within the motion, s, increasing
    forces: np.ndarray  # (N, nv) 0 for those not measured
    weights: np.ndarray  # (N, nv) relative inverse variances; 0 where a force is not measured or does not count

    def part(self, rows: np.ndarray) -> "Measurements":
        """Return some of the samples."""
        return Measurements(self.t[rows], self.forces[rows], self.weights[rows])


@dataclass(frozen=True, eq=False)
class MeasuredLog:
    """A log: a motion, and the forces measured along it."""

    name: str  # "" of the only log
    motion: Motion  # of the joints of the robot, in its order
    measurements: Measurements
    used: np.ndarray  # (N,) which samples are fitted, or read of a log that only tests
    tests: bool = False  # whether the log only tests

    @property
    def samples(self) -> Measurements:
        """The samples that are used."""
        return self.measurements.part(self.used)

    def earlier(self, delay: float) -> "MeasuredLog":
        """Return the log with forces at times earlier by a delay, s.

        Those outside of the motion are left out.
        """
        t = self.measurements.t - delay
        inside = (t >= self.motion.start) & (t <= self.motion.stop)
        return replace(self, measurements=replace(self.measurements, t=t).part(inside), used=self.used[inside])


def check_logs(
    mechanism: Mechanism,
    logs: Logs,
    measured: Mapping[str, Any],
    span: tuple[float, float] | None,
    test: int | str | Sequence[int | str],
) -> list[MeasuredLog]:
    """Check the logs of a caller, with what is measured along them.

    `measured` holds forces, t, weights, deviations: each for all logs, or as a list by log.
    """
    # Logs by their names, or by their places in a list.
    alone = not isinstance(logs, Mapping | list | tuple)
    motions: dict[Any, Any] = dict(logs) if isinstance(logs, Mapping) else dict(enumerate(errors.as_list(logs)))
    if len(motions) == 0:
        raise JounceError(f"motion is {quote_value(logs)}; expected a log, or several")
    # Some of them may only test, but not all.
    tests = errors.as_list(test)
    for name in tests:
        if isinstance(name, bool) or not isinstance(name, int | str | np.integer) or name not in motions:
            raise errors.unknown_name_error(f"log of {cures.option_name('test')}", name, map(str, motions))
    if len(set(tests)) == len(motions):
        raise JounceError(f"{cures.option_value('test', test)} names every log; expected one or more to be used")
    # What is measured, by log: deviations are known of all logs or of none, as logs share the variances of a fit.
    by_log = {label: [values] if alone else _list_by_log(label, values, len(motions))
              for label, values in measured.items()}  # fmt: skip
    if any(values is None for values in by_log["deviations"]) and measured["deviations"] is not None:
        raise JounceError("deviations has None for a log; expected those of all logs, or deviations=None")
    checked = []
    for k, (key, motion) in enumerate(motions.items()):
        name = "" if alone else _log_name(key)
        with errors.locate_errors(name):
            path = along.check_motion(mechanism, motion)
            samples = check_measurements(mechanism, path, **{label: values[k] for label, values in by_log.items()})
            checked.append(MeasuredLog(name, path, samples, _select_samples(span, samples.t), key in tests))
    if alone or measured["deviations"] is not None:
        return checked
    return _weigh_by_time(checked)


def _log_name(key: object) -> str:
    return key if isinstance(key, str) else f"motion[{key}]"


def _weigh_by_time(logs: Sequence[MeasuredLog]) -> list[MeasuredLog]:
    """Weigh samples of logs by the time between them.

    Errors that matter are slower than samples of any rate: a log sampled twice as fast knows no more.
    """
    steps = [median_step(log.measurements.t) / median_step(logs[0].measurements.t) for log in logs]
    weights = [log.measurements.weights * step for log, step in zip(logs, steps, strict=True)]
    return [
        replace(log, measurements=replace(log.measurements, weights=w)) for log, w in zip(logs, weights, strict=True)
    ]


def _list_by_log(label: str, values: Any, count: int) -> list[Any]:
    """Return values by log: a list has one entry per log, anything else is for all."""
    if not isinstance(values, list | tuple):
        return [values] * count
    if len(values) != count:
        raise JounceError(f"{label} has {len(values)} entries; expected {count}: one per log, or an array for all logs")
    return list(values)


def _select_samples(span: tuple[float, float] | None, t: np.ndarray) -> np.ndarray:
    """Return which times (N,) are within a span."""
    if span is None:
        return np.ones(len(t), dtype=bool)
    times = np.asarray(scalars.asarray(span, "span"))
    if times.shape != (2,) or times.dtype.kind != "f":
        raise JounceError(f"span is {quote_value(span)}; expected two times in s")
    first, last = times
    inside = (t >= first) & (t <= last)
    if not inside.any():
        raise JounceError(
            f"span is {quote_value(span)}; expected times from {t[0]:.6g} to {t[-1]:.6g} s, which forces have"
        )
    return inside


def twin_notes(logs: Sequence[MeasuredLog]) -> list[str]:
    """Name logs that hold the same forces, sample by sample: no two measured ones do."""
    return [
        f"{join_names([a.name, b.name])} hold the same forces: a log that counts twice makes deviations too small, and"
        " tests nothing; leave one of them out"
        for a, b in combinations(logs, 2)
        if np.array_equal(a.measurements.forces, b.measurements.forces) and a.measurements.forces.any()
    ]


# One log: its forces, their times and weights.
def check_measurements(
    mechanism: Mechanism,
    motion: Motion,
    forces: ArrayLike | None,
    t: ArrayLike | None,
    weights: ArrayLike | None,
    deviations: ArrayLike | None,
) -> Measurements:
    """Check the forces of a caller, or those of the motion: (N, nv) at times (N,)."""
    # Forces and times: of the motion's table, or stated; times of stated forces are the motion's by default.
    names = coordinates.force_names(mechanism)
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
    # How much each force counts: weight over squared deviation, (N, nv).
    factors = np.broadcast_to(_factors("weights", weights, times.size, names), values.shape)
    if deviations is not None:
        factors = factors / _factors("deviations", deviations, times.size, names) ** 2
    # Samples within the motion of which a force counts; forces that do not count are 0 with the weight 0.
    counts = np.isfinite(values) & (factors > 0)
    inside = (times >= motion.start) & (times <= motion.stop) & counts.any(axis=1)
    if not inside.any():
        span = f"from {motion.start:.6g} to {motion.stop:.6g} s"
        raise JounceError(f"{NO_FORCES} {span} that count; {NO_FORCES_CURE}")
    counts = counts[inside]
    return Measurements(times[inside], np.where(counts, values[inside], 0.0), np.where(counts, factors[inside], 0.0))


def _motion_forces(mechanism: Mechanism, motion: Motion) -> tuple[np.ndarray, np.ndarray]:
    """Return the times and forces of the motion's table.

    Forces on a base that floats are not measured.
    """
    if motion.torques is None:
        raise JounceError(f"{NO_FORCES}; {NO_FORCES_CURE}")
    times, torques = motion.torques
    base = np.full((len(times), mechanism.nv - mechanism.n), np.nan)
    return times, np.concatenate([base, torques], axis=1)


def _factors(label: str, values: ArrayLike | None, count: int, names: Sequence[str]) -> np.ndarray:
    """Check weights or standard deviations: for all forces, per force, or per sample too."""
    if values is None:
        return np.ones(())
    factors, shape = _check_numbers(array_by_name(values, names, label), label), (count, len(names))
    if factors.shape not in ((), shape[1:], shape):
        expected = f"a number, {shape[1:]}, one per force, or {shape}"
        raise JounceError(f"{label} have shape {factors.shape}; expected {expected}")
    least, meaning = FACTOR_BOUNDS[label]
    wrong = ~(np.isfinite(factors) & (factors >= least))
    if wrong.any():
        raise JounceError(f"{label} hold {factors[wrong].flat[0]:g}; expected {meaning}")
    return factors


def _check_numbers(values: ArrayLike, label: str) -> np.ndarray:
    numbers = np.asarray(scalars.asarray(values, label))
    if numbers.dtype.kind != "f" or numbers.size == 0:
        raise JounceError(f"{label} is {quote_value(values)}; expected an array of numbers")
    return numbers


def median_step(t: np.ndarray) -> float:
    """Return the usual step between increasing times (N,), s."""
    return float(np.median(np.diff(t))) if len(t) > 1 else 1.0
