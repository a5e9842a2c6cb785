"""Property tests run the same examples everywhere, however slow the machine."""

from hypothesis import settings

settings.register_profile("jounce", deadline=None, max_examples=40, derandomize=True)
settings.load_profile("jounce")
