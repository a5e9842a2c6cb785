"""Excitation: the motion within all limits whose forces tell most about the parameters of a robot."""

from dataclasses import dataclass

import numpy as np

from jounce.core.errors import JounceError, listed
from jounce.core.typing import ArrayLike, DriveColumns
from jounce.engine.engine import Engine
from jounce.identification.harmonics import FEWEST, Harmonics
from jounce.identification.search import Progress, Search
from jounce.identification.setup import number, search_of, whole
from jounce.limits.check import Check, CheckedLimit, check
from jounce.model.drives import select_columns
from jounce.motion import Motion

MOST, MANY = 50, 1000  # harmonics; starts and periods: more are slips of the pen
SINGULAR = 1e5  # condition number from which on parameters cannot be told from each other
DRAWN = 30  # times that a motion is drawn to a pose at rest, until it is within the limits between its points too
LEAST = 1e-4  # of its size, by which it is drawn at first


@dataclass(frozen=True, repr=False)
class Excitation:
    """A motion that excites the parameters of a robot. `jounce.excite` makes one.

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
        The base parameters and drive terms that forces along the motion tell.
    unseen : tuple of str
        Those that no motion of this robot tells from them.
    check : Check
        Every limit along the motion, between samples too.
    notes : tuple of str
        What was assumed, in words.

    Examples
    --------
    >>> import jounce
    >>> robot = jounce.load("planar2r").with_limits(lower=-2, upper=2, velocity=3, effort=[60, 20])
    >>> found = jounce.excite(robot, period=4, harmonics=4, starts=2)
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
        told = f"{len(self.parameters)} parameters, condition {self.condition:.4g}"
        return f"<Excitation: {self.motion.duration:g} s, {told}; worst: {self.check.worst}>"

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
            f"{len(self.parameters)} parameters seen, unseen: {listed(self.unseen) or '-'}",
            f"log det of the information matrix {self.criterion:.6g}, condition number {self.condition:.4g}",
            *self.notes,
            "",
            *("  ".join(map(str.ljust, row, widths)).rstrip() for row in rows),
        ])  # fmt: skip


def excite(
    robot: Engine,
    *,
    period: float = 10.0,
    periods: int = 1,
    harmonics: int = 5,
    drives: DriveColumns = False,
    weights: ArrayLike | None = None,
    reach: float = np.pi,
    margin: float = 0.01,
    starts: int = 5,
    seed: int = 0,
    progress: Progress | None = None,
) -> Excitation:
    """Find a motion whose forces tell most about the base parameters of a robot, within all its limits.

    ``q(t) = c + sum_k a_k cos(k w t) + b_k sin(k w t)``, ``w = 2 pi / period``, for every coordinate, with all rates up
    to q4d zero at the ends of each period: the robot starts and stops at rest, and Q2d has no jump. The amplitudes
    maximize log det H of the information matrix H, the time mean of ``Y^T W Y`` with the regressor Y of the base
    parameters and weights W of the forces: the confidence ellipsoid of identified parameters has the least volume,
    whatever their units. All limits that the robot states hold, between samples too. Obstacles and the robot's own
    links are not seen: position limits keep it from them.

    Parameters
    ----------
    robot : Robot
        With limits, see `Robot.with_limits`. Drive terms that act enter its effort limits.
    period : float, optional
        Of the series, s.
    periods : int, optional
        How often the motion repeats it.
    harmonics : int, optional
        Of the series, 3 to 50.
    drives : bool, str or iterable of str, optional
        Drive terms that are to be identified too, as `Robot.regressor` takes them: "armature", "damping", "friction",
        "spring", "offset"; True for all.
    weights : (n,), optional
        Relative inverse variances of the measured forces; 0 leaves one out. By default the inverse squares of the
        effort limits; equal if a coordinate has none.
    reach : float, optional
        How far a revolute joint without position limits moves to either side of 0 (or away from its only limit, twice
        as far), rad.
    margin : float, optional
        Share of each limit that is left.
    starts, seed : int, optional
        Number of random series to start from, and the seed of their generator.
    progress : callable, optional
        It is called with the number of starts that are done, and of all.

    Returns
    -------
    Excitation
        The `motion`, the `criterion`, the `condition` number, the parameters seen and unseen, and the `check` of all
        limits.

    Raises
    ------
    JounceError
        If the robot floats, has closed loops or states no limit of a rate or force, an argument is out of range, a
        prismatic joint has no position limits, limits leave no room to move, or the motion does not tell the parameters
        from each other.

    References
    ----------
    J. Swevers, C. Ganseman, D. B. Tukel, J. De Schutter, H. Van Brussel, "Optimal Robot Excitation and Identification",
    IEEE Transactions on Robotics and Automation 13(5), 1997.

    Examples
    --------
    >>> import jounce
    >>> robot = jounce.load("planar2r").with_limits(lower=-2, upper=2, velocity=3, effort=[60, 20])
    >>> found = jounce.excite(robot, period=4, harmonics=4, starts=2, drives="friction")
    >>> found.check.ok, found.parameters[-1]
    (True, 'joint2 friction')
    """
    count, rng = whole("starts", starts, 1, MANY), np.random.default_rng(whole("seed", seed, 0))
    times = number("period", period, "s"), whole("periods", periods, 1, MANY)
    series = Harmonics(*times, whole("harmonics", harmonics, FEWEST, MOST))
    search, notes = search_of(robot, series, select_columns(drives), weights, reach, margin, rng)
    rest = search.rest(rng)
    x, motion, found = _within(search, search.best(count, rng, progress), rest)
    rates, told = search.rates(x), search.information
    condition = told.condition(rates)
    if not condition <= SINGULAR:
        raise JounceError(
            f"the motion does not tell the {len(told.names)} parameters from each other (condition number"
            f" {condition:.2g}); expected a longer period, more than {harmonics} harmonics, or wider limits"
        )
    return Excitation(motion, told.log_det(rates), condition, told.names, told.unseen, found, notes)


def _within(search: Search, x: np.ndarray, rest: np.ndarray) -> tuple[np.ndarray, Motion, Check]:
    """A series drawn to a pose at rest as far as limits between its points need it, with its motion and the check."""
    robot, centre, size = search.information.robot, np.zeros_like(x), 1.0
    centre[0] = rest
    for i in range(DRAWN):
        near = centre + size * (x - centre)
        motion = search.series.motion(near, robot.joint_names)
        found = check(robot, motion.with_step(search.series.step))
        if found.worst.ratio <= search.share:
            return near, motion, found
        size *= 1 - max(1 - search.share / found.worst.ratio, min(LEAST * 2**i, 0.5))
    raise JounceError(f"no excitation is found within the limits; the nearest one has {found.worst}")
