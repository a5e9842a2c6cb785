"""Columns of tables made along motions: rates, their standard deviations, samples, breaks, measured torques."""

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from jounce.core.errors import JounceError
from jounce.core.version import __version__
from jounce.io.table_format import Columns, TableMetadata
from jounce.model import coordinates
from jounce.model.elasticity import motor_names
from jounce.model.limits import derivative_unit
from jounce.model.mechanism import Mechanism
from jounce.motion import Motion
from jounce.motion.base import BASE_COLUMNS
from jounce.motion.channel import DEVIATION, Channel, Discontinuity
from jounce.motion.table_columns import TIME
from jounce.spatial.series import RATE_SUFFIX

ROWS_PER_MOTION_PIECE = 1000  # about 1 MB for a robot of 30 joints with three rates
SAMPLE, MEASURED = "_sample", "_measured"  # what follows the name of a quantity in a column's
WRITTEN_QUANTITY = re.compile("(q|Q|theta|tau|i|u)" + RATE_SUFFIX)  # of the names of quantities that are written
WITH_DEVIATIONS = ("q", "Q", "tau")  # the quantities whose deviations are written, 0 where a motion is exact
BREAK_COLUMN = "break"  # the column of breaks: the order of the derivative that jumps since the row before, else -1
NO_BREAK = -1.0  # in the column of breaks


def motion_pieces(motion: Motion, joints: Sequence[str], order: int) -> Iterator[Columns]:
    """A motion at its times as ``NAME.q, NAME.qd, ...``, piece by piece, a table that is read as a motion again."""
    breaks = [(found.t, found.order) for found in motion.breaks_to(order) if found.symbol in ("q", "base")]
    sampled = motion.samples is not None and len(motion.samples[0]) == len(motion.times)
    for start in range(0, len(motion.times), ROWS_PER_MOTION_PIECE):
        part = slice(start, start + ROWS_PER_MOTION_PIECE)
        t = motion.times[part]
        channels = [joint_channel(motion, joints, t, order), *base_channels(motion, t, order)]
        if sampled and motion.samples is not None:
            names = [f"{stem}{SAMPLE}" for stem in column_stems(motion, joints)]
            channels.append(column_channel(names, t, (motion.samples[1][part],)))
        yield table_columns([*channels, *measured_channels(motion, joints, t), *break_channels(motion, breaks, t)])


def table_columns(channels: Sequence[Channel]) -> Columns:
    """The columns of a table that holds channels at the same times: t, then those of each channel."""
    t = channels[0].times
    columns: Columns = {"t": t}
    for channel in channels:
        if channel.times is not t and not np.array_equal(channel.times, t):
            raise JounceError(
                f"{channels[0].summary}, and {channel.summary}; expected the same times of all channels of a table"
            )
        columns |= channel.to_columns()
    return columns


def column_channel(
    names: Sequence[str], t: np.ndarray, rates: Sequence[np.ndarray], deviations: Sequence[np.ndarray] | None = None
) -> Channel:
    """A channel whose names are those of columns, or what these begin with, as they are read again."""
    off = None if deviations is None else tuple(deviations)
    return Channel("", tuple(names), ("",) * len(names), t, tuple(rates), off)


def column_stems(motion: Motion, joints: Sequence[str]) -> list[str]:
    """What the columns of its numbers begin with, ``joint1.q`` or, of a ball, ``ankle.qx``."""
    several = {name for joint in motion.several for name in joint.names}
    return [name if name in several else f"{name}.q" for name in (motion.joint_names if several else None) or joints]


def joint_channel(motion: Motion, joints: Sequence[str], t: np.ndarray, order: int) -> Channel:
    """The columns ``NAME.q, NAME.qd, ...`` or ``NAME.qx, NAME.qxd, ...`` of the joints, as they are read again."""
    motion(t, order)  # refuses what is not known
    curve = motion.curve
    return column_channel(column_stems(motion, joints), t, curve.rates(t, order), curve.deviations(t, order))


def base_channels(motion: Motion, t: np.ndarray, order: int) -> list[Channel]:
    """The columns ``base.x, base.xd, ..., base.qz, ...`` of the base of a motion, if it has one."""
    if motion.base_curve is None:
        return []
    motion.base(t, order)  # refuses what is not known
    curve = motion.base_curve
    return [column_channel(BASE_COLUMNS, t, curve.rates(t, order), curve.deviations(t, order))]


def table_metadata(mechanism: Mechanism, order: int) -> TableMetadata:
    """What a table of results is of: the robot, its joints, the order, and the units of columns."""
    joints = mechanism.coordinates
    data = {"version": __version__, "robot": mechanism.name, "joints": list(joints), "order": order}
    owners = dict(zip(joints, coordinates.units(mechanism), strict=True))
    owners |= dict(zip(coordinates.BASE_FORCES, ["rad"] * 3 + ["m"] * 3, strict=True)) if mechanism.floats else {}
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


def measured_channels(motion: Motion, joints: Sequence[str], t: np.ndarray) -> list[Channel]:
    """Measured torques at times, linear between rows of the log, NaN next to missing ones: ``NAME.Q_measured``."""
    if motion.torques is None:
        return []
    at, torques = motion.torques
    known = [j for j in range(len(joints)) if np.isfinite(torques[:, j]).any()]
    if not known:
        return []
    values = np.column_stack([np.interp(t, at, torques[:, j]) for j in known])
    return [column_channel([f"{joints[j]}.Q{MEASURED}" for j in known], t, (values,))]


def break_channels(motion: Motion, breaks: Sequence[tuple[float, int]], t: np.ndarray) -> list[Channel]:
    """The column of breaks, given by their times and orders, at some of the times of a motion; none without any."""
    if not breaks:
        return []
    at, jumps = np.array(breaks).T
    last = motion.times[-1]
    at, jumps = (values[(motion.times[0] < at) & (at <= last)] for values in (at, jumps))
    after = motion.times[np.searchsorted(motion.times, at)]  # the times of the rows that follow the breaks
    row = np.searchsorted(t, after).clip(max=len(t) - 1)
    here = t[row] == after
    orders = np.full(len(t), np.inf)
    np.minimum.at(orders, row[here], jumps[here])
    return [column_channel([BREAK_COLUMN], t, (np.where(np.isfinite(orders), orders, NO_BREAK)[:, None],))]


def further_channels(
    motion: Motion, joints: Sequence[str], breaks: Sequence[Discontinuity], t: np.ndarray
) -> list[Channel]:
    """Measured torques and breaks of forces, of motions that have some."""
    marks = [(found.t, max(found.order, 0)) for found in breaks]
    return [*measured_channels(motion, joints, t), *break_channels(motion, marks, t)]


def align_deviations(channels: Sequence[Channel]) -> list[Channel]:
    """Channels with the columns that those of all motions of a table have: deviations, 0 where a motion is exact."""
    return [
        replace(channel, deviations=channel.deviations or tuple(map(np.zeros_like, channel.rates)))
        if channel.symbol in WITH_DEVIATIONS
        else channel
        for channel in channels
    ]


def align_further(
    further: Sequence[Channel], motion: Motion, joints: Sequence[str], measured: Collection[str], t: np.ndarray
) -> list[Channel]:
    """The columns next to results that all motions of a table have: torques of the `measured` joints, and breaks."""
    found = [channel for channel in further if channel.names == (BREAK_COLUMN,)]
    if not found:
        found = [column_channel([BREAK_COLUMN], t, (np.full((len(t), 1), NO_BREAK),))]
    of_table = [j for j, name in enumerate(joints) if name in measured]
    if motion.torques is None or not of_table:
        return found
    at, torques = motion.torques
    values = np.column_stack([np.interp(t, at, torques[:, j]) for j in of_table])
    return [column_channel([f"{joints[j]}.Q{MEASURED}" for j in of_table], t, (values,)), *found]
