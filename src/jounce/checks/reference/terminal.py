"""Output that foreign code writes directly to standard error, bypassing Python."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from tempfile import TemporaryFile


@contextmanager
def errors_caught(said: list[str]) -> Iterator[None]:
    """Within this context, output to standard error is captured, and appended to `said` at the end."""
    try:
        before = os.dup(2)
    except OSError:  # closed: nothing to keep it from
        yield
        return
    with TemporaryFile() as file:
        os.dup2(file.fileno(), 2)
        try:
            yield
        finally:
            os.dup2(before, 2)
            os.close(before)
            file.seek(0)
            said.append(file.read().decode(errors="replace"))
