"""Robots at rest: positions and torques of poses, from rows of a table or from the holds of a log.

A hold is a stretch in which no joint leaves a range of MAX_REST_RANGE within any MIN_HOLD_SECONDS: slower than that,
what a joint makes beyond gravity is far below friction. `find_holds` averages positions and torques over each hold,
and finds from which side each joint came, as the friction that remains at rest has that sign. Holds between which no
joint moves are one pose. A joint that creeps through its range within a hold drifts, and so do joints that are slow for
as long as a hold, and never rest: such logs are refused, as nobody knows whether these stretches were meant as poses.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from jounce.core import errors, scalars
from jounce.core.cures import Remedy
from jounce.core.errors import JounceError, check_choice, quote_value, shorten
from jounce.core.typing import ArrayLike
from jounce.motion import noise

MIN_HOLD_SECONDS = 0.5  # arms settle within half of it, and the torques of the other half are averaged
MAX_REST_RANGE = 1e-3  # rad or m within such a time: 2 mrad/s, at which viscous friction is next to nothing
MAX_DRIFT_RANGES = 5.0  # such ranges in that time: faster joints move from pose to pose, slower ones drift
MAX_REST_STEPS = 3.0  # steps of an encoder at rest, if these are larger: the last digit may go to either side
MIN_HOLD_ROWS = 5  # in such a time: fewer rows hide motion between them
MAX_GAP_SHARE = 2.0  # of such a time that its rows may last: where rows are missing, nobody knows what moved
MAX_ENCODER_STEP = 7e-3  # rad or m: encoders of 10 bits have 6e-3, and what is coarser is no encoder


@dataclass(frozen=True, eq=False, repr=False)
class Poses:
    """A robot at rest in N poses, with measured torques. `jounce.load_poses` reads them.

    Attributes
    ----------
    q : (N, n)
        Positions of the joints, rad or m.
    torques : (N, n)
        Torques measured there, N m or N; NaN where a joint has none.
    joint_names : tuple of str, or None
        The names of the columns; None if they are in the robot's order.
    approach : (N, n), or None
        The direction in which each joint moved before it came to rest: 1 up, -1 down, 0 unknown. None if no direction
        is known: identification then takes the order of the rows for that of the poses, and names no friction.
    angles : "rad", or None
        States that angles are in rad. If it is None, methods of robots compare them with their limits, and refuse what
        looks like degrees.
    places : tuple of str
        Where each pose comes from, as messages name it.
    notes : tuple of str
        What else the table contains, one note each.

    Examples
    --------
    >>> import jounce, numpy as np
    >>> robot = jounce.load("ur5")
    >>> q = np.random.default_rng(0).uniform(-1.5, 1.5, (30, 6))
    >>> jounce.Poses(q, robot.gravity_forces(q))
    30 poses of 6 joints at rest
    """

    q: np.ndarray
    torques: np.ndarray
    joint_names: tuple[str, ...] | None = None
    approach: np.ndarray | None = None
    angles: str | None = field(default=None, kw_only=True)
    places: tuple[str, ...] = field(default=(), kw_only=True)
    notes: tuple[str, ...] = field(default=(), kw_only=True)

    def __post_init__(self) -> None:
        names = None if self.joint_names is None else _check_texts("joint_names", self.joint_names)
        if names is not None and len({*names}) < len(names):
            raise JounceError(f"joint_names is {quote_value(self.joint_names)}; expected each joint once")
        # Positions of all joints are known, torques of some joints in some poses may be missing.
        q = _check_rows("q", self.q, None if names is None else len(names))
        if not np.isfinite(q).all():
            raise JounceError(f"q holds {q[~np.isfinite(q)][0]:g}; expected positions of all joints, rad or m")
        torques = _check_rows("torques", self.torques, None, q.shape)
        if np.isinf(torques).any():
            raise JounceError("torques hold inf; expected numbers, NaN for those not measured")
        if not np.isfinite(torques).any():
            raise JounceError(f"none of {len(q)} poses has a torque; {NO_TORQUES_CURE}")
        # Directions of approach are signs, and each pose has a name for messages.
        approach = None if self.approach is None else _check_rows("approach", self.approach, None, q.shape)
        if approach is not None and not np.isin(approach, (-1.0, 0.0, 1.0)).all():
            wrong = approach[~np.isin(approach, (-1.0, 0.0, 1.0))][0]
            raise JounceError(f"approach holds {wrong:g}; expected 1 of a joint that moved up, -1 down, 0 if unknown")
        if self.angles is not None:
            check_choice("unit of angles", self.angles, ("rad",))
        notes, places = (_check_texts(label, getattr(self, label)) for label in ("notes", "places"))
        places = places if len(places) > 0 else tuple(f"pose {k}" for k in range(len(q)))
        if len(places) != len(q):
            raise JounceError(f"places has {len(places)} entries; expected {len(q)}, one per pose")
        for name, value in (("q", q), ("torques", torques), ("joint_names", names), ("approach", approach)):
            object.__setattr__(self, name, value)
        object.__setattr__(self, "places", places)
        object.__setattr__(self, "notes", notes)

    def __len__(self) -> int:
        return len(self.q)

    def __repr__(self) -> str:
        return f"{len(self.q)} poses of {self.q.shape[1]} joints at rest"

    @property
    def directions(self) -> np.ndarray:
        """The directions (N, n) from which joints came: those stated, or those from pose to pose."""
        if self.approach is not None:
            return self.approach
        steps = np.diff(self.q, axis=0, prepend=self.q[:1])
        return np.sign(np.where(np.abs(steps) > MAX_REST_RANGE, steps, 0.0))


NO_TORQUES_CURE = Remedy(
    "expected columns such as tau_JOINT, named by torques='tau{number}'",
    "expected columns such as tau_JOINT, named by --torques 'tau{number}'",
)


def _check_texts(label: str, texts: Sequence[str]) -> tuple[str, ...]:
    """Return several texts of a caller."""
    items = errors.as_list(texts)
    if isinstance(texts, str) or not all(isinstance(text, str) for text in items):
        raise JounceError(f"{label} is {quote_value(texts)}; expected texts in a list")
    return tuple(items)


def _check_rows(label: str, values: ArrayLike, columns: int | None, shape: tuple[int, ...] | None = None) -> np.ndarray:
    """Return rows (N, n) of numbers, of a known number or shape."""
    numbers = np.asarray(scalars.asarray(values, label))
    if shape is not None:
        fits, expected = numbers.shape == shape, f"{shape}, as q"
    else:
        fits = numbers.ndim == 2 and numbers.size > 0 and columns in (None, numbers.shape[1])
        expected = "(N, n)" if columns is None else f"(N, {columns}), one per joint name"
    if numbers.dtype.kind not in "fiu" or not fits:
        raise JounceError(f"{label} is {quote_value(values)} of shape {numbers.shape}; expected numbers {expected}")
    return numbers.astype(float)


# Holds of a log.
class Hold(NamedTuple):
    """Rows of a log in which all joints rest."""

    start: int
    stop: int  # the row after the last


def find_holds(t: np.ndarray, q: np.ndarray, torques: np.ndarray, joints: Sequence[str]) -> Poses:
    """Return the holds of a log as poses: t (N,), q and torques (N, n).

    Raise `JounceError` where a joint drifts in a hold, or where the log has none.
    """
    step = float(np.median(np.diff(t))) if len(t) > 1 else np.inf
    window = round(MIN_HOLD_SECONDS / step) if step > 0 else 0
    if window < MIN_HOLD_ROWS:
        cure = "if each row is a pose at rest, leave the column of times out"
        raise JounceError(
            f"rows are {step:.3g} s apart; holds need {MIN_HOLD_ROWS} rows in {MIN_HOLD_SECONDS:g} s: {cure}"
        )
    limits = np.maximum(MAX_REST_RANGE, MAX_REST_STEPS * _encoder_steps(q))
    ranges = _moving_ranges(q, window)
    lasting = _moving_ranges(t[:, None], window)[:, 0] < MAX_GAP_SHARE * MIN_HOLD_SECONDS
    rests = (ranges < limits).all(axis=1) & lasting
    holds = _join_holds(q, _runs(rests), limits)
    if len(holds) == 0:
        quietest = int((ranges / limits).max(axis=1).argmin())
        j = int((ranges[quietest] / limits).argmax())
        raise JounceError(
            f"no hold in which all joints rest for {MIN_HOLD_SECONDS:g} s: {shorten(joints[j])} moves by at"
            f" least {ranges[quietest, j]:.2g} rad or m in that time; expected a log that stops in each pose"
        )
    slow = (ranges < MAX_DRIFT_RANGES * limits).all(axis=1) & lasting
    restless = [run for run in _runs(slow) if not rests[run.start : run.stop].any()]
    for hold in (*holds, *restless):
        _refuse_drift(t, q, hold, limits, joints)
    # Half of the window at both ends of a hold belongs to it, of which joints settle in one half.
    means = np.stack([q[start:stop].mean(axis=0) for start, stop in holds])
    forces = np.full((len(holds), torques.shape[1]), np.nan)
    for k, (start, stop) in enumerate(holds):
        rows = torques[max(0, start - window // 4) : stop + window // 4]
        measured = np.isfinite(rows).any(axis=0)
        forces[k, measured] = np.nanmean(rows[:, measured], axis=0)
    # Each joint came from where it was last outside of the range about the hold, since the hold before.
    approach = np.zeros_like(means)
    for k, (start, _) in enumerate(holds):
        before = q[holds[k - 1].stop if k > 0 else 0 : start] - means[k]
        for j in range(q.shape[1]):
            outside = np.flatnonzero(np.abs(before[:, j]) > limits[j])
            if len(outside) > 0:
                approach[k, j] = -np.sign(before[outside[-1], j])
    places = tuple(f"hold from {t[start]:.4g} to {t[stop - 1]:.4g} s" for start, stop in holds)
    seconds = sum(t[stop - 1] - t[start] for start, stop in holds)
    note = f"{len(holds)} holds of {seconds:.3g} s together are used, and nothing between them"
    return Poses(means, forces, tuple(joints), approach, angles="rad", places=places, notes=(note,))


def _encoder_steps(q: np.ndarray) -> np.ndarray:
    """Return the steps (n,) of encoders; 0 of those without."""
    steps = np.array([noise.find_step(column)[0] for column in q.T])
    # Positions that are set, and not measured, are multiples of anything.
    return np.where(steps < MAX_ENCODER_STEP, steps, 0.0)


def _moving_ranges(values: np.ndarray, window: int) -> np.ndarray:
    """Return the ranges of columns (N, k) in a window about each row."""
    from scipy.ndimage import maximum_filter1d, minimum_filter1d  # imported here to keep start-up fast

    size = window + 1
    return np.asarray(
        maximum_filter1d(values, size, axis=0, mode="nearest") - minimum_filter1d(values, size, axis=0, mode="nearest")
    )


def _runs(mask: np.ndarray) -> list[Hold]:
    """Return the runs of a mask (N,)."""
    edges = np.flatnonzero(np.diff(mask.astype(np.int8), prepend=0, append=0))
    return [Hold(int(start), int(stop)) for start, stop in edges.reshape(-1, 2)]


def _join_holds(q: np.ndarray, holds: Sequence[Hold], limits: np.ndarray) -> list[Hold]:
    """Join holds between which no joint moves: two rows of one pose would count its friction twice."""
    joined: list[Hold] = []
    for hold in holds:
        if len(joined) > 0 and (np.ptp(q[joined[-1].start : hold.stop], axis=0) < limits).all():
            joined[-1] = Hold(joined[-1].start, hold.stop)
        else:
            joined.append(hold)
    return joined


def _refuse_drift(t: np.ndarray, q: np.ndarray, hold: Hold, limits: np.ndarray, joints: Sequence[str]) -> None:
    """Raise `JounceError` of a joint that drifts in a hold."""
    quarter = max(1, (hold.stop - hold.start) // 4)
    first, last = q[hold.start : hold.start + quarter], q[hold.stop - quarter : hold.stop]
    drift = np.abs(last.mean(axis=0) - first.mean(axis=0))
    j = int((drift / limits).argmax())
    if drift[j] < limits[j]:
        return
    span = f"from {t[hold.start]:.4g} to {t[hold.stop - 1]:.4g} s"
    raise JounceError(
        f"{shorten(joints[j])} drifts by {drift[j]:.2g} rad or m in the hold {span}; expected joints at rest:"
        " leave these rows out, or hold the pose until it stands"
    )
