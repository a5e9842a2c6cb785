"""The logs of an identification: of each its name, its motion, its measured forces, and which samples are used."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np

from jounce.core.cures import option_name, option_value
from jounce.core.errors import JounceError, as_list, join_names, locate_errors, quote_value, unknown_name_error
from jounce.core.scalars import asarray
from jounce.engine.along import check_motion
from jounce.identification.averaging import median_step
from jounce.identification.measurements import Measurements, check_measurements
from jounce.model.mechanism import Mechanism
from jounce.motion.motion import Motion

Logs = Motion | Sequence[Motion] | Mapping[str, Motion]  # one log, or several with their names


@dataclass(frozen=True, eq=False)
class MeasuredLog:
    """A log: a motion, and the forces measured along it."""

    name: str  # "" of the only one
    motion: Motion  # of the joints of the robot, in its order
    given: Measurements
    used: np.ndarray  # (N,) which samples are fitted, or read of a log that only tests
    tests: bool = False  # whether the log only tests

    @property
    def samples(self) -> Measurements:
        """The samples that are used."""
        return self.given.part(self.used)

    def earlier(self, delay: float) -> "MeasuredLog":
        """The log with forces at times that are earlier by a delay in s, as far as these are within the motion."""
        t = self.given.t - delay
        inside = (t >= self.motion.start) & (t <= self.motion.stop)
        return replace(self, given=replace(self.given, t=t).part(inside), used=self.used[inside])


def check_logs(
    mechanism: Mechanism,
    logs: Logs,
    measured: Mapping[str, Any],
    span: tuple[float, float] | None,
    test: int | str | Sequence[int | str],
) -> list[MeasuredLog]:
    """The logs of a caller, checked, with what is `measured`: forces, t, weights, deviations; one or lists by log."""
    alone = not isinstance(logs, Mapping | list | tuple)
    motions: dict[Any, Any] = dict(logs) if isinstance(logs, Mapping) else dict(enumerate(as_list(logs)))
    if not motions:
        raise JounceError(f"motion is {quote_value(logs)}; expected a log, or several")
    tests = as_list(test)
    for name in tests:
        if isinstance(name, bool) or not isinstance(name, int | str | np.integer) or name not in motions:
            raise unknown_name_error(f"log of {option_name('test')}", name, map(str, motions))
    if len(set(tests)) == len(motions):
        raise JounceError(f"{option_value('test', test)} names every log; expected one or more to be used")
    given = {label: [x] if alone else _spread(label, x, len(motions)) for label, x in measured.items()}
    if any(x is None for x in given["deviations"]) and measured["deviations"] is not None:
        raise JounceError("deviations has None for a log; expected those of all logs, or deviations=None")
    found = []
    for k, (key, motion) in enumerate(motions.items()):
        name = "" if alone else key if isinstance(key, str) else f"motion[{key}]"
        with locate_errors(name):
            path = check_motion(mechanism, motion)
            samples = check_measurements(mechanism, path, **{label: x[k] for label, x in given.items()})
            found.append(MeasuredLog(name, path, samples, _select_samples(span, samples.t), key in tests))
    return found if alone or measured["deviations"] is not None else _weigh_by_time(found)


def _weigh_by_time(logs: Sequence[MeasuredLog]) -> list[MeasuredLog]:
    """Logs whose samples count by the time between them: errors that matter are slower than samples of any rate."""
    steps = [median_step(of.given.t) / median_step(logs[0].given.t) for of in logs]
    weights = [of.given.weights * step for of, step in zip(logs, steps, strict=True)]
    return [replace(of, given=replace(of.given, weights=w)) for of, w in zip(logs, weights, strict=True)]


def _spread(label: str, given: Any, count: int) -> list[Any]:
    """What is given for each log: a list has one entry per log, anything else is for all of them."""
    if not isinstance(given, list | tuple):
        return [given] * count
    if len(given) != count:
        raise JounceError(f"{label} has {len(given)} entries; expected {count}: one per log, or an array for all logs")
    return list(given)


def _select_samples(span: tuple[float, float] | None, t: np.ndarray) -> np.ndarray:
    if span is None:
        return np.ones(len(t), dtype=bool)
    times = np.asarray(asarray(span, "span"))
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
    """What is said of logs that hold the same forces, sample by sample: no two measured ones do."""
    return [
        f"{join_names([a.name, b.name])} hold the same forces: a log that counts twice makes deviations too small, and"
        " tests nothing; leave one of them out"
        for a, b in combinations(logs, 2)
        if np.array_equal(a.given.forces, b.given.forces) and a.given.forces.any()
    ]
