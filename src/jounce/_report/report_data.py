"""The data of a report: a robot along a motion, with all that panels show.

`make_report_data` computes them once per report. The joints of a report are the coordinates of the robot and, where
loops are closed, the joints that follow them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from jounce._report.meshes import Meshes, meshes_of
from jounce.actuators.motors import motors_along
from jounce.core.errors import JounceError
from jounce.dynamics import joint_springs
from jounce.engine import along, closed_path
from jounce.engine.along import Along
from jounce.engine.engine import Engine
from jounce.engine.plan import compute
from jounce.limits.check import check
from jounce.limits.joints import (
    column_names,
    drop_base,
    effort_quantity,
    joint_limits,
    joint_names,
    joint_rates,
    joint_units,
    quantity_columns,
    scatter_columns,
    scatter_sizes,
)
from jounce.limits.limited_motion import known_kinds
from jounce.limits.samples import limited_values, sum_powers
from jounce.limits.slowdown import Slowdown, slowdown
from jounce.limits.verdicts import Check
from jounce.model import coordinates
from jounce.model.limits import BOUNDED_FORCES, LIMIT_KINDS, Limits
from jounce.model.mechanism import Mechanism
from jounce.motion import reliability
from jounce.motion.channel import Channel, Span
from jounce.motion.motion import Motion
from jounce.spatial.series import rate_name

MEASURED_LESS_COMPUTED = "Q measured - Q"
MAX_REPORT_ORDER = 2  # rate of Q that is drawn
# Times at which the cursor can stand, without those of worst values and breaks: a slider has no more pixels.
MAX_REPORT_FRAMES, MIN_REPORT_FRAMES = 1000, 200
MAX_CURSOR_VALUES = 60_000  # of all frames together: they are stored exactly, and are most of the page
MAX_SLOWDOWN_STATES = 10_000  # longer motions are thinned for the slow-down factor, which looks between states
BREAK_SIDE_SHARE = 1e-9  # of the duration: how long before a break its left side is drawn; no screen shows it


@dataclass(frozen=True, eq=False)
class ReportData:
    """A robot along a motion, with all data of a report.

    `frames` (K,) are the indices of the times `t` at which the cursor can stand. `quantities` are channels of all
    joints, by the kind of limit that may bound them, or else by their symbols; sums that limits of the whole robot
    bound have one column. They are NaN for joints without the quantity, such as forces of joints without a motor. The
    window of a channel whose deviations are known leaves out
    the uncertain ends of samples. `at_frames` are the same channels at the frames, with their deviations.

    `check` and `slowdown` are None where the robot has no limits; `slowdown` is a text where no factor exists, with the
    reason. `loop_wrenches` (N, loops, 6) are the wrenches at cut joints, None where no loop is closed.
    """

    robot: Engine
    motion: Motion
    along: Along
    limits: Limits
    quantities: Mapping[str, Channel]
    at_frames: Mapping[str, Channel]
    frames: np.ndarray
    check: Check | None
    slowdown: Slowdown | str | None
    meshes: Meshes
    loop_wrenches: np.ndarray | None
    positions: np.ndarray  # (K, numbers) of all joints at the frames

    @property
    def joints(self) -> tuple[str, ...]:
        """The names of the joints."""
        return joint_names(self.robot.mechanism)

    @property
    def own(self) -> tuple[int, ...]:
        """The joints that are the coordinates of the robot."""
        return self.robot.mechanism.independent_places

    @property
    def t(self) -> np.ndarray:
        """The times of the motion, of worst values, and around breaks."""
        return self.along.t

    @property
    def has_uncertain_ends(self) -> bool:
        """Whether any quantity has uncertain ends."""
        whole = ((self.motion.start, self.motion.stop),)
        return any(channel.windows not in ((), whole) for channel in self.quantities.values())

    @property
    def start_frame(self) -> int:
        """The frame at which a page opens: the worst moment, certain if any is.

        Without a check it is the first one at which all values are certain.
        """
        if self.check is not None:
            worst = self.check.worst
            return self.frame(worst.t if worst.certain is None else worst.certain[1])
        starts = [channel.windows[0][0] for channel in self.at_frames.values() if channel.windows]
        return self.frame(max(starts, default=self.motion.start))

    def keys(self, of_forces: bool) -> list[str]:
        """Return the keys of Q, its rates and their differences, or all others."""
        return [key for key, x in self.quantities.items() if x.symbol.startswith("Q") == of_forces]

    def frame(self, t: float) -> int:
        """Return the frame nearest to a time."""
        return int(np.abs(self.t[self.frames] - t).argmin())


def make_report_data(
    robot: Engine, motion: Motion, order: int, visuals: Path | None = None, folders: Sequence[Path] = ()
) -> ReportData:
    """Check a motion, and compute all that its report shows.

    Forces have rates up to an order. The URDF `visuals` shows the links.
    """
    m = robot.mechanism
    limits = joint_limits(m)
    verdicts = check(robot, motion) if known_kinds(robot, limits) else None
    rows = verdicts.table if verdicts is not None else ()
    # Curves must pass through the worst values and show both sides of jumps: their times join those of the motion.
    worst = np.array([row.t for row in rows])
    ends = np.array([end for row in rows for span in row.violations for end in span])
    breaks = np.array([jump.t for jump in motion.breaks])
    left_sides = (breaks - BREAK_SIDE_SHARE * motion.duration).clip(motion.start)
    t = np.unique(np.concatenate([motion.times, worst, ends, breaks, left_sides]))
    traced = along.forces_along(robot, motion, t, order, options=along.ForceOptions(row=effort_quantity(m)))
    # The cursor stands at even rows, as many as the size of the page allows, at worst values, and at the first breaks.
    rate_count = (order + 1) * 2 + along.Q_RATE_ORDER
    quantity_count = rate_count + len(limits.without_gravity) + 1 + len(LIMIT_KINDS.motor)  # at most
    frame_count = int(np.clip(MAX_CURSOR_VALUES // (quantity_count * m.tree.n), MIN_REPORT_FRAMES, MAX_REPORT_FRAMES))
    even_rows = np.linspace(0, len(traced.t) - 1, min(frame_count, len(traced.t))).astype(int)
    frames = np.union1d(even_rows, np.searchsorted(traced.t, [*worst, *breaks[:frame_count]]))
    with closed_path.name_errors_by_time(traced.t):
        tree_positions = closed_path.continue_positions(robot, motion, traced.t)
        quantities, at_frames = _quantities(robot, motion, traced, limits, frames, tree_positions)
        wrenches = _loop_wrenches(robot, motion, traced)
    factor = _slowdown(robot, motion, worst) if verdicts is not None else None
    meshes = Meshes() if visuals is None else meshes_of(m, visuals, folders)
    joint_positions = quantities[LIMIT_KINDS.motion[0]].values if tree_positions is not None else traced.rates[0]
    return ReportData(
        robot,
        motion,
        traced,
        limits,
        quantities,
        at_frames,
        frames,
        verdicts,
        factor,
        meshes,
        wrenches,
        joint_positions[frames],
    )


def list_known(channel: Channel) -> list[int]:
    """Return the columns without NaN: the joints that have the quantity."""
    return [j for j, has in enumerate(~np.isnan(channel.values).any(axis=0)) if has]


def _slowdown(robot: Engine, motion: Motion, worst: np.ndarray) -> Slowdown | str:
    """Return the slow-down factor, or the reason why it does not exist."""
    # Long motions are thinned to even steps and the times of worst values.
    states = motion
    if len(motion.times) > MAX_SLOWDOWN_STATES:
        states = replace(motion, grid=np.union1d(np.linspace(motion.start, motion.stop, MAX_SLOWDOWN_STATES), worst))
    try:
        slow = slowdown(robot, states)
        return slow if slow.binding else replace(slow, motion=motion)
    except JounceError as error:
        return str(error)


def _quantities(
    robot: Engine, motion: Motion, traced: Along, limits: Limits, frames: np.ndarray, tree_positions: np.ndarray | None
) -> tuple[dict[str, Channel], dict[str, Channel]]:
    """Return the channels of a report at all times and at frames.

    They are q and its rates, the forces and theirs, and what else limits bound: forces without gravity, the power,
    forces at stall, motors. Those at the frames have their deviations.
    """
    # Values and deviations by kind of limit; columns are spread over all joints, (N, n) -> (N, joints).
    m, count = robot.mechanism, len(traced.forces)
    forces = [_spread_drives(m, x) for x in drop_base(m, traced.forces, effort_quantity(m))]
    rates = joint_rates(robot, traced.rates, tree_positions)
    deviations_of_q = motion.deviations(traced.t[frames], len(rates) - 1) or ()
    q_deviations = [_spread_columns(m, m.independent_places, x) for x in deviations_of_q]
    values = dict(zip(LIMIT_KINDS.motion, rates, strict=False)) | dict(zip(LIMIT_KINDS.effort, forces, strict=False))
    deviations = dict(zip(LIMIT_KINDS.motion, q_deviations, strict=False))
    sizes = scatter_sizes(m, drop_base(m, traced.deviations or (), effort_quantity(m)), effort_quantity(m))
    force_deviations = [_only_forces(m, x)[frames] for x in sizes]
    deviations |= dict(zip(LIMIT_KINDS.effort, force_deviations, strict=False))
    units = joint_units(m)

    def channel(kind: str, values: np.ndarray, symbol: str = "", bounded: bool = True) -> Channel:
        """Return the channel of a kind of limit, with bounds and window."""
        row, known = LIMIT_KINDS[kind], deviations.get(kind)
        names = column_names(m, kind)
        bounds = limits.bounds(kind) if bounded else np.full((2, len(units)), [[-np.inf], [np.inf]])
        windows: tuple[Span, ...] = ()
        if known is not None:
            windows = (reliability.find_window(traced.t[frames], known, values[frames]),)
        kind_units = tuple(map(row.unit, units[: len(names)]))
        return Channel(symbol or row.symbol, names, kind_units, traced.t, (values,), None, windows, bounds=(bounds,))

    # A limit on forces without gravity does not bound the whole forces, whose channel then goes by its symbol.
    channels = {}
    for kind, x in values.items():
        is_other = kind in limits.without_gravity
        channels[LIMIT_KINDS[kind].symbol if is_other else kind] = channel(kind, x, bounded=not is_other)
    # What a log measured, less what the model computes.
    if motion.torques is not None:
        difference = _measured(motion, traced.t, m.independent_places, forces[0].shape) - forces[0]
        channels[MEASURED_LESS_COMPUTED] = channel(
            LIMIT_KINDS.effort[0], difference, MEASURED_LESS_COMPUTED, bounded=False
        )
    # Forces without gravity, where limits bound them, and power and forces at stall.
    inertial = [kind for kind in limits.without_gravity if kind in limits.kinds and kind in values]
    gravity = []
    if len(inertial) > 0:
        gravity_rates = closed_path.with_tree_positions(traced.rates[:count], tree_positions)
        base = None if traced.base is None else traced.base[:count]
        weights = compute(robot, "gravity_forces", gravity_rates, base=base)
        gravity = [_spread_drives(m, x) for x in drop_base(m, weights, effort_quantity(m))]
    bounded = limited_values(limits, rates, forces, gravity)
    for kind in inertial:
        symbol = " - ".join(rate_name(name, LIMIT_KINDS[kind].rate) for name in BOUNDED_FORCES[1].split(" - "))
        channels[kind] = channel(kind, bounded[kind], symbol)
    motors: dict[str, np.ndarray] = {}
    if m.elasticity is not None and count > MAX_REPORT_ORDER:
        motors = _motors(robot, motion, traced.t, limits)
        channels |= {kind: channel(kind, _spread_drives(m, x)) for kind, x in motors.items()}
    channels |= {kind: channel(kind, bounded[kind]) for kind in ("power", "stall_effort") if kind in limits.kinds}
    # Sums over all joints that are limited.
    factors = {"velocity": rates[1], "effort": forces[0]} | {kind: _spread_drives(m, x) for kind, x in motors.items()}
    channels |= {
        kind: channel(kind, x, kind.replace("_", " "))
        for kind, x in sum_powers(m, factors).items()
        if kind in limits.kinds
    }
    # Channels go by their kinds or their symbols. Measured forces and motors have no deviations.
    deviations_by_key = deviations | {LIMIT_KINDS[kind].symbol: x for kind, x in deviations.items()}
    at_frames = {}
    for key, whole in channels.items():
        known = (deviations_by_key[key],) if key in deviations_by_key else None
        at_frames[key] = replace(whole.rows(frames), deviations=known)
    return channels, at_frames


def _loop_wrenches(robot: Engine, motion: Motion, traced: Along) -> np.ndarray | None:
    """Return the wrenches (N, loops, 6) at cut joints, or None."""
    if not robot.mechanism.takes_dependent:
        return None
    base = None if traced.base is None else traced.base[: along.Q_RATE_ORDER + 1]
    W, tree_positions = motion.wrench(traced.t, 0), closed_path.continue_positions(robot, motion, traced.t)
    rates = closed_path.with_tree_positions(traced.rates[: along.Q_RATE_ORDER + 1], tree_positions)
    return np.asarray(compute(robot, "loop_wrenches", rates, wrench=W, base=base))


def _measured(motion: Motion, t: np.ndarray, joints: Sequence[int], shape: tuple[int, ...]) -> np.ndarray:
    """Interpolate measured torques at times, as columns of all joints.

    They are linear between rows, and NaN for joints without measured torques.
    """
    assert motion.torques is not None
    torques = np.full(shape, np.nan)
    for j, column in zip(joints, motion.torques[1].T, strict=True):
        is_known = np.isfinite(column)
        if is_known.any():
            torques[:, j] = np.interp(t, motion.torques[0][is_known], column[is_known])
    return torques


def _spread_drives(m: Mechanism, x: np.ndarray) -> np.ndarray:
    """Spread columns of the drives over all joints.

    Drives are those of the coordinates, or of the actuated joints where these differ. Coordinates that several motors
    move together have the force of all.
    """
    return _only_forces(m, scatter_columns(m, [x], effort_quantity(m))[0])


def _only_forces(m: Mechanism, columns: np.ndarray) -> np.ndarray:
    """Return columns of all joints, NaN for those without a force."""
    with_force = [*quantity_columns(m, effort_quantity(m)), *coordinates.shared_coordinates(m)]
    return np.where(np.isin(np.arange(m.tree.n), with_force), columns, np.nan)


def _spread_columns(m: Mechanism, joints: Sequence[int], x: np.ndarray) -> np.ndarray:
    """Spread columns of some joints over all joints, NaN for the others."""
    spread = np.full((len(x), m.tree.n), np.nan)
    spread[:, joints] = x
    return spread


def _motors(robot: Engine, motion: Motion, t: np.ndarray, limits: Limits) -> dict[str, np.ndarray]:
    """Return positions, torques, currents and voltages of motors, by kind of limit.

    Quantities that are not known of all motors are left out. Joints with two motors need a stiffness over time, which a
    report does not have.
    """
    e = joint_springs.elasticity_of(robot.mechanism)
    if e.pairs:
        return {}
    # Voltages of inductances take one rate more, which a motion has that is checked against their limits.
    takes_voltages = "motor_voltage" in limits.kinds or "total_electrical_power" in limits.kinds
    motors = motors_along(robot, motion, t, order=int(e.is_inductive and takes_voltages))
    series = (*motors.positions[:2], motors.torques[0], *(x[0] for x in (motors.currents, motors.voltages) if x))
    return {kind: x for kind, x in zip(LIMIT_KINDS.motor, series, strict=False) if np.isfinite(x).all()}
