"""Compute forces along a motion piece by piece, with their deviations and the times at which they jump.

`forces_along` is the door. It joins what `compute_pieces` yields: some states at a time, so that working memory is
bounded and a callback reports the progress. Where a motion is measured, deviations of the forces follow from those of
q, W and the base to first order: forces are computed again with each entry off by its own deviation, at some times, and
interpolated between (`interpolate_deviations`). A `ForceBreak` is a time at which a rate of Q jumps; breaks come from
those of the motion, of loads and of the base, and from contacts that begin or end to carry (`find_force_breaks`).
`describe_break` says by names what jumps and why.
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
from jounce.motion.channel import Channel, print_channels
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
        """Standard deviations of the forces that follow from those of q, qd, ...; None where these are exact."""
        return self.efforts.deviations

    @property
    def breaks(self) -> tuple[ForceBreak, ...]:
        """Times at which Q or one of its rates jumps or does not exist, with order, jump and causes."""
        return tuple(found for found in self.efforts.breaks if isinstance(found, ForceBreak))

    @property
    def base(self) -> Rates | None:
        """C (N, 4, 4), V, Vd, ... (N, 6) of the motion at these times; None if it has no base."""
        return tuple(x[:, 0] for channel in self.base_motion for x in channel.rates) or None

    @property
    def wrenches(self) -> Rates | None:
        """The wrenches of contacts and their rates, (N, contacts, 6) each; None of motions without stances."""
        return None if self.contacts is None else self.contacts.rates

    @property
    def channels(self) -> tuple[Channel, ...]:
        """All channels: the coordinates, the forces, the base and the contacts."""
        return (*self.coordinates, self.efforts, *self.base_motion, *([self.contacts] if self.contacts else []))

    def __repr__(self) -> str:
        return print_channels("Along", self.channels)


def forces_along(
    robot: Engine,
    motion: object,
    t: ArrayLike | None = None,
    order: object = 2,
    method: str | None = None,
    progress: Progress | None = None,
    row: Quantity = DEFAULT_QUANTITY,
) -> Along:
    """Compute the forces and their rates at given times of a motion, or at its own times.

    `row` may be another quantity (n,) that takes as many rates of q or more, such as motor torques.
    """
    path, highest = check_motion(robot.mechanism, motion), check_order(order)
    if isinstance(motion, Motion) and motion.angles is not None:  # else they are judged already
        q, qd = path(np.linspace(path.start, path.stop, _UNIT_SAMPLES), 1)
        units.warn_of_degrees(q, qd, robot.mechanism, "the motion")
    times = path.times if t is None else path.checked(t)
    if times.ndim != 1 or not times.size:
        raise JounceError(
            f"t is {quote_value(t)}; expected an array (N,) of times in s, or None for those of the motion"
        )
    if progress is not None and not callable(progress):
        raise JounceError(f"progress is {quote_value(progress)}; expected a function of two numbers, (done, total)")
    parts = list(compute_pieces(robot, path, times, highest, method, progress, row))
    breaks = find_force_breaks(robot, path, times, highest, method, row)
    coordinates, base_motion = (
        tuple(map(Channel.join, zip(*channels, strict=True)))
        for channels in ([part.coordinates for part in parts], [part.base_motion for part in parts])
    )
    efforts = replace(Channel.join([part.efforts for part in parts]), breaks=breaks)
    return Along(coordinates, efforts, base_motion, _contact_wrenches(robot, path, times, highest, row))


def _contact_wrenches(robot: Engine, motion: Motion, times: np.ndarray, order: int, row: Quantity) -> Channel | None:
    """The wrenches of contacts with rates, of motions with stances."""
    if motion.presence is None or not robot.mechanism.contacts or not row.balanced:
        return None
    pieces = MotionStates.pieces(robot, motion, times, [(row, order)])
    wrenches = [states.compute(robot, "contact_wrenches") for _, states in pieces]
    rates = tuple(np.concatenate(terms) for terms in zip(*wrenches, strict=True))
    return motion_channels.contact_channel(robot.mechanism, times, rates)


def check_motion(mechanism: Mechanism, motion: object) -> Motion:
    """Check that a motion is one of the robot's joints, in rad where it is measured, and put it in their order."""
    if not isinstance(motion, Motion):
        raise JounceError(f"motion is {quote_value(motion)}; expected a jounce.Motion, as jounce.load_motion makes one")
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
    if path.angles is None:  # of a log, whose robot is known from here on
        t, q = path.samples or (path.times, path(path.times, 0)[0])
        units.check_angles(t, q, None, mechanism, "the motion", units.ANGLES_ARGUMENT_CURE)
        path = replace(path, angles="rad")
    if mechanism.contacts:
        contact_motion.refuse_sliding(mechanism, path)
    elif mechanism.floats and path.presence:
        raise JounceError(
            f"the motion has stances, and {mechanism.name!r} no contacts{Remedy('; state them: robot.contacts([...])')}"
        )
    return path


def compute_pieces(
    robot: Engine,
    motion: Motion,
    times: np.ndarray,
    order: int,
    method: str | None = None,
    progress: Progress | None = None,
    row: Quantity = DEFAULT_QUANTITY,
) -> Iterator[Along]:
    """Yield the forces along a motion in pieces of some states, without breaks.

    After each piece, `progress` is called with the number of states done and the total. A warning in the end counts
    rows without certain digits, which are NaN.
    """
    m = robot.mechanism
    uncertain: list[list[np.ndarray]] = []  # times of each piece, by order
    spread = interpolate_deviations(robot, motion, times, order, method, row)
    force_rate = row.takes.rates - 1
    windows = motion_channels.find_windows(motion, order + force_rate, force_rate)[force_rate:] if spread else ()
    breaks = motion.breaks
    for part, states in MotionStates.pieces(robot, motion, times, [(row, order)]):
        t = times[part]
        try:
            with contact_limits.unbalanced_at(t):
                forces = states.compute(robot, row.name, method)
        except UncertainError as error:
            forces = error.results
            uncertain.append([t[where] for where in error.uncertain])
        if progress is not None:
            progress(part.start + len(t), len(times))
        deviations = spread and spread(t)
        efforts = motion_channels.quantity_channel(m, row, t, forces, deviations, windows)
        base = () if states.base is None else motion_channels.base_channels(t, states.base)
        yield Along(motion_channels.coordinate_channels(m, t, states.rates, breaks=breaks), efforts, base)
    if uncertain:
        by_order = map(np.concatenate, zip(*uncertain, strict=True))
        warn(certain_digits.describe_uncertain(robot.mechanism, row.names(order), by_order, len(times)))


def find_force_breaks(
    robot: Engine,
    motion: Motion,
    times: np.ndarray,
    order: int,
    method: str | None = None,
    row: Quantity = DEFAULT_QUANTITY,
) -> tuple[ForceBreak, ...]:
    """Find the times between the first and the last given time at which the forces up to an order are not smooth."""
    known = [
        (t, tuple(causes))
        for t, causes in groupby(motion.breaks_to(order + row.takes.rates - 1), key=lambda found: found.t)
        if times.min() <= t <= times.max()
    ]
    own = row.takes
    taken = {"q": own.rates, "base": own.rates, "W": own.wrench_rates, "contact": 1}  # rates that it takes itself
    lowest = [min(cause.order - taken[cause.symbol] + 1 for cause in causes) for _, causes in known]
    t = np.array([t for t, _ in known])
    jumps = np.zeros((order + 1, len(t), entry_count(robot, row)))
    of_sides = (MotionStates.pieces(robot, motion, t, [(row, order)], side) for side in SIDES)
    for (part, left), (_, right) in zip(*of_sides, strict=True):
        with contact_limits.unbalanced_at(t[part]):
            before, after = (compute_certain(robot, states, method, row) for states in (left, right))
        size = np.maximum(np.abs(before), np.abs(after)).max(axis=2, keepdims=True)
        difference = np.subtract(after, before)
        jumps[:, part] = np.where(np.abs(difference) > _FORCE_JUMP_TOLERANCE * size, difference, 0)
    found = [
        ForceBreak(time, k, jumps[k, i], causes, tuple(jumps[k + 1 :, i]))
        if k >= 0
        else ForceBreak(time, -1, None, causes)
        for i, (k, (time, causes)) in enumerate(zip(lowest, known, strict=True))
    ]
    if order and row.balanced and contact_limits.are_limited(robot.mechanism):
        for start, stop in pairwise(np.unique(motion.stance_ends.clip(times.min(), times.max()))):
            part = np.unique([start, *times[(start < times) & (times < stop)], np.nextafter(stop, start)])
            found += [
                ForceBreak(t, 1, of[1], (), of[2:])
                for t, of in contact_motion.find_switches(robot, motion, part, row, order)
            ]
    return tuple(sorted(found, key=lambda x: x.t))


_MAX_PERTURBED_STATES = 200_000  # computed for deviations of forces, which change slowly: linear between fewer times


def compute_certain(robot: Engine, states: MotionStates, method: str | None, row: Quantity) -> Rates:
    """A quantity with its rates, NaN where no digits are certain."""
    try:
        return states.compute(robot, row.name, method)
    except UncertainError as error:
        return error.results


def entry_count(robot: Engine, row: Quantity) -> int:
    """The number of entries of a quantity for one state: n, or nv of the forces on a robot that floats."""
    [size] = Computation(row.name, 0).shape(robot.mechanism)
    return size


def interpolate_deviations(
    robot: Engine, motion: Motion, times: np.ndarray, order: int, method: str | None, row: Quantity
) -> Callable[[np.ndarray], Rates] | None:
    """The standard deviations of the forces over time: computed with each entry of q, W and the base off by its own.

    The rates are assumed independent, which overestimates slightly: the highest rates dominate.
    """
    highest = order + row.takes.rates - 1
    smoothed = [body for body, load in motion.loads.items() if load.deviations(times[:1], 0) is not None]
    on_base = motion.base_curve is not None and motion.base_curve.deviations(times[:1], 0) is not None
    if motion.deviations(times[:1], 0) is None and not smoothed and not on_base:
        return None
    every = np.unique(times)
    entries = motion.curve.columns + 7 * on_base + 6 * len(smoothed)
    count = max(2, _MAX_PERTURBED_STATES // (entries * (highest + 1)))
    t = every[np.unique(np.linspace(0, len(every) - 1, min(count, len(every))).astype(int))]
    total = np.zeros((order + 1, len(t), entry_count(robot, row)))
    for part, states in MotionStates.pieces(robot, motion, t, [(row, order)]):
        true = np.array(compute_certain(robot, states, method, row))
        for moved in _perturb_states(motion, t[part], states):
            if moved.near is not None:
                near = loop_closure.close_loops(robot.mechanism, moved.rates[0], moved.near, closing_step(robot))
                moved = replace(moved, near=near)
            found = np.array(compute_certain(robot, moved, method, row))
            total[:, part] += (found - true) ** 2
    certain = np.isfinite(total).all(axis=(0, 2))
    t, known = (t[certain], np.sqrt(total[:, certain])) if certain.any() else (t, np.sqrt(total))

    def interpolate(times: np.ndarray) -> Rates:
        return tuple(np.stack([np.interp(times, t, column) for column in rate.T], axis=1) for rate in known)

    return interpolate


def with_vibration_notes(motion: Motion, robot: Engine) -> Motion:
    """The motion, with notes of what vibrations of its samples mean in Q2d, for robots of joints alone."""
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
    """States at times with each entry of q, W and the base off by its standard deviation, one by one."""
    highest, W = len(states.rates) - 1, states.wrench or ()
    for q in perturb_rates(motion.curve, t, highest, partial(compute_states, motion.several)):
        yield replace(states, rates=q)
    for k, by_body in enumerate(motion.wrench_deviations(t, len(W) - 1) if W else ()):
        for body, off in by_body.items():
            for j in np.flatnonzero(off.any(axis=0)).tolist():
                moved = {**W[k], body: W[k][body] + off * (np.arange(6) == j)}
                yield replace(states, wrench=(*W[:k], moved, *W[k + 1 :]))
    for base in perturb_rates(motion.base_curve, t, highest, compute_base_motion) if motion.base_curve else ():
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


def describe_break(found: ForceBreak, joints: Sequence[str], names: Sequence[str]) -> DescribedBreak:
    """A break by the names of forces (nv) and of the rates of Q."""
    jumps = names[found.order] if found.order >= 0 else None
    by = None if found.jump is None else dict(zip(joints, found.jump.tolist(), strict=True))
    causes = {
        str(cause.joint): BreakCause(rate_name(_cause_symbol(cause), cause.order), cause.jump) for cause in found.causes
    }
    return DescribedBreak(found.t, jumps, by, tuple(names[found.order + 1 :]), causes)


def _cause_symbol(cause: Break) -> str:
    """q, W or, of the base, the entry that jumps: x of base.x."""
    return str(cause.joint).rpartition(".")[2] if cause.symbol == "base" else cause.symbol
