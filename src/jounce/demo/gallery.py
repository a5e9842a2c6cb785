"""The pictures of the paper's example, by name."""

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

import numpy as np

from jounce.demo.example import Example, StepErrors
from jounce.demo.steps import errors_over_steps
from jounce.figures.canvas import painted
from jounce.figures.curves import Panel, over_time
from jounce.figures.drawing import View, draw
from jounce.figures.schematic import schematic
from jounce.robot import Robot

if TYPE_CHECKING:
    from matplotlib.figure import Figure

POSE = np.array([0, -0.2, 0, 0.45, 0, 0.55, 0])  # rad, a little bent, so that its axes can be told apart


def gallery(
    alone: Example, loaded: Example, errors: tuple[StepErrors, StepErrors]
) -> Mapping[str, "Callable[[], Figure]"]:
    """Name of each picture, and what paints it."""
    wrench = r"the last body exerts $10\,\sin(\pi t)$ in all six components of its wrench, N m and N"
    return {
        "forces": lambda: forces(alone, ""),
        "forces-wrench": lambda: forces(loaded, wrench),
        "step-size": lambda: errors_over_steps(*errors),
        "planar2r": schematic,
        "iiwa14": lambda: portrait(alone.robot),
    }


def forces(found: Example, title: str) -> "Figure":
    """q, Q, Qd and Q2d over time, the last two with numerical differentiation laid over."""
    differentiated = (None, None, *found.differentiated)
    labels = (r"$q$ [rad]", r"$Q$ [N m]", r"$\dot{Q}$ [N m/s]", r"$\ddot{Q}$ [N m/s²]")

    def by_joint(values: np.ndarray) -> dict[str, np.ndarray]:
        return dict(zip(found.robot.joint_names, values.T, strict=True))

    panels = [
        Panel(label, by_joint(exact), None if rough is None else by_joint(rough))
        for label, exact, rough in zip(labels, (found.motion.rates[0], *found.forces), differentiated, strict=True)
    ]
    return over_time(found.motion.t, panels, title)


def portrait(robot: Robot) -> "Figure":
    """The iiwa with its frames, joint axes and centres of mass."""

    def paint(figure: "Figure") -> None:
        draw(figure.subplots(), robot.mechanism, robot.poses(POSE), View(-55, 18))

    return painted(paint, 6, 6)
