"""`load_motion` and `load_poses`: motions and poses at rest from a file, by name, or from columns."""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args

from jounce.arguments.rates import check_order
from jounce.core import named_entries
from jounce.core.cures import option_name
from jounce.core.errors import JounceError, check_bool, check_choice, door, locate_errors, quote_value
from jounce.core.typing import Angles, ArrayLike, OnError, RowKind, Shaped, TimeUnit
from jounce.engine.along import with_vibration_notes
from jounce.engine.engine import Engine
from jounce.io import files, motions
from jounce.model import positions
from jounce.model.mechanism import Mechanism

if TYPE_CHECKING:
    from jounce.motion import Motion
    from jounce.motion.poses import Poses

PLACE = "the motion"  # the place of columns without a file, in messages


@door
def load_motion(
    source: str | os.PathLike[str] | Shaped | Mapping[str, ArrayLike],
    /,
    robot: Engine,
    order: int = 2,
    degree: int | None = None,
    intervals: int | None = None,
    *,
    bandwidth: float | None = None,
    allow_noise: bool = False,
    time: str | None = None,
    columns: str | Mapping[str, str] | None = None,
    torques: str | None = None,
    torque_constants: ArrayLike | Mapping[str, float] | None = None,
    gear_ratios: ArrayLike | Mapping[str, float] | None = None,
    angles: Angles | None = None,
    time_unit: TimeUnit | None = None,
    rename: Mapping[str, str] | None = None,
    unwrap: bool = False,
    on_error: OnError = "stop",
    topic: str | None = None,
    episode: int | None = None,
    measured: Literal["links", "motors"] | None = None,
    as_: RowKind | None = None,
    duration: float | None = None,
    tolerance: float | None = None,
) -> "Motion":
    """Load a motion of a robot as a function of time.

    It comes from a file, by name, or from named columns.

    Columns are matched by joint name in any order: ``t`` and either one column per joint (samples; the rates are those
    of a spline) or ``NAME.q, NAME.qd, NAME.q2d, ...`` (used unchanged), and if wrenches act ``BODY.mx .. BODY.fz``. Of
    balls, planar and free joints these are ``NAME.qx, ...`` and ``NAME.qxd, ...``, or velocities ``NAME.wx, ...``.

    Parameters
    ----------
    source : str, path or columns
        The path of a file; "paper", the cosines of the paper's iiwa example, "paper-wrench", with the wrench of its
        figure too; or columns (N,) in SI units: a dict, data frame, structured array.
    robot : Robot
        The robot that moves.
    order : int, optional
        The highest rate of the forces to be computed: 2, for Q2d, needs q to q4d.
    degree : int, optional
        Interpolate samples by a spline of degree 7 (C^6) or 5 (C^4); by default they are smoothed according to their
        noise, and rates have standard deviations.
    intervals : int, optional
        Fit such a spline by least squares over this number of intervals.
    bandwidth : float, optional
        Bandwidth of the smoothing in Hz; by default chosen from the noise in the samples.
    allow_noise : bool, optional
        Accept samples even if noise dominates the highest rate.
    time : str, optional
        The column of times; by default t, else time or timestamp.
    columns : str or mapping, optional
        Pattern of the joints' columns: "q_{joint}", or in the robot's order "q{number}" from 1, "q[{index}]" from 0.
        Or the column of each joint: ``{"joint1": "base", "joint2": "elbow"}``.
    torques : str, optional
        Pattern of the columns of measured torques: "tau{number}"; by default ``tau_JOINT``, ``JOINT.tau``,
        ``JOINT.effort``, ...
    torque_constants, gear_ratios : number, (n,) or mapping, optional
        Constants in N m/A, N/A of prismatic joints, and ratios of gears, 1 by default: the columns of torques are
        currents in A then, such as ``current_JOINT``, and the torques are constant * ratio * current.
    angles : {"rad", "deg"}, optional
        The unit of angles and their rates; a column may state its own, ``joint1 [deg]``.
    time_unit : {"s", "ms", "us", "ns"}, optional
        The unit of times.
    rename : mapping, optional
        New names of columns: ``{"base": "joint1"}`` of a column, with its unit or without. With stars of a prefix,
        wherever names of joints or bodies stand: ``{"fer_*": "panda_*"}`` reads ``fer_joint1`` as ``panda_joint1``, and
        ``tau_fer_joint1`` as its torques.
    unwrap : bool, optional
        Remove the jumps by whole turns, 2 pi or 360 degrees, of revolute joints whose encoders wrap. Angles continue
        from the first row, or whole turns from there within the joint's limits. By default tables whose angles wrap are
        refused.
    on_error : {"stop", "skip"}, optional
        Whether bad rows of a table are refused, the first of them in the message, or left out with a note.
    topic : str, optional
        The topic of a ROS bag to read; by default its only one of type JointTrajectory or JointState.
    episode : int, optional
        The episode of a LeRobot data set, its folder or one of its Parquet tables; by default its only one. Data sets
        state no unit of angles: `angles` has to.
    measured : {"links", "motors"}, optional
        Whether the columns hold positions of the links (default) or of the motors behind elastic joints. The positions
        of the links follow from those of the motors if motions are slower than the links swing on their springs.
    as_ : {"samples", "commands"}, optional
        What the rows are: samples of a motion, or commands of a controller, one per period, which are neither smoothed
        nor interpolated: `Robot.check` takes their differences, as those of `Motion.sampled`.
    duration, tolerance : float, optional
        How long the motion lasts along way points, rows without a column of times, and how far it may be from corners
        between straight lines: see `Motion.waypoints`. A YAML file of such has ``points: [[...], ...]``.

    Returns
    -------
    Motion
        The motion, immutable: ``motion(t, order)`` returns q, qd, ... at any times.

    Raises
    ------
    JounceError
        If the file cannot be read, columns are missing or unknown, t does not increase, or there are too few samples.

    Warns
    -----
    JounceWarning
        If velocity, acceleration or jerk jump, or rounding noise of the samples dominates the highest rate.

    Examples
    --------
    >>> import numpy as np, jounce
    >>> robot, t = jounce.load("planar2r"), np.linspace(0, 1, 101)
    >>> motion = jounce.load_motion({"t": t, "joint2": np.sin(t), "joint1": np.cos(t)}, robot)
    >>> Q, Qd, Q2d = robot.forces_along(motion).forces
    >>> Q2d.shape
    (101, 2)
    """
    if not isinstance(robot, Engine):
        raise JounceError(f"load_motion() expects a jounce.Robot, got {type(robot).__name__}; try jounce.load")
    from jounce.motion.spline import select_smoothing
    from jounce.motion.table_columns import ColumnOptions

    # Forces with rates up to an order need q with rates up to two orders more.
    mechanism, highest = robot.mechanism, check_order(order) + 2
    smoothing = select_smoothing(degree, intervals, bandwidth, allow_noise, as_)
    skip = check_choice("on_error", on_error, get_args(OnError)) == "skip"
    names = (time, columns, angles, time_unit, torques, () if rename is None else rename)
    options = ColumnOptions(*names, unwrap, skip, torque_constants, gear_ratios, episode)  # type: ignore[arg-type]
    if topic is not None and not isinstance(topic, str):
        raise JounceError(f"topic is {quote_value(topic)}; expected a text")
    if measured is not None:
        check_choice("measured", measured, ("links", "motors"))
    if duration is not None or tolerance is not None:
        return _load_points(source, mechanism, (smoothing, options, topic, measured), duration, tolerance)
    if named_entries.entry_names(source) is not None:
        from jounce.io.motions import logs

        if topic is not None:
            raise JounceError(f"{PLACE}: topic is for ROS bags, not for columns; leave it out")
        motion = logs.read_arrays(_arrays(source), mechanism, highest, smoothing, options, PLACE)
    elif isinstance(source, str | os.PathLike):
        motion = motions.read(files.expand_path(source), mechanism, highest, smoothing, options, topic)
    else:
        expected = f"a path, one of {', '.join(motions.BUNDLED_MOTIONS)}, or named columns"
        raise JounceError(f"load_motion() expects {expected}, got {type(source).__name__}")
    # Notes are about the positions as they were measured: of the motors, if these are given.
    motion = with_vibration_notes(motion, robot)
    if measured == "motors":
        from jounce.actuators.link_motion import recover_links

        return recover_links(robot, motion)
    return motion


def _load_points(
    source: Any, mechanism: Mechanism, reading: tuple[Any, Any, Any, Any], duration: Any, tolerance: Any
) -> "Motion":
    """Load the motion along way points, which have no times."""
    from jounce.motion.spline import refuse_smoothing
    from jounce.motion.table_columns import DURATION_CURE, UntimedError

    smoothing, options, topic, measured = reading
    rows: Path | dict[str, object]
    if isinstance(source, str | os.PathLike):
        rows, place = files.expand_path(source), str(source)
    elif named_entries.entry_names(source) is not None:
        rows, place = _arrays(source), PLACE
    else:
        raise JounceError(f"load_motion() expects a path or named columns of way points, got {type(source).__name__}")
    if duration is None:
        raise UntimedError(f"{place}: {option_name('tolerance')} is for way points; {DURATION_CURE}")
    reason = "way points have no times"
    refuse_smoothing(smoothing, place, reason)
    over_time = {"unwrap": options.unwrap, "time_unit": options.time_unit, "topic": topic, "measured": measured}
    for name, value in over_time.items():
        if value not in (None, False):
            raise JounceError(f"{place}: {reason}; {option_name(name)} is for motions over time: leave it out")
    return motions.read_points(rows, mechanism, options, duration, tolerance, place)


@door
def load_poses(
    source: str | os.PathLike[str] | Shaped | Mapping[str, ArrayLike],
    /,
    robot: Engine,
    *,
    holds: bool | None = None,
    columns: str | Mapping[str, str] | None = None,
    torques: str | None = None,
    torque_constants: ArrayLike | Mapping[str, float] | None = None,
    gear_ratios: ArrayLike | Mapping[str, float] | None = None,
    angles: Angles | None = None,
    rename: Mapping[str, str] | None = None,
    time: str | None = None,
    time_unit: TimeUnit | None = None,
    unwrap: bool = False,
    on_error: OnError = "stop",
) -> "Poses":
    """Load poses of a robot at rest, with measured torques.

    They determine a load, first moments and constant torques: see `Robot.payload` and `Robot.identify`. A table without
    times holds a pose in each row: columns of positions and torques, matched by joint name as by `load_motion`. Of a
    log, which has times, the poses are its holds: the stretches of half a second or more in which all joints rest.

    What remains of friction at rest has the direction from which a joint came. A log shows it; a table may state it in
    columns ``JOINT.approach``, 1 up, -1 down, 0 unknown.

    Parameters
    ----------
    source : str, path or columns
        The path of a table, or columns (N,) in SI units: a dict, data frame, structured array.
    robot : Robot
        The robot that rests.
    holds : bool, optional
        Whether the table is a log whose holds are the poses, True, or has a pose in each row, False; by default a table
        with times is a log.
    columns, torques, torque_constants, gear_ratios, angles, rename, time, time_unit, unwrap, on_error : optional
        How the table is read, as of `load_motion`.

    Returns
    -------
    Poses

    Raises
    ------
    JounceError
        If columns are missing or unknown, no torque is measured, a row has velocities that are not zero, a log has no
        hold, or a joint drifts in one.

    Examples
    --------
    >>> import jounce, numpy as np
    >>> robot = jounce.load("planar2r")
    >>> q = np.linspace([0, 1], [2, 0], 12)
    >>> columns = {name: x for name, x in zip(["joint1", "joint2"], q.T)}
    >>> columns |= {name: x for name, x in zip(["tau_joint1", "tau_joint2"], robot.gravity_forces(q).T)}
    >>> jounce.load_poses(columns, robot)
    12 poses of 2 joints at rest
    """
    if not isinstance(robot, Engine):
        raise JounceError(f"load_poses() expects a jounce.Robot, got {type(robot).__name__}; try jounce.load")
    from jounce.io.motions import untimed
    from jounce.motion.table_columns import ColumnOptions

    positions.check_single_screws(robot.mechanism, "load_poses()")
    if holds is not None:
        check_bool("holds", holds, "whether the holds of a log are the poses")
    skip = check_choice("on_error", on_error, get_args(OnError)) == "skip"
    names = (time, columns, angles, time_unit, torques, () if rename is None else rename)
    options = ColumnOptions(*names, unwrap, skip, torque_constants, gear_ratios)  # type: ignore[arg-type]
    if named_entries.entry_names(source) is not None:
        return untimed.read_poses(_arrays(source), robot.mechanism, options, holds, "the poses")
    if isinstance(source, str | os.PathLike):
        path = files.expand_path(source)
        return untimed.read_poses(path, robot.mechanism, options, holds, str(path))
    raise JounceError(f"load_poses() expects a path of a table, or named columns, got {type(source).__name__}")


def _arrays(source: Any) -> dict[str, object]:
    """Return named columns, all of whose names are strings."""
    with locate_errors(PLACE):
        columns = named_entries.read_entries(source)
        unnamed = [name for name in columns if not isinstance(name, str)]
        if len(unnamed) > 0:
            raise JounceError(
                f"column {quote_value(unnamed[0])} is not named by a string; expected t and names of joints"
            )
        return columns
