"""One run at a time writes into an output: the lock of a file in its work folder, which ends with the process."""

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from jounce.core.errors import JounceError
from jounce.io.files import make_folder

LOCK_FILE = "_jounce.lock"


@contextmanager
def hold_lock(work: Path, output: Path) -> Iterator[None]:
    """Hold the lock of a work folder, unless another run does; a lock ends with its process, however that ends."""
    make_folder(work)
    file = _take_lock(work / LOCK_FILE, output)
    try:
        yield
    finally:
        with suppress(OSError):
            (work / LOCK_FILE).unlink()
            work.rmdir()  # if nothing is left to go on with
        if file is not None:
            os.close(file)


def _take_lock(path: Path, output: Path) -> int | None:
    """The file of the lock; None on systems and disks without locks."""
    try:
        import fcntl
    except ImportError:
        return None
    while True:
        file = os.open(path, os.O_RDWR | os.O_CREAT, 0o600)
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            holder = os.read(file, 20).decode(errors="replace")
            os.close(file)
            raise JounceError(
                f"{output}: another run writes there (process {holder or 'unknown'}); wait until it ends, or choose"
                " another output"
            ) from None
        except OSError:
            os.close(file)
            return None
        with suppress(FileNotFoundError):
            if os.fstat(file).st_ino == path.stat().st_ino:
                os.ftruncate(file, 0)
                os.write(file, str(os.getpid()).encode())
                return file
        os.close(file)  # another run has removed it in between
