"""Robot: what users hold, and how its calls are computed."""

from jounce.robot.robot import Robot

__all__ = ["Robot"]
