"""Native code as users get it, not as tests/conftest.py speeds it up."""

import pytest

OF_MATHEMATICS = {"test_products", "test_second_derivatives"}  # which no optimization of machine code changes


@pytest.fixture(autouse=True)
def _native_code(request):
    """Of every test here that is of code, not of what it computes."""
    if request.path.stem not in OF_MATHEMATICS:
        request.getfixturevalue("as_shipped")
