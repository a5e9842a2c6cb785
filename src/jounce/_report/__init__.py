"""Reports: one self-contained page about a robot along a motion."""

from jounce._report.page import Report, report

__all__ = ["Report", "report"]
