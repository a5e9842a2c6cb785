"""Property tests run the same examples everywhere, however slow the machine."""

import pytest
from hypothesis import settings

settings.register_profile("jounce", deadline=None, max_examples=40, derandomize=True)
settings.load_profile("jounce")


@pytest.fixture(scope="session", autouse=True)
def _own_cache(tmp_path_factory):
    """Native code of the tests is compiled by them, and leaves nothing in the user's cache."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("JOUNCE_CACHE_DIR", str(tmp_path_factory.mktemp("kernels")))
        yield
