"""Folders written as a whole: all files or none, and nothing of a user's lost."""

import re
import shutil
from collections.abc import Mapping
from pathlib import Path

from jounce._parts import part_in, remove_abandoned
from jounce.errors import JounceError, listed
from jounce.io.files import check_writable, mode_of


def check_folder(folder: Path, mark: str, names: list[str], force: bool) -> None:
    """Raise `JounceError` where `write_folder` would, before any work is done for it."""
    try:
        there = sorted(path.name for path in folder.iterdir()) if folder.is_dir() else []
        if folder.exists() and not folder.is_dir():
            raise JounceError(f"{folder}: exists and is not a folder")
        if there and not force:
            raise JounceError(
                f"{folder}: is not empty ({listed(there, most=3)}); expected a new or empty folder, or --force"
            )
        foreign = [name for name in names if name in there and not _is_marked(folder / name, mark)]
    except OSError as error:
        raise JounceError(f"{folder}: {error.strerror or error}") from None
    if foreign:
        raise JounceError(f"{folder / foreign[0]}: was not made by jounce; it is not replaced, with --force neither")
    check_writable(folder / "any" if folder.is_dir() else folder)


def write_folder(folder: Path, files: Mapping[str, str], mark: str, force: bool) -> None:
    """Write texts as the files of a folder, all of them or none.

    With `force` it need not be empty. Files of the same names are replaced, if they bear the mark; those that a former
    run left and this one does not write are removed; all others stay. What is replaced passes its mode on, the folder
    too.
    """
    check_folder(folder, mark, list(files), force)
    target = folder.resolve()
    remove_abandoned(target.parent)
    part, mode = part_in(target.parent), mode_of(target)
    try:
        part.mkdir(0o777 if mode is None else 0o700)
        for name, text in files.items():
            (part / name).write_text(text, encoding="utf-8", newline="\n")
            if (before := mode_of(target / name)) is not None:
                (part / name).chmod(before)
        if target.is_dir() and any(target.iterdir()):
            stale = _stale(target, files, mark)
            for name in files:
                (part / name).replace(target / name)
            for path in stale:
                path.unlink()
        else:
            if mode is not None:
                part.chmod(mode)
                target.rmdir()  # empty, as is checked anew by the system
            part.replace(target)
    except OSError as error:
        raise JounceError(f"{folder}: cannot be written: {error.strerror or error}") from None
    finally:
        shutil.rmtree(part, ignore_errors=True)


def _stale(folder: Path, files: Mapping[str, str], mark: str) -> list[Path]:
    """The marked files of a former run that are not written again: those that a file to be replaced speaks of.

    A user's copy of generated code is marked as well, but nothing speaks of it.
    """
    replaced = [folder / name for name in files if _is_marked(folder / name, mark)]
    texts = (path.read_text(encoding="utf-8", errors="replace") for path in replaced)
    words = {word for text in texts for word in re.findall(r"\w+", text)}
    kept = {name.casefold() for name in files}  # as file systems compare that take A for a
    return [
        path
        for path in sorted(folder.iterdir())
        if path.stem in words and path.name.casefold() not in kept and _is_marked(path, mark)
    ]


def _is_marked(path: Path, mark: str) -> bool:
    """Whether a file bears the mark within its first lines."""
    if path.is_symlink() or not path.is_file():
        return False
    with path.open("rb") as file:
        return mark.encode() in file.read(4096)
