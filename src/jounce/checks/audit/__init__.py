"""The audit of a robot's data: physically impossible values, and values that suggest a mistake in a file."""

from jounce.checks.audit.checks import audit
from jounce.checks.audit.finding import SEVERITIES, Finding
from jounce.checks.audit.inertias import check_inertias

__all__ = ["SEVERITIES", "Finding", "audit", "check_inertias"]
