"""The names of all quantities, as a type.

Type checkers read them in the stub of this module.
"""

from typing import Literal

from jounce.dynamics.quantities import QUANTITIES

QuantityName = Literal[tuple(QUANTITIES)]
