"""Reads and writes files and folders.

All readers and writers check their paths here, before any work is done, and errors of the system become one line with
the path and the reason. `write_whole` and `write_folder` write next to the target under a temporary name and move the
complete file or folder there at the end: no partial file is ever seen. A folder is written whole, all files or none,
without loss of a user's files: only files that bear the mark of an earlier run are replaced or removed.

`hold_lock` lets one run at a time write into an output: by the lock of a file in its work folder, which ends with the
process.
"""

import os
import re
import shutil
import stat
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import partial
from hashlib import sha256
from pathlib import Path
from typing import BinaryIO

from jounce.core.cures import Remedy
from jounce.core.errors import JounceError, join_names, one_line, quote_value
from jounce.core.temporary_files import remove_abandoned, temporary_path

CHECKSUM_BLOCK_BYTES = 1 << 20  # read at a time: files of any size are checked in little memory


@contextmanager
def system_errors(path: Path, what: str = "", cure: str = "") -> Iterator[None]:
    """Turn errors of the system within this context into `JounceError`.

    Its line has the path, what failed and why, and the cure.
    """
    try:
        yield
    except OSError as error:
        raise JounceError(f"{path}: {what}{error.strerror or one_line(error)}{cure}") from None


def check_readable(path: Path) -> None:
    """Raise `JounceError` if there is no file at `path`."""
    with system_errors(path):
        exists, is_file = path.exists(), path.is_file()
    if not is_file:
        raise JounceError(f"{path}: {'is not a file' if exists else 'no such file'}")


def read_bytes(path: Path) -> bytes:
    """Return the content of a file."""
    with open_file(path) as file:
        return file.read()


@contextmanager
def open_file(path: Path) -> Iterator[BinaryIO]:
    """Open a file for reading.

    Within this context its errors become `JounceError`.
    """
    check_readable(path)
    with system_errors(path, "cannot be read: "), path.open("rb") as file:
        yield file


def check_writable(path: Path) -> None:
    """Raise `JounceError` if no file can be written to a path.

    It is called before any work is done.
    """
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
    """Turn errors of writing within this context into `JounceError`.

    `cure` ends the sentence.
    """
    try:
        with system_errors(path, "cannot be written: ", cure):
            yield
    except UnicodeEncodeError as error:  # half a character in a name
        raise JounceError(f"{path}: cannot write a name: {one_line(error)}") from None


@contextmanager
def write_whole(path: Path) -> Iterator[Path]:
    """Yield a path next to `path`, and move its file there.

    The file is moved at the end, so that no partial file is ever seen. The new file gets the mode of the file that it
    replaces; until then only its owner can read it.
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
    """Return the permissions of a path, None if it does not exist."""
    with suppress(FileNotFoundError):
        return stat.S_IMODE(path.stat().st_mode)
    return None


def expand_path(path_of_caller: str | os.PathLike[str]) -> Path:
    """Return a caller's path, with a leading ~ expanded."""
    try:
        path = Path(path_of_caller).expanduser()
        if b"\0" in os.fsencode(path):
            raise ValueError("it contains a zero byte")
    except Exception as error:  # half a character, a home of nobody, and errors of any foreign path
        raise JounceError(f"{quote_value(path_of_caller)} is not a path: {one_line(error)}") from None
    return path


def checksum(path: Path) -> str:
    """Return the SHA-256 checksum of a file."""
    digest = sha256()
    with path.open("rb") as file:
        for block in iter(partial(file.read, CHECKSUM_BLOCK_BYTES), b""):
            digest.update(block)
    return digest.hexdigest()


# Folders: which files are there, and which of them may be replaced or removed.
def check_folder(folder: Path, mark: str, names: list[str], overwrite: bool) -> None:
    """Raise `JounceError` if `write_folder` would.

    It is called before any work is done.
    """
    with system_errors(folder):
        present_names = sorted(path.name for path in folder.iterdir()) if folder.is_dir() else []
        if folder.exists() and not folder.is_dir():
            raise JounceError(f"{folder}: exists and is not a folder")
        if len(present_names) > 0 and not overwrite:
            cure = f"expected a new or empty folder, or {Remedy('overwrite=True', '--overwrite')}"
            raise JounceError(f"{folder}: is not empty ({join_names(present_names, most=3)}); {cure}")
        foreign = [name for name in names if name in present_names and not _is_marked(folder / name, mark)]
    if len(foreign) > 0:
        raise JounceError(f"{folder / foreign[0]}: not generated by jounce; it is never overwritten")
    check_writable(folder / "any" if folder.is_dir() else folder)


def write_folder(folder: Path, files: Mapping[str, str], mark: str, overwrite: bool) -> None:
    """Write the files of a folder, all of them or none.

    The folder need not be empty if `overwrite` is true: files of the same names are replaced, if they bear the mark;
    files that a former run left and this one does not write are removed; all others stay. A file that is replaced
    passes its mode on, and so does the folder.
    """
    check_folder(folder, mark, list(files), overwrite)
    target = folder.resolve()
    remove_abandoned(target.parent)
    part, mode = temporary_path(target.parent), file_mode(target)
    try:
        with system_errors(folder, "cannot be written: "):
            part.mkdir(0o777 if mode is None else 0o700)
            for name, text in files.items():
                (part / name).write_text(text, encoding="utf-8", newline="\n")
                former_mode = file_mode(target / name)
                if former_mode is not None:
                    (part / name).chmod(former_mode)
            if target.is_dir() and any(target.iterdir()):
                # A folder with files keeps those of a user: files are moved into it one by one.
                stale = _find_stale_files(target, files, mark)
                for name in files:
                    (part / name).replace(target / name)
                for path in stale:
                    path.unlink()
            else:
                # The system refuses to remove a folder that is no longer empty.
                if mode is not None:
                    part.chmod(mode)
                    target.rmdir()
                part.replace(target)
    finally:
        shutil.rmtree(part, ignore_errors=True)


def _find_stale_files(folder: Path, files: Mapping[str, str], mark: str) -> list[Path]:
    """Return marked files of a former run that are not rewritten.

    A file that is to be replaced names them. A user's copy of generated code is marked as well, but no generated file
    names it.
    """
    replaced_files = [folder / name for name in files if _is_marked(folder / name, mark)]
    texts = (path.read_text(encoding="utf-8", errors="replace") for path in replaced_files)
    words = {word for text in texts for word in re.findall(r"\w+", text)}
    # Some file systems take A for a.
    written_names = {name.casefold() for name in files}
    return [
        path
        for path in sorted(folder.iterdir())
        if path.stem in words and path.name.casefold() not in written_names and _is_marked(path, mark)
    ]


def _is_marked(path: Path, mark: str) -> bool:
    """Return whether a file has the mark within its first lines."""
    if path.is_symlink() or not path.is_file():
        return False
    with path.open("rb") as file:
        return mark.encode() in file.read(4096)


LOCK_FILE = "_jounce.lock"


@contextmanager
def hold_lock(work: Path, output: Path) -> Iterator[None]:
    """Hold the lock of a work folder, unless another run does.

    A lock ends with its process, however the process ends.
    """
    make_folder(work)
    file = _take_lock(work / LOCK_FILE, output)
    try:
        yield
    finally:
        with suppress(OSError):
            # The work folder stays where a run left results to go on with.
            (work / LOCK_FILE).unlink()
            work.rmdir()
        if file is not None:
            os.close(file)


def _take_lock(path: Path, output: Path) -> int | None:
    """Return the file of the lock, None where there are no locks.

    Some systems and disks have none.
    """
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
        # The lock counts only if it is on the file that has this name now: another run may have removed the file in
        # between.
        with suppress(FileNotFoundError):
            if os.fstat(file).st_ino == path.stat().st_ino:
                os.ftruncate(file, 0)
                os.write(file, str(os.getpid()).encode())
                return file
        os.close(file)
