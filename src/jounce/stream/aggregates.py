"""Aggregates of motions: rows, times, peaks and root mean squares, gathered chunk by chunk and joined part by part.

Sums are added in the order of the input whatever computes the parts, so that they are the same to the last bit.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import chain
from math import inf, isnan
from typing import Any

import numpy as np

from jounce.core.errors import JounceError, join_names, quote_value, warn
from jounce.io.columns import Columns
from jounce.io.tables import describe_place
from jounce.limits.joints import joint_limits, limits_of_coordinates
from jounce.limits.samples import find_worst_broken
from jounce.limits.uncertain_spans import DECISIVE_DEVIATIONS
from jounce.model.limit_kinds import MOTION_KINDS
from jounce.model.limits import Limits
from jounce.motion.motion import Motion
from jounce.motion.reliability import BAND_DEVIATIONS, MAX_CERTAIN_SHARE, find_surest_rows
from jounce.spatial.series import rate_name
from jounce.stream.job import MOTION_COLUMN, InputPart, Job
from jounce.stream.outputs import Output, OutputBlock, find_windows

LARGEST, CERTAIN = slice(0, 3), slice(3, 6)  # of the numbers of a quantity: peak, deviation and time
MAX_TALLIED_ROWS = 10_000  # of a motion at a time: a few MB
Aggregate = dict[str, Any]  # plain data of a motion: rows, t, and values by joint and quantity
Add = Callable[[dict[str, Aggregate], str, Aggregate], None]  # joins that of further rows to that of a motion


def tally(block: OutputBlock, rows: slice, limits: Limits | None) -> Aggregate:
    """The aggregate of rows of one motion; of q and its rates none is wanted next to other quantities.

    Of each quantity of a joint or motor there are the largest absolute value, its deviation and time, the same of the
    largest one in its window, and the sum of squares.
    `broken` is the limit that is broken most at the rows, if one is and there are `limits`.
    """
    t, values = block.t[rows], dict[str, dict[str, list[float]]]()
    outputs = [output for output in block.outputs if output.symbol != "q"] or block.outputs
    for output in outputs:
        for k, rate in enumerate(output.rates):
            x, off = np.asfortranarray(rate[rows]), None if output.deviations is None else output.deviations[k][rows]
            largest = certain = _find_largest(t, x, off)
            if output.windows and off is not None:
                start, stop = output.windows[k]
                known = ((start <= t) & (t <= stop))[:, None] | (off <= MAX_CERTAIN_SHARE * np.abs(x))
                certain = _find_largest(t, np.where(known, x, np.nan), off)
            found = np.array([*largest, *certain, np.einsum("ij,ij->j", x, x)]).T.tolist()
            for name, of in zip(output.names, found, strict=True):
                values.setdefault(name, {})[rate_name(output.symbol, k)] = of
    forces = tuple(rate[rows] for rate in outputs[0].rates)
    if outputs[0].deviations is not None:  # what is surely there
        bands = [DECISIVE_DEVIATIONS * spread[rows] for spread in outputs[0].deviations]
        forces = tuple(np.sign(x) * np.maximum(np.abs(x) - s, 0) for x, s in zip(forces, bands, strict=True))
    worst = limits and find_worst_broken(limits, t, tuple(rate[rows] for rate in block.states), forces)
    known = {"rows": len(t), "t": [float(t[0]), float(t[-1])], "values": values, "broken": list(worst or ())}
    return {**block.about, **known}


def tally_motion(motion: Motion, joints: Sequence[str], order: int) -> dict[str, dict[str, list[float]]]:
    """The same numbers of q and its rates along a motion, by joint and rate; none of joints of several numbers."""
    found, windows = dict[str, Aggregate](), find_windows(motion, order)
    for start in range(0, 0 if motion.several else len(motion.times), MAX_TALLIED_ROWS):
        t = motion.times[start : start + MAX_TALLIED_ROWS]
        q = Output("q", joints, motion(t, order), motion.deviations(t, order), windows)
        add(found, "", tally(OutputBlock(t, [q], {}, {}, (), {}), slice(None), None))
    return found[""]["values"] if found else {}


def reported_limits(job: Job) -> Limits | None:
    """The limits that a run reports if they are broken: those of coordinates, of runs that compute forces.

    Limits of forces are of motors: where these are elsewhere, Q says nothing of them, and a warning does.
    """
    if job.subject != "forces":
        return None
    m, limits = job.robot.mechanism, limits_of_coordinates(job.robot.mechanism)
    if of_motors := [kind for kind in joint_limits(m).kinds if kind not in (*limits.kinds, *MOTION_KINDS)]:
        warn(
            f"{m.name!r}: limits of {join_names(of_motors)} are of motors, which Q is not of; jounce check judges them"
        )
    return limits


def _find_largest(t: np.ndarray, x: np.ndarray, deviations: np.ndarray | None) -> tuple[np.ndarray, ...]:
    """The absolute values (N, n) that are largest less their bands, their deviations and times; no NaN."""
    columns, high, low = np.arange(x.shape[1]), x.argmax(axis=0), x.argmin(axis=0)
    at = np.where(x[high, columns] >= -x[low, columns], high, low)
    if deviations is not None or np.isnan(x[at, columns]).any():
        at = find_surest_rows(x, np.zeros_like(x) if deviations is None else deviations)
    return np.abs(x[at, columns]), np.zeros(len(at)) if deviations is None else deviations[at, columns], t[at]


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
        for name, new in values.items():
            old = known["values"][joint][name]
            both = (surest_peak([old[part], new[part]]) for part in (LARGEST, CERTAIN))
            known["values"][joint][name] = [*chain(*both), old[-1] + new[-1]]


def surest_peak(peaks: Iterable[Sequence[float]]) -> Sequence[float]:
    """The first of the peaks, with their deviations, that are largest less their bands; NaN if all are."""
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


NO_PEAK = (np.nan,)
AGGREGATES: Mapping[str, Callable[[Sequence[float], int], float]] = {
    "peak": lambda found, rows: found[0],
    "rms": lambda found, rows: float(np.sqrt(found[-1] / rows)),
}
