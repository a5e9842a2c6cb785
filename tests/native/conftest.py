"""Native code as users get it, not as tests/conftest.py speeds it up."""

import pytest


@pytest.fixture(autouse=True)
def _native_code(as_shipped):
    """Of every test here."""
