"""Every limit along a motion: the worst values, between samples too, and when limits are broken."""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from jounce.errors import listed, quoted
from jounce.limits.bounded import DERIVATIVE, Bounded, bounded, rate_of_forces
from jounce.limits.joints import in_columns, joint_units, of_joints
from jounce.limits.pieces import pieces_of
from jounce.limits.worst import ROUNDING, Worst
from jounce.model.coordinates import following_efforts
from jounce.model.limits import EFFORT_KINDS, MOTION_KINDS, MOTOR_KINDS, in_words, unit_of
from jounce.robot.along import ForceBreak, force_breaks, forces_along
from jounce.spatial.series import rate_name

if TYPE_CHECKING:
    from jounce.robot.robot import Robot


@dataclass(frozen=True)
class CheckedLimit:
    """One limit of one coordinate along a motion, at the time when it is nearest or farthest beyond.

    Attributes
    ----------
    joint, limit : str
        The coordinate, and the kind of limit: "position", "velocity", ..., "effort", "effort_rate", ..., "power".
    of : str or None
        Which force an effort limit bounds: "Q" or "Q - Qgrav".
    unit : str
        The unit of `value`, `bound` and `margin`.
    value, bound : float
        The worst value, and the bound on its side; infinite where a lower rate jumps.
    ratio : float
        Above 1 where the limit is broken: value / bound, for positions measured from the middle of their range.
    margin : float
        How far the value stays from the bound, negative where it is beyond.
    t : float
        When, s.
    deviation : float or None
        Standard deviation of the ratio, for measured motions.
    violations : tuple of (start, stop)
        When the limit is broken, s.

    Examples
    --------
    >>> import jounce
    >>> robot = jounce.load("planar2r").with_limits(velocity=1.0)
    >>> robot.check(jounce.Motion.polynomial([[0, 2], [0, 0.5]], duration=1.0)).worst.ratio
    2.0
    """

    joint: str
    limit: str
    of: str | None
    unit: str
    value: float
    bound: float
    ratio: float
    margin: float
    t: float
    deviation: float | None
    violations: tuple[tuple[float, float], ...]

    @property
    def ok(self) -> bool:
        """Whether the motion keeps the limit, to rounding."""
        return self.ratio <= 1 + ROUNDING

    @property
    def words(self) -> str:
        """The kind of limit in words, and the force that it bounds unless that is Q."""
        return in_words(self.limit, self.of)

    def __str__(self) -> str:
        of = f" of {self.of}" if self.of else ""
        numbers = f"{self.value:.6g} of {self.bound:.6g} {self.unit}"
        when = f"at t = {self.t:.6g} s, ratio {self.ratio:.4g}"
        return f"{self.limit.replace('_', ' ')}{of} of {self.joint}: {numbers} {when}"


@dataclass(frozen=True, repr=False)
class Check:
    """Every limit of a robot along a motion. `Robot.check` makes one.

    Attributes
    ----------
    table : tuple of CheckedLimit
        Each limit of each coordinate that is stated, in the order of the coordinates.
    breaks : tuple of ForceBreak
        Where Q or one of its rates jumps or does not exist; none where no force is limited.
    notes : tuple of str
        What cannot be met or is not checked, in words.

    Examples
    --------
    >>> import jounce
    >>> robot = jounce.load("panda", lock={"panda_finger_joint1": 0.0})
    >>> home = [0, -0.785, 0, -2.356, 0, 1.571, 0.785]
    >>> motion = jounce.Motion.trapezoidal([home, [q + 0.5 for q in home]], 1.0, 5.0)
    >>> found = robot.check(motion)
    >>> found.ok, found.worst.joint, found.worst.limit
    (True, 'panda_joint4', 'position')
    """

    table: tuple[CheckedLimit, ...]
    breaks: tuple[ForceBreak, ...] = ()
    notes: tuple[str, ...] = ()

    def __repr__(self) -> str:
        broken = sum(not row.ok for row in self.table)
        return f"<Check: {broken} of {len(self.table)} limits broken; worst: {self.worst}>"

    def _repr_html_(self) -> str:
        from jounce.figures import displays

        return displays.check(self)

    @property
    def ok(self) -> bool:
        """Whether the motion keeps every limit."""
        return all(row.ok for row in self.table)

    @property
    def worst(self) -> CheckedLimit:
        """The limit with the largest ratio."""
        return max(self.table, key=lambda row: row.ratio)


def check(robot: "Robot", motion: object) -> Check:
    """Every limit of a robot along a motion."""
    b = bounded(robot, motion)
    worst = Worst(b)
    for pieces in pieces_of(b):
        worst.take(pieces)
    breaks = breaks_of(b)
    worst.take_jumps(breaks)
    return Check(_table(b, worst), breaks, notes_of(b, breaks))


def breaks_of(b: Bounded) -> tuple[ForceBreak, ...]:
    """Where the forces that are limited are not smooth."""
    return force_breaks(b.robot, b.motion, b.motion.times, b.force_order, row=b.efforts) if b.forces else ()


def _table(b: Bounded, worst: Worst) -> tuple[CheckedLimit, ...]:
    rows = []
    units = joint_units(b.robot.mechanism)
    for j, joint in enumerate(b.joints):
        for kind in b.kinds:
            scale = worst.scales[kind]
            if not np.isfinite(b.limits.bounds(kind)[:, j]).any():
                continue
            at = np.array([j])
            ratios = {sign: float(scale.ratio(sign * worst.value[kind, sign][at], sign, at)[0]) for sign in (1, -1)}
            sign = max(ratios, key=lambda sign: ratios[sign])
            value, bound = sign * float(worst.value[kind, sign][j]), sign * float(scale.bound(sign)[j])
            rows.append(CheckedLimit(
                joint=joint,
                limit=kind,
                of=b.limits.of(kind) if kind in EFFORT_KINDS else None,
                unit=unit_of(kind, units[j]),
                value=value,
                bound=bound,
                ratio=ratios[sign],
                margin=sign * (bound - value),
                t=float(worst.t[kind, sign][j]),
                deviation=None,
                violations=tuple(sorted(worst.spans[kind, 1][j] + worst.spans[kind, -1][j])),
            ))  # fmt: skip
    return _with_deviations(b, worst, rows)


def _with_deviations(b: Bounded, worst: Worst, rows: list[CheckedLimit]) -> tuple[CheckedLimit, ...]:
    """The rows with standard deviations of their ratios, where the motion has those of its rates."""
    t = np.array([row.t for row in rows])
    motion = b.motion.deviations(t, b.rate_order)
    if motion is None:
        return tuple(rows)
    m, names = b.robot.mechanism, b.robot.joint_names
    rates = b.rates(t, 1)
    along = forces_along(b.robot, b.motion, t, b.force_order, None, None, b.efforts) if b.forces else None
    spread, Q = (
        in_columns(m, of_joints(m, found, b.efforts), b.efforts)
        for found in ((along.deviations or (), along.forces) if along else ((), ()))
    )
    found = []
    for i, row in enumerate(rows):
        j = b.joints.index(row.joint)
        own = names.index(row.joint) if row.joint in names else None
        if row.limit in MOTOR_KINDS or (own is None and row.limit in (*MOTION_KINDS, "power")):
            found.append(row)
            continue
        if row.limit in MOTION_KINDS:
            deviation = motion[MOTION_KINDS.index(row.limit)][i, own]
        elif row.limit == "power":
            deviation = np.hypot(rates[1][i, j] * spread[0][i, j], Q[0][i, j] * motion[1][i, own])
        else:
            deviation = spread[DERIVATIVE[row.limit]][i, j]
        reach = abs(row.bound - float(worst.scales[row.limit].centre[j]))
        found.append(replace(row, deviation=float(deviation) / reach if reach else None))
    return tuple(found)


def notes_of(b: Bounded, breaks: tuple[ForceBreak, ...]) -> tuple[str, ...]:
    """What the motion cannot meet because it is not smooth, and which limits nothing is checked against."""
    notes = []
    orders = {kind: rate_of_forces(b.robot, kind) for kind in b.kinds if kind not in MOTION_KINDS}
    missed = [found for found in breaks if found.order < max(orders.values(), default=0)]
    if missed:
        first = missed[0]
        joints = b.robot.joint_names
        names = listed([joints[j] if isinstance(j := cause.joint, int) else j for cause in first.causes])
        more = f" (and at {len(missed) - 1} more times)" if len(missed) > 1 else ""
        jumps = rate_name("Q", max(first.order, 0)) if first.order >= 0 else "qd"
        limits = " and ".join(kind.replace("_", " ") for kind, k in orders.items() if k > max(first.order, 0))
        came = f"break at t = {first.t:.9g} s{more}: {jumps} jumps because of {names}"
        notes.append(f"{came}; no limit of {limits} can be met there; motion.blended (--blend) replaces breaks")
    if b.window != (b.motion.start, b.motion.stop):
        start, stop = b.window
        notes.append(
            f"looked at from t = {start:.6g} to {stop:.6g} s: rates of the samples are uncertain at their ends"
        )
    if idle := [kind.replace("_", " ") for kind in b.limits.kinds if kind not in b.kinds]:
        notes.append(f"limits of {listed(idle)} are not checked: the joints are rigid; see robot.elastic(stiffness)")
    for joint in following_efforts(b.robot.mechanism):
        notes.append(f"effort limits of joint {quoted(joint)} are not checked: it follows another, which Q belongs to")
    return tuple(notes)
