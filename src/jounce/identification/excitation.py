"""Excitation: the motion within all limits whose forces determine the parameters of a robot best."""

from dataclasses import dataclass

import numpy as np

from jounce.core.errors import JounceError, join_names
from jounce.core.typing import ArrayLike, DriveTerms
from jounce.engine.engine import Engine
from jounce.identification.excitation_search import ExcitationSearch, Progress
from jounce.identification.excitation_setup import check_number, check_whole_number, prepare_search
from jounce.identification.harmonics import MIN_HARMONICS, Harmonics
from jounce.limits.check import check
from jounce.limits.verdicts import Check, CheckedLimit
from jounce.model.drives import DRIVE_TERMS, select_terms
from jounce.model.parameters import find_load_frame
from jounce.motion import Motion

MAX_HARMONICS = 50  # more are slips of the pen
MAX_REPETITIONS = 1000  # of starts, and of periods: likewise
MAX_CONDITION = 1e5  # of W^(1/2) Y: beyond it the data do not separate the parameters
MAX_SHRINK_STEPS = 30  # towards a pose at rest, until a motion is within the limits between its points too
MIN_SHRINKAGE = 1e-4  # of the size, in the first step; it doubles from step to step


@dataclass(frozen=True, repr=False)
class Excitation:
    """A motion that excites the parameters of a robot. `Robot.excite` makes one.

    Attributes
    ----------
    motion : Motion
        The Fourier series; every period starts and ends at rest, q4d = 0 included.
    criterion : float
        log det of the information matrix, the time mean of Y^T W Y: Y the regressor of `parameters` in SI units, W the
        weights of the forces.
    condition : float
        Condition number of W^(1/2) Y, its columns of unit length.
    parameters : tuple of str
        The base parameters and drive terms that forces along the motion determine.
    unseen : tuple of str
        Those that no motion of this robot separates from them.
    check : Check
        Every limit along the motion, between samples too.
    notes : tuple of str
        What was assumed, in words.

    Examples
    --------
    >>> import jounce
    >>> robot = jounce.load("planar2r").with_limits(lower=-2, upper=2, velocity=3, effort=[60, 20])
    >>> found = robot.excite(period=4, harmonics=4, starts=2)
    >>> found.check.ok, found.unseen, len(found.parameters)
    (True, (), 6)
    """

    motion: Motion
    criterion: float
    condition: float
    parameters: tuple[str, ...]
    unseen: tuple[str, ...]
    check: Check
    notes: tuple[str, ...] = ()

    def __repr__(self) -> str:
        size = f"{len(self.parameters)} parameters, condition {self.condition:.4g}"
        return f"<Excitation: {self.motion.duration:g} s, {size}; worst: {self.check.worst}>"

    @property
    def limits(self) -> tuple[CheckedLimit, ...]:
        """Of each kind of limit the one that the motion uses most."""
        table = self.check.table
        kinds = dict.fromkeys(row.limit for row in table)
        return tuple(max((row for row in table if row.limit == kind), key=lambda row: row.ratio) for kind in kinds)

    def __str__(self) -> str:
        rows = [("limit", "joint", "worst", "bound", "unit", "ratio", "at t")]
        for row in self.limits:
            numbers = f"{row.value:.6g}", f"{row.bound:.6g}", row.unit, f"{row.ratio:.4f}", f"{row.t:.4f}"
            rows.append((row.words, row.joint, *numbers))
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        return "\n".join([
            self.motion.source,
            f"{len(self.parameters)} parameters seen, unseen: {join_names(self.unseen) or '-'}",
            f"log det of the information matrix {self.criterion:.6g}, condition number {self.condition:.4g}",
            *self.notes,
            "",
            *("  ".join(map(str.ljust, row, widths)).rstrip() for row in rows),
        ])  # fmt: skip


def excite(
    robot: Engine,
    period: float,
    periods: int,
    harmonics: int,
    drives: DriveTerms,
    weights: ArrayLike | None,
    reach: float,
    margin: float,
    payload: bool | str,
    starts: int,
    seed: int,
    progress: Progress | None,
) -> Excitation:
    """Find the motion that excites a robot within its limits, see `Robot.excite`."""
    count, rng = (
        check_whole_number("starts", starts, 1, MAX_REPETITIONS),
        np.random.default_rng(check_whole_number("seed", seed, 0)),
    )
    times = check_number("period", period, "s"), check_whole_number("periods", periods, 1, MAX_REPETITIONS)
    series = Harmonics(*times, check_whole_number("harmonics", harmonics, MIN_HARMONICS, MAX_HARMONICS))
    load = None
    if payload is not False:
        load = find_load_frame(robot.mechanism, None if payload is True else payload).body
    search, notes = prepare_search(robot, series, select_terms(drives, DRIVE_TERMS), weights, reach, margin, rng, load)
    rest = search.find_rest(rng)
    x, motion, found = _shrink_into_limits(search, search.find_best(count, rng, progress), rest)
    rates, information = search.rates(x), search.information
    condition = information.condition(rates)
    if not condition <= MAX_CONDITION:
        cure = f"expected a longer period, more than {harmonics} harmonics, or wider limits"
        came = f"{len(information.names)} parameters (condition number {condition:.2g})"
        raise JounceError(f"the motion does not separate the {came}; {cure}")
    names, unseen = information.names, information.unseen
    return Excitation(motion, information.log_det(rates), condition, names, unseen, found, notes)


def _shrink_into_limits(search: ExcitationSearch, x: np.ndarray, rest: np.ndarray) -> tuple[np.ndarray, Motion, Check]:
    """A series drawn to a pose at rest as far as limits between its points need it, with its motion and the check."""
    robot, centre, size = search.information.robot, np.zeros_like(x), 1.0
    centre[0] = rest
    # limits hold at rest, so that some share of the series does too: it shrinks by the excess, and faster and faster
    for i in range(MAX_SHRINK_STEPS):
        near = centre + size * (x - centre)
        motion = search.series.motion(near, robot.joint_names)
        found = check(robot, motion.with_step(search.series.step))
        if found.worst.ratio <= search.share:
            return near, motion, found
        size *= 1 - max(1 - search.share / found.worst.ratio, min(MIN_SHRINKAGE * 2**i, 0.5))
    raise JounceError(f"no excitation is found within the limits; the nearest one has {found.worst}")
