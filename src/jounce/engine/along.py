"""Compute forces along a motion, with their deviations and breaks.

`forces_along` is the door. It joins what `compute_pieces` yields: some states at a time, so that working memory is
bounded and a callback reports the progress. Where a motion is measured, deviations of the forces follow from those of
q, W and the base to first order: forces are computed again with each entry off by its own deviation, once per motion
and at some times only, and interpolated between (`interpolate_deviations`). A `ForceBreak` is a time at which a rate of
Q jumps; breaks come from those of the motion, of loads and of the base, and from contacts that begin or end to carry
(`find_force_breaks`). `describe_break` says by names what jumps and why.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import groupby, pairwise
from typing import NamedTuple

import numpy as np

from jounce.arguments.rates import check_order
from jounce.core.cures import Remedy
from jounce.core.display import HtmlDisplay
from jounce.core.errors import JounceError, UncertainError, locate_errors, quote_value, warn
from jounce.core.typing import ArrayLike
from jounce.dynamics import loop_closure
from jounce.dynamics.computation import Computation
from jounce.dynamics.quantities import DEFAULT_QUANTITY, Quantity
from jounce.engine import certain_digits, contact_limits, contact_motion, motion_channels
from jounce.engine.backends import closing_step
from jounce.engine.engine import Engine
from jounce.engine.motion_states import MotionStates, Rates, Side
from jounce.engine.plan import compute
from jounce.model import positions
from jounce.model.mechanism import Mechanism
from jounce.motion import units, vibrations
from jounce.motion.base import compute_base_motion, compute_states, perturb_rates
from jounce.motion.channel import Channel, Span, print_channels
from jounce.motion.joint_matching import match_joints
from jounce.motion.motion import Break, Motion
from jounce.motion.sample_curves import SmoothedCurve
from jounce.spatial.series import rate_name

POSES_OF_BASE = Remedy(
    ", motion.with_base(t, C) gives it poses C (N, 4, 4), or one pose with t=None, and"
    " robot.contacts([...]).project(motion) that of feet that stay"
)
_UNIT_SAMPLES = 200  # even times of a motion by which its unit, rad or degrees, is judged
_FORCE_JUMP_TOLERANCE = 1e-12  # of the largest rate of all joints: smaller differences at a break are rounding
Q_RATE_ORDER = DEFAULT_QUANTITY.takes.rates - 1  # the order of the rate of q that Q itself takes: q2d
SIDES: tuple[Side, Side] = ("left", "right")  # of a break: before it and after it
Progress = Callable[[int, int], object]  # of the number of states done, and of all


@dataclass(frozen=True)
class ForceOptions:
    """What is computed along a motion, and who hears of progress.

    `row` may be another quantity (n,) than the forces that takes as many rates of q or more, such as motor torques.
    """

    method: str | None = None
    progress: Progress | None = None
    row: Quantity = DEFAULT_QUANTITY

    def __post_init__(self) -> None:
        if self.progress is not None and not callable(self.progress):
            raise JounceError(
                f"progress is {quote_value(self.progress)}; expected a function of two numbers, (done, total)"
            )


_DEFAULT_OPTIONS = ForceOptions()


class ForceBreak(NamedTuple):
    """A time at which the forces are not smooth: a rate of Q jumps, and higher rates do not exist.

    `order` is the order of the rate that jumps (0 is Q), `jump` (nv,) the size of the jump; they are -1 and None if q
    or qd jumps, so that Q itself does not exist. `causes` are the breaks of the motion at this time; none where a
    contact's friction or sole begins or ends to limit its wrench. `higher` (nv,) are the jumps of the rates after it:
    a joint whose Q does not jump may have a Qd that does.
    """

    t: float
    order: int
    jump: np.ndarray | None
    causes: tuple[Break, ...]
    higher: tuple[np.ndarray, ...] = ()


@dataclass(frozen=True, eq=False, repr=False)
class Along(HtmlDisplay):
    """The forces along a motion, and the states that they belong to. `Robot.forces_along` makes one.

    It holds channels; `t`, `rates`, `forces`, ... are the arrays in them.

    Attributes
    ----------
    coordinates : tuple of Channel
        q with its rates; of robots with joints of several screws q alone, and qd with its rates.
    efforts : Channel
        Q with its rates, deviations and breaks.
    base_motion : tuple of Channel
        The pose C of the base, and its twist V with its rates; empty if the motion has no base.
    contacts : Channel or None
        Of motions with stances, what `Robot.contact_wrenches` is, with rates; 0 of contacts that are not there.

    Examples
    --------
    >>> import jounce
    >>> robot = jounce.load("planar2r")
    >>> motion = jounce.load_motion({"t": range(9), "joint1": [0.1] * 9, "joint2": [0.2] * 9}, robot, 0, degree=7)
    >>> along = robot.forces_along(motion, order=0)
    >>> along.forces[0].shape
    (9, 2)
    """

    coordinates: tuple[Channel, ...]
    efforts: Channel
    base_motion: tuple[Channel, ...] = ()
    contacts: Channel | None = None

    @property
    def t(self) -> np.ndarray:
        """Times (N,) in s."""
        return self.efforts.times

    @property
    def rates(self) -> Rates:
        """q, qd, q2d, ... of the motion, (N, n) each: rad or m, per s, per s^2, ...; at a break those after it."""
        return tuple(x for channel in self.coordinates for x in channel.rates)

    @property
    def forces(self) -> Rates:
        """Q, Qd, ..., (N, nv) each: N m for revolute and N for prismatic coordinates, per s, ...

        If the robot floats, the first 6 columns are the wrench (moment; force) that acts on its base, in its axes. NaN
        where loops are so nearly singular that no digits are certain: a `JounceWarning` counts these rows.
        """
        return self.efforts.rates

    @property
    def deviations(self) -> Rates | None:
        """Standard deviations of the forces, by those of q, qd, ...

        They are None where these are exact.
        """
        return self.efforts.deviations

    @property
    def breaks(self) -> tuple[ForceBreak, ...]:
        """Times at which Q or its rates jump, with causes."""
        return tuple(x for x in self.efforts.breaks if isinstance(x, ForceBreak))

    @property
    def base(self) -> Rates | None:
        """The motion C, V, ... of the base, or None.

        C is (N, 4, 4), the others are (N, 6).
        """
        terms = tuple(x[:, 0] for channel in self.base_motion for x in channel.rates)
        return None if len(terms) == 0 else terms

    @property
    def wrenches(self) -> Rates | None:
        """The wrenches of contacts with rates, (N, contacts, 6) each.

        They are None without stances.
        """
        return None if self.contacts is None else self.contacts.rates

    @property
    def channels(self) -> tuple[Channel, ...]:
        """All channels: the coordinates, the forces, the base and the contacts."""
        contacts = () if self.contacts is None else (self.contacts,)
        return (*self.coordinates, self.efforts, *self.base_motion, *contacts)

    def __repr__(self) -> str:
        return print_channels("Along", self.channels)


def forces_along(
    robot: Engine,
    motion: object,
    t: ArrayLike | None = None,
    order: object = 2,
    *,
    options: ForceOptions = _DEFAULT_OPTIONS,
) -> Along:
    """Compute the forces and their rates at times of a motion.

    By default, these are times of the motion itself.
    """
    path, highest = check_motion(robot.mechanism, motion), check_order(order)
    # Of other motions, `check_motion` has judged the unit.
    if isinstance(motion, Motion) and motion.angles is not None:
        q, qd = path(np.linspace(path.start, path.stop, _UNIT_SAMPLES), 1)
        units.warn_of_degrees(q, qd, robot.mechanism, "the motion")
    times = path.times if t is None else path.checked(t)
    if times.ndim != 1 or times.size == 0:
        raise JounceError(
            f"t is {quote_value(t)}; expected an array (N,) of times in s, or None for those of the motion"
        )
    parts = list(compute_pieces(robot, path, times, highest, options=options))
    breaks = find_force_breaks(robot, path, times, highest, options=options)
    # The pieces of each channel become one channel of all times.
    coordinates, base_motion = (
        tuple(map(Channel.join, zip(*channels, strict=True)))
        for channels in ([part.coordinates for part in parts], [part.base_motion for part in parts])
    )
    efforts = replace(Channel.join([part.efforts for part in parts]), breaks=breaks)
    return Along(coordinates, efforts, base_motion, _contact_wrenches(robot, path, times, highest, options.row))


def _contact_wrenches(robot: Engine, motion: Motion, times: np.ndarray, order: int, row: Quantity) -> Channel | None:
    """Compute the wrenches of contacts with rates, of motions with stances."""
    if motion.presence is None or not robot.mechanism.contacts or not row.balanced:
        return None
    pieces = MotionStates.pieces(robot, motion, times, [(row, order)])
    wrenches = [states.compute(robot, "contact_wrenches") for _, states in pieces]
    rates = tuple(np.concatenate(terms) for terms in zip(*wrenches, strict=True))
    return motion_channels.contact_channel(robot.mechanism, times, rates)


def check_motion(mechanism: Mechanism, motion: object) -> Motion:
    """Check that a motion fits the robot, and order its joints.

    Angles of a log have to be in rad, and feet have to stay where contacts are.
    """
    if not isinstance(motion, Motion):
        raise JounceError(
            f"motion is {quote_value(motion)}; expected a jounce.Motion, as jounce.load_motion makes one, and"
            " jounce.Motion.waypoints of points without times"
        )
    if not mechanism.is_numeric:
        raise JounceError(
            f"{mechanism.name!r} has symbols in its data; expected numbers, which motions and their limits take:"
            " methods of one state, such as inverse_dynamics, take symbols"
        )
    with locate_errors("the motion"):
        if mechanism.floats and motion.base_curve is None:
            raise JounceError(
                f"{mechanism.name!r} floats, and the motion has no base; columns base.x, ..., base.qz of a table state"
                f" one{POSES_OF_BASE}"
            )
        path = match_joints(motion, mechanism)
    # A log has no unit until its robot is known. Its samples show the unit best, if it still has them.
    if path.angles is None:
        t, q = (path.times, path(path.times, 0)[0]) if path.samples is None else path.samples
        units.check_angles(t, q, None, mechanism, "the motion", units.ANGLES_ARGUMENT_CURE)
        path = replace(path, angles="rad")
    if mechanism.contacts:
        contact_motion.refuse_sliding(mechanism, path)
    elif mechanism.floats and path.presence is not None:
        raise JounceError(
            f"the motion has stances, and {mechanism.name!r} no contacts{Remedy('; state them: robot.contacts([...])')}"
        )
    return path


def compute_pieces(
    robot: Engine,
    motion: Motion,
    times: np.ndarray,
    order: int,
    *,
    options: ForceOptions = _DEFAULT_OPTIONS,
) -> Iterator[Along]:
    """Yield the forces along a motion in pieces, without breaks.

    After each piece, `progress` is called with the number of states done and the total. A warning in the end counts
    rows without certain digits, which are NaN.
    """
    m, row = robot.mechanism, options.row
    # The times of each piece at which results are uncertain, by order.
    uncertain: list[list[np.ndarray]] = []
    # Once per motion: deviations over time, and windows in which a measured motion is known well. Q is known where the
    # highest rate of q that it takes is, hence the windows of the rates from there on.
    deviations_at = interpolate_deviations(robot, motion, times, order, options=options)
    force_rate = row.takes.rates - 1
    windows: tuple[Span, ...] = ()
    if deviations_at is not None:
        windows = motion_channels.find_windows(motion, order + force_rate, force_rate)[force_rate:]
    breaks = motion.breaks
    for part, states in MotionStates.pieces(robot, motion, times, [(row, order)]):
        t = times[part]
        try:
            with contact_limits.unbalanced_at(t):
                forces = states.compute(robot, row.name, options.method)
        # Along a motion, single uncertain rows are no error.
        except UncertainError as error:
            forces = error.results
            uncertain.append([t[is_uncertain] for is_uncertain in error.uncertain])
        if options.progress is not None:
            options.progress(part.start + len(t), len(times))
        deviations = None if deviations_at is None else deviations_at(t)
        efforts = motion_channels.quantity_channel(m, row, t, forces, deviations, windows)
        base = () if states.base is None else motion_channels.base_channels(t, states.base)
        yield Along(motion_channels.coordinate_channels(m, t, states.rates, breaks=breaks), efforts, base)
    if len(uncertain) > 0:
        by_order = map(np.concatenate, zip(*uncertain, strict=True))
        warn(certain_digits.describe_uncertain(robot.mechanism, row.names(order), by_order, len(times)))


def find_force_breaks(
    robot: Engine,
    motion: Motion,
    times: np.ndarray,
    order: int,
    *,
    options: ForceOptions = _DEFAULT_OPTIONS,
) -> tuple[ForceBreak, ...]:
    """Find the times at which forces or their rates jump.

    Only times between the first and the last given one count.
    """
    row = options.row
    # Breaks of the motion at one time have one effect: they are its causes together.
    breaks = [
        (t, tuple(causes))
        for t, causes in groupby(motion.breaks_to(order + row.takes.rates - 1), key=_time_of_break)
        if times.min() <= t <= times.max()
    ]
    # A jump of the k-th rate of an input of which Q itself takes r rates, the value among them, makes the rate
    # k - r + 1 of Q jump. The lowest one counts: higher ones do not exist there, and at -1 Q itself does not.
    needs = row.takes
    input_rates = {"q": needs.rates, "base": needs.rates, "W": needs.wrench_rates, "contact": 1}
    lowest = [min(cause.order - input_rates[cause.symbol] + 1 for cause in causes) for _, causes in breaks]
    t = np.array([t for t, _ in breaks])
    # (order + 1, breaks, entries): the values after each break less those before it.
    jumps = np.zeros((order + 1, len(t), entry_count(robot, row)))
    pieces_by_side = (MotionStates.pieces(robot, motion, t, [(row, order)], side) for side in SIDES)
    for (part, states_before), (_, states_after) in zip(*pieces_by_side, strict=True):
        with contact_limits.unbalanced_at(t[part]):
            before, after = (compute_certain(robot, states, options) for states in (states_before, states_after))
        # Differences that are rounding of the largest entry are no jumps.
        size = np.maximum(np.abs(before), np.abs(after)).max(axis=2, keepdims=True)
        difference = np.subtract(after, before)
        jumps[:, part] = np.where(np.abs(difference) > _FORCE_JUMP_TOLERANCE * size, difference, 0)
    force_breaks = [
        ForceBreak(time, k, jumps[k, i], causes, tuple(jumps[k + 1 :, i]))
        if k >= 0
        else ForceBreak(time, -1, None, causes)
        for i, (k, (time, causes)) in enumerate(zip(lowest, breaks, strict=True))
    ]
    # Between two ends of stances, rows of limits begin or end to be active: Q is continuous there, and Qd jumps.
    if order > 0 and row.balanced and contact_limits.are_limited(robot.mechanism):
        for start, stop in pairwise(np.unique(motion.stance_ends.clip(times.min(), times.max()))):
            # At `stop` itself other contacts carry: the last time is just before it.
            part = np.unique([start, *times[(start < times) & (times < stop)], np.nextafter(stop, start)])
            force_breaks += [
                ForceBreak(t, 1, switch_jumps[1], (), switch_jumps[2:])
                for t, switch_jumps in contact_motion.find_switches(robot, motion, part, row, order)
            ]
    return tuple(sorted(force_breaks, key=_time_of_break))


def _time_of_break(x: Break | ForceBreak) -> float:
    return x.t


_MAX_PERTURBED_STATES = 200_000  # computed for deviations of forces, which change slowly: linear between fewer times


def compute_certain(robot: Engine, states: MotionStates, options: ForceOptions) -> Rates:
    """Compute a quantity with its rates, NaN where no digits are certain."""
    try:
        return states.compute(robot, options.row.name, options.method)
    except UncertainError as error:
        return error.results


def entry_count(robot: Engine, row: Quantity) -> int:
    """Return the number of entries of a quantity for one state.

    It is n, or nv of the forces on a robot that floats.
    """
    [size] = Computation(row.name, 0).shape(robot.mechanism)
    return size


def interpolate_deviations(
    robot: Engine, motion: Motion, times: np.ndarray, order: int, *, options: ForceOptions = _DEFAULT_OPTIONS
) -> Callable[[np.ndarray], Rates] | None:
    """Return standard deviations of the forces as functions of time.

    They are None if the motion is exact. They are sums of squares of what changes if each entry of q, W and the
    base is off by its own deviation. The rates are assumed independent, which overestimates slightly: the highest
    rates dominate.
    """
    row = options.row
    highest = order + row.takes.rates - 1
    smoothed = [body for body, load in motion.loads.items() if load.deviations(times[:1], 0) is not None]
    on_base = motion.base_curve is not None and motion.base_curve.deviations(times[:1], 0) is not None
    if motion.deviations(times[:1], 0) is None and len(smoothed) == 0 and not on_base:
        return None
    # Each entry and rate takes one more computation of all states: few times are computed where there are many.
    distinct_times = np.unique(times)
    entries = motion.curve.columns + 7 * on_base + 6 * len(smoothed)
    count = max(2, _MAX_PERTURBED_STATES // (entries * (highest + 1)))
    t = distinct_times[np.unique(np.linspace(0, len(distinct_times) - 1, min(count, len(distinct_times))).astype(int))]
    # Variances, (order + 1, times, entries).
    total = np.zeros((order + 1, len(t), entry_count(robot, row)))
    for part, states in MotionStates.pieces(robot, motion, t, [(row, order)]):
        nominal = np.array(compute_certain(robot, states, options))
        for perturbed in _perturb_states(motion, t[part], states):
            # Other independent coordinates need other dependent ones, on the same branch.
            if perturbed.near is not None:
                near = loop_closure.close_loops(
                    robot.mechanism, perturbed.rates[0], perturbed.near, closing_step(robot)
                )
                perturbed = replace(perturbed, near=near)
            total[:, part] += (np.array(compute_certain(robot, perturbed, options)) - nominal) ** 2
    # Rows without certain digits are left out, if any are left: deviations between others stand for theirs.
    certain = np.isfinite(total).all(axis=(0, 2))
    if certain.any():
        t, total = t[certain], total[:, certain]
    deviations = np.sqrt(total)

    def interpolate(times: np.ndarray) -> Rates:
        """Return the deviations at times (N,), (N, entries) for each order."""
        return tuple(np.stack([np.interp(times, t, column) for column in rate.T], axis=1) for rate in deviations)

    return interpolate


def with_vibration_notes(motion: Motion, robot: Engine) -> Motion:
    """Return the motion with notes on what vibrations do to Q2d.

    Motions of floating and closed robots, and of joints of several screws, have none.
    """
    mechanism, curve = robot.mechanism, motion.curve
    if (
        not isinstance(curve, SmoothedCurve)
        or mechanism.floats
        or mechanism.loops
        or positions.multiscrew_joints(mechanism)
    ):
        return motion

    def mass_matrices(t: np.ndarray) -> np.ndarray:
        return np.asarray(compute(robot, "mass_matrix", curve.rates(t, 0)))

    notes = [
        vibrations.describe_force_rates(vibration, mass_matrices, mechanism.coordinates)
        for vibration in curve.fit.vibrations
    ]
    return replace(motion, notes=(*motion.notes, *notes))


def _perturb_states(motion: Motion, t: np.ndarray, states: MotionStates) -> Iterator[MotionStates]:
    """Yield the states with one entry off by its deviation.

    Entries of q, W and the base are moved one by one.
    """
    highest, W = len(states.rates) - 1, () if states.wrench is None else states.wrench
    for q in perturb_rates(motion.curve, t, highest, partial(compute_states, motion.several)):
        yield replace(states, rates=q)
    # Component j of the k-th rate of the wrench on a body, at all times together.
    for k, by_body in enumerate(motion.wrench_deviations(t, len(W) - 1) if len(W) > 0 else ()):
        for body, deviations in by_body.items():
            for j in np.flatnonzero(deviations.any(axis=0)).tolist():
                perturbed = {**W[k], body: W[k][body] + deviations * (np.arange(6) == j)}
                yield replace(states, wrench=(*W[:k], perturbed, *W[k + 1 :]))
    if motion.base_curve is not None:
        for base in perturb_rates(motion.base_curve, t, highest, compute_base_motion):
            yield replace(states, base=base)


class BreakCause(NamedTuple):
    """Which rate of a joint jumps, and by how much."""

    rate: str
    by: float


@dataclass(frozen=True)
class DescribedBreak:
    """A break of forces by names: which rate of Q jumps, by how much at each joint, which do not exist, and why."""

    t: float
    jumps: str | None
    by: Mapping[str, float] | None
    missing: tuple[str, ...]
    causes: Mapping[str, BreakCause]


def describe_break(x: ForceBreak, joints: Sequence[str], names: Sequence[str]) -> DescribedBreak:
    """Describe a break by names of forces and rates."""
    jumps = names[x.order] if x.order >= 0 else None
    by = None if x.jump is None else dict(zip(joints, x.jump.tolist(), strict=True))
    causes = {
        str(cause.joint): BreakCause(rate_name(_cause_symbol(cause), cause.order), cause.jump) for cause in x.causes
    }
    return DescribedBreak(x.t, jumps, by, tuple(names[x.order + 1 :]), causes)


def _cause_symbol(cause: Break) -> str:
    """Return q, W or, of the base, the entry that jumps: x of base.x."""
    return str(cause.joint).rpartition(".")[2] if cause.symbol == "base" else cause.symbol
