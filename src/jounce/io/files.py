"""Files and the numbers in them, as every reader takes them."""

import math
from pathlib import Path

from jounce.errors import JounceError


def check_readable(path: Path) -> None:
    """Raise `JounceError` where there is no file at `path`."""
    try:
        found, is_file = path.exists(), path.is_file()
    except OSError as error:
        raise JounceError(f"{path}: {error.strerror or error}") from None
    if not is_file:
        raise JounceError(f"{path}: {'is not a file' if found else 'no such file'}")


def read_bytes(path: Path) -> bytes:
    """The content of a file."""
    check_readable(path)
    try:
        return path.read_bytes()
    except OSError as error:
        raise JounceError(f"{path}: cannot be read: {error.strerror or error}") from None


def finite(text: str) -> float | None:
    """The finite decimal number that a text is, or None; 1_000 and digits of other scripts are none here."""
    if "_" in text or not text.isascii():
        return None
    try:
        number = float(text)
    except ValueError:
        return None
    return number if math.isfinite(number) else None
