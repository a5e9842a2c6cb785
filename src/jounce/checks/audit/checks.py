"""`audit`: all the checks in a row."""

from collections.abc import Callable, Iterable

import numpy as np

from jounce.checks.audit.finding import SEVERITIES, Finding
from jounce.checks.audit.inertias import (
    check_inertias,
    check_massless,
    check_placeholders,
    check_point_masses,
    check_singular,
    check_unit_masses,
)
from jounce.checks.audit.limits import check_axes, check_degrees, check_formulas, check_stated_limits
from jounce.checks.audit.units import check_densities, check_gravity, check_masses, check_sizes
from jounce.core.errors import JounceError
from jounce.model.mechanism import Mechanism

CHECKS: tuple[Callable[[Mechanism], Iterable[Finding]], ...] = (
    check_inertias,
    check_singular,
    check_placeholders,
    check_unit_masses,
    check_densities,
    check_masses,
    check_sizes,
    check_massless,
    check_point_masses,
    check_stated_limits,
    check_degrees,
    check_axes,
    check_gravity,
    check_formulas,
)


def audit(mechanism: Mechanism) -> tuple[Finding, ...]:
    """Check the data of a mechanism of numbers, and return the findings, errors first."""
    if not mechanism.is_numeric:
        raise JounceError(f"robot {mechanism.name!r} contains symbols; an audit needs numbers")
    with np.errstate(all="ignore"):  # of numbers near the ends of the doubles, which are not judged
        found = [finding for check in CHECKS for finding in check(mechanism)]
    return tuple(sorted(found, key=lambda finding: list(SEVERITIES).index(finding.severity)))
