"""Columns of tables made along motions: rates, their standard deviations, samples, breaks, measured torques."""

import re
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from jounce.core.version import __version__
from jounce.io.columns import Columns, TableMetadata
from jounce.model.coordinates import BASE_FORCES, coordinate_units
from jounce.model.elasticity import motor_names
from jounce.model.limit_kinds import derivative_unit
from jounce.model.mechanism import Mechanism
from jounce.motion import Motion
from jounce.motion.base import BASE_COLUMNS
from jounce.motion.table_columns import TIME
from jounce.spatial.series import RATE_SUFFIX, rate_name

ROWS_PER_MOTION_PIECE = 1000  # about 1 MB for a robot of 30 joints with three rates
DEVIATION, SAMPLE, MEASURED = "_sd", "_sample", "_measured"  # what follows the name of a quantity in a column's
WRITTEN_QUANTITY = re.compile("(q|Q|theta|tau|i|u)" + RATE_SUFFIX)  # of the names of quantities that are written
BREAK_COLUMN = "break"  # the column of breaks: the order of the derivative that jumps since the row before, else -1


def motion_pieces(motion: Motion, joints: Sequence[str], order: int) -> Iterator[Columns]:
    """A motion at its times as ``NAME.q, NAME.qd, ...``, piece by piece, a table that is read as a motion again."""
    breaks = [(found.t, found.order) for found in motion.breaks_to(order) if found.symbol in ("q", "base")]
    for start in range(0, len(motion.times), ROWS_PER_MOTION_PIECE):
        part = slice(start, start + ROWS_PER_MOTION_PIECE)
        t = motion.times[part]
        columns: Columns = {"t": t}
        columns |= joint_columns(motion, joints, t, order) | base_columns(motion, t, order)
        if motion.samples is not None and len(motion.samples[0]) == len(motion.times):
            columns |= {f"{x}{SAMPLE}": motion.samples[1][part, j] for j, x in enumerate(column_stems(motion, joints))}
        yield columns | measured_columns(motion, joints, t) | break_marks(motion, breaks, t)


def named_columns(
    symbol: str, joints: Sequence[str], rates: Sequence[np.ndarray], deviations: Sequence[np.ndarray] | None
) -> Columns:
    """The columns ``NAME.Q, NAME.Qd, ...`` of rates (N, n), and ``NAME.Q_sd, ...`` of their standard deviations."""
    return _stem_columns([f"{name}.{symbol}" for name in joints], rates, deviations)


def _stem_columns(
    stems: Sequence[str], rates: Sequence[np.ndarray], deviations: Sequence[np.ndarray] | None
) -> Columns:
    found: Columns = {}
    for j, stem in enumerate(stems):
        for ending, arrays in (("", rates), (DEVIATION, deviations or ())):
            found |= {f"{rate_name(stem, k)}{ending}": rate[:, j] for k, rate in enumerate(arrays)}
    return found


def column_stems(motion: Motion, joints: Sequence[str]) -> list[str]:
    """What the columns of its numbers begin with, ``joint1.q`` or, of a ball, ``ankle.qx``."""
    several = {name for joint in motion.several for name in joint.names}
    return [name if name in several else f"{name}.q" for name in (motion.joint_names if several else None) or joints]


def joint_columns(motion: Motion, joints: Sequence[str], t: np.ndarray, order: int) -> Columns:
    """The columns ``NAME.q, NAME.qd, ...`` or ``NAME.qx, NAME.qxd, ...`` of the joints, as they are read again."""
    motion(t, order)  # refuses what is not known
    return _stem_columns(column_stems(motion, joints), motion.curve.rates(t, order), motion.curve.deviations(t, order))


def base_columns(motion: Motion, t: np.ndarray, order: int) -> Columns:
    """The columns ``base.x, base.xd, ..., base.qz, ...`` of the base of a motion, as they are read again."""
    if motion.base_curve is None:
        return {}
    motion.base(t, order)  # refuses what is not known
    return _stem_columns(BASE_COLUMNS, motion.base_curve.rates(t, order), motion.base_curve.deviations(t, order))


def table_metadata(mechanism: Mechanism, order: int) -> TableMetadata:
    """What a table of results is of: the robot, its joints, the order, and the units of columns."""
    joints = mechanism.coordinates
    data = {"version": __version__, "robot": mechanism.name, "joints": list(joints), "order": order}
    owners = dict(zip(joints, coordinate_units(mechanism), strict=True))
    owners |= dict(zip(BASE_FORCES, ["rad"] * 3 + ["m"] * 3, strict=True)) if mechanism.floats else {}
    if (e := mechanism.elasticity) is not None:
        of_motors = [owners[joints[j]] for j in e.joints_of_motors]
        owners |= dict(zip(motor_names(e, joints), of_motors, strict=True))
    return TableMetadata(lambda name: "s" if name == TIME else _column_unit(owners, name), data)


def _column_unit(owners: Mapping[str, str], name: str) -> str:
    """The unit of a column ``NAME.Qd``; none where it is no quantity of a joint or motor."""
    owner, _, symbol = name.removesuffix(DEVIATION).removesuffix(SAMPLE).removesuffix(MEASURED).rpartition(".")
    rate = WRITTEN_QUANTITY.fullmatch(symbol)
    if owner not in owners or rate is None:
        return ""
    k = int(rate[2][:-1] or 1) if rate[2] else 0
    return derivative_unit(rate[1], k, owners[owner])


def measured_columns(motion: Motion, joints: Sequence[str], t: np.ndarray) -> Columns:
    """Measured torques at times, linear between rows of the log, NaN next to missing ones: ``NAME.Q_measured``."""
    if motion.torques is None:
        return {}
    at, torques = motion.torques
    return {
        f"{name}.Q{MEASURED}": np.interp(t, at, torques[:, j])
        for j, name in enumerate(joints)
        if np.isfinite(torques[:, j]).any()
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
    return {BREAK_COLUMN: np.where(np.isfinite(orders), orders, -1.0)}
