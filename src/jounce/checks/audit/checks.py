"""`audit`: all the checks in a row."""

from collections.abc import Callable, Iterable

import numpy as np

from jounce.checks.audit.finding import SEVERITIES, Finding
from jounce.checks.audit.inertias import impossible, placeholders, point_masses, unit_masses
from jounce.checks.audit.limits import axes, degrees, limits
from jounce.checks.audit.mobility import massless, singular
from jounce.checks.audit.names import formulas
from jounce.checks.audit.units import densities, gravity, masses, sizes
from jounce.core.errors import JounceError
from jounce.model.mechanism import Mechanism

CHECKS: tuple[Callable[[Mechanism], Iterable[Finding]], ...] = (
    impossible,
    singular,
    placeholders,
    unit_masses,
    densities,
    masses,
    sizes,
    massless,
    point_masses,
    limits,
    degrees,
    axes,
    gravity,
    formulas,
)


def audit(mechanism: Mechanism) -> tuple[Finding, ...]:
    """Check the data of a mechanism of numbers, and return the findings, errors first."""
    if not mechanism.is_numeric:
        raise JounceError(f"robot {mechanism.name!r} contains symbols; an audit needs numbers")
    with np.errstate(all="ignore"):  # of numbers near the ends of the doubles, which are not judged
        found = [finding for check in CHECKS for finding in check(mechanism)]
    return tuple(sorted(found, key=lambda finding: list(SEVERITIES).index(finding.severity)))
