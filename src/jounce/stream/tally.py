"""Aggregates of motions: rows, times, peaks and root mean squares, gathered chunk by chunk and joined part by part.

Sums are added in the order of the input whatever computes the parts, so that they are the same to the last bit.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from jounce.core.errors import JounceError, quoted
from jounce.io.columns import Columns
from jounce.io.tables import place
from jounce.motion.bands import surest_peaks
from jounce.spatial.series import rate_name
from jounce.stream.outputs import Block
from jounce.stream.plan import MOTION, Part

Aggregate = dict[str, Any]  # plain data of a motion: rows, t, peaks and squares by quantity and joint
Add = Callable[[dict[str, Aggregate], str, Aggregate], None]  # joins that of further rows to that of a motion


def tally(block: Block, rows: slice) -> Aggregate:
    """The aggregate of rows of one motion; of q and its rates none is wanted."""
    t = block.t[rows]
    found: Aggregate = {"rows": len(t), "t": [float(t[0]), float(t[-1])], "peaks": {}, "squares": {}}
    for output in block.outputs:
        for k, values in enumerate(rate[rows] for rate in output.rates if output.symbol != "q"):
            name = rate_name(output.symbol, k)
            if output.deviations:
                peak = surest_peaks(values, output.deviations[k][rows])[0]
            else:
                peak = np.maximum(values.max(axis=0), -values.min(axis=0))
            found["peaks"][name] = dict(zip(output.names, peak.tolist(), strict=True))
            squares = np.einsum("ij,ij->j", values, values)
            found["squares"][name] = dict(zip(output.names, squares.tolist(), strict=True))
    return found


def add(tallies: dict[str, Aggregate], motion: str, more: Aggregate) -> None:
    """Join an aggregate of further rows to that of a motion."""
    if motion not in tallies:
        tallies[motion] = more
        return
    known = tallies[motion]
    if more["t"][0] <= known["t"][1]:
        raise out_of_order(motion, known, more)
    known["rows"] += more["rows"]
    known["t"] = [known["t"][0], more["t"][1]]
    for name, peaks in more["peaks"].items():
        of, squares = known["peaks"][name], known["squares"][name]
        for joint, peak in peaks.items():
            of[joint] = max(of[joint], peak)
            squares[joint] += more["squares"][name][joint]


def join(parts: Iterable[tuple[Part, Mapping[str, Aggregate]]], add: Add = add) -> dict[str, Aggregate]:
    """The aggregates of all parts, in the order in which motions come first."""
    tallies: dict[str, Aggregate] = {}
    for part, found in parts:
        try:
            for motion, more in found.items():
                add(tallies, motion, more)
        except JounceError as error:
            raise JounceError(f"{place(part.path, part.span.start)}: {error}") from None
    return tallies


def out_of_order(motion: str, known: Aggregate, more: Aggregate) -> JounceError:
    """The error where a motion goes on at a time that it has passed already."""
    return JounceError(
        f"motion {quoted(motion)} goes on at t = {more['t'][0]:.17g}, and its rows before end at"
        f" t = {known['t'][1]:.17g}; expected increasing times: sort the rows of each motion, and give motions names of"
        " their own"
    )


def reduced(tallies: Mapping[str, Aggregate], kinds: Sequence[str]) -> Columns:
    """A table of aggregates with a row per motion and joint: columns ``Q_peak, Qd_peak, ..., Q_rms, ...``."""
    motions, joints, rows = list[str](), list[str](), list[int]()
    quantities: dict[str, object] = {}
    for motion, found in tallies.items():
        names = list(dict.fromkeys(joint for peaks in found["peaks"].values() for joint in peaks))
        quantities |= dict.fromkeys(found["peaks"])
        motions += [motion] * len(names)
        joints += names
        rows += [found["rows"]] * len(names)
    columns: Columns = {MOTION: np.array(motions), "joint": np.array(joints), "rows": np.array(rows)}
    for kind in kinds:
        for name in quantities:
            columns[f"{name}_{kind}"] = np.array([
                KINDS[kind](found, name, joint)
                for found in tallies.values()
                for joint in dict.fromkeys(joint for peaks in found["peaks"].values() for joint in peaks)
            ])  # fmt: skip
    return columns


def _peak(found: Aggregate, name: str, joint: str) -> float:
    return float(found["peaks"][name].get(joint, np.nan))


def _rms(found: Aggregate, name: str, joint: str) -> float:
    return float(np.sqrt(found["squares"][name].get(joint, np.nan) / found["rows"]))


KINDS = {"peak": _peak, "rms": _rms}
