"""Makes the columns of tables along motions.

They are rates, their standard deviations, samples, breaks, and measured torques.
"""

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
    """Yield a motion at its times, piece by piece.

    Columns are ``NAME.q, NAME.qd, ...``, a table that is read as a motion again.
    """
    breaks = [(jump.t, jump.order) for jump in motion.breaks_to(order) if jump.symbol in ("q", "base")]
    # Samples have a column where they are at the times of the rows.
    has_samples = motion.samples is not None and len(motion.samples[0]) == len(motion.times)
    for start in range(0, len(motion.times), ROWS_PER_MOTION_PIECE):
        part = slice(start, start + ROWS_PER_MOTION_PIECE)
        t = motion.times[part]
        channels = [joint_channel(motion, joints, t, order), *base_channels(motion, t, order)]
        if has_samples and motion.samples is not None:
            names = [f"{stem}{SAMPLE}" for stem in column_stems(motion, joints)]
            channels.append(column_channel(names, t, (motion.samples[1][part],)))
        yield table_columns([*channels, *measured_channels(motion, joints, t), *break_channels(motion, breaks, t)])


def table_columns(channels: Sequence[Channel]) -> Columns:
    """Return the columns of channels at the same times.

    They are t, then those of each channel.
    """
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
    """Return a channel whose names are those of columns.

    They may be stems, as columns of rates begin with them when they are read again.
    """
    sigmas = None if deviations is None else tuple(deviations)
    return Channel("", tuple(names), ("",) * len(names), t, tuple(rates), sigmas)


def column_stems(motion: Motion, joints: Sequence[str]) -> list[str]:
    """Return the stems of the columns of positions.

    They are ``joint1.q`` or, of a ball, ``ankle.qx``.
    """
    multiscrew_names = {name for joint in motion.several for name in joint.names}
    # A motion of such joints names their numbers itself.
    names = joints
    if len(multiscrew_names) > 0 and motion.joint_names:
        names = motion.joint_names
    return [name if name in multiscrew_names else f"{name}.q" for name in names]


def joint_channel(motion: Motion, joints: Sequence[str], t: np.ndarray, order: int) -> Channel:
    """Return the columns of the joints, as they are read again.

    They are ``NAME.q, NAME.qd, ...`` or ``NAME.qx, NAME.qxd, ...``.
    """
    # The call refuses rates that are not known; the curve itself does not.
    motion(t, order)
    curve = motion.curve
    return column_channel(column_stems(motion, joints), t, curve.rates(t, order), curve.deviations(t, order))


def base_channels(motion: Motion, t: np.ndarray, order: int) -> list[Channel]:
    """Return the columns of the base of a motion, if any.

    They are ``base.x, base.xd, ..., base.qz, ...``.
    """
    if motion.base_curve is None:
        return []
    motion.base(t, order)
    curve = motion.base_curve
    return [column_channel(BASE_COLUMNS, t, curve.rates(t, order), curve.deviations(t, order))]


def table_metadata(mechanism: Mechanism, order: int) -> TableMetadata:
    """Return the metadata of a table of results.

    They are the robot, its joints, the order, and the units of columns.
    """
    joints = mechanism.coordinates
    data = {"version": __version__, "robot": mechanism.name, "joints": list(joints), "order": order}
    # The unit of the position of each joint, component of the base and motor: those of rates and forces follow.
    position_units = dict(zip(joints, coordinates.units(mechanism), strict=True))
    if mechanism.floats:
        position_units |= dict(zip(coordinates.BASE_FORCES, ["rad"] * 3 + ["m"] * 3, strict=True))
    e = mechanism.elasticity
    if e is not None:
        units_of_motors = [position_units[joints[j]] for j in e.joints_of_motors]
        position_units |= dict(zip(motor_names(e, joints), units_of_motors, strict=True))
    return TableMetadata(lambda name: "s" if name == TIME else _column_unit(position_units, name), data)


def _column_unit(position_units: Mapping[str, str], name: str) -> str:
    """Return the unit of a column ``NAME.Qd``.

    It is "" where the column is no quantity of a joint or motor.
    """
    owner, _, symbol = name.removesuffix(DEVIATION).removesuffix(SAMPLE).removesuffix(MEASURED).rpartition(".")
    rate = WRITTEN_QUANTITY.fullmatch(symbol)
    if owner not in position_units or rate is None:
        return ""
    # "" is the quantity itself, "d" its first rate, "2d" its second.
    k = 0
    if rate[2]:
        k = int(rate[2][:-1] or 1)
    return derivative_unit(rate[1], k, position_units[owner])


def measured_channels(motion: Motion, joints: Sequence[str], t: np.ndarray) -> list[Channel]:
    """Return measured torques at times: ``NAME.Q_measured``.

    They are linear between rows of the log, and NaN next to missing ones.
    """
    if motion.torques is None:
        return []
    torque_times, torques = motion.torques
    measured_joints = [j for j in range(len(joints)) if np.isfinite(torques[:, j]).any()]
    if len(measured_joints) == 0:
        return []
    values = np.column_stack([np.interp(t, torque_times, torques[:, j]) for j in measured_joints])
    return [column_channel([f"{joints[j]}.Q{MEASURED}" for j in measured_joints], t, (values,))]


def break_channels(motion: Motion, breaks: Sequence[tuple[float, int]], t: np.ndarray) -> list[Channel]:
    """Return the column of breaks at times of a motion, if any.

    `breaks` are their times and orders. A row has the lowest order of the breaks since the row before.
    """
    if len(breaks) == 0:
        return []
    break_times, break_orders = np.array(breaks).T
    is_within = (motion.times[0] < break_times) & (break_times <= motion.times[-1])
    break_times, break_orders = break_times[is_within], break_orders[is_within]
    # The row of the motion that follows each break, which may be in another piece of the table.
    next_times = motion.times[np.searchsorted(motion.times, break_times)]
    row = np.searchsorted(t, next_times).clip(max=len(t) - 1)
    is_in_piece = t[row] == next_times
    orders = np.full(len(t), np.inf)
    np.minimum.at(orders, row[is_in_piece], break_orders[is_in_piece])
    return [column_channel([BREAK_COLUMN], t, (np.where(np.isfinite(orders), orders, NO_BREAK)[:, None],))]


def further_channels(
    motion: Motion, joints: Sequence[str], breaks: Sequence[Discontinuity], t: np.ndarray
) -> list[Channel]:
    """Return measured torques and breaks of forces, of motions that have some."""
    # Impulses, of order -1, are jumps of forces in a table.
    times_and_orders = [(jump.t, max(jump.order, 0)) for jump in breaks]
    return [*measured_channels(motion, joints, t), *break_channels(motion, times_and_orders, t)]


def align_deviations(channels: Sequence[Channel]) -> list[Channel]:
    """Return channels with deviations, 0 where a motion is exact.

    All motions of a table have the same columns then.
    """
    aligned = []
    for channel in channels:
        if channel.symbol in WITH_DEVIATIONS and not channel.deviations:
            channel = replace(channel, deviations=tuple(map(np.zeros_like, channel.rates)))
        aligned.append(channel)
    return aligned


def align_further(
    further: Sequence[Channel], motion: Motion, joints: Sequence[str], measured: Collection[str], t: np.ndarray
) -> list[Channel]:
    """Return the columns next to results that all motions have.

    They are the torques of the `measured` joints, and breaks.
    """
    break_columns = [channel for channel in further if channel.names == (BREAK_COLUMN,)]
    if len(break_columns) == 0:
        break_columns = [column_channel([BREAK_COLUMN], t, (np.full((len(t), 1), NO_BREAK),))]
    measured_joints = [j for j, name in enumerate(joints) if name in measured]
    if motion.torques is None or len(measured_joints) == 0:
        return break_columns
    torque_times, torques = motion.torques
    values = np.column_stack([np.interp(t, torque_times, torques[:, j]) for j in measured_joints])
    return [column_channel([f"{joints[j]}.Q{MEASURED}" for j in measured_joints], t, (values,)), *break_columns]
