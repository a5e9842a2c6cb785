"""Motions: coordinates over time with all the rates that higher-order inverse dynamics takes in."""

from jounce.motion.motion import Break, Motion

__all__ = ["Break", "Motion"]
