"""Columns of tables made along motions: rates, their standard deviations, samples, breaks, measured torques."""

from collections.abc import Iterator, Sequence

import numpy as np

from jounce.io.columns import Columns
from jounce.motion import Motion
from jounce.motion.base import NAMES
from jounce.spatial.series import rate_name

PIECE = 1000  # rows
DEVIATION, SAMPLE, MEASURED = "_sd", "_sample", "_measured"  # what follows the name of a quantity in a column's
BREAK = "break"  # the column of breaks: the order of the derivative that jumps since the row before, else -1


def pieces(motion: Motion, joints: Sequence[str], order: int) -> Iterator[Columns]:
    """A motion at its times as ``NAME.q, NAME.qd, ...``, piece by piece, a table that is read as a motion again."""
    breaks = [(found.t, found.order) for found in motion.breaks_to(order) if found.symbol != "W"]
    for start in range(0, len(motion.times), PIECE):
        part = slice(start, start + PIECE)
        t = motion.times[part]
        columns: Columns = {"t": t}
        columns |= named("q", joints, motion(t, order), motion.deviations(t, order)) | of_base(motion, t, order)
        if motion.samples is not None and len(motion.samples[0]) == len(motion.times):
            columns |= {f"{name}.q{SAMPLE}": motion.samples[1][part, j] for j, name in enumerate(joints)}
        yield columns | measured(motion, joints, t) | break_marks(motion, breaks, t)


def named(
    symbol: str, joints: Sequence[str], rates: Sequence[np.ndarray], deviations: Sequence[np.ndarray] | None
) -> Columns:
    """The columns ``NAME.Q, NAME.Qd, ...`` of rates (N, n), and ``NAME.Q_sd, ...`` of their standard deviations."""
    found: Columns = {}
    for j, name in enumerate(joints):
        for ending, arrays in (("", rates), (DEVIATION, deviations or ())):
            found |= {f"{name}.{rate_name(symbol, k)}{ending}": rate[:, j] for k, rate in enumerate(arrays)}
    return found


def of_base(motion: Motion, t: np.ndarray, order: int) -> Columns:
    """The columns ``base.x, base.xd, ..., base.qz, ...`` of the base of a motion, as they are read again."""
    if motion.base_curve is None:
        return {}
    found: Columns = {}
    motion.base(t, order)  # refuses what is not known
    rates, deviations = motion.base_curve.rates(t, order), motion.base_curve.deviations(t, order)
    for j, name in enumerate(NAMES):
        for ending, arrays in (("", rates), (DEVIATION, deviations or ())):
            found |= {f"{rate_name(name, k)}{ending}": rate[:, j] for k, rate in enumerate(arrays)}
    return found


def measured(motion: Motion, joints: Sequence[str], t: np.ndarray) -> Columns:
    """Measured torques at times, linear between the rows of the log: the columns ``NAME.Q_measured``."""
    if motion.torques is None:
        return {}
    at, torques = motion.torques
    return {
        f"{name}.Q{MEASURED}": np.interp(t, at, torques[:, j])
        for j, name in enumerate(joints)
        if np.isfinite(torques[:, j]).all()
    }


def break_marks(motion: Motion, breaks: Sequence[tuple[float, int]], t: np.ndarray) -> Columns:
    """The column of breaks, given by their times and orders, at some of the times of a motion; nothing without any."""
    if not breaks:
        return {}
    at, jumps = np.array(breaks).T
    last = motion.times[-1]
    at, jumps = (values[(motion.times[0] < at) & (at <= last)] for values in (at, jumps))
    after = motion.times[np.searchsorted(motion.times, at)]  # the times of the rows that follow the breaks
    row = np.searchsorted(t, after).clip(max=len(t) - 1)
    here = t[row] == after
    orders = np.full(len(t), np.inf)
    np.minimum.at(orders, row[here], jumps[here])
    return {BREAK: np.where(np.isfinite(orders), orders, -1.0)}
