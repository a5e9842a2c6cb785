"""MuJoCo's models, mjModel: what dynamics needs of their arrays, as links and joints."""

from jounce.io.models.mujoco.tree import mechanism

__all__ = ["mechanism"]
