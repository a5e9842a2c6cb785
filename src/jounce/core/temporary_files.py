"""Make temporary files next to their final place, and remove abandoned ones."""

import os
import re
from contextlib import suppress
from hashlib import sha256
from pathlib import Path
from time import time

PART_NAME = re.compile(r"\.jounce-(?:([0-9a-f]{8})-(\d+)-)?[0-9a-f]{12}\.part")
MAX_WRITING_TIME = 86400  # s, a day: no single file takes longer, so that an older part is abandoned


def temporary_path(folder: Path) -> Path:
    """Return a path to write to until all is there.

    Its name says which process on which machine writes.
    """
    return folder / f".jounce-{_machine_digest()}-{os.getpid()}-{os.urandom(6).hex()}.part"


def remove_abandoned(folder: Path) -> None:
    """Remove the parts that killed runs have left."""
    with suppress(OSError):
        matches = [(path, PART_NAME.fullmatch(path.name)) for path in folder.iterdir()]
        abandoned = [
            path for path, match in matches if match is not None and (_is_gone(match[1], match[2]) or _is_old(path))
        ]
        for path in abandoned:
            if path.is_dir() and not path.is_symlink():
                import shutil  # imported here to keep start-up fast

                shutil.rmtree(path, ignore_errors=True)
            else:
                with suppress(OSError):  # another run was faster, or it belongs to another user
                    path.unlink()


def _is_gone(machine: str | None, process: str) -> bool:
    """Return whether a process of this machine is known to have ended."""
    if machine != _machine_digest() or not hasattr(os, "uname"):  # on Windows signal 0 is Ctrl-C
        return False
    try:
        os.kill(int(process), 0)
    except ProcessLookupError:
        return True
    except (OSError, OverflowError):  # another user's, for one
        return False
    try:
        state = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:  # of systems that have no such file
        return False
    return state in "ZX"  # it ended, and its parent has not collected its exit status


def _is_old(path: Path) -> bool:
    with suppress(OSError):
        return time() - path.lstat().st_mtime > MAX_WRITING_TIME
    return False


def _machine_digest() -> str:
    """Return the name of this machine and container in eight digits.

    Process numbers of others mean nothing here.
    """
    name = os.uname().nodename if hasattr(os, "uname") else ""
    with suppress(OSError):  # of systems without containers
        name += str(Path("/proc/self/ns/pid").readlink())
    return sha256(name.encode()).hexdigest()[:8]
