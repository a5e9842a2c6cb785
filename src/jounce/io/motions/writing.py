"""Columns of tables made along motions: rates, their standard deviations, samples, breaks, measured torques."""

from collections.abc import Iterator, Sequence

import numpy as np

from jounce.io.columns import Columns
from jounce.motion import Motion
from jounce.spatial.series import rate_name

PIECE = 1000  # rows
DEVIATION, SAMPLE, MEASURED = "_sd", "_sample", "_measured"  # what follows the name of a quantity in a column's
BREAK = "break"  # the column of breaks: the order of the derivative that jumps since the row before, else -1


def pieces(motion: Motion, joints: Sequence[str], order: int) -> Iterator[Columns]:
    """A motion at its times as ``NAME.q, NAME.qd, ...``, piece by piece, a table that is read as a motion again."""
    breaks = [found for found in motion.breaks_to(order) if found.symbol == "q"]
    at, orders = np.array([found.t for found in breaks]), [found.order for found in breaks]
    for start in range(0, len(motion.times), PIECE):
        part = slice(start, start + PIECE)
        t = motion.times[part]
        columns: Columns = {"t": t}
        columns |= named("q", joints, motion(t, order), motion.deviations(t, order))
        if motion.samples is not None and len(motion.samples[0]) == len(motion.times):
            columns |= {f"{name}.q{SAMPLE}": motion.samples[1][part, j] for j, name in enumerate(joints)}
        columns |= measured(motion, joints, t)
        if breaks:
            before = motion.times[max(start - 1, 0)]
            columns[BREAK] = _orders(at, orders, t, before)
        yield columns


def named(
    symbol: str, joints: Sequence[str], rates: Sequence[np.ndarray], deviations: Sequence[np.ndarray] | None
) -> Columns:
    """The columns ``NAME.Q, NAME.Qd, ...`` of rates (N, n), and ``NAME.Q_sd, ...`` of their standard deviations."""
    found: Columns = {}
    for j, name in enumerate(joints):
        for ending, arrays in (("", rates), (DEVIATION, deviations or ())):
            found |= {f"{name}.{rate_name(symbol, k)}{ending}": rate[:, j] for k, rate in enumerate(arrays)}
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


def _orders(at: np.ndarray, orders: Sequence[int], t: np.ndarray, before: float) -> np.ndarray:
    """The lowest order of a derivative that jumps between each time and the one before it; -1 where none does."""
    found = np.full(len(t), np.inf)
    row = np.searchsorted(t, at)
    inside = (at > before) & (row < len(t))
    np.minimum.at(found, row[inside], np.asarray(orders, dtype=float)[inside])
    return np.where(np.isfinite(found), found, -1.0)
