"""Aggregates of motions: rows, times, peaks and root mean squares, gathered chunk by chunk and joined part by part.

Sums are added in the order of the input whatever computes the parts, so that they are the same to the last bit.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from math import inf, isnan
from typing import Any

import numpy as np

from jounce.core.errors import JounceError, quote_value
from jounce.io.columns import Columns
from jounce.io.tables import describe_place
from jounce.limits.samples import find_worst_broken
from jounce.model.coordinates import coordinate_limits
from jounce.model.limits import Limits
from jounce.motion.reliability import BAND_DEVIATIONS, find_surest_peaks
from jounce.spatial.series import rate_name
from jounce.stream.job import MOTION_COLUMN, InputPart, Job
from jounce.stream.outputs import OutputBlock

Aggregate = dict[str, Any]  # plain data of a motion: rows, t, and values by joint and quantity
Add = Callable[[dict[str, Aggregate], str, Aggregate], None]  # joins that of further rows to that of a motion


def tally(block: OutputBlock, rows: slice, limits: Limits | None) -> Aggregate:
    """The aggregate of rows of one motion; of q and its rates none is wanted.

    Of each quantity of a joint or motor there are the largest absolute value, its deviation, and the sum of squares.
    `broken` is the limit that is broken most at the rows, if one is and there are `limits`.
    """
    t, values = block.t[rows], dict[str, dict[str, list[float]]]()
    outputs = [output for output in block.outputs if output.symbol != "q"]
    for output in outputs:
        for k, rate in enumerate(output.rates):
            x, off = np.asfortranarray(rate[rows]), None if output.deviations is None else output.deviations[k][rows]
            found = np.array([*_peaks(x, off), np.einsum("ij,ij->j", x, x)]).T.tolist()
            for name, of in zip(output.names, found, strict=True):
                values.setdefault(name, {})[rate_name(output.symbol, k)] = of
    forces = tuple(rate[rows] for rate in outputs[0].rates)
    worst = limits and find_worst_broken(limits, t, tuple(rate[rows] for rate in block.states), forces)
    known = {"rows": len(t), "t": [float(t[0]), float(t[-1])], "values": values, "broken": list(worst or ())}
    return {**block.about, **known}


def reported_limits(job: Job) -> Limits | None:
    """The limits that a run reports if they are broken: those of coordinates, of runs that compute forces."""
    return coordinate_limits(job.robot.mechanism) if job.subject == "forces" else None


def _peaks(x: np.ndarray, deviations: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
    """The absolute values (N, n) that are largest less their bands, and their deviations; no NaN."""
    largest = np.maximum(x.max(axis=0), -x.min(axis=0))
    if deviations is None and not np.isnan(largest).any():
        return largest, np.zeros_like(largest)
    return find_surest_peaks(x, np.zeros_like(x) if deviations is None else deviations)


def add(tallies: dict[str, Aggregate], motion: str, more: Aggregate) -> None:
    """Join an aggregate of further rows to that of a motion."""
    if motion not in tallies:
        tallies[motion] = more
        return
    known = tallies[motion]
    if more["t"][0] <= known["t"][1]:
        raise order_error(motion, known, more)
    known["rows"] += more["rows"]
    known["t"] = [known["t"][0], more["t"][1]]
    known["broken"] = max(known["broken"], more["broken"])
    for joint, values in more["values"].items():
        for name, (peak, off, squares) in values.items():
            of = known["values"][joint][name]
            known["values"][joint][name] = [*surest_peak([of[:2], [peak, off]]), of[2] + squares]


def surest_peak(peaks: Iterable[Sequence[float]]) -> Sequence[float]:
    """The first of the peaks with their deviations that are largest less their bands; NaN if all are."""
    return max(peaks, key=lambda peak: -inf if isnan(peak[0]) else peak[0] - BAND_DEVIATIONS * peak[1])


def join_tallies(parts: Iterable[tuple[InputPart, Mapping[str, Aggregate]]], add: Add = add) -> dict[str, Aggregate]:
    """The aggregates of all parts, in the order in which motions come first."""
    tallies: dict[str, Aggregate] = {}
    for part, found in parts:
        try:
            for motion, more in found.items():
                add(tallies, motion, more)
        except JounceError as error:
            raise JounceError(f"{describe_place(part.path, part.span.start)}: {error}") from None
    return tallies


def order_error(motion: str, known: Aggregate, more: Aggregate) -> JounceError:
    """The error where a motion goes on at a time that it has passed already."""
    return JounceError(
        f"motion {quote_value(motion)} goes on at t = {more['t'][0]:.17g}, and its rows before end at"
        f" t = {known['t'][1]:.17g}; expected increasing times: sort the rows of each motion, and give motions names of"
        " their own"
    )


def reduce_aggregates(tallies: Mapping[str, Aggregate], kinds: Sequence[str]) -> Columns:
    """A table of aggregates with a row per motion and joint: columns ``Q_peak, Qd_peak, ..., Q_rms, ...``."""
    rows = [
        (motion, joint, of["rows"], values) for motion, of in tallies.items() for joint, values in of["values"].items()
    ]
    columns = dict(zip([MOTION_COLUMN, "joint", "rows"], map(np.array, list(zip(*rows, strict=True))[:3]), strict=True))
    for kind in kinds:
        for name in dict.fromkeys(name for *_, values in rows for name in values):
            columns[f"{name}_{kind}"] = np.array(
                [AGGREGATES[kind](values.get(name, NO_PEAK), n) for *_, n, values in rows]
            )
    return columns


NO_PEAK = (np.nan, 0.0, np.nan)
AGGREGATES: Mapping[str, Callable[[Sequence[float], int], float]] = {
    "peak": lambda found, rows: found[0],
    "rms": lambda found, rows: float(np.sqrt(found[2] / rows)),
}
