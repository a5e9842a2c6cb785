"""How long the attacks run: part of a round from a fixed seed in `make test`, until the time is over in `make fuzz`."""

import os

import pytest

from fuzz.attack import Budget


@pytest.fixture
def budget(request):
    """The share of one attack in the seconds that all of them have, side by side on the workers of pytest-xdist."""
    seconds, workers = request.config.option.fuzz_seconds, int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1"))
    attacks = sum("budget" in item.fixturenames for item in request.session.items)
    return Budget(request.config.option.fuzz_seed, seconds * workers / attacks)
