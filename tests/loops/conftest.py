"""The bundled robots with closed loops, read once."""

import pytest

import jounce
from support.closed_robots import LOOP_ROBOTS


@pytest.fixture(scope="session")
def closed():
    """The bundled robots with closed loops by name."""
    return {name: jounce.load(name) for name in LOOP_ROBOTS}
