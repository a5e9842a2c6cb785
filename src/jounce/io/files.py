"""Checks, reading and writing of files, shared by all readers and writers."""

import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from hashlib import sha256
from pathlib import Path
from typing import BinaryIO

from jounce.core.errors import JounceError, one_line, quote_value
from jounce.core.temporary_files import remove_abandoned, temporary_path

CHECKSUM_BLOCK_BYTES = 1 << 20  # read at a time: files of any size are checked in little memory


@contextmanager
def system_errors(path: Path, what: str = "", cure: str = "") -> Iterator[None]:
    """Within this context, errors of the system become `JounceError`: the path, what failed and why, and the cure."""
    try:
        yield
    except OSError as error:
        raise JounceError(f"{path}: {what}{error.strerror or one_line(error)}{cure}") from None


def check_readable(path: Path) -> None:
    """Raise `JounceError` if there is no file at `path`."""
    with system_errors(path):
        found, is_file = path.exists(), path.is_file()
    if not is_file:
        raise JounceError(f"{path}: {'is not a file' if found else 'no such file'}")


def read_bytes(path: Path) -> bytes:
    """The content of a file."""
    with open_file(path) as file:
        return file.read()


@contextmanager
def open_file(path: Path) -> Iterator[BinaryIO]:
    """Open a file for reading; within this context its errors become `JounceError`."""
    check_readable(path)
    with system_errors(path, "cannot be read: "), path.open("rb") as file:
        yield file


def check_writable(path: Path) -> None:
    """Raise `JounceError` if no file can be written to `path`, before any work is done."""
    folder = path.parent
    with system_errors(path):
        if not folder.is_dir():
            raise JounceError(f"{path}: no folder {str(folder)!r} to write into")
        if not os.access(folder, os.W_OK):
            raise JounceError(f"{path}: the folder {str(folder)!r} is not writable")
        if path.exists() and not path.is_file():
            raise JounceError(f"{path}: exists and is not a file")


def make_folder(path: Path) -> None:
    """Create a folder if it is missing; raise `JounceError` if that fails."""
    with system_errors(path, "cannot be created: "):
        try:
            path.mkdir(exist_ok=True)
        except FileNotFoundError:
            raise JounceError(f"{path}: no folder {str(path.parent)!r} to create it in") from None
        except FileExistsError:
            raise JounceError(f"{path}: exists and is not a folder") from None


@contextmanager
def write_errors(path: Path, cure: str = "") -> Iterator[None]:
    """Within this context, errors of writing a file or folder become `JounceError`; `cure` ends the sentence."""
    try:
        with system_errors(path, "cannot be written: ", cure):
            yield
    except UnicodeEncodeError as error:  # half a character in a name
        raise JounceError(f"{path}: cannot write a name: {one_line(error)}") from None


@contextmanager
def write_whole(path: Path) -> Iterator[Path]:
    """Yield a path to write to, next to `path`, and move it there at the end, so that no partial file is ever seen.

    The new file gets the mode of the file that it replaces; until then only its owner can read it.
    """
    check_writable(path)
    target = path.resolve()
    remove_abandoned(target.parent)
    part, mode = temporary_path(target.parent), file_mode(target)
    try:
        with write_errors(path):
            part.touch(0o666 if mode is None else 0o600, exist_ok=False)
            yield part
            if mode is not None:
                part.chmod(mode)
            part.replace(target)
    finally:
        part.unlink(missing_ok=True)


def file_mode(path: Path) -> int | None:
    """Return the permissions of a path, or None if it does not exist."""
    with suppress(FileNotFoundError):
        return stat.S_IMODE(path.stat().st_mode)
    return None


def expand_path(given: str | os.PathLike[str]) -> Path:
    """Return a caller's path, with a leading ~ expanded."""
    try:
        path = Path(given).expanduser()
        if b"\0" in os.fsencode(path):
            raise ValueError("it contains a zero byte")
    except Exception as error:  # half a character, a home of nobody, and errors of any foreign path
        raise JounceError(f"{quote_value(given)} is not a path: {one_line(error)}") from None
    return path


def checksum(path: Path) -> str:
    """The checksum of a file."""
    found = sha256()
    with path.open("rb") as file:
        while block := file.read(CHECKSUM_BLOCK_BYTES):
            found.update(block)
    return found.hexdigest()
