"""How many bodies a robot may have: memory grows with the square of it, so it is bounded before anything is built."""

import os

from jounce.core.errors import JounceError, quote_value

MAX_BODIES = 5000  # a matrix of all joint variables by all coordinates takes 200 MB then, and a robot keeps a few
VARIABLE = "JOUNCE_MAX_BODIES"


def check_size(bodies: int) -> None:
    """Raise `JounceError` where a robot would have more bodies on movable joints than are allowed."""
    stated = os.environ.get(VARIABLE) or str(MAX_BODIES)
    if not (stated.isascii() and stated.isdigit()):
        raise JounceError(f"{VARIABLE}={quote_value(stated)}; expected the largest number of bodies")
    if bodies > int(stated):
        why = f"a mass matrix would take {8e-9 * bodies**2:.2g} GB; the environment variable {VARIABLE} raises this"
        raise JounceError(f"{bodies} movable joints; expected up to {stated}: {why}")
