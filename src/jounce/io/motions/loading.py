"""`load_motion`: the motion of a robot from a file, by name, or from named columns."""

import os
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from jounce._typing import Angles, ArrayLike, Shaped, TimeUnit
from jounce.arguments import names
from jounce.arguments.rates import checked_order
from jounce.errors import JounceError, at, quoted
from jounce.io import motions
from jounce.io.files import path_of
from jounce.robot import Robot

if TYPE_CHECKING:
    from jounce.motion import Motion

PLACE = "the motion"  # where columns without a file stand, in messages


def load_motion(
    source: str | os.PathLike[str] | Shaped | Mapping[str, ArrayLike],
    /,
    robot: Robot,
    order: int = 2,
    degree: int | None = None,
    intervals: int | None = None,
    *,
    bandwidth: float | None = None,
    force: bool = False,
    time: str | None = None,
    columns: str | None = None,
    torques: str | None = None,
    angles: Angles | None = None,
    time_unit: TimeUnit | None = None,
    topic: str | None = None,
) -> "Motion":
    """Load a motion of a robot as a function of time: from a file, by name, or from named columns.

    Columns are matched by joint name in any order: ``t`` and either one column per joint (samples; the rates are those
    of a spline) or ``NAME.q, NAME.qd, NAME.q2d, ...`` (used as they are), and if wrenches act ``BODY.mx .. BODY.fz``.

    Parameters
    ----------
    source : str, path or columns
        The path of a .csv, .npz, .yaml or .yml file, "paper", "paper-wrench", or columns (N,) of numbers in SI units: a
        dict, a data frame, a structured array.
    robot : Robot
        The robot that moves.
    order : int, optional
        The highest rate of the forces to be computed: 2, for Q2d, takes q to q4d, which the source must have.
    degree : int, optional
        Take samples as they are, by a spline of degree 7 (C^6) or 5 (C^4) through all of them; by default they are
        smoothed, as their noise asks for, and rates have standard deviations.
    intervals : int, optional
        Fit such a spline by least squares over this number of intervals.
    bandwidth : float, optional
        The frequency in Hz up to which samples are followed; by default as far as the motion stands out of the noise.
    force : bool, optional
        Take samples whose noise drowns the highest rate all the same.
    time : str, optional
        The column of times; by default t, else time or timestamp.
    columns : str, optional
        How the table calls the joints: "q_{joint}", or "q{number}" from 1, "q[{index}]" from 0, in the robot's order.
    torques : str, optional
        How the table calls measured torques, in the same way: "tau{number}"; by default ``tau_JOINT``, ``JOINT.tau``
        and ``JOINT.effort`` are known.
    angles : {"rad", "deg"}, optional
        The unit of angles and their rates; a column may state its own, ``joint1 [deg]``.
    time_unit : {"s", "ms", "us", "ns"}, optional
        The unit of times.
    topic : str, optional
        The topic of a ROS bag to read; by default its only one of type JointTrajectory or JointState.

    Returns
    -------
    Motion
        Frozen: ``motion(t, order)`` gives q, qd, ... at any times.

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
    if not isinstance(robot, Robot):
        raise JounceError(f"a motion is loaded for a Robot, not for a {type(robot).__name__}; try jounce.load")
    from jounce.motion.columns import Options
    from jounce.motion.spline import way_of

    mechanism, highest, way = robot.mechanism, checked_order(order) + 2, way_of(degree, intervals, bandwidth, force)
    options = Options(time, columns, angles, time_unit, torques)
    if topic is not None and not isinstance(topic, str):
        raise JounceError(f"topic is {quoted(topic)}; expected a text")
    if names.listed_in(source) is not None:
        from jounce.io.motions import tabular

        if topic is not None:
            raise JounceError(f"{PLACE}: topic is for bags of ROS, not for columns: leave it out")
        return tabular.of_arrays(_arrays(source), mechanism, highest, way, options, PLACE)
    if not isinstance(source, str | os.PathLike):
        known = f"a path, one of {', '.join(motions.BUNDLED)}, or named columns"
        raise JounceError(f"a motion is of type {type(source).__name__}; expected {known}")
    path = path_of(source)
    return motions.read(path, mechanism, highest, way, options, topic)


def _arrays(source: Any) -> dict[str, Any]:
    with at(PLACE):
        columns = names.entries(source)
        odd = [name for name in columns if not isinstance(name, str)]
        if odd:
            raise JounceError(f"column {quoted(odd[0])} has no text as its name; expected t and names of joints")
        return columns
