"""Motions: coordinates over time with all the rates that higher-order inverse dynamics takes in."""

from jounce.motion.states import Motion

__all__ = ["Motion"]
