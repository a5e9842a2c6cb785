"""The audit of a robot's data: what no body can have, and what a mistake in a file makes look wrong."""

from jounce.checks.audit.checks import audit
from jounce.checks.audit.finding import SEVERITIES, Finding
from jounce.checks.audit.inertias import impossible

__all__ = ["SEVERITIES", "Finding", "audit", "impossible"]
