"""The table of quantities holds everything that is known about them.

It has one row each, and is the index of the package. Methods of robots, native code,
generated code, CasADi, symbolic form, the command and the documentation derive what they need from these rows. A new
quantity takes its mathematics and a row.
"""

from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache

from jounce.dynamics.quantities.bodies import Bodies, Momenta, Wrenches
from jounce.dynamics.quantities.forces import Forces, Forward, Matrices, Regressors
from jounce.dynamics.quantities.loops import Contacts, Loops
from jounce.dynamics.quantities.motors import Motors
from jounce.dynamics.quantities.partials import Partials
from jounce.dynamics.quantities.row import Quantity

__all__ = ["DEFAULT_QUANTITY", "QUANTITIES", "Quantity", "find_row"]

_TOPICS = (Forces, Forward, Partials, Regressors, Matrices, Bodies, Momenta, Wrenches, Motors, Loops, Contacts)
QUANTITIES: Mapping[str, Quantity] = {
    name: row for topic in _TOPICS for name, row in vars(topic).items() if isinstance(row, Quantity)
}
DEFAULT_QUANTITY = QUANTITIES["inverse_dynamics"]  # the default where a quantity is chosen


@lru_cache(maxsize=64)
def find_row(name: str, more_rates: int = 0) -> Quantity:
    """Return the row of a quantity.

    Springs and motors of a robot may take `more_rates` of the motion.
    """
    row = QUANTITIES[name]
    if more_rates == 0:
        return row
    takes = replace(row.takes, rates=row.takes.rates + more_rates, wrench_rates=row.takes.wrench_rates + more_rates)
    return replace(row, takes=takes)
