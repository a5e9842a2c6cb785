"""What a report is about: a robot along a motion, with all that its panels draw and list, computed once.

Its joints are the coordinates of the robot, and where loops are closed those that follow them too.
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
    drop_base,
    effort_quantity,
    joint_limits,
    joint_names,
    joint_rates,
    joint_units,
    quantity_columns,
)
from jounce.limits.limited_motion import known_kinds
from jounce.limits.samples import limited_values
from jounce.limits.slowdown import Slowdown, slowdown
from jounce.limits.verdicts import Check
from jounce.model import positions
from jounce.model.limits import BOUNDED_FORCES, LIMIT_KINDS, Limits
from jounce.model.mechanism import Mechanism
from jounce.motion import reliability
from jounce.motion.channel import Channel
from jounce.motion.motion import Motion
from jounce.spatial.series import rate_name

MEASURED_LESS_COMPUTED = "Q measured - Q"
MAX_REPORT_ORDER = 2  # rate of Q that is drawn
# Times at which the cursor can stand, without those of worst values and breaks: a slider has no more pixels.
MAX_REPORT_FRAMES, MIN_REPORT_FRAMES = 1000, 200
MAX_CURSOR_VALUES = 60_000  # of all frames together: they are stored exactly, and are most of the page
MAX_SLOWDOWN_STATES = 10_000  # that longer motions are thinned to for the slow-down factor, which looks between them
BREAK_SIDE_SHARE = 1e-9  # of the duration: how long before a break its left side is drawn; no screen shows it


@dataclass(frozen=True, eq=False)
class ReportData:
    """A robot along a motion; `frames` are the indices (K,) of those of the times `t` at which the cursor can stand.

    `quantities` are channels of all joints by the kind of limit that may bound them, or else by their symbols: NaN for
    joints that have none, such as forces of those without a motor. A window of one whose deviations are known leaves
    out the uncertain ends of samples. `at_frames` are the same at the frames, with their deviations.

    `check` is None where the robot states no limits; `slowdown` is then None too, or the reason why no factor exists.
    `loop_wrenches` (N, loops, 6) are those of cut joints, None where no loop is closed.
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
        """The times, those of the worst values and both sides of breaks among them."""
        return self.along.t

    @property
    def has_uncertain_ends(self) -> bool:
        """Whether any quantity lies in an uncertain end of samples at some time."""
        whole = ((self.motion.start, self.motion.stop),)
        return any(channel.windows not in ((), whole) for channel in self.quantities.values())

    def frame(self, t: float) -> int:
        """The frame that is nearest to a time."""
        return int(np.abs(self.t[self.frames] - t).argmin())


def make_report_data(
    robot: Engine, motion: Motion, order: int, visuals: Path | None = None, folders: Sequence[Path] = ()
) -> ReportData:
    """Check the motion, and compute it and the forces up to an order at its times and at those that stand out.

    The URDF `visuals` shows the links.
    """
    m = robot.mechanism
    limits = joint_limits(m)
    checked = check(robot, motion) if known_kinds(robot, limits) else None
    rows = checked.table if checked else ()
    worst = np.array([row.t for row in rows])
    ends = np.array([end for row in rows for span in row.violations for end in span])
    breaks = np.array([found.t for found in motion.breaks])
    before = (breaks - BREAK_SIDE_SHARE * motion.duration).clip(motion.start)
    t = np.unique(np.concatenate([motion.times, worst, ends, breaks, before]))
    traced = along.forces_along(robot, motion, t, order, options=along.ForceOptions(row=effort_quantity(m)))
    shown = (
        (order + 1) * 2 + along.Q_RATE_ORDER + len(limits.without_gravity) + 1 + len(LIMIT_KINDS.motor)
    )  # quantities, at most
    count = int(np.clip(MAX_CURSOR_VALUES // (shown * m.tree.n), MIN_REPORT_FRAMES, MAX_REPORT_FRAMES))
    even = np.linspace(0, len(traced.t) - 1, min(count, len(traced.t))).astype(int)
    frames = np.union1d(even, np.searchsorted(traced.t, [*worst, *breaks[:count]]))
    with closed_path.name_errors_by_time(traced.t):
        near = closed_path.continue_positions(robot, motion, traced.t)
        quantities, at_frames = _quantities(robot, motion, traced, limits, frames, near)
        wrenches = _loop_wrenches(robot, motion, traced)
    factor = _slowdown(robot, motion, worst) if checked else None
    meshes = Meshes() if visuals is None else meshes_of(m, visuals, folders)
    where = quantities[LIMIT_KINDS.motion[0]].values if near is not None else traced.rates[0]
    return ReportData(
        robot, motion, traced, limits, quantities, at_frames, frames, checked, factor, meshes, wrenches, where[frames]
    )


def list_known(channel: Channel) -> list[int]:
    """The columns of a channel without NaN: the joints that have the quantity."""
    return [j for j, has in enumerate(~np.isnan(channel.values).any(axis=0)) if has]


def _slowdown(robot: Engine, motion: Motion, worst: np.ndarray) -> Slowdown | str:
    """The slow-down factor, or why it does not exist; of long motions by even steps and the times of worst values."""
    states = motion
    if len(motion.times) > MAX_SLOWDOWN_STATES:
        states = replace(motion, grid=np.union1d(np.linspace(motion.start, motion.stop, MAX_SLOWDOWN_STATES), worst))
    try:
        found = slowdown(robot, states)
        return found if found.binding else replace(found, motion=motion)
    except JounceError as error:
        return str(error)


def _quantities(
    robot: Engine, motion: Motion, traced: Along, limits: Limits, frames: np.ndarray, near: np.ndarray | None
) -> tuple[dict[str, Channel], dict[str, Channel]]:
    """The rates, the forces, and what else limits bound: forces without gravity, the power, forces at stall.

    They are at all times, and at the frames with their deviations.
    """
    m, count = robot.mechanism, len(traced.forces)
    forces = [_spread_drives(m, x) for x in drop_base(m, traced.forces, effort_quantity(m))]
    rates = joint_rates(robot, traced.rates, near)
    of_coordinates = motion.deviations(traced.t[frames], len(rates) - 1) or ()
    spread = [_spread_columns(m, m.independent_places, x) for x in of_coordinates]
    values = dict(zip(LIMIT_KINDS.motion, rates, strict=False)) | dict(zip(LIMIT_KINDS.effort, forces, strict=False))
    deviations = dict(zip(LIMIT_KINDS.motion, spread, strict=False))
    off = [_spread_drives(m, x)[frames] for x in drop_base(m, traced.deviations or (), effort_quantity(m))]
    deviations |= dict(zip(LIMIT_KINDS.effort, off, strict=False))
    units = joint_units(m)

    def channel(kind: str, values: np.ndarray, symbol: str = "", bounded: bool = True) -> Channel:
        row, off = LIMIT_KINDS[kind], deviations.get(kind)
        names = positions.extent_names(m.tree) if kind == LIMIT_KINDS.motion[0] else joint_names(m)
        bounds = limits.bounds(kind) if bounded else np.full((2, len(units)), [[-np.inf], [np.inf]])
        windows = () if off is None else (reliability.find_window(traced.t[frames], off, values[frames]),)
        of_kind = tuple(map(row.unit, units))
        return Channel(symbol or row.symbol, names, of_kind, traced.t, (values,), None, windows, bounds=(bounds,))

    found = {}
    for kind, x in values.items():
        whole = kind in limits.without_gravity  # of another force than the limit bounds
        found[LIMIT_KINDS[kind].symbol if whole else kind] = channel(kind, x, bounded=not whole)
    if motion.torques is not None:
        apart = _measured(motion, traced.t, m.independent_places, forces[0].shape) - forces[0]
        found[MEASURED_LESS_COMPUTED] = channel(LIMIT_KINDS.effort[0], apart, MEASURED_LESS_COMPUTED, bounded=False)
    inertial = [kind for kind in limits.without_gravity if kind in limits.kinds and kind in values]
    weight = closed_path.with_tree_positions(traced.rates[:count], near)
    gravity = compute(robot, "gravity_forces", weight, base=traced.base and traced.base[:count]) if inertial else ()
    gravity = [_spread_drives(m, x) for x in drop_base(m, gravity, effort_quantity(m))] if inertial else []
    bounded = limited_values(limits, rates, forces, gravity)
    for kind in inertial:
        symbol = " - ".join(rate_name(name, LIMIT_KINDS[kind].rate) for name in BOUNDED_FORCES[1].split(" - "))
        found[kind] = channel(kind, bounded[kind], symbol)
    if m.elasticity is not None and count > MAX_REPORT_ORDER:
        motors = _motors(robot, motion, traced.t)
        found |= {kind: channel(kind, _spread_drives(m, x)) for kind, x in motors.items()}
    found |= {kind: channel(kind, bounded[kind]) for kind in ("power", "stall_effort") if kind in limits.kinds}
    known = deviations | {LIMIT_KINDS[kind].symbol: x for kind, x in deviations.items()}  # of what is measured: not
    at_frames = {
        key: replace(of.rows(frames), deviations=(known[key],) if key in known else None) for key, of in found.items()
    }
    return found, at_frames


def _loop_wrenches(robot: Engine, motion: Motion, traced: Along) -> np.ndarray | None:
    if not robot.mechanism.takes_dependent:
        return None
    base = traced.base and traced.base[: along.Q_RATE_ORDER + 1]
    W, near = motion.wrench(traced.t, 0), closed_path.continue_positions(robot, motion, traced.t)
    return np.asarray(
        compute(
            robot,
            "loop_wrenches",
            closed_path.with_tree_positions(traced.rates[: along.Q_RATE_ORDER + 1], near),
            wrench=W,
            base=base,
        )
    )


def _measured(motion: Motion, t: np.ndarray, joints: Sequence[int], shape: tuple[int, ...]) -> np.ndarray:
    """The torques of a log at times, linear between its rows, as columns of all joints; NaN of those without."""
    assert motion.torques is not None
    whole = np.full(shape, np.nan)
    for j, column in zip(joints, motion.torques[1].T, strict=True):
        if (known := np.isfinite(column)).any():
            whole[:, j] = np.interp(t, motion.torques[0][known], column[known])
    return whole


def _spread_drives(m: Mechanism, x: np.ndarray) -> np.ndarray:
    """Columns of all joints from those of the drives: of the coordinates, or of actuated joints where these differ."""
    return _spread_columns(m, quantity_columns(m, effort_quantity(m)), x)


def _spread_columns(m: Mechanism, joints: Sequence[int], x: np.ndarray) -> np.ndarray:
    whole = np.full((len(x), m.tree.n), np.nan)
    whole[:, joints] = x
    return whole


def _motors(robot: Engine, motion: Motion, t: np.ndarray) -> dict[str, np.ndarray]:
    """What the motors of elastic joints do, by the kind of its limits; what is not known of all motors is left out.

    Joints with two motors need a stiffness over time, which a report is not given.
    """
    if joint_springs.elasticity_of(robot.mechanism).pairs:
        return {}
    found = motors_along(robot, motion, t)
    series = (*found.positions[:2], found.torques[0], *(x[0] for x in (found.currents, found.voltages) if x))
    return {kind: x for kind, x in zip(LIMIT_KINDS.motor, series, strict=False) if np.isfinite(x).all()}
