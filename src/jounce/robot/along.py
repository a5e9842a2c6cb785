"""Forces along a motion, computed piece by piece: working memory is bounded, and a callback can follow the progress."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from jounce.arguments.rates import checked_order
from jounce.dynamics.quantities import FORCES
from jounce.errors import JounceError, listed, quoted
from jounce.model.mechanism import Mechanism
from jounce.motion.states import Motion
from jounce.robot.dispatch import compute
from jounce.spatial.series import rate_name

if TYPE_CHECKING:
    from jounce.robot.robot import Robot

PIECE = 1000  # states

Progress = Callable[[int, int], object]  # of the number of states done, and of all


@dataclass(frozen=True, eq=False)
class Along:
    """The forces along a motion, and the states that they belong to. `Robot.forces_along` makes one.

    Attributes
    ----------
    t : (N,)
        Times in s.
    rates : tuple of (N, n)
        q, qd, q2d, ... of the motion at these times: rad or m, per s, per s^2, ...
    forces : tuple of (N, n)
        Q, Qd, ...: N m for revolute and N for prismatic coordinates, per s, ...; a tuple for order 0 too.

    Examples
    --------
    >>> import jounce
    >>> robot = jounce.load("planar2r")
    >>> motion = jounce.load_motion({"t": range(9), "joint1": [0.1] * 9, "joint2": [0.2] * 9}, robot, order=0)
    >>> along = robot.forces_along(motion, order=0)
    >>> along.forces[0].shape
    (9, 2)
    """

    t: np.ndarray
    rates: tuple[np.ndarray, ...]
    forces: tuple[np.ndarray, ...]


def forces_along(
    robot: "Robot", motion: object, t: object, order: object, method: str | None, progress: Progress | None
) -> Along:
    """The forces and their rates at times of a motion, or along all of it, checked."""
    states = _states(robot.mechanism, motion, t, checked_order(order))
    if progress is not None and not callable(progress):
        raise JounceError(f"progress is {quoted(progress)}; expected a function of two numbers, (done, total)")
    parts = [piece.forces for piece in pieces_along(robot, states, method, progress)]
    return Along(states.t, states.rates, tuple(np.concatenate(terms) for terms in zip(*parts, strict=True)))


def pieces_along(
    robot: "Robot", motion: Motion, method: str | None = None, progress: Progress | None = None
) -> Iterator[Along]:
    """The forces along a motion in pieces of some states, of the order that its rates allow.

    A piece is computed when it is asked for; then `progress` is called with how many states are done, and of how many.
    """
    total = len(motion.t)
    for start in range(0, total, PIECE):
        piece = motion.part(slice(start, start + PIECE))
        forces = compute(robot, FORCES.name, piece.rates, wrench=piece.wrench, method=method)
        if progress is not None:
            progress(start + len(piece.t), total)
        yield Along(piece.t, piece.rates, forces if isinstance(forces, tuple) else (forces,))


def _states(mechanism: Mechanism, motion: object, t: object, order: int) -> Motion:
    """The states at times of a motion, with just the rates that forces to an order take."""
    if not isinstance(motion, Motion):
        came = type(motion).__name__
        raise JounceError(f"forces_along() expects a jounce.Motion, got {came}; jounce.load_motion makes one")
    if motion.joints != mechanism.coordinates:
        expected = listed(mechanism.coordinates)
        raise JounceError(
            f"the motion is one of the joints {listed(motion.joints)}; {mechanism.name!r} has {expected}:"
            " load the motion for this robot"
        )
    names = [rate_name("q", k) for k in range(FORCES.rates + order)]
    if len(motion.rates) < len(names):
        known = ", ".join(names[: len(motion.rates)])
        raise JounceError(
            f"forces to order {order} take q to {names[-1]}, this motion has {known};"
            f" load it with jounce.load_motion(..., order={order})"
        )
    states = motion if t is None else motion.at(t)
    return replace(states, rates=states.rates[: len(names)], wrench=states.wrench and states.wrench[: order + 1])
