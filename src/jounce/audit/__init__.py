"""The audit of a robot's data: what no body can have, and what a mistake in a file makes look wrong."""

from jounce.audit.checks import audit
from jounce.audit.finding import SEVERITIES, Finding
from jounce.audit.inertias import impossible

__all__ = ["SEVERITIES", "Finding", "audit", "impossible"]
