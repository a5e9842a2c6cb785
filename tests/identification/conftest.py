"""An arm of three joints and a motion that excites all its parameters."""

import numpy as np
import pytest

import jounce

SECONDS = 6.0


@pytest.fixture(scope="session")
def arm():
    """Three joints of an arm, whose forearm carries the tool."""
    ur5 = jounce.load("ur5")
    return ur5.locked(dict.fromkeys(ur5.joint_names[3:], 0.1))


@pytest.fixture(scope="session")
def motion():
    """250 samples per second, of which all rates are exact."""
    rng = np.random.default_rng(0)
    exact = jounce.Motion.fourier(np.full(3, 0.3), *rng.uniform(-0.5, 0.5, (2, 3, 3)), 2.0, SECONDS)
    return exact.with_step(SECONDS / 1500)


def table_values(found, ending=""):
    """The values of the rows of a table whose names end like this."""
    return np.array([row.value for row in found.table if row.name.endswith(ending)])
